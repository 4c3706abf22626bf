"""People beside the arm: bodies of capsules, and how they move."""

import copy
import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

from jssa_gym.humans.body import Body, nobody, together
from jssa_gym.humans.files import is_file, load
from jssa_gym.humans.hand import Hand
from jssa_gym.humans.motion import CLEARANCE, Crowd, HumanMotion, Nobody, Walk
from jssa_gym.humans.paced import Paced
from jssa_gym.humans.pursuit import Pursuit
from jssa_gym.humans.random_walk import RandomWalk
from jssa_gym.humans.receive import Receive
from jssa_gym.humans.recorded import Recorded
from jssa_gym.humans.recording import Recording
from jssa_gym.humans.steered import Steered
from jssa_gym.humans.visitors import Visitors
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
"""Motions by name, of people who are there from the beginning to the end."""

STREAMS: dict[str, Callable[[], HumanMotion]] = {"visitors": Visitors}
"""Motions by name, of people who come and go."""

__all__ = [
    "CLEARANCE",
    "HUMANS",
    "STREAMS",
    "ApproachRetreat",
    "Body",
    "ConstantVelocity",
    "Crowd",
    "Given",
    "Hand",
    "HumanMotion",
    "Nobody",
    "Paced",
    "Pursuit",
    "RandomWalk",
    "Receive",
    "Recorded",
    "Recording",
    "Steered",
    "Visitors",
    "Walk",
    "WalkBy",
    "make_human",
    "nobody",
    "together",
]


Given = str | os.PathLike[str] | HumanMotion
"""Somebody: a name in :data:`HUMANS` or :data:`STREAMS`, a file, or a motion."""


def make_human(human: Given | Sequence[Given]) -> HumanMotion:
    """A motion from its name in :data:`HUMANS` or :data:`STREAMS`, or from a file; several of the first make a crowd.

    A file, ``.npz``, ``.csv`` or ``.bvh``, is played as :class:`Recorded` does unless told otherwise. What is in it
    that is not as in people, and what had to be guessed of it, is a warning. A motion that is passed in is copied: it
    has a state, which no two environments must share.

    Raises:
        ParameterError: Unknown name.
        RecordingError: The file is not a sound recording.
    """
    if isinstance(human, HumanMotion):
        return copy.deepcopy(human)
    if isinstance(human, str | os.PathLike) and is_file(human):
        person = load(human)
        for told in person.surprises():
            warnings.warn(f"{Path(human).name}: {told}", stacklevel=2)
        return Recorded(person.recording)
    if isinstance(human, str) or not isinstance(human, Sequence):
        known = {**HUMANS, **STREAMS}
        return known[known_name("human", human, known)]()
    return Crowd([make_human(one) for one in human])
