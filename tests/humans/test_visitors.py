"""People who come and go in environments: when, how fast, how many; and what takes them and what refuses them."""

import copy
import itertools
from dataclasses import asdict

import gymnasium as gym
import numpy as np
import pytest

from jssa_gym import ArmEnv, JSSAShield, SensorModel, Shield, Status, VectorArmEnv
from jssa_gym.evaluation import rollout
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.humans import Crowd, Visitors, WalkBy, make_human
from jssa_gym.humans.body import NAMES
from jssa_gym.policies import HoldPolicy
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.region import WatchedRegion

DT = 0.008


def walk(motion, seed, steps):
    people = [motion.reset(np.random.default_rng(seed))]
    for _ in range(steps):
        people.append(motion.step(DT, people[-1]))
    return people


@pytest.fixture(scope="module")
def seen():
    """Five minutes of somebody's work."""
    return walk(Visitors(), 0, 37_500)


def numbers(people):
    return np.array([len(one.radius) // 6 for one in people])


def test_they_come_and_go_several_at_once_and_never_more_than_may(seen):
    count = numbers(seen)
    assert set(count) == {0, 1, 2, 3}
    ids = [tuple(one.person[::6]) for one in seen]
    everybody = set().union(*ids)
    # one every 3.3 s in the mean, but for those who find it full
    assert 30 < len(everybody) < 100
    assert sorted(everybody) == list(range(len(everybody)))
    for one in seen:
        assert one.names == NAMES * (len(one.radius) // 6)
        assert np.array_equal(one.person, np.repeat(one.person[::6], 6))
    # who has gone does not come back
    for who in everybody:
        there = np.flatnonzero([who in now for now in ids])
        assert np.array_equal(there, np.arange(there[0], there[-1] + 1))


def test_they_begin_and_end_outside_and_walk_through_the_box(seen):
    motion = Visitors()
    middle = {}
    for before, now in itertools.pairwise(seen):
        for who in np.setxor1d(before.person, now.person):
            people = now if who in now.person else before
            part = people.person == who
            ends, radius = (
                np.concatenate([people.start[part], people.end[part]])[:, :2],
                np.tile(people.radius[part], 2),
            )
            beyond = [
                (np.array(motion.low[:2]) - (ends + radius[:, None]).max(axis=0)).max(),
                ((ends - radius[:, None]).min(axis=0) - motion.high[:2]).max(),
            ]
            assert max(beyond) >= 0.0
        for who in set(now.person):
            start = now.start[now.person == who][0, :2]
            middle[who] = min(middle.get(who, np.inf), float(np.hypot(*start)))
    near = [distance for who, distance in middle.items() if who not in seen[-1].person]
    assert min(near) >= 0.85 - 1e-6
    assert np.max(near) < 1.2


def test_they_keep_their_speed_and_acceleration(seen):
    motion, turns = Visitors(), []
    for before, now in itertools.pairwise(seen):
        assert np.linalg.norm(now.start_velocity, axis=1).max(initial=0.0) <= motion.speed_bound + 1e-9
        for who in np.intersect1d(before.person, now.person):
            a, b = before.person == who, now.person == who
            np.testing.assert_allclose(now.start[b], before.start[a] + DT * before.start_velocity[a], atol=1e-9)
            turns.append(np.abs(now.start_velocity[b] - before.start_velocity[a]).max())
    assert max(turns) <= motion.acceleration * DT + 1e-9


def test_the_same_seed_brings_the_same_visitors():
    for one, other in zip(walk(Visitors(rate=2.0), 5, 800), walk(Visitors(rate=2.0), 5, 800), strict=True):
        np.testing.assert_array_equal(one.start, other.start)
        np.testing.assert_array_equal(one.person, other.person)
    assert numbers(walk(Visitors(rate=2.0), 6, 800)).tolist() != numbers(walk(Visitors(rate=2.0), 5, 800)).tolist()


def test_more_come_at_a_higher_rate_and_fewer_where_fewer_may():
    few, many = (numbers(walk(Visitors(rate=rate), 1, 4000)).mean() for rate in (0.1, 3.0))
    assert few < many
    assert set(numbers(walk(Visitors(rate=3.0, most=1), 1, 2000))) == {0, 1}


@pytest.mark.parametrize(
    "changes",
    [
        {"rate": 0.0},
        {"most": 0},
        {"speed": (0.0, 1.0)},
        {"offset": (0.1, 0.2)},
        {"low": (-1.0, -1.0, 0.0)},
        {"high": (0.0, 2.0, 2.0)},
        {"low": (0, 0)},
        {"acceleration": -1.0},
    ],
)
def test_what_no_stream_can_be_is_refused(changes):
    with pytest.raises(ParameterError):
        Visitors(**changes)


# ---- environments -------------------------------------------------------------------------------------


def test_observations_keep_their_size_whoever_is_there():
    env = ArmEnv(human=Visitors(rate=2.0), terminate_on=())
    other = ArmEnv(human="walk_by")
    assert env.observation_space == other.observation_space
    observation, info = env.reset(seed=0)
    keys, there = set(info), set()
    for _ in range(700):
        observation, _, _, _, info = env.step(np.zeros(6))
        assert env.observation_space.contains(observation)
        assert keys <= set(info)
        there.add(len(env.scene.human.radius))
        assert np.isfinite(info["distance"]) == bool(len(env.scene.human.radius))
    assert {0, 6, 12} <= there


@pytest.mark.parametrize("filter", ["jssa+stop", "stop", "work"])
def test_a_shield_by_its_name_watches_where_they_come(filter):
    env = Shield(ArmEnv(human="visitors"), filter)
    assert env.filter.failsafe.watched == WatchedRegion.box(
        (-1.8, -1.8, 0.0), (1.8, 1.8, 2.5), ("bottom", "top"), entry_speed=2.0
    )


def test_a_shielded_visitors_environment_watches_and_goes_on_without_end():
    env = gym.make("jssa_gym/TrackShielded-v0", human=Visitors(rate=2.0), max_episode_steps=-1)
    assert env.get_wrapper_attr("filter").failsafe.watched is not None
    env.reset(seed=1)
    there, faults = set(), 0
    for _ in range(900):
        _, _, terminated, truncated, info = env.step(np.zeros(6))
        assert (terminated, truncated, info["limit_violation"]) == (False, False, False)
        assert info["contact_speed"] <= 1e-3
        there.add(len(env.unwrapped.scene.human.radius))
        faults += info["shield/status"] == Status.FAULT
    assert len(there) > 2
    assert faults == 0


def test_the_assumptions_of_ones_own_are_asked_too_unless_they_say_where():
    own = WatchedRegion.box((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0))
    assert JSSAShield(ArmEnv(human="visitors"), failsafe={"max_age": 0.1}).filter.failsafe.watched is not None
    assert JSSAShield(ArmEnv(human="visitors"), watched=own).filter.failsafe.watched == own
    assert JSSAShield(ArmEnv(human="visitors"), failsafe={"watched": asdict(own)}).filter.failsafe.watched == own
    assert JSSAShield(ArmEnv(human="visitors"), failsafe=False).filter.failsafe is None
    assert JSSAShield(ArmEnv(human="walk_by")).filter.failsafe.watched is None


def test_copies_go_on_alike():
    env = JSSAShield(ArmEnv(human=Visitors(rate=3.0), terminate_on=()))
    env.reset(seed=2)
    for _ in range(150):
        env.step(np.full(6, 0.1))
    other = copy.deepcopy(env)
    for _ in range(150):
        one, two = (it.step(np.full(6, -0.1)) for it in (env, other))
        np.testing.assert_array_equal(one[0], two[0])
        assert one[4]["shield/reason"] == two[4]["shield/reason"]


def test_who_cannot_take_them_says_so_by_name():
    with pytest.raises(ParameterError, match="Visitors come and go"):
        VectorArmEnv(2, human="visitors")
    with pytest.raises(ParameterError, match="Visitors come and go"):
        SensorModel(ArmEnv(human="visitors"), "noise")
    with pytest.raises(ParameterError, match="Visitors come and go"):
        Crowd([WalkBy(), Visitors()])
    env = ArmEnv(human="visitors")
    with pytest.raises(InterfaceError, match="Visitors come and go"):
        rollout(env, HoldPolicy(env), seed=0, steps=3)
    assert isinstance(make_human("visitors"), Visitors)


@pytest.mark.parametrize(
    "make", [lambda env: JSSAShield(env, failsafe=FailsafeParams()), lambda env: Shield(env, "stop")]
)
def test_a_spec_makes_it_anew_and_it_watches(make):
    env = make(gym.make("jssa_gym/Home-v0", human="visitors"))
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.get_wrapper_attr("filter").failsafe == env.filter.failsafe
    assert env.filter.failsafe.watched is not None
