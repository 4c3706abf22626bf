"""Python's collector of garbage, while much is made that stays: it would look through all of it, again and again."""

import gc
from collections.abc import Generator
from contextlib import contextmanager

SELDOM = 50_000
"""New objects from which on it looks then."""

Threshold = tuple[int, int, int]


def collect_seldom() -> Threshold:
    """Let it look less often, unless it is switched off or looks less often still; what to go back to."""
    before = gc.get_threshold()
    if 0 < before[0] < SELDOM:
        gc.set_threshold(SELDOM, *before[1:])
    return before


def collect_as(before: Threshold) -> None:
    """Let it look as often as before."""
    gc.set_threshold(*before)


@contextmanager
def collecting_seldom() -> Generator[None]:
    """Inside it looks less often."""
    before = collect_seldom()
    try:
        yield
    finally:
        collect_as(before)
