"""Of tests with many cases the fast lane plays a few."""

import pytest

_GOLDEN = 0.6180339887498949


def leave_cases_out(items):
    """Of a test that is ``sampled(n)`` all cases but n are ``long``.

    Multiples of the golden ratio choose them: evenly spread, and of a product of two lists not always with the same
    value of one of them.
    """
    cases = {}
    for item in items:
        if item.get_closest_marker("sampled") and not item.get_closest_marker("slow"):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for alike in cases.values():
        (count,) = alike[0].get_closest_marker("sampled").args
        for case in sorted(range(len(alike)), key=lambda case: case * _GOLDEN % 1.0)[count:]:
            alike[case].add_marker(pytest.mark.long)
