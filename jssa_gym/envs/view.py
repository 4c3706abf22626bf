"""Cameras for what goes on: live, from what may come, or of an episode that is known."""

import copy
from collections.abc import Sequence

import numpy as np

from jssa_gym.envs.camera import ELEVATION, Camera, balls_of, chosen, framing
from jssa_gym.envs.drawing import goal_points
from jssa_gym.envs.surroundings import posed
from jssa_gym.humans import HumanMotion
from jssa_gym.humans.body import some_of
from jssa_gym.robots import RobotModel
from jssa_gym.safety.postures import reach_of
from jssa_gym.types import CapsuleSet, Trace

_AROUND, _CLOSE = 0.6, 0.2
"""People count for the frame of an episode, and live, while they are no further outside of the arm's reach [m]."""

_SHARE = 0.75
"""Share of its reach that the arm, live, is expected to use."""

_AZIMUTH = 98.0
"""Azimuth of the live camera, which does not know yet where people will be closest [degrees]."""

_REHEARSALS, _SECONDS, _STEP = 4, 8.0, 0.04
_LOOKS = 40
"""So many moments of an episode are looked at to choose a camera."""


def live_camera(robot: RobotModel, human: HumanMotion, aspect: float) -> Camera:
    """A camera for episodes to come: the arm's reach, and where people have been in a few rehearsed ones.

    Args:
        robot: The arm, where it stands.
        human: The people; they are copied.
        aspect: Width of the picture over its height.
    """
    people: list[CapsuleSet] = []
    arm = posed(robot, robot.home).robot_capsules
    for seed in range(_REHEARSALS):
        who = copy.deepcopy(human)
        now = who.reset(np.random.default_rng(seed))
        for k in range(round(_SECONDS / _STEP)):
            if k % 5 == 0:
                people.append(around(robot, now, _CLOSE))
            now = who.step(_STEP, arm)
    points, radius = balls_of(people)
    reach = _SHARE * reach_of(robot)
    middle = robot.mount + np.array([0.0, 0.0, 0.4 * reach])
    return framing(np.vstack([points, middle]), np.append(radius, reach), _AZIMUTH, aspect=aspect)


def episode_camera(
    traces: Sequence[Trace], robot: RobotModel, aspect: float = 1.0, elevation: float = ELEVATION
) -> Camera:
    """A camera that has arm, goal and people of recorded episodes in the picture, all the time.

    Of people it has those in the picture who are near enough to matter; who leaves, leaves the picture.

    Args:
        traces: Episodes of one robot beside the same people, or several.
        robot: The robot, where it stands.
        aspect: Width of the picture over its height.
        elevation: Of looking, negative downwards [degrees].
    """
    balls, moments = [], []
    for trace in traces:
        count = len(trace.time)
        contacts = np.flatnonzero(trace.contact)[:1]
        for k in np.unique([*np.linspace(0, count - 1, min(count, _LOOKS)).astype(int), *contacts]):
            people = around(robot, people_of(trace, k))
            arm = posed(robot, trace.position[k], people)
            balls.append(balls_of([arm.robot_capsules, people]))
            moments.append((balls_of([arm.robot_capsules])[0], people, arm.line))
            goal = goal_points(robot, trace.goal[k], trace.holds)
            if goal is not None:
                balls.append((goal, np.full(len(goal), 0.05)))
    points, radius = (np.concatenate(parts) for parts in zip(*balls, strict=True))
    return chosen(points, radius, moments, elevation, aspect)


def people_of(trace: Trace, k: int) -> CapsuleSet:
    """Everybody at a row of a recording, as if standing still."""
    still = np.zeros_like(trace.human_start[k])
    ends = trace.human_start[k], trace.human_end[k]
    return CapsuleSet(*ends, still, still, trace.human_radius, trace.human_names, trace.human_person)


def around(robot: RobotModel, people: CapsuleSet, beyond: float = _AROUND) -> CapsuleSet:
    """Those who have a part no further ``beyond`` the arm's reach than that [m], as a whole."""
    middle = (people.start + people.end)[:, :2] / 2.0 - robot.mount[:2]
    near = np.hypot(*middle.T) < reach_of(robot) + beyond
    return some_of(people, np.isin(people.person, people.person[near]))
