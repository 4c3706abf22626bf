"""Self-checks of the test oracle in `reference.py`: two routes to every number."""

import math

import numpy as np
import pytest
import reference as ref
from numpy.polynomial import chebyshev

TAU = 0.008
JERK = np.radians([3798.0, 3408.0, 3505.0, 7011.0, 7011.0, 10712.0])
HOME = np.radians([0.0, 0.0, 0.0, 0.0, -90.0, 0.0])
PARAMS = ref.Params(d_min=0.05, lambda1=3.0, lambda2=1.0)


def random_rotation(rng):
    axis = rng.normal(size=3)
    return ref.rodrigues(axis / np.linalg.norm(axis), rng.uniform(-math.pi, math.pi))


def random_chain(rng, n=5):
    chain = []
    for _ in range(n):
        axis = rng.normal(size=3)
        chain.append(ref.Joint(random_rotation(rng), 0.3 * rng.normal(size=3), axis / np.linalg.norm(axis)))
    return chain


def random_motion(rng):
    return np.array(
        [0.5 * rng.normal(size=3), rng.normal(size=3), 3.0 * rng.normal(size=3)],
    )


def scene(rng):
    """A random arm state and human capsule, as the leading arguments of phi_after."""
    capsule = ref.LR_MATE_CAPSULES[rng.integers(1, 5)]
    human = ref.HUMAN_CAPSULES[rng.integers(0, 6)]
    root = np.array([rng.uniform(0.9, 1.2), rng.uniform(-0.5, 0.5), -0.87])
    velocity = rng.normal(size=3)
    return (
        ref.lr_mate_chain(),
        rng.uniform(-1.0, 1.0, 6),
        0.5 * rng.normal(size=6),
        3.0 * rng.normal(size=6),
        rng.uniform(-1.0, 1.0, 6) * JERK,
        TAU,
        capsule[1],
        capsule[2],
        capsule[3],
        root + human[1],
        root + human[2],
        velocity,
        velocity,
        capsule[4] + human[3],
        PARAMS,
    )


def test_triple_integrator_composes():
    rng = np.random.default_rng(1)
    x, v, a, u = rng.normal(size=(4, 3))
    half = ref.triple_integrator(*ref.triple_integrator(x, v, a, u, 0.1), u, 0.1)
    whole = ref.triple_integrator(x, v, a, u, 0.2)
    np.testing.assert_allclose(half, whole, rtol=0, atol=1e-14)
    np.testing.assert_allclose(whole[0], x + 0.2 * v + 0.02 * a + 0.008 / 6 * u, atol=1e-15)


@pytest.mark.parametrize(("q", "flange"), [(HOME, (0.470, 0.0, 0.725)), (np.zeros(6), (0.550, 0.0, 0.805))])
def test_lr_mate_flange(q, flange):
    reached = ref.point(ref.lr_mate_chain(), q, ref.FLANGE_LINK, ref.FLANGE_LOCAL)
    np.testing.assert_allclose(reached, flange, rtol=0, atol=1e-15)


def test_lr_mate_joint_signs():
    chain = ref.lr_mate_chain()

    def moved(joint):
        q = np.zeros(6)
        q[joint - 1] = 0.1
        local = (0.080, 0.0, 0.1) if joint in (4, 6) else ref.FLANGE_LOCAL
        return ref.point(chain, q, 6, local) - ref.point(chain, np.zeros(6), 6, local)

    assert moved(1)[1] > 0.0  # +z axis: x towards y
    assert moved(2)[2] < 0.0  # +y axis: the arm tips forward and down
    assert moved(3)[2] > 0.0  # -y axis: the forearm rises
    assert moved(4)[1] > 0.0  # -x axis: z towards y
    assert moved(5)[2] > 0.0
    assert moved(6)[1] > 0.0


def test_link_poses_are_rigid():
    rng = np.random.default_rng(2)
    chain = random_chain(rng)
    poses = ref.link_poses(chain, rng.normal(size=5))
    assert len(poses) == 6
    for pose in poses:
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-14)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


def test_point_motion_against_interpolation_of_positions():
    rng = np.random.default_rng(3)
    reach, count = 0.05, 14
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    for _ in range(10):
        chain = random_chain(rng)
        q, qd, qdd, u = rng.normal(size=(4, 5)) * np.array([[1.0], [1.0], [3.0], [10.0]])
        local = 0.1 * rng.normal(size=3)
        motion = ref.point_motion(chain, q, qd, qdd, u, 5, local)
        track = [ref.point(chain, q + qd * t + qdd * t**2 / 2 + u * t**3 / 6, 5, local) for t in reach * nodes]
        series = chebyshev.chebfit(nodes, np.array(track), count - 1)
        for order, tolerance in enumerate((1e-14, 1e-11, 1e-9, 1e-7)):
            derivative = chebyshev.chebval(0.0, chebyshev.chebder(series, order)) / reach**order
            scale = 1.0 + np.max(np.abs(motion[order]))
            np.testing.assert_allclose(derivative, motion[order], rtol=0, atol=tolerance * scale)


def test_jacobian_and_drift_are_consistent():
    rng = np.random.default_rng(4)
    chain = random_chain(rng)
    q, qd, qdd, u = rng.normal(size=(4, 5))
    local = 0.1 * rng.normal(size=3)
    for link in range(6):
        J = ref.jacobian(chain, q, link, local)
        assert J.shape == (3, 5)
        assert not np.any(J[:, link:])
        differences = np.column_stack(
            [
                (ref.point(chain, q + 1e-6 * e, link, local) - ref.point(chain, q - 1e-6 * e, link, local)) / 2e-6
                for e in np.eye(5)
            ]
        )
        np.testing.assert_allclose(J, differences, atol=1e-9)
        np.testing.assert_allclose(ref.point_velocity(chain, q, qd, link, local), J @ qd)
        jerk = ref.point_motion(chain, q, qd, qdd, u, link, local)[3]
        drift = ref.point_drift(chain, q, qd, qdd, link, local)
        np.testing.assert_allclose(jerk - drift, J @ u, atol=1e-12)
        centripetal = ref.point_acceleration(chain, q, qd, np.zeros(5), link, local)
        acceleration = ref.point_acceleration(chain, q, qd, qdd, link, local)
        np.testing.assert_allclose(acceleration - centripetal, J @ qdd, atol=1e-12)


def test_spinning_point_has_textbook_motion():
    chain = [ref.Joint(np.eye(3), np.zeros(3), np.array([0.0, 0.0, 1.0]))]
    p, v, a, j = ref.point_motion(chain, [0.0], [2.0], [0.0], [0.0], 1, (0.5, 0.0, 0.1))
    np.testing.assert_allclose(p, (0.5, 0.0, 0.1), atol=1e-15)
    np.testing.assert_allclose(v, (0.0, 1.0, 0.0), atol=1e-15)
    np.testing.assert_allclose(a, (-2.0, 0.0, 0.0), atol=1e-15)
    np.testing.assert_allclose(j, (0.0, -4.0, 0.0), atol=1e-15)


def segment_pairs(rng):
    for _ in range(60):
        yield rng.normal(size=(4, 3))
    for scale in (0.0, 1e-14, 1e-9, 1e-5):  # parallel and nearly so
        for _ in range(5):
            a0, along, b0 = rng.normal(size=(3, 3))
            yield np.array(
                [a0, a0 + along, b0, b0 + 0.7 * along + scale * rng.normal(size=3)],
            )
    a0, a1, b0 = rng.normal(size=(3, 3))
    yield np.array([a0, a0, b0, a1])
    yield np.array([a0, a1, b0, b0])
    yield np.array([a0, a0, b0, b0])
    yield np.array([a0, a1, a0, a1])
    yield np.array([a0, a1, (a0 + a1) / 2, b0])
    yield np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]])


def test_segment_distance_against_grid():
    rng = np.random.default_rng(5)
    count = 201
    grid = np.linspace(0.0, 1.0, count)
    for a0, a1, b0, b1 in segment_pairs(rng):
        d, s, r = ref.segment_distance(a0, a1, b0, b1)
        assert 0.0 <= s <= 1.0
        assert 0.0 <= r <= 1.0
        attained = np.linalg.norm(a0 + s * (a1 - a0) - b0 - r * (b1 - b0))
        assert d == pytest.approx(attained, abs=1e-15)
        on_a = a0 + grid[:, None] * (a1 - a0)
        on_b = b0 + grid[:, None] * (b1 - b0)
        nearest = np.min(np.linalg.norm(on_a[:, None] - on_b[None, :], axis=2))
        coarse = 0.5 / (count - 1) * (np.linalg.norm(a1 - a0) + np.linalg.norm(b1 - b0))
        assert d <= nearest + 1e-14
        assert d >= nearest - coarse
        # First-order optimality: no move of either point within the square gets closer.
        gap = a0 + s * (a1 - a0) - b0 - r * (b1 - b0)
        for move in (-s * (a1 - a0), (1 - s) * (a1 - a0), r * (b1 - b0), -(1 - r) * (b1 - b0)):
            assert gap @ move >= -1e-12 * (1.0 + np.linalg.norm(move))


def test_capsule_and_plane_distance():
    square = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.1, (0.5, 1.0, 0.0), (0.5, 2.0, 0.0), 0.2)
    assert ref.capsule_distance(*square) == pytest.approx(0.7)
    crossing = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.1, (0.5, -1.0, 0.05), (0.5, 2.0, 0.05), 0.2)
    assert ref.capsule_distance(*crossing) == pytest.approx(-0.25)
    table = ref.plane_distance((0.0, 0.0, 0.5), (0.0, 0.3, 0.3), 0.1, (0.0, 0.0, 1.0), 0.25)
    assert table == pytest.approx(-0.05)


def test_phi_uses_the_signed_square():
    assert ref.phi(1.0, -0.2, 0.3, 0.4, 0.05, 3.0, 1.0) == pytest.approx(0.0025 - 0.36 + 0.6 - 0.3)
    assert ref.phi(0.1, 0.0, 0.0, 0.4, 0.05, 3.0, 1.0) == pytest.approx(0.0025 + 0.09)


def test_material_derivatives_against_differences():
    rng = np.random.default_rng(6)
    for _ in range(20):
        p, v, a = random_motion(rng)
        # Two equal motions make two degenerate segments, whose distance does not slide.
        still = np.zeros((3, 3))
        moving = np.array([p, v, a])
        expected = ref.sliding_derivatives_by_differences(moving, moving, still, still)
        np.testing.assert_allclose(ref.material_distance_derivatives(p, v, a), expected[:3], rtol=1e-8, atol=1e-8)


@pytest.mark.long
def test_sliding_derivatives_against_differences():
    rng = np.random.default_rng(7)
    kinds = {0: 0, 1: 0, 2: 0}
    for _ in range(250):
        ends = [random_motion(rng) for _ in range(4)]
        expected = ref.sliding_derivatives_by_differences(*ends)
        if expected[3] > 1e-7:  # the pair changes its kind within the largest step
            continue
        _, s, r = ref.segment_distance(*(end[0] for end in ends))
        kinds[(0.0 < s < 1.0) + (0.0 < r < 1.0)] += 1
        np.testing.assert_allclose(ref.sliding_derivatives(*ends), expected[:3], rtol=1e-7, atol=1e-7)
    assert min(kinds.values()) >= 10


def test_skew_lines_in_translation_have_linear_distance():
    rest = np.zeros(3)
    along_x = [np.array([(x, 0.0, 0.3), (0.3, 0.4, -0.2), rest]) for x in (-1.0, 1.0)]
    along_y = [np.array([(0.0, y, 0.0), rest, rest]) for y in (-1.0, 1.0)]
    d, d_dot, d_ddot = ref.sliding_derivatives(*along_x, *along_y)
    assert (d, d_dot) == pytest.approx((0.3, -0.2))
    assert d_ddot == pytest.approx(0.0, abs=1e-14)
    # The material formula credits |v_perp|^2 / d, which the sliding pair does not have.
    relative = ((0.0, 0.0, 0.3), (0.3, 0.4, -0.2), rest)
    assert ref.material_distance_derivatives(*relative)[2] == pytest.approx(0.25 / 0.3)


def test_parallel_segments_in_translation():
    velocity, acceleration = (0.5, 0.2, -0.1), (0.3, 0.1, 0.4)
    upper = [np.array([(x, 0.0, 0.3), velocity, acceleration]) for x in (-0.3, 0.5)]
    lower = [np.array([(x, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]) for x in (-1.0, 1.0)]
    d, d_dot, d_ddot = ref.sliding_derivatives(*upper, *lower)
    assert (d, d_dot) == pytest.approx((0.3, -0.1))
    # Distance of a point from the line along x: only y and z count.
    assert d_ddot == pytest.approx(0.4 + 0.2**2 / 0.3)


def test_touching_axes_are_refused():
    still = np.zeros((3, 3))
    with pytest.raises(ValueError, match="d = 0"):
        ref.sliding_derivatives(still, still, still, still)
    with pytest.raises(ValueError, match="d = 0"):
        ref.material_distance_derivatives(*still)


def test_phi_after_of_a_resting_arm_is_phi_now():
    chain, zero = ref.lr_mate_chain(), np.zeros(6)
    _, link, start, end, radius = ref.LR_MATE_CAPSULES[4]
    _, low, high, human_radius = ref.HUMAN_CAPSULES[2]
    root = np.array([0.9, 0.0, -0.87])
    for sliding in (False, True):
        value = ref.phi_after(
            chain,
            HOME,
            zero,
            zero,
            zero,
            TAU,
            link,
            start,
            end,
            root + low,
            root + high,
            np.zeros(3),
            np.zeros(3),
            radius + human_radius,
            PARAMS,
            sliding,
        )
        surface = ref.capsule_distance(
            ref.point(chain, HOME, link, start),
            ref.point(chain, HOME, link, end),
            radius,
            root + low,
            root + high,
            human_radius,
        )
        assert value == pytest.approx(PARAMS.d_min**2 - surface**2, abs=1e-14)


def test_row_by_differences_against_chain_rule():
    """The chain rule through p, v, a of the material pair, with their Jacobians by differences."""
    rng = np.random.default_rng(8)
    for _ in range(4):
        args = scene(rng)
        chain, q, qd, qdd, u, _, link, start, end, low, high, velocity = args[:12]
        pair = (0.4, 0.7)
        row = ref.row_by_differences(*args, False, pair)
        local = (1 - pair[0]) * np.array(start) + pair[0] * np.array(end)
        human = (1 - pair[1]) * low + pair[1] * high + TAU * velocity
        nothing = np.zeros(6)

        def motion(jerk, q=q, qd=qd, qdd=qdd, link=link, local=local, chain=chain, zero=nothing):
            state = ref.triple_integrator(q, qd, qdd, jerk, TAU)
            return np.concatenate(ref.point_motion(chain, *state, zero, link, local)[:3])

        p, v, a = np.split(motion(u), 3)
        p, v = p - human, v - velocity
        d, d_dot, _ = ref.material_distance_derivatives(p, v, a)
        n, surface = p / d, d - args[13]
        across = v - d_dot * n
        by_a = -PARAMS.lambda2 * n
        by_v = -PARAMS.lambda1 * n - 2 * PARAMS.lambda2 * across / d
        by_p = (
            -2 * abs(surface) * n
            - PARAMS.lambda1 * across / d
            - PARAMS.lambda2 * ((a - (n @ a) * n) - across @ across * n / d - 2 * d_dot * across / d) / d
        )
        steps = np.column_stack([motion(u + 2 * e) - motion(u - 2 * e) for e in np.eye(6)]) / 4
        expected = -np.concatenate([by_p, by_v, by_a]) @ steps
        np.testing.assert_allclose(row, expected, rtol=0, atol=1e-9 * np.max(np.abs(row)))


@pytest.mark.parametrize("sliding", [False, True])
def test_row_by_differences_does_not_depend_on_the_step(sliding):
    rng = np.random.default_rng(9)
    for _ in range(4):
        args = scene(rng)
        row = ref.row_by_differences(*args, sliding)
        other = ref.row_by_differences(*args, sliding, step=1.0)
        np.testing.assert_allclose(row, other, rtol=0, atol=1e-8 * np.max(np.abs(row)))


def relative_state(rng, speed):
    p = rng.normal(size=3)
    p *= rng.uniform(0.3, 1.0) / np.linalg.norm(p)
    return p, speed * rng.normal(size=3), speed * rng.normal(size=3), rng.normal(size=(3, 6))


def test_phi_times_distance_is_phi_times_distance():
    rng = np.random.default_rng(10)
    for _ in range(10):
        p, v, a, _ = relative_state(rng, 1.0)
        derivatives = ref.material_distance_derivatives(p, v, a)
        expected = derivatives[0] * ref.phi(*derivatives, 0.0, *PARAMS)
        product = ref.phi_times_distance(np.concatenate([p, v, a]), *PARAMS)
        assert product == pytest.approx(expected, rel=1e-12, abs=1e-13)


def test_exact_row_against_differences():
    rng = np.random.default_rng(11)
    for _ in range(10):
        p, v, a, J = relative_state(rng, 1.0)
        L, S = ref.exact_row(p, v, a, J, TAU, *PARAMS)
        delta = np.concatenate([p, v, a])
        through = ref.cartesian_input_matrix(TAU) @ J
        assert pytest.approx(ref.phi_times_distance(delta, *PARAMS)) == S
        for i, e in enumerate(np.eye(6)):
            after = ref.phi_times_distance(delta + through @ e, *PARAMS)
            before = ref.phi_times_distance(delta - through @ e, *PARAMS)
            assert L[i] == pytest.approx((before - after) / 2, rel=1e-6, abs=1e-8)


def test_printed_row_is_twice_the_true_one():
    rng = np.random.default_rng(12)
    for speed, tau, tolerance in ((0.0, TAU, 0.02), (0.5, TAU, 0.2), (0.5, 1e-5, 5e-4)):
        for _ in range(20):
            p, v, a, J = relative_state(rng, speed)
            printed, printed_side = ref.printed_row(p, v, a, J, tau, *PARAMS)
            exact, exact_side = ref.exact_row(p, v, a, J, tau, *PARAMS)
            assert printed_side == exact_side
            assert printed @ exact / (exact @ exact) == pytest.approx(2.0, rel=tolerance)
            # Written out: only the terms 2 tau lambda2 p + tau^2 (lambda1 p + lambda2 v) survive.
            by_hand = 2 * tau * PARAMS.lambda2 * p
            by_hand = by_hand + tau**2 * (PARAMS.lambda1 * p + PARAMS.lambda2 * v)
            np.testing.assert_allclose(printed, by_hand @ J, rtol=1e-12, atol=1e-15)


def random_projection(rng, n, rows, feasible=True):
    upper = rng.uniform(20.0, 180.0, n)
    lower = -rng.uniform(20.0, 180.0, n)
    L = rng.normal(size=(rows, n)) * 10.0 ** rng.uniform(-3, 0, (rows, 1))
    inside = lower + rng.uniform(0.02, 0.98, n) * (upper - lower)
    S = L @ inside - np.abs(L) @ (upper - lower) * rng.uniform(0.0, 0.1, rows)
    if not feasible:
        S[0] = np.abs(L[0]) @ np.maximum(upper, -lower) * 1.01
    root = rng.normal(size=(n, n))
    V = np.eye(n) if rng.random() < 0.5 else root @ root.T + 0.5 * np.eye(n)
    return rng.uniform(-1.3, 1.3, n) * upper, L, S, lower, upper, V


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("n", "rows"), [(1, 1), (2, 3), (3, 2), (4, 1), (4, 3)])
def test_projections_agree(n, rows):
    rng = np.random.default_rng(13 + n + 10 * rows)
    for _ in range(4):
        problem = random_projection(rng, n, rows)
        brute = ref.project_brute(*problem)
        assert brute is not None
        np.testing.assert_allclose(brute, ref.project_reference(*problem), rtol=0, atol=1e-8)
        problem = random_projection(rng, n, rows, feasible=False)
        assert ref.project_brute(*problem) is None
        assert ref.project_reference(*problem) is None


def test_projection_special_cases():
    box = ([-1.0, -1.0], [1.0, 1.0])
    V = np.eye(2)
    for project in (ref.project_brute, ref.project_reference):
        inside = project([0.2, -0.3], np.zeros((0, 2)), np.zeros(0), *box, V)
        np.testing.assert_allclose(inside, [0.2, -0.3], atol=1e-12)
        clipped = project([2.0, -0.3], np.zeros((0, 2)), np.zeros(0), *box, V)
        np.testing.assert_allclose(clipped, [1.0, -0.3], atol=1e-12)
        # The closed form followed by a clip would give (1, 0.5) and break the row.
        sliding = project([1.0, 0.0], [[1.0, 1.0]], [1.9], *box, V)
        np.testing.assert_allclose(sliding, [1.0, 0.9], atol=1e-12)
        double = project([0.0, 0.0], [[1.0, 1.0], [2.0, 2.0]], [1.0, 2.0], *box, V)
        np.testing.assert_allclose(double, [0.5, 0.5], atol=1e-12)
        assert project([0.0, 0.0], [[0.0, 0.0]], [1.0], *box, V) is None
        assert project([0.0, 0.0], [[0.0, 0.0]], [-1.0], *box, V) is not None


def test_project_reference_against_osqp():
    osqp = pytest.importorskip("osqp")
    sparse = pytest.importorskip("scipy.sparse")
    rng = np.random.default_rng(14)
    compared = 0
    for _ in range(20):
        nominal, L, S, lower, upper, V = random_projection(rng, 6, 30)
        exact = ref.project_reference(nominal, L, S, lower, upper, V)
        norm = np.linalg.norm(L, axis=1)
        solver = osqp.OSQP()
        solver.setup(
            sparse.csc_matrix(2 * V),
            -2 * V @ nominal,
            sparse.csc_matrix(np.vstack([L / norm[:, None], np.eye(6)])),
            np.concatenate([S / norm, lower]),
            np.concatenate([np.full(30, np.inf), upper]),
            eps_abs=1e-10,
            eps_rel=1e-10,
            max_iter=100000,
            polishing=True,
            verbose=False,
        )
        result = solver.solve(raise_error=False)
        assert exact is not None
        assert np.all(L @ exact >= S - 1e-8 * norm)
        if result.info.status_val == 1:
            compared += 1
            np.testing.assert_allclose(exact, result.x, rtol=0, atol=1e-6)
    assert compared >= 15


def test_least_violation():
    rng = np.random.default_rng(15)
    for n, rows in ((2, 2), (6, 10)):
        for _ in range(5):
            _, L, S, lower, upper, _ = random_projection(rng, n, rows, feasible=False)
            t, u = ref.least_violation(L, S, lower, upper)
            assert np.all(u >= lower)
            assert np.all(u <= upper)
            assert t == pytest.approx(np.max(S - L @ u), abs=1e-12)
            assert t >= S[0] - np.abs(L[0]) @ np.maximum(upper, -lower) - 1e-9
            tried = rng.uniform(lower, upper, size=(2000, n))
            assert np.min(np.max(S - tried @ L.T, axis=1)) >= t - 1e-9
            # Relaxed by a little more than t the rows can be met, by a little less they cannot.
            slack = 1e-6 * (1.0 + abs(t))
            box = (lower, upper, np.eye(n))
            assert ref.project_reference(u, L, S - t - slack, *box) is not None
            if n == 2:
                assert ref.project_brute(u, L, S - t + slack, *box) is None
    # One row: the corner that pushes hardest.
    t, u = ref.least_violation([[1.0, -2.0]], [10.0], [-1.0, -1.0], [1.0, 2.0])
    assert t == pytest.approx(7.0)
    np.testing.assert_allclose(u, [1.0, -1.0])
