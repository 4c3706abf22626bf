"""Peers of the shield: each formula against an oracle of its own, and what each does beside a person."""

import gymnasium as gym
import numpy as np
import pytest
import reference as ref

from jssa_gym.cli.demo import paper_scene
from jssa_gym.evaluation import rollout
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import Body, ConstantVelocity, nobody, together
from jssa_gym.kernels.records import STOP, records
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.policies import HoldPolicy, WanderPolicy
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.safety.pairs import measure_pairs
from jssa_gym.safety.proximity import agent_records
from jssa_gym.shields import (
    FILTERS,
    CBFFilter,
    CBFParams,
    NoFilter,
    PFMParams,
    Shield,
    SMAParams,
    SSAFilter,
    SSAParams,
    SSMParams,
    SSSFilter,
    SSSParams,
    make_filter,
)
from jssa_gym.shields.reasons import OUTSIDE, UNRECOVERABLE
from jssa_gym.types import CapsuleSet, Scene, Status

DT = 0.008
TABLE = 0.87
HOME = np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2.0, 0.0])
JERK = np.radians([3798.0, 3408.0, 3505.0, 7011.0, 7011.0, 10712.0])
HEAVY = np.diag([4.0, 9.0, 1.0, 0.5, 2.0, 1.0]) + 0.2
"""A metric in which no joint is like another."""
CHAIN = [ref.lr_mate_chain()[0]._replace(offset=np.array([0.0, 0.0, 0.330 + TABLE])), *ref.lr_mate_chain()[1:]]


# ---- the oracle: material points of a pair, followed along the motion -----------------------------------


def closest(scene: Scene, i: int, j: int):
    """Closest points of a pair: link and local point of the robot's, world point and velocity of the person's."""
    _, link, start, end, radius = ref.LR_MATE_CAPSULES[i]
    q, human = scene.robot.position, scene.human
    a, b = (ref.point(CHAIN, q, link, x) for x in (start, end))
    _, s, r = ref.segment_distance(a, b, human.start[j], human.end[j])
    local = np.asarray(start) + s * (np.asarray(end) - np.asarray(start))
    on_human = human.start[j] + r * (human.end[j] - human.start[j])
    walk = human.start_velocity[j] + r * (human.end_velocity[j] - human.start_velocity[j])
    return link, local, on_human, walk, radius + human.radius[j]


def motion(scene: Scene, i: int, j: int, jerk) -> np.ndarray:
    """Surface distance of the same two material points at constant joint jerk, and its first three derivatives now.

    By central differences of the eighth order: the polynomial through nine samples, differentiated at 0.
    """
    link, local, on_human, walk, radii = closest(scene, i, j)
    state, h, values = scene.robot, 1e-3, []
    for t in h * np.arange(-4, 5):
        q = state.position + t * state.velocity + t**2 / 2 * state.acceleration + t**3 / 6 * np.asarray(jerk)
        values.append(np.linalg.norm(ref.point(CHAIN, q, link, local) - on_human - t * walk) - radii)
    coefficients = np.linalg.solve(np.vander(np.arange(-4.0, 5.0), increasing=True), values)
    return coefficients[:4] * np.array([1.0, 1.0 / h, 2.0 / h**2, 6.0 / h**3])


def normal_jacobian(scene: Scene, i: int, j: int) -> np.ndarray:
    """What the joint rates do to the distance's, shape (6,)."""
    link, local, on_human, *_ = closest(scene, i, j)
    w = ref.point(CHAIN, scene.robot.position, link, local) - on_human
    return w @ ref.jacobian(CHAIN, scene.robot.position, link, local) / np.linalg.norm(w)


def nearest_pair(scene: Scene) -> tuple[int, int]:
    human, found = scene.human, {}
    for i, (_, link, start, end, radius) in enumerate(ref.LR_MATE_CAPSULES):
        a, b = (ref.point(CHAIN, scene.robot.position, link, x) for x in (start, end))
        for j in range(len(human.radius)):
            found[i, j] = ref.segment_distance(a, b, human.start[j], human.end[j])[0] - radius - human.radius[j]
    return min(found, key=found.get)


def scenes(random_scene, count: int, seed: int = 0, **options):
    """Scenes with their nominal jerks."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield random_scene(rng, **options), rng.uniform(-1.0, 1.0, 6) * JERK


def phi_rate(D, lambda1, lambda2=0.0):
    """Rate of Eq. (6) from D and its derivatives."""
    return -2.0 * abs(D[0]) * D[1] - lambda1 * D[2] - lambda2 * D[3]


def test_derivatives_are_those_of_the_motion(robot, random_scene):
    for scene, jerk in scenes(random_scene, 6, motion=0.3):
        pairs = measure_pairs(robot, np.array(scene.robot), agent_records(scene.human))
        index = pairs.index(0.05, 3.0, 0.0)
        D, rate, curvature, _ = pairs.motion.T
        for d_min, *lambdas in ((0.05, 3.0, 0.0), (0.03, 0.7, 0.02)):
            phi = d_min * d_min - D * np.abs(D) - lambdas[0] * rate - lambdas[1] * curvature
            np.testing.assert_array_equal(pairs.index(d_min, *lambdas), phi)  # to the bit
        for number in range(30):
            pair = divmod(number, 6)
            expected = motion(scene, *pair, jerk)
            found = pairs.motion[number].copy()
            found[3] += pairs.rows[number] @ jerk
            for order, tolerance in enumerate((1e-9, 1e-7, 1e-5, 1e-2)):
                assert found[order] == pytest.approx(expected[order], rel=1e-5, abs=tolerance)
            assert index[number] == pytest.approx(0.0025 - found[0] * abs(found[0]) - 3.0 * found[1], abs=1e-9)


# ---- safe set algorithm -----------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("V", [None, HEAVY], ids=["plain", "weighted"])
def test_ssa_gives_the_nearest_acceleration_that_lets_the_index_fall(robot, random_scene, V):
    params, seen = SSAParams(), {}
    chosen = SSAFilter(robot, DT, weight=V)
    for scene, nominal in scenes(random_scene, 140, motion=0.02):
        decision = chosen.decide(scene, nominal)
        seen[decision.status] = seen.get(decision.status, 0) + 1
        i, j = nearest_pair(scene)
        assert decision.pair == (i, j)
        D = motion(scene, i, j, np.zeros(6))
        phi = params.d_min**2 - D[0] * abs(D[0]) - params.lambda1 * D[1]
        assert decision.phi == pytest.approx(phi, abs=1e-6)
        acceleration = scene.robot.acceleration + DT * nominal
        row = normal_jacobian(scene, i, j)
        rate = phi_rate(D, params.lambda1) - params.lambda1 * np.dot(row, acceleration - scene.robot.acceleration)
        if phi < 0.0 or rate <= -params.eta:
            assert decision.status == Status.NOMINAL
            np.testing.assert_array_equal(decision.jerk, nominal)
            continue
        if np.abs(row).max() < 1e-3:  # the base column: no acceleration helps
            assert decision.status == Status.RELAXED
            continue
        # one half-space: the nearest point is along the row, seen in the metric
        way = row if V is None else np.linalg.solve(V, row)
        step = (rate + params.eta) / (params.lambda1 * np.dot(row, way))
        safe = acceleration + step * way
        after = phi_rate(D, params.lambda1) - params.lambda1 * np.dot(row, safe - scene.robot.acceleration)
        assert after == pytest.approx(-params.eta, abs=1e-9)
        expected = np.clip((safe - scene.robot.acceleration) / DT, -JERK, JERK)
        np.testing.assert_allclose(decision.jerk, expected, rtol=1e-4, atol=1e-2)
        cut = np.any(np.abs(expected) >= JERK)
        assert decision.status == (Status.RELAXED if decision.slack > 1e-9 else Status.PROJECTED)
        assert cut or decision.status == Status.PROJECTED
    assert min(seen.get(s, 0) for s in (Status.NOMINAL, Status.PROJECTED, Status.RELAXED)) >= 3


# ---- filters that project: sublevel safe set and control barrier function -----------------------------------


def all_rows(scene: Scene, condition):
    """Rows of all pairs with authority: ``condition`` maps D and its derivatives at zero jerk to (weight, right)."""
    L, S = [], []
    for pair in np.ndindex(5, len(scene.human.radius)):
        row = normal_jacobian(scene, *pair)
        asked = condition(motion(scene, *pair, np.zeros(6)))
        if np.abs(row) @ JERK >= 5.0 and asked is not None:
            L.append(asked[0] * row)
            S.append(asked[1])
    return np.array(L).reshape(-1, 6), np.array(S)


def assert_nearest(decision, nominal, L, S, tolerance, V=None) -> None:
    """The decision is what Eq. (14) asks for, by two solvers that share nothing with the package's."""
    if not len(S) or np.all(L @ nominal >= S):
        assert decision.status == Status.NOMINAL
        np.testing.assert_array_equal(decision.jerk, nominal)
        return
    expected = ref.project_reference(nominal, L, S, -JERK, JERK, np.eye(6) if V is None else V)
    if expected is None:
        assert decision.status == Status.RELAXED
        least, _ = ref.least_violation(L, S, -JERK, JERK)
        assert decision.slack == pytest.approx(least, rel=1e-3, abs=tolerance)
        assert (S - L @ decision.jerk).max() == pytest.approx(least, rel=1e-3, abs=tolerance)
    else:
        assert decision.status == Status.PROJECTED
        assert (S - L @ decision.jerk).max() <= tolerance
        np.testing.assert_allclose(decision.jerk, expected, atol=1e-2)


@pytest.mark.long
@pytest.mark.parametrize("V", [None, HEAVY], ids=["plain", "weighted"])
def test_cbf_keeps_what_its_poles_ask_for_in_every_pair(robot, random_scene, V):
    params = CBFParams(k1=0.7, k2=4.0, k3=12.0)
    poles = np.poly([-params.k1, -params.k2, -params.k3])  # s³ + ... by numpy's hand
    chosen, seen = CBFFilter(robot, DT, params, weight=V), set()

    def asked(D):
        return 1.0, -(poles @ [D[3], D[2], D[1], D[0] - params.d_min])

    for k, (scene, nominal) in enumerate(scenes(random_scene, 10, near=0.6, motion=0.01)):
        nominal = nominal if k % 2 else 0.02 * nominal
        decision = chosen.decide(scene, nominal)
        seen.add(decision.status)
        assert_nearest(decision, nominal, *all_rows(scene, asked), 1e-2, V)
    assert seen == {Status.NOMINAL, Status.PROJECTED, Status.RELAXED}


def test_cbf_row_is_the_third_derivative_along_the_motion_under_the_jerk(robot, random_scene):
    """With one pair and room in the box, the arm that then moves meets the condition with equality."""
    params, met = CBFParams(k1=1.0, k2=5.0, k3=20.0, rows="closest"), 0
    poles, chosen = np.poly([-1.0, -5.0, -20.0]), make_filter("cbf", robot, DT, params=params)
    for scene, nominal in scenes(random_scene, 60, near=0.9, motion=0.02):
        decision = chosen.decide(scene, 0.3 * nominal)
        if decision.status == Status.PROJECTED:
            D = motion(scene, *decision.pair, decision.jerk)
            assert poles @ [D[3], D[2], D[1], D[0] - params.d_min] == pytest.approx(0.0, abs=1e-2)
            met += 1
    assert met >= 5


@pytest.mark.long
@pytest.mark.parametrize("V", [None, HEAVY], ids=["plain", "weighted"])
def test_sss_asks_only_where_the_index_is_above_0(robot, random_scene, V):
    params, seen = SSSParams(c=3.0), set()
    chosen = SSSFilter(robot, DT, params, weight=V)

    def asked(D):
        phi = params.d_min**2 - D[0] * abs(D[0]) - params.lambda1 * D[1] - params.lambda2 * D[2]
        # the index has to fall by c phi a second
        right = params.c * phi + phi_rate(D, params.lambda1, params.lambda2)
        return None if phi < 0.0 else (DT * params.lambda2, DT * right)

    for scene, nominal in scenes(random_scene, 8, near=0.7, motion=0.02):
        decision = chosen.decide(scene, nominal)
        seen.add(decision.status)
        assert_nearest(decision, nominal, *all_rows(scene, asked), 1e-5, V)
    assert seen >= {Status.NOMINAL, Status.PROJECTED}


# ---- filters in closed form: potential field and sliding mode ---------------------------------------------------


def test_pfm_pushes_by_the_gradient_of_its_potential(robot, random_scene):
    params, pushed = PFMParams(), 0
    chosen = make_filter("pfm", robot, DT, params=params)

    def potential(D):
        return 0.5 * params.strength * (1.0 / D - 1.0 / params.influence) ** 2

    for scene, nominal in scenes(random_scene, 60, motion=0.02):
        nominal = 0.1 * nominal
        decision = chosen.decide(scene, nominal)
        pair = nearest_pair(scene)
        D = motion(scene, *pair, np.zeros(6))
        assert decision.phi == pytest.approx(params.influence**2 - D[0] * abs(D[0]), abs=1e-9)
        if D[0] > params.influence:
            assert decision.status == Status.NOMINAL
            np.testing.assert_array_equal(decision.jerk, nominal)
            continue
        if D[0] < 0.02:
            continue
        h = 1e-5 * D[0]
        force = -(potential(D[0] + h) - potential(D[0] - h)) / (2.0 * h) - params.damping * D[1]
        push = max(force - D[2], 0.0) / params.lag
        expected = np.clip(nominal + push * normal_jacobian(scene, *pair), -JERK, JERK)
        np.testing.assert_allclose(decision.jerk, expected, rtol=1e-5, atol=1e-5)
        if push == 0.0:
            assert decision.status == Status.NOMINAL
        elif np.abs(expected - nominal).max() > 1e-6:  # the base column can hardly be pushed
            assert decision.status == Status.PROJECTED
        pushed += push > 0.0
    assert pushed >= 5


@pytest.mark.parametrize("rows", ["closest", "all"])
def test_sma_adds_a_jerk_of_one_size_where_the_index_is_above_0(robot, random_scene, rows):
    params = SMAParams(gain=0.4, rows=rows)
    chosen, seen = make_filter("sma", robot, DT, params=params), set()
    for scene, nominal in scenes(random_scene, 8, near=0.7, motion=0.02):
        nominal = 0.1 * nominal
        decision = chosen.decide(scene, nominal)
        seen.add(decision.status)
        gradient = np.zeros(6)
        for pair in [nearest_pair(scene)] if rows == "closest" else np.ndindex(5, 6):
            D, row = motion(scene, *pair, np.zeros(6)), normal_jacobian(scene, *pair)
            phi = params.d_min**2 - D[0] * abs(D[0]) - params.lambda1 * D[1] - params.lambda2 * D[2]
            if phi > 0.0 and (rows == "closest" or np.abs(row) @ JERK >= 5.0):
                gradient += row
        if np.abs(gradient).max() < 1e-9:
            assert decision.status in (Status.NOMINAL, Status.RELAXED)
            np.testing.assert_array_equal(decision.jerk, nominal)
            continue
        added = decision.jerk - nominal
        # along the gradient, the joint that gives most at 0.4 of its bound; nothing was cut off
        assert np.abs(added / JERK).max() == pytest.approx(0.4, rel=1e-9)
        np.testing.assert_allclose(added / np.linalg.norm(added), gradient / np.linalg.norm(gradient), atol=1e-7)
        assert decision.status == Status.PROJECTED
    assert seen >= {Status.NOMINAL, Status.PROJECTED}


# ---- speed and separation monitoring ----------------------------------------------------------------------------


def ends_along_the_stop(robot, scene: Scene, jerk):
    """Capsule ends of the arm (T, 5, 2, 3) from now through one step at a jerk and then its stop; the stop's time."""
    state = np.array([scene.robot.position, scene.robot.velocity, scene.robot.acceleration])
    limits, plan = robot.limits, records(6, STOP)
    bounds = np.array([*limits.position.T, limits.velocity, limits.acceleration, limits.jerk])

    def place(q):
        return [[ref.point(CHAIN, q, link, x) for x in (start, end)] for _, link, start, end, _ in ref.LR_MATE_CAPSULES]

    path = [place(state[0])]
    state = ref.triple_integrator(*state, jerk, DT)
    path.append(place(state[0]))
    ticks, held = plan_stop(np.array(state), bounds, DT, plan), np.zeros(6)
    for tick in range(ticks):
        stop_jerk(plan, tick, held)
        state = ref.triple_integrator(*state, held, DT)
        path.append(place(state[0]))
    assert np.abs(state[1]).max() < 1e-6
    return np.array(path), ticks * DT


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(3))
def test_ssm_nobody_farther_than_the_protective_distance_meets_the_moving_arm(robot, random_scene, seed):
    """Brute force: the stop rolled out, the person straight on at full speed, at every tick."""
    chosen = make_filter("ssm", robot, DT, params=SSMParams())
    for scene, jerk in scenes(random_scene, 2, seed=seed, near=0.9, motion=0.3):
        jerk = 0.5 * jerk
        chosen.decide(scene, jerk)
        needed = chosen.records.work.needed.reshape(5, 6)
        path, stopping = ends_along_the_stop(robot, scene, jerk)
        human = scene.human
        for i, j in np.ndindex(5, 6):
            radii = ref.LR_MATE_CAPSULES[i][4] + human.radius[j]
            now, s, r = ref.segment_distance(*path[0, i], human.start[j], human.end[j])
            n = path[0, i, 0] + s * (path[0, i, 1] - path[0, i, 0]) - human.start[j]
            n = (n - r * (human.end[j] - human.start[j])) / now
            # what it has to be: the walk, and the farthest that an end of the capsule comes along n
            came = max(0.0, float(((path[0, i] - path[:, i]) @ n).max()))
            assert needed[i, j] == pytest.approx(1.6 * (DT + stopping) + came, abs=1e-6)
            # and enough: at that distance nobody is met while the arm moves
            shift = (now - radii - needed[i, j]) * n
            for tick, ends in enumerate(path):
                walk = shift + 1.6 * DT * tick * n
                gap = ref.segment_distance(*ends[i], human.start[j] + walk, human.end[j] + walk)[0] - radii
                assert gap >= -1e-9


def test_ssm_at_rest_by_hand(robot, make_scene):
    scene = make_scene([HOME, 0.0 * HOME, 0.0 * HOME], Body.facing().at((1.5, 0.0), (-0.5, 0.0)))

    def needed(**values):
        chosen = make_filter("ssm", robot, DT, params=SSMParams(**values))
        chosen.decide(scene, np.zeros(6))
        return chosen.records.work.needed

    np.testing.assert_allclose(needed(), 1.6 * 0.008, rtol=1e-12)
    errors = {"intrusion": 0.02, "human_error": 0.03, "robot_error": 0.004}
    np.testing.assert_allclose(needed(latency=0.1, **errors), 1.6 * 0.108 + 0.054, rtol=1e-12)
    measured = needed(human_speed=None).reshape(5, 6)
    # the tool is nearly straight in front of the body, everybody else aside
    assert 0.3 * DT < measured[4, 1] <= 0.5 * DT
    assert measured.max() <= 0.5 * DT * (1.0 + 1e-12)


def test_ssm_stops_once_and_goes_on_with_more_distance_than_it_stopped_at(robot, make_scene):
    """A person walks up and away again: a stop, rest, and no to and fro."""
    chosen, nominal = make_filter("ssm", robot, DT, params=SSMParams(hysteresis=0.1)), 0.05 * JERK
    state, stopped, resumed, edges, was = [HOME, 0.0 * HOME, 0.0 * HOME], None, None, 0, Status.NOMINAL
    for k in range(1200):
        root = 1.9 - 0.8 * DT * k if k < 150 else 0.94 + 0.8 * DT * max(k - 400, 0)
        walk = (-0.8 if k < 150 else 0.8 if k > 400 else 0.0, 0.0)
        scene = make_scene(state, Body.facing().at((root, 0.0), walk), time=DT * k)
        # gently to and fro until it stopped and went on
        wanted = nominal * np.sign(np.sin(4.0 * DT * k + np.pi / 2.0)) if resumed is None else np.zeros(6)
        decision = chosen.decide(scene, wanted)
        edges += decision.status != was
        was = decision.status
        if decision.status == Status.PROJECTED and stopped is None:
            stopped = decision.distance
        if stopped is not None and resumed is None and decision.status == Status.NOMINAL:
            resumed = decision.distance
            assert np.abs(state[1]).max() < 1e-8
        state = list(ref.triple_integrator(*state, decision.jerk, DT))
    assert stopped is not None
    assert resumed is not None
    assert stopped + 0.09 < resumed < stopped + 0.2
    assert edges == 2


def ball(place, radius=0.005):
    place = np.array([place], float)
    return CapsuleSet(place, place, 0.0 * place, 0.0 * place, np.array([radius]), ("ball",), np.zeros(1, np.int64))


def test_ssm_forgets_at_reset_that_it_stopped(robot, make_scene):
    chosen, rest = make_filter("ssm", robot, DT), [HOME, 0.0 * HOME, 0.0 * HOME]
    near, away = (make_scene(rest, ball([0.485 + gap, 0.0, TABLE + 0.7])) for gap in (0.06, 0.11))
    nominal = np.zeros(6)
    assert chosen.decide(away, nominal).status == Status.NOMINAL
    assert chosen.decide(near, nominal).status == Status.PROJECTED
    waiting = chosen.decide(away, nominal)
    assert waiting.status == Status.PROJECTED
    assert "waiting" in waiting.reason
    chosen.reset(away)
    assert chosen.decide(away, nominal).status == Status.NOMINAL


# ---- every filter -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(FILTERS))
def test_parameters_of_another_filter_are_refused(robot, name):
    with pytest.raises(ParameterError, match="got"):
        make_filter(name, robot, DT, params="fast")
    if name == "stop" or name == "none":
        with pytest.raises(ParameterError, match="no parameters"):
            make_filter(name, robot, DT, IndexParams())
    if name != "ssa":
        with pytest.raises(ParameterError, match="SSAParams"):
            make_filter(name, robot, DT, params=SSAParams())
    with pytest.raises(ParameterError, match="one of them"):
        make_filter(name, robot, DT, IndexParams(), params=IndexParams())


@pytest.mark.parametrize("name", list(FILTERS))
def test_with_nobody_there_the_nominal_is_forwarded(robot, make_scene, name):
    chosen, nominal = make_filter(name, robot, DT), 0.1 * JERK
    scene = make_scene([HOME, 0.0 * HOME, 0.0 * HOME], nobody())
    chosen.reset(scene)
    decision = chosen.decide(scene, nominal)
    assert decision.status == Status.NOMINAL
    np.testing.assert_array_equal(decision.jerk, nominal)


@pytest.mark.parametrize("name", list(FILTERS))
def test_somebody_far_away_changes_nothing(robot, make_scene, name):
    chosen, nominal = make_filter(name, robot, DT), 0.1 * JERK
    scene = make_scene([HOME, 0.0 * HOME, 0.0 * HOME], Body.facing().at((4.0, 0.0), (0.0, 0.0)))
    chosen.reset(scene)
    decision = chosen.decide(scene, nominal)
    assert decision.status == Status.NOMINAL
    np.testing.assert_array_equal(decision.jerk, nominal)


@pytest.mark.parametrize("name", list(FILTERS))
@pytest.mark.parametrize("human", [nobody(), Body.facing().at((4.0, 0.0), (0.0, 0.0))], ids=["nobody", "far away"])
def test_a_clipped_nominal_is_told_from_one_that_would_break_the_joint_limits(robot, make_scene, name, human):
    chosen = make_filter(name, robot, DT, viability=True)
    at_rest = [HOME, 0.0 * HOME, 0.0 * HOME]
    # the first joint is about to exceed its velocity limit, unless it brakes
    fast, first = [HOME, np.eye(6)[0] * 0.99999 * robot.limits.velocity, 0.0 * HOME], np.eye(6)[0]
    for state, nominal, reason in (
        (at_rest, 2.0 * JERK, OUTSIDE),
        (fast, 0.5 * first * JERK, UNRECOVERABLE),
        (fast, 2.0 * JERK, UNRECOVERABLE),
        (fast, (2.0 - 2.5 * first) * JERK, OUTSIDE),
        (fast, (2.0 - 1.5 * first) * JERK, UNRECOVERABLE),
        (fast, -2.0 * first * JERK, OUTSIDE),
    ):
        scene = make_scene(state, human)
        chosen.reset(scene)
        decision = chosen.decide(scene, nominal)
        assert (decision.status, decision.reason) == (Status.PROJECTED, reason)
        clipped = np.clip(nominal, -robot.limits.jerk, robot.limits.jerk)
        assert (decision.jerk == clipped).all() == (reason == OUTSIDE)
        np.testing.assert_array_equal(decision.jerk, np.clip(nominal, chosen.lower, chosen.upper))


# ---- beside a person: the paper's scene, and what else an arm may meet ---------------------------------------


def fig5(speed: float, *, name: str | None, seed: int = 0, steps: int = 700):
    """The arm holds its home position, a person walks up to it and back again."""
    env = gym.make("jssa_gym/Home-v0", human=paper_scene(speed), terminate_on=())
    if name is not None:
        env = Shield(env, make_filter(name, env.unwrapped.robot, DT))
    return rollout(env, HoldPolicy(env), seed=seed, steps=steps)


AVOIDING = ("jssa", "jssa_near", "jssa_published", "jssa_ahead", "ssa", "sss", "cbf", "pfm", "sma")
STOPPING = ("ssm", "stop", "none")
"""An arm that holds its place is touched where it stands by these: they never move it away."""


def test_every_filter_is_of_one_kind():
    assert {*AVOIDING, *STOPPING} == set(FILTERS)


@pytest.fixture(scope="module")
def unshielded():
    return fig5(0.8, name=None)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", AVOIDING)
def test_the_arm_gives_way_in_the_papers_scene(unshielded, name):
    assert unshielded.contact.any()
    trace = fig5(0.8, name=name)
    assert trace.distance.min() > unshielded.distance.min() + 0.02
    assert trace.intervened.any()
    assert np.all(np.abs(trace.jerk) <= JERK * (1.0 + 1e-9))
    assert not (trace.status == Status.FAULT).any()
    # before the person walks and after they left nothing is touched
    assert not trace.intervened[:50].any()
    assert not trace.intervened[-20:].any()
    np.testing.assert_array_equal(trace.jerk[:50], trace.nominal[:50])


@pytest.mark.parametrize("name", STOPPING)
def test_who_only_stops_stands_in_the_way(unshielded, name):
    trace = fig5(0.8, name=name)
    assert trace.distance.min() == pytest.approx(unshielded.distance.min(), abs=1e-6)
    assert trace.contact_speed.max() < 1e-6


@pytest.mark.parametrize("name", ["ssm", "stop"])
def test_who_stops_in_time_is_at_rest_at_every_contact(name):
    """A wandering arm, somebody who passes it at 1.6 m/s: unshielded it hits."""

    def hits(name):
        fastest = 0.0
        for seed in range(4):
            human = ConstantVelocity(speed=(1.4, 1.6), offset=(0.6, 0.7), passing=(1.0, 1.5))
            env = gym.make("jssa_gym/Home-v0", human=human, terminate_on=())
            env = Shield(env, make_filter(name, env.unwrapped.robot, DT))
            trace = rollout(env, WanderPolicy(env, seed=seed), seed=seed, steps=300)
            fastest = max(fastest, trace.contact_speed.max())
        return fastest

    assert hits("none") > 0.1
    assert hits(name) < 1e-3


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", list(FILTERS))
def test_runs_repeat_bit_for_bit(name):
    one, two = (fig5(1.6, name=name, steps=250) for _ in range(2))
    for values in ("jerk", "position", "phi", "status", "distance"):
        np.testing.assert_array_equal(getattr(one, values), getattr(two, values))


@pytest.mark.sampled(7)
@pytest.mark.parametrize("name", list(FILTERS))
def test_reset_begins_anew(name):
    """The second episode of a used filter is that of a new one."""
    env = gym.make("jssa_gym/Home-v0", human=paper_scene(1.6), terminate_on=())
    env = Shield(env, make_filter(name, env.unwrapped.robot, DT))
    policy = HoldPolicy(env)
    first, second = (rollout(env, policy, seed=0, steps=150) for _ in range(2))
    np.testing.assert_array_equal(first.jerk, second.jerk)
    np.testing.assert_array_equal(first.status, second.status)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", list(FILTERS))
def test_an_arm_of_three_joints_a_crowd_and_static_agents(toy_robot, make_scene, name):
    rng, seen = np.random.default_rng(0), set()
    bound = np.array(toy_robot.limits.jerk)
    post = ball([0.0, 0.9, 0.1], 0.1)
    for k in range(60):
        crowd = together(
            [ball(rng.uniform([0.1, -0.8, 0.0], [1.2, 0.8, 0.4]), 0.05) for _ in range(k % 5)] or [nobody()]
        )
        state = [rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.5, 0.5, 3), rng.uniform(-1.0, 1.0, 3)]
        chosen = make_filter(name, toy_robot, 0.01)
        scene = make_scene(state, crowd)._replace(static=post)
        chosen.reset(scene)
        nominal = rng.uniform(-1.0, 1.0, 3) * bound
        decision = chosen.decide(scene, nominal)
        seen.add(decision.status)
        assert decision.jerk.shape == (3,)
        assert np.all(np.abs(decision.jerk) <= bound)
        if decision.status == Status.NOMINAL:
            np.testing.assert_array_equal(decision.jerk, nominal)
        if name != "stop":  # the arm is found in motion, for which no stop was verified
            assert decision.status != Status.FAULT, decision.reason
    assert len(seen) >= 2 or name in ("none", "stop")


@pytest.mark.parametrize("size", [1e160, 1e308])
@pytest.mark.parametrize("name", ["ssa", "sss", "cbf", "pfm", "sma", "ssm"])
def test_what_overflows_is_a_fault(robot, make_scene, name, size):
    """A distance's derivative that is infinite or no number must not read as an index below 0."""
    for velocity in (size * np.ones(6), -size * np.ones(6)):
        chosen = make_filter(name, robot, DT)
        decision = chosen.decide(
            make_scene([HOME, velocity, 0.0 * HOME], Body.facing().at((1.2, 0.0), (0.0, 0.0))), HOME
        )
        assert decision.status == Status.FAULT
        assert "not finite" in decision.reason


def test_stop_is_the_verified_stop_alone(robot, random_scene):
    named, alone = make_filter("stop", robot, DT), NoFilter(robot, DT, viability=True, failsafe=FailsafeParams())
    assert named.viability
    assert named.failsafe == FailsafeParams()
    for scene, nominal in scenes(random_scene, 30, motion=0.1):
        for filter in (named, alone):
            filter.reset(scene)
        one, other = named.decide(scene, nominal), alone.decide(scene, nominal)
        assert (one.status, one.reason) == (other.status, other.reason)
        np.testing.assert_array_equal(one.jerk, other.jerk)
    assert make_filter("stop", robot, DT, failsafe=FailsafeParams(human_speed=1.0)).failsafe.human_speed == 1.0


WRONG = [
    (SSAParams, {"d_min": 0.0}),
    (SSAParams, {"lambda1": -1.0}),
    (SSAParams, {"eta": np.nan}),
    (SSAParams, {"rows": "some"}),
    (SSAParams, {"lambda1": "3"}),
    (SSSParams, {"c": 0.0}),
    (SSSParams, {"lambda1": 0.1}),
    (SSSParams, {"rows": None}),
    (CBFParams, {"k1": -1.0}),
    (CBFParams, {"k3": np.inf}),
    (PFMParams, {"influence": 0.0}),
    (PFMParams, {"lag": True}),
    (SMAParams, {"gain": 1.5}),
    (SMAParams, {"gain": 0.0}),
    (SSMParams, {"human_speed": 0.0}),
    (SSMParams, {"latency": -0.1}),
    (SSMParams, {"hysteresis": np.nan}),
]


@pytest.mark.parametrize(("kind", "wrong"), WRONG, ids=[f"{kind.__name__} {wrong}" for kind, wrong in WRONG])
def test_parameters_that_are_none_are_refused(kind, wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        kind(**wrong)


@pytest.mark.parametrize("kind", [SSAFilter, SSSFilter, CBFFilter])
def test_a_metric_that_is_none_is_refused(robot, kind):
    with pytest.raises(ParameterError, match="weight"):
        kind(robot, DT, weight=-np.ones(6))
