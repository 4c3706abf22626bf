"""Distances of capsules and half-spaces: right, symmetric, and NaN never reads as far away."""

import mujoco
import numpy as np
import pytest
import reference as ref
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from jssa_gym.kernels.capsules import (
    capsule_pair,
    closest_points,
    measure_agents,
    measure_planes,
    measure_self,
    nearest,
    plane_pair,
)
from jssa_gym.kernels.records import AGENT, PAIR, PLANE, SEGMENT
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.safety.proximity import measure
from jssa_gym.types import CapsuleSet, JointState, Planes

FIXED = settings(deadline=None, derandomize=True, database=None, max_examples=300)

# A coarse grid makes points, parallel, collinear, touching and crossing segments common; two decimals keep
# the angles of the others above the one under which two segments count as parallel.
coordinate = st.one_of(st.sampled_from([-1.0, -0.5, 0.0, 0.5, 1.0]), st.floats(-1.0, 1.0).map(lambda x: round(x, 2)))
points = st.lists(coordinate, min_size=12, max_size=12).map(lambda x: np.array(x).reshape(4, 3))
scales = st.sampled_from([1e-9, 1e-3, 1.0, 1e3])

X, Y, Z = np.eye(3)
O = np.zeros(3)  # noqa: E741
DEGENERATE = {
    "two points": (O, O, Y, Y, 1.0),
    "same point": (O, O, O, O, 0.0),
    "point and segment": (Y / 2, Y / 2, -X, X, 0.5),
    "segment and point beyond its end": (-X, X, 2 * X, 2 * X, 1.0),
    "parallel, overlapping": (O, 2 * X, X + Y, 3 * X + Y, 1.0),
    "parallel, opposite": (O, 2 * X, 3 * X + Y, X + Y, 1.0),
    "parallel, apart": (O, X, 4 * X + 4 * Y, 5 * X + 4 * Y, 5.0),
    "collinear, disjoint": (O, X, 3 * X, 4 * X, 2.0),
    "collinear, overlapping": (O, 2 * X, X, 3 * X, 0.0),
    "collinear, nested": (O, 4 * X, X, 2 * X, 0.0),
    "coincident": (O, X, O, X, 0.0),
    "coincident, reversed": (O, X, X, O, 0.0),
    "crossing": (-X, X, -Y, Y, 0.0),
    "crossing obliquely": (-X, X, -X - Y, X + Y, 0.0),
    "touching at ends": (O, X, X, X + Y, 0.0),
    "end on the inside": (O, 2 * X, X, X + Y, 0.0),
    "skew": (-X, X, Z - Y, Z + Y, 1.0),
    "nearest at two ends": (O, X, 4 * X + 4 * Y, 4 * X + 5 * Y, 5.0),
}


@pytest.fixture(params=[1, pytest.param(100, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


def check(a, b, c, d, scale):
    """The pair lies on both segments, has the distance it claims, and none is closer."""
    distance, s, r = capsule_pair(a, b, c, d, 0.0)
    assert 0.0 <= s <= 1.0
    assert 0.0 <= r <= 1.0
    assert abs(np.linalg.norm(a + s * (b - a) - c - r * (d - c)) - distance) <= 1e-12 * scale
    expected = ref.segment_distance(a, b, c, d)[0]
    assert distance <= expected + 1e-12 * scale
    assert distance >= expected - 1e-9 * scale


def symmetric(a, b, c, d, scale):
    distance = capsule_pair(a, b, c, d, 0.0)[0]
    for other in ((c, d, a, b), (b, a, c, d), (a, b, d, c), (d, c, b, a)):
        assert abs(capsule_pair(*other, 0.0)[0] - distance) <= 1e-12 * scale


@pytest.mark.long
@FIXED
@given(points, scales)
def test_distance_of_segments_is_the_smallest(ends, scale):
    """Every protective distance rests on this number: no pair of axis points may be closer than it says."""
    check(*(ends * scale), scale)


@FIXED
@given(points, scales)
def test_distance_does_not_depend_on_the_order(ends, scale):
    """Robot against human is human against robot, and a capsule has no first end."""
    symmetric(*(ends * scale), scale)


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_segments(name):
    """Points, parallel, crossing, coincident and nested axes have their textbook distance at every scale."""
    *ends, expected = DEGENERATE[name]
    for scale in (1e-9, 1.0, 1e3):
        scaled = [scale * end for end in ends]
        distance = capsule_pair(*scaled, 0.0)[0]
        assert abs(distance - scale * expected) <= 1e-12 * scale
        check(*scaled, scale)
        symmetric(*scaled, scale)


def test_random_segments_of_many_lengths(times):
    """As above in bulk, lengths from a nanometre to a kilometre mixed in one pair."""
    rng = np.random.default_rng(1)
    for _ in range(1000 * times):
        ends = rng.normal(size=(4, 3))
        lengths = 10.0 ** rng.choice([-9.0, -3.0, 0.0, 3.0], 2)
        ends[1] = ends[0] + lengths[0] * ends[1]
        ends[3] = ends[2] + lengths[1] * ends[3]
        scale = max(1.0, *lengths)
        check(*ends, scale)
        symmetric(*ends, scale)


def test_nearly_parallel_segments_lose_at_most_a_micrometre_a_metre():
    """Below an angle of 1e-6 rad axes count as parallel; the distance is too large by that width at most."""
    rng = np.random.default_rng(2)
    for _ in range(1000):
        a, c = rng.normal(size=(2, 3))
        e = rng.normal(size=3)
        f = e + 10.0 ** rng.uniform(-13.0, -4.0) * rng.normal(size=3)
        b, d = a + e, c + f * rng.choice([-1.0, 1.0])
        length = np.linalg.norm(e)
        distance = capsule_pair(a, b, c, d, 0.0)[0]
        expected = ref.segment_distance(a, b, c, d)[0]
        assert distance <= expected + 1.1e-6 * length


def test_nearly_parallel_segments_are_symmetric():
    """Turning a capsule round must not move the distance, not even between nearly parallel axes."""
    symmetric(O, X, 0.1 * Y, X + (0.1 - 5e-7) * Y, 1.0)


@pytest.mark.long
@FIXED
@given(points, st.floats(0.0, 0.5), st.floats(0.0, 0.5))
def test_radii_are_taken_off_once(ends, a_radius, b_radius):
    """The surface distance is the axis distance less both radii, negative in penetration."""
    distance, s, r = capsule_pair(*ends, a_radius + b_radius)
    expected = ref.capsule_distance(ends[0], ends[1], a_radius, ends[2], ends[3], b_radius)
    assert abs(distance - expected) <= 1e-9
    assert (s, r) == tuple(closest_points(*ends))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", ["skew", "two points", "point and segment", "parallel, overlapping", "crossing"])
def test_a_coordinate_that_is_no_number_never_gives_a_distance(kind, bad):
    """A broken measurement never reads as far away: the result is not finite, and nothing is raised."""
    ends = np.array(DEGENERATE[kind][:4])
    for index in np.ndindex(4, 3):
        broken = ends.copy()
        broken[index] = bad
        with np.errstate(invalid="ignore"):  # numpy warns where kernels run uncompiled
            distance, _, _ = capsule_pair(*broken, 0.2)
        if np.isnan(bad):
            assert np.isnan(distance)
        else:
            # inf - inf is NaN; a point at infinity may also truly be infinitely far
            assert not np.isfinite(distance)
    assert np.isnan(capsule_pair(*ends, np.nan)[0])


CAPSULES = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body><freejoint/><geom type="capsule" size=".05 .2"/></body>
    <body><freejoint/><geom type="capsule" size=".05 .2"/></body>
  </worldbody>
</mujoco>
"""


class Simulator:
    """Two capsules and a floor, put where we want them, measured by MuJoCo."""

    def __init__(self):
        self.model = mujoco.MjModel.from_xml_string(CAPSULES)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)

    def put(self, geom, start, end, radius):
        half = np.linalg.norm(end - start) / 2.0
        z = (end - start) / (2.0 * half) if half > 0.0 else np.array([0.0, 0.0, 1.0])
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        self.data.geom_xpos[geom] = (start + end) / 2.0
        self.data.geom_xmat[geom] = np.column_stack([x, np.cross(z, x), z]).ravel()
        self.model.geom_size[geom] = (radius, half, 0.0)

    def distance(self, one, two):
        return mujoco.mj_geomDistance(self.model, self.data, one, two, 1e4, None)


def test_capsule_distance_agrees_with_mujoco(times):
    """A second, foreign implementation measures the same distances, in penetration too."""
    simulator = Simulator()
    rng = np.random.default_rng(3)
    overlapping = 0
    for _ in range(500 * times):
        ends = rng.normal(size=(4, 3)) * rng.choice([0.1, 0.5, 2.0])
        kind = rng.integers(0, 6)
        if kind == 0:  # a sphere
            ends[1] = ends[0]
        elif kind == 1:  # parallel
            ends[3] = ends[2] + rng.normal() * (ends[1] - ends[0])
        elif kind == 2:  # collinear
            ends[2:] = ends[0] + rng.normal(size=(2, 1)) * (ends[1] - ends[0])
        radii = rng.uniform(0.02, 0.3, 2)
        simulator.put(1, ends[0], ends[1], radii[0])
        simulator.put(2, ends[2], ends[3], radii[1])
        distance = capsule_pair(*ends, radii.sum())[0]
        assert abs(distance - simulator.distance(1, 2)) <= 1e-6
        overlapping += distance < 0.0
    assert overlapping >= 50


def plane_record(normal, offset):
    planes = np.zeros(1, PLANE)
    planes[0]["normal"], planes[0]["offset"] = normal, offset
    return planes


def test_half_space_distance(times):
    """Table and floor: the lowest point of the capsule counts, whichever end it is; MuJoCo's plane agrees."""
    simulator = Simulator()
    rng = np.random.default_rng(4)
    for _ in range(300 * times):
        start, end, normal = rng.normal(size=(3, 3))
        normal /= np.linalg.norm(normal)
        radius, offset = rng.uniform(0.02, 0.3), rng.normal()
        distance, s = plane_pair(start, end, radius, plane_record(normal, offset)[0])
        assert abs(distance - ref.plane_distance(start, end, radius, normal, offset)) <= 1e-12
        lowest = start + s * (end - start)
        assert s in (0.0, 1.0)
        assert abs(normal @ lowest - offset - radius - distance) <= 1e-12
        floor, _ = plane_pair(start, end, radius, plane_record(Z, 0.0)[0])
        simulator.put(1, start, end, radius)
        assert abs(floor - simulator.distance(0, 1)) <= 1e-6


@pytest.mark.parametrize(
    "where",
    [
        "start",
        "end",
    ],
)
def test_a_nan_end_has_no_height_over_a_plane(where):
    """An end that is no number must not hide behind the other end."""
    plane = plane_record(Z, 0.0)[0]
    for k in range(3):
        ends = {"start": X + Z, "end": Y + 2.0 * Z}
        ends[where] = ends[where].copy()
        ends[where][k] = np.nan
        for start, end in ((ends["start"], ends["end"]), (ends["start"], ends["end"] - 3.0 * Z)):
            assert np.isnan(plane_pair(start, end, 0.1, plane)[0])


def pairs_of(distances):
    pairs = np.zeros(np.shape(distances), PAIR)
    pairs["distance"] = distances
    return pairs


@FIXED
@given(st.lists(st.floats(-5.0, 5.0), min_size=6, max_size=6), st.integers(0, 3))
def test_nearest_is_the_smallest_of_the_first_columns(values, columns):
    """The closest pair is what the paper's single row protects; columns behind the agents do not count."""
    distances = np.array(values).reshape(2, 3)
    row, column, smallest = nearest(pairs_of(distances), columns)
    if columns == 0:
        assert (row, column, smallest) == (-1, -1, np.inf)
    else:
        assert smallest == distances[:, :columns].min() == distances[row, column]
        assert column < columns


@FIXED
@given(st.lists(st.sampled_from([-1.0, 0.0, 1.0, np.inf, np.nan]), min_size=6, max_size=6))
@example([np.nan, -1.0, 0.0, 0.0, 0.0, 0.0])
@example([-1.0, 0.0, 0.0, 0.0, 0.0, np.nan])
def test_nearest_lets_nan_win(values):
    """A distance that is no number is never overlooked in favour of a harmless one."""
    assume(any(np.isnan(values)))
    distances = np.array(values).reshape(2, 3)
    row, column, smallest = nearest(pairs_of(distances), 3)
    assert np.isnan(smallest)
    assert np.isnan(distances[row, column])


def segments_of(rng, m):
    segments = np.zeros(m, SEGMENT)
    segments["start"], segments["end"] = rng.normal(size=(2, m, 3))
    segments["radius"] = rng.uniform(0.05, 0.2, m)
    segments["link"] = np.arange(m)
    segments["swing"] = 0.3 * Z
    return segments


def test_measures_of_many_pairs():
    """Every robot capsule is measured against every agent, plane and listed self-pair."""
    rng = np.random.default_rng(5)
    segments = segments_of(rng, 4)
    agents = np.zeros(3, AGENT)
    agents["start"], agents["end"] = rng.normal(size=(2, 3, 3))
    agents["radius"] = rng.uniform(0.05, 0.2, 3)
    pairs = np.zeros((4, 3), PAIR)
    measure_agents(segments, agents, pairs)
    for i, robot in enumerate(segments):
        for j, agent in enumerate(agents):
            expected = ref.capsule_distance(
                robot["start"], robot["end"], robot["radius"], agent["start"], agent["end"], agent["radius"]
            )
            assert abs(pairs[i, j]["distance"] - expected) <= 1e-12
            _, s, r = ref.segment_distance(robot["start"], robot["end"], agent["start"], agent["end"])
            assert (pairs[i, j]["s"], pairs[i, j]["r"]) == pytest.approx((s, r), abs=1e-9)

    planes = np.zeros(2, PLANE)
    planes["normal"], planes["offset"] = np.array([Z, -X]), (-0.3, 0.4)
    heights = np.zeros((4, 2), PAIR)
    measure_planes(segments, planes, heights)
    assert heights["distance"][0, 0] == np.inf  # the first link, upright, stands on what is level
    for i in range(4):
        for j in range(i == 0, 2):
            expected = ref.plane_distance(
                segments[i]["start"],
                segments[i]["end"],
                segments[i]["radius"],
                planes[j]["normal"],
                planes[j]["offset"],
            )
            assert abs(heights[i, j]["distance"] - expected) <= 1e-12

    chosen = np.array([[0, 2], [3, 1]])
    own = np.zeros(2)
    measure_self(segments, chosen, own)
    for k, (i, j) in enumerate(chosen):
        one, two = segments[i], segments[j]
        expected = ref.capsule_distance(
            one["start"], one["end"], one["radius"], two["start"], two["end"], two["radius"]
        )
        assert abs(own[k] - expected) <= 1e-12
    segments[1]["end"][2] = np.nan
    measure_self(segments, chosen, own)
    assert np.isfinite(own[0])
    assert np.isnan(own[1])


def world_capsules(q):
    poses = ref.link_poses(ref.lr_mate_chain(), q)
    for _, link, start, end, radius in ref.LR_MATE_CAPSULES:
        rotation, origin = poses[link][:3, :3], poses[link][:3, 3]
        yield origin + rotation @ start, origin + rotation @ end, radius


def test_measure_of_the_whole_arm():
    """What users call gives the reference's distances for arm, person, table and arm against itself."""
    robot = lr_mate_200id_7l()
    rng = np.random.default_rng(6)
    self_pairs = [(0, 2), (0, 3), (0, 4), (1, 4), (2, 4)]
    table = Planes(Z[None], np.array([-0.1]), ("table",))
    for _ in range(20):
        q, qd = rng.uniform(-1.5, 1.5, 6), rng.normal(size=6)
        root = np.array([rng.uniform(0.4, 1.2), rng.uniform(-0.5, 0.5), -0.87])
        human = [(root + s, root + e, r) for _, s, e, r in ref.HUMAN_CAPSULES]
        velocity = np.tile(rng.normal(size=3), (6, 1))
        agents = CapsuleSet(
            np.array([h[0] for h in human]),
            np.array([h[1] for h in human]),
            velocity,
            velocity,
            np.array([h[2] for h in human]),
            tuple("abcdef"),
            np.zeros(6, np.int64),
        )
        found = measure(robot, JointState(q, qd, np.zeros(6)), agents, table)
        arm = list(world_capsules(q))
        expected = [[ref.capsule_distance(*a, *h) for h in human] for a in arm]
        np.testing.assert_allclose(found.distance, expected, rtol=0, atol=1e-12)
        own = [ref.capsule_distance(*arm[i], *arm[j]) for i, j in self_pairs]
        np.testing.assert_allclose(found.own, own, rtol=0, atol=1e-12)
        heights = [ref.plane_distance(*a, Z, -0.1) for a in arm[1:]]
        np.testing.assert_allclose(found.planes[1:, 0], heights, rtol=0, atol=1e-12)
        assert found.planes[0, 0] == np.inf
        assert found.pair == np.unravel_index(np.argmin(expected), (5, 6))
        assert found.smallest == found.distance.min()
