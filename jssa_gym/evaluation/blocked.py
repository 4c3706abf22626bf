"""Runs in which every decision of a shield is a FAULT: they say nothing about policy or filter."""

import re
from collections import Counter
from collections.abc import Iterable

from jssa_gym.types import Status, Trace

_LONGEST = 200
"""Characters of a reason that are told."""


def one_line(reason: str) -> str:
    """A reason as it is told."""
    return " ".join(reason.split())[:_LONGEST]


def kind_of(reason: str) -> str:
    """What reasons that differ in their numbers alone have in common."""
    return re.sub(r"\d+(\.\d+)?(e[+-]?\d+)?", "#", reason)


def commonest(reasons: Iterable[str]) -> str:
    """The most frequent reason of the most frequent kind, the first of several, on one line; empty of none."""
    counts, kinds = Counter[str](), Counter[str]()
    for reason in reasons:
        counts[reason] += 1
        kinds[kind_of(reason)] += 1
    if not counts:
        return ""
    return one_line(max(counts, key=lambda reason: (kinds[kind_of(reason)], counts[reason]))) or "no reason given"


def fault_of(trace: Trace) -> str:
    """The most frequent reason of an episode's FAULTs; empty without any."""
    return commonest(trace.reason[trace.status == Status.FAULT].tolist())


def blocked(trace: Trace) -> str:
    """Why every step of an episode was a FAULT; empty if not every one was."""
    return fault_of(trace) if len(trace.status) and (trace.status == Status.FAULT).all() else ""


def warning(reason: str) -> str:
    """What is to be said of a run that was blocked."""
    return f"every decision was a FAULT, so that this says nothing about policy or filter; most often: {reason}"
