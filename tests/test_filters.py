"""Peers of the shield: each formula against an oracle of its own, and what each does beside a person."""

import numpy as np
import pytest
import reference as ref

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import Body, nobody
from jssa_gym.safety.index import IndexParams
from jssa_gym.shields import FILTERS, SSAParams, make_filter
from jssa_gym.types import Scene, Status

DT = 0.008
TABLE = 0.87
HOME = np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2.0, 0.0])
JERK = np.radians([3798.0, 3408.0, 3505.0, 7011.0, 7011.0, 10712.0])
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
    return link, local, on_human, walk, radius + human.radius[j], (s, r)


def distance_after(scene: Scene, i: int, j: int, jerk, t: float) -> float:
    """Surface distance of the same two material points after the time t at constant joint jerk."""
    link, local, on_human, walk, radii, _ = closest(scene, i, j)
    state = scene.robot
    q = state.position + t * state.velocity + t**2 / 2 * state.acceleration + t**3 / 6 * np.asarray(jerk)
    return float(np.linalg.norm(ref.point(CHAIN, q, link, local) - on_human - t * walk)) - radii


def motion(scene: Scene, i: int, j: int, jerk) -> np.ndarray:
    """D and its first three derivatives now, by central differences of the eighth order."""
    h = 1e-3
    t = h * np.arange(-4, 5)
    values = [distance_after(scene, i, j, jerk, x) for x in t]
    # the polynomial through nine samples, differentiated at 0
    coefficients = np.linalg.solve(np.vander(t / h, increasing=True), values)
    return coefficients[:4] * np.array([1.0, 1.0 / h, 2.0 / h**2, 6.0 / h**3])


def normal_jacobian(scene: Scene, i: int, j: int) -> np.ndarray:
    """What the joint rates do to the distance's, shape (6,)."""
    link, local, on_human, *_ = closest(scene, i, j)
    w = ref.point(CHAIN, scene.robot.position, link, local) - on_human
    return w @ ref.jacobian(CHAIN, scene.robot.position, link, local) / np.linalg.norm(w)


def nearest_pair(scene: Scene) -> tuple[int, int]:
    pairs = [(i, j) for i in range(5) for j in range(len(scene.human.radius))]
    return min(pairs, key=lambda pair: distance_after(scene, *pair, np.zeros(6), 0.0))


def scenes(random_scene, count: int, seed: int = 0, **options):
    """Scenes with their nominal jerks."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield random_scene(rng, **options), rng.uniform(-1.0, 1.0, 6) * JERK


def phi_rate(D, lambda1, lambda2=0.0):
    """Rate of Eq. (6) from D and its derivatives."""
    return -2.0 * abs(D[0]) * D[1] - lambda1 * D[2] - lambda2 * D[3]


def test_derivatives_are_those_of_the_motion(robot, random_scene):
    chosen = make_filter("ssa", robot, DT)
    for scene, jerk in scenes(random_scene, 6, motion=0.3):
        chosen.decide(scene, np.zeros(6))
        for number in range(30):
            pair = divmod(number, 6)
            expected = motion(scene, *pair, jerk)
            found = chosen._motion[number].copy()
            found[3] += chosen._rows[number] @ jerk
            for order, tolerance in enumerate((1e-9, 1e-7, 1e-5, 1e-2)):
                assert found[order] == pytest.approx(expected[order], rel=1e-5, abs=tolerance)
            assert chosen._phi[number] == pytest.approx(0.0025 - found[0] * abs(found[0]) - 3.0 * found[1], abs=1e-9)


# ---- safe set algorithm -----------------------------------------------------------------------------------


def test_ssa_gives_the_nearest_acceleration_that_lets_the_index_fall(robot, random_scene):
    params, seen = SSAParams(), {}
    chosen = make_filter("ssa", robot, DT)
    for scene, nominal in scenes(random_scene, 90, motion=0.02):
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
        # one half-space: the nearest point is along the row
        step = (rate + params.eta) / (params.lambda1 * np.dot(row, row))
        safe = acceleration + step * row
        after = phi_rate(D, params.lambda1) - params.lambda1 * np.dot(row, safe - scene.robot.acceleration)
        assert after == pytest.approx(-params.eta, abs=1e-9)
        expected = np.clip((safe - scene.robot.acceleration) / DT, -JERK, JERK)
        np.testing.assert_allclose(decision.jerk, expected, rtol=1e-4, atol=1e-2)
        cut = np.any(np.abs(expected) >= JERK)
        assert decision.status == (Status.RELAXED if decision.slack > 1e-9 else Status.PROJECTED)
        assert cut or decision.status == Status.PROJECTED
    assert min(seen.get(s, 0) for s in (Status.NOMINAL, Status.PROJECTED, Status.RELAXED)) >= 3


# ---- every filter -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(FILTERS))
def test_parameters_of_another_filter_are_refused(robot, name):
    with pytest.raises(ParameterError, match="got"):
        make_filter(name, robot, DT, params="fast")
    if name != "ssa":
        with pytest.raises(ParameterError, match="SSAParams"):
            make_filter(name, robot, DT, params=SSAParams())
    with pytest.raises(ParameterError, match="one of them"):
        make_filter(name, robot, DT, IndexParams(), params=IndexParams())


@pytest.mark.parametrize("name", list(FILTERS))
def test_with_nobody_there_the_nominal_is_forwarded(robot, make_scene, name):
    chosen, nominal = make_filter(name, robot, DT), 0.1 * JERK
    decision = chosen.decide(make_scene([HOME, 0.0 * HOME, 0.0 * HOME], nobody()), nominal)
    assert decision.status == Status.NOMINAL
    np.testing.assert_array_equal(decision.jerk, nominal)


@pytest.mark.parametrize("name", list(FILTERS))
def test_somebody_far_away_changes_nothing(robot, make_scene, name):
    chosen, nominal = make_filter(name, robot, DT), 0.1 * JERK
    scene = make_scene([HOME, 0.0 * HOME, 0.0 * HOME], Body.facing().at((4.0, 0.0), (0.0, 0.0)))
    decision = chosen.decide(scene, nominal)
    assert decision.status == Status.NOMINAL
    np.testing.assert_array_equal(decision.jerk, nominal)


@pytest.mark.parametrize(
    "wrong", [{"d_min": 0.0}, {"lambda1": -1.0}, {"eta": np.nan}, {"rows": "some"}, {"lambda1": "3"}]
)
def test_ssa_parameters_that_are_none_are_refused(wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        SSAParams(**wrong)
