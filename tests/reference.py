"""Independent reference ("oracle") for the tests: plain numpy, one equation at a time.

Nothing here is imported from the package, and wherever there is a choice the route differs from
the usual fast one: motion of a point comes from truncated power series in time instead of a
velocity/acceleration recursion, the sliding segment distance from common-normal formulas instead
of a Hessian correction, projections from enumeration and from non-negative least squares.

Equation numbers refer to Liu, Chen and Liu, "Safe Interactive Industrial Robots using Jerk-based
Safe Set Algorithm".  Units: metre, radian, second.  A "motion" of a point is an array of shape
(3, 3) with the rows position, velocity, acceleration.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def _array(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=np.float64)


# --------------------------------------------------------------------------------------------
# 1. Joint dynamics
# --------------------------------------------------------------------------------------------


def triple_integrator(
    position: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike, jerk: ArrayLike, tau: float
) -> tuple[Array, Array, Array]:
    """Eq. (1): x' = A x + B u with the explicit (3n, 3n) and (3n, n) block matrices.

    position, velocity, acceleration, jerk: (n,) [rad, rad/s, rad/s^2, rad/s^3]; tau [s].
    Returns the next position, velocity and acceleration, each (n,).
    """
    n = len(_array(position))
    one, zero = np.eye(n), np.zeros((n, n))
    state_matrix = np.block([[one, tau * one, tau**2 / 2 * one], [zero, one, tau * one], [zero, zero, one]])
    input_matrix = np.vstack([tau**3 / 6 * one, tau**2 / 2 * one, tau * one])
    state = np.concatenate([_array(position), _array(velocity), _array(acceleration)])
    following = state_matrix @ state + input_matrix @ _array(jerk)
    return following[:n], following[n : 2 * n], following[2 * n :]


# --------------------------------------------------------------------------------------------
# 2. Forward kinematics
# --------------------------------------------------------------------------------------------


class Joint(NamedTuple):
    """A hinge: fixed transform from the previous link frame, then a turn about `axis`."""

    rotation: Array  # (3, 3)
    offset: Array  # (3,) [m], in the previous link frame
    axis: Array  # (3,) unit vector in the joint's own frame


Chain = Sequence[Joint]


def _cross_matrix(axis: ArrayLike) -> Array:
    x, y, z = _array(axis)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _homogeneous(rotation: Array, offset: ArrayLike) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = offset
    return pose


def rodrigues(axis: ArrayLike, angle: float) -> Array:
    """Rotation matrix I + sin(angle) K + (1 - cos(angle)) K^2, K = [axis]x; angle [rad]."""
    cross = _cross_matrix(axis)
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def link_poses(chain: Chain, q: ArrayLike) -> list[Array]:
    """Poses of all link frames in the base frame: n + 1 matrices (4, 4); [0] is the base itself.

    q: (n,) [rad].  Entry i is the frame that joint i (counted from 1) moves.
    """
    poses = [np.eye(4)]
    for joint, angle in zip(chain, _array(q), strict=True):
        fixed = _homogeneous(joint.rotation, joint.offset)
        turn = _homogeneous(rodrigues(joint.axis, float(angle)), np.zeros(3))
        poses.append(poses[-1] @ fixed @ turn)
    return poses


def point(chain: Chain, q: ArrayLike, link: int, local: ArrayLike) -> Array:
    """Position (3,) [m] in the base frame of the point `local` (3,) [m] of link 0 (base) .. n."""
    return (link_poses(chain, q)[link] @ np.append(_array(local), 1.0))[:3]


# --------------------------------------------------------------------------------------------
# 3. Motion of a link point by power series in time
#
# A polynomial c_0 + c_1 t + ... is an array whose first axis is the power of t; products are cut
# at the length of the operands.  The k-th time derivative at t = 0 is k! c_k.
# --------------------------------------------------------------------------------------------


def _series_product(left: Array, right: Array, multiply: Callable[[Array, Array], Array] = np.multiply) -> Array:
    """Truncated product of two polynomials whose coefficients are combined by `multiply`."""
    length = len(left)
    return np.array([sum(multiply(left[i], right[power - i]) for i in range(power + 1)) for power in range(length)])


def _series_sin_cos(angle: Array) -> tuple[Array, Array]:
    """sin and cos of a cubic polynomial, (4,) each.

    With angle = a0 + x and x without constant term, x^4 = 0 after truncation, so that
    sin x = x - x^3/6 and cos x = 1 - x^2/2 are exact; then the addition theorem.
    """
    x = angle.copy()
    x[0] = 0.0
    x_squared = _series_product(x, x)
    x_cubed = _series_product(x_squared, x)
    sin_x = x - x_cubed / 6.0
    cos_x = -x_squared / 2.0
    cos_x[0] += 1.0
    sin_0, cos_0 = math.sin(angle[0]), math.cos(angle[0])
    return sin_0 * cos_x + cos_0 * sin_x, cos_0 * cos_x - sin_0 * sin_x


def point_motion(
    chain: Chain,
    q: ArrayLike,
    qd: ArrayLike,
    qdd: ArrayLike,
    u: ArrayLike,
    link: int,
    local: ArrayLike,
) -> tuple[Array, Array, Array, Array]:
    """Position, velocity, acceleration and jerk of a link point, each (3,) [m, m/s, ...].

    The joints move as q + qd t + qdd t^2/2 + u t^3/6; q, qd, qdd, u: (n,).  The product of the
    homogeneous matrices is carried out on matrix-valued polynomials cut after t^3.
    """
    angles = np.array(
        [_array(q), _array(qd), _array(qdd) / 2.0, _array(u) / 6.0]
    )  # (4, n): one column of coefficients per joint
    pose = np.zeros((4, 4, 4))
    pose[0] = np.eye(4)
    for joint, angle in zip(chain[:link], angles.T[:link], strict=True):
        sin_angle, cos_angle = _series_sin_cos(angle)
        one_minus_cos = -cos_angle
        one_minus_cos[0] += 1.0
        cross = _cross_matrix(joint.axis)
        turn = np.zeros((4, 4, 4))
        turn[0] = np.eye(4)
        for power in range(4):
            turn[power, :3, :3] += sin_angle[power] * cross + one_minus_cos[power] * cross @ cross
        fixed = _homogeneous(joint.rotation, joint.offset)
        moved = np.array([fixed @ coefficient for coefficient in turn])
        pose = _series_product(pose, moved, np.matmul)
    coefficients = pose @ np.append(_array(local), 1.0)
    return (
        coefficients[0, :3],
        coefficients[1, :3],
        2.0 * coefficients[2, :3],
        6.0 * coefficients[3, :3],
    )


def jacobian(chain: Chain, q: ArrayLike, link: int, local: ArrayLike) -> Array:
    """J (3, n) [m/rad]: column i is the velocity at unit velocity of joint i alone."""
    n = len(chain)
    zero = np.zeros(n)
    return np.column_stack([point_motion(chain, q, unit, zero, zero, link, local)[1] for unit in np.eye(n)])


def point_velocity(chain: Chain, q: ArrayLike, qd: ArrayLike, link: int, local: ArrayLike) -> Array:
    """J qd (3,) [m/s]."""
    zero = np.zeros(len(chain))
    return point_motion(chain, q, qd, zero, zero, link, local)[1]


def point_acceleration(chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, link: int, local: ArrayLike) -> Array:
    """J qdd + J' qd (3,) [m/s^2]."""
    return point_motion(chain, q, qd, qdd, np.zeros(len(chain)), link, local)[2]


def point_drift(chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, link: int, local: ArrayLike) -> Array:
    """J'' qd + 2 J' qdd (3,) [m/s^3], Eq. (10)-(11): the jerk of the point at zero joint jerk."""
    return point_motion(chain, q, qd, qdd, np.zeros(len(chain)), link, local)[3]


# --------------------------------------------------------------------------------------------
# 4. and 5. Distances
# --------------------------------------------------------------------------------------------

# Below this sine of the angle between two segments they count as parallel: an end point is then
# as close as any interior pair to within length * 1e-12.
PARALLEL_SINE = 1e-12


def _project_on_segment(target: Array, start: Array, end: Array) -> float:
    """Parameter in [0, 1] of the point of the segment that is closest to `target`."""
    direction = end - start
    squared_length = float(direction @ direction)
    if squared_length == 0.0:
        return 0.0
    return min(1.0, max(0.0, float((target - start) @ direction) / squared_length))


def segment_distance(a0: ArrayLike, a1: ArrayLike, b0: ArrayLike, b1: ArrayLike) -> tuple[float, float, float]:
    """Distance [m] of two segments and the parameters (s, r) in [0, 1] of a closest pair.

    End points: (3,) [m].  The closest points are a0 + s (a1 - a0) and b0 + r (b1 - b0).  The
    squared distance is convex in (s, r), so its minimum over the unit square is either stationary
    inside or lies on one of the four edges, and an edge is an end point against a segment: all
    five candidates are listed and the smallest is taken (of equal ones the first).  Zero-length
    and parallel segments have no inner candidate and need none.
    """
    a0, a1, b0, b1 = _array(a0), _array(a1), _array(b0), _array(b1)
    candidates = [
        (0.0, _project_on_segment(a0, b0, b1)),
        (1.0, _project_on_segment(a1, b0, b1)),
        (_project_on_segment(b0, a0, a1), 0.0),
        (_project_on_segment(b1, a0, a1), 1.0),
    ]
    along_a, along_b = a1 - a0, b1 - b0
    normal = np.cross(along_a, along_b)
    sine = np.linalg.norm(normal)
    if sine > PARALLEL_SINE * np.linalg.norm(along_a) * np.linalg.norm(along_b):
        # Foot points of the common normal of two skew lines.
        s = float(np.cross(b0 - a0, along_b) @ normal / (normal @ normal))
        r = float(np.cross(b0 - a0, along_a) @ normal / (normal @ normal))
        if 0.0 <= s <= 1.0 and 0.0 <= r <= 1.0:
            candidates.append((s, r))
    distances = [float(np.linalg.norm(a0 + s * along_a - b0 - r * along_b)) for s, r in candidates]
    best = int(np.argmin(distances))
    return distances[best], candidates[best][0], candidates[best][1]


def capsule_distance(
    a0: ArrayLike,
    a1: ArrayLike,
    a_radius: float,
    b0: ArrayLike,
    b1: ArrayLike,
    b_radius: float,
) -> float:
    """Signed surface distance [m]: axis distance minus both radii; negative when overlapping."""
    return segment_distance(a0, a1, b0, b1)[0] - (a_radius + b_radius)


def plane_distance(start: ArrayLike, end: ArrayLike, radius: float, normal: ArrayLike, offset: float) -> float:
    """Signed distance [m] of a capsule from the half-space {x: normal.x <= offset}.

    normal: (3,) unit vector.  min over both ends of normal.p - offset, minus the radius.
    """
    heights = [float(_array(normal) @ _array(end_point)) - offset for end_point in (start, end)]
    return min(heights) - radius


# --------------------------------------------------------------------------------------------
# 6. and 7. Safety index and its ingredients
# --------------------------------------------------------------------------------------------


def phi(
    d_axis: float,
    d_dot: float,
    d_ddot: float,
    radius_sum: float,
    d_min: float,
    lambda1: float,
    lambda2: float,
) -> float:
    """Eq. (6) with the signed square: d_min^2 - D|D| - lambda1 d' - lambda2 d'' [m^2], D = d - R.

    The printed D^2 would let a deep penetration (D < -d_min) read as safe.
    """
    surface = d_axis - radius_sum
    return d_min**2 - surface * abs(surface) - lambda1 * d_dot - lambda2 * d_ddot


def material_distance_derivatives(p: ArrayLike, v: ArrayLike, a: ArrayLike) -> tuple[float, float, float]:
    """d = |p|, d', d'' [m, m/s, m/s^2] of two material points with relative motion p, v, a (3,).

    From (d^2)' = 2 p.v and (d^2)'' = 2 (v.v + p.a).
    """
    p, v, a = _array(p), _array(v), _array(a)
    d = math.sqrt(p @ p)
    if d == 0.0:
        raise ValueError("the distance has no derivative at d = 0")
    d_dot = float(p @ v) / d
    d_ddot = (float(v @ v) + float(p @ a) - d_dot**2) / d
    return d, d_dot, d_ddot


def _series_quotient(numerator: Array, denominator: Array) -> Array:
    quotient = np.zeros(len(numerator))
    for power in range(len(numerator)):
        known = sum(quotient[i] * denominator[power - i] for i in range(power))
        quotient[power] = (numerator[power] - known) / denominator[0]
    return quotient


def _series_root(radicand: Array) -> Array:
    root = np.zeros(len(radicand))
    root[0] = math.sqrt(radicand[0])
    for power in range(1, len(radicand)):
        known = sum(root[i] * root[power - i] for i in range(1, power))
        root[power] = (radicand[power] - known) / (2.0 * root[0])
    return root


def sliding_derivatives(
    a0: ArrayLike, a1: ArrayLike, b0: ArrayLike, b1: ArrayLike, end_tolerance: float = 1e-9
) -> tuple[float, float, float]:
    """Exact d, d', d'' [m, m/s, m/s^2] of the distance of two moving segments.

    Each argument is the motion (3, 3) of an end point: rows position, velocity, acceleration.
    The closest pair slides along the segments.  `segment_distance` tells which of its parameters
    sit at an end; with that held, the distance is elementary and is expanded in powers of t:
      both free   distance of two lines      |w.(E x F)| / |E x F|
      one free    distance of point and line |w x E| / |E|
      none free   distance of two points     |w|
    (w: difference of any two points of the axes, E, F: directions).  No differencing: accurate to
    rounding, times about 1/sin^2 of the angle between nearly parallel segments.  Not defined
    where the distance itself is not twice differentiable: at d = 0, where a free parameter
    reaches an end (within `end_tolerance` it counts as an end), for parallel segments with a
    continuum of closest pairs that turn out of parallel.
    """
    motions = [_array(motion) for motion in (a0, a1, b0, b1)]
    distance, s, r = segment_distance(*(motion[0] for motion in motions))
    if distance == 0.0:
        raise ValueError("the distance has no derivative at d = 0")
    # Coefficients of 1, t, t^2.
    a_start, a_end, b_start, b_end = (motion / np.array([[1.0], [1.0], [2.0]]) for motion in motions)
    along_a, along_b = a_end - a_start, b_end - b_start
    s_free = end_tolerance < s < 1.0 - end_tolerance
    r_free = end_tolerance < r < 1.0 - end_tolerance
    a_point = a_end if s > 0.5 and not s_free else a_start
    b_point = b_end if r > 0.5 and not r_free else b_start
    gap = a_point - b_point
    if s_free and r_free:
        normal = _series_product(along_a, along_b, np.cross)
        height = _series_product(gap, normal, np.dot)
        series = _series_quotient(
            math.copysign(1.0, height[0]) * height,
            _series_root(_series_product(normal, normal, np.dot)),
        )
    elif s_free or r_free:
        along = along_a if s_free else along_b
        moment = _series_product(gap, along, np.cross)
        series = _series_quotient(
            _series_root(_series_product(moment, moment, np.dot)),
            _series_root(_series_product(along, along, np.dot)),
        )
    else:
        series = _series_root(_series_product(gap, gap, np.dot))
    return float(series[0]), float(series[1]), 2.0 * float(series[2])


def _extrapolate(estimates: Sequence[float]) -> tuple[float, float]:
    """Richardson (Neville) table for estimates with step h, h/2, h/4, ... and even error terms.

    Returns the entry that agrees best with its neighbours and that disagreement.
    """
    best, best_error = estimates[-1], math.inf
    previous: list[float] = []
    for estimate in estimates:
        row = [estimate]
        for column, older in enumerate(previous):
            factor = 4.0 ** (column + 1)
            refined = (factor * row[column] - older) / (factor - 1.0)
            error = max(abs(refined - row[column]), abs(refined - older))
            if error < best_error:
                best, best_error = refined, error
            row.append(refined)
        previous = row
    return best, best_error


def sliding_derivatives_by_differences(
    a0: ArrayLike,
    a1: ArrayLike,
    b0: ArrayLike,
    b1: ArrayLike,
    step: float = 0.02,
    levels: int = 6,
) -> tuple[float, float, float, float]:
    """The same as `sliding_derivatives` from nothing but values of `segment_distance`.

    The end points follow p + v t + a t^2/2; central differences at step, step/2, ... [s] are
    Richardson-extrapolated.  Returns d, d', d'' and the estimated error of d'' [m/s^2]: about
    1e-9 where the distance is smooth over a few steps, large where it is not.
    """
    motions = [_array(motion) for motion in (a0, a1, b0, b1)]

    def distance(t: float) -> float:
        powers = np.array([1.0, t, t * t / 2.0])
        return segment_distance(*(powers @ motion for motion in motions))[0]

    middle = distance(0.0)
    first, second = [], []
    for level in range(levels):
        h = step / 2**level
        before, after = distance(-h), distance(h)
        first.append((after - before) / (2.0 * h))
        second.append((after - 2.0 * middle + before) / h**2)
    d_ddot, error = _extrapolate(second)
    return middle, _extrapolate(first)[0], d_ddot, error


# --------------------------------------------------------------------------------------------
# 8. The index after one step, and its gradient
# --------------------------------------------------------------------------------------------


class Params(NamedTuple):
    """Parameters of the safety index: d_min [m], lambda1 [m s], lambda2 [m s^2]."""

    d_min: float
    lambda1: float
    lambda2: float


def phi_after(
    chain: Chain,
    q: ArrayLike,
    qd: ArrayLike,
    qdd: ArrayLike,
    u: ArrayLike,
    tau: float,
    link: int,
    local_start: ArrayLike,
    local_end: ArrayLike,
    human_start: ArrayLike,
    human_end: ArrayLike,
    human_start_velocity: ArrayLike,
    human_end_velocity: ArrayLike,
    radius_sum: float,
    params: Params,
    sliding: bool,
    pair: tuple[float, float] | None = None,
) -> float:
    """phi(x_{k+1}) [m^2] for a capsule of a link and one of a human, Eq. (1), (4), (6).

    The joints are propagated by Eq. (1) with the jerk u (n,) held for tau, the human's axis ends
    (3,) at constant velocity (3,).  There the index is evaluated from the true motion of the link
    points: with sliding False from the material points that are closest at that instant (or, if
    `pair` = (s, r) is given, from those axis parameters), with sliding True from the exact
    derivatives of the axis distance.
    """
    zero = np.zeros(len(chain))
    q_next, qd_next, qdd_next = triple_integrator(q, qd, qdd, u, tau)
    robot_start, robot_end = (
        np.array(point_motion(chain, q_next, qd_next, qdd_next, zero, link, local)[:3])
        for local in (local_start, local_end)
    )
    person_start, person_end = (
        np.array([_array(where) + tau * _array(rate), _array(rate), np.zeros(3)])
        for where, rate in (
            (human_start, human_start_velocity),
            (human_end, human_end_velocity),
        )
    )
    if sliding:
        if pair is not None:
            raise ValueError("a fixed pair does not slide")
        derivatives = sliding_derivatives(robot_start, robot_end, person_start, person_end)
    else:
        if pair is None:
            _, s, r = segment_distance(robot_start[0], robot_end[0], person_start[0], person_end[0])
        else:
            s, r = pair
        on_robot = robot_start + s * (robot_end - robot_start)
        on_person = person_start + r * (person_end - person_start)
        derivatives = material_distance_derivatives(*(on_robot - on_person))
    return phi(*derivatives, radius_sum, *params)


def row_by_differences(
    chain: Chain,
    q: ArrayLike,
    qd: ArrayLike,
    qdd: ArrayLike,
    u: ArrayLike,
    tau: float,
    link: int,
    local_start: ArrayLike,
    local_end: ArrayLike,
    human_start: ArrayLike,
    human_end: ArrayLike,
    human_start_velocity: ArrayLike,
    human_end_velocity: ArrayLike,
    radius_sum: float,
    params: Params,
    sliding: bool,
    pair: tuple[float, float] | None = None,
    step: float = 4.0,
) -> Array:
    """L = -d phi_after / du (n,) [m^2 / (rad/s^3)] at u.

    Central differences with `step` and step/2 [rad/s^3], one Richardson extrapolation.  phi is
    nearly linear in u (the quadratic part is of order tau^4), so large steps are harmless and
    only rounding is left: 1e-10 of the largest entry of L, a few digits less for nearly parallel
    segments with sliding True.  Meaningless where the closest pair changes its kind within
    `step`.  At u this is the gradient of the true phi, with J, J' and J'' moving with the state.
    """
    u = _array(u)

    def index(jerk: Array) -> float:
        return phi_after(
            chain,
            q,
            qd,
            qdd,
            jerk,
            tau,
            link,
            local_start,
            local_end,
            human_start,
            human_end,
            human_start_velocity,
            human_end_velocity,
            radius_sum,
            params,
            sliding,
            pair,
        )

    row = []
    for unit in np.eye(len(u)):
        coarse, fine = ((index(u + h * unit) - index(u - h * unit)) / (2.0 * h) for h in (step, step / 2.0))
        row.append(-(4.0 * fine - coarse) / 3.0)
    return np.array(row)


# --------------------------------------------------------------------------------------------
# 9. The constraint as printed, and its true differential
# --------------------------------------------------------------------------------------------


def _block_selector(row: int, column: int) -> Array:
    """(9, 9) matrix with I_3 in block (row, column), blocks counted from 0."""
    selector = np.zeros((3, 3))
    selector[row, column] = 1.0
    return _array(np.kron(selector, np.eye(3)))


U1 = _block_selector(0, 0)
U2 = _block_selector(0, 1)
U3 = _block_selector(1, 1)
U4 = _block_selector(0, 2)


def cartesian_input_matrix(tau: float) -> Array:
    """B^C(tau) of Eq. (3), (9, 3)."""
    return np.vstack([tau**3 / 6 * np.eye(3), tau**2 / 2 * np.eye(3), tau * np.eye(3)])


def phi_times_distance(delta: ArrayLike, d_min: float, lambda1: float, lambda2: float) -> float:
    """phi d of Eq. (13) [m^3] for a relative state delta (9,): the expression before `approx`."""
    delta = _array(delta)
    q1, q2, q3, q4 = (float(delta @ matrix @ delta) for matrix in (U1, U2, U3, U4))
    return d_min**2 * math.sqrt(q1) - q1**1.5 - lambda1 * q2 - lambda2 * (-((q2 / math.sqrt(q1)) ** 2) + q3 + q4)


def printed_row(
    delta_p: ArrayLike,
    delta_v: ArrayLike,
    delta_a: ArrayLike,
    jacobian: ArrayLike,
    tau: float,
    d_min: float,
    lambda1: float,
    lambda2: float,
) -> tuple[Array, float]:
    """L (n,) and S of the constraint L u >= S exactly as Eq. (13) prints them.

    delta_p, delta_v, delta_a: (3,), the relative state Delta of Eq. (11) at the next step without
    u; jacobian: (3, n).  L = 2 (lambda1 Delta'U2 + lambda2 Delta'U3 + lambda2 Delta'U4) B^C J;
    S = phi d at Delta (plain square, no radii).
    """
    delta = np.concatenate([_array(delta_p), _array(delta_v), _array(delta_a)])
    row = 2.0 * (lambda1 * delta @ U2 + lambda2 * delta @ U3 + lambda2 * delta @ U4)
    through = cartesian_input_matrix(tau) @ _array(jacobian)
    return row @ through, phi_times_distance(delta, d_min, lambda1, lambda2)


def exact_row(
    delta_p: ArrayLike,
    delta_v: ArrayLike,
    delta_a: ArrayLike,
    jacobian: ArrayLike,
    tau: float,
    d_min: float,
    lambda1: float,
    lambda2: float,
) -> tuple[Array, float]:
    """As `printed_row`, but L = -d(phi d)/du, the full differential of the same expression.

    The differential of delta'U delta is delta'(U + U'); no term is left out.
    """
    delta = np.concatenate([_array(delta_p), _array(delta_v), _array(delta_a)])
    q1, q2 = float(delta @ U1 @ delta), float(delta @ U2 @ delta)
    g1, g2, g3, g4 = (delta @ (matrix + matrix.T) for matrix in (U1, U2, U3, U4))
    gradient = (
        d_min**2 * g1 / (2.0 * math.sqrt(q1))
        - 1.5 * math.sqrt(q1) * g1
        - lambda1 * g2
        - lambda2 * (-2.0 * q2 / q1 * g2 + (q2 / q1) ** 2 * g1 + g3 + g4)
    )
    through = cartesian_input_matrix(tau) @ _array(jacobian)
    return -gradient @ through, phi_times_distance(delta, d_min, lambda1, lambda2)


# --------------------------------------------------------------------------------------------
# 10. Projection
# --------------------------------------------------------------------------------------------


def _unit_rows(L: ArrayLike, S: ArrayLike, n: int) -> tuple[Array, Array] | None:
    """Rows scaled to unit length; zero rows are dropped, or None if one of them cannot hold."""
    rows, sides = _array(L).reshape(-1, n), _array(S).reshape(-1)
    lengths = np.linalg.norm(rows, axis=1)
    if np.any(sides[lengths == 0.0] > 0.0):
        return None
    kept = lengths > 0.0
    return rows[kept] / lengths[kept, None], sides[kept] / lengths[kept]


def project_brute(
    nominal: ArrayLike,
    L: ArrayLike,
    S: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    V: ArrayLike,
) -> Array | None:
    """Eq. (14) by enumeration: minimise (u-nominal)'V(u-nominal), L u >= S, lower <= u <= upper.

    nominal, lower, upper: (n,); L: (m, n); S: (m,); V: (n, n) positive definite.  Every choice of
    {free, at lower, at upper} per variable and of a subset of rows held with equality gives one
    linear (KKT) system.  The optimum solves the system of its own active set, and every feasible
    solution is an upper bound, so the feasible solution of least cost is the projection: the
    signs of the multipliers are not needed.  3^n 2^m systems: n <= 4 and few rows.  Constraint
    tolerance 1e-11 of the largest bound (rows at unit length).  None if infeasible.
    """
    nominal, lower, upper, V = _array(nominal), _array(lower), _array(upper), _array(V)
    n = len(nominal)
    scaled = _unit_rows(L, S, n)
    if scaled is None:
        return None
    rows, sides = scaled
    tolerance = 1e-11 * max(1.0, float(np.max(np.abs([lower, upper]))))
    best, best_cost = None, math.inf
    for pattern in itertools.product(("free", "lower", "upper"), repeat=n):
        free = np.array([choice == "free" for choice in pattern])
        held = np.where([choice == "upper" for choice in pattern], upper, lower)
        start = np.where(free, nominal, held)
        count = int(free.sum())
        for size in range(min(count, len(sides)) + 1):
            for subset in map(list, itertools.combinations(range(len(sides)), size)):
                u = start.copy()
                if count:
                    active = rows[subset][:, free]
                    system = np.block([[V[np.ix_(free, free)], -active.T], [active, np.zeros((size, size))]])
                    right = np.concatenate(
                        [
                            -V[np.ix_(free, ~free)] @ (start - nominal)[~free],
                            sides[subset] - rows[subset] @ start,
                        ]
                    )
                    # Least squares: dependent rows give a singular but harmless system.
                    u[free] += np.linalg.lstsq(system, right, rcond=None)[0][:count]
                feasible = (
                    np.all(u >= lower - tolerance)
                    and np.all(u <= upper + tolerance)
                    and np.all(rows @ u >= sides - tolerance)
                )
                cost = float((u - nominal) @ V @ (u - nominal))
                if feasible and cost < best_cost:
                    best, best_cost = u, cost
    return best


def project_reference(
    nominal: ArrayLike,
    L: ArrayLike,
    S: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    V: ArrayLike,
) -> Array | None:
    """The same projection for any size, as a least-distance problem (Lawson and Hanson, ch. 23).

    With V = C'C, z = C (u - nominal) / scale the problem reads: minimise |z| subject to G z >= h.
    Non-negative least squares min |E y - f|, E = [G'; h'], f = (0, .., 0, 1), leaves a residual
    (r, rho) that vanishes if and only if the constraints conflict; otherwise z = -r / rho and
    |residual|^2 = 1 / (1 + |z|^2).  `scale` is the largest possible distance within the box, so
    |z| <= 1 and the two cases, |residual|^2 >= 1/2 and = 0, are far apart.  None if infeasible;
    RuntimeError if the result misses a constraint (rows at unit length) by more than 1e-9 of the
    largest bound.
    """
    nominal, lower, upper, V = _array(nominal), _array(lower), _array(upper), _array(V)
    n = len(nominal)
    scaled = _unit_rows(L, S, n)
    if scaled is None or np.any(lower > upper):
        return None
    rows, sides = scaled
    root = np.linalg.cholesky(V).T
    farthest = np.maximum(np.abs(lower - nominal), np.abs(upper - nominal))
    scale = max(float(np.linalg.norm(np.abs(root) @ farthest)), 1e-300)
    constraints = np.vstack([rows, np.eye(n), -np.eye(n)])
    bounds = np.concatenate([sides, lower, -upper])
    G = constraints @ np.linalg.inv(root)
    h = (bounds - constraints @ nominal) / scale
    target = np.append(np.zeros(n), 1.0)
    E = np.vstack([G.T, h])
    # Columns of unit length: the same cone, better conditioned.
    E = E / np.linalg.norm(E, axis=0)
    multipliers, _ = scipy.optimize.nnls(E, target, maxiter=1000)
    residual = E @ multipliers - target
    if residual @ residual < 0.25:
        return None
    u = nominal + scale * np.linalg.solve(root, -residual[:n] / residual[n])
    miss = float(np.max(bounds - constraints @ u))
    if miss > 1e-9 * max(1.0, float(np.max(np.abs([lower, upper])))):
        raise RuntimeError(f"the reference projection misses a constraint by {miss:g}")
    return np.clip(u, lower, upper)


def least_violation(L: ArrayLike, S: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> tuple[float, Array]:
    """Smallest t for which L u + t >= S (every row) has a solution in the box, and such a u.

    L: (m, n), S: (m,), m >= 1; lower, upper: (n,).  t is signed: t <= 0 means that all rows can
    be met, with -t to spare.  Linear program in (u, t); t is evaluated at the returned u, so it
    is attained exactly, and minimal to about 1e-9.
    """
    lower, upper, sides = _array(lower), _array(upper), _array(S).reshape(-1)
    rows = _array(L).reshape(len(sides), len(lower))
    # u = lower + (upper - lower) x with x in the unit box: all unknowns of like size.
    width = upper - lower
    result = scipy.optimize.linprog(
        np.append(np.zeros(len(lower)), 1.0),
        A_ub=np.column_stack([-rows * width, -np.ones(len(sides))]),
        b_ub=rows @ lower - sides,
        bounds=[(0.0, 1.0)] * len(lower) + [(None, None)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    if not result.success:
        raise RuntimeError(result.message)
    u = np.clip(lower + width * result.x[:-1], lower, upper)
    return float(np.max(sides - rows @ u)), u


# --------------------------------------------------------------------------------------------
# 11. Data: FANUC LR Mate 200iD/7L and the human of the paper's simulation
# --------------------------------------------------------------------------------------------

FLANGE_LINK = 6
FLANGE_LOCAL = (0.080, 0.0, 0.0)

# name, link (1 = the frame moved by J1), axis start and end in that link frame [m], radius [m]
LR_MATE_CAPSULES = [
    ("base_column", 1, (0.05, 0.0, -0.02), (0.0, 0.0, -0.27), 0.162),
    ("upper_arm", 2, (0.0, 0.0, 0.0), (0.0, 0.0, 0.44), 0.125),
    ("elbow", 3, (0.03, 0.0, 0.04), (-0.01, 0.0, 0.01), 0.094),
    ("forearm", 4, (0.10, 0.0, 0.0), (0.42, 0.0, 0.0), 0.072),
    ("wrist_tool", 5, (0.0, 0.0, 0.0), (0.16, 0.0, 0.0), 0.060),
]

# name, axis start and end [m] for a root at (0, 0) on the floor, radius [m]; facing -x
HUMAN_CAPSULES = [
    ("head", (0.0, 0.0, 1.5), (0.0, 0.0, 1.5), 0.20),
    ("core_body", (0.0, 0.0, 0.9), (0.0, 0.0, 1.25), 0.25),
    ("right_arm", (0.0, 0.2, 1.3), (0.0, 0.5, 0.8), 0.10),
    ("left_arm", (0.0, -0.2, 1.3), (0.0, -0.5, 0.8), 0.10),
    ("right_leg", (0.0, 0.15, 0.8), (0.0, 0.4, 0.1), 0.10),
    ("left_leg", (0.0, -0.15, 0.8), (0.0, -0.4, 0.1), 0.10),
]


def lr_mate_chain() -> list[Joint]:
    """The six joints of the LR Mate 200iD/7L, base frame at the origin."""
    table = [
        ((0.0, 0.0, 0.330), (0.0, 0.0, 1.0)),
        ((0.050, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((0.0, 0.0, 0.440), (0.0, -1.0, 0.0)),
        ((0.0, 0.0, 0.035), (-1.0, 0.0, 0.0)),
        ((0.420, 0.0, 0.0), (0.0, -1.0, 0.0)),
        ((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    ]
    return [Joint(np.eye(3), _array(offset), _array(axis)) for offset, axis in table]
