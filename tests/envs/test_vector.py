"""Many environments at once: each gives what a single one gives that was reset with the same seed, bit for bit."""

import copy
import itertools
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from vectored import same_infos, without_words

import jssa_gym
from jssa_gym.envs.tasks import TASKS, Reach, Track
from jssa_gym.envs.vector import VectorArmEnv
from jssa_gym.exceptions import InterfaceError, InvalidActionError, ParameterError
from jssa_gym.humans import (
    HUMANS,
    Crowd,
    Hand,
    Paced,
    Pursuit,
    RandomWalk,
    Recorded,
    Recording,
    Steered,
    make_human,
)
from jssa_gym.registration import ENTRIES
from jssa_gym.robots import ROBOTS
from jssa_gym.shields import FILTERS, PROFILES, JSSAFilter, JSSAShield, Shield, make_filter
from jssa_gym.shields.vector import VectorShield

MODES = list(AutoresetMode)


class Pair:
    """A vector and as many single environments, that get the same."""

    def __init__(self, count, task, shield=None, *, mode=AutoresetMode.NEXT_STEP, limit=60, **arguments):
        self.mode, self.count = mode, count
        env_id = ENTRIES[task].env_id()

        def single():
            env = gym.make(env_id, max_episode_steps=limit, disable_env_checker=True, **arguments)
            if shield is None:
                return env
            return Shield(env, shield) if isinstance(shield, str) else JSSAShield(env, **shield)

        options = {"autoreset_mode": mode.value, "max_episode_steps": limit, "shield": shield}
        self.vector = gym.make_vec(env_id, count, **options, **arguments)
        self.singles = SyncVectorEnv([single] * count, autoreset_mode=mode)
        self.shielded, self.reasons, self.over = shield is not None, set(), 0
        self.some = False  # whether episodes have ended while others went on

    def reset(self, **options):
        (seen, infos), (alone, told) = (env.reset(**copy.deepcopy(options)) for env in (self.vector, self.singles))
        np.testing.assert_array_equal(seen, alone)
        same_infos(infos, without_words(told)[0], "reset")

    def step(self, actions, what=""):
        (*stepped, infos), (*alone, told) = (env.step(actions.copy()) for env in (self.vector, self.singles))
        for name, one, other in zip(("seen", "reward", "terminated", "truncated"), stepped, alone, strict=True):
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other, err_msg=f"{what}: {name}")
        told, words = without_words(told)
        same_infos(infos, told, what)
        if self.shielded:
            assert self.vector.reasons() == list(words["shield/reason"]), what
            assert self.vector.kinds() == list(words["shield/kind"]), what
            self.reasons |= set(infos["shield/reason_code"].tolist())
        over = stepped[2] | stepped[3]
        self.over += int(over.sum())
        self.some |= bool(over.any() and not over.all())
        if self.mode == AutoresetMode.DISABLED and over.any():
            self.reset(options={"reset_mask": over})

    def play(self, steps, size=1.2, spoil=False, seed=3):
        rng, n = np.random.default_rng(0), self.vector.single_action_space.shape[0]
        self.reset(seed=seed)
        for k in range(steps):
            if k % 10 == 0:
                drawn = size * rng.uniform(-1.0, 1.0, (self.count, n))
                drawn = drawn.astype(np.float32) if k % 20 else drawn
            actions = drawn.copy()
            if spoil and k % 17 == 0:
                actions[k % self.count] = np.nan
            self.step(actions, f"step {k}")
        return self


def combinations():
    for i, task in enumerate(TASKS):
        for j, human in enumerate(HUMANS):
            if (task, human) != ("handover", "none"):  # a handover needs a hand
                # people move whatever the task is: all of either, half of both
                marks = () if (i + j) % 2 == 0 else pytest.mark.slow
                yield pytest.param(task, human, MODES[(i + j) // 2 % len(MODES)], marks=marks)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("task", "human", "mode"), list(combinations()))
def test_every_task_beside_everybody_is_as_alone(task, human, mode):
    pair = Pair(4, task, human=human, mode=mode).play(200)
    assert pair.over >= 8


@pytest.mark.sampled(1)
@pytest.mark.parametrize("human", ["random", "walk_by", "hand", pytest.param(Pursuit(feint=True), id="feint")])
def test_long_episodes_draw_what_single_ones_draw(human):
    # and episodes behind them: nothing that was drawn is lost or used twice
    Pair(3, "reach", human=human, limit=420, terminate_on=(), mode=AutoresetMode.SAME_STEP).play(1000, size=0.2)


def test_who_draws_again_and_again_draws_what_a_single_one_draws():
    restless = RandomWalk(2.0, 3.0, 0.05, ((0.7, 1.0), (-0.2, 0.2)), acceleration=None)
    pair = Pair(2, "reach", human=restless, limit=700, terminate_on=())
    pair.reset(seed=0)
    before = [rng.bit_generator.state for rng in pair.vector.np_random]
    for _ in range(300):
        pair.step(np.zeros((2, 6)))
    for rng, alone, state in zip(pair.vector.np_random, pair.singles.np_random, before, strict=True):
        assert rng.bit_generator.state == alone.bit_generator.state != state


def recording(loop=False):
    """Two capsules of somebody who goes up to the arm and back, with samples at uneven times; their number is odd."""
    time = 2.0 + np.cumsum(np.random.default_rng(5).uniform(0.002, 0.09, 41))
    way = 1.5 - 0.7 * np.sin(np.pi * (time - time[0]) / (time[-1] - time[0]) * (1.0 if loop else 0.7))
    start = way[:, None, None] * np.array([[1.0, 0.1, 0.0], [0.9, -0.2, 0.0]]) + np.array([0.0, 0.0, 1.1])
    end = start + np.array([-0.3, 0.1, 0.2])
    ends = (np.concatenate([x[:-1], x[:1]]) if loop else x for x in (start, end))
    return Recording(time, *ends, np.array([0.1, 0.2]), ("right_arm", "core_body"))


CROWDS = {
    "draw at once": ["walk_by", "walk_by", "random"],
    "the same": Crowd([RandomWalk(), RandomWalk()]),
    "all draw": ["random", "hand", "recorded", Pursuit(feint=True)],
    "a crowd in a crowd": [Crowd([make_human("recorded"), Recorded(recording())]), "receive", "none"],
    "slow": Paced(Crowd([Hand(), Paced(RandomWalk(), (0.2, 0.9)), Recorded()]), (0.3, 1.0)),
    "standing": [Paced(Recorded(), (0.0, 0.0)), "walk_by"],
    "steered": [Steered([[-1.0, 0.2, 1.0]] * 3), "random"],
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("crowd", CROWDS)
@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.DISABLED])
def test_crowds_are_as_alone(crowd, mode):
    Pair(3, "home", human=CROWDS[crowd], mode=mode, limit=110, terminate_on=()).play(250)


RECORDED = {
    "hold": {},
    "back_and_forth": {"afterwards": "back_and_forth"},
    "loop": {"recording": recording(loop=True), "afterwards": "loop"},
    "slow": {"pace": 0.3, "afterwards": "back_and_forth"},
    "fast": {"pace": 4.0, "afterwards": "back_and_forth"},
    "anywhere": {"turn": (-3.0, 3.0), "offset": ((-0.2, 0.4), (-0.3, 0.3)), "clearance": 0.3},
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("how", RECORDED)
def test_recordings_are_as_alone(how):
    human = Recorded(**({"recording": recording()} | RECORDED[how]))
    pair = Pair(3, "track", human=human, limit=400, terminate_on=(), mode=AutoresetMode.SAME_STEP)
    pair.play(30, size=0.2)
    start = {"human_start": np.array([1.4, 0.3])}
    pair.reset(options=start)
    for _ in range(450):  # longer than the recording
        pair.step(np.zeros((3, 6)))


def test_nobody_is_moved_in_python_but_who_is_steered(monkeypatch):
    asked = []
    for kind in (*HUMANS.values(), Paced, Crowd, Steered):
        monkeypatch.setattr(kind, "step", lambda self, dt, robot: asked.append(type(self)) or self.reset(None))
    everybody = Paced(Crowd([make() for make in HUMANS.values()]), (0.5, 1.0))
    for human, seen in (([everybody, "recorded"], []), (Steered([[0.0, 0.1]]), [Steered] * 2)):
        env = VectorArmEnv(2, "home", human=human)
        env.reset(seed=0)
        env.step(np.zeros((2, 6)))
        assert asked == seen


def test_a_recording_is_there_once_for_all_arms():
    time = np.linspace(0.0, 10.0, 2001)
    body = np.zeros((2001, 6, 3)) + np.array([1.5, 0.0, 1.0])
    human = [Recorded(Recording(time, body, body + 0.1, np.full(6, 0.1), tuple("abcdef"))), "random"]
    few, many = (pickle.dumps(VectorArmEnv(n, "home", human=human)._crowd) for n in (10, 110))
    assert len(few) > body.nbytes
    assert len(many) - len(few) < 100 * 4096


FILTERED = [*FILTERS, *PROFILES, "shielded", "jssa+stop", {}, {"lambda1": 3.0, "lambda2": 1.0}]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", range(len(FILTERED)), ids=[str(name) for name in FILTERED])
def test_every_filter_decides_as_alone(number):
    shield, mode = FILTERED[number], MODES[number % 3]
    pair = Pair(4, "reach", shield, human="pursuit" if number % 2 else "hand", mode=mode, limit=80)
    pair.play(200, spoil=shield != "none")
    assert len(pair.reasons) > (0 if shield == "none" else 2)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("task", TASKS)
def test_shielded_ids_are_as_alone(task):
    env_id = ENTRIES[task].env_id(shielded=True)
    vector = gym.make_vec(env_id, 3)
    single = [gym.make(env_id, disable_env_checker=True) for _ in range(3)]
    seen, _ = vector.reset(seed=5)
    for e, env in enumerate(single):
        np.testing.assert_array_equal(seen[e], env.reset(seed=5 + e)[0])
    rng = np.random.default_rng(1)
    for _ in range(30):
        actions = rng.uniform(-1.0, 1.0, (3, 6))
        seen, rewards, *_, infos = vector.step(actions)
        for e, env in enumerate(single):
            alone, reward, *_, info = env.step(actions[e])
            np.testing.assert_array_equal(seen[e], alone)
            assert (rewards[e], infos["shield/phi"][e]) == (reward, info["shield/phi"])


@pytest.mark.parametrize("robot", [name for name in ROBOTS if name != "lr_mate_200id_7l"])
@pytest.mark.long
def test_every_robot_is_as_alone(robot):
    Pair(2, "reach", "jssa", robot=robot, human="walk_by", limit=30).play(50)


@pytest.mark.parametrize("dt", [0.004, 0.02])
def test_every_control_step_is_as_alone(dt):
    Pair(2, "reach", {}, dt=dt, human="walk_by").play(90)


@pytest.mark.parametrize("ending", ["contact", "limit_violation"])
def test_every_ending_is_as_alone(ending):
    pair = Pair(3, "home", human="pursuit", terminate_on=(ending,), limit=300)
    assert pair.play(300).over >= 3


@pytest.mark.long
def test_who_ends_alone_says_so_in_words_as_alone():
    pair = Pair(4, "reach", "jssa", human="pursuit", mode=AutoresetMode.SAME_STEP, terminate_on=("contact",), limit=400)
    pair.play(400)
    assert pair.some


@pytest.mark.slow
@pytest.mark.parametrize("shield", [None, "jssa", {}])
@pytest.mark.parametrize("task", TASKS)
def test_a_hundred_thousand_steps_are_as_alone(task, shield):
    people = [human for human in HUMANS if (task, human) != ("handover", "none")]
    for seed, human in enumerate(people):
        Pair(8, task, shield, human=human, mode=MODES[seed % 3], limit=250).play(
            125 if shield == {} else 1250, seed=seed
        )


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_every_task_beside_everybody_behind_every_filter_is_as_alone(task):
    people = [human for human in HUMANS if (task, human) != ("handover", "none")]
    for k, (human, shield) in enumerate(itertools.product(people, FILTERED)):
        Pair(2, task, shield, human=human, mode=MODES[k % 3], limit=25).play(40, seed=k)


# ---- seeds, and who begins when ----------------------------------------------------------------------


@pytest.mark.parametrize("shield", [None, "jssa+stop"])
def test_nothing_depends_on_how_many_there_are(shield):
    few, many = (gym.make_vec("jssa_gym/Reach-v0", n, shield=shield, max_episode_steps=40) for n in (2, 7))
    few.reset(seed=11), many.reset(seed=11)
    rng = np.random.default_rng(0)
    for _ in range(100):
        actions = rng.uniform(-1.0, 1.0, (7, 6))
        some, all_of_them = few.step(actions[:2]), many.step(actions)
        for one, other in zip(some[:4], all_of_them[:4], strict=True):
            np.testing.assert_array_equal(one, other[:2])


def test_a_list_of_seeds_is_taken_and_what_is_none_goes_on():
    env = VectorArmEnv(3, "reach")
    first, _ = env.reset(seed=[4, 5, 6])
    again, _ = env.reset(seed=[4, None, 6])
    np.testing.assert_array_equal(first[[0, 2]], again[[0, 2]])
    assert np.any(first[1] != again[1])
    assert env.np_random_seed == (4, 5, 6)


@pytest.mark.parametrize("seed", [[1, 2], [1, -2, 3], [1, 2.5, 3], -1])
def test_unsound_seeds_are_refused_before_anything_changes(seed):
    env = VectorArmEnv(3, "reach", human="none")
    env.reset(seed=1)
    state = copy.deepcopy(env.np_random)
    with pytest.raises(ParameterError, match="seed"):
        env.reset(seed=seed)
    assert [rng.bit_generator.state for rng in env.np_random] == [rng.bit_generator.state for rng in state]


@pytest.mark.long
def test_generators_are_where_those_of_single_environments_are():
    pair = Pair(2, "reach", human="random", limit=500, terminate_on=())
    pair.play(300, size=0.1)
    for mine, alone in zip(pair.vector.np_random, pair.singles.np_random, strict=True):
        assert mine.bit_generator.state == alone.bit_generator.state
    Pair.play(pair, 300, size=0.1, seed=None)


def test_options_are_those_of_single_environments():
    pair = Pair(3, "track", human="walk_by")
    waypoints = np.array(pair.vector.unwrapped.robot.home) + 0.1 * np.arange(6)[:, None]
    for goal in (waypoints[:2], waypoints, waypoints[:3]):
        pair.reset(seed=2, options={"goal": goal, "joint_position": np.array([0.1, 0.0, 0.0, 0.0, -1.5, 0.0])})
        for _ in range(20):
            pair.step(np.full((3, 6), 0.1))
    with pytest.raises(ParameterError, match="unknown reset options"):
        pair.vector.reset(options={"gaol": 1})


def test_a_mask_resets_some_and_leaves_the_others():
    pair = Pair(3, "reach", "jssa", mode=AutoresetMode.DISABLED, limit=1000, terminate_on=())
    pair.reset(seed=1)
    mask = np.array([True, False, True])
    for k in range(30):
        pair.step(np.full((3, 6), 0.3))
        if k % 9 == 8:
            pair.reset(options={"reset_mask": mask})


@pytest.mark.parametrize("mask", [[True, False], np.zeros(2, np.bool_), np.ones(3, np.bool_), np.ones(2)])
def test_unsound_masks_are_refused(mask):
    env = VectorArmEnv(2, "reach", autoreset_mode="Disabled")
    env.reset(seed=1)
    with pytest.raises(ParameterError, match="reset_mask"):
        env.reset(options={"reset_mask": mask})


def test_nobody_moves_who_was_not_reset():
    env = gym.make_vec("jssa_gym/Reach-v0", 2, shield="jssa", autoreset_mode="Disabled", max_episode_steps=3)
    zero = np.zeros((2, 6))
    with pytest.raises(gym.error.ResetNeeded):
        env.step(zero)
    env.reset(seed=0)
    for _ in range(3):
        env.step(zero)
    with pytest.raises(gym.error.ResetNeeded, match=r"\[0, 1\]"):
        env.step(zero)


# ---- what is taken and what is refused ---------------------------------------------------------------


@pytest.mark.parametrize("actions", [np.zeros((2, 5)), np.zeros(6), np.zeros((2, 6), complex), [["a"] * 6] * 2])
@pytest.mark.parametrize("shield", [None, {}])
def test_unsound_actions_are_refused(actions, shield):
    env = gym.make_vec("jssa_gym/Reach-v0", 2, shield=shield)
    env.reset(seed=0)
    with pytest.raises(InvalidActionError, match=r"\(2, 6\)"):
        env.step(actions)


def test_who_asks_for_no_number_is_named():
    env = gym.make_vec("jssa_gym/Reach-v0", 3)
    env.reset(seed=0)
    with pytest.raises(InvalidActionError, match="environment 1"):
        env.step(np.array([np.zeros(6), np.full(6, np.nan), np.zeros(6)]))


class OwnTask(Reach):
    """A user's."""


class OwnWalk(RandomWalk):
    """A user's."""


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"dynamics": "servo"}, "servo.*sync"),
        ({"task": OwnTask()}, "OwnTask.*sync"),
        ({"human": OwnWalk()}, "OwnWalk.*sync"),
        ({"human": ["random", OwnWalk()]}, "OwnWalk.*sync"),
        ({"render_mode": "rgb_array"}, "render_mode"),
        ({"autoreset_mode": "later"}, "autoreset_mode.*NextStep"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"num_envs": 0}, "num_envs"),
        ({"shield": "osqp"}, "unknown filter"),
        ({"shield": {"projector": "osqp"}}, "Python.*sync"),
        ({"shield": {"typo": 1}}, "unknown option of the shield 'typo'; valid: profile, .*lambda1, .*watched"),
        ({"human": "visitors"}, "Visitors come and go.*sync"),
    ],
)
def test_what_cannot_be_batched_is_refused_by_name(arguments, said):
    with pytest.raises(ParameterError, match=said):
        gym.make_vec("jssa_gym/Reach-v0", **({"num_envs": 2} | arguments))


def test_a_filter_that_was_built_is_taken_and_a_misfit_is_not():
    env = VectorArmEnv(2, "reach")
    shield = VectorShield(env, make_filter("jssa", env.robot, env.dt))
    shield.reset(seed=0)
    assert shield.step(np.zeros((2, 6)))[4]["shield/status"].shape == (2,)
    with pytest.raises(InterfaceError, match="time step"):
        VectorShield(env, JSSAFilter(env.robot, 0.01))
    with pytest.raises(InterfaceError, match="VectorArmEnv"):
        VectorShield(SyncVectorEnv([lambda: gym.make("jssa_gym/Reach-v0")]), "jssa")
    with pytest.raises(InterfaceError, match="wrappers around the shield"):
        VectorShield(jssa_gym.VectorRecordSafety(env), "jssa")
    with pytest.raises(ParameterError, match="filter"):
        VectorShield(env, 3)


def test_a_shielded_id_has_its_own_shield():
    with pytest.raises(ParameterError, match=r"ReachShielded-v0 has its own shield: take jssa_gym/Reach-v0"):
        gym.make_vec("jssa_gym/ReachShielded-v0", 2, shield="cbf")


@pytest.mark.parametrize(
    ("wrap", "twin"),
    [
        (lambda envs: jssa_gym.Shield(envs, "stop"), "VectorShield"),
        (jssa_gym.JSSAShield, "VectorShield"),
        (jssa_gym.RecordSafety, "VectorRecordSafety"),
        (lambda envs: jssa_gym.ActionRepeat(envs, 5), "VectorActionRepeat"),
        (lambda envs: jssa_gym.SensorModel(envs, "noise"), "VectorSensorModel"),
        (jssa_gym.JPCAction, "VectorJPCAction"),
    ],
    ids=["Shield", "JSSAShield", "RecordSafety", "ActionRepeat", "SensorModel", "JPCAction"],
)
def test_a_wrapper_of_one_names_the_one_of_many(wrap, twin):
    with pytest.raises(InterfaceError, match=f"take {twin}"):
        wrap(gym.make_vec("jssa_gym/Reach-v0", 2))
    assert hasattr(jssa_gym, twin)


@pytest.mark.parametrize("shield", [None, "work", {"lambda1": 3.0, "lambda2": 1.0}])
def test_a_spec_makes_the_same_again(shield):
    env = gym.make_vec("jssa_gym/Track-v0", 3, shield=shield, human="hand", autoreset_mode="SameStep")
    assert isinstance(env, VectorArmEnv if shield is None else VectorShield)
    again = gym.make_vec(EnvSpec.from_json(env.unwrapped.spec.to_json()))
    assert (again.num_envs, type(again)) == (3, type(env))
    assert again.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    np.testing.assert_array_equal(env.reset(seed=1)[0], again.reset(seed=1)[0])


def test_a_shielded_id_is_made_again_from_its_spec():
    env = gym.make("jssa_gym/HandoverShielded-v0", human="hand", max_episode_steps=7)
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        again = gym.make(spec)
        assert str(again) == str(env)
        assert again.spec.max_episode_steps == 7
        assert again.get_wrapper_attr("filter").failsafe == env.get_wrapper_attr("filter").failsafe


@pytest.mark.sampled(4)
@pytest.mark.parametrize("through", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("human", ["random", "hand", "recorded"])
def test_a_copy_goes_on_by_itself(human, through):
    env = gym.make_vec("jssa_gym/Reach-v0", 2, shield="jssa+stop", human=human, max_episode_steps=30)
    env.reset(seed=3)
    for _ in range(10):
        env.step(np.full((2, 6), 0.2))
    other = through(env)
    other_before = [other.step(np.full((2, 6), 0.2)) for _ in range(60)]
    for stepped in other_before:
        for one, two in zip(env.step(np.full((2, 6), 0.2))[:4], stepped[:4], strict=True):
            np.testing.assert_array_equal(one, two)


def test_what_is_returned_is_the_callers_own():
    env = gym.make_vec("jssa_gym/Reach-v0", 2, shield="jssa")
    seen, infos = env.reset(seed=0)
    before = {key: value.copy() for key, value in infos.items()}, seen.copy()
    *_, later = env.step(np.ones((2, 6)))
    told = {key: value.copy() for key, value in later.items()}
    env.step(-np.ones((2, 6)))
    same_infos(infos, before[0], "after a step")
    same_infos(later, told, "after another")
    np.testing.assert_array_equal(seen, before[1])


def test_the_public_name():
    assert jssa_gym.VectorShield is VectorShield
    assert jssa_gym.VectorArmEnv is VectorArmEnv
    assert Track in (type(VectorArmEnv(1, "track").task),)
