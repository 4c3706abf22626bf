"""Safety metrics of every episode of any training loop."""

from collections import deque
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.arm import MOVING
from jssa_gym.envs.repeat import ActionRepeat
from jssa_gym.evaluation.definitions import metrics_of
from jssa_gym.evaluation.steps import Steps, StepSummary, summarise_steps
from jssa_gym.evaluation.trace import WITHOUT_SHIELD
from jssa_gym.exceptions import InterfaceError
from jssa_gym.shields.reasons import OUTSIDE
from jssa_gym.shields.wrappers import layer_of
from jssa_gym.types import Status
from jssa_gym.validation import number_within, positive_integer
from jssa_gym.vectors import refuse_vector

_NEEDED = ("success", "distance", "contact", "contact_speed", "limit_violation")
"""Keys of ``info`` that there have to be; those of a shield may be missing."""

_TOLD = ("intervened", "correction", "phi", "slack")
"""What a shield says of a step, besides status and reason."""

COLUMNS: dict[str, type] = {
    "reward": float,
    "success": bool,
    "distance": float,
    "contact": bool,
    "contact_speed": float,
    "limit_violation": bool,
    "shield/status": np.int64,
    "reasoned": bool,
    "shield/intervened": bool,
    "shield/correction": float,
    "shield/phi": float,
    "shield/slack": float,
}
"""What is taken down of every step; ``reasoned`` is whether the shield gave a reason other than the jerk bounds."""

_OPTIONAL = frozenset(metric.name for metric in metrics_of(StepSummary) if metric.optional)


class RecordSafety(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Adds an episode's safety metrics to ``info["safety"]`` at its end.

    In the manner of Gymnasium's ``RecordEpisodeStatistics``; it goes around the shield, inside ``ActionRepeat``, and
    works in vector environments. ``info["safety"]`` is a dictionary of the fields of
    :class:`~jssa_gym.evaluation.steps.StepSummary`, NaN where an episode has none, so that all values are numbers.

    Args:
        env: An environment that offers ``dt`` [s] and whose ``info`` has ``success``, ``distance``, ``contact``,
            ``contact_speed`` and ``limit_violation`` after every step.
        buffer_length: How many episodes :attr:`recent` remembers.
        v_safe: Speed of the robot's touching point from which a contact is critical [m/s].

    Raises:
        InterfaceError: The environment offers no ``dt``, or repeats actions; at the first step, if ``info`` lacks a
            key.
        ParameterError: A number is out of range.
    """

    def __init__(self, env: gym.Env, buffer_length: int = 100, v_safe: float = MOVING) -> None:
        refuse_vector(env, "VectorRecordSafety")
        gym.utils.RecordConstructorArgs.__init__(self, buffer_length=buffer_length, v_safe=v_safe)
        gym.Wrapper.__init__(self, env)
        if not env.has_wrapper_attr("dt"):
            raise InterfaceError(f"{env} has no attribute 'dt', the control step [s]")
        if layer_of(env, ActionRepeat) is not None:
            raise InterfaceError(f"{env} repeats actions, and tells of all its ticks at once: RecordSafety goes inside")
        self._dt = float(env.get_wrapper_attr("dt"))
        self._d_min = float(env.get_wrapper_attr("d_min")) if env.has_wrapper_attr("d_min") else 0.05
        # tasks of other packages do not say whether they end
        self._holds = env.has_wrapper_attr("task") and not getattr(env.get_wrapper_attr("task"), "ends", True)
        self._v_safe = number_within("v_safe", v_safe, 0.0)
        self._rows: list[tuple[Any, ...]] = []
        self.recent: deque[StepSummary] = deque(maxlen=positive_integer("buffer_length", buffer_length))
        """The latest episodes, the last one at the end."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; an episode that was not ended is forgotten."""
        self._rows.clear()
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and take down what ``info`` says."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        try:
            self._rows.append(
                (
                    float(reward),
                    *(info[name] for name in _NEEDED),
                    info.get("shield/status", 0),
                    info.get("shield/reason", OUTSIDE) != OUTSIDE,
                    *(info.get(f"shield/{name}", WITHOUT_SHIELD[name]) for name in _TOLD),
                )
            )
        except KeyError as error:
            raise InterfaceError(f"info has no key {error}; RecordSafety needs {', '.join(_NEEDED)}") from error
        if terminated or truncated:
            summary = self._summary(terminated)
            self._rows.clear()
            self.recent.append(summary)
            info["safety"] = as_numbers(summary)
        return observation, reward, terminated, truncated, info

    def _summary(self, terminated: bool) -> StepSummary:
        columns = [np.array(x, kind) for x, kind in zip(zip(*self._rows, strict=True), COLUMNS.values(), strict=True)]
        return summary_of(columns, terminated, self._dt, self._d_min, self._holds, self._v_safe)


def summary_of(
    columns: Sequence[NDArray[Any]], terminated: bool, dt: float, d_min: float, holds: bool, v_safe: float
) -> StepSummary:
    """What an episode's steps come to, whose :data:`COLUMNS` these are; the rest as of :class:`Steps`."""
    (reward, success, distance, contact, contact_speed, violation, status, reasoned, *rest) = columns
    ended: Literal["terminated", "truncated"] = "terminated" if terminated else "truncated"
    changed = reasoned & (status != Status.NOMINAL)
    steps = Steps(
        dt, d_min, holds, ended, reward, success, distance, contact, contact_speed, violation, status, changed, *rest
    )  # fmt: skip
    return summarise_steps(steps, v_safe)


def as_numbers(summary: StepSummary) -> dict[str, Any]:
    """A summary as ``info["safety"]`` has it: NaN where an episode has none."""
    return {
        name: (np.nan if value is None else float(value)) if name in _OPTIONAL else value
        for name, value in asdict(summary).items()
    }
