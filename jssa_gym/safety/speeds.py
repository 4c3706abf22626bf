"""How fast somebody who was recorded is, beside what a shield assumes of people."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from jssa_gym.humans import Recording
from jssa_gym.humans.survey import steps_of
from jssa_gym.safety.failsafe import LEG_SPEEDS, FailsafeParams
from jssa_gym.safety.parts import by_name

_ROUNDING = 1e-9
"""Share of a bound by which a speed may exceed it."""


@dataclass(frozen=True, slots=True)
class PartSpeed:
    """How fast a body part moves."""

    name: str
    speed: float
    """Largest of its ends [m/s]."""
    time: float
    """Time of the sample at which that speed is reached, from the first [s]."""
    bound: float
    """What the shield assumes [m/s]."""
    beyond: float
    """Share of the recording's time in which it is faster than that."""

    @property
    def excess(self) -> float:
        """The speed above the bound [m/s]; 0 if it is kept."""
        return self.speed - self.bound if self.speed > self.bound * (1.0 + _ROUNDING) else 0.0


def part_speeds(recording: Recording, params: FailsafeParams) -> list[PartSpeed]:
    """Speeds of all body parts, between samples, beside the bounds that a shield has for their names."""
    step = np.diff(recording.time)
    speed = steps_of(recording).max(axis=2) / step[:, None]
    found = []
    for i, name in enumerate(recording.names):
        k, bound = int(speed[:, i].argmax()), params.speed_of(name)
        found.append(
            PartSpeed(
                name,
                float(speed[k, i]),
                float(recording.time[k + 1] - recording.time[0]),
                bound,
                float(step[speed[:, i] > bound * (1.0 + _ROUNDING)].sum() / step.sum()),
            )
        )
    return found


def time_beyond(recording: Recording, params: FailsafeParams) -> float:
    """Share of the recording's time in which any body part is faster than the shield assumes."""
    step = np.diff(recording.time)
    bounds = np.array([params.speed_of(name) for name in recording.names])
    beyond = (steps_of(recording).max(axis=2) / step[:, None] > bounds * (1.0 + _ROUNDING)).any(axis=1)
    return float(step[beyond].sum() / step.sum())


def sufficient(parts: Sequence[PartSpeed], params: FailsafeParams) -> dict[str, float]:
    """Speeds of :class:`FailsafeParams` [m/s] under which no part is too fast: the fewest, each rounded up to 0.1 m/s.

    Args:
        parts: Of a recording.
        params: What is assumed so far.
    """
    names = [field.name for field in fields(params) if field.name.endswith("_speed") and field.name != "contact_speed"]
    # human_speed is everybody's: it comes last
    names.sort(key=lambda name: name == "human_speed")
    raised: dict[str, float] = {}
    for part in sorted(parts, key=lambda part: -part.speed):
        if params.speed_of(part.name) * (1.0 + _ROUNDING) >= part.speed:
            continue
        needed = float(np.ceil(part.speed * 10.0 - _ROUNDING) / 10.0)
        for name in names:
            if (changed := replace(params, **{name: needed})).speed_of(part.name) >= needed:
                params, raised = changed, {**raised, name: needed}
                break
    return raised


def legs_of_feet(recording: Recording, params: FailsafeParams) -> tuple[str, ...]:
    """Parts that are too fast, and would not be with ``end_speeds=LEG_SPEEDS``: legs whose other end is a foot.

    None if another leg would still be too fast with it.
    """
    changed, found = replace(params, end_speeds={**LEG_SPEEDS, **(params.end_speeds or {})}), []
    for name, ends in zip(recording.names, recording.end_speeds, strict=True):
        if by_name(LEG_SPEEDS, name) is None or ends.max() <= params.speed_of(name) * (1.0 + _ROUNDING):
            continue
        if np.any(ends > np.array(changed.end_speeds_of(name)) * (1.0 + _ROUNDING)):
            return ()
        found.append(name)
    return tuple(found)
