"""Plans: a jerk for every tick, within all limits, through waypoints to rest."""

import functools
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.control.least_jerk import FEWEST, corrected, equalities, limited, required, splines
from jssa_gym.exceptions import InfeasibleError, ParameterError
from jssa_gym.kernels.motion import violates
from jssa_gym.kernels.profile import all_keep, follow, keeps
from jssa_gym.kernels.rest import REST_PLANNED
from jssa_gym.robots import JointLimits
from jssa_gym.types import Array, JointState
from jssa_gym.validation import positive_number, real_array

TOLERANCE = 1e-9
"""Share of a limit by which a plan may exceed it: rounding."""

MET = 1e-6
"""Distance from a waypoint that counts as met [rad]."""

MOST = 2**21
"""Ticks that a plan may have: 35 minutes at 1 kHz, and 400 MB for six joints."""

_TURNING = 1e-5
"""Speed at a waypoint on the end of the range [rad/s]."""

_BETWEEN = 1e-3
"""Share of a limit that is more than what is lost between ticks."""

_LONGEST = 2**12
"""No horizon is tried that is longer than this many ticks (33 s at 125 Hz) when the shortest period is looked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A motion on the time grid: the buffer of the jerk-bounded position controller."""

    dt: float
    """Tick [s]."""
    jerk: Array
    """Shape (H, n) [rad/s³], held for a tick each."""
    states: Array
    """Position, velocity, acceleration before every tick and after the last, shape (H + 1, 3, n)."""
    marks: tuple[int, ...]
    """Ticks after which each waypoint is met, ascending; the last one is H."""

    @classmethod
    def follow(cls, state: Array, jerk: Array, dt: float, marks: tuple[int, ...]) -> Self:
        """The motion that jerks (H, n) lead to from a state (3, n), by Eq. (1)."""
        states = np.empty((len(jerk) + 1, 3, jerk.shape[1]))
        states[0] = state
        follow(jerk, dt, states)
        for array in (jerk, states):
            array.flags.writeable = False
        return cls(dt, jerk, states, marks)

    def __len__(self) -> int:
        """Number of ticks."""
        return len(self.jerk)

    @property
    def duration(self) -> float:
        """[s]."""
        return len(self) * self.dt

    def then(self, later: "Plan") -> "Plan":
        """This plan and another one that begins where it ends.

        Raises:
            ParameterError: The other one is for another tick or number of joints.
        """
        if later.dt != self.dt or later.jerk.shape[1] != self.jerk.shape[1]:
            raise ParameterError("the later plan is for another tick or another number of joints")
        jerk = np.concatenate([self.jerk, later.jerk])
        return Plan.follow(self.states[0], jerk, self.dt, self.marks + tuple(len(self) + m for m in later.marks))

    def keeps(self, limits: JointLimits, tolerance: float = TOLERANCE) -> bool:
        """Whether every joint keeps all limits, at the ticks and between them: the cubics' extremes are computed.

        Of a plan without ticks it is the state that has to keep them.
        """
        return self.within(limits.bounds(), tolerance)

    def within(self, bounds: Array, tolerance: float = TOLERANCE) -> bool:
        """:meth:`keeps` of limits as rows lower and upper position, velocity, acceleration and jerk, shape (5, n)."""
        if not len(self):
            return not violates(self.states[0], np.zeros(bounds.shape[1]), bounds, tolerance)
        return all_keep(self.jerk, self.dt, self.states, bounds, tolerance)


def checked_state(state: JointState, limits: JointLimits) -> JointState:
    """A finite joint state of as many joints as the limits are for.

    Raises:
        ParameterError: It is something else.
    """
    n = len(limits.jerk)
    return JointState(*(real_array(name, part, (n,), "a joint state") for name, part in state._asdict().items()))


def affordable(ticks: float, dt: float) -> None:
    """Refuse plans that would fill the memory.

    Raises:
        ParameterError: The plan has more than :data:`MOST` ticks.
    """
    if not ticks <= MOST:
        raise ParameterError(
            f"a plan would take {ticks:.3g} ticks of {dt:g} s, more than {MOST}: the tick is too short, the limits are "
            "too low, or the arm is too fast for them"
        )


def plan_waypoints(
    state: JointState,
    waypoints: ArrayLike,
    period: float,
    limits: JointLimits,
    dt: float,
    *,
    stretch: bool = False,
    shortest: bool = True,
) -> Plan:
    """Least squared jerk through waypoints within all limits, at rest at the last one.

    Every joint by itself: the least-norm solution where that keeps the limits, else a quadratic programme. What either
    gives is verified, between the ticks too, and refused if it is off by more than rounding.

    Args:
        state: Where it begins, in motion or not.
        waypoints: Joint positions P, shape (K, n) [rad].
        period: Time T from one to the next, and from the start to the first, a whole number of ticks [s].
        limits: Of the joints.
        dt: Tick [s].
        stretch: Whether a period that is too short is made as long as it has to be.
        shortest: Whether the error is to hold the shortest period, which takes some ten further plans to find.

    Raises:
        ParameterError: A shape is wrong, a waypoint lies outside the position limits or the period off the grid.
        InfeasibleError: No motion within the limits keeps the period; it holds the shortest one that can be kept.
    """
    n, dt = len(limits.jerk), positive_number("dt", dt)
    K = np.shape(waypoints)[0] if np.ndim(waypoints) == 2 else 0
    if K < 1:
        raise ParameterError(f"waypoints have to be of shape (K, {n}) with K >= 1, got shape {np.shape(waypoints)}")
    points = real_array("waypoints", waypoints, (K, n), "joint positions [rad]")
    outside = np.argwhere((points < limits.position[:, 0]) | (points > limits.position[:, 1]))
    if len(outside):
        k, j = outside[0]
        raise ParameterError(
            f"waypoint {k} puts joint {j} at {points[k, j]:.6g} rad, outside its limits {limits.position[j].tolist()}"
        )
    rows = np.array(checked_state(state, limits))
    affordable(K * positive_number("period", period) / dt, dt)
    each = round(period / dt)
    if abs(each * dt - period) > 1e-6 * dt * max(each, 1) or each < FEWEST:
        near = max(each, FEWEST) * dt
        raise ParameterError(
            f"period has to be a whole number of ticks of {dt:g} s and at least {FEWEST}, got {period!r}; "
            f"nearest: {near:g}"
        )
    plan = _attempt(rows, points, each, limits, dt)
    if plan is not None:
        return plan
    if not (shortest or stretch):
        raise InfeasibleError(f"a period of {period:g} s is too short for the limits")
    found = _shortest(rows, points, each, limits, dt)
    if found is None:
        raise InfeasibleError(
            "no period leads through these waypoints within the limits: the first state is outside of them, "
            "or too fast to be stopped before"
        )
    if not stretch:
        raise InfeasibleError(
            f"a period of {period:g} s is too short for the limits; the shortest is {len(found) // K * dt:.6g} s "
            "(stretch=True takes it)",
            len(found) // K * dt,
        )
    return found


def _attempt(state: Array, waypoints: Array, each: int, limits: JointLimits, dt: float) -> Plan | None:
    """A verified plan with ``each`` ticks between waypoints, or None."""
    ticks = (each,) * len(waypoints)
    equal, bounds = equalities(ticks), limits.bounds()
    unit = np.array([1.0, dt, dt**2])[:, None]
    right = required(equal, state * unit, waypoints)
    free = corrected(equal, right, np.zeros((equal.matrix.shape[1], state.shape[1])))
    plan = Plan.follow(state, free / dt**3, dt, tuple(equal.marks.tolist()))
    jerk = plan.jerk.copy()
    kept = np.array([keeps(jerk, dt, plan.states, bounds, j, TOLERANCE) for j in range(len(limits.jerk))])
    if not kept.all():
        for j in np.flatnonzero(~kept):
            better = _limited(state, ticks, plan, limits, j, right)
            if better is None:
                return None
            jerk[:, j] = better
        plan = Plan.follow(state, jerk, dt, plan.marks)
    met = np.abs(plan.states[list(plan.marks), 0] - waypoints).max() <= MET
    at_rest = np.abs(plan.states[-1, 1:]).max() <= REST_PLANNED
    return plan if met and at_rest and plan.keeps(limits) else None


def _limited(
    state: Array, ticks: tuple[int, ...], plan: Plan, limits: JointLimits, j: int, right: Array
) -> Array | None:
    """One joint's jerks (H,) within its limits, at the ticks and between them; None if there are none."""
    dt, bounds = plan.dt, limits.bounds()[:, [j]]
    (low,), (high,), (V,), (A,), (J,) = bounds
    motion = plan.states[1:-1, :, j].T * np.array([1.0, dt, dt**2])[:, None]
    marks, tick = np.array(plan.marks[:-1], int), np.arange(1, len(plan))
    # between ticks a speed exceeds those at them by J τ²/8 at most, a position by A τ²/8
    edge = 0.125 * A * dt**2
    at = plan.states[marks, 0, j]
    turns = marks[(at < low + edge) | (at > high - edge)]
    # at rest, and where the joint turns at the end of its range, position is as good as given
    apart = np.abs(tick[:, None] - np.array([0, *turns, len(plan)])).min(axis=1)
    edge = np.minimum(edge, 0.125 * J * dt**3 * apart)
    for share in (0.0, 0.05, 1.0):
        speed = np.full(len(tick), (V - share * 0.125 * J * dt**2) * dt)
        speed[turns - 1] = _TURNING * dt
        inset = share * edge
        found = limited(
            splines(ticks), plan.jerk[:, j] * dt**3, motion, J * dt**3, A * dt**2, speed, low + inset, high - inset
        )
        if not np.all(np.isfinite(found)):
            continue
        jerk = corrected(equalities(ticks), right[:, [j]], found[:, None]) / dt**3
        states = np.empty((len(jerk) + 1, 3, 1))
        states[0] = state[:, [j]]
        follow(jerk, dt, states)
        if keeps(jerk, dt, states, bounds, 0, TOLERANCE):
            return jerk[:, 0]
        if not keeps(jerk, dt, states, bounds, 0, _BETWEEN):
            return None  # so much is lost at the ticks already
    return None


def _shortest(state: Array, waypoints: Array, each: int, limits: JointLimits, dt: float) -> Plan | None:
    """The plan with the fewest ticks between waypoints above ``each``, which are too few; None if none is found."""
    attempt = functools.partial(_attempt, state, waypoints, limits=limits, dt=dt)
    short, long = each, 2 * each
    while (plan := attempt(long)) is None:
        short, long = long, 2 * long
        if long * len(waypoints) > _LONGEST:
            return None
    while long - short > 1:
        middle = (short + long) // 2
        found = attempt(middle)
        if found is None:
            short = middle
        else:
            long, plan = middle, found
    return plan
