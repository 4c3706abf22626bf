"""The position controllers of many arms: each does, bit for bit, what one of its own does."""

from collections.abc import Iterator

import gymnasium as gym
import numpy as np
import pytest

from jssa_gym.control import Phase
from jssa_gym.envs import ArmEnv
from jssa_gym.evaluation.record_vector import VectorRecordSafety
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.humans import HUMANS
from jssa_gym.policies import JPCPolicy
from jssa_gym.policies.vector_jpc import VectorJPCPolicy
from jssa_gym.registration import ENTRIES
from jssa_gym.shields import Shield

SHIELDS = [None, "none", "stop", "jssa+stop", "work", "yield"]

BESIDE = {"home": "approach_retreat", "reach": "random", "track": "walk_by", "handover": "receive"}

SAID = ("choice", "override", "status", "margin", "correction", "phi", "slack", "reason_code", "intervened")


class Both:
    """Arms in one vector and as many by themselves, each with a policy, that are compared in every step."""

    def __init__(self, task, shield=None, *, count=2, limit=150, vector=VectorJPCPolicy, policy=JPCPolicy, **options):
        human = options.pop("human", BESIDE[task])
        env_id, arguments = ENTRIES[task].env_id(), {"human": human, "max_episode_steps": limit}
        arguments |= {name: options.pop(name) for name in ("robot", "dt", "terminate_on") if name in options}
        self.vector = gym.make_vec(env_id, count, shield=shield, autoreset_mode="SameStep", **arguments)
        alone = [gym.make(env_id, disable_env_checker=True, **arguments) for _ in range(count)]
        self.alone = [env if shield is None else Shield(env, shield) for env in alone]
        self.make = lambda e, seed: policy(self.alone[e], seed, **options)
        self.many, self.shield, self.count = vector(self.vector, **options), shield, count
        self.choices, self.paces, self.phases, self.ends, self.kinds = set(), set(), set(), 0, set()

    def reset(self, **options):
        self.seen, _ = self.vector.reset(seed=5, **options)
        single = [env.reset(seed=5 + e, **options)[0] for e, env in enumerate(self.alone)]
        np.testing.assert_array_equal(self.seen, single)
        self.policies = [self.make(e, 100 + e) for e in range(self.count)]
        self.many.begin(np.arange(self.count), range(100, 100 + self.count))
        return self

    def step(self, push=0.0):
        actions = self.many(self.seen)
        single = [policy(one) for policy, one in zip(self.policies, self.seen, strict=True)]
        np.testing.assert_array_equal(actions, single)
        if push:
            actions, single = np.full_like(actions, push), np.full_like(actions, push)
        self.phases |= {policy.jpc.phase for policy in self.policies}
        self.seen, rewards, terminated, truncated, infos = self.vector.step(actions)
        kinds = self.vector.kinds() if self.shield else []
        for e, env in enumerate(self.alone):
            one, reward, *over, info = env.step(single[e])
            assert (reward, over) == (rewards[e], [terminated[e], truncated[e]])
            if any(over):
                self.ends += 1
                one, _ = env.reset()
                self.policies[e] = self.make(e, 1000 + self.ends)
                self.many.begin(np.array([e]), [1000 + self.ends])
            elif self.shield:
                assert kinds[e] == info["shield/kind"]
            np.testing.assert_array_equal(self.seen[e], one)
            self.compare(e, infos["final_info"] if any(over) else infos, info)

    def compare(self, e, infos, info):
        for key in SAID if self.shield else ():
            np.testing.assert_array_equal(infos[f"shield/{key}"][e], info[f"shield/{key}"], err_msg=key)
        if self.shield:
            self.choices.add(info["shield/choice"]), self.paces.add(info["shield/override"])
            self.kinds.add(info["shield/kind"])

    def play(self, steps):
        for _ in range(steps):
            self.step()
        return self


def combinations() -> Iterator:
    """Every task and every shield, not all of both: what a policy does depends on the task, what of it is applied on
    the shield."""
    for i, task in enumerate(BESIDE):
        for j, shield in enumerate(SHIELDS):
            yield pytest.param(task, shield, marks=() if (i + j) % 2 == 0 else pytest.mark.slow)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("task", "shield"), list(combinations()))
def test_many_do_what_each_does_by_itself(task, shield) -> None:
    both = Both(task, shield)
    elsewhere = {"joint_position": np.array(both.vector.unwrapped.robot.home) + 0.3}
    both.reset(options=elsewhere if task == "home" else None).play(200)
    assert both.ends >= 2
    if shield is None or task in ("reach", "track"):
        assert Phase.TRACKING in both.phases
    if shield is not None and (task, shield) != ("handover", "jssa+stop"):  # which never lets it begin
        assert {0, -1} <= both.choices
        assert "alternative" in both.kinds


def test_a_shield_inside_other_wrappers_is_offered_paths_all_the_same() -> None:
    both = Both("track", "work", vector=lambda envs, **options: VectorJPCPolicy(VectorRecordSafety(envs), **options))
    both.reset().play(80)
    assert 0 in both.choices


@pytest.mark.long
def test_people_slow_arms_down_along_their_paths() -> None:
    both = Both("track", "work", human="hand", limit=500).reset().play(260)
    assert max(both.choices) > 0
    assert min(both.paces) < 0.5


@pytest.mark.long
def test_who_is_thrown_off_its_path_goes_back_or_brakes() -> None:
    both = Both("track", "jssa+stop", human="hand", limit=400).reset().play(400)
    assert {Phase.YIELDING, Phase.SETTLING, Phase.WAITING} <= both.phases


@pytest.mark.parametrize("shield", [None, "jssa+stop"])
def test_the_paper_s_controllers_do_too(shield) -> None:
    both = Both("track", shield, human="hand", limit=400, yielding=False).reset().play(400)
    assert both.phases >= ({Phase.TRACKING} if shield is None else {Phase.YIELDING, Phase.SETTLING})


@pytest.mark.parametrize("yielding", [True, False])
def test_waypoints_that_were_met_before_somebody_pushes_are_counted(yielding) -> None:
    both = Both("track", human="none", terminate_on=(), limit=900, yielding=yielding, host_delay=0.0).reset()
    both.play(240)
    for _ in range(8):
        both.step(push=0.3)
    both.play(120)
    met = [policy.jpc.met for policy in both.policies]
    assert [jpc.met for jpc in both.many.controllers] == met
    assert min(met) >= 1
    assert yielding or Phase.SETTLING in both.phases


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "options",
    [
        {"host_delay": 0.0},
        {"host_delay": (0.0, 1.2), "patience": 0.4},
        {"host_delay": np.inf, "patience": 0.1},
        {"dt": 0.02},
        {"robot": "ur5e"},
        {"tolerance": 0.05, "clear": 0.02, "human": "hand"},
    ],
    ids=str,
)
def test_options_mean_the_same(options) -> None:
    Both("reach", "work", **options).reset().play(150)


@pytest.mark.long
def test_goals_may_have_more_waypoints_and_episodes_begin_by_themselves() -> None:
    both = Both("track", human="none", limit=900)
    home = np.array(both.vector.unwrapped.robot.home)
    both.reset().play(30)
    more = home + np.random.default_rng(0).uniform(-0.2, 0.2, (6, 6))
    both.reset(options={"goal": more}).play(900)
    assert both.ends == 2
    # nobody says that an episode begins: the clock does
    both.vector.reset(seed=9), both.many(both.seen)
    assert all(jpc.phase is Phase.WAITING for jpc in both.many.controllers)


def test_arms_whose_clock_stands_still_wait() -> None:
    envs = gym.make_vec("jssa_gym/Track-v0", 2, human="none", autoreset_mode="Disabled")
    policy = VectorJPCPolicy(envs, host_delay=0.0)
    seen, _ = envs.reset(seed=0)
    for _ in range(10):
        seen, *_ = envs.step(policy(seen))
    (first, second), time = policy.controllers, envs.unwrapped.time
    before = first.tick, second.tick
    time[1] += 0.008
    policy(seen)
    policy(seen)
    assert (first.tick, second.tick) == before  # as they were looked at last
    first, second = policy.controllers
    assert (first.tick, second.tick) == (before[0] + 1, before[1] + 1)
    time[1] += 0.008
    policy(seen)
    first, second = policy.controllers
    assert (first.tick, second.tick) == (before[0] + 1, before[1] + 2)


def test_other_vectors_are_refused() -> None:
    single = gym.vector.SyncVectorEnv([lambda: ArmEnv("home")])
    with pytest.raises(InterfaceError, match="JPCPolicy of its own"):
        VectorJPCPolicy(single)
    with pytest.raises(ParameterError, match="patience"):
        VectorJPCPolicy(gym.make_vec("jssa_gym/Home-v0", 2), patience=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("shield", SHIELDS)
@pytest.mark.parametrize("task", BESIDE)
def test_a_hundred_thousand_steps_are_as_alone(task, shield) -> None:
    for human in HUMANS:
        if (task, human) != ("handover", "none"):
            Both(task, shield, count=4, limit=400, human=human).reset().play(700)
