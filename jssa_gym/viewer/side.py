"""One arm inside its shield, with the policy that drives it: a live view has one or two of them."""

from collections import deque

import numpy as np

from jssa_gym.envs.arm import DT, MOVING, ArmEnv
from jssa_gym.evaluation.policy import make_policy
from jssa_gym.evaluation.rollout import Recorder
from jssa_gym.humans import HumanMotion
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import Shield
from jssa_gym.shields.wrappers import layer_of
from jssa_gym.types import Array, Status, Trace
from jssa_gym.viewer.choices import Choices, ShieldChoice, numbers_of
from jssa_gym.viewer.overlays import reachable, swept_stop
from jssa_gym.viewer.snapshot import SERIES, ArmView, History

LONGEST = 60.0
"""So much of an episode is kept to be saved [s]: a page may stay open for days."""

PLOTTED = 10.0
"""So much of it is plotted [s]."""

_EVERY = 4
"""A point of a curve every so many control steps."""

_POLICY_SEEDS = 10**9
"""Added to an episode's seed: what policy and people draw must have nothing in common."""

_ROUNDING = 1.0 + 1e-6
"""How much faster than assumed counts as faster."""


class Side:
    """An environment inside a shield, its policy and its record.

    Args:
        choices: What is played.
        shield: The shield.
        human: Who is there; used as it is, not copied.

    Raises:
        JSSAGymError: Something that was chosen does not exist, or does not fit.
    """

    def __init__(self, choices: Choices, shield: ShieldChoice, human: HumanMotion) -> None:
        self.choices, self.shield, self.human = choices, shield, human
        self.base = ArmEnv(choices.task, human=human, robot=choices.robot, terminate_on=())
        self.env = shield.around(self.base)
        inside = layer_of(self.env, Shield)
        self.assumed: FailsafeParams | None = None if inside is None else inside.filter.failsafe
        """What the verified stop assumes; None without one."""
        self.numbers = {} if inside is None else numbers_of(inside.filter)
        # the environment has copied it, and the shield has looked at it: from now on it is the one that is dragged
        self.base.human = human
        self.robot = self.base.robot
        # fails before anything is taken over
        make_policy(choices.policy, self.base, choices.seed, seen=self.env)
        self.recorder = Recorder(self.env, name=shield.name, most=round(LONGEST / DT))
        self.take: Recorder | None = None
        self._curves: deque[tuple[float, ...]] = deque(maxlen=round(PLOTTED / DT) // _EVERY)

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self.observation, self.info = self.env.reset(seed=seed)
        self.policy = make_policy(self.choices.policy, self.base, _POLICY_SEEDS + seed, seen=self.env)
        self.recorder.begin()
        self._curves.clear()
        self.steps, self.succeeded = 0, 0
        self.smallest, self.moving_contacts, self.too_fast = float(self.info["distance"]), 0, ""

    def step(self) -> None:
        """One control step."""
        action = self.policy(self.observation)
        self.observation, reward, _, _, self.info = self.env.step(action)
        info = self.info
        self.recorder.take(float(reward), info)
        if self.take is not None:
            self.take.take(float(reward), info)
        self.steps += 1
        self.succeeded = self.succeeded + 1 if info["success"] else 0
        self.smallest = min(self.smallest, info["distance"])
        self.moving_contacts += info["contact_speed"] > MOVING
        if not self.too_fast and self.assumed is not None:
            self.too_fast = self._faster_than(self.assumed)
        if self.steps % _EVERY == 0:
            self._curves.append(self._point())

    def roll(self) -> None:
        """Begin a recording for a film, from here on; one that goes on is forgotten."""
        self.cut()
        self.take = Recorder(self.env, name=self.shield.name, most=round(LONGEST / DT))
        self.take.begin()

    def cut(self) -> Trace | None:
        """End the recording; None if there was none, or nothing on it."""
        take, self.take = self.take, None
        if take is None:
            return None
        take.close()
        return take.trace() if len(take) else None

    def close(self) -> None:
        """Free what the environment holds."""
        self.env.close()

    # ---- what is seen ----------------------------------------------------------------------------------

    def view(self, promise: str, overlays: tuple[bool, bool]) -> ArmView:
        """The present.

        Args:
            promise: Why nothing is promised; empty where something is.
            overlays: Whether the swept stop and the people's reach are asked for.
        """
        base, info, near = self.base, self.info, self.base.closest
        scene, goal = base.scene, base.goal
        stop = reach = None
        if any(overlays):
            swept, time = swept_stop(self.robot, scene.robot, base.dt)
            stop = swept if overlays[0] else None
            if overlays[1] and scene.human.names:
                reach = reachable(scene.human, self.assumed or FailsafeParams(), time)
        assumed = self.assumed
        held = (
            ""
            if assumed is None
            else f"nobody faster than {assumed.human_speed:g} m/s, hands {assumed.limb_speed:g} m/s"
        )
        return ArmView(
            name=self.shield.name,
            position=scene.robot.position.copy(),
            capsules=base.robot_capsules,
            line=base.line,
            goal=goal if goal.shape == (3,) else None,
            distance=near.distance,
            closest=self.smallest,
            phi=float(info.get("shield/phi", np.nan)),
            margin=float(info.get("shield/margin", np.nan)),
            override=float(info.get("shield/override", np.nan)),
            speed=self._share(scene.robot.velocity, self.robot.limits.velocity),
            jerk=self._share(info["jerk"], self.robot.limits.jerk),
            status=Status(info.get("shield/status", Status.NOMINAL)),
            reason=str(info.get("shield/reason", "")),
            contact=bool(info["contact"]),
            contact_speed=float(info["contact_speed"]),
            moving_contacts=self.moving_contacts,
            success=bool(info["success"]),
            numbers=self.numbers,
            promise=promise or held,
            promised=not promise,
            stop=stop,
            reach=reach,
            history=self.history(),
        )

    def history(self) -> History:
        """The curves of the last seconds."""
        points = np.array(self._curves, np.float64).reshape(-1, 1 + len(SERIES))
        return History(points[:, 0], points[:, 1:].T)

    def _point(self) -> tuple[float, ...]:
        info, scene = self.info, self.base.scene
        return (
            scene.time,
            info["distance"],
            float(info.get("shield/phi", np.nan)),
            float(info.get("shield/margin", np.nan)),
            float(info.get("shield/override", np.nan)),
            self._share(scene.robot.velocity, self.robot.limits.velocity),
            self._share(info["jerk"], self.robot.limits.jerk),
            float(info.get("shield/status", 0)),
        )

    @staticmethod
    def _share(values: Array, bounds: Array) -> float:
        return float(np.abs(values / bounds).max())

    def _faster_than(self, assumed: FailsafeParams) -> str:
        """Who is faster than assumed at present; empty if nobody is."""
        people = self.base.scene.human
        for k, name in enumerate(people.names):
            ends = people.start_velocity[k], people.end_velocity[k]
            for velocity, bound in zip(ends, assumed.end_speeds_of(name), strict=True):
                speed = float(np.sqrt(velocity.dot(velocity)))
                if speed > bound * _ROUNDING:
                    return f"{name.replace('_', ' ')} was {speed:.1f} m/s fast, {bound:g} is assumed"
        return ""
