"""The paper's handover: the arm brings a tool to a hand that comes nearer meanwhile."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jssa_gym.evaluation.rollout import rollout
from jssa_gym.humans import HumanMotion, Receive
from jssa_gym.policies.jpc import JPCPolicy
from jssa_gym.robots import JointLimits
from jssa_gym.safety.postures import tool_point
from jssa_gym.types import Array, Trace

_PICK = np.radians((-20.279, 33.041, -2.341, 0.0, -54.635, 35.493))
"""Where the arm has picked up the tool [rad]: the pose of the paper's authors."""

BEGIN = 1.5
"""When the delivery begins [s]: the hand has been held out by then."""

ARRIVED = 0.03
"""Distance from the handover point that counts as there [m], as of the task."""

STEPS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Delivery:
    """One handover."""

    trace: Trace
    tip: Array
    """Tool centre point, shape (T, 3) [m]."""
    goal: Array
    """Handover point, shape (T, 3) [m]."""
    replans: NDArray[np.bool_]
    """Whether a plan was asked for in the step, the first one not counted, shape (T,)."""
    limits: JointLimits

    @property
    def error(self) -> Array:
        """Distance of the tool centre point from the handover point, shape (T,) [m]."""
        return np.linalg.norm(self.tip - self.goal, axis=1)


def recipient() -> HumanMotion:
    """The person of the paper's Fig. 9: the hand is held low, then raised and moved towards the arm, at once at its
    speed, as it is in the figures.
    """
    fixed = {
        "front": 1.3,
        "side": 0.0,
        "forward": 0.42,
        "aside": 0.15,
        "height": 1.05,
        "nearer": 0.08,
        "higher": 0.2,
        "speed": 0.4,
        "wait": 0.1,
        "hold": 1.2,
        "stay": 60.0,
    }
    return Receive(**{name: (value, value) for name, value in fixed.items()}, acceleration=None)


def deliver(wrap: Callable[[gym.Env], gym.Env], name: str, steps: int = STEPS) -> Delivery:
    """One handover with the jerk-bounded position controller, which replans whenever a shield has interfered.

    Args:
        wrap: Puts a shield around the environment.
        name: Of the trace.
        steps: Length.
    """
    env = wrap(gym.make("jssa_gym/Handover-v0", human=recipient(), terminate_on=(), max_episode_steps=steps))
    base: Any = env.unwrapped
    controller, goals, asked = JPCPolicy(env, seed=0, yielding=False), [], []

    def policy(observation: Any) -> Array:
        action = np.zeros(base.robot.n) if base.scene.time < BEGIN else controller(observation)
        request = controller.jpc.request
        goals.append(base.goal)
        asked.append(0 if request is None else request.number)
        return action

    trace = rollout(env, policy, seed=0, options={"joint_position": _PICK}, steps=steps, name=name)
    env.close()
    # requests are numbered from 1; one that was answered is gone
    last = np.maximum.accumulate(asked)
    return Delivery(
        trace,
        np.array([tool_point(base.robot, position) for position in trace.position]),
        np.array(goals),
        (np.diff(last, prepend=0) > 0) & (last > 1),
        base.robot.limits,
    )
