"""Numbers about one episode."""

import dataclasses
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.arm import MOVING
from jssa_gym.envs.tasks import TASKS, Deliver
from jssa_gym.envs.tasks.deliver import per_minute
from jssa_gym.evaluation.definitions import About
from jssa_gym.evaluation.geometry import Geometry
from jssa_gym.evaluation.motion import jerk_jumps
from jssa_gym.evaluation.spans import spans
from jssa_gym.evaluation.steps import DEBOUNCE, Steps, StepSummary, summarise_steps
from jssa_gym.evaluation.trace import every_step
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import JointLimits
from jssa_gym.shields.reasons import OUTSIDE
from jssa_gym.types import Array, Status, Trace
from jssa_gym.validation import check_fields, number_within

_ROUNDING = 1e-9
"""Share of a limit that rounding may cost, as in the environment."""

_SLOWEST = 1e-6
"""Closing speed under which there is no time to collision [m/s]."""


@dataclass(frozen=True, slots=True)
class SeparationParams:
    r"""Speed and separation monitoring, after ISO/TS 15066:2016, 5.5.4: :math:`S_p = S_h + S_r + S_s + C + Z`.

    :math:`S_h = v_h (T_r + T_s)`, :math:`S_r = v_r T_r`; the stopping time :math:`T_s` and the distance
    :math:`S_s` covered while stopping are those of the jerk-limited stop from the joint state at hand.

    Raises:
        ParameterError: A number is negative or not finite.
    """

    human_speed: float | None = 1.6
    """:math:`v_h` [m/s]; None for the measured speed of the person's closest point towards the robot."""
    reaction_time: float = 0.1
    """:math:`T_r` [s]."""
    intrusion: float = 0.0
    """C: how far a person reaches before being seen [m]."""
    uncertainty: float = 0.0
    """:math:`Z = Z_d + Z_r`, of the person's and the robot's place [m]."""

    def __post_init__(self) -> None:
        speed = () if self.human_speed is None else ("human_speed",)
        check_fields(self, (*speed, "reaction_time", "intrusion", "uncertainty"), number_within, 0.0)


@dataclass(frozen=True, slots=True)
class Summary(StepSummary):
    """One episode in numbers; times in seconds, counts in control steps. None where something cannot be said."""

    name: str
    n_collisions_robot_fault: Annotated[
        int | None, About("", "Contacts in which the robot's point moves in, the person's not.")
    ]
    n_collisions_human_fault: Annotated[
        int | None, About("", "Contacts in which the robot's point never moves in over v_safe.")
    ]
    n_collisions_shared_fault: Annotated[int | None, About("", "Contacts in which both move in faster than v_safe.")]
    energy_ratio: Annotated[
        float | None,
        About("", "Largest energy that the arm's own motion gives in a contact, over the part's limit; indicative."),
    ]
    n_collisions_self: Annotated[int | None, About("", "Contacts of the arm with itself.")]
    n_collisions_static: Annotated[
        int | None, About("", "Contacts of the arm with table or floor; a column that stands on it is none.")
    ]
    n_actions_not_finite: Annotated[
        int, About("steps", "Steps in which the policy's action was not finite, which a filter answers with a FAULT.")
    ]
    min_distance_arm: Annotated[
        float | None, About("m", "Smallest distance to people of the arm, but for its first link.")
    ]
    ttc: Annotated[float | None, About("s", "Smallest distance over closing speed; none if they never approach.")]
    ssm_margin: Annotated[
        float | None, About("m", "Smallest distance − S_p of any pair, of speed and separation monitoring.")
    ]
    ssm_violation_rate: Annotated[float | None, About("", "Share of the steps with a pair's distance below its S_p.")]
    ssm_violation_time: Annotated[float | None, About("s", "Time with a pair's distance below its S_p.")]
    false_intervention_rate: Annotated[
        float | None,
        About("", "Share of the interventions in whose place the wanted jerk, then a stop, would have done no harm."),
    ]
    true_phi_max: Annotated[
        float | None, About("m²", "Largest safety index that is measured, by the same λ for all filters.")
    ]
    true_phi_violation_rate: Annotated[float | None, About("", "Share of the steps with that index above 0.")]
    true_forward_invariance_violations: Annotated[
        int | None, About("", "How often that index rose from ≤ 0 to above 0 in a step.")
    ]
    path_length: Annotated[float | None, About("m", "Length of the way of the tool centre point.")]
    tracking_error: Annotated[
        float | None,
        About("m", "Mean distance of the tool centre point from its goal; none where that is no point."),
    ]
    tracking_error_end: Annotated[float | None, About("m", "The same at the end of the episode.")]
    deliveries_per_minute: Annotated[
        float | None, About("1/min", "Deliveries over time, until the last that is asked for; none of other tasks.")
    ]
    jerk_rms: Annotated[float, About("jerk bounds", "Root mean square, over steps and joints, of the applied jerk.")]
    jerk_jumps: Annotated[
        float,
        About("", "Share of the steps, from the second on, in which a joint's applied jerk changes by over its bound."),
    ]
    jerk_jumps_nominal: Annotated[
        float, About("", "The part of it in which the wanted jerk, within its bounds, jumps as well: the policy's.")
    ]
    jerk_jumps_shield: Annotated[float, About("", "The rest, in which the wanted jerk does not: the shield's.")]
    speed_limit_ratio: Annotated[float, About("", "Largest joint speed over its limit.")]
    acceleration_limit_ratio: Annotated[float, About("", "Largest joint acceleration over its limit.")]
    jerk_limit_ratio: Annotated[float, About("", "Largest applied joint jerk over its bound.")]
    position_violation_rate: Annotated[float, About("", "Share of the steps with a joint outside its range.")]
    velocity_violation_rate: Annotated[float, About("", "Share of the steps with a joint faster than its limit.")]
    acceleration_violation_rate: Annotated[
        float, About("", "Share of the steps with a joint acceleration above its limit.")
    ]
    jerk_violation_rate: Annotated[float, About("", "Share of the steps with a jerk above its bound.")]
    mean_critical_velocity: Annotated[
        float | None, About("m/s", "Mean, over all steps, of the distance's absolute rate.")
    ]
    mean_critical_acceleration: Annotated[float | None, About("m/s²", "The same of the distance's second derivative.")]
    shield_p50: Annotated[float | None, About("s", "Median time of a decision; none without a shield.")]
    shield_p95: Annotated[float | None, About("s", "95th percentile of it.")]
    shield_p99: Annotated[float | None, About("s", "99th percentile of it.")]
    shield_max: Annotated[float | None, About("s", "Longest decision.")]
    deadline_miss_rate: Annotated[
        float | None, About("", "Share of the decisions that took longer than the control step.")
    ]


def summarise(
    trace: Trace,
    limits: JointLimits,
    seen: Geometry | None = None,
    *,
    v_safe: float = MOVING,
    separation: SeparationParams | None = None,
) -> Summary:
    """Summary of a trace.

    Args:
        trace: The episode.
        limits: The robot's limits.
        seen: :func:`~jssa_gym.evaluation.geometry.geometry` of the trace; metrics that need it are None without.
        v_safe: Speed of the robot's touching point from which a contact is critical [m/s].
        separation: Parameters of ``ssm_margin`` and its kin; None for the defaults.

    Raises:
        ParameterError: ``v_safe`` is negative, or the rows are not one control step apart.
    """
    v_safe = number_within("v_safe", v_safe, 0.0)
    if not every_step(trace):
        raise ParameterError(
            "the rows of the episode are not one control step apart; of a policy that acts more slowly an "
            "environment without ActionRepeat and ticks= are to be given"
        )
    steps = summarise_steps(_steps(trace), v_safe)
    low, high = limits.position.T
    slack = _ROUNDING * (high - low)
    outside = np.any((trace.position < low - slack) | (trace.position > high + slack), axis=1)
    ratios = [
        np.abs(x) / limit
        for x, limit in (
            (trace.velocity, limits.velocity),
            (trace.acceleration, limits.acceleration),
            (trace.jerk, limits.jerk),
        )
    ]
    peaks = [float(ratio.max(initial=0.0)) for ratio in ratios]
    beyond = [_mean((ratio > 1.0 + _ROUNDING).any(axis=1)) or 0.0 for ratio in ratios]
    jumps = jerk_jumps(trace.jerk, trace.nominal, limits.jerk)
    timed = trace.shield_time[np.isfinite(trace.shield_time)]
    quantiles = np.percentile(timed, [50, 95, 99, 100]).tolist() if len(timed) else [None] * 4
    people = np.isfinite(trace.distance)
    # the touching points are the commanded arm's, which a servoed one follows late
    kinematic = trace.dynamics == "kinematic"
    faults = _faults(trace, seen, v_safe) if seen is not None and kinematic else (None,) * 3
    margin = None if seen is None else separation_margin(seen, separation or SeparationParams())
    closing = trace.speed < -_SLOWEST
    phi = seen.phi if seen is not None and kinematic and len(trace.human_radius) else np.zeros(0)
    above = ~(phi <= 0.0)
    task = TASKS.get(trace.task)
    off = np.zeros(0)
    if seen is not None and task is not None and task.space == "tip":
        off = np.linalg.norm(seen.tip[1:] - trace.goal, axis=1)
    return Summary(
        **{field.name: getattr(steps, field.name) for field in dataclasses.fields(StepSummary)},
        name=trace.name,
        n_collisions_robot_fault=faults[0],
        n_collisions_human_fault=faults[1],
        n_collisions_shared_fault=faults[2],
        energy_ratio=float(seen.touches.energy_ratio.max(initial=0.0)) if seen is not None and kinematic else None,
        n_collisions_self=None if seen is None else _events(seen.own, trace.dt),
        n_collisions_static=None if seen is None else _events(seen.planes, trace.dt),
        n_actions_not_finite=int((~np.isfinite(trace.nominal)).any(axis=1).sum()) if len(trace.time) else 0,
        min_distance_arm=None if seen is None else float(seen.arm_distance.min(initial=np.inf)),
        ttc=_least(np.maximum(trace.distance[closing & people], 0.0) / -trace.speed[closing & people]),
        ssm_margin=None if margin is None else _least(margin[people]),
        ssm_violation_rate=None if margin is None else _mean(~(margin >= 0.0)),
        ssm_violation_time=None if margin is None else float((~(margin >= 0.0)).sum() * trace.dt),
        false_intervention_rate=_mean(seen.false_interventions) if seen is not None and kinematic else None,
        true_phi_max=float(phi.max()) if len(phi) else None,
        true_phi_violation_rate=_mean(above),
        true_forward_invariance_violations=int((~above[:-1] & above[1:]).sum()) if len(phi) else None,
        path_length=None if seen is None else float(np.linalg.norm(np.diff(seen.tip, axis=0), axis=1).sum()),
        tracking_error=_mean(off),
        tracking_error_end=float(off[-1]) if len(off) else None,
        deliveries_per_minute=_throughput(trace, steps.time_to_goal) if trace.task == Deliver.name else None,
        jerk_rms=float(np.sqrt(np.mean(ratios[2] ** 2))) if len(trace.time) else 0.0,
        jerk_jumps=jumps.applied,
        jerk_jumps_nominal=jumps.nominal,
        jerk_jumps_shield=jumps.shield,
        speed_limit_ratio=peaks[0],
        acceleration_limit_ratio=peaks[1],
        jerk_limit_ratio=peaks[2],
        position_violation_rate=_mean(outside) or 0.0,
        velocity_violation_rate=beyond[0],
        acceleration_violation_rate=beyond[1],
        jerk_violation_rate=beyond[2],
        mean_critical_velocity=_mean(np.abs(trace.speed[people])),
        mean_critical_acceleration=_mean(np.abs(trace.acceleration_of_distance[people])),
        shield_p50=quantiles[0],
        shield_p95=quantiles[1],
        shield_p99=quantiles[2],
        shield_max=quantiles[3],
        deadline_miss_rate=_mean(timed > trace.dt),
    )


def _throughput(trace: Trace, finished: float | None) -> float:
    """Deliveries per minute: a leg is over where the next place becomes the goal, and the last with success."""
    legs = int(np.diff(trace.goal, axis=0).any(axis=1).sum()) + (finished is not None)
    return per_minute(legs // 2, len(trace.time) * trace.dt if finished is None else finished)


def _steps(trace: Trace) -> Steps:
    told = {name: getattr(trace, name) for name in Steps._fields if name != "triggered"}
    return Steps(**told, triggered=(trace.status != Status.NOMINAL) & (trace.reason != OUTSIDE))


def _faults(trace: Trace, seen: Geometry, v_safe: float) -> tuple[int, int, int]:
    """Contacts by who moved into whom, as :attr:`jssa_gym.evaluation.Contact.fault` says it."""
    robot = human = shared = 0
    touches = seen.touches
    for first, last in spans(trace.contact, round(DEBOUNCE / trace.dt)):
        during = (touches.step >= first) & (touches.step < last)
        if touches.robot_approach[during].max(initial=0.0) <= v_safe:
            human += 1
        elif touches.human_approach[during].max(initial=0.0) <= v_safe:
            robot += 1
        else:
            shared += 1
    return robot, human, shared


def separation_margin(seen: Geometry, params: SeparationParams) -> Array:
    """Smallest distance minus protective separation distance of all pairs, shape (T,) [m]; inf without people."""
    speed = np.maximum(seen.human_approach, 0.0) if params.human_speed is None else params.human_speed
    needed = (
        speed * (params.reaction_time + seen.stop_time[:, None, None])
        + np.maximum(seen.approach, 0.0) * params.reaction_time
        + seen.stop_advance
        + params.intrusion
        + params.uncertainty
    )
    return (seen.distance - needed).min(axis=(1, 2), initial=np.inf)


def _events(distance: Array, dt: float) -> int:
    return len(spans(~(distance > 0.0), round(DEBOUNCE / dt)))


def _mean(values: Array | NDArray[np.bool_]) -> float | None:
    return float(values.mean()) if len(values) else None


def _least(values: Array) -> float | None:
    return float(values.min()) if len(values) else None
