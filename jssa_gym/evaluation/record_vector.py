"""Safety metrics of every episode of many environments at once."""

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from jssa_gym.envs.arm import MOVING
from jssa_gym.envs.vector import VectorArmEnv
from jssa_gym.evaluation.record import COLUMNS, as_numbers, summary_of
from jssa_gym.evaluation.steps import StepSummary
from jssa_gym.evaluation.trace import WITHOUT_SHIELD
from jssa_gym.exceptions import InterfaceError
from jssa_gym.tick.codes import CLIPPED
from jssa_gym.validation import number_within, positive_integer
from jssa_gym.vectors import Infos, stacked, wrapper_with

_ABSENT = {f"shield/{name}": absent for name, absent in WITHOUT_SHIELD.items()} | {"shield/reason_code": CLIPPED}
"""What is taken down without a shield."""


class VectorRecordSafety(VectorWrapper):
    """Adds episodes' safety metrics to ``infos["safety"]`` at their ends, as :class:`~jssa_gym.RecordSafety` does.

    It goes around a :class:`~jssa_gym.VectorArmEnv`, or the shield around it. With ``AutoresetMode.SAME_STEP`` the
    metrics are in ``infos["final_info"]``.

    Args:
        env: The vector.
        buffer_length: How many episodes :attr:`recent` remembers.
        v_safe: Speed of the robot's touching point from which a contact is critical [m/s].

    Raises:
        InterfaceError: It is another vector, or repeats actions.
        ParameterError: A number is out of range.
    """

    def __init__(self, env: VectorEnv, buffer_length: int = 100, v_safe: float = MOVING) -> None:
        super().__init__(env)
        arms = env.unwrapped
        if not isinstance(arms, VectorArmEnv):
            raise InterfaceError(f"{env} is no VectorArmEnv: put a RecordSafety around each environment")
        if wrapper_with(env, "ticks") is not None:
            raise InterfaceError(
                f"{env} repeats actions, and tells of all its ticks at once: VectorRecordSafety goes inside"
            )
        self._arms = arms
        self._v_safe = number_within("v_safe", v_safe, 0.0)
        self._count = np.zeros(env.num_envs, np.int64)
        self._columns = [np.zeros((env.num_envs, 256), kind) for kind in COLUMNS.values()]
        self.recent: deque[StepSummary] = deque(maxlen=positive_integer("buffer_length", buffer_length))
        """The latest episodes, the last one at the end."""

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, Infos]:
        """Reset environments; episodes that were not ended are forgotten."""
        observations, infos = self.env.reset(seed=seed, options=options)  # ty: ignore[invalid-argument-type]  # or a list
        self._count[self._arms.began] = 0
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Infos]:
        """Step the environments and take down what ``infos`` says."""
        live = self._arms.ready()
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        self._take(np.flatnonzero(live), rewards, infos)
        self._count[live] += 1
        over = np.flatnonzero(live & (terminated | truncated)).tolist()
        if over:
            ends = infos.get("final_info", infos)
            ends["safety"] = safety = {}
            ends["_safety"] = np.zeros(self.num_envs, np.bool_)
            for e in over:
                columns = [column[e, : self._count[e]].copy() for column in self._columns]
                arms = self._arms
                summary = summary_of(
                    columns, bool(terminated[e]), arms.dt, arms.d_min, not arms.task.ends, self._v_safe
                )
                self.recent.append(summary)
                numbers = as_numbers(summary)
                for name, array in stacked(numbers, self.num_envs).items() if not safety else ():
                    safety[name], safety[f"_{name}"] = array, np.zeros(self.num_envs, np.bool_)
                for name, number in numbers.items():
                    safety[name][e] = number
                    safety[f"_{name}"][e] = True
                ends["_safety"][e] = True
        self._count[self._arms.began] = 0
        return observations, rewards, terminated, truncated, infos

    def _take(self, live: NDArray[np.int64], rewards: NDArray[Any], infos: Infos) -> None:
        """Take down a step of those that were in it."""
        at = self._count[live]
        if len(at) and at.max() >= self._columns[0].shape[1]:
            self._columns = [np.concatenate([column, np.zeros_like(column)], axis=1) for column in self._columns]
        for (name, kind), column in zip(COLUMNS.items(), self._columns, strict=True):
            if name == "reward":
                values = rewards
            elif name == "reasoned":
                values = self._said("shield/reason_code", infos) != CLIPPED
            else:
                values = self._said(name, infos).astype(kind)
            column[live, at] = values[live]

    def _said(self, name: str, infos: Infos) -> NDArray[Any]:
        """What ``infos`` says of the step itself, not of the beginning behind it."""
        if name not in infos:
            return np.full(self.num_envs, _ABSENT[name])
        if "final_info" not in infos:
            return infos[name]
        return np.where(infos["_final_info"], infos["final_info"][name], infos[name])
