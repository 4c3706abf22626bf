"""Bounds on how fast people change their velocity, and the motions without one."""

import functools
import math

import gymnasium as gym
import numpy as np
import pytest

from jssa_gym.evaluation.people import ABRUPT, PEOPLE
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import (
    HUMANS,
    ApproachRetreat,
    Body,
    Crowd,
    Hand,
    Pursuit,
    RandomWalk,
    Receive,
    Steered,
    WalkBy,
    make_human,
)
from jssa_gym.humans.acceleration import towards
from jssa_gym.humans.body import NAMES
from jssa_gym.humans.hand import Limb
from jssa_gym.kernels.walkers import stopping_speed

DT = 0.008


def search(**options):
    return Steered(np.cos(np.arange(36.0)).reshape(12, 3), **options)


BOUNDED = {
    "approach_retreat": ApproachRetreat,
    "random": RandomWalk,
    "walk_by": WalkBy,
    "pursuit": Pursuit,
    "feint": functools.partial(Pursuit, feint=True),
    "hand": Hand,
    "receive": Receive,
}
"""Whose velocity could change at once."""

# made with the commit before there was a bound: the sum over all ticks k of 1001, weighed by cos(k), of the ends'
# places, weighed by (1, 2, 3); seeds 0, 1, 2
BEFORE = {
    "approach_retreat": (81.175165578, 91.401367521, 81.652676815),
    "random": (81.673769357, 84.357177521, 69.183179764),
    "walk_by": (95.385154141, 109.860784724, -42.876776227),
    "pursuit": (30.140263284, 47.224784366, 24.928763464),
    "feint": (29.609902929, 47.27287059, 25.005588017),
    "hand": (68.892643741, 84.157212635, 67.009288571),
    "receive": (73.518677021, 85.645459285, 72.528649299),
    "steered": (-6.192713389,),
}


@functools.cache
def arm():
    env = gym.make("jssa_gym/Home-v0", human="none").unwrapped
    env.reset(seed=0)
    return env.robot_capsules


def walk(motion, seed, steps=1000, dt=DT, start=None):
    """Ends (T, 2, m, 3) of an episode beside the arm at home, and their velocities."""
    seen = [motion.reset(np.random.default_rng(seed), start)]
    seen += [motion.step(dt, arm()) for _ in range(steps)]
    ends = np.array([(people.start, people.end) for people in seen])
    return ends, np.array([(people.start_velocity, people.end_velocity) for people in seen])


def changes(velocity):
    return np.linalg.norm(np.diff(velocity, axis=0), axis=-1)


# ---- every motion ------------------------------------------------------------------------------------


def test_everybody_whose_velocity_may_change_has_a_bound():
    without = {name for name, make in HUMANS.items() if not hasattr(make(), "acceleration")}
    assert without == {"none", "constant_velocity", "recorded"}
    for name, make in HUMANS.items():
        if name not in without:
            motion = make()
            moves_a_hand = isinstance(motion, Hand | Receive)
            assert 10.0 <= motion.acceleration <= 50.0 if moves_a_hand else 1.5 <= motion.acceleration <= 5.0


@pytest.mark.sampled(6)
@pytest.mark.parametrize("dt", [0.002, DT, 0.05])
@pytest.mark.parametrize("acceleration", [0.7, 3.0, 30.0, "default"])
@pytest.mark.parametrize("name", BOUNDED)
def test_no_end_of_a_capsule_is_accelerated_more_than_the_bound(name, acceleration, dt):
    motion = BOUNDED[name](**{} if acceleration == "default" else {"acceleration": acceleration})
    fastest = 0.0
    for seed in range(4):
        ends, velocity = walk(motion, seed, steps=int(8.0 / dt), dt=dt)
        fastest = max(fastest, changes(velocity).max())
        # the velocity is that of the step to come, and within its own bound
        np.testing.assert_allclose(ends[:-1] + dt * velocity[:-1], ends[1:], rtol=0.0, atol=1e-12)
        assert np.linalg.norm(velocity, axis=-1).max() <= motion.speed_bound + 1e-12
        if motion.clearance:
            assert np.hypot(*ends[:, 0, 0, :2].T).min() >= motion.clearance
    assert fastest <= motion.acceleration * dt * (1.0 + 1e-9)
    if dt < 0.05:
        assert fastest >= 0.9 * motion.acceleration * dt  # no idle one


@pytest.mark.parametrize("name", BOUNDED)
def test_wherever_somebody_starts_the_bounds_hold(name):
    for seed, start in enumerate([(0.63, 0.0), (0.9, -0.4), (1.9, 1.1), (2.0, -1.2), (0.87, 0.0), (0.65, 0.0)]):
        motion = BOUNDED[name]()
        try:
            ends, velocity = walk(motion, seed, start=np.array(start))
        except ParameterError:
            continue
        assert changes(velocity).max() <= motion.acceleration * DT * (1.0 + 1e-9)
        assert np.hypot(*ends[:, 0, 0, :2].T).min() >= motion.clearance - 1e-9


@pytest.mark.parametrize("name", BEFORE)
def test_without_a_bound_a_motion_is_what_it_was(name):
    kind, word = BOUNDED.get(name, search), "limb_acceleration" if name == "steered" else "acceleration"
    for seed, expected in enumerate(BEFORE[name]):
        ends, velocity = walk(kind(**{word: None}), seed)
        seen = ends.sum(axis=(1, 2)) @ np.array([1.0, 2.0, 3.0]) * np.cos(np.arange(1001.0))
        assert seen.sum() == pytest.approx(expected, abs=2e-8)
        assert name == "steered" or changes(velocity).max() > 0.05  # and that is at once


@pytest.mark.parametrize("name", BOUNDED)
@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan, "fast", True], ids=str)
def test_a_bound_is_positive_or_none(name, value):
    with pytest.raises(ParameterError, match="acceleration"):
        BOUNDED[name](acceleration=value)


def test_people_without_a_bound_have_names_for_the_commands():
    assert set(ABRUPT) <= set(PEOPLE)
    for name, make in ABRUPT.items():
        usual = make_human(PEOPLE[name.removesuffix(" abrupt")]())
        motion = make_human(make())
        pairs = zip(motion.motions, usual.motions, strict=True) if isinstance(motion, Crowd) else [(motion, usual)]
        for one, other in pairs:
            assert type(one) is type(other)
            assert one.acceleration == math.inf > other.acceleration
            differing = {word for word, value in vars(one).items() if np.any(value != vars(other)[word])}
            assert differing == {"acceleration"}
    # speed alone is what these are asked for
    assert PEOPLE["pursuit x2"]().acceleration == PEOPLE["hand x2"]().acceleration == math.inf


# ---- each one ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("stay", [0.0, 0.05, 1.0])
@pytest.mark.parametrize("acceleration", [1.5, 3.0])
def test_who_approaches_slows_down_turns_and_ramps_up(acceleration, stay):
    fixed = {"nearest": 0.7, "side": 0.1, "speed": 0.6, "wait": 0.5, "stay": stay}
    motion = ApproachRetreat(start=2.0, **{n: (v, v) for n, v in fixed.items()}, acceleration=acceleration)
    ends, velocity = walk(motion, 0, steps=1250)
    path, along = ends[:, 0, 0, :2], velocity[:, 0, 0, 0]
    np.testing.assert_allclose(path[:, 1], 0.1, atol=1e-12)
    ramp, leg = 0.6 / acceleration, 1.3 * 2.0 / 3.0 / 0.6
    # the same walk at once, and its mean over a ramp, one step later, when the person begins to move
    moments = np.cumsum([0.5, leg, leg, ramp + stay, 1.3 / 0.6])
    levels = np.array([0.0, -0.6, -0.3, 0.0, 0.6, 0.0])
    times = np.arange(-4000, 80000) * 1e-4
    places = 2.0 + np.cumsum(levels[np.searchsorted(moments, times)]) * 1e-4
    smooth = np.convolve(places, np.ones(round(ramp / 1e-4)) / round(ramp / 1e-4), mode="full")[: len(times)]
    ticks = np.arange(2, 900)
    np.testing.assert_allclose(path[ticks, 0], np.interp((ticks - 1) * DT, times, smooth), atol=5e-4)
    # as near as asked, and stands there for as long as asked
    assert path[:, 0].min() == pytest.approx(0.7, abs=acceleration * DT**2)
    assert path[:, 0].min() >= 0.7 - 1e-9
    still = np.flatnonzero((np.abs(along) < 1e-9) & (path[:, 0] < 0.71))
    assert len(still) * DT == pytest.approx(stay, abs=2 * DT)
    assert np.abs(along).max() == pytest.approx(0.6, abs=1e-9)
    np.testing.assert_allclose(path[-1], (2.0, 0.1), atol=1e-9)
    assert np.abs(along[-1]) < 1e-9


def test_a_very_short_approach_keeps_the_bound_too():
    options = {"start": 0.9, "nearest": (0.85, 0.85), "speed": (1.6, 1.6), "wait": (0.0, 0.0), "stay": (0.0, 0.0)}
    ends, velocity = walk(ApproachRetreat(**options), 0)
    assert changes(velocity).max() <= 3.0 * DT * (1.0 + 1e-9)
    assert ends[:, 0, 0, 0].min() == pytest.approx(0.85, abs=1e-3)
    for speed, wait in ((0.0, 0.0), (0.0, 1.0)):
        ends, _ = walk(ApproachRetreat(speed=(speed, speed), wait=(wait, wait)), 0)
        assert np.ptp(ends, axis=0).max() == 0.0


def test_who_wanders_brakes_in_time_for_the_border():
    options = {"speed": 1.6, "change": 3.2, "period": 0.5, "region": ((0.7, 1.3), (-0.3, 0.3))}
    nearest = np.inf
    for seed in range(20):
        ends, velocity = walk(RandomWalk(**options, acceleration=1.5), seed)
        path = ends[:, 0, 0, :2]
        gap = np.minimum(path - (0.7, -0.3), (1.3, 0.3) - path)
        nearest = min(nearest, gap.min())
        assert gap.min() >= 0.0
        assert changes(velocity).max() <= 1.5 * DT * (1.0 + 1e-9)
        assert changes(ends).sum() > 1.0  # nobody gets stuck there
    assert nearest < 0.01


def test_who_wanders_gets_away_from_the_border():
    for start in ((0.65, -1.2), (2.0, 1.2), (0.65, 0.0), (2.0, 0.3)):
        ends, _ = walk(RandomWalk(), 0, start=np.array(start))
        assert np.hypot(*np.ptp(ends[:, 0, 0, :2], axis=0)) > 0.3
    # all of it is border
    ends, _ = walk(RandomWalk(region=((0.65, 2.0), (0.0, 1e-9))), 0)
    assert np.ptp(ends[:, 0, 0, 0]) > 0.3


def test_who_walks_by_has_walked_before_and_stops_within_the_bound():
    stopped = 0
    for seed in range(20):
        _, velocity = walk(WalkBy(), seed)
        _, before = walk(WalkBy(acceleration=None), seed)
        np.testing.assert_array_equal(velocity[0], before[0])
        speed, abrupt = np.linalg.norm(velocity[:, 0, 0], axis=-1), np.linalg.norm(before[:, 0, 0], axis=-1)
        # the same pace, a little later
        ramp = math.ceil(1.0 / 3.0 / DT)
        settled = np.array([np.ptp(abrupt[max(k - ramp, 0) : k + 1]) == 0.0 for k in range(len(abrupt))])
        np.testing.assert_allclose(speed[settled], abrupt[settled], atol=1e-12)
        stopped += bool(np.any(speed == 0.0))
    assert stopped >= 5


@pytest.mark.parametrize("acceleration", [5.0, 2.0])
def test_who_runs_at_the_arm_hits_it_at_full_speed(acceleration):
    for seed in range(8):
        motion = Pursuit(acceleration=acceleration)
        people = motion.reset(np.random.default_rng(seed))
        for _ in range(1000):
            people = motion.step(DT, arm())
            if motion.record[0]["touches"]:
                break
        assert motion.record[0]["touches"]
        assert np.linalg.norm(people.start_velocity[0]) > 1.6 - acceleration * DT - 1e-9


@pytest.mark.parametrize("name", ["hand", "receive"])
def test_a_hand_leaves_and_arrives_gently_and_gets_as_far_as_before(name):
    arms = [NAMES.index("right_arm"), NAMES.index("left_arm")]
    for seed in range(10):
        ends, velocity = walk(BOUNDED[name](), seed, steps=1250)
        before, _ = walk(BOUNDED[name](acceleration=None), seed, steps=1250)
        hands = np.linalg.norm(ends - ends[0], axis=-1)[:, 1, arms].max()
        assert hands == pytest.approx(np.linalg.norm(before - before[0], axis=-1)[:, 1, arms].max(), abs=1e-6)
        # in between it is at rest, or turns
        assert np.linalg.norm(velocity[20:, 1, arms[0]], axis=-1).min() < 30.0 * DT


@pytest.mark.parametrize("limb_acceleration", [8.0, 30.0])
def test_the_hand_of_a_search_keeps_its_bounds_in_the_body_and_in_the_world(limb_acceleration):
    right, fastest = NAMES.index("right_arm"), 0.0
    for seed in range(12):
        shares = np.sign(np.random.default_rng(seed).standard_normal((40, 3)))
        motion = Steered(shares, period=0.1, start=(0.9, 0.1), limb_acceleration=limb_acceleration)
        ends, velocity = walk(motion, 0)
        hand = velocity[:, 1, right] - velocity[:, 0, right]
        assert changes(hand).max() <= limb_acceleration * DT * (1.0 + 1e-9)
        assert changes(velocity[:, 0]).max() <= 8.0 * DT * (1.0 + 1e-9)
        speed = np.linalg.norm(hand, axis=-1) + np.linalg.norm(velocity[:, 0, right], axis=-1)
        assert speed.max() <= 2.0 + 1e-9
        assert np.linalg.norm(ends[:, 1, right] - ends[:, 0, right], axis=-1).max() <= 0.7 + 1e-6
        fastest = max(fastest, changes(hand).max())
    assert fastest >= 0.99 * limb_acceleration * DT


def test_an_arm_is_never_longer_however_its_goal_jumps():
    rng, longest = np.random.default_rng(0), 0.0
    limb = Limb(Body.facing(), NAMES.index("right_arm"), acceleration=8.0)
    for k in range(4000):
        if k % 30 == 0:
            way = rng.standard_normal(3)
            limb.point(2.0 * way / np.linalg.norm(way) + (0.0, 0.2, 1.3))
        limb.move(DT)
        limb.head(2.0, DT)
        longest = max(longest, math.dist(limb.record[0]["hand"], limb.record[0]["shoulder"]))
    assert 0.69 < longest <= 0.7 + 1e-6


# ---- what they are made of ---------------------------------------------------------------------------


def stopping_place(speed, acceleration):
    """Where somebody comes to rest, beyond the beginning, who walks the step to come and brakes from then on [m]."""
    most = acceleration * DT
    steps = max(math.ceil(speed / most), 1)
    return DT * (steps * speed - most * steps * (steps - 1) / 2.0)


@pytest.mark.parametrize("acceleration", [1.5, 3.0, 30.0])
@pytest.mark.parametrize("way", [0.0, 1e-12, 1e-5, 0.003, 0.1, 1.0])
def test_the_stopping_speed_ends_exactly_where_it_should(way, acceleration):
    place, speed = 0.0, stopping_speed(way, acceleration, DT)
    most = acceleration * DT
    # any faster would not do
    assert stopping_place(speed + most / 10.0, acceleration) > way
    assert stopping_place(speed, acceleration) == pytest.approx(way, abs=1e-12)
    for _ in range(1000):
        place += speed * DT
        follows = stopping_speed(max(way - place, 0.0), acceleration, DT)
        assert speed - follows <= most * (1.0 + 1e-9) + 1e-12
        speed = follows
    assert place == pytest.approx(way, abs=1e-12)
    assert stopping_speed(way, math.inf, DT) == way / DT


def test_a_bound_on_the_speed_that_falls_is_kept_first():
    for seed in range(200):
        rng = np.random.default_rng(seed)
        before, wanted = rng.standard_normal((2, 3))
        fastest = np.linalg.norm(before) - rng.uniform(-1.0, 1.0) * 0.02
        wanted *= rng.uniform(0.0, 1.0) * fastest / np.linalg.norm(wanted)
        velocity = np.array(towards(before, wanted, 3.0, DT, fastest))
        assert np.linalg.norm(velocity - before) <= 3.0 * DT * (1.0 + 1e-9)
        assert np.linalg.norm(velocity) <= fastest * (1.0 + 1e-12)
        assert np.linalg.norm(velocity - wanted) <= np.linalg.norm(before - wanted)
