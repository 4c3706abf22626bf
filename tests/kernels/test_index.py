"""The safety index and its rows: the right number, the right slope, and never a NaN that reads as safe."""

from types import SimpleNamespace

import numpy as np
import pytest
import reference as ref
from hypothesis import given, settings
from hypothesis import strategies as st

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.capsules import capsule_pair
from jssa_gym.kernels.index import (
    advance,
    assess,
    evaluate,
    evaluate_plane,
    exact_rows,
    index_of,
)
from jssa_gym.kernels.printed import measure_present, printed_row, printed_rows
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, PLANE, SEGMENT
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.safety.index import IndexParams

FIXED = settings(deadline=None, derandomize=True, database=None, max_examples=200)
TAU = 0.008
ROBOT = lr_mate_200id_7l()
CHAIN = ref.lr_mate_chain()
JERK = ROBOT.limits.jerk
ENDLESS = 1e12 * JERK
NO_PLANES = np.zeros(0, PLANE)
INDEX = IndexParams(d_min=0.05, lambda1=1.25, lambda2=0.39, sliding=True).kernel()
MATERIAL = INDEX._replace(sliding=False)
# the sliding term without the two guards that keep it finite
EXACT = INDEX._replace(sin2_floor=1e-12, sliding_limit=1e12)
PARAMS = ref.Params(INDEX.d_min, INDEX.lambda1, INDEX.lambda2)


@pytest.fixture(params=[1, pytest.param(50, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


# ---- one pair of moving capsules ----------------------------------------------------------------------


class Duel:
    """A robot capsule and an agent with random motions; the reference's view of the same."""

    def __init__(self, rng, d=None):
        segments, agents = np.zeros(1, SEGMENT), np.zeros(1, AGENT)
        self.segment, self.agent = segments[0], agents[0]
        for end in ("start", "end"):
            self.segment[end], self.agent[end] = 0.4 * rng.normal(size=(2, 3))
            self.segment[f"{end}_velocity"], self.agent[f"{end}_velocity"] = 0.5 * rng.normal(size=(2, 3))
            self.segment[f"{end}_acceleration"] = 2.0 * rng.normal(size=3)
        self.segment["radius"], self.agent["radius"] = rng.uniform(0.03, 0.2, 2)
        self.segment["link"] = 2
        if d is not None:
            self.shift_to(d)
        self.measure()

    def shift_to(self, d):
        """Move the agent along the common normal until the axes are d apart."""
        self.measure()
        gap = self.point("segment", self.s) - self.point("agent", self.r)
        move = gap * (1.0 - d / np.linalg.norm(gap))
        self.agent["start"] += move
        self.agent["end"] += move

    def point(self, which, fraction):
        body = getattr(self, which)
        return body["start"] + fraction * (body["end"] - body["start"])

    def measure(self):
        a, b = self.segment, self.agent
        self.radii = a["radius"] + b["radius"]
        self.distance, self.s, self.r = capsule_pair(a["start"], a["end"], b["start"], b["end"], self.radii)

    def evaluate(self, index):
        return evaluate(self.segment, self.agent, self.s, self.r, self.distance, index)

    def motions(self):
        zero = np.zeros(3)
        a, b = self.segment, self.agent
        return [np.array([a[end], a[f"{end}_velocity"], a[f"{end}_acceleration"]]) for end in ("start", "end")] + [
            np.array([b[end], b[f"{end}_velocity"], zero]) for end in ("start", "end")
        ]

    def material(self):
        a0, a1, b0, b1 = self.motions()
        relative = a0 + self.s * (a1 - a0) - b0 - self.r * (b1 - b0)
        return ref.material_distance_derivatives(*relative)

    @property
    def sin2(self):
        e, f = self.segment["end"] - self.segment["start"], self.agent["end"] - self.agent["start"]
        return 1.0 - (e @ f) ** 2 / ((e @ e) * (f @ f))

    @property
    def inside(self):
        return int(0.0 < self.s < 1.0) + int(0.0 < self.r < 1.0)


def duels(rng, count):
    """Pairs at all distances, in penetration too, some of them with a point for an agent."""
    for case in range(count):
        duel = Duel(rng, d=rng.uniform(0.02, 0.8) if case % 3 else None)
        if case % 7 == 0:
            duel.agent["end"] = duel.agent["start"]
            duel.agent["end_velocity"] = duel.agent["start_velocity"]
            duel.measure()
        yield duel


def test_index_of_material_points_is_eq_6(times):
    """Without sliding: d', d'' and index of two axis points, surface distance squared with its sign."""
    rng = np.random.default_rng(1)
    for duel in duels(rng, 300 * times):
        if duel.distance + duel.radii < 2e-3:  # 1/d is held: another test
            continue
        phi, d_dot, d_ddot, _ = duel.evaluate(MATERIAL)
        d, expected_dot, expected_ddot = duel.material()
        assert duel.distance == pytest.approx(d - duel.radii, abs=1e-12)
        assert d_dot == pytest.approx(expected_dot, rel=1e-9, abs=1e-9)
        assert d_ddot == pytest.approx(expected_ddot, rel=1e-9, abs=1e-8)
        assert phi == pytest.approx(ref.phi(d, d_dot, d_ddot, duel.radii, *PARAMS), rel=1e-9, abs=1e-9)


def test_index_with_sliding_has_the_true_second_derivative(times):
    """The distance's own second derivative, the closest points moving along axes that are not parallel.

    Compared where the two guards are inactive: sin^2 of the angle above its floor, the term under its limit.
    """
    rng = np.random.default_rng(2)
    seen = {0: 0, 1: 0, 2: 0}
    for duel in duels(rng, 600 * times):
        if duel.distance + duel.radii < 2e-3:
            continue
        _, material_dot, material_ddot, _ = duel.evaluate(MATERIAL)
        d, expected_dot, expected_ddot = ref.sliding_derivatives(*duel.motions())
        term = material_ddot - expected_ddot
        if (duel.inside == 2 and duel.sin2 < 0.011) or term >= 0.999 * INDEX.sliding_limit:
            continue
        phi, d_dot, d_ddot, _ = duel.evaluate(INDEX)
        seen[duel.inside] += 1
        assert d_dot == material_dot
        assert d_dot == pytest.approx(expected_dot, rel=1e-9, abs=1e-9)
        assert d_ddot == pytest.approx(expected_ddot, rel=1e-6, abs=1e-6)
        assert phi == pytest.approx(ref.phi(d, d_dot, d_ddot, duel.radii, *PARAMS), rel=1e-9, abs=1e-9)
    assert min(seen.values()) >= 20 * times


def test_sliding_never_makes_the_pair_look_safer(times):
    """The term only lowers d'' and so only raises the index, up to its limit; near parallel axes too."""
    rng = np.random.default_rng(3)
    limited = floored = 0
    for case, duel in enumerate(duels(rng, 600 * times)):
        if case % 2:  # nearly parallel, the closest points inside both axes
            along = duel.segment["end"] - duel.segment["start"]
            aside = np.cross(along, rng.normal(size=3))
            middle = duel.segment["start"] + along / 2.0 + rng.uniform(0.05, 1.0) * aside
            tilted = along + 10.0 ** rng.uniform(-5.0, -0.5) * np.cross(aside, along)
            duel.agent["start"], duel.agent["end"] = middle - tilted, middle + tilted
            duel.measure()
        phi_material, _, material, _ = duel.evaluate(MATERIAL)
        phi, _, d_ddot, gradient = duel.evaluate(INDEX)
        assert np.all(np.isfinite([phi, d_ddot, *np.ravel(gradient)]))
        assert d_ddot <= material + 1e-12 * max(1.0, abs(material))
        assert d_ddot >= material - INDEX.sliding_limit - 1e-9
        assert phi >= phi_material - 1e-12 * max(1.0, abs(phi_material))
        limited += int(d_ddot <= material - INDEX.sliding_limit + 1e-9)
        floored += int(duel.inside == 2 and duel.sin2 < INDEX.sin2_floor)
    assert limited >= 50 * times
    assert floored >= 100 * times


def test_sliding_at_its_limit_and_under_its_floor():
    """Both guards do what they say: the term ends at its limit, and sin^2 counts as the floor at least."""
    rng = np.random.default_rng(4)
    checked = 0
    for duel in duels(rng, 300):
        _, _, material, _ = duel.evaluate(MATERIAL)
        _, _, exact, _ = duel.evaluate(EXACT)
        if material - exact > 1e-3:
            limit = 0.5 * (material - exact)
            _, _, cut, gradient = duel.evaluate(EXACT._replace(sliding_limit=limit))
            assert cut == pytest.approx(material - limit, rel=1e-12)
            np.testing.assert_array_equal(gradient, duel.evaluate(MATERIAL)[3])
        if duel.inside == 2 and material - exact > 1e-3:
            _, _, floored, _ = duel.evaluate(EXACT._replace(sin2_floor=4.0 * duel.sin2))
            assert material - floored == pytest.approx((material - exact) / 4.0, rel=1e-6)
            checked += 1
    assert checked >= 20


@FIXED
@given(st.floats(-0.6, 0.6), st.floats(1e-4, 0.3), st.integers(0, 1000))
def test_deeper_is_never_safer(distance, deeper, seed):
    """At rest the index grows as bodies come closer and go on growing in penetration: the signed square."""
    rng = np.random.default_rng(seed)
    duel = Duel(rng)
    for name in SEGMENT.names:
        if "velocity" in name or "acceleration" in name:
            duel.segment[name] = 0.0
    duel.agent["start_velocity"] = duel.agent["end_velocity"] = 0.0
    here = evaluate(duel.segment, duel.agent, duel.s, duel.r, distance, INDEX)[0]
    there = evaluate(duel.segment, duel.agent, duel.s, duel.r, distance - deeper, INDEX)[0]
    assert there > here
    assert (here > 0.0) == (distance < INDEX.d_min)


def test_crossing_axes_and_deep_penetration_stay_finite():
    """d = 0 has no direction and divides by zero; there the index is finite, unsafe for a body at rest."""
    rng = np.random.default_rng(5)
    for d in (0.0, 1e-320, 1e-15, 1e-10, 1e-9, 1e-6, 1e-4, 1e-3, 0.02):
        for _ in range(20):
            duel = Duel(rng, d=d)
            if d == 0.0:  # exactly: the agent's axis ends on the robot's, or is it
                duel.agent["start"] = duel.segment["start"]
                if rng.integers(2):
                    duel.agent["end"] = duel.segment["end"]
                duel.measure()
                assert duel.distance == -duel.radii
            phi, d_dot, d_ddot, gradient = duel.evaluate(INDEX)
            assert np.all(np.isfinite([phi, d_dot, d_ddot, *np.ravel(gradient)]))
            slow = IndexParams(lambda1=1.0, lambda2=1e-9).kernel()
            for name in ("start_velocity", "end_velocity"):
                duel.segment[name] = duel.agent[name] = 0.0
            assert duel.evaluate(slow)[0] > 0.0
            # the direction is a unit vector: the gradient by the acceleration is lambda2 long
            assert np.linalg.norm(gradient.acceleration) == pytest.approx(INDEX.lambda2, rel=1e-6)


def test_gradients_of_a_pair_are_those_of_finite_differences():
    """The derivatives of the index by position, velocity and acceleration of the axis points, one by one."""
    rng = np.random.default_rng(6)
    for duel in duels(rng, 40):
        if duel.distance + duel.radii < 5e-3:
            continue
        gradient = duel.evaluate(MATERIAL)[3]
        relative = [
            m0 + fraction * (m1 - m0)
            for (m0, m1), fraction in zip((duel.motions()[:2], duel.motions()[2:]), (duel.s, duel.r), strict=True)
        ]
        motion = relative[0] - relative[1]
        for order, name in enumerate(("position", "velocity", "acceleration")):
            for k in range(3):
                values = []
                for step in (1e-5, -1e-5):
                    moved = motion.copy()
                    moved[order, k] += step
                    values.append(ref.phi(*ref.material_distance_derivatives(*moved), duel.radii, *PARAMS))
                slope = (values[0] - values[1]) / 2e-5
                size = 1.0 + np.max(np.abs(getattr(gradient, name)))
                assert getattr(gradient, name)[k] == pytest.approx(slope, abs=1e-4 * size)
        assert gradient.turn == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("field", ["start", "end", "start_velocity", "end_velocity", "radius"])
def test_a_nan_agent_has_no_index(field, sliding):
    """A measurement that is no number gives no number: `if phi > 0` would call it safe."""
    rng = np.random.default_rng(7)
    for duel in duels(rng, 50):
        if field == "radius":
            duel.agent["radius"] = np.nan
        else:
            duel.agent[field][rng.integers(3)] = np.nan
        duel.measure()
        phi, _, _, _ = duel.evaluate(INDEX._replace(sliding=sliding))
        assert np.isnan(phi)


@pytest.mark.parametrize("name", ["start_velocity", "end_velocity", "start_acceleration", "end_acceleration"])
def test_a_nan_robot_motion_has_no_index(name):
    """The same on the robot's side."""
    rng = np.random.default_rng(8)
    for duel in duels(rng, 50):
        duel.segment[name][rng.integers(3)] = np.nan
        assert np.isnan(duel.evaluate(INDEX)[0])


# ---- the arm among people --------------------------------------------------------------------------------


def people(rng, closest=0.45, farthest=1.2):
    """The paper's human, somewhere around the arm on its table, every limb with a velocity of its own."""
    agents = np.zeros(6, AGENT)
    angle, reach = rng.uniform(-1.5, 1.5), rng.uniform(closest, farthest)
    root = np.array([reach * np.cos(angle), reach * np.sin(angle), -0.87])
    for agent, (_, start, end, radius) in zip(agents, ref.HUMAN_CAPSULES, strict=True):
        agent["start"], agent["end"], agent["radius"] = root + start, root + end, radius
        agent["start_velocity"] = rng.normal(size=3)
        agent["end_velocity"] = agent["start_velocity"]
        if start != end:
            agent["end_velocity"] += 0.5 * rng.normal(size=3)
    return agents


def planes_of(*rows):
    planes = np.zeros(len(rows), PLANE)
    for plane, (normal, offset) in zip(planes, rows, strict=True):
        plane["normal"], plane["offset"] = np.array(normal) / np.linalg.norm(normal), offset
    return planes


def random_state(rng, speed=0.5):
    return np.array([rng.uniform(-1.0, 1.0, 6), speed * rng.normal(size=6), 3.0 * rng.normal(size=6)])


def look_ahead(state, jerk, agents, index, planes=NO_PLANES, tau=TAU):
    """One step ahead, as a filter does it: the agents are advanced once, then the arm is assessed."""
    agents = agents.copy()
    advance(agents, tau)
    after, frames, segments = np.zeros((3, 6)), np.zeros(6, FRAME), np.zeros(5, SEGMENT)
    pairs = np.zeros((5, len(agents) + len(planes)), PAIR)
    pairs[:] = (7.0, 7.0, 7.0, 7.0)
    worst = assess(ROBOT.links, ROBOT.capsules, state, jerk, agents, planes, tau, index, after, frames, segments, pairs)
    return SimpleNamespace(
        agents=agents,
        after=after,
        frames=frames,
        segments=segments,
        pairs=pairs,
        planes=planes,
        worst=worst,
        jerk=jerk,
        index=index,
        tau=tau,
    )


def rows_of(step, lower, upper, only=-1, authority=0.0, above=-np.inf):
    """L, S and the owners of the exact rows."""
    count = step.pairs.size
    L, S, owner = np.full((count, 6), np.nan), np.full(count, np.nan), np.full(count, -1, np.int64)
    used = exact_rows(
        step.frames,
        step.segments,
        step.agents,
        step.planes,
        step.pairs,
        step.jerk,
        lower,
        upper,
        step.tau,
        step.index,
        only,
        above,
        (upper - lower) / 2.0,
        authority,
        0.0,
        step.pairs,
        L,
        S,
        owner,
        np.zeros(count),
    )
    return L[:used], S[:used], owner[:used]


def between(values):
    """A number between the two middle values."""
    middle = len(values) // 2
    return float(np.mean(np.sort(values)[middle - 1 : middle + 1]))


def row_of(step, i, j):
    """The row of one pair; zero where there is none because no jerk of an endless box could violate it."""
    pair = i * step.pairs.shape[1] + j
    L, S, owner = rows_of(step, -ENDLESS, ENDLESS, only=pair)
    if len(owner) == 0:
        assert step.pairs.ravel()[pair]["phi"] <= 0.0
        return np.zeros(6), step.pairs.ravel()[pair]["phi"]
    assert list(owner) == [pair]
    return L[0], S[0]


def reference_arguments(state, jerk, agents, i, j, tau=TAU):
    """The leading arguments of the reference's phi_after for robot capsule i and agent j."""
    _, link, start, end, radius = ref.LR_MATE_CAPSULES[i]
    agent = agents[j]
    return (
        CHAIN,
        *state,
        jerk,
        tau,
        link,
        start,
        end,
        agent["start"],
        agent["end"],
        agent["start_velocity"],
        agent["end_velocity"],
        radius + agent["radius"],
        PARAMS,
    )


def test_advance_moves_agents_by_their_velocities():
    """People are where they will be at the end: each end by its own velocity, radius unchanged."""
    agents = people(np.random.default_rng(9))
    before = agents.copy()
    advance(agents, TAU)
    for end in ("start", "end"):
        expected = before[end] + TAU * before[f"{end}_velocity"]
        np.testing.assert_allclose(agents[end], expected, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(agents[f"{end}_velocity"], before[f"{end}_velocity"])
    np.testing.assert_array_equal(agents["radius"], before["radius"])


@pytest.mark.parametrize("sliding", [False, True])
def test_assess_is_the_index_after_the_step(sliding, times):
    """phi(x_{k+1}) of every pair, from the arm's true motion, people at constant velocity."""
    rng = np.random.default_rng(10)
    index = EXACT if sliding else MATERIAL
    for _ in range(5 * times):
        state, jerk, agents = random_state(rng, 1.0), rng.uniform(-JERK, JERK), people(rng)
        step = look_ahead(state, jerk, agents, index)
        np.testing.assert_allclose(step.after, ref.triple_integrator(*state, jerk, TAU), rtol=1e-13, atol=1e-13)
        for i, j in np.ndindex(5, 6):
            arguments = reference_arguments(state, jerk, agents, i, j)
            expected = ref.phi_after(*arguments, sliding)
            assert step.pairs[i, j]["phi"] == pytest.approx(expected, rel=1e-7, abs=1e-8)
        phi, row, column = step.worst
        assert phi == step.pairs["phi"].max() == step.pairs[row, column]["phi"]


@pytest.mark.parametrize("field", ["start", "end", "start_velocity", "end_velocity", "radius"])
def test_a_nan_agent_makes_the_worst_index_nan(field):
    """Among many harmless pairs the one that is no number wins, and it makes a row that nobody can keep."""
    rng = np.random.default_rng(11)
    for case in range(30):
        agents = people(rng)
        bad = case % 6
        if field == "radius":
            agents[bad]["radius"] = np.nan
        else:
            agents[bad][field][rng.integers(3)] = np.nan
        step = look_ahead(random_state(rng), np.zeros(6), agents, INDEX)
        phi, row, column = step.worst
        assert np.isnan(phi)
        assert column == bad
        L, S, owner = rows_of(step, -JERK, JERK, only=row * 6 + column, authority=1.0)
        assert list(owner) == [row * 6 + column]
        assert np.isnan(S[0])
        assert not np.all(S - L @ np.zeros(6) <= 0.0)


def test_a_nan_joint_state_makes_the_worst_index_nan():
    """A joint state that is no number must not look safe either."""
    rng = np.random.default_rng(12)
    for row in range(3):
        for joint in range(5):  # the last joint carries no capsule
            state = random_state(rng)
            state[row, joint] = np.nan
            assert np.isnan(look_ahead(state, np.zeros(6), people(rng), INDEX).worst[0])
    jerk = np.zeros(6)
    jerk[3] = np.nan
    assert np.isnan(look_ahead(random_state(rng), jerk, people(rng), INDEX).worst[0])


def test_nothing_around_is_safe():
    """Without agents and planes there is no pair and no row."""
    step = look_ahead(random_state(np.random.default_rng(13)), np.zeros(6), np.zeros(0, AGENT), INDEX)
    assert step.worst == (-np.inf, -1, -1)
    assert len(rows_of(step, -JERK, JERK)[0]) == 0


@pytest.mark.long
def test_row_of_a_frozen_pair_is_the_true_gradient(times):
    """L is minus the derivative of phi(x_{k+1}) by the jerks, all of J, J' and J'' included, to 1e-6."""
    rng = np.random.default_rng(14)
    for case in range(20 * times):
        state, jerk, agents = random_state(rng, 1.0), rng.uniform(-JERK, JERK), people(rng)
        step = look_ahead(state, jerk, agents, MATERIAL)
        i, j = case % 5, int(rng.integers(6))
        pair = step.pairs[i, j]
        if pair["distance"] + step.segments[i]["radius"] + agents[j]["radius"] < 2e-3:
            continue
        L, S = row_of(step, i, j)
        arguments = reference_arguments(state, jerk, agents, i, j)
        expected = ref.row_by_differences(*arguments, False, (pair["s"], pair["r"]))
        assert np.max(np.abs(L - expected)) <= 1e-6 * np.max(np.abs(expected)) + 1e-15
        assert S - L @ jerk == pytest.approx(pair["phi"], abs=1e-12 * max(1.0, np.abs(L) @ np.abs(jerk)))


def rows_by_kind(rng, kinds, count, tau=TAU):
    """(row, difference row) of pairs whose closest points are inside `kinds` axes and stay of that kind."""
    while count:
        state, jerk, agents = random_state(rng), rng.uniform(-JERK, JERK), people(rng)
        step = look_ahead(state, jerk, agents, INDEX, tau=tau)
        material = look_ahead(state, jerk, agents, MATERIAL, tau=tau)
        for i, j in (divmod(k, 6) for k in rng.permutation(30)):
            pair = step.pairs[i, j]
            s, r = pair["s"], pair["r"]
            inside = int(0.0 < s < 1.0) + int(0.0 < r < 1.0)
            margin = min(min(x, 1.0 - x) for x in (s, r) if 0.0 < x < 1.0) if inside else 1.0
            term = (pair["phi"] - material.pairs[i, j]["phi"]) / INDEX.lambda2
            e = step.segments[i]["end"] - step.segments[i]["start"]
            f = step.agents[j]["end"] - step.agents[j]["start"]
            parallel = inside == 2 and np.linalg.norm(np.cross(e, f)) ** 2 < 0.02 * (e @ e) * (f @ f)
            close = pair["distance"] + step.segments[i]["radius"] + agents[j]["radius"] < 0.1
            if i == 0 or inside not in kinds or margin < 0.01 or term > 19.0 or parallel or close:
                continue
            arguments = reference_arguments(state, jerk, agents, i, j, tau)
            yield row_of(step, i, j)[0], ref.row_by_differences(*arguments, True)
            count -= 1
            break


def test_row_of_an_end_pair_is_the_true_gradient(times):
    """Closest points at two ends do not slide: the row is exact to 1e-6."""
    for L, expected in rows_by_kind(np.random.default_rng(15), (0,), 15 * times):
        assert np.max(np.abs(L - expected)) <= 1e-6 * np.max(np.abs(expected))


@pytest.mark.long
def test_row_of_a_sliding_pair_is_the_gradient_to_order_tau(times):
    """Closest points inside an axis slide with the jerk, too, and the row leaves out how far.

    Its sliding term is differentiated by the velocities only (tau^2/2); that the closest points, b and H move
    with the positions is of order tau^3, against the leading tau: relative order tau^2.
    Measured at tau = 8 ms, joint speeds of 0.5 rad/s, d >= 0.1 m, 400 pairs, relative to the largest entry:
    median 1.1e-4, 95 % 1.1e-3, largest 5.1e-3; a quarter of the step makes it a sixteenth.
    """
    errors = {}
    for tau in (TAU, TAU / 4.0):
        rows = rows_by_kind(np.random.default_rng(16), (1, 2), 25 * times, tau)
        errors[tau] = np.array([np.max(np.abs(L - row)) / np.max(np.abs(row)) for L, row in rows])
    assert errors[TAU].max() <= 2e-2
    assert np.median(errors[TAU]) <= 5e-4
    assert np.median(errors[TAU / 4.0]) <= np.median(errors[TAU]) / 8.0


@pytest.mark.long
def test_plane_rows_against_differences():
    """Rows of half-spaces: index of the lowest point, slope by differences, none for the column on a level one."""
    rng, leaning = np.random.default_rng(17), 0
    for case in range(10):
        state, jerk = random_state(rng, 1.0), rng.uniform(-JERK, JERK)
        normal = (0.0, 0.0, 1.0) if case % 2 else rng.normal(size=3)
        planes = planes_of((normal, rng.uniform(-0.5, 0.5)), (rng.normal(size=3), -0.3))
        step = look_ahead(state, jerk, people(rng)[:2], INDEX, planes)
        for i, k in np.ndindex(5, 2):
            pair = step.pairs[i, 2 + k]
            if i == 0 and k == 0 and case % 2:
                assert pair["distance"] == np.inf
                assert pair["phi"] == -np.inf
                continue
            _, link, start, end, radius = ref.LR_MATE_CAPSULES[i]
            plane = planes[k]

            def index(u, k=k, link=link, start=start, end=end, radius=radius, plane=plane, state=state):
                later = ref.triple_integrator(*state, u, TAU)
                motions = [
                    [plane["normal"] @ x for x in ref.point_motion(CHAIN, *later, np.zeros(6), link, local)]
                    for local in (start, end)
                ]
                height, rate, acceleration, _ = min(motions)
                return ref.phi(height - plane["offset"], rate, acceleration, radius, *PARAMS)

            assert pair["phi"] == pytest.approx(index(jerk), rel=1e-9, abs=1e-9)
            L, S = row_of(step, i, 2 + k)
            slope = np.array([(index(jerk + 4.0 * e) - index(jerk - 4.0 * e)) / 8.0 for e in np.eye(6)])
            assert np.max(np.abs(L + slope)) <= 1e-6 * np.max(np.abs(slope)) + 1e-12
            assert S - L @ jerk == pytest.approx(pair["phi"], abs=1e-9)
        owners = {divmod(owner, 4) for owner in rows_of(step, -ENDLESS, ENDLESS)[2]}
        assert case % 2 == 0 or (0, 2) not in owners
        leaning += len({(0, 2), (0, 3)} & owners)
    assert leaning > 0


def test_plane_evaluation_has_no_curvature():
    """A half-space is flat: d'' is the acceleration along the normal, the square is signed."""
    rng = np.random.default_rng(18)
    for _ in range(50):
        duel, plane = Duel(rng), planes_of((rng.normal(size=3), 0.1))[0]
        distance, s = rng.normal(), float(rng.integers(2))
        phi, d_dot, d_ddot, gradient = evaluate_plane(duel.segment, plane, s, distance, INDEX)
        end = "end" if s == 1.0 else "start"
        assert d_dot == pytest.approx(plane["normal"] @ duel.segment[f"{end}_velocity"], abs=1e-12)
        assert d_ddot == pytest.approx(plane["normal"] @ duel.segment[f"{end}_acceleration"], abs=1e-12)
        assert phi == pytest.approx(ref.phi(distance, d_dot, d_ddot, 0.0, *PARAMS), abs=1e-12)
        np.testing.assert_allclose(gradient.position, -2.0 * abs(distance) * plane["normal"], atol=1e-12)


def test_pruning_is_exact(times):
    """A pair without a row cannot be violated by any jerk of the box, as far as its linearisation goes.

    The largest value of a linear index over a box is at a corner; random jerks and corners are tried as well.
    Conversely every row that is made can be violated.
    """
    rng = np.random.default_rng(19)
    pruned = kept = 0
    for _ in range(30 * times):
        state, jerk, agents = random_state(rng), rng.uniform(-JERK, JERK), people(rng, 0.5, 2.5)
        lower, upper = -JERK * rng.uniform(0.1, 1.0, 6), JERK * rng.uniform(0.1, 1.0, 6)
        step = look_ahead(state, jerk, agents, INDEX, planes_of(((0, 0, 1), -0.05)))
        L, S, owner = rows_of(step, lower, upper)
        assert 6 not in owner  # the base column stands on the table
        for pair in range(step.pairs.size):
            if pair == 6:
                continue
            row, right = row_of(step, *divmod(pair, 7))
            candidates = np.vstack(
                [
                    np.where(row > 0.0, lower, upper),
                    np.where(rng.integers(2, size=(10, 6)), lower, upper),
                    rng.uniform(lower, upper, (10, 6)),
                ]
            )
            largest = np.max(right - candidates @ row)
            size = 1e-12 * (abs(right) + np.abs(row) @ JERK)
            if pair in owner:
                kept += 1
                assert largest > -size
                k = list(owner).index(pair)
                np.testing.assert_array_equal(L[k], row)
                assert S[k] == right
            else:
                pruned += 1
                assert largest <= size
    assert pruned >= 200
    assert kept >= 100


def test_rows_without_authority_and_the_only_row():
    """Pairs that no jerk moves make no row; `only` asks for a single pair and gets that one."""
    rng = np.random.default_rng(20)
    for _ in range(20):
        step = look_ahead(random_state(rng), np.zeros(6), people(rng, 0.5, 0.8), INDEX._replace(d_min=1.5))
        every_L, _, every_owner = rows_of(step, -JERK, JERK)
        span = np.abs(every_L) @ JERK
        authority = between(span)
        _, _, owner = rows_of(step, -JERK, JERK, authority=authority)
        assert set(owner) == set(every_owner[span >= authority])
        for pair in every_owner[:5]:
            L, _, owner = rows_of(step, -JERK, JERK, only=int(pair))
            assert list(owner) == [pair]
            np.testing.assert_array_equal(L[0], every_L[list(every_owner).index(pair)])


def test_crossing_axes_still_make_finite_rows():
    """A person inside the arm: d = 0, and the rows are numbers all the same."""
    rng = np.random.default_rng(21)
    for _ in range(20):
        state = random_state(rng)
        agents = people(rng)
        step = look_ahead(state, np.zeros(6), agents, INDEX)
        for i, agent in enumerate(agents[:5]):  # each through the middle of one robot capsule, after the step
            middle = (step.segments[i]["start"] + step.segments[i]["end"]) / 2.0
            across = rng.normal(size=3)
            agent["start"] = middle - across - TAU * agent["start_velocity"]
            agent["end"] = middle + across - TAU * agent["end_velocity"]
        step = look_ahead(state, np.zeros(6), agents, INDEX)
        assert np.all(np.diag(step.pairs["distance"]) < -0.06)
        L, S, _ = rows_of(step, -JERK, JERK)
        assert np.all(np.isfinite(L))
        assert np.all(np.isfinite(S))
        assert np.isfinite(step.worst[0])


# ---- the row as printed ----------------------------------------------------------------------------------


def present(state, agents):
    """The arm and its pairs now: what the printed row is made from."""
    frames, segments, pairs = np.zeros(6, FRAME), np.zeros(5, SEGMENT), np.zeros((5, len(agents)), PAIR)
    closest = measure_present(ROBOT.links, ROBOT.capsules, state, agents, frames, segments, pairs)
    return SimpleNamespace(frames=frames, segments=segments, pairs=pairs, closest=closest, agents=agents)


def surface_delta(state, now, i, j):
    """Delta of Eq. (11) for the closest surface points, and J of the robot's, by the reference."""
    _, link, start, end, radius = ref.LR_MATE_CAPSULES[i]
    pair, agent = now.pairs[i, j], now.agents[j]
    on_axis = np.add(start, pair["s"] * np.subtract(end, start))
    rotation = ref.link_poses(CHAIN, state[0])[link][:3, :3]
    axis = ref.point(CHAIN, state[0], link, on_axis)
    human, human_velocity = (
        agent[f"start{name}"] + pair["r"] * (agent[f"end{name}"] - agent[f"start{name}"]) for name in ("", "_velocity")
    )
    normal = (axis - human) / np.linalg.norm(axis - human)
    local = on_axis - radius * (rotation.T @ normal)
    p, v, a, j0 = ref.point_motion(CHAIN, *state, np.zeros(6), link, local)
    later = p + TAU * v + TAU**2 / 2 * a + TAU**3 / 6 * j0, v + TAU * a + TAU**2 / 2 * j0, a + TAU * j0
    surface = human + agent["radius"] * normal + TAU * human_velocity
    delta = (later[0] - surface, later[1] - human_velocity, later[2])
    return delta, ref.jacobian(CHAIN, state[0], link, local)


def printed(now, i, j):
    row, pair = np.full(6, np.nan), now.pairs[i, j]
    S, d = printed_row(now.frames, now.segments[i], now.agents[j], pair["s"], pair["r"], TAU, INDEX, row)
    return row, S, d


def test_printed_row_is_eq_13_to_the_letter(times):
    """The paper's own row is reproduced, mistakes included, so that results can be compared."""
    rng = np.random.default_rng(22)
    checked = 0
    while checked < 60 * times:
        state, agents = random_state(rng, 1.0), people(rng)
        now = present(state, agents)
        i, j = int(rng.integers(5)), int(rng.integers(6))
        if now.pairs[i, j]["distance"] < 0.05:
            continue
        delta, J = surface_delta(state, now, i, j)
        L, S = ref.printed_row(*delta, J, TAU, *PARAMS)
        found, right, d = printed(now, i, j)
        np.testing.assert_allclose(found, L, rtol=1e-9, atol=1e-12 * np.max(np.abs(L)))
        assert right == pytest.approx(S, rel=1e-9, abs=1e-9)
        assert d == pytest.approx(np.linalg.norm(delta[0]), rel=1e-12)
        checked += 1


def test_printed_rows_are_the_printed_row_over_d():
    """In square metres like the exact rows; authority prunes, nothing else."""
    rng = np.random.default_rng(23)
    for _ in range(10):
        state, agents = random_state(rng), people(rng, 0.8, 1.2)
        now = present(state, agents)
        row, column, distance = now.closest
        assert distance == now.pairs["distance"].min() == now.pairs[row, column]["distance"]
        L, S, owner = np.full((30, 6), np.nan), np.full(30, np.nan), np.full(30, -1, np.int64)

        def rows(only, authority, now=now, L=L, S=S, owner=owner):
            return printed_rows(
                now.frames,
                now.segments,
                now.agents,
                now.pairs,
                -JERK,
                JERK,
                TAU,
                INDEX,
                only,
                authority,
                L,
                S,
                owner,
            )

        assert rows(-1, 0.0) == 30
        spans = []
        for i, j in np.ndindex(5, 6):
            expected, right, d = printed(now, i, j)
            k = list(owner).index(i * 6 + j)
            np.testing.assert_allclose(L[k], expected / d, rtol=1e-12, atol=1e-18)
            assert S[k] == pytest.approx(right / d, rel=1e-12)
            spans.append(np.abs(expected / d) @ JERK)
        authority = between(spans)
        used = rows(-1, authority)
        assert set(owner[:used]) == set(np.flatnonzero(np.array(spans) >= authority))
        assert rows(13, 0.0) == 1
        assert owner[0] == 13


def test_printed_row_is_twice_the_true_gradient(times):
    """T1: a fact about Eq. (13), not a feature. U2 and U4 are not symmetric, so its L is twice the gradient.

    Where the robot has to be pushed away (S > 0) half of what is needed is asked for. Compared with the
    exact rows of the same pair: leading terms agree whatever the radii, the rest is of order tau |v| / d.
    """
    rng = np.random.default_rng(24)
    ratios = []
    while len(ratios) < 200 * times:
        state, agents = random_state(rng, 0.2), people(rng, 0.6, 1.2)
        for name in ("start_velocity", "end_velocity"):
            agents[name] *= 0.3
        now = present(state, agents)
        step = look_ahead(state, np.zeros(6), agents, MATERIAL)
        i, j = int(rng.integers(2, 5)), int(rng.integers(6))
        if now.pairs[i, j]["distance"] < 0.1:
            continue
        L, _, d = printed(now, i, j)
        exact, _ = row_of(step, i, j)
        ratios.append((L / d) @ exact / (exact @ exact))
    assert abs(np.median(ratios) - 2.0) <= 0.02
    assert np.quantile(np.abs(np.array(ratios) - 2.0), 0.95) <= 0.1


def test_printed_row_is_finite_at_contact_and_nan_for_nan():
    """Eq. (13) divides by the surface distance; at contact the axis direction takes over. NaN stays NaN."""
    rng = np.random.default_rng(25)
    for _ in range(20):
        state, agents = random_state(rng), people(rng, 0.2, 0.4)
        now = present(state, agents)
        for k, agent in enumerate(agents[:5]):
            middle = (now.segments[k]["start"] + now.segments[k]["end"]) / 2.0
            agent["start"], agent["end"] = middle - agent["start"], middle + agent["start"]
        now = present(state, agents)
        for i, j in np.ndindex(5, 6):
            L, S, d = printed(now, i, j)
            assert np.all(np.isfinite([*L, S, d]))
            assert d >= 1e-3
        agents[2]["start"][1] = np.nan
        now = present(state, agents)
        assert np.isnan(now.closest[2])
        assert now.closest[1] == 2
        assert np.isnan(printed(now, 3, 2)[1])


# ---- parameters ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["d_min", "lambda1", "lambda2", "sliding_limit", "sin2_floor"])
@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf, "1", None])
def test_bad_parameters_are_refused_by_name(name, bad):
    """An index without positive, finite parameters protects nothing."""
    with pytest.raises(ParameterError, match=f"{name} has to be a positive number"):
        IndexParams(**{name: bad})


def test_parameters_that_keep_no_distance_are_refused():
    """lambda1^2 >= 8 lambda2 d_min: below that an approach can oscillate across d_min while phi <= 0."""
    with pytest.raises(ParameterError, match="lambda1² has to be at least 8 lambda2 d_min"):
        IndexParams(d_min=0.2, lambda1=1.0, lambda2=1.0)
    IndexParams(d_min=0.125, lambda1=1.0, lambda2=1.0)
    assert IndexParams(lambda1=3.0, lambda2=1.0).has_real_roots
    assert not IndexParams(lambda1=1.25, lambda2=0.5).has_real_roots
    params = IndexParams(0.06, 2.0, 0.5, sliding=False, sliding_limit=7.0, sin2_floor=0.02)
    kernel = params.kernel()._asdict()
    assert kernel == {name: getattr(params, name) for name in kernel}
    assert index_of(params.array()) == params.kernel()  # no two numbers change places on the way
    assert index_of(IndexParams(sliding=True).array()).sliding
