"""People beside the arm: bodies of capsules, and how they move."""

import copy
from collections.abc import Callable, Sequence

from jssa_gym.humans.body import Body, nobody, together
from jssa_gym.humans.hand import Hand
from jssa_gym.humans.motion import CLEARANCE, Crowd, HumanMotion, Nobody, Walk
from jssa_gym.humans.pursuit import Pursuit
from jssa_gym.humans.random_walk import RandomWalk
from jssa_gym.humans.receive import Receive
from jssa_gym.humans.recorded import Recorded
from jssa_gym.humans.recording import Recording
from jssa_gym.humans.steered import Steered
from jssa_gym.humans.walks import ApproachRetreat, ConstantVelocity, WalkBy
from jssa_gym.validation import known_name

HUMANS: dict[str, Callable[[], HumanMotion]] = {
    "none": Nobody,
    "constant_velocity": ConstantVelocity,
    "approach_retreat": ApproachRetreat,
    "random": RandomWalk,
    "walk_by": WalkBy,
    "pursuit": Pursuit,
    "hand": Hand,
    "receive": Receive,
    "recorded": Recorded,
}
"""Motions by name."""

__all__ = [
    "CLEARANCE",
    "HUMANS",
    "ApproachRetreat",
    "Body",
    "ConstantVelocity",
    "Crowd",
    "Hand",
    "HumanMotion",
    "Nobody",
    "Pursuit",
    "RandomWalk",
    "Receive",
    "Recorded",
    "Recording",
    "Steered",
    "Walk",
    "WalkBy",
    "make_human",
    "nobody",
    "together",
]


def make_human(human: str | HumanMotion | Sequence[str | HumanMotion]) -> HumanMotion:
    """A motion from its name in :data:`HUMANS`; a sequence of names or motions makes a crowd.

    A motion that is passed in is copied: it has a state, which no two environments must share.

    Raises:
        ParameterError: Unknown name.
    """
    if isinstance(human, HumanMotion):
        return copy.deepcopy(human)
    if isinstance(human, str) or not isinstance(human, Sequence):
        return HUMANS[known_name("human", human, HUMANS)]()
    return Crowd([make_human(one) for one in human])
