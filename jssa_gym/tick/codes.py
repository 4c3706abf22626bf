"""Why a decision was made, as a number: hundreds are the status.

``shields/reasons.py`` has the texts, ``shields/words.py`` makes sentences of them.
"""

NOMINAL, PROJECTED, RELAXED, FAILSAFE, FAULT = range(5)
"""Values of :class:`~jssa_gym.types.Status`."""

CLIPPED, UNRECOVERABLE, ROWS = 101, 102, 103
"""Outside the jerk bounds, outside the viability box, outside the safety rows."""

TOO_CLOSE, WAITING, REPELLED, SLIDING = 104, 105, 106, 107
"""Closer than the protective distance; waiting for more; a repulsive force; sliding mode."""

INFEASIBLE, RECOVERING, CORNERED = 201, 202, 203
"""No jerk keeps all rows; the index falls as fast as asked for; no jerk keeps the joint limits."""

CUT_OFF, IMMOVABLE = 204, 205
"""The jerk bounds cut off the safe acceleration; no joint moves the pair."""

LIMITS, UNDECIDED, REACH, MEETS, CROWDED, ENTRY = 301, 302, 303, 304, 305, 306
"""No stop within the joint limits; one that takes too many checks; somebody can reach the arm; it would meet something
(``other`` from 0 counts half-spaces, then static capsules, then the robot's own capsules); little room is left;
somebody who is not seen yet can reach the arm."""

NOT_FINITE_NOMINAL, NOT_FINITE_JOINTS, NOT_FINITE_PEOPLE, UNMEASURED = 401, 402, 403, 404
"""What is not finite: nominal, joints, people; somebody was not measured."""

SCENE, JOINTS, PEOPLE = 405, 406, 407
"""What could not be read, or does not fit."""

ASTRAY, LEAPT = 408, 409
"""The joint state is not where the last jerk led; the clock leapt ahead of the arm."""

TRUST = 410
"""A person's capsule is not to be trusted; the code is this and what became of its sample
(:mod:`jssa_gym.kernels.people`), from 1."""

FOREIGN, FILTER_FAILED, FAILED = 420, 421, 428
"""A filter that is not compiled says so itself; a filter failed (a compiled one: what stands still makes no rows); the
control step failed."""

ANSWER, UNSOLVED, UNVERIFIED = 422, 423, 427
"""The filter's answer is unfit; there is no projection; no verified stop."""

INDEX, DERIVATIVE, PRINTED_ROW = 424, 425, 426
"""What is not finite: index, a distance or one of its derivatives, printed row."""

UNWATCHED = 439
"""There was no complete frame of the watched region for too long."""

FROZEN, LAGS, MOVING = 431, 432, 434
"""What is wrong with the joint state: it is the same again, of some ticks ago, in motion though unknown so far."""

CLOCK_UNREADABLE, CLOCK_NOT_FINITE, CLOCK_BACK, CLOCK_STILL = 435, 436, 437, 438
"""What is wrong with the clock: it cannot be read, is not finite, went back, stands still."""

OTHER_TICK = 400
"""The people are of another tick."""
