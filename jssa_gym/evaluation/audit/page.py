"""An audit as one page that loads nothing."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from jssa_gym.evaluation.audit.result import FIGURES, Audit, AuditedStretch
from jssa_gym.evaluation.report import METRICS
from jssa_gym.evaluation.svg import Markup, Panel, document, figure, note, rows_of, tag
from jssa_gym.text import counted
from jssa_gym.types import Array

_POINTS = 1200
"""Points that a curve of a page has at most."""

_READING = (
    "The log says where the robot and the people were; this page says what follows from that for the capsules of "
    "the robot's model and of the people, and what a shield in the place of the robot's controller would have "
    "done, from the first sample on, had everybody moved as they did. People do not react to the slower robot. "
    "It is research software, no safety-rated device and no assessment of a cell."
)

_RULES = (
    "Between samples joints follow the cubic of both samples' positions and velocities or, without velocities, "
    "the spline with continuous acceleration; people move on straight lines. Nothing is made up in a gap: it "
    "ends a stretch, and a shield would have gone on with its stored stop there. Accelerations and jerks are "
    "those of these curves: noise of the positions of size e makes accelerations wrong by about e / dt², and "
    "jerks by e / dt³."
)


_CLOSEST = (
    ("time", " [s]", "Of the closest approach, by the log's clock."),
    ("distance", " [m]", ""),
    ("speed", " [m/s]", "Of the arm's nearest point then."),
    ("approach", " [m/s]", "Rate at which the distance falls then."),
    ("robot", "", "Capsule of the arm."),
    ("human", "", "Body part."),
)
"""What is told of the closest approach: field, unit, and what it is."""


def page(audit: Audit, command: str) -> str:
    """The audit as HTML.

    Args:
        audit: What was found.
        command: That made it.
    """
    people = ", ".join(audit.people) or "nobody"
    parts = [
        tag("h1", f"Audit of {audit.log}"),
        tag("p", f"Robot {audit.robot}, people: {people}. Shield {audit.filter}, control step {audit.dt:g} s."),
        tag("p", tag("code", command)),
        tag("h2", summary_line(audit)),
        note(_READING),
        tag("h2", "As logged, and with the shield"),
        _figures(audit),
        tag("h2", "Interventions"),
        *_interventions(audit),
        tag("h2", "Over time"),
        *(part for stretch in audit.stretches for part in _curves(stretch)),
        tag("h2", "Gaps"),
        _gaps(audit),
        tag("h2", "How it was read, and what was assumed"),
        note(_RULES),
        rows_of(
            ["assumption", "value"], [[one.name, getattr(audit.assumed, one.name)] for one in fields(audit.assumed)]
        ),
    ]
    return document(f"Audit of {audit.log}", parts)


def summary_line(audit: Audit) -> str:
    """The answer in one line."""
    found, late = audit.interventions, audit.lateness
    if not found:
        return f"The shield would not have intervened in {audit.duration:.1f} s."
    return (
        f"The shield would have intervened: {counted(len(found), 'time')} in {audit.duration:.1f} s, for "
        f"{audit.held:.2f} s, first at {found[0].start:.3f} s; the arm would be {late:.2f} s late."
    )


def _figures(audit: Audit) -> Markup:
    units = {metric.name: metric for metric in METRICS}
    logged, safe = audit.totals()
    rows = []
    for name in FIGURES:
        unit = units[name].unit
        rows.append([f"{name} [{unit}]" if unit else name, units[name].text, _told(logged[name]), _told(safe[name])])
    for what, unit, text in _CLOSEST:
        rows.append([f"closest {what}{unit}", text, *(_told(getattr(audit.closest(k), what, None)) for k in (0, 1))])
    return rows_of(["", "what it is", "as logged", "with the shield"], rows, text=2, kind="text long")


def _told(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool | str):
        return str(value)
    return f"{value:.4g}"


def _interventions(audit: Audit) -> list[Markup]:
    found = audit.interventions
    if not found:
        return [tag("p", "None.")]
    rows = [
        [one.reason, f"{one.start:.3f}", f"{one.end:.3f}", one.status, f"{one.distance:.3f}", f"{one.slowed:.3f}"]
        for one in found
    ]
    titles = ["why", "from [s]", "to [s]", "status", "distance as logged [m]", "later by [s]"]
    return [rows_of(titles, rows, kind="text long")]


def _curves(stretch: AuditedStretch) -> list[Markup]:
    """Distance and margin, speed and lateness over time."""
    pick = np.unique(np.linspace(0, len(stretch.time) - 1, min(_POINTS, len(stretch.time))).astype(int))
    time = stretch.time[pick]
    limits = [_fastest(trace.velocity)[pick] for trace in (stretch.logged, stretch.safe)]
    panels = [
        ("distance [m]", (stretch.logged.distance[pick], stretch.safe.distance[pick])),
        ("distance − S_p [m]", (stretch.margins[0][pick], stretch.margins[1][pick])),
        ("fastest joint [rad/s]", limits),
        ("behind the log [s]", (np.zeros(len(time)), stretch.lateness[pick])),
    ]
    return [
        figure(_panel(time, what, curves), "Blue: as logged. Orange: with the shield.")
        for what, curves in panels
        if all(np.isfinite(curve).all() for curve in curves)
    ]


def _fastest(velocity: Array) -> Array:
    return np.abs(velocity).max(axis=1)


def _panel(time: Array, what: str, curves: Sequence[Array]) -> Panel:
    low = min(0.0, *(float(curve.min()) for curve in curves))
    high = max(float(curve.max()) for curve in curves)
    panel = Panel((float(time[0]), float(time[-1])), (low, high), "time [s]", what)
    for k, (curve, title) in enumerate(zip(curves, ("as logged", "with the shield"), strict=True)):
        panel.curve(time, curve, k, title)
    return panel


def _gaps(audit: Audit) -> Markup:
    if not audit.gaps:
        return tag("p", "None.")
    rows = [[gap.of, f"{gap.start:.3f}", f"{gap.end:.3f}", f"{gap.end - gap.start:.3f}"] for gap in audit.gaps]
    return rows_of(["of", "from [s]", "to [s]", "length [s]"], rows)
