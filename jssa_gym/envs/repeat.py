"""A policy that acts more slowly than the arm is controlled."""

from collections.abc import Callable
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from jssa_gym.validation import positive_integer
from jssa_gym.vectors import refuse_vector

ANY = ("contact", "limit_violation", "success", "is_success", "shield/intervened")
REASONS = ("shield/reason", "shield/reason_code")
LARGEST = ("contact_speed", "shield/status", "shield/phi", "shield/correction", "shield/slack")
"""Keys of ``info`` of which any tick's counts, that of the worst status, the largest."""


class ActionRepeat(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Repeats an action for some ticks: with 5 of 8 ms policy at 25 Hz, shield and arm at 125 Hz.

    It goes *outside* the shield, which then still decides in every tick. Rewards are summed, and ``info`` tells about
    all ticks, not the last one only: ``distance`` is the smallest, ``cost`` the sum, ``contact``, ``limit_violation``,
    ``success``, ``is_success`` and ``shield/intervened`` whether any tick had it, ``contact_speed`` and the shield's
    status, index, correction and slack the largest (NaN if any is), ``shield/reason`` and ``shield/reason_code`` the
    first of that status. Other keys are the last tick's. An episode's end in between ends the repetition.

    Args:
        env: The environment.
        ticks: How often an action is applied, at least 1.

    Raises:
        ParameterError: ``ticks`` is not a positive integer.
        InterfaceError: It is a vector of environments.
    """

    outside_shield: ClassVar[bool] = True
    """Shields refuse to go around it."""

    def __init__(self, env: gym.Env, ticks: int) -> None:
        refuse_vector(env, "VectorActionRepeat")
        self.ticks = positive_integer("ticks", ticks)
        gym.utils.RecordConstructorArgs.__init__(self, ticks=self.ticks)
        gym.Wrapper.__init__(self, env)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Apply one action for ``ticks`` control steps."""
        total, seen = 0.0, []
        for _ in range(self.ticks):
            observation, reward, terminated, truncated, info = self.env.step(action)
            total += float(reward)
            seen.append(info)
            if terminated or truncated:
                break
        merged = dict(info)
        merged["distance"] = min(i["distance"] for i in seen)
        merged["cost"] = sum(i["cost"] for i in seen)
        for key in ANY:
            if key in info:
                merged[key] = any(i[key] for i in seen)
        for key in LARGEST:
            if key in info:
                # numpy's maximum is NaN if any tick's is: a fault must not be hidden
                merged[key] = type(info[key])(np.max([i[key] for i in seen]))
        if "shield/status" in info:
            worst = next(i for i in seen if i["shield/status"] == merged["shield/status"])
            merged |= {key: worst[key] for key in REASONS if key in worst}
        return observation, total, terminated, truncated, merged

    @property
    def compute_reward(self) -> Callable[[Any, Any, Any], Any]:
        """The environment's own, of ``ticks`` ticks that are all like the last: see ``ArmEnv.compute_reward``."""
        inner = self.env.get_wrapper_attr("compute_reward")
        return lambda achieved, desired, info: self.ticks * inner(achieved, desired, info)
