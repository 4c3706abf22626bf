"""Where a region is watched: its geometry, and that what is believed contains everybody who comes and goes."""

import itertools
import json
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from monitors import wrong_with_people
from visitors import RADIUS, World, ball

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import Body, nobody, together
from jssa_gym.kernels.region import deepest, outside, room_inside
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.region import ConvexPiece, WatchedRegion
from jssa_gym.shields import NoFilter
from jssa_gym.tick import codes

DT, HALF, SPEED, MAX_AGE = 0.008, 1.0, 2.0, 0.2
LOW, HIGH = (-HALF, -HALF, -1.0), (HALF, HALF, 4.0)
HEIGHTS = ("bottom", "top")


def box(low=LOW, high=HIGH, closed=HEIGHTS):
    return WatchedRegion.box(low, high, closed, SPEED)


# ---- geometry -----------------------------------------------------------------------------------------

TWO = WatchedRegion(
    (
        ConvexPiece.box((-1.0, -1.0, 0.0), (0.3, 1.0, 2.0), closed=("bottom",)),
        ConvexPiece([[1.0, 0.0, 0.0], [-0.6, 0.8, 0.0], [-0.6, -0.8, 0.0]], [-0.2, -1.0, -1.0]),
    )
)
REGIONS = [box(), box(closed=()), TWO]


def inside(region, points, closed=True):
    """Of each point, how far it is from the nearest open face of the piece where that is farthest, (k,) [m]."""
    rooms = []
    for piece in region.pieces:
        depth = points @ np.array(piece.normal).T - piece.offset
        rooms.append(np.where(piece.closed, np.inf, depth).min(axis=1))
    return np.max(rooms, axis=0)


def within(region, points):
    """Whether points are in the region."""
    depths = [(points @ np.array(piece.normal).T - piece.offset).min(axis=1) for piece in region.pieces]
    return np.max(depths, axis=0) >= 0.0


def points_of(rng, start, end, radius, count=400):
    way = rng.standard_normal((count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return start + rng.random((count, 1)) * (end - start) + radius * way


@pytest.mark.parametrize("region", REGIONS, ids=["box", "open box", "two pieces"])
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_capsule_is_as_far_inside_as_its_points_are(region, seed):
    rng = np.random.default_rng(seed)
    start, radius = rng.uniform(-2.0, 2.0, 3), rng.uniform(0.05, 0.3)
    end = start + rng.uniform(-0.5, 0.5, 3)
    faces, pieces = region.faces()
    room, most = (of(start, end, radius, faces, pieces) for of in (room_inside, deepest))
    points = points_of(rng, start, end, radius)
    # of some piece all points are that far from every open face
    rooms = [
        np.where(piece.closed, np.inf, points @ np.array(piece.normal).T - piece.offset).min()
        for piece in region.pieces
    ]
    assert max(rooms) >= room - 1e-9
    assert room >= max(rooms) - 0.3 * radius - 0.1
    # none is deeper, and the deepest of the axis is that deep but for the radius
    axis = start + np.linspace(0.0, 1.0, 500)[:, None] * (end - start)
    assert inside(region, points).max() <= most + 1e-9
    np.testing.assert_allclose(inside(region, axis).max() + radius, most, atol=0.01)
    if outside(start, end, radius, faces, pieces):
        assert not within(region, points).any()


def test_somebody_beside_a_box_is_outside_and_beyond_a_closed_face_too():
    faces, pieces = box().faces()
    for at, gone in (((1.2, 0, 1), True), ((1.09, 0, 1), False), ((0, 0, -1.2), True), ((0, 0, 1), False)):
        at = np.array(at, float)
        assert outside(at, at, 0.1, faces, pieces) == gone


def test_what_is_not_finite_is_neither_inside_nor_outside():
    faces, pieces = box().faces()
    nowhere, here = np.full(3, np.nan), np.zeros(3)
    assert not room_inside(nowhere, here, 0.1, faces, pieces) > -np.inf
    assert not outside(nowhere, nowhere, 0.1, faces, pieces)
    assert not deepest(nowhere, nowhere, 0.1, faces, pieces) <= np.inf


# ---- who is there -------------------------------------------------------------------------------------


class Guarded:
    """A resting arm that is shown people."""

    def __init__(self, robot, make_scene, region=None, **changes):
        params = {"position_error": 0.0, "max_age": MAX_AGE, "watched": box() if region is None else region}
        self.filter = NoFilter(robot, DT, viability=True, failsafe=FailsafeParams(**(params | changes)))
        self.make_scene, self.robot, self.time = make_scene, robot, 0.0
        self.filter.reset(self.scene(nobody()))
        self.time = -DT

    def scene(self, people, **changes):
        rest = [self.robot.home, np.zeros(6), np.zeros(6)]
        return self.make_scene(rest, people, time=self.time)._replace(**changes)

    def see(self, people, **changes):
        """One tick; the code of what is wrong with people, or 0."""
        self.time += DT
        return wrong_with_people(self.filter, self.scene(people, **changes))

    @property
    def names(self):
        return list(self.filter.reading.names)

    @property
    def persons(self):
        return self.filter.records.memory.tracks[0]["person"].tolist()

    def covers(self, at, radius):
        """Whether somebody who is a ball there is within what is believed."""
        memory, settings = self.filter.records.memory, self.filter.records.settings
        now = float(memory.arm[0]["people_time"])
        for track, growth in zip(memory.tracks[0], memory.growth[0], strict=True):
            reach = growth * (now - track["stamp"]) + settings.position_error
            if np.linalg.norm(track["trusted"][0] - at) <= reach + 1e-9:
                return True
        come = settings.entry_speed * (now - memory.arm[0]["frame"]) + settings.position_error
        faces, pieces = settings.faces, settings.pieces
        return deepest(at, at, radius, faces, pieces) <= come + 1e-9 or outside(at, at, radius, faces, pieces)


@pytest.fixture
def arm(robot, make_scene):
    return Guarded(robot, make_scene)


WORLDS = {
    "exact": {},
    "imprecise": {"error": 0.02},
    "late": {"period": 4, "late": 6},
    "hidden": {"occluded": 0.1, "period": 4, "late": 3},
    "hidden and not listed": {"occluded": 0.1, "period": 4, "late": 3, "listed": False},
    "swapped": {"swaps": 0.02},
    "everything": {"error": 0.02, "period": 4, "late": 6, "occluded": 0.1, "swaps": 0.02},
}


@pytest.mark.parametrize(
    "name", [name if name == "everything" else pytest.param(name, marks=pytest.mark.long) for name in WORLDS]
)
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 30))])
def test_everybody_is_within_what_is_believed_whoever_comes_and_goes(robot, make_scene, name, seed):
    world = World(np.random.default_rng(seed), half=HALF, speed=SPEED, **WORLDS[name])
    arm, faults, inside, numbers = Guarded(robot, make_scene, position_error=world.error), 0, 0, set()
    for k in range(400):
        frame = world.frame()
        faults += arm.see(frame.people, age=frame.age, valid=frame.valid, frame_age=frame.frame_age) != 0
        numbers.add(len(frame.valid))
        if k > world.late:
            for at in world.at:
                inside += np.abs(at[:2]).max() < HALF
                assert arm.covers(at, RADIUS), (k, at)
        world.step()
    # not by believing nothing, nor beside nobody; where people are hidden, or another's id overlaps, some time is lost
    assert inside > 100
    assert len(numbers) > 2
    assert faults <= (200 if world.swaps else 30)


def test_people_may_come_and_go_and_change_places(arm):
    one, two = (ball((-0.3, y, 1.0), person=p) for y, p in ((-0.2, 7), (0.4, 3)))
    far = ball((1.4, 0.0, 1.0), person=9)
    for people in ((), (one,), (one, two), (two, one), (two, one, far), (one, far, two), (one, two)):
        assert arm.see(together(list(people))) == 0
        assert arm.persons == [int(p.person[0]) for p in people]


def test_without_a_region_it_is_a_fault(robot, make_scene):
    filter = NoFilter(robot, DT, viability=True, failsafe=FailsafeParams())
    rest = [robot.home, np.zeros(6), np.zeros(6)]
    filter.reset(make_scene(rest, nobody()))
    assert wrong_with_people(filter, make_scene(rest, nobody())) == 0
    assert wrong_with_people(filter, make_scene(rest, ball((0.9, 0, 1)), time=DT)) == codes.PEOPLE


def test_who_is_lost_inside_grows_and_is_a_fault_until_seen_again(arm):
    person = ball((0.0, 0.5, 1.0), person=4)
    assert arm.see(person) == 0
    for k in range(1, 40):
        code = arm.see(nobody())
        assert arm.persons == [4]
        assert arm.covers(np.array([0.0, 0.5 + 2.0 * k * DT, 1.0]), RADIUS)
        assert (code != 0) == (k * DT > MAX_AGE + 1e-9)
    assert arm.see(person) == 0


def test_who_was_measured_outside_is_dropped_as_soon_as_that_is_certain(arm):
    for x, kept in ((1.3, False), (1.11, True), (1.09, True)):
        arm.filter.reset(arm.scene(nobody()))
        arm.time = -DT
        assert arm.see(ball((x, 0.0, 1.0), person=4)) == 0
        assert arm.see(nobody()) == 0
        assert arm.persons == ([4] if kept else [])


def test_an_error_of_places_keeps_who_may_be_inside(robot, make_scene):
    arm = Guarded(robot, make_scene, position_error=0.05)
    arm.see(ball((1.15, 0.0, 1.0), person=4))
    arm.see(nobody())
    assert arm.persons == [4]


def test_who_is_listed_but_not_measured_any_more_is_dropped_outside_and_new_when_seen_again(arm):
    person = ball((1.3, 0.0, 1.0), person=4)
    arm.see(person)
    for _ in range(60):
        assert arm.see(person, valid=np.zeros(1, np.bool_)) == 0
        assert arm.persons == []
    assert arm.see(ball((1.0, 0.5, 1.0), person=4)) == 0
    assert arm.persons == [4]


def test_who_is_listed_and_never_measured_is_a_fault(arm):
    assert arm.see(ball((0.0, 0.5, 1.0)), valid=np.zeros(1, np.bool_)) != 0


def test_exchanged_ids_are_told_apart_by_place(arm):
    places = (-0.5, 0.5)
    for ids in ((1, 2), (2, 1), (1, 2), (2, 1)):
        assert arm.see(together([ball((0.0, y, 1.0), person=p) for y, p in zip(places, ids, strict=True)])) == 0
        assert arm.persons == list(ids)
        # all of it is believed
        assert arm.filter.records.memory.arm[0]["frame"] == pytest.approx(arm.time)


def test_a_sample_that_comes_late_gives_no_track_away(robot, make_scene):
    """A, who is hidden, has gone on from where B stands by now; then a sample of A from before that arrives."""
    arm = Guarded(robot, make_scene, box((-3.0, -3.0, -1.0), (3.0, 3.0, 4.0)), position_error=0.02)

    def people(a, b=0.3):
        return together([ball((x, 1.0, 1.0), person=p) for x, p in ((a, 1), (b, 2))])

    codes_seen = []
    for k in range(40):
        a = max(-1.96 * k * DT, -0.3)
        old = k == 20  # of 0.155 s before the first
        shown, age = people(0.31 if old else a), np.array([k * DT + 0.155 if old else 0.0, 0.0])
        frame_age = np.nan if old else 0.0
        codes_seen.append(arm.see(shown, age=age, valid=np.array([k == 0 or old, True]), frame_age=frame_age))
        assert arm.covers(np.array([a, 1.0, 1.0]), RADIUS), k
        assert arm.persons == [1, 2]
    assert codes_seen[:20] == [0] * 20
    assert all(codes_seen[27:])  # hidden for longer than may be


def test_a_new_id_takes_no_track_of_somebody_who_is_listed(arm):
    both = [ball((0.0, y, 1.0), person=p) for y, p in ((0.5, 1), (0.52, 2))]
    assert arm.see(together(both)) == 0
    # the second is hidden, and the first has another id from where either could be
    shown = together([ball((0.0, 0.51, 1.0), person=7), both[1]])
    arm.see(shown, valid=np.array([True, False]), frame_age=np.nan)
    assert 2 in arm.persons
    for k in range(1, 12):
        assert arm.covers(np.array([0.0, 0.52 + 1.9 * k * DT, 1.0]), RADIUS)
        arm.see(shown, valid=np.array([True, False]), frame_age=np.nan)


def test_a_frame_in_which_nobody_is_measured_is_as_old_as_its_samples(arm):
    outside_of_it = ball((1.3, 0.0, 1.0), person=4)
    assert arm.see(outside_of_it) == 0
    for k in range(1, 60):  # the camera is dead, and says so
        code = arm.see(outside_of_it, valid=np.zeros(1, np.bool_), age=np.array([k * DT]))
        assert arm.filter.records.memory.arm[0]["frame"] == pytest.approx(0.0)
        assert (code != 0) == (k * DT > MAX_AGE + 1e-9)


def test_a_new_id_of_who_was_there_is_told_by_place(arm):
    arm.see(ball((0.0, 0.5, 1.0), person=1))
    for k in range(60):
        assert arm.see(ball((0.0, 0.5, 1.0), person=k)) == 0
        assert arm.persons == [k]


def test_a_new_id_that_may_be_either_of_two_is_neither(arm):
    arm.see(together([ball((0.0, 0.50, 1.0), person=1), ball((0.0, 0.51, 1.0), person=2)]))
    arm.see(ball((0.0, 0.505, 1.0), person=3))
    assert sorted(arm.persons) == [1, 2, 3]


def test_who_jumps_is_not_believed_and_who_was_there_is_not_forgotten(arm):
    arm.see(ball((0.0, 0.5, 1.0), person=1))
    frame = arm.filter.records.memory.arm[0]["frame"]
    for k in range(1, 30):
        code = arm.see(ball((0.0, -0.5, 1.0), person=1))
        assert arm.covers(np.array([0.0, 0.5, 1.0]), RADIUS)
        # nor does that count as a frame in which everybody is known
        assert arm.filter.records.memory.arm[0]["frame"] == frame
        assert (code != 0) == (k * DT > MAX_AGE + 1e-9)


def test_who_is_hidden_after_a_place_that_was_not_believed_is_not_known(arm):
    hidden = np.zeros(1, np.bool_)
    arm.see(ball((0.0, 0.5, 1.0), person=1))
    frame = arm.filter.records.memory.arm[0]["frame"]
    arm.see(ball((0.0, -0.5, 1.0), person=1))
    for _ in range(3):
        arm.see(ball((0.0, -0.5, 1.0), person=1), valid=hidden)
        # whoever was shown there may be there still, and is no track
        assert arm.filter.records.memory.arm[0]["frame"] == frame


def test_who_was_outside_and_was_then_shown_inside_is_not_dropped(arm):
    arm.see(ball((1.3, 0.0, 1.0), person=1))
    arm.see(ball((0.0, 0.5, 1.0), person=1))
    arm.see(ball((0.0, 0.5, 1.0), person=1), valid=np.zeros(1, np.bool_))
    assert arm.persons == [1]


@pytest.mark.parametrize("age", [0.21, np.nan, np.inf, -1.0])
def test_a_region_that_nobody_sees_is_a_fault(arm, age):
    assert arm.see(nobody()) == 0
    codes_seen = [arm.see(nobody(), frame_age=age) for _ in range(40)]
    assert codes_seen[0] == 0
    assert codes_seen[-1] == codes.UNWATCHED
    assert arm.see(nobody(), frame_age=0.0) == 0


def test_a_frame_is_as_old_as_the_oldest_of_its_capsules(arm):
    people = together([ball((0.0, y, 1.0), person=p) for p, y in enumerate((-0.4, 0.4))])
    arm.see(people, age=np.array([0.02, 0.05]))
    assert arm.time - arm.filter.records.memory.arm[0]["frame"] == pytest.approx(0.05)


@pytest.mark.parametrize("frame_age", ["soon", object()])
def test_a_frame_whose_age_is_none_is_a_fault(arm, frame_age):
    assert arm.see(nobody()) == 0
    assert arm.see(nobody(), frame_age=frame_age) == codes.PEOPLE


def test_more_people_than_there_is_room_for_are_a_fault(robot, make_scene):
    arm = Guarded(robot, make_scene, WatchedRegion((ConvexPiece.box(LOW, HIGH),), SPEED, capacity=12))
    crowd = [Body.facing(person=k).at((1.8 + k, 0.0), (0.0, 0.0)) for k in range(3)]
    assert arm.see(together(crowd[:2])) == 0
    assert arm.see(together(crowd)) == codes.PEOPLE
    assert "18 body parts are more than the watched region's capacity, 12" in arm.filter.reading.wrong["people"]
    assert arm.see(together(crowd[:2])) == 0


@pytest.mark.parametrize(
    "spoil",
    [
        lambda p: p._replace(start=p.start[:3]),
        lambda p: p._replace(names=p.names[:3]),
        lambda p: p._replace(names=([],) * 6),
        lambda p: p._replace(person=p.person + 0.5),
        lambda p: p._replace(radius="thick"),
        lambda p: p._replace(end=np.ma.masked_array(p.end)),
        lambda p: None,
    ],
    ids=["start", "names", "no names", "person", "radius", "masked", "none"],
)
def test_people_that_cannot_be_read_are_a_fault_and_change_nothing(arm, spoil):
    body = Body.facing(person=2).at((1.8, 0.0), (0.0, 0.0))
    assert arm.see(body) == 0
    assert arm.see(spoil(body), age=np.zeros(6), valid=np.ones(6, np.bool_)) == codes.PEOPLE
    assert len(arm.names) == 6
    assert arm.see(body) == 0


def test_a_clock_that_goes_back_changes_nothing(arm):
    for _ in range(4):
        assert arm.see(ball((0.0, 0.5, 1.0), person=1)) == 0
    arm.time -= 3 * DT
    assert arm.see(nobody()) != 0
    assert arm.persons == [1]


# ---- what it is told of -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make",
    [
        lambda: WatchedRegion(()),
        lambda: WatchedRegion(ConvexPiece.box(LOW, HIGH)),
        lambda: WatchedRegion(({"normal": [[1, 0, 0]]},)),
        lambda: WatchedRegion.of({"capacity": 12}),
        lambda: WatchedRegion(({"nromal": [[1, 0, 0]], "offset": [0]},)),
        lambda: WatchedRegion.box(HIGH, LOW),
        lambda: WatchedRegion.box(LOW, HIGH, closed=("ceiling",)),
        lambda: WatchedRegion.box(LOW, HIGH, entry_speed=0.0),
        lambda: WatchedRegion((ConvexPiece.box(LOW, HIGH),), capacity=0),
        lambda: ConvexPiece([[1.0, 1.0, 0.0]], [0.0]),
        lambda: ConvexPiece([[1.0, 0.0, 0.0]], [np.nan]),
        lambda: ConvexPiece([[1.0, 0.0, 0.0]], [0.0], closed=["yes"]),
        lambda: ConvexPiece([], []),
        lambda: FailsafeParams(watched="everywhere"),
    ],
)
def test_a_region_that_is_none_is_refused(make):
    with pytest.raises(ParameterError):
        make()


def test_a_region_can_be_written_down():
    params = FailsafeParams(watched=TWO)
    again = FailsafeParams.of(json.loads(json.dumps(asdict(params))))
    assert again == params
    for ours, theirs in zip(again.watched.faces(), TWO.faces(), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_nobody_says_how_fast_people_come_in_they_come_at_a_foots_speed():
    region = WatchedRegion.box(LOW, HIGH)
    assert FailsafeParams(watched=region).entry_speed == 4.8
    assert FailsafeParams(watched=region, end_speeds={"arm": (1.0, 7.0)}).entry_speed == 7.0
    assert FailsafeParams(watched=box()).entry_speed == SPEED
    assert FailsafeParams().entry_speed == 0.0


def test_sides_of_a_box_are_where_they_are_said_to_be():
    for side, (axis, sign) in zip(
        ("left", "right", "back", "front", "bottom", "top"), itertools.product(range(3), (-1, 1)), strict=True
    ):
        faces, pieces = WatchedRegion.box((-1, -1, -1), (1, 1, 1), [s for s in SIDES if s != side]).faces()
        at = np.zeros(3)
        at[axis] = 0.7 * sign
        assert room_inside(at, at, 0.1, faces, pieces) == pytest.approx(0.2)
        assert room_inside(-at, -at, 0.1, faces, pieces) == pytest.approx(1.6)


SIDES = ("left", "right", "back", "front", "bottom", "top")
