"""Interventions that the recorded people made needless, against driving the other arm tick by tick."""

from dataclasses import replace

import numpy as np
import pytest

import jssa_gym
from jssa_gym.envs import ArmEnv
from jssa_gym.evaluation import geometry, rollout, summarise
from jssa_gym.evaluation.spans import spans
from jssa_gym.kernels.motion import integrate, violates
from jssa_gym.kernels.records import STOP, records
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.policies import POLICIES
from jssa_gym.safety.proximity import measure
from jssa_gym.types import CapsuleSet, JointState, Planes

DT, STEPS, ONSET = 0.008, 160, 10


def bounds_of(robot):
    limits = robot.limits
    return limits.bounds()


def driven(trace, robot, first):
    """Whether no harm is done: joint limits and all distances looked at in every tick."""
    bounds, planes = bounds_of(robot), Planes(trace.plane_normal, trace.plane_offset, trace.plane_names)
    states = np.stack([trace.position, trace.velocity, trace.acceleration], axis=1)
    state = np.array(trace.initial_state if first == 0 else states[first - 1])
    jerk = np.clip(trace.nominal[first], -robot.limits.jerk, robot.limits.jerk)
    integrate(state, jerk, DT, state)
    plan, still = records(robot.n, STOP), np.zeros(trace.human_start[0].shape)
    ticks = plan_stop(state, bounds, DT, plan)
    for tick in range(max(125, ticks)):
        if violates(state, jerk, bounds, 1e-9):
            return False
        row = first + tick
        if tick < 125 and row < len(trace.time):
            people = CapsuleSet(
                trace.human_start[row], trace.human_end[row], still, still, trace.human_radius, trace.human_names,
                trace.human_person,
            )  # fmt: skip
            near = measure(robot, JointState(*state), people, planes)
            if near.smallest < trace.d_min or near.own.min() <= 0.0 or near.planes.min() <= 0.0:
                return False
        stop_jerk(plan, tick, jerk)
        integrate(state, jerk, DT, state)
    return True


@pytest.fixture(scope="module")
def swinging():
    """The first joint turns to the left, ever faster; what a filter does from step 10 on is written in later."""
    env = ArmEnv(human="none", terminate_on=())
    action = np.array([1.0, 0, 0, 0, 0, 0])
    return rollout(env, lambda _: action, seed=0, steps=STEPS)


def beside(trace, path, onset=ONSET, **changes):
    """The same arm beside a ball at ``path`` (T + 1, 3) [m], in whose behalf somebody intervened once."""
    path = np.asarray(path)[:, None]
    intervened = np.zeros(STEPS, bool)
    intervened[onset : onset + 5] = True
    values = {
        "initial_human": np.array([path[0], path[0]]),
        "human_start": path[1:],
        "human_end": path[1:],
        "human_radius": np.array([0.1]),
        "human_person": np.zeros(1, np.int64),
        "human_names": ("ball",),
        "intervened": intervened,
        "status": intervened.astype(np.int64),
    }
    return replace(trace, **(values | changes))


def rate(trace, robot):
    return summarise(trace, robot.limits, geometry(trace, robot)).false_intervention_rate


@pytest.fixture(scope="module")
def ahead(swinging, robot):
    """A place on the tool's way that it would not have reached had it stopped after the onset."""
    return geometry(swinging, robot).tip[ONSET] + np.array([0.0, 0.4, 0.0])


def path(ahead, velocity):
    return ahead + np.arange(STEPS + 1)[:, None] * DT * np.array(velocity)


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.0, 0.6, 0.0), (0.5, 0.0, 0.5)])
def test_who_stands_or_turns_away_made_an_intervention_needless(swinging, robot, ahead, velocity):
    trace = beside(swinging, path(ahead, velocity))
    assert rate(trace, robot) == 1.0
    assert driven(trace, robot, ONSET)


def test_who_walks_into_the_arms_way_did_not(swinging, robot, ahead):
    trace = beside(swinging, path(ahead, (0.0, -0.6, 0.0)))
    assert rate(trace, robot) == 0.0
    assert not driven(trace, robot, ONSET)
    # but it was needless if that happened later than one second after it
    begin = path(ahead, (0.0, -0.6, 0.0))
    waiting = np.concatenate([np.tile(ahead, (ONSET + 126, 1)), begin])[: STEPS + 1]
    assert rate(beside(swinging, waiting), robot) == 1.0
    # and of two interventions one may have been needed
    both = np.zeros(STEPS, bool)
    both[[0, ONSET]] = True
    late = np.concatenate([np.tile(ahead, (ONSET + 120, 1)), ahead + np.tile([0.0, -0.4, 0.0], (STEPS, 1))])
    late = beside(swinging, late[: STEPS + 1], intervened=both)
    assert [driven(late, robot, k) for k in (0, ONSET)] == [True, False]
    assert rate(late, robot) == 0.5


def test_d_min_is_the_episodes(swinging, robot, ahead):
    trace = beside(swinging, path(ahead, (0.0, 0.0, 0.0)))
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = (low + high) / 2.0
        low, high = (middle, high) if rate(replace(trace, d_min=middle), robot) == 1.0 else (low, middle)
    assert 0.05 < low < 0.3
    assert driven(replace(trace, d_min=low), robot, ONSET)
    assert not driven(replace(trace, d_min=high), robot, ONSET)


def test_what_is_wanted_counts(swinging, robot, ahead):
    far = path(ahead, (0.0, 5.0, 0.0))
    assert rate(beside(swinging, far), robot) == 1.0
    # beyond the bounds it is clipped, and without a number nobody knows what it would have done
    assert rate(beside(swinging, far, nominal=1e3 * swinging.nominal), robot) == 1.0
    for wrong in (np.nan, np.inf):
        assert rate(beside(swinging, far, nominal=np.full((STEPS, 6), wrong)), robot) == 0.0
    # a jerk that was only clipped was no intervention of the filter's
    clipped = np.full(STEPS, "outside the jerk bounds")
    assert rate(beside(swinging, far, reason=clipped), robot) is None


def test_joint_limits_of_the_stop_count(swinging, robot, ahead):
    far = path(ahead, (0.0, 5.0, 0.0))
    assert rate(beside(swinging, far), robot) == 1.0
    # the last state from which the arm stops before the end of the joint's range, and one beyond it
    high, kept = robot.limits.position[0, 1], []
    for offset in np.linspace(0.0, high - swinging.position[ONSET - 1, 0], 41)[:-1]:
        position = swinging.position + np.array([offset, 0, 0, 0, 0, 0])
        trace = beside(swinging, far, position=position)
        kept.append(rate(trace, robot) == 1.0)
        assert kept[-1] == driven(trace, robot, ONSET)
    assert kept[0]
    assert not kept[-1]


@pytest.mark.long
def test_half_spaces_and_the_arm_itself_count(swinging, robot, ahead):
    low, high = robot.limits.position.T
    rng, far, found = np.random.default_rng(1), np.tile(ahead + np.array([0.0, 9.0, 0.0]), (STEPS + 1, 1)), []
    for _ in range(120):
        posture = rng.uniform(0.7 * low, 0.7 * high)
        # fast enough to come into something on the way to rest
        velocity = rng.uniform(-0.6, 0.6, 6) * robot.limits.velocity
        states = {"position": posture, "velocity": velocity, "acceleration": np.zeros(6)}
        trace = beside(swinging, far, **{name: np.tile(value, (STEPS, 1)) for name, value in states.items()})
        found.append(rate(trace, robot) == 1.0)
        assert found[-1] == driven(trace, robot, ONSET)
    assert 5 < sum(found) < 115


def test_onsets_at_either_end_of_the_recording(swinging, robot, ahead):
    still = path(ahead, (0.0, 0.0, 0.0))
    for onset in (0, STEPS - 1):
        trace = beside(swinging, still, onset)
        assert rate(trace, robot) == float(driven(trace, robot, onset))


def test_none_without_interventions_people_or_a_kinematic_arm(swinging, robot, ahead):
    trace = beside(swinging, path(ahead, (0.0, 0.0, 0.0)))
    assert rate(replace(trace, intervened=np.zeros(STEPS, bool)), robot) is None
    assert rate(replace(trace, dynamics="servo"), robot) is None
    assert rate(replace(swinging, intervened=trace.intervened), robot) is None
    assert summarise(trace, robot.limits).false_intervention_rate is None


@pytest.mark.parametrize("seed", [3, 4])
def test_every_onset_of_a_shielded_episode_is_judged_as_driven(robot, seed):
    base = ArmEnv("reach", human="pursuit", terminate_on=())
    env = jssa_gym.JSSAShield(base)
    trace = rollout(env, POLICIES["wander"](base, seed), seed=seed, steps=400)
    # as if somebody had intervened all the time
    often = np.arange(400) % 4 == 0
    trace = replace(trace, intervened=often, reason=np.full(400, ""))
    onsets = [first for first, _ in spans(often)]
    told = geometry(trace, robot).false_interventions
    assert told.tolist() == [driven(trace, robot, first) for first in onsets]
    assert 5 < told.sum() < len(onsets) - 5
