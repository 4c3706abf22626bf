"""How a shield's status is said and coloured; the colours are told apart by colour-blind people."""

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
    Status.NOMINAL: (0, 158, 115),
    Status.PROJECTED: (230, 159, 0),
    Status.RELAXED: (204, 121, 167),
    Status.FAILSAFE: (213, 94, 0),
    Status.FAULT: (40, 40, 40),
}
"""Of Okabe and Ito's palette."""
