"""Colours for figures, films and pages, told apart by colour-blind people: Okabe and Ito's, and a grey."""

BLUE, RED, GREEN, ORANGE, PINK, SKY = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9"
GREY, BLACK = "#666666", "#000000"
CONTACT = "#D62728"
"""Colour of what must not be missed, and of nothing else."""

COLOURS = (BLUE, RED, GREEN, ORANGE, PINK, SKY, GREY, BLACK)
"""In an order in which neighbours differ in lightness too."""

Rgb = tuple[int, int, int]


def rgb(colour: str) -> Rgb:
    """``#rrggbb`` as three numbers up to 255."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue
