"""Somebody who takes what the arm hands over."""

import math
from collections.abc import Sequence

import numpy as np

from jssa_gym.humans.acceleration import HAND, acceleration_bound
from jssa_gym.humans.body import NAMES
from jssa_gym.humans.hand import ARM_LENGTH, RIGHT, Gesturer, write_limb
from jssa_gym.humans.motion import CLEARANCE, STILL
from jssa_gym.kernels.limbs import RECEIVES
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import low_high


class Receive(Gesturer):
    """Stands in front of the arm and holds out the right hand, low at first, then nearer and higher, as in the paper's
    handover; takes it back in the end.

    Body, legs and shoulders stand still; the hand moves on straight lines, each at a speed of its own, and pauses in
    between. It does not look at the arm. Places are drawn in front of the body: forwards, to its right, and up.

    Args:
        front: Range of the root's x [m]; the defaults put the hand where the arm reaches a point 0.27 m before it.
        side: Range of the root's y [m].
        forward: Range of how far in front of the body the hand is held out [m].
        aside: Range of how far to the right of the body's middle [m].
        height: Range of the hand's height [m].
        nearer: Range of how far it is then moved towards the arm [m].
        higher: Range of how far it is then moved up [m].
        speed: Range of the hand's speed, drawn for every way [m/s].
        wait: Range of the time before the hand is held out [s].
        hold: Range of the time that it is held low [s].
        stay: Range of the time that it is held high [s].
        acceleration: Largest acceleration of the hand [m/s²]; None for none: it starts and stops at once.
    """

    reacts = False
    arms = (NAMES[RIGHT],)

    def __init__(
        self,
        front: Sequence[float] = (1.3, 1.5),
        side: Sequence[float] = (-0.25, 0.25),
        forward: Sequence[float] = (0.4, 0.5),
        aside: Sequence[float] = (0.0, 0.2),
        height: Sequence[float] = (1.0, 1.1),
        nearer: Sequence[float] = (0.05, 0.1),
        higher: Sequence[float] = (0.1, 0.25),
        speed: Sequence[float] = (0.4, 0.8),
        wait: Sequence[float] = (0.2, 0.8),
        hold: Sequence[float] = (0.8, 1.6),
        stay: Sequence[float] = (3.5, 5.0),
        acceleration: float | None = HAND,
    ) -> None:
        self.front, self.side = low_high("front", front, CLEARANCE), low_high("side", side, -np.inf)
        self.forward, self.aside = low_high("forward", forward), low_high("aside", aside, -np.inf)
        self.height, self.nearer = low_high("height", height), low_high("nearer", nearer)
        self.higher, self.speed = low_high("higher", higher), low_high("speed", speed, 1e-3)
        self.wait, self.hold, self.stay = low_high("wait", wait), low_high("hold", hold), low_high("stay", stay)
        self.acceleration = acceleration_bound("acceleration", acceleration)
        self.speed_bound = self.speed[1]

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        gesture, root = self._stand(RECEIVES, rng, start, person)
        gesture["limbs"] = 1
        write_limb(self.limbs[0], self.body, RIGHT, ARM_LENGTH, self.acceleration)
        heading = math.atan2(-root[1], -root[0])
        ahead, aside, up, nearer, higher = (
            rng.uniform(*r) for r in (self.forward, self.aside, self.height, self.nearer, self.higher)
        )
        c, s = math.cos(heading), math.sin(heading)
        gesture["places"] = [
            (x * c + aside * s, x * s - aside * c, z) for x, z in ((ahead, up), (ahead + nearer, up + higher))
        ]
        gesture["pauses"] = [rng.uniform(*r) for r in (self.wait, self.hold, self.stay)]
        gesture["speeds"] = [rng.uniform(*self.speed) for _ in range(3)]
        return self.body.at(root, STILL)
