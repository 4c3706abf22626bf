"""Moves from one posture to another, and stops."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jssa_gym.control.least_jerk import FEWEST
from jssa_gym.control.plan import TOLERANCE, Plan, affordable, checked_state, plan_waypoints
from jssa_gym.exceptions import InfeasibleError
from jssa_gym.kernels.fewest import search
from jssa_gym.kernels.records import STOP, records
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.robots import JointLimits
from jssa_gym.types import Array, JointState
from jssa_gym.validation import positive_number, real_array

_GROWTH = 1.15
"""By which the time for a move that begins in motion is lengthened until it can be made."""


def fewest_ticks(distance: float, V: float, A: float, J: float, dt: float) -> tuple[int, int, int]:
    r"""The shortest symmetric jerk-limited move of one joint from rest to rest on the time grid.

    Jerk :math:`u` for :math:`n_j` ticks, none for :math:`n_a`, :math:`-u` for :math:`n_j`, none for :math:`n_v`, and
    the same backwards. With times :math:`t = n\tau` it goes

    .. math:: \Delta = u\, t_j (t_j + t_a) (2 t_j + t_a + t_v),

    at an acceleration of :math:`u t_j` and a speed of :math:`u t_j (t_j + t_a)` at most. So for every choice of whole
    ticks there is a jerk that ends exactly at the goal, and the fewest ticks within the limits are found by looking.

    Args:
        distance: Positive [rad].
        V, A, J: Limits [rad/s, rad/s², rad/s³].
        dt: Tick [s].

    Returns:
        The ticks n_j, n_a, n_v.

    Raises:
        ParameterError: A number is not positive or not finite, or the move takes more ticks than a plan may have.
    """
    distance, V, A, J, dt = (
        positive_number(name, value) for name, value in {"distance": distance, "V": V, "A": A, "J": J, "dt": dt}.items()
    )
    rise = min(A / J, np.sqrt(V / J))
    hold = max(V / A - rise, 0.0) if rise == A / J else 0.0
    if distance >= V * (2.0 * rise + hold):
        shortest = 2.0 * rise + hold + distance / V
    else:
        rise = np.cbrt(distance / (2.0 * J))
        shortest = 4.0 * rise
        if rise > A / J:
            rise = A / J
            shortest = rise + 2.0 * np.sqrt(rise**2 / 4.0 + distance / A)
    affordable(float(shortest) / dt, dt)
    total = max(FEWEST, int(np.ceil(shortest / dt - 1e-9)))
    return search(total, distance, (V, A, J), dt, dt**2)


def _shape(n_j: int, n_a: int, n_v: int, dt: float) -> Array:
    """Jerks of a move of distance 1, shape (4 n_j + 2 n_a + n_v,)."""
    unit = 1.0 / (dt**3 * n_j * (n_j + n_a) * (2 * n_j + n_a + n_v))
    signs = np.repeat([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0], [n_j, n_a, n_j, n_v, n_j, n_a, n_j])
    return unit * signs


def within_range(position: Array, limits: JointLimits) -> bool:
    """Whether all joints, shape (n,) [rad], are inside their position limits."""
    low, high = limits.position.T
    return bool(np.all(position >= low - TOLERANCE) and np.all(position <= high + TOLERANCE))


def plan_move(start: ArrayLike, goal: ArrayLike, limits: JointLimits, dt: float) -> Plan:
    """The shortest jerk-limited move from rest to rest, all joints ending together.

    Its duration is the slowest joint's (see :func:`fewest_ticks`). The others share its profile where that keeps their
    limits, so that the way is a straight line in joint space; those for which it does not cruise at a lower speed.

    Args:
        start, goal: Joint positions, shape (n,) [rad].
        limits: Of the joints.
        dt: Tick [s].

    Returns:
        The plan; of no ticks if start and goal are the same.

    Raises:
        ParameterError: A shape is wrong, a number not finite, the tick not positive or so short that the plan would
            have more than :data:`~jssa_gym.control.plan.MOST` of them.
        InfeasibleError: Start or goal lies outside the position limits.
    """
    n, dt = len(limits.jerk), positive_number("dt", dt)
    begin = real_array("start", start, (n,), "a joint position [rad]")
    end = real_array("goal", goal, (n,), "a joint position [rad]")
    # first of all: towards an arm that was thrown far out of its range, plans have no end
    if not (within_range(begin, limits) and within_range(end, limits)):
        raise InfeasibleError(f"a move from {begin.tolist()} to {end.tolist()} leaves the position limits")
    way, rest = end - begin, np.zeros(n)
    state = np.array([begin, rest, rest])
    moving = np.flatnonzero(np.abs(way) > 1e-12)
    jerk = np.zeros((0, n))
    if len(moving):
        shapes = {
            j: fewest_ticks(abs(way[j]), limits.velocity[j], limits.acceleration[j], limits.jerk[j], dt) for j in moving
        }
        ticks = {j: 4 * n_j + 2 * n_a + n_v for j, (n_j, n_a, n_v) in shapes.items()}
        slowest = max(ticks, key=lambda j: ticks[j])
        total = ticks[slowest]
        line = _shape(*shapes[slowest], dt)
        n_j, n_a, _ = shapes[slowest]
        jerk = np.zeros((total, n))
        for j in moving:
            u = abs(way[j]) * np.abs(line).max()
            peak = u * n_j * dt
            fits = u <= limits.jerk[j] and peak <= limits.acceleration[j]
            fits = fits and peak * (n_j + n_a) * dt <= limits.velocity[j]
            own = shapes[j]
            jerk[:, j] = way[j] * (line if fits else _shape(own[0], own[1], own[2] + total - ticks[j], dt))
    plan = Plan.follow(state, jerk, dt, (len(jerk),))
    if not plan.keeps(limits):
        raise InfeasibleError(f"a move from {begin.tolist()} to {end.tolist()} cannot keep the limits")
    return plan


def plan_approach(state: JointState, goal: ArrayLike, limits: JointLimits, dt: float) -> Plan:
    """A move to rest at a posture that may begin in motion: :func:`plan_move` from rest, else of least squared jerk.

    If none of those is found in the time that a stop and a move take, it is these.

    Args:
        state: Where it begins.
        goal: Shape (n,) [rad].
        limits: Of the joints.
        dt: Tick [s].

    Raises:
        ParameterError: A shape is wrong, a number not finite, the tick not positive, or the plan too long.
        InfeasibleError: The goal lies outside the position limits, or the state cannot be brought to rest within them.
    """
    state = checked_state(state, limits)
    if not (np.any(state.velocity) or np.any(state.acceleration)):
        return plan_move(state.position, goal, limits, dt)
    end = real_array("goal", goal, (len(limits.jerk),), "a joint position [rad]")
    if not (within_range(state.position, limits) and within_range(end, limits)):
        raise InfeasibleError(f"no move from {state} to {goal} keeps the position limits")
    low, high = limits.position.T
    brake = plan_brake(state, limits, dt)
    move = plan_move(np.clip(brake.states[-1, 0], low, high), goal, limits, dt)
    ticks = max(len(brake), len(plan_move(np.clip(state.position, low, high), goal, limits, dt)), FEWEST)
    while ticks <= len(brake) + len(move):
        try:
            return plan_waypoints(state, [goal], ticks * dt, limits, dt, shortest=False)
        except InfeasibleError:
            ticks = int(np.ceil(ticks * _GROWTH))
    if not brake.keeps(limits):
        raise InfeasibleError(f"no move from {state} to {goal} keeps the limits")
    both = brake.then(move)
    return Plan(dt, both.jerk, both.states, both.marks[-1:])


def plan_brake(state: JointState, limits: JointLimits, dt: float) -> Plan:
    """The jerk-limited stop on the time grid, see :func:`jssa_gym.kernels.stopping.stop_joint`.

    Whether it keeps the position limits depends on the state; :meth:`Plan.keeps` tells.

    Raises:
        ParameterError: A shape is wrong, a number not finite, the tick not positive, or the arm so fast that its stop
            would take more than :data:`~jssa_gym.control.plan.MOST` ticks.
    """
    state, dt = checked_state(state, limits), positive_number("dt", dt)
    rows, stops, ticks = _stop(state, limits, dt)
    affordable(ticks if np.all(np.isfinite(stops["jerk_in"])) else np.inf, dt)
    jerk = np.zeros((ticks, rows.shape[1]))
    for k in range(ticks):
        stop_jerk(stops, k, jerk[k])
    return Plan.follow(rows, jerk, dt, (ticks,))


def brake_jerk(state: JointState, limits: JointLimits, dt: float) -> Array:
    """The first jerk of :func:`plan_brake`, shape (n,) [rad/s³]; zero at rest, and for a joint without a stop."""
    rows, stops, ticks = _stop(state, limits, dt)
    jerk = np.zeros(rows.shape[1])
    if ticks:
        stop_jerk(stops, 0, jerk)
    return jerk


def _stop(state: JointState, limits: JointLimits, dt: float) -> tuple[Array, NDArray, int]:
    """The state as rows, its stop by joints, and how many ticks that takes."""
    rows = np.array(state, float)
    stops = records(rows.shape[1], STOP)
    return rows, stops, plan_stop(rows, limits.bounds(), dt, stops)
