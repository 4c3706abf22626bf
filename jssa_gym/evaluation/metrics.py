"""Numbers about one episode."""

from dataclasses import dataclass

import numpy as np

from jssa_gym.envs.arm import MOVING
from jssa_gym.robots import JointLimits
from jssa_gym.types import Trace


@dataclass(frozen=True, slots=True)
class Summary:
    """One episode in numbers; times in seconds, counts in control steps."""

    name: str
    steps: int
    min_distance: float
    """Smallest robot-human surface distance [m]; inf without a human."""
    collision: bool
    """Any contact."""
    moving_contact: bool
    """A contact with the robot's touching point faster than 1e-3 m/s."""
    contact_speed: float
    """Largest speed of a touching point of the robot [m/s]."""
    first_trigger: float | None
    """Time of the first intervention [s]; None without any."""
    last_trigger: float | None
    active_duration: float
    """Time with an intervention in total [s]."""
    intervention_rate: float
    n_activations: int
    """Rising edges of the intervention."""
    speed_limit_ratio: float
    """Largest joint speed over its limit."""
    jerk_limit_ratio: float
    """Largest applied joint jerk over its bound."""
    position_violation_rate: float
    """Share of steps with a joint outside its range."""
    shield_p50: float | None
    """Median time of a decision [s]; None without a shield."""
    shield_p99: float | None


def summarise(trace: Trace, limits: JointLimits) -> Summary:
    """Summary of a trace.

    Args:
        trace: The episode.
        limits: The robot's limits.
    """
    active = trace.intervened
    moments = trace.time[active]
    # the state after an intervention is stamped with the step's end; the trigger is its beginning
    first, last = (float(moments[0] - trace.dt), float(moments[-1] - trace.dt)) if len(moments) else (None, None)
    low, high = limits.position.T
    outside = np.any((trace.position < low) | (trace.position > high), axis=1)
    timed = trace.shield_time[np.isfinite(trace.shield_time)]
    return Summary(
        name=trace.name,
        steps=len(trace.time),
        min_distance=float(trace.distance.min(initial=np.inf)),
        collision=bool(trace.contact.any()),
        moving_contact=bool((trace.contact_speed > MOVING).any()),
        contact_speed=float(trace.contact_speed.max(initial=0.0)),
        first_trigger=first,
        last_trigger=last,
        active_duration=float(active.sum() * trace.dt),
        intervention_rate=float(active.mean()) if len(active) else 0.0,
        n_activations=int((np.diff(active.astype(int), prepend=0) == 1).sum()),
        speed_limit_ratio=float((np.abs(trace.velocity) / limits.velocity).max(initial=0.0)),
        jerk_limit_ratio=float((np.abs(trace.jerk) / limits.jerk).max(initial=0.0)),
        position_violation_rate=float(outside.mean()) if len(outside) else 0.0,
        shield_p50=float(np.median(timed)) if len(timed) else None,
        shield_p99=float(np.percentile(timed, 99)) if len(timed) else None,
    )
