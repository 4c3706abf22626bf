"""Shields around people who come and go: nobody who comes in is met by a moving arm, seen or not."""

import copy
import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from visitors import Runner, ball

import jssa_gym
from jssa_gym import ArmEnv, JSSAShield, Shield, Status
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import Body, nobody, together
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.region import WatchedRegion
from jssa_gym.shields import NoFilter, make_filter
from jssa_gym.shields.batch import Batch

DT, HALF, SPEED = 0.008, 0.9, 2.0
MOVING = 1e-3
REGION = WatchedRegion.box((-HALF, -HALF, 0.0), (HALF, HALF, 3.0), ("bottom", "top"), SPEED)
BLIND = WatchedRegion.box((-HALF, -HALF, 0.0), (HALF, HALF, 3.0), ("left", "right", "back", "front", "bottom", "top"))
"""The same, through whose faces nobody comes, as is said."""


@pytest.fixture(params=[12, pytest.param(150, marks=pytest.mark.slow)])
def count(request):
    """Number of episodes; the large one runs with -m slow."""
    return request.param


def play(region, seed, ticks=160):
    """Fastest contact of an arm that is thrown about while somebody runs in; whether it moved, and the shield."""
    env = Shield(ArmEnv(human=Runner(HALF), terminate_on=()), "stop", stop=FailsafeParams(watched=region))
    rng, fastest, moved = np.random.default_rng(seed), 0.0, 0.0
    _, info = env.reset(seed=seed)
    action = rng.choice([-1.0, 1.0], 6)
    for _ in range(ticks):
        if rng.random() < 0.1:
            action = rng.choice([-1.0, 1.0], 6)
        _, _, _, _, info = env.step(action)
        moved = max(moved, float(np.abs(env.unwrapped.scene.robot.velocity).max()))
        assert not info["limit_violation"]
        if info["contact"]:
            fastest = max(fastest, info["contact_speed"])
    return fastest, moved, env


@pytest.mark.long
def test_who_runs_in_at_the_edge_never_meets_a_moving_arm_and_does_if_the_edge_is_left_out(count):
    watched, blind = (np.array([play(region, seed)[:2] for seed in range(count)]) for region in (REGION, BLIND))
    assert watched[:, 0].max() <= MOVING
    assert np.all(watched[:, 1] > 0.05)
    assert (blind[:, 0] > MOVING).mean() > 0.2


def scene_of(make_scene, robot, filter, people, time, **changes):
    return make_scene(filter.expected, people, time=time)._replace(**changes)


def moving(robot, make_scene, region=REGION, ticks=40, jerk=2.0, **changes):
    """A filter whose arm moves, and the time."""
    filter = NoFilter(robot, DT, viability=True, failsafe=FailsafeParams(**({"watched": region} | changes)))
    filter.reset(make_scene([robot.home, np.zeros(6), np.zeros(6)]))
    nominal = np.array([jerk, 0.0, 0.0, 0.0, 0.0, 0.0])
    for k in range(ticks):
        decision = filter.decide(scene_of(make_scene, robot, filter, nobody(), k * DT), nominal)
        assert decision.status == Status.NOMINAL, decision.reason
    return filter, ticks * DT


def test_the_reason_says_who_could_come(robot, make_scene):
    filter = NoFilter(robot, DT, viability=True, failsafe=FailsafeParams(watched=REGION))
    filter.reset(make_scene([robot.home, np.zeros(6), np.zeros(6)]))
    reasons = set()
    for k in range(120):
        nominal = np.array([0.0, 40.0, 0.0, 0.0, 0.0, 0.0])
        decision = filter.decide(scene_of(make_scene, robot, filter, nobody(), k * DT), nominal)
        assert decision.status in (Status.NOMINAL, Status.PROJECTED, Status.FAILSAFE)
        reasons.add(decision.reason.split(" at ")[0])
        if "somebody" in decision.reason:
            assert jssa_gym.shields.reasons.reason_code(decision) == 306
    assert "somebody unseen could be" in reasons


def test_the_older_the_last_frame_the_earlier_the_arm_stops(robot, make_scene):
    def ticks_until_it_says_no(age, **changes):
        filter = NoFilter(robot, DT, viability=True, failsafe=FailsafeParams(watched=REGION, **changes))
        filter.reset(make_scene([robot.home, np.zeros(6), np.zeros(6)]))
        for k in range(400):
            scene = scene_of(make_scene, robot, filter, nobody(), k * DT, frame_age=age)
            if filter.decide(scene, np.array([0.0, 3.0, 0.0, 0.0, 0.0, 0.0])).status != Status.NOMINAL:
                return k
        return 400

    plain = ticks_until_it_says_no(0.0)
    assert plain > 20
    assert ticks_until_it_says_no(0.1) < plain
    assert ticks_until_it_says_no(0.0, actuation_lag=0.1) == ticks_until_it_says_no(0.1)
    assert ticks_until_it_says_no(0.0, position_error=0.2) == ticks_until_it_says_no(0.1)
    assert ticks_until_it_says_no(0.0, tracking_error=0.05) < plain


@pytest.mark.parametrize("at", [0.45, 0.6])
def test_who_appears_in_the_middle_is_a_fault_until_a_stop_is_verified_and_a_track_from_then_on(robot, make_scene, at):
    filter, time = moving(robot, make_scene, ticks=60)
    assert filter.verified
    person, statuses, reasons = ball((at, 0.25, 1.2), person=5), [], []
    for k in range(200):
        decision = filter.decide(scene_of(make_scene, robot, filter, person, time + k * DT), np.full(6, 2.0))
        statuses.append((decision.status, filter.verified))
        reasons.append(decision.reason)
    # as long as what goes on is verified against them it is nothing, else a fault
    first = next(k for k, (_, verified) in enumerate(statuses) if verified)
    assert all(status == Status.FAULT for status, verified in statuses[:first] if not verified)
    assert all(verified for _, verified in statuses[first:])
    if at == 0.45:
        assert first > 0
        assert reasons[0].startswith("no verified stop: hand can reach")
    assert filter.reading.names == ("hand",)


def test_who_comes_in_at_the_edge_is_no_fault(robot, make_scene):
    filter, time = moving(robot, make_scene)
    person = ball((HALF + 0.1 - SPEED * DT, 0.0, 1.2), (-SPEED, 0.0, 0.0), person=5)
    decision = filter.decide(scene_of(make_scene, robot, filter, person, time), np.array([2.0, 0, 0, 0, 0, 0]))
    assert decision.status != Status.FAULT
    assert filter.verified


@pytest.mark.parametrize(("name", "trusted"), [("hand", True), ("left_foot", False)])
def test_who_comes_in_and_may_be_faster_than_that_is_met_anew(robot, make_scene, name, trusted):
    filter, time = moving(robot, make_scene, ticks=10, jerk=20.0)
    person = ball((HALF + 0.1 - SPEED * DT, 0.0, 1.2), (-SPEED, 0.0, 0.0), person=5, name=name)
    decision = filter.decide(scene_of(make_scene, robot, filter, person, time), np.array([20.0, 0, 0, 0, 0, 0]))
    assert filter.verified == trusted
    assert (decision.status == Status.FAULT) == (not trusted)


def test_pairs_are_numbered_as_the_scene_has_them(robot, make_scene):
    filter = make_filter("jssa+stop", robot, DT, failsafe=FailsafeParams(watched=REGION))
    filter.reset(make_scene([robot.home, np.zeros(6), np.zeros(6)]))
    near, far = ball((0.75, 0.0, 1.2), person=1), ball((3.0, 0.0, 1.2), person=2)
    # whoever is near is lost at the end, and in no scene any more
    for k, (people, column) in enumerate([([near], 0), ([far, near], 1), ([near, far], 0), ([far], -1)]):
        decision = filter.decide(scene_of(make_scene, robot, filter, together(people), k * DT), np.full(6, 0.1))
        assert decision.pair[1] == column


class Come(jssa_gym.humans.HumanMotion):
    """Somebody who is there now and then, far away."""

    people, speed_bound, reacts = 1, 1.0, False

    def reset(self, rng, start=None, person=0):
        self._ticks = 0
        return nobody()

    def step(self, dt, robot):
        self._ticks += 1
        count = (self._ticks // 7) % 3
        return together([Body.facing(person=k).at((2.5, 2.0 * k), (0.0, 0.0)) for k in range(count)])


@pytest.mark.parametrize("profile", ["paper", "work"])
def test_an_environment_whose_people_come_and_go_has_no_faults(profile):
    env = JSSAShield(ArmEnv(human=Come(), terminate_on=()), profile=profile, watched=REGION)
    env.reset(seed=0)
    numbers = set()
    for _ in range(60):
        info = env.step(np.full(6, 0.02))[4]
        numbers.add(len(env.unwrapped.scene.human.radius))
        assert info["shield/status"] != Status.FAULT, info["shield/reason"]
    assert numbers == {0, 6, 12}


def test_copies_and_pickles_go_on_alike(robot, make_scene):
    filter, time = moving(robot, make_scene)
    people = [together([ball((2.0, float(k), 1.0), person=k) for k in range(n)]) for n in (1, 3, 2, 3, 0, 1)]
    for n in (0, 1, 2):
        filter.decide(scene_of(make_scene, robot, filter, people[n], time + n * DT), np.full(6, 2.0))
    others = copy.deepcopy(filter), pickle.loads(pickle.dumps(filter))
    for n in (3, 4, 5):
        at = time + n * DT
        answers = [
            one.decide(scene_of(make_scene, robot, one, people[n], at), np.full(6, 2.0)) for one in (filter, *others)
        ]
        for answer in answers[1:]:
            np.testing.assert_array_equal(answer.jerk, answers[0].jerk)
            assert (answer.status, answer.reason) == (answers[0].status, answers[0].reason)


def test_with_a_region_the_same_people_are_shielded_the_same(robot, make_scene):
    """A region so large that its edge is nowhere near changes nothing beside people who stay."""
    far = WatchedRegion.box((-50, -50, -50), (50, 50, 50))
    envs = [JSSAShield(ArmEnv(human="pursuit", terminate_on=()), watched=region) for region in (None, far)]
    for env in envs:
        env.reset(seed=3)
    rng = np.random.default_rng(0)
    for _ in range(150):
        action = rng.uniform(-1, 1, 6)
        one, other = (env.step(action)[4] for env in envs)
        np.testing.assert_array_equal(one["jerk"], other["jerk"])
        assert one["shield/reason"] == other["shield/reason"]


def test_a_spec_makes_it_anew():
    env = JSSAShield(gym.make("jssa_gym/Home-v0", human="none"), watched=REGION)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.get_wrapper_attr("filter").failsafe == env.filter.failsafe == FailsafeParams(watched=REGION)


def test_it_is_for_a_verified_stop_and_given_once():
    env = ArmEnv()
    with pytest.raises(ParameterError, match="verified stop"):
        JSSAShield(env, failsafe=False, watched=REGION)
    with pytest.raises(ParameterError, match="not both"):
        JSSAShield(env, failsafe=FailsafeParams(watched=REGION), watched=REGION)
    with pytest.raises(ParameterError, match="WatchedRegion"):
        JSSAShield(env, watched="everywhere")


def test_many_arms_at_once_refuse_it_by_name(robot):
    filter = make_filter("jssa+stop", robot, DT, failsafe=FailsafeParams(watched=REGION))
    with pytest.raises(ParameterError, match="watched"):
        Batch(filter, 2, ("head",))


# ---- the guard ----------------------------------------------------------------------------------------


def test_a_guard_lets_people_come_and_go(robot):
    guard = jssa_gym.Guard(watched=REGION)
    guard.start(guard.robot.home)
    body = [Body.facing(person=k).at((2.0, 1.5 * k), (0.0, 0.0)) for k in range(3)]
    for k, people in enumerate([[], [0], [0, 1], [1, 0], [2, 1], [1], []]):
        answer = guard.tick(None, together([body[p] for p in people]), k * DT)
        assert answer.reason == "there is no command", answer.reason


def test_a_guards_frame_is_as_old_as_its_people(robot):
    for empty in (
        jssa_gym.MeasuredPeople(nobody(), age=0.1),
        jssa_gym.MeasuredPeople(nobody(), age=np.zeros(0), frame_age=0.1),
    ):
        guard = jssa_gym.Guard(watched=REGION)
        guard.start(guard.robot.home)
        guard.tick(None, empty, 0.0)
        answers = [guard.tick(None, replace(empty, frame_age=np.nan), DT * k) for k in range(1, 30)]
        assert f"the watched region was not seen completely for {0.1 + 29 * DT:.3f} s" in answers[-1].reason
