"""Texts of the reasons that kernels give as numbers, or several filters alike; ``words.py`` makes sentences of them."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from jssa_gym.tick import codes
from jssa_gym.types import Array, Decision, Status

BAD_INPUTS = (
    "",
    "nominal jerk is not finite",
    "joint state is not finite",
    "human measurement is not finite",
    "a human capsule was not measured",
)
"""What is wrong with the input, by its code less 400."""

UNFIT = (
    "",
    "the filter's answer is not finite",
    "the filter's answer is outside the jerk bounds",
    "the filter's answer is not the nominal, as it claims",
)
"""What is wrong with the answer, by the number of :func:`~jssa_gym.tick.admit.unfit_answer`."""

FIXTURES = (
    "",
    "a static capsule or half-space is not finite, a radius not positive, or a normal no unit vector",
    "the half-spaces are not those of the beginning",
    "the static capsules are not those of the beginning",
)
"""What is wrong with what stands still, by the number of :func:`~jssa_gym.kernels.verification.load_fixtures`: it does
not come, go or move."""

OUTSIDE = "outside the jerk bounds"
"""Reason of a decision that only clipped the nominal to the jerk bounds."""

UNRECOVERABLE = "would leave no way to keep the joint limits"
"""Reason of a decision that only clipped the nominal, to a viability box narrower than the jerk bounds."""


SAMPLES = (
    "too old",
    "not measured",
    "older than one before",
    "frozen: the same again though it claims to move",
    "jumped farther than it can have moved",
    "of another person than before",
    "from the future",
    "not finite",
    "without a radius",
)
"""What became of a human capsule's sample, by the number of :mod:`jssa_gym.kernels.people`."""


def of_clipping(nominal: Array, clipped: Array, bound: Array) -> str:
    """Why the nominal was clipped: by the jerk bounds alone, or by the viability box in some joint; shapes (n,)."""
    plain = np.maximum(np.minimum(nominal, bound), -bound)
    return OUTSIDE if (clipped == plain).all() else UNRECOVERABLE


REASONS: Mapping[int, str] = {
    codes.CLIPPED: OUTSIDE,
    codes.UNRECOVERABLE: UNRECOVERABLE,
    codes.ROWS: "safety rows",
    codes.TOO_CLOSE: "closer than the protective distance",
    codes.WAITING: "waiting for more distance",
    codes.REPELLED: "a repulsive force",
    codes.SLIDING: "sliding mode",
    codes.INFEASIBLE: "no jerk keeps all rows",
    codes.RECOVERING: "recovering",
    codes.CORNERED: "no jerk keeps the joint limits",
    codes.CUT_OFF: "the jerk bounds cut off the safe acceleration",
    codes.IMMOVABLE: "no joint moves the pair",
    codes.LIMITS: "no stop inside the joint limits",
    codes.UNDECIDED: "its stop takes too many checks",
    codes.REACH: "... can reach ... before it rests",
    codes.MEETS: "... would meet ...",
    codes.CROWDED: "too little room to people",
    codes.ENTRY: "somebody unseen could be at ... before it rests",
    **dict(enumerate(BAD_INPUTS[1:], codes.NOT_FINITE_NOMINAL)),
    codes.SCENE: "the scene does not fit",
    codes.JOINTS: "the joint state cannot be read",
    codes.PEOPLE: "the people cannot be read",
    codes.ASTRAY: "the joint state is not where the last jerk led",
    codes.LEAPT: "the clock leapt ahead of the arm",
    **{codes.TRUST + k: f"... of person ...: {what}" for k, what in enumerate(SAMPLES, 1)},
    codes.FILTER_FAILED: "the filter failed",
    codes.ANSWER: "the filter's answer",
    codes.UNSOLVED: "the projection found no solution",
    codes.INDEX: "the safety index is not finite",
    codes.DERIVATIVE: "a distance or one of its derivatives is not finite",
    codes.PRINTED_ROW: "the printed row is not finite",
    codes.UNVERIFIED: "no verified stop",
    codes.FAILED: "the control step failed",
    codes.FROZEN: "the joint state is frozen",
    codes.LAGS: "the joint state lags by",
    codes.MOVING: "the arm moves in the first reading",
    codes.CLOCK_UNREADABLE: "the clock cannot be read",
    codes.CLOCK_NOT_FINITE: "the time is",
    codes.CLOCK_BACK: "the clock went back",
    codes.CLOCK_STILL: "the clock stands still",
    codes.UNWATCHED: "the watched region was not seen completely",
}
"""What reasons begin with, by their code: hundreds are the :class:`~jssa_gym.types.Status`, ``...`` stands for names.

A code keeps its meaning for good: new reasons get new ones. The full hundred is everything else of that status, such
as what filters of users say.
"""


# what a reason says, in parts between names; whole beginnings first: what follows them may quote anything
_PARTS = {
    status: sorted(
        ((code, text.split("...")) for code, text in REASONS.items() if code // 100 == status),
        key=lambda kind: kind[1][0] == "",
    )
    for status in Status
}


def _says(reason: str, parts: list[str]) -> bool:
    """Whether a reason begins with the first of some parts and has the others behind it, in their order."""
    if not reason.startswith(parts[0]):
        return False
    at = len(parts[0])
    for part in parts[1:]:
        if (at := reason.find(part, at)) < 0:
            return False
        at += len(part)
    return True


def reason_code(decision: Decision) -> int:
    """The reason of a decision as a number, for those who cannot do with text: 0 for NOMINAL, else see `REASONS`."""
    return 0 if decision.status == Status.NOMINAL else _code(decision.status, decision.reason)


@lru_cache(maxsize=256)  # what is wrong tends to stay wrong
def _code(status: Status, reason: str) -> int:
    for code, parts in _PARTS[status]:
        if _says(reason, parts):
            return code
    return 100 * int(status)
