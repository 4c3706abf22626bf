"""Other people's motions in slow motion, another pace every episode."""

import copy
from collections.abc import Sequence
from numbers import Real
from typing import Any

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.body import nobody
from jssa_gym.humans.motion import HumanMotion
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import low_high, share


class Paced(HumanMotion):
    """Moves as another motion does, whose time runs ``pace`` times as fast: its speeds are that share of what they are.

    The pace is drawn anew at every reset, from the generator that the motion draws from too, and not if it cannot vary.
    With a pace of 1 everything is, bit for bit, as without.

    Args:
        motion: Who moves.
        pace: Range of the pace; 0 is somebody who stands still.

    Raises:
        ParameterError: The range is none, or the motion does not say how fast it is.
    """

    def __init__(self, motion: HumanMotion, pace: Sequence[float] = (0.3, 1.0)) -> None:
        if not isinstance(motion, HumanMotion):
            raise ParameterError(f"motion has to be a HumanMotion, got {motion!r}; make_human() makes one of a name")
        if not isinstance(getattr(motion, "speed_bound", None), Real):
            raise ParameterError(f"{type(motion).__name__} does not say how fast its people are: it has no speed_bound")
        self.motion, self.pace = motion, low_high("pace", pace)
        self.level = 1.0
        """Share of the pace that is taken, in [0, 1], from the next reset on."""
        self.people, self.clearance, self.reacts = motion.people, motion.clearance, motion.reacts
        self.comers = getattr(motion, "comers", None)  # of people who come and go
        self.speed_bound = self.pace[1] * motion.speed_bound
        self.now = 1.0
        """Pace of this episode."""
        self._seen = nobody()

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        low, high = self.pace
        self.now = share("level", self.level) * (rng.uniform(low, high) if low < high else high)
        return self._slowed(self.motion.reset(rng, start, person))

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        if self.now == 0.0:
            return copy.deepcopy(self._seen)  # nobody else's
        return self._slowed(self.motion.step(self.now * dt, robot))

    def _slowed(self, people: CapsuleSet) -> CapsuleSet:
        self._seen = people._replace(
            start_velocity=self.now * people.start_velocity, end_velocity=self.now * people.end_velocity
        )
        return self._seen

    def end_speeds_of(self, part: str) -> tuple[float, float]:
        start, end = self.motion.end_speeds_of(part)
        return self.pace[1] * start, self.pace[1] * end

    def acceleration_of(self, part: str) -> float | None:
        most = self.motion.acceleration_of(part)
        return None if most is None else self.pace[1] ** 2 * most

    def check_start(self, start: Any) -> None:
        self.motion.check_start(start)
