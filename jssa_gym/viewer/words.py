"""How a shield's status is said and coloured; the colours are told apart by colour-blind people."""

from jssa_gym.palette import GREEN, ORANGE, PINK, RED, rgb
from jssa_gym.types import Status

WORDS = {
    Status.NOMINAL: "as the policy wants",
    Status.PROJECTED: "corrected",
    Status.RELAXED: "least violation",
    Status.FAILSAFE: "stopping",
    Status.FAULT: "fault",
}
"""What the shield does, in two words."""

COLOURS = {
    Status.NOMINAL: rgb(GREEN),
    Status.PROJECTED: rgb(ORANGE),
    Status.RELAXED: rgb(PINK),
    Status.FAILSAFE: rgb(RED),
    Status.FAULT: (40, 40, 40),
}
"""How it is coloured."""
