"""People beside many arms: each arm's move as they would beside a single one."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import HUMANS, Crowd, HumanMotion, Steered, nobody
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.vectors import Mask

_OURS = (*HUMANS.values(), Steered)


def refuse_foreign(motion: HumanMotion) -> None:
    """Refuse people who move as a user's own code says.

    Raises:
        ParameterError: They do.
    """
    if isinstance(motion, Crowd) and type(motion) is Crowd:
        for one in motion.motions:
            refuse_foreign(one)
    elif type(motion) not in _OURS:
        raise ParameterError(
            f"people of the kind {type(motion).__name__} are moved by Python of your own: vectors take "
            f"{', '.join(HUMANS)}, files of recordings, and crowds of these; for others take vectorization_mode='sync'"
        )


class OneByOne:
    """People who are moved in Python, an object for each arm.

    Args:
        motion: What all are copies of.
        count: How many arms.
    """

    def __init__(self, motions: list[HumanMotion], parts: int) -> None:
        self.motions = motions
        self.ends = np.zeros((len(motions), 4, parts, 3))
        """Starts, ends and their velocities of human capsules, shape (E, 4, k, 3) [m, m/s]."""
        self.radius = np.zeros((len(motions), parts))
        """Shape (E, k) [m]."""

    def begin(self, e: int, people: CapsuleSet) -> None:
        """An episode of arm ``e`` begins, with people as they are now."""
        self._take(e, people)

    def settle(self, e: int) -> None:
        """The generator of arm ``e`` is about to be used by somebody else."""

    def step(self, live: Mask, dt: float, segments: NDArray[Any], names: tuple[str, ...]) -> None:
        """Move on by ``dt`` [s] beside those arms that are ``live``; their capsules are of shape (E, m) or (E, 0)."""
        for e in np.flatnonzero(live):
            robot = _capsules(segments[e], names) if segments.shape[1] else nobody()
            self._take(e, self.motions[e].step(dt, robot))

    def _take(self, e: int, people: CapsuleSet) -> None:
        self.ends[e], self.radius[e] = people[:4], people.radius


def _capsules(segments: NDArray[Any], names: tuple[str, ...]) -> CapsuleSet:
    """An arm's capsules as reacting people see them; as of ``Surroundings.robot_capsules``."""
    ends: list[Array] = [
        segments[field].copy() for field in ("start", "end", "start_velocity", "end_velocity", "radius")
    ]
    return CapsuleSet(*ends, names, np.zeros(len(segments), np.int64))
