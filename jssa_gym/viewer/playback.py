"""A saved episode as moments to be shown."""

import math
from pathlib import Path

import numpy as np

from jssa_gym.envs.view import people_of
from jssa_gym.evaluation.trace import load_trace
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import MENAGERIE, ROBOTS, RobotModel, make_robot
from jssa_gym.safety.proximity import measure
from jssa_gym.types import JointState, Planes, Status, Trace
from jssa_gym.viewer.choices import Choices
from jssa_gym.viewer.overlays import arm_capsules
from jssa_gym.viewer.side import PLOTTED
from jssa_gym.viewer.snapshot import ArmView, History, Snapshot

_EVERY = 4
"""A point of a curve every so many control steps."""


class Playback:
    """An episode from a file.

    Args:
        path: As :func:`~jssa_gym.evaluation.trace.save_trace` wrote it.
        choices: What is played live meanwhile.
        robot: The live robot, where it stands: the episode's, if it has that name.

    Raises:
        TraceError: It is no complete, unchanged recording.
        ParameterError: It is of a robot that is neither the package's nor the live one.
    """

    def __init__(self, path: Path, choices: Choices, robot: RobotModel) -> None:
        self.trace: Trace = load_trace(path)
        if not len(self.trace.time):
            raise ParameterError(f"{path.name} has no step to show")
        self.robot = self._robot_of(self.trace, robot).mounted(self.trace.mount)
        self.name, self._choices = path.stem, choices
        self.epoch = -2 - hash((path, self.trace.time[-1])) % 10**6  # no live one has it
        self._limits = self.robot.limits

    @staticmethod
    def _robot_of(trace: Trace, live: RobotModel) -> RobotModel:
        if trace.robot == live.name:
            return live
        if trace.robot not in (*ROBOTS, *MENAGERIE):
            raise ParameterError(f"the episode's robot is {trace.robot!r}: open it beside that one, --robot FILE")
        return make_robot(trace.robot)

    @property
    def length(self) -> float:
        """[s]."""
        return float(self.trace.time[-1])

    def at(self, time: float) -> Snapshot:
        """The moment at a time [s]; the nearest there is."""
        trace = self.trace
        k = int(np.clip(np.searchsorted(trace.time, time - trace.dt / 2.0), 0, len(trace.time) - 1))
        people = people_of(trace, k)
        state = JointState(trace.position[k], trace.velocity[k], trace.acceleration[k])
        near = measure(self.robot, state, people, Planes(trace.plane_normal, trace.plane_offset, trace.plane_names))
        moved = trace.contact_speed[: k + 1] > 1e-3
        view = ArmView(
            name=self.name,
            position=trace.position[k],
            capsules=arm_capsules(self.robot, state),
            line=near.points,
            goal=trace.goal[k] if trace.goal.shape[1] == 3 else None,
            distance=float(trace.distance[k]),
            closest=float(trace.distance[: k + 1].min(initial=math.inf)),
            phi=float(trace.phi[k]),
            margin=float(trace.margin[k]),
            override=float(trace.override[k]),
            speed=float(np.abs(trace.velocity[k] / self._limits.velocity).max()),
            jerk=float(np.abs(trace.jerk[k] / self._limits.jerk).max()),
            status=Status(int(trace.status[k])),
            reason=str(trace.reason[k]),
            contact=bool(trace.contact[k]),
            contact_speed=float(trace.contact_speed[k]),
            moving_contacts=int(moved.sum()),
            success=bool(trace.success[k]),
            numbers={},
            promise="a saved episode",
            promised=False,
            stop=None,
            reach=None,
            history=self._history(k),
        )
        return Snapshot(
            answered=0, number=-k - 1, epoch=self.epoch, time=float(trace.time[k]), choices=self._choices,
            robot=self.robot, people=people, arms=(view,), paused=True, scrubbed=True, length=self.length,
        )  # fmt: skip

    def _history(self, k: int) -> History:
        trace = self.trace
        rows = np.arange(max(0, k + 1 - round(PLOTTED / trace.dt)), k + 1)[::-1][::_EVERY][::-1]
        speed = np.abs(trace.velocity[rows] / self._limits.velocity).max(axis=1)
        jerk = np.abs(trace.jerk[rows] / self._limits.jerk).max(axis=1)
        status = trace.status[rows].astype(np.float64)
        curves = (trace.distance, trace.phi, trace.margin, trace.override)
        return History(trace.time[rows], np.array([*(curve[rows] for curve in curves), speed, jerk, status]))
