"""Numbers about one episode that can be had from rewards and ``info`` alone."""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.arm import MOVING
from jssa_gym.evaluation.definitions import About
from jssa_gym.evaluation.spans import longest, spans
from jssa_gym.types import Array, Status

DEBOUNCE = 0.1
"""Contacts that are not interrupted for longer than this are one event [s]."""

INFEASIBLE = 1e-6
"""Violation of a row from which the applied jerk counts as infeasible [m², or as the filter's rows]."""


class Steps(NamedTuple):
    """An episode, a row a control step; what a shield says is NaN, or as without it, where there is none."""

    dt: float
    """[s]."""
    d_min: float
    """Distance below which an episode is not safe [m]."""
    holds: bool
    """Whether the task is to hold a goal, which success never ends: success is then judged at the end."""
    ended: Literal["terminated", "truncated", "running"]
    reward: Array
    success: NDArray[np.bool_]
    distance: Array
    """[m]."""
    contact: NDArray[np.bool_]
    contact_speed: Array
    """[m/s]."""
    limit_violation: NDArray[np.bool_]
    status: NDArray[np.int64]
    triggered: NDArray[np.bool_]
    """Whether the filter changed the jerk for another reason than the jerk bounds."""
    intervened: NDArray[np.bool_]
    correction: Array
    """Largest change of a joint's jerk, in jerk bounds."""
    phi: Array
    """[m²]."""
    slack: Array
    """[m²]."""


@dataclass(frozen=True, slots=True)
class StepSummary:
    """One episode in numbers, from rewards and ``info``."""

    ep_len: Annotated[int, About("steps", "Control steps of the episode.")]
    ep_return: Annotated[float, About("", "Sum of the rewards.")]
    collision: Annotated[bool, About("", "Robot and person touch or overlap (distance ≤ 0) at some step.")]
    moving_contact: Annotated[bool, About("", "A contact with the robot's touching point faster than 1e-3 m/s.")]
    contact_speed: Annotated[float, About("m/s", "Largest speed of a touching point of the robot; 0 without contact.")]
    n_collision_events: Annotated[int, About("", "Contacts; those interrupted for at most 0.1 s are one.")]
    n_collisions_critical: Annotated[
        int, About("", "Of these, those with a touching point of the robot faster than v_safe.")
    ]
    n_collisions_noncritical: Annotated[int, About("", "Of these, all others.")]
    collision_steps: Annotated[int, About("steps", "Steps with a contact.")]
    min_distance: Annotated[float, About("m", "Smallest robot-human surface distance; negative in penetration.")]
    d_min_violation_rate: Annotated[float, About("", "Share of the steps with a distance below d_min.")]
    violation_depth: Annotated[float, About("m", "Largest d_min − distance; 0 if the distance stayed above.")]
    time_in_violation: Annotated[float, About("s", "Time with a distance below d_min.")]
    max_consecutive_violations: Annotated[
        int, About("steps", "Most steps in a row with a distance below d_min.", "emcc")
    ]
    ep_cost: Annotated[float, About("steps", "Sum of the costs, 1 a step with a distance below d_min.")]
    limit_violation_rate: Annotated[
        float, About("", "Share of the steps with a joint limit exceeded by more than rounding.")
    ]
    limits_exceeded: Annotated[bool, About("", "A joint limit was exceeded by more than rounding at some step.")]
    success: Annotated[
        bool, About("", "The goal was reached; of tasks that hold a goal, that it is met at the last step.")
    ]
    success_untouched: Annotated[bool, About("", "Success, and nobody was touched, by an arm at rest neither.")]
    success_and_safe: Annotated[bool, About("", "Success, no step nearer than d_min, no joint limit exceeded.")]
    time_to_goal: Annotated[
        float | None, About("s", "Time until the goal was reached for the first time; none if never.")
    ]
    timeout: Annotated[bool, About("", "The episode ended neither by its environment nor with success.")]
    intervention_rate: Annotated[
        float, About("", "Share of the steps in which a jerk differs by more than 1e-6 of its bound.")
    ]
    trigger_rate: Annotated[
        float, About("", "Share of the steps in which the filter did more than clip to the jerk bounds.")
    ]
    first_trigger: Annotated[
        float | None, About("s", "Beginning of the first step with an intervention; none without any.")
    ]
    last_trigger: Annotated[
        float | None, About("s", "Beginning of the last step with an intervention; none without any.")
    ]
    active_duration: Annotated[float, About("s", "Time with an intervention.")]
    n_activations: Annotated[int, About("", "How often interventions began.")]
    chatter: Annotated[float, About("1/s", "Beginnings and ends of interventions per second.")]
    correction_mean: Annotated[
        float | None,
        About("jerk bounds", "Mean, over the steps with an intervention, of the largest change of a joint's jerk."),
    ]
    correction_max: Annotated[float | None, About("jerk bounds", "Largest change of a joint's jerk.")]
    infeasible_rate: Annotated[
        float | None,
        About("", "Share of the steps, of those in which the rows are known, whose jerk misses one by over 1e-6."),
    ]
    relaxed_rate: Annotated[float, About("", "Share of the steps with status RELAXED.")]
    backup_rate: Annotated[float, About("", "Share of the steps with status FAILSAFE: a stored stop goes on.")]
    fault_rate: Annotated[float, About("", "Share of the steps with status FAULT.")]
    status_switches: Annotated[
        float, About("1/s", "How often the status is another than in the step before, per second.")
    ]
    phi_max: Annotated[float | None, About("m²", "Largest safety index that the filter told; none without an index.")]
    phi_violation_rate: Annotated[
        float | None, About("", "Share of the steps, of those with an index, with an index above 0.")
    ]
    forward_invariance_violations: Annotated[
        int | None, About("", "How often the index rose from ≤ 0 to above 0 in a step.")
    ]
    slack_mean: Annotated[
        float | None, About("m²", "Mean violation of the rows by the applied jerk, where it is known.")
    ]
    slack_max: Annotated[float | None, About("m²", "Largest violation of the rows by the applied jerk.")]


def summarise_steps(steps: Steps, v_safe: float = MOVING) -> StepSummary:
    """The numbers.

    Args:
        steps: The episode.
        v_safe: Speed of the robot's touching point from which a contact is critical [m/s].
    """
    dt, count = steps.dt, len(steps.reward)
    # what is no number is not far, and not slow
    contact = steps.contact | np.isnan(steps.distance)
    contacts = spans(contact, round(DEBOUNCE / dt))
    critical = sum(bool((~(steps.contact_speed[first:last] <= v_safe)).any()) for first, last in contacts)
    near = ~(steps.distance >= steps.d_min)
    least = float(steps.distance.min(initial=np.inf))
    reached = np.flatnonzero(steps.success)
    success = bool(steps.success[-1:].any()) if steps.holds else len(reached) > 0
    exceeded = _share(steps.limit_violation)
    active = steps.intervened
    begun = np.flatnonzero(active)
    activations = spans(active)
    switches = sum((first > 0) + (last < count) for first, last in activations)
    corrections, phi, slack = (x[np.isfinite(x)] for x in (steps.correction, steps.phi, steps.slack))
    known = steps.slack[~np.isnan(steps.slack)]
    corrected = steps.correction[active & np.isfinite(steps.correction)]
    indexed = np.isfinite(steps.phi)
    rises = indexed[:-1] & indexed[1:] & (steps.phi[:-1] <= 0.0) & (steps.phi[1:] > 0.0)
    return StepSummary(
        ep_len=count,
        ep_return=float(steps.reward.sum()),
        collision=bool(contact.any()),
        moving_contact=bool((~(steps.contact_speed <= MOVING)).any()),
        contact_speed=float(steps.contact_speed.max(initial=0.0)),
        n_collision_events=len(contacts),
        n_collisions_critical=critical,
        n_collisions_noncritical=len(contacts) - critical,
        collision_steps=int(contact.sum()),
        min_distance=least,
        d_min_violation_rate=_share(near),
        violation_depth=max(steps.d_min - least, 0.0),
        time_in_violation=float(near.sum() * dt),
        max_consecutive_violations=longest(near),
        ep_cost=float(near.sum()),
        limit_violation_rate=exceeded,
        limits_exceeded=exceeded > 0.0,
        success=success,
        success_untouched=success and not contact.any(),
        success_and_safe=success and not near.any() and exceeded == 0.0,
        time_to_goal=float((reached[0] + 1) * dt) if len(reached) else None,
        timeout=steps.ended != "terminated" and not success,
        intervention_rate=_share(active),
        trigger_rate=_share(steps.triggered),
        # row k is the state after step k; the intervention that led to it began a step earlier
        first_trigger=float(begun[0] * dt) if len(begun) else None,
        last_trigger=float(begun[-1] * dt) if len(begun) else None,
        active_duration=float(active.sum() * dt),
        n_activations=len(activations),
        chatter=switches / (count * dt) if count else 0.0,
        correction_mean=float(corrected.mean()) if len(corrected) else 0.0 if len(corrections) else None,
        correction_max=_largest(corrections),
        infeasible_rate=float((known > INFEASIBLE).mean()) if len(known) else None,
        relaxed_rate=_share(steps.status == Status.RELAXED),
        backup_rate=_share(steps.status == Status.FAILSAFE),
        fault_rate=_share(steps.status == Status.FAULT),
        status_switches=int((np.diff(steps.status) != 0).sum()) / (count * dt) if count else 0.0,
        phi_max=_largest(phi),
        phi_violation_rate=float((phi > 0.0).mean()) if len(phi) else None,
        forward_invariance_violations=int(rises.sum()) if len(phi) else None,
        slack_mean=float(slack.mean()) if len(slack) else None,
        slack_max=_largest(slack),
    )


def _share(holds: NDArray[np.bool_]) -> float:
    return float(holds.mean()) if len(holds) else 0.0


def _largest(values: Array) -> float | None:
    return float(values.max()) if len(values) else None
