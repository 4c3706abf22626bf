"""The paper's human: six capsules."""

from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.motion import translate
from jssa_gym.types import Array, CapsuleSet

PARTS: tuple[tuple[str, tuple[float, float, float], tuple[float, float, float], float], ...] = (
    ("head", (0.0, 0.0, 1.5), (0.0, 0.0, 1.5), 0.20),
    ("core_body", (0.0, 0.0, 0.9), (0.0, 0.0, 1.25), 0.25),
    ("right_arm", (0.0, 0.2, 1.3), (0.0, 0.5, 0.8), 0.10),
    ("left_arm", (0.0, -0.2, 1.3), (0.0, -0.5, 0.8), 0.10),
    ("right_leg", (0.0, 0.15, 0.8), (0.0, 0.4, 0.1), 0.10),
    ("left_leg", (0.0, -0.15, 0.8), (0.0, -0.4, 0.1), 0.10),
)
"""Name, start, end, radius of each part in metres, from the paper's simulation; root on the floor, facing -x."""

NAMES = tuple(name for name, _, _, _ in PARTS)


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One person's capsules around a root on the floor."""

    start: Array
    """Relative to the root, shape (6, 3) [m]."""
    end: Array
    """Shape (6, 3) [m]."""
    radius: Array
    """Shape (6,) [m]."""
    person: NDArray[np.int64]
    """Person id of every capsule, shape (6,)."""

    @classmethod
    def facing(cls, heading: float = np.pi, person: int = 0) -> "Body":
        """A body that looks along ``heading`` [rad], counted from +x towards +y; the paper's looks along -x."""
        turn = turning(heading - np.pi)
        return cls(
            np.array([start for _, start, _, _ in PARTS]) @ turn.T,
            np.array([end for _, _, end, _ in PARTS]) @ turn.T,
            np.array([radius for _, _, _, radius in PARTS]),
            np.full(len(PARTS), person, np.int64),
        )

    def at(self, root: tuple[float, float], velocity: tuple[float, float]) -> CapsuleSet:
        """The body at ``root`` on the floor [m], moving as a whole at ``velocity`` [m/s]."""
        out = np.empty((4, len(self.radius), 3))
        translate(self.start, self.end, root[0], root[1], velocity[0], velocity[1], out)
        return CapsuleSet(out[0], out[1], out[2], out[3], self.radius, NAMES, self.person)


def turning(angle: float) -> Array:
    """A turn about the base axis, counter-clockwise from above [rad], as a matrix, shape (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


NO_LINKS = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
"""An arm's capsules, starts, ends and radii, to who does not look at it."""


def nobody() -> CapsuleSet:
    """No capsule at all."""
    empty = np.zeros((0, 3))
    return CapsuleSet(empty, empty, empty, empty, np.zeros(0), (), np.zeros(0, np.int64))


def together(people: list[CapsuleSet]) -> CapsuleSet:
    """Several people's capsules in one set."""
    if not people:
        return nobody()
    *arrays, names, person = zip(*people, strict=True)
    return CapsuleSet(*map(np.concatenate, arrays), tuple(chain(*names)), np.concatenate(person))


def some_of(people: CapsuleSet, which: NDArray[np.bool_]) -> CapsuleSet:
    """Some of the capsules, shape (m,)."""
    names = tuple(name for name, wanted in zip(people.names, which, strict=True) if wanted)
    return CapsuleSet(*(array[which] for array in people[:5]), names, people.person[which])
