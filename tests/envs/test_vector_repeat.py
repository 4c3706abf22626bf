"""Actions repeated for many arms at once: each gets what a single ``ActionRepeat`` gives it, bit for bit."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from vectored import same_infos, without_words

import jssa_gym
from jssa_gym.control.vector import VectorJPCAction
from jssa_gym.envs.vector import VectorActionRepeat
from jssa_gym.evaluation.record_vector import VectorRecordSafety
from jssa_gym.exceptions import InterfaceError, InvalidActionError, ParameterError
from jssa_gym.shields import JSSAShield, Shield

COUNT = 3


def pair(mode, ticks, *, shield=None, control=None, limit=23, task="Reach", human="pursuit"):
    """A vector and as many single environments, whose episodes end in the middle of an action."""

    def single():
        env = gym.make(f"jssa_gym/{task}-v0", max_episode_steps=limit, disable_env_checker=True, human=human)
        if shield is not None:
            env = Shield(env, shield) if isinstance(shield, str) else JSSAShield(env, **shield)
        env = jssa_gym.RecordSafety(env)
        env = env if control is None else jssa_gym.JPCAction(env, mode=control, share=0.7)
        return jssa_gym.ActionRepeat(env, ticks)

    options = {"autoreset_mode": "Disabled", "max_episode_steps": limit, "human": human, "shield": shield}
    made = VectorRecordSafety(gym.make_vec(f"jssa_gym/{task}-v0", COUNT, **options))
    made = made if control is None else VectorJPCAction(made, mode=control, share=0.7)
    return VectorActionRepeat(made, ticks, mode), SyncVectorEnv([single] * COUNT, autoreset_mode=mode)


def as_told(infos):
    """Single environments' infos without words; returns of episodes come as numpy has them."""
    infos, _ = without_words(infos)
    if "final_info" in infos:
        infos["final_info"], _ = without_words(infos["final_info"])
    return infos


def compare(vector, singles, *, steps=40, size=1.0):
    rng, over = np.random.default_rng(0), 0
    (seen, _), (alone, _) = (env.reset(seed=3) for env in (vector, singles))
    np.testing.assert_array_equal(seen, alone)
    for k in range(steps):
        actions = size * rng.uniform(-1.0, 1.0, (COUNT, *vector.single_action_space.shape)).astype(np.float32)
        (*stepped, infos), (*expected, told) = (env.step(actions.copy()) for env in (vector, singles))
        for name, one, other in zip(("seen", "reward", "terminated", "truncated"), stepped, expected, strict=True):
            assert one.dtype == other.dtype, name
            np.testing.assert_array_equal(one, other, err_msg=f"step {k}: {name}")
        same_infos(infos, as_told(told), f"step {k}")
        done = stepped[2] | stepped[3]
        over += int(done.sum())
        if vector.autoreset_mode == AutoresetMode.DISABLED and done.any():
            (seen, _), (alone, _) = (env.reset(options={"reset_mask": done.copy()}) for env in (vector, singles))
            np.testing.assert_array_equal(seen, alone)
    return over


@pytest.mark.sampled(1)
@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_it_gives_what_single_ones_give(mode):
    assert compare(*pair(mode, 7)) >= 3 * COUNT


@pytest.mark.long
@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("control", ["velocity", "tip", "position"])
def test_with_a_shield_and_commands_too(mode, control):
    assert compare(*pair(mode, 5, shield={}, control=control)) >= 3 * COUNT


@pytest.mark.long
def test_faults_and_contacts_of_any_tick_are_told():
    """Of what a published filter lets through beside somebody who comes near; episodes end by contacts too."""
    vector, singles = pair(AutoresetMode.SAME_STEP, 10, shield="jssa", limit=400, task="Home")
    compare(vector, singles, steps=60, size=1.5)


def test_one_tick_is_the_vector_itself():
    vector, _ = pair(AutoresetMode.DISABLED, 1)
    plain = gym.make_vec("jssa_gym/Reach-v0", COUNT, autoreset_mode="Disabled", human="pursuit", max_episode_steps=23)
    (seen, _), (alone, _) = vector.reset(seed=1), plain.reset(seed=1)
    for _ in range(5):
        np.testing.assert_array_equal(seen, alone)
        seen, alone = (env.step(np.full((COUNT, 6), 0.3))[0] for env in (vector, plain))


def test_infos_can_be_fewer():
    vector, _ = pair(AutoresetMode.SAME_STEP, 7)
    few = VectorActionRepeat(vector.env, 7, "SameStep", ("cost", "safety"))
    few.reset(seed=1)
    infos = {}
    while "final_info" not in infos:
        infos = few.step(np.zeros((COUNT, 6)))[-1]
        assert {key for key in infos if key[0] != "_"} <= {"cost", "final_info", "final_obs"}
    assert set(infos["final_info"]) == {"cost", "_cost", "safety", "_safety"}


def test_what_it_cannot_go_around_is_refused():
    options = {"human": "none", "max_episode_steps": 4}
    sync = gym.make_vec("jssa_gym/Reach-v0", 2, vectorization_mode="sync", **options)
    with pytest.raises(InterfaceError, match="no VectorArmEnv: put an ActionRepeat around each"):
        VectorActionRepeat(sync, 3)
    with pytest.raises(InterfaceError, match="take a VectorArmEnv"):
        VectorJPCAction(sync)
    with pytest.raises(ParameterError, match="begins episodes by itself"):
        VectorActionRepeat(gym.make_vec("jssa_gym/Reach-v0", 2, **options), 3)
    made = gym.make_vec("jssa_gym/Reach-v0", 2, autoreset_mode="Disabled", **options)
    with pytest.raises(ParameterError, match="ticks has to be a positive integer"):
        VectorActionRepeat(made, 0)
    with pytest.raises(ParameterError, match="autoreset_mode has to be one of"):
        VectorActionRepeat(made, 3, "Now")
    with pytest.raises(InvalidActionError, match="shape"):
        VectorJPCAction(made).step(np.zeros((2, 5)))
    repeated = VectorActionRepeat(made, 3, "Disabled")
    repeated.reset(seed=0)
    for _ in range(2):
        repeated.step(np.zeros((2, 6)))
    with pytest.raises(gym.error.ResetNeeded, match=r"\[0, 1\] are over"):
        repeated.step(np.zeros((2, 6)))
