"""What is said of metrics: unit and definition are written once, beside the name, as fields of dataclasses."""

from collections.abc import Iterable, Iterator
from dataclasses import fields
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints


class About(NamedTuple):
    """What is said of a metric, as its type's annotation."""

    unit: str
    """Unit of the metric's value; empty for a plain number."""
    text: str
    """Its definition, in one sentence."""
    over_episodes: str = ""
    """Name of its rate or mean over episodes, where that has a name of its own."""


class Metric(NamedTuple):
    """What is known of a metric."""

    name: str
    unit: str
    text: str
    over_episodes: str
    """Name of its rate (of yes-or-no metrics) or mean over episodes."""
    yes_or_no: bool
    optional: bool
    """Whether an episode may have none."""


def metrics_of(summary: type[Any]) -> Iterator[Metric]:
    """The metrics of a summary's class, in its order."""
    hints = get_type_hints(summary, include_extras=True)
    for field in fields(summary):
        hint = hints[field.name]
        if get_origin(hint) is not Annotated:
            continue
        kind, says = get_args(hint)
        name = says.over_episodes or (f"{field.name}_rate" if kind is bool else field.name)
        yield Metric(field.name, says.unit, says.text, name, kind is bool, kind not in (bool, int, float))


def markdown(metrics: Iterable[Metric]) -> str:
    """Metrics as a table in Markdown."""
    lines = ["| metric | unit | definition | over episodes |", "|---|---|---|---|"]
    for metric in metrics:
        told = "k of n" if metric.yes_or_no else "mean"
        name = "" if metric.over_episodes == metric.name else f", `{metric.over_episodes}`"
        lines.append(f"| `{metric.name}` | {metric.unit} | {metric.text} | {told}{name} |")
    return "\n".join(lines)
