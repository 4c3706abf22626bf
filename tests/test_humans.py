"""How people move: what every motion promises, and what each one is for."""

import itertools
import math

import gymnasium as gym
import numpy as np
import pytest
import reference as ref

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import (
    CLEARANCE,
    HUMANS,
    ApproachRetreat,
    Body,
    ConstantVelocity,
    Crowd,
    HumanMotion,
    Nobody,
    RandomWalk,
    make_human,
    nobody,
    together,
)
from jssa_gym.humans.body import NAMES, PARTS
from jssa_gym.types import CapsuleSet

DT = 0.008
STEPS = 1000

# Liu, Chen, Liu: the simulated human, and the names and radii that this package gave its capsules [m]
PUBLISHED = {
    "head": ((0.0, 0.0, 1.5), (0.0, 0.0, 1.5), 0.20),
    "core_body": ((0.0, 0.0, 0.9), (0.0, 0.0, 1.25), 0.25),
    "right_arm": ((0.0, 0.2, 1.3), (0.0, 0.5, 0.8), 0.10),
    "left_arm": ((0.0, -0.2, 1.3), (0.0, -0.5, 0.8), 0.10),
    "right_leg": ((0.0, 0.15, 0.8), (0.0, 0.4, 0.1), 0.10),
    "left_leg": ((0.0, -0.15, 0.8), (0.0, -0.4, 0.1), 0.10),
}


@pytest.fixture(params=list(HUMANS))
def name(request):
    return request.param


@pytest.fixture(params=[name for name in HUMANS if HUMANS[name]().people])
def somebody(request):
    """The motions of somebody who is there."""
    return request.param


def walk(motion, seed, steps=STEPS, start=None, dt=DT):
    """The capsules of an episode, reset first."""
    seen = [motion.reset(np.random.default_rng(seed), start)]
    seen += [motion.step(dt, nobody()) for _ in range(steps)]
    return seen


def roots(seen):
    """Where a body stands on the floor, from its head, shape (steps + 1, 2)."""
    return np.array([capsules.start[0, :2] for capsules in seen])


def velocities(seen):
    return np.array([capsules.start_velocity[0, :2] for capsules in seen])


# ---- what every motion promises -----------------------------------------------------------------------


def test_a_capsule_will_be_where_its_velocity_says(name):
    for seed in range(5):
        seen = walk(HUMANS[name](), seed)
        for now, then in itertools.pairwise(seen):
            np.testing.assert_allclose(now.start + DT * now.start_velocity, then.start, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(now.end + DT * now.end_velocity, then.end, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.slow)])
def test_people_keep_their_distance_and_their_speed(name, count):
    motion = HUMANS[name]()
    for seed in range(count):
        seen = walk(motion, seed)
        for capsules in seen[:: 1 if count > 20 else 5]:
            for speeds in (capsules.start_velocity, capsules.end_velocity):
                assert np.linalg.norm(speeds, axis=1).max(initial=0.0) <= motion.speed_bound + 1e-12
        if motion.people:
            assert np.hypot(*roots(seen).T).min() >= 0.6


def test_the_body_is_the_published_one(name):
    motion = HUMANS[name]()
    seen = walk(motion, 0, steps=50)
    assert len(seen[0].names) == 6 * motion.people
    for capsules in seen:
        if not motion.people:
            assert capsules.radius.shape == (0,)
            continue
        assert capsules.names == tuple(PUBLISHED)
        np.testing.assert_array_equal(capsules.radius, [radius for _, _, radius in PUBLISHED.values()])
        root = np.append(capsules.start[0, :2], 0.0)
        for i, (start, end, _) in enumerate(PUBLISHED.values()):
            # turned about the vertical as a whole: heights, lengths and distances from the root stay
            np.testing.assert_allclose(capsules.start[i, 2], start[2], atol=1e-12)
            np.testing.assert_allclose(capsules.end[i, 2], end[2], atol=1e-12)
            for ours, theirs in ((capsules.start[i], start), (capsules.end[i], end)):
                assert np.linalg.norm(ours - root) == pytest.approx(np.linalg.norm(theirs), abs=1e-12)


def test_a_seed_fixes_a_motion_whatever_came_before(name):
    used = HUMANS[name]()
    walk(used, 99, steps=77)
    for one, other in zip(walk(HUMANS[name](), 3), walk(used, 3), strict=True):
        for field in ("start", "end", "start_velocity", "end_velocity", "radius", "person"):
            np.testing.assert_array_equal(getattr(one, field), getattr(other, field))
    if HUMANS[name]().people:
        assert not np.array_equal(walk(HUMANS[name](), 3)[0].start, walk(HUMANS[name](), 4)[0].start)


def test_capsules_once_returned_stay_as_they_are(name):
    motion = HUMANS[name]()
    first = motion.reset(np.random.default_rng(0))
    kept = first.start.copy(), first.start_velocity.copy()
    for _ in range(100):
        motion.step(DT, nobody())
    motion.reset(np.random.default_rng(1))
    np.testing.assert_array_equal(first.start, kept[0])
    np.testing.assert_array_equal(first.start_velocity, kept[1])


def test_persons_are_numbered_from_where_they_are_told(name):
    motion = HUMANS[name]()
    seen = motion.reset(np.random.default_rng(0), None, 4)
    assert seen.person.tolist() == [4] * 6 * motion.people
    assert motion.step(DT, nobody()).person.tolist() == [4] * 6 * motion.people


def test_a_start_is_where_the_person_begins(somebody):
    motion = HUMANS[somebody]()
    start = np.array([1.3, 0.4])
    for seed in range(20):
        seen = walk(motion, seed, start=start)
        np.testing.assert_allclose(roots(seen)[0], [1.3, 0.4], atol=1e-12)
        assert np.hypot(*roots(seen).T).min() >= 0.6
    np.testing.assert_array_equal(start, [1.3, 0.4])


@pytest.mark.parametrize("start", [(0.0, 0.0), (0.4, 0.4), (-1.0, 0.0), (0.0, 0.61), (0.7, 0.0), (np.nan, 0.0)])
def test_wherever_a_person_may_start_the_distance_is_kept(somebody, start):
    motion = HUMANS[somebody]()
    for seed in range(10):
        try:
            seen = walk(motion, seed, start=np.array(start))
        except ParameterError:
            continue
        assert np.isfinite(start).all()
        assert np.hypot(*roots(seen).T).min() >= 0.6 - 1e-9


def test_a_refused_start_changes_nothing(somebody):
    motion, twin = HUMANS[somebody](), HUMANS[somebody]()
    walk(motion, 1, steps=30)
    walk(twin, 1, steps=30)
    with pytest.raises(ParameterError):
        motion.reset(np.random.default_rng(5), np.array([0.1, 0.1]))
    for _ in range(30):
        np.testing.assert_array_equal(motion.step(DT, nobody()).start, twin.step(DT, nobody()).start)


@pytest.mark.parametrize("dt", [0.001, 0.008, 0.013, 0.1])
def test_promises_hold_for_other_steps_too(somebody, dt):
    motion = HUMANS[somebody]()
    for seed in range(5):
        seen = walk(motion, seed, steps=int(8.0 / dt), dt=dt)
        path, speeds = roots(seen), velocities(seen)
        np.testing.assert_allclose(path[:-1] + dt * speeds[:-1], path[1:], atol=1e-12)
        assert np.hypot(*path.T).min() >= 0.6
        assert np.hypot(*speeds.T).max() <= motion.speed_bound + 1e-12


@pytest.mark.parametrize("count", [40, pytest.param(2000, marks=pytest.mark.slow)])
def test_nobody_starts_within_reach_of_contact(name, count):
    env = gym.make("jssa_gym/Home-v0", human=name)
    for seed in range(count):
        _, info = env.reset(seed=seed)
        assert info["distance"] >= 0.1


# ---- each one -----------------------------------------------------------------------------------------


def test_the_published_table_is_the_packages():
    assert {part: (start, end, radius) for part, start, end, radius in PARTS} == PUBLISHED
    assert tuple(PUBLISHED) == NAMES
    reference = {part: (start, end, radius) for part, start, end, radius in ref.HUMAN_CAPSULES}
    assert reference == PUBLISHED
    facing = Body.facing()
    np.testing.assert_allclose(facing.start, [start for start, _, _ in PUBLISHED.values()], atol=1e-15)
    np.testing.assert_allclose(facing.end, [end for _, end, _ in PUBLISHED.values()], atol=1e-15)


def test_a_body_turns_with_its_heading():
    # the paper's looks along -x with its right arm at +y; looking along +x the right arm is at -y
    there = Body.facing(0.0).at((1.0, 2.0), (0.3, -0.4))
    right = list(PUBLISHED).index("right_arm")
    np.testing.assert_allclose(there.start[right], [1.0, 1.8, 1.3], atol=1e-12)
    quarter = Body.facing(np.pi / 2.0).at((0.0, 0.0), (0.0, 0.0))
    np.testing.assert_allclose(quarter.start[right], [0.2, 0.0, 1.3], atol=1e-12)
    np.testing.assert_array_equal(there.start_velocity, np.tile([0.3, -0.4, 0.0], (6, 1)))
    np.testing.assert_array_equal(there.end_velocity, there.start_velocity)


def test_constant_velocity_is_constant_and_passes_in_the_workspace():
    sides = []
    for seed in range(20):
        seen = walk(ConstantVelocity(), seed)
        speeds, path = velocities(seen), roots(seen)
        np.testing.assert_array_equal(speeds, np.tile(speeds[0], (len(seen), 1)))
        assert 0.3 <= np.hypot(*speeds[0]) <= 1.6
        gap = np.hypot(*path.T)
        assert 0.85 - 1e-3 <= gap.min() <= 1.3 + 1e-3
        assert 1.5 - DT <= gap.argmin() * DT <= 5.0 + DT
        sides.append(np.sign(path[0, 0] * speeds[0, 1] - path[0, 1] * speeds[0, 0]))
    assert set(sides) == {-1.0, 1.0}


def test_approach_retreat_approaches_stops_and_retreats():
    motion = ApproachRetreat(
        start=2.0, nearest=(0.7, 0.7), side=(0.1, 0.1), speed=(0.6, 0.6), wait=(0.5, 0.5), stay=(1.0, 1.0)
    )
    seen = walk(motion, 0)
    path, speeds = roots(seen), np.hypot(*velocities(seen).T)
    np.testing.assert_allclose(path[0], [2.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(path[:, 1], 0.1, atol=1e-12)
    # wait 0.5 s; 1.3 m: two thirds at 0.6 m/s, one third at 0.3 m/s, so 1.44 s each; stay 1 s; back at 0.6 m/s
    moments = np.cumsum([0.5, 1.3 * 2 / 3 / 0.6, 1.3 / 3 / 0.3, 1.0, 1.3 / 0.6])
    for k, speed in enumerate(speeds):
        expected = [0.0, 0.6, 0.3, 0.0, 0.6, 0.0]
        near = np.abs(moments - k * DT).min() <= 3 * DT
        assert near or speed == pytest.approx(expected[int(np.searchsorted(moments, k * DT))], abs=1e-12)
    assert path[:, 0].min() == pytest.approx(0.7, abs=0.01)
    assert path[:, 0].min() >= 0.7 - 1e-9
    assert path[-1, 0] == pytest.approx(2.0, abs=0.02)
    assert speeds[-1] == 0.0


@pytest.mark.parametrize("speed", [0.3, 0.37, 0.8, 1.3, 1.6])
@pytest.mark.parametrize("dt", [0.008, 0.05])
def test_approach_retreat_never_comes_nearer_than_asked(speed, dt):
    motion = ApproachRetreat(nearest=(CLEARANCE, CLEARANCE), side=(0.0, 0.0), speed=(speed, speed))
    for seed in range(5):
        gap = np.hypot(*roots(walk(motion, seed, steps=int(8.0 / dt), dt=dt)).T).min()
        assert gap >= CLEARANCE - 1e-9
        assert gap <= CLEARANCE + 2.0 * speed * dt


def test_random_walk_changes_gently_and_stays_in_its_region():
    motion = RandomWalk()
    travelled = []
    for seed in range(20):
        seen = walk(motion, seed)
        path, speeds = roots(seen), velocities(seen)
        change = np.hypot(*np.diff(speeds, axis=0).T)
        assert change.max() <= 0.4 + 1e-9
        moments = np.flatnonzero(change > 0.0)
        assert np.diff(moments).min() * DT >= 0.2 - 2 * DT
        assert np.hypot(*speeds[0]) <= 0.4 + 1e-9
        assert path[:, 0].min() >= 0.65
        assert path[:, 0].max() <= 2.0
        assert np.abs(path[:, 1]).max() <= 1.2
        travelled.append(np.hypot(*np.diff(path, axis=0).T).sum())
    assert min(travelled) > 1.0


@pytest.mark.parametrize(
    "arguments",
    [
        {"speed": 2.0, "change": 2.0, "period": 1.0},
        {"speed": 0.2, "change": 0.05, "period": 0.05},
        {"speed": 5.0, "change": 0.1, "period": 0.4},
        {"region": ((0.7, 1.1), (-0.2, 0.2))},
        {"region": ((-2.0, -0.65), (0.5, 2.0)), "period": 0.03},
        {"region": ((0.7, 0.9), (0.0, 0.02))},
    ],
    ids=str,
)
@pytest.mark.timeout(20)
def test_other_random_walks_keep_their_promises_too(arguments):
    try:
        motion = RandomWalk(**arguments)
    except ParameterError:
        assert "region" in arguments
        return
    (x_low, x_high), (y_low, y_high) = arguments.get("region", ((0.65, 2.0), (-1.2, 1.2)))
    for seed in range(5):
        seen = walk(motion, seed)
        path, speeds = roots(seen), velocities(seen)
        assert np.hypot(*np.diff(speeds, axis=0).T).max() <= motion.change + 1e-9
        assert np.hypot(*speeds.T).max() <= motion.speed_bound + 1e-12
        assert x_low - 1e-9 <= path[:, 0].min() <= path[:, 0].max() <= x_high + 1e-9
        assert y_low - 1e-9 <= path[:, 1].min() <= path[:, 1].max() <= y_high + 1e-9


@pytest.mark.timeout(20)
def test_a_region_too_small_to_walk_in_is_refused():
    with pytest.raises(ParameterError, match="region"):
        RandomWalk(region=((0.65, 0.70), (0.0, 0.01))).reset(np.random.default_rng(0))


def test_a_crowd_is_its_members_one_after_the_other():
    crowd = Crowd([RandomWalk(), Nobody(), ConstantVelocity()])
    assert crowd.people == 2
    assert crowd.speed_bound == 1.6
    assert not crowd.reacts
    seen = walk(crowd, 0, steps=20)
    assert seen[-1].names == NAMES * 2
    assert seen[-1].person.tolist() == [0] * 6 + [1] * 6
    assert all(len(array) == 12 for array in (seen[-1].start, seen[-1].end, seen[-1].end_velocity, seen[-1].radius))
    # the start is the first person's
    begun = crowd.reset(np.random.default_rng(0), np.array([1.0, 0.0]))
    np.testing.assert_allclose(begun.start[0, :2], [1.0, 0.0])
    assert not np.allclose(begun.start[6, :2], [1.0, 0.0])


def test_nobody_together_with_nobody_is_nobody():
    assert together([]).names == ()
    assert together([nobody(), nobody()]).radius.shape == (0,)


class Follower(HumanMotion):
    """Stands still until the arm moves; then steps back."""

    speed_bound = 1.0

    def reset(self, rng, start=None, person=0):
        self.body, self.x, self.given = Body.facing(person=person), 1.2, []
        return self.body.at((self.x, 0.0), (0.0, 0.0))

    def step(self, dt, robot):
        self.given.append(robot)
        speed = 0.5 if np.abs(robot.end_velocity).max() > 0.01 else 0.0
        self.x += speed * dt
        return self.body.at((self.x, 0.0), (speed, 0.0))


def test_a_motion_that_reacts_gets_the_robots_capsules():
    env = gym.make("jssa_gym/Home-v0", human=Crowd([Follower(), RandomWalk()]), terminate_on=())
    human = env.unwrapped.human.motions[0]  # a copy of its own
    env.reset(seed=0)
    for _ in range(10):
        env.step(np.zeros(6))
    assert human.x == 1.2
    for _ in range(10):
        env.step(np.full(6, 0.5))
    assert human.x > 1.2
    assert len(human.given) == 20
    for capsules in human.given:
        assert isinstance(capsules, CapsuleSet)
        assert capsules.start.shape == (5, 3)
        assert capsules.names == tuple(part for part, *_ in ref.LR_MATE_CAPSULES)
        np.testing.assert_array_equal(capsules.radius, [radius for *_, radius in ref.LR_MATE_CAPSULES])
    assert not np.allclose(human.given[-1].end, human.given[0].end)


def test_a_motion_that_does_not_react_is_given_nothing(robot):
    class Blind(RandomWalk):
        def step(self, dt, robot):
            assert robot.names == ()
            return super().step(dt, robot)

    env = gym.make("jssa_gym/Home-v0", human=Blind())
    env.reset(seed=0)
    env.step(np.zeros(6))


# ---- what is refused ----------------------------------------------------------------------------------

RANGES = ["fast", 1.0, None, (1.0,), (1.0, 2.0, 3.0), (2.0, 1.0), (np.nan, 1.0), (1.0, np.inf), ("a", "b"), (-1.0, 1.0)]


@pytest.mark.parametrize("value", RANGES, ids=str)
@pytest.mark.parametrize(
    ("motion", "argument"),
    [
        (ConstantVelocity, "speed"),
        (ConstantVelocity, "offset"),
        (ConstantVelocity, "passing"),
        (ApproachRetreat, "nearest"),
        (ApproachRetreat, "speed"),
        (ApproachRetreat, "wait"),
        (ApproachRetreat, "stay"),
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_a_range_is_two_numbers_in_order(motion, argument, value):
    with pytest.raises(ParameterError, match=argument):
        motion(**{argument: value})


@pytest.mark.parametrize(
    ("motion", "arguments", "word"),
    [
        (ConstantVelocity, {"offset": (0.5, 1.0)}, "0.6"),
        (ApproachRetreat, {"nearest": (0.5, 0.7)}, "0.6"),
        (ApproachRetreat, {"start": 0.7}, "start"),
        (ApproachRetreat, {"start": np.nan}, "start"),
        (ApproachRetreat, {"start": "far"}, "start"),
        (ApproachRetreat, {"side": (0.2, -0.2)}, "side"),
        (RandomWalk, {"speed": 0.0}, "speed"),
        (RandomWalk, {"speed": "fast"}, "speed"),
        (RandomWalk, {"change": -1.0}, "change"),
        (RandomWalk, {"period": np.inf}, "period"),
        (RandomWalk, {"region": ((0.1, 2.0), (-1.0, 1.0))}, "0.6"),
        (RandomWalk, {"region": ((0.65, 2.0), (1.0, -1.0))}, "region"),
        (RandomWalk, {"region": ((0.65, 2.0),)}, "region"),
        (RandomWalk, {"region": 5.0}, "region"),
        (RandomWalk, {"region": ((0.65, 2.0), (-1.0, np.nan))}, "region"),
        (Crowd, {"motions": []}, "at least one"),
    ],
    ids=str,
)
def test_bad_parameters_are_named(motion, arguments, word):
    with pytest.raises(ParameterError, match=word) as caught:
        motion(**arguments)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("human", ["ghost", 3, None, ["random", "ghost"], ["random", 3], {"random"}], ids=str)
def test_an_unknown_human_is_told_the_valid_ones(human):
    with pytest.raises(ParameterError, match="approach_retreat, random"):
        make_human(human)


def test_make_human_takes_names_motions_and_both():
    given = RandomWalk(speed=0.7)
    copied = make_human(given)
    assert copied is not given
    assert copied.speed_bound == given.speed_bound
    assert isinstance(make_human("random"), RandomWalk)
    crowd = make_human([given, given])
    assert crowd.motions[0] is not crowd.motions[1]
    assert math.isclose(crowd.speed_bound, given.speed_bound)
