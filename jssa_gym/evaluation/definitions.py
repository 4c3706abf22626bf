"""What is said of metrics: unit and definition are written once, beside the name, as fields of dataclasses.

What they are called on pages, in words, is here too.
"""

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


WORDS = {
    "success_and_safe_rate": "success, and safe",
    "success_untouched_rate": "success, nobody touched",
    "success_rate": "success",
    "collision_rate": "any contact",
    "moving_contact_rate": "contact with the arm moving",
    "limits_exceeded_rate": "joint limit exceeded",
    "min_distance": "smallest distance",
    "min_distance_arm": "smallest distance of the arm",
    "contact_speed": "fastest contact",
    "ep_return": "return",
    "ep_len": "length",
    "ep_cost": "cost",
    "emcc": "longest stay below d_min",
    "intervention_rate": "steps changed",
    "backup_rate": "steps of a stored stop",
    "fault_rate": "steps with a fault",
    "relaxed_rate": "steps with least violation",
    "infeasible_rate": "steps with a row missed",
    "trigger_rate": "steps with more than clipping",
    "jerk_jumps": "steps with a jump of the jerk",
    "jerk_jumps_shield": "jumps of the jerk by the filter",
    "jerk_jumps_nominal": "jumps of the jerk by the policy",
    "status_switches": "switches of status",
    "jerk_rms": "RMS jerk",
    "path_length": "way of the tool",
    "time_to_goal": "time to the goal",
    "ttc": "time to collision",
    "n_collision_events": "contacts",
    "n_collisions_critical": "critical contacts",
    "n_collisions_noncritical": "other contacts",
    "n_collisions_robot_fault": "contacts by the robot's fault",
    "n_collisions_human_fault": "contacts by the person's fault",
    "n_collisions_shared_fault": "contacts by both's fault",
    "n_collisions_self": "contacts of the arm with itself",
    "n_collisions_static": "contacts with table or floor",
    "n_actions_not_finite": "actions that were not finite",
    "n_activations": "activations",
    "shield_p50": "decision time, median",
    "shield_p95": "decision time, 95 %",
    "shield_p99": "decision time, 99 %",
    "shield_max": "decision time, longest",
    "ssm_margin": "margin of speed and separation",
    "phi_max": "largest index told",
    "true_phi_max": "largest index measured",
}
"""By name over episodes; of all others the name itself says enough."""


def in_words(name: str, unit: str = "") -> str:
    """A metric's name over episodes in words, and its unit."""
    words = WORDS.get(name) or name.removesuffix("_rate").replace("_", " ")
    return f"{words} [{unit}]" if unit else words
