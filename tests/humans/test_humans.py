"""How people move: what every motion promises, and what each one is for."""

import functools
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
    Hand,
    HumanMotion,
    Nobody,
    Pursuit,
    RandomWalk,
    Steered,
    WalkBy,
    make_human,
    nobody,
    together,
)
from jssa_gym.humans.body import NAMES, PARTS
from jssa_gym.safety.failsafe import ARM_SPEEDS
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


@functools.cache
def arm(position=None):
    """The arm at rest, at home or at a joint position, as a motion that reacts sees it."""
    env = gym.make("jssa_gym/Home-v0", human="none").unwrapped
    env.reset(seed=0, options={} if position is None else {"joint_position": position})
    return env.robot_capsules


def walk(motion, seed, steps=STEPS, start=None, dt=DT, robot=None):
    """The capsules of an episode beside the arm at home, reset first."""
    robot = arm() if robot is None else robot
    seen = [motion.reset(np.random.default_rng(seed), start)]
    seen += [motion.step(dt, robot) for _ in range(steps)]
    return seen


def surface_distance(people, robot):
    """Smallest surface distance of two sets of capsules [m], from points along the axes: never too small."""
    share = np.linspace(0.0, 1.0, 21)[:, None, None]
    (p, q) = (c.start + share * (c.end - c.start) for c in (people, robot))
    axis = np.linalg.norm(p[:, None, :, None] - q[None, :, None, :], axis=-1)
    return (axis - people.radius[:, None] - robot.radius).min()


def roots(seen):
    """Where a body stands on the floor, from its head, shape (steps + 1, 2)."""
    return np.array([capsules.start[0, :2] for capsules in seen])


def velocities(seen):
    return np.array([capsules.start_velocity[0, :2] for capsules in seen])


# ---- what every motion promises -----------------------------------------------------------------------


@pytest.mark.sampled(1)
def test_a_capsule_will_be_where_its_velocity_says(name):
    for seed in range(5):
        seen = walk(HUMANS[name](), seed)
        for now, then in itertools.pairwise(seen):
            np.testing.assert_allclose(now.start + DT * now.start_velocity, then.start, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(now.end + DT * now.end_velocity, then.end, rtol=0.0, atol=1e-12)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.slow)])
def test_people_keep_their_distance_and_their_speed(name, count):
    motion = HUMANS[name]()
    for seed in range(count):
        seen = walk(motion, seed)
        for capsules in seen[:: 1 if count > 20 else 5]:
            for speeds in (capsules.start_velocity, capsules.end_velocity):
                assert np.linalg.norm(speeds, axis=1).max(initial=0.0) <= motion.speed_bound + 1e-12
        if motion.people:
            assert np.hypot(*roots(seen).T).min() >= motion.clearance
            assert motion.clearance == (0.0 if name == "pursuit" else 0.6)


@pytest.mark.sampled(6)
def test_arms_begin_at_the_shoulder_and_both_ends_keep_their_speeds(name):
    """What :data:`ARM_SPEEDS` says of this package's own people: fast or slow, everybody who is in ``HUMANS``."""
    arms = 0
    for seed in range(10):
        seen = walk(HUMANS[name](), seed, steps=600)
        for part, bounds in ARM_SPEEDS.items():
            for k in (k for k, of in enumerate(seen[0].names) if of == part):
                shoulder, hand = (np.array([getattr(one, end)[k] for one in seen]) for end in ("start", "end"))
                body = seen[0].names.index("core_body")
                neck = np.array([one.end[body] for one in seen])
                # a shoulder keeps its place beside the upper end of the body; a hand does not get there
                near = np.linalg.norm(shoulder - neck, axis=1)
                assert near.max() < 0.3
                assert np.ptp(near) < 0.05
                assert np.all(np.linalg.norm(hand - shoulder, axis=1) > 0.05)
                for end, bound in zip((shoulder, hand), bounds, strict=True):
                    assert np.linalg.norm(np.diff(end, axis=0), axis=1).max() <= bound * DT + 1e-9
                arms += 1
    assert arms >= (0 if name == "none" else 10)


def test_no_part_is_faster_than_a_motion_says_of_it(name):
    assert_parts_keep_their_bounds([HUMANS[name]()] * 6)


def test_no_part_of_somebody_steered_is_faster_than_that_says():
    rng = np.random.default_rng(3)
    for columns in (2, 3):
        assert_parts_keep_their_bounds([Steered(rng.uniform(-1.0, 1.0, (6, columns))) for _ in range(6)])


def assert_parts_keep_their_bounds(motions):
    """Each end of each capsule: its speed, and how fast that changes; and the bound of the fastest is no idle one."""
    for seed, motion in enumerate(motions):
        seen = walk(motion, seed, steps=600)
        ends = np.array([[one.start_velocity, one.end_velocity] for one in seen])
        changes = np.linalg.norm(np.diff(ends, axis=0), axis=-1).max(axis=(0, 1), initial=0.0) / DT
        for k, part in enumerate(seen[0].names):
            for row, bound in enumerate(motion.end_speeds_of(part)):
                assert np.linalg.norm(ends[:, row, k], axis=-1).max() <= bound + 1e-12
            if (bound := motion.acceleration_of(part)) is not None:
                assert changes[k] <= bound * (1.0 + 1e-9)
        said = [bound for part in seen[0].names for bound in motion.end_speeds_of(part)]
        assert max(said, default=0.0) == motion.speed_bound


def test_nothing_moves_faster_than_the_bound(name):
    # from where things are, not from what the velocities say
    motion, fastest = HUMANS[name](), 0.0
    for seed in range(10):
        seen = walk(motion, seed, steps=600)
        for field in ("start", "end"):
            moved = np.diff([getattr(capsules, field) for capsules in seen], axis=0)
            fastest = max(fastest, np.linalg.norm(moved, axis=-1).max(initial=0.0) / DT)
    assert fastest <= motion.speed_bound + 1e-9
    # the bound is no idle one
    assert fastest >= 0.7 * motion.speed_bound


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
        for i, (part, (start, end, _)) in enumerate(PUBLISHED.items()):
            if name in ("hand", "receive", "recorded") and part.endswith("_arm"):
                end = capsules.end[i] - root  # hands move as they like
            # turned about the vertical as a whole: heights, lengths and distances from the root stay
            np.testing.assert_allclose(capsules.start[i, 2], start[2], atol=1e-12)
            np.testing.assert_allclose(capsules.end[i, 2], end[2], atol=1e-12)
            for ours, theirs in ((capsules.start[i], start), (capsules.end[i], end)):
                assert np.linalg.norm(ours - root) == pytest.approx(np.linalg.norm(theirs), abs=1e-12)


@pytest.mark.sampled(2)
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


@pytest.mark.sampled(2)
def test_a_start_is_where_the_person_begins(somebody):
    motion = HUMANS[somebody]()
    start = np.array([1.3, 0.4])
    for seed in range(20):
        seen = walk(motion, seed, start=start)
        np.testing.assert_allclose(roots(seen)[0], [1.3, 0.4], atol=1e-12)
        assert np.hypot(*roots(seen).T).min() >= motion.clearance
    np.testing.assert_array_equal(start, [1.3, 0.4])


@pytest.mark.sampled(11)
@pytest.mark.parametrize("start", [(0.0, 0.0), (0.4, 0.4), (-1.0, 0.0), (0.0, 0.61), (0.7, 0.0), (np.nan, 0.0)])
def test_wherever_a_person_may_start_the_distance_is_kept(somebody, start):
    motion = HUMANS[somebody]()
    for seed in range(10):
        try:
            seen = walk(motion, seed, start=np.array(start))
        except ParameterError:
            continue
        assert np.isfinite(start).all()
        assert np.hypot(*roots(seen).T).min() >= motion.clearance - 1e-9


def test_a_refused_start_changes_nothing(somebody):
    motion, twin = HUMANS[somebody](), HUMANS[somebody]()
    walk(motion, 1, steps=30)
    walk(twin, 1, steps=30)
    with pytest.raises(ParameterError):
        motion.reset(np.random.default_rng(5), np.array([0.1, 0.1]))
    for _ in range(30):
        np.testing.assert_array_equal(motion.step(DT, nobody()).start, twin.step(DT, nobody()).start)


@pytest.mark.long
@pytest.mark.parametrize("dt", [0.001, 0.008, 0.013, 0.1])
def test_promises_hold_for_other_steps_too(somebody, dt):
    motion = HUMANS[somebody]()
    for seed in range(5):
        seen = walk(motion, seed, steps=int(8.0 / dt), dt=dt)
        path, speeds = roots(seen), velocities(seen)
        np.testing.assert_allclose(path[:-1] + dt * speeds[:-1], path[1:], atol=1e-12)
        assert np.hypot(*path.T).min() >= motion.clearance
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
        start=2.0,
        nearest=(0.7, 0.7),
        side=(0.1, 0.1),
        speed=(0.6, 0.6),
        wait=(0.5, 0.5),
        stay=(1.0, 1.0),
        acceleration=None,
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


@pytest.mark.sampled(12)
@pytest.mark.parametrize("speed", [0.3, 0.37, 0.8, 1.3, 1.6])
@pytest.mark.parametrize("dt", [0.008, 0.05])
@pytest.mark.parametrize("acceleration", [None, 3.0, 1.0])
def test_approach_retreat_never_comes_nearer_than_asked(speed, dt, acceleration):
    motion = ApproachRetreat(
        nearest=(CLEARANCE, CLEARANCE), side=(0.0, 0.0), speed=(speed, speed), acceleration=acceleration
    )
    for seed in range(5):
        gap = np.hypot(*roots(walk(motion, seed, steps=int(8.0 / dt), dt=dt)).T).min()
        assert gap >= CLEARANCE - 1e-9
        assert gap <= CLEARANCE + 2.0 * speed * dt


def test_random_walk_changes_gently_and_stays_in_its_region():
    motion = RandomWalk(acceleration=None)
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


@pytest.mark.sampled(8)
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
@pytest.mark.parametrize("acceleration", [None, 3.0, 0.5])
def test_other_random_walks_keep_their_promises_too(arguments, acceleration):
    try:
        motion = RandomWalk(**arguments, acceleration=acceleration)
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


def test_a_region_too_small_to_walk_in_is_refused():
    with pytest.raises(ParameterError, match="region"):
        RandomWalk(region=((0.65, 0.70), (0.0, 0.01))).reset(np.random.default_rng(0))


def test_walk_by_passes_in_the_workspace_and_changes_its_pace():
    stopped, sides = 0, []
    for seed in range(60):
        seen = walk(WalkBy(acceleration=None), seed)
        path, speeds = roots(seen), np.hypot(*velocities(seen).T)
        gap = np.hypot(*path.T)
        assert 0.85 - 1e-9 <= gap.min() <= 1.2 + 1e-3
        # in front or beside, not behind, and well within the episode
        nearest = path[gap.argmin()]
        assert np.abs(np.arctan2(nearest[1], nearest[0])) <= np.deg2rad(121.0)
        assert gap.argmin() * DT <= 6.5
        walking = speeds[speeds > 0.0]
        assert np.all((walking >= 0.3 - 1e-12) & (walking <= 1.0 + 1e-12))
        assert walking.max() - walking.min() <= 0.4 * walking.max() + 1e-12
        assert len(np.unique(walking.round(12))) > 3
        stopped += np.any(speeds == 0.0)
        still = np.count_nonzero(speeds == 0.0) * DT
        assert still == 0.0 or 0.3 - DT <= still <= 1.5 + DT
        direction = np.diff(path, axis=0)[walking.size // 2]
        sides.append(np.sign(nearest[0] * direction[1] - nearest[1] * direction[0]))
    assert 15 <= stopped <= 45
    assert set(sides) >= {-1.0, 1.0}


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "options", [{}, {"acceleration": None}, {"acceleration": 2.0}, {"feint": True}, {"speed": 0.8}], ids=str
)
def test_pursuit_reaches_an_arm_at_rest_from_every_start(robot, options):
    rng, (low, high) = np.random.default_rng(0), robot.limits.position.T
    for seed in range(12):
        caught = arm(None if seed < 4 else tuple(rng.uniform(low, high).tolist()))
        motion = Pursuit(**options)
        people, gaps = motion.reset(np.random.default_rng(seed)), []
        if seed % 2 == 0:
            bearing, distance = 2.4 * seed, 0.8 + 0.2 * seed
            people = motion.reset(np.random.default_rng(seed), distance * np.array([np.cos(bearing), np.sin(bearing)]))
        for k in range(STEPS):
            people = motion.step(DT, caught)
            if k % 5 == 0:
                gaps.append(surface_distance(people, caught))
                if gaps[-1] <= 0.0:
                    break
        assert gaps[-1] <= 0.0


@pytest.mark.parametrize("acceleration", [None, 5.0, 1.5])
def test_pursuit_follows_the_arm_and_stays_in_contact(acceleration):
    motion = Pursuit(acceleration=acceleration)
    motion.reset(np.random.default_rng(0), np.array([2.0, 0.0]))
    for turn in (0.0, 1.5, -1.5):
        target = arm((turn, 0.0, 0.0, 0.0, -np.pi / 2.0, 0.0))
        for _ in range(600):
            people = motion.step(DT, target)
        assert surface_distance(people, target) < 0.0
        # it has arrived: nothing is left to run to
        np.testing.assert_allclose(people.end_velocity, 0.0, atol=1e-6)


def test_pursuit_overlooks_a_link_that_it_cannot_reach_by_walking():
    # a link overhead is nearer than the one beside it, and 2.3 m up
    link = CapsuleSet(
        np.array([[1.5, 0.0, 2.3], [0.0, 1.0, 1.0]]),
        np.array([[1.5, 0.0, 2.3], [0.0, 1.0, 1.0]]),
        *np.zeros((2, 2, 3)),
        np.full(2, 0.1),
        ("overhead", "beside"),
        np.zeros(2, np.int64),
    )
    seen = walk(Pursuit(), 0, steps=400, start=np.array([1.5, 0.0]), robot=link)
    assert surface_distance(seen[-1], link) <= 0.0
    # alone it is run under, at least
    alone = CapsuleSet(
        *(getattr(link, f)[:1] for f in ("start", "end", "start_velocity", "end_velocity", "radius")),
        ("overhead",),
        np.zeros(1, np.int64),
    )
    seen = walk(Pursuit(), 0, steps=400, start=np.array([2.5, 1.0]), robot=alone)
    assert np.hypot(*(roots(seen)[-1] - [1.5, 0.0])) < 0.7


def test_pursuit_runs_as_it_is_told():
    speeds = np.hypot(*velocities(walk(Pursuit(acceleration=None), 0, steps=100)).T)
    np.testing.assert_array_equal(speeds[0], 0.0)
    np.testing.assert_allclose(speeds[1:], 1.6, rtol=1e-12)
    path = velocities(walk(Pursuit(acceleration=2.0), 0))
    assert np.hypot(*np.diff(path, axis=0).T).max() == pytest.approx(2.0 * DT, rel=1e-9)
    feints = np.array(
        [np.hypot(*velocities(walk(Pursuit(acceleration=None, feint=True), seed, steps=250)).T) for seed in range(10)]
    )
    stops = (feints[:, 1:-1] > 0.0) & (feints[:, 2:] == 0.0)
    assert np.count_nonzero(stops) >= 5
    assert not np.array_equal(feints[0], feints[1])
    # with nobody to run at it stays where it is
    assert np.ptp(roots(walk(Pursuit(), 0, steps=50, robot=nobody())), axis=0).max() == 0.0


@pytest.mark.long
def test_a_hand_touches_an_arm_held_in_reach_and_goes_back():
    right = list(PUBLISHED).index("right_arm")
    for seed in range(15):
        seen = walk(Hand(front=(0.95, 1.05), side=(-0.15, 0.15)), seed)
        out = np.array([np.linalg.norm(capsules.end[right] - seen[0].end[right]) for capsules in seen])
        assert min(surface_distance(capsules, arm()) for capsules in seen[::5]) <= 0.0
        # several strokes, each from rest and back to it
        away = out > 0.05
        assert np.count_nonzero(~away[:-1] & away[1:]) >= 2
        assert np.count_nonzero(away[:-1] & ~away[1:]) >= 2


def test_a_hand_moves_on_straight_strokes_at_up_to_its_speed_and_nothing_else_moves():
    arms = [list(PUBLISHED).index(part) for part in ("right_arm", "left_arm")]
    left, fastest, slowest = [], [], []
    for seed in range(20):
        seen = walk(Hand(), seed)
        ends = np.array([capsules.end_velocity for capsules in seen])
        assert np.array([capsules.start_velocity for capsules in seen]).any() == np.False_
        assert not np.delete(ends, arms, axis=1).any()
        left.append(bool(ends[:, arms[1]].any()))
        speeds = np.linalg.norm(ends[:, arms[0]], axis=-1)
        # straight: while it moves at one speed its direction is one
        same = (speeds[1:] > 0.0) & (np.abs(np.diff(speeds)) < 1e-9)
        a, b = ends[:-1, arms[0]][same], ends[1:, arms[0]][same]
        np.testing.assert_allclose(np.cross(a, b), 0.0, atol=1e-9)
        fastest.append(speeds.max())
        slowest.append(speeds[speeds > 0.0].mean())
        for capsules in seen[::50]:
            stretched = np.linalg.norm((capsules.end - capsules.start)[arms], axis=1)
            assert stretched.max() <= 0.7 + 1e-9
    assert 3 <= sum(left) <= 17
    assert 1.8 < max(fastest) <= 2.0 + 1e-12
    assert min(slowest) > 0.9


def test_a_hand_alone_keeps_still():
    seen = walk(Hand(), 0, steps=200, robot=nobody())
    for capsules in seen:
        np.testing.assert_array_equal(capsules.end, seen[0].end)


# ---- the one that is steered --------------------------------------------------------------------------


def steered(seed, columns=2, **options):
    return Steered(np.random.default_rng(seed).uniform(-1.5, 1.5, (15, columns)), **options)


@pytest.mark.long
@pytest.mark.parametrize("columns", [2, 3])
def test_the_steered_keeps_its_promises(columns):
    for seed in range(10):
        motion = steered(seed, columns)
        assert motion.speed_bound == (1.6 if columns == 2 else 2.0)
        assert motion.reacts == (columns == 3)
        seen = walk(motion, 0)
        for now, then in itertools.pairwise(seen):
            np.testing.assert_allclose(now.start + DT * now.start_velocity, then.start, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(now.end + DT * now.end_velocity, then.end, rtol=0.0, atol=1e-12)
        ends = np.linalg.norm([capsules.end_velocity for capsules in seen], axis=-1)
        assert np.hypot(*velocities(seen).T).max() <= 1.6 + 1e-12
        assert ends.max() <= motion.speed_bound + 1e-12
        assert np.hypot(*np.diff(velocities(seen), axis=0).T).max() <= 8.0 * DT + 1e-9
        for one, other in zip(seen, walk(steered(seed, columns), 99), strict=True):
            np.testing.assert_array_equal(one.end, other.end)


def test_the_steered_goes_where_its_parameters_say():
    motion = Steered([[-1.0, 0.0], [0.0, 0.0], [0.8, 0.6]], acceleration=1.0, period=0.4, start=(2.0, 0.5))
    seen = walk(motion, 0, steps=200)
    path, speeds = roots(seen), velocities(seen)
    np.testing.assert_allclose(path[0], [2.0, 0.5])
    np.testing.assert_allclose(speeds[75], [-0.4, 0.0], atol=1.1 * DT)
    np.testing.assert_allclose(speeds[-1], [-0.08, 0.24], atol=1.1 * DT)
    np.testing.assert_allclose(speeds[150:], np.tile(speeds[150], (51, 1)), rtol=1e-12)
    # saturation keeps the direction
    fast = velocities(walk(Steered([[1.0, 0.5]] * 9, period=0.4), 0, steps=300))
    assert np.hypot(*fast[-1]) == pytest.approx(1.6)
    assert fast[-1][0] == pytest.approx(2.0 * fast[-1][1])
    begun = walk(motion, 0, start=np.array([1.0, 1.0]), steps=1)
    np.testing.assert_allclose(roots(begun)[0], [1.0, 1.0])


def test_the_steered_reaches_for_the_arm_with_its_hand():
    motion = Steered([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], start=(1.0, 0.0), period=1.0)
    seen = walk(motion, 0, steps=250)
    gaps = [surface_distance(capsules, arm()) for capsules in seen[::5]]
    assert gaps[0] > 0.05
    assert min(gaps) <= 0.0
    np.testing.assert_allclose(seen[-1].end, seen[0].end, atol=1e-6)
    assert max(np.linalg.norm(capsules.end_velocity, axis=1).max() for capsules in seen) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"parameters": [1.0, 2.0]}, "segments"),
        ({"parameters": np.zeros((0, 2))}, "segments"),
        ({"parameters": np.zeros((3, 4))}, "segments"),
        ({"parameters": [[np.nan, 0.0]]}, "parameters"),
        ({"parameters": [[0.0, 0.0]], "speed": 0.0}, "speed"),
        ({"parameters": [[0.0, 0.0]], "limb_speed": 1.0}, "limb_speed"),
        ({"parameters": [[0.0, 0.0]], "limb_acceleration": 5.0}, "limb_acceleration"),
        ({"parameters": [[0.0, 0.0]], "limb_acceleration": 0.0}, "limb_acceleration"),
        ({"parameters": [[0.0, 0.0]], "start": (0.1, 0.1)}, "0.6"),
        ({"parameters": [[0.0, 0.0]], "period": -1.0}, "period"),
    ],
    ids=str,
)
def test_bad_steering_is_named(arguments, word):
    with pytest.raises(ParameterError, match=word):
        Steered(**arguments)


def test_new_people_make_a_crowd():
    crowd = Crowd([WalkBy(), Pursuit(), Hand(), steered(0, 3)])
    assert crowd.reacts
    assert crowd.speed_bound == 2.0
    assert crowd.clearance == 0.0
    assert Crowd([WalkBy(), Hand()]).clearance == 0.6
    seen = walk(crowd, 0, steps=100)
    assert seen[-1].person.tolist() == [k for k in range(4) for _ in range(6)]
    assert not np.array_equal(seen[-1].end[6:12], seen[0].end[6:12])


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
        (WalkBy, "speed"),
        (WalkBy, "offset"),
        (WalkBy, "passing"),
        (WalkBy, "stop"),
        (Pursuit, "distance"),
        (Hand, "front"),
        (Hand, "speed"),
        (Hand, "pause"),
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
        (WalkBy, {"change": 1.5}, "change"),
        (WalkBy, {"change": "much"}, "change"),
        (WalkBy, {"offset": (0.5, 1.0)}, "0.6"),
        (Pursuit, {"speed": 0.0}, "speed"),
        (Pursuit, {"acceleration": -1.0}, "acceleration"),
        (Pursuit, {"distance": (0.1, 2.0)}, "distance"),
        (Hand, {"both": 1.5}, "both"),
        (Hand, {"both": np.nan}, "both"),
        (Hand, {"length": 0.0}, "length"),
        (Hand, {"front": (0.5, 1.0)}, "0.6"),
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
