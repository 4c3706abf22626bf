"""Texts of the reasons that kernels give as numbers, or several filters alike; ``words.py`` makes sentences of them."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

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
    101: "outside the jerk bounds",
    102: "would leave no way to keep the joint limits",
    103: "safety rows",
    104: "closer than the protective distance",
    105: "waiting for more distance",
    106: "a repulsive force",
    107: "sliding mode",
    201: "no jerk keeps all rows",
    202: "recovering",
    203: "no jerk keeps the joint limits",
    204: "the jerk bounds cut off the safe acceleration",
    205: "no joint moves the pair",
    301: "no stop inside the joint limits",
    302: "its stop takes too many checks",
    303: "... can reach ... before it rests",
    304: "... would meet ...",
    305: "too little room to people",
    306: "somebody unseen could be at ... before it rests",
    401: "nominal jerk is not finite",
    402: "joint state is not finite",
    403: "human measurement is not finite",
    404: "a human capsule was not measured",
    405: "the scene does not fit",
    406: "the joint state cannot be read",
    407: "the people cannot be read",
    408: "the joint state is not where the last jerk led",
    409: "the clock leapt ahead of the arm",
    411: "... of person ...: too old",
    412: "... of person ...: not measured",
    413: "... of person ...: older than one before",
    414: "... of person ...: frozen",
    415: "... of person ...: jumped",
    416: "... of person ...: of another person than before",
    417: "... of person ...: from the future",
    418: "... of person ...: not finite",
    419: "... of person ...: without a radius",
    421: "the filter failed",
    422: "the filter's answer",
    423: "the projection found no solution",
    424: "the safety index is not finite",
    425: "a distance or one of its derivatives is not finite",
    426: "the printed row is not finite",
    427: "no verified stop",
    428: "the control step failed",
    431: "the joint state is frozen",
    432: "the joint state lags by",
    434: "the arm moves in the first reading",
    435: "the clock cannot be read",
    436: "the time is",
    437: "the clock went back",
    438: "the clock stands still",
    439: "the watched region was not seen completely",
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
