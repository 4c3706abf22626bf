"""Wrappers between environment and shield: what changes, repeats or drops a jerk is refused, what does not is taken."""

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.envs import ArmEnv
from jssa_gym.exceptions import InterfaceError
from jssa_gym.shields.wrappers import REPEATERS, refuse_other_actions

PICTURE = {"width": 64, "height": 48}


class Bottom(gym.Wrapper):
    """Keeps the jerks that really reach the arm."""

    def __init__(self, env):
        super().__init__(env)
        self.jerks = []

    def step(self, action):
        result = self.env.step(action)
        self.jerks.append(result[4]["jerk"].copy())
        return result


def arm(drawn: bool = False) -> Bottom:
    options = {"render_mode": "rgb_array", **PICTURE} if drawn else {}
    return Bottom(ArmEnv("home", human="walk_by", terminate_on=(), **options))


def picture(env):
    return gym.wrappers.AddRenderObservation(env, render_only=True)


def aware(env):
    return gym.wrappers.TimeAwareObservation(gym.wrappers.TimeLimit(env, 1000), flatten=False)


def bounded(env):
    few = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
    return gym.wrappers.TransformObservation(env, lambda seen: seen[:3].clip(-1.0, 1.0), few)


# every name of gymnasium.wrappers: how it is made around an arm; None for what is no wrapper
MADE = {
    "vector": None,
    "AtariPreprocessing": lambda env, tmp: gym.wrappers.AtariPreprocessing(env, noop_max=0),
    "DelayObservation": lambda env, tmp: gym.wrappers.DelayObservation(env, 2),
    "DtypeObservation": lambda env, tmp: gym.wrappers.DtypeObservation(env, np.float32),
    "DiscretizeObservation": lambda env, tmp: gym.wrappers.DiscretizeObservation(bounded(env), 5),
    "FilterObservation": lambda env, tmp: gym.wrappers.FilterObservation(aware(env), ["obs"]),
    "FlattenObservation": lambda env, tmp: gym.wrappers.FlattenObservation(env),
    "FrameStackObservation": lambda env, tmp: gym.wrappers.FrameStackObservation(env, 3),
    "GrayscaleObservation": lambda env, tmp: gym.wrappers.GrayscaleObservation(picture(env)),
    "TransformObservation": lambda env, tmp: bounded(env),
    "MaxAndSkipObservation": lambda env, tmp: gym.wrappers.MaxAndSkipObservation(env, 2),
    "NormalizeObservation": lambda env, tmp: gym.wrappers.NormalizeObservation(env),
    "AddRenderObservation": lambda env, tmp: picture(env),
    "ResizeObservation": lambda env, tmp: gym.wrappers.ResizeObservation(picture(env), (12, 16)),
    "ReshapeObservation": lambda env, tmp: gym.wrappers.ReshapeObservation(env, (1, *env.observation_space.shape)),
    "RescaleObservation": lambda env, tmp: gym.wrappers.RescaleObservation(bounded(env), *np.float32([0.0, 1.0])),
    "TimeAwareObservation": lambda env, tmp: aware(env),
    "ClipAction": lambda env, tmp: gym.wrappers.ClipAction(env),
    "DiscretizeAction": lambda env, tmp: gym.wrappers.DiscretizeAction(env, 5),
    "TransformAction": lambda env, tmp: gym.wrappers.TransformAction(env, lambda jerk: -jerk, env.action_space),
    "RescaleAction": lambda env, tmp: gym.wrappers.RescaleAction(env, np.float32(-0.5), np.float32(0.5)),
    "StickyAction": lambda env, tmp: gym.wrappers.StickyAction(env, 0.2),
    "RepeatAction": lambda env, tmp: gym.wrappers.RepeatAction(env, 2),
    "ClipReward": lambda env, tmp: gym.wrappers.ClipReward(env, -1.0, 1.0),
    "TransformReward": lambda env, tmp: gym.wrappers.TransformReward(env, float),
    "NormalizeReward": lambda env, tmp: gym.wrappers.NormalizeReward(env),
    "TimeLimit": lambda env, tmp: gym.wrappers.TimeLimit(env, 30),
    "Autoreset": lambda env, tmp: gym.wrappers.Autoreset(gym.wrappers.TimeLimit(env, 30)),
    "PassiveEnvChecker": lambda env, tmp: gym.wrappers.PassiveEnvChecker(env),
    "OrderEnforcing": lambda env, tmp: gym.wrappers.OrderEnforcing(env),
    "RecordEpisodeStatistics": lambda env, tmp: gym.wrappers.RecordEpisodeStatistics(env),
    "AddWhiteNoise": lambda env, tmp: gym.wrappers.AddWhiteNoise(env, 0.5),
    "ObstructView": lambda env, tmp: gym.wrappers.ObstructView(env, 0.5, 3),
    "RenderCollection": lambda env, tmp: gym.wrappers.RenderCollection(env),
    "RecordVideo": lambda env, tmp: gym.wrappers.RecordVideo(env, str(tmp), disable_logger=True),
    "HumanRendering": lambda env, tmp: gym.wrappers.HumanRendering(env),
    "ArrayConversion": lambda env, tmp: gym.wrappers.ArrayConversion(env, np, np),
    "JaxToNumpy": lambda env, tmp: gym.wrappers.JaxToNumpy(env),
    "JaxToTorch": lambda env, tmp: gym.wrappers.JaxToTorch(env),
    "NumpyToTorch": lambda env, tmp: gym.wrappers.NumpyToTorch(env),
}

DRAWN = {
    *("GrayscaleObservation", "AddRenderObservation", "ResizeObservation", "AddWhiteNoise", "ObstructView"),
    *("RenderCollection", "RecordVideo", "HumanRendering"),
}

REFUSED = {
    *("MaxAndSkipObservation", "ClipAction", "DiscretizeAction", "TransformAction", "RescaleAction", "StickyAction"),
    *("RepeatAction", "Autoreset"),
}
"""Of those that can be made around any arm."""


def test_every_wrapper_of_gymnasium_was_looked_at():
    assert set(gym.wrappers.__all__) - set(MADE) == set()


def drive(env, ticks=40) -> np.ndarray:
    """The jerks that reach the arm while a policy of random jerks drives it, shape (count, 6) [rad/s³]."""
    env.reset(seed=1)
    for action in np.random.default_rng(2).uniform(-1.0, 1.0, (ticks, 6)):
        env.step(action)
    bottom = env
    while not isinstance(bottom, Bottom):
        bottom = bottom.env
    return np.array(bottom.jerks)


@pytest.mark.sampled(5)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.gl if name in DRAWN else ()) for name in MADE if MADE[name]]
)
def test_a_wrapper_of_gymnasium_is_refused_or_changes_no_jerk(name, tmp_path, monkeypatch):
    if name in DRAWN:
        monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    try:
        env = MADE[name](arm(name in DRAWN), tmp_path)
        env.reset(seed=0)  # some look for what they need only then
    except (gym.error.DependencyNotInstalled, ImportError) as error:
        # those that need nothing are made everywhere
        assert name not in REFUSED
        pytest.skip(f"{name} cannot be made here: {error}")
    if name in REFUSED:
        with pytest.raises(InterfaceError, match=f"{name} belongs outside the shield.*around the shield"):
            jssa_gym.JSSAShield(env)
        return
    refuse_other_actions(env)
    np.testing.assert_array_equal(drive(env), drive(arm()))
    env.close()


def test_the_refused_do_change_what_reaches_the_arm():
    # the other side of the test above: nobody is refused for nothing
    plain = drive(arm())
    for name in REFUSED - {"DiscretizeAction", "ClipAction"}:  # the one takes other actions, the other clips none here
        changed = drive(MADE[name](arm(), None))
        assert changed.shape != plain.shape or not np.array_equal(changed, plain), name


@pytest.mark.parametrize("name", sorted(REPEATERS))
def test_a_repeater_is_known_by_its_name_and_by_its_parents(name):
    parent = type(name, (gym.Wrapper,), {})
    for kind in (parent, type("Mine", (parent,), {})):
        with pytest.raises(InterfaceError, match=rf"^{kind.__name__} belongs outside"):
            refuse_other_actions(gym.wrappers.OrderEnforcing(kind(arm())))


class Counts(gym.ActionWrapper):
    """Changes nothing, and says so."""

    outside_shield = False
    seen = 0

    def action(self, action):
        self.seen += 1
        return action


class Flips(Counts):
    def action(self, action):
        return -action


class Says(gym.Wrapper):
    outside_shield = True


class SaysToo(Says):
    pass


def test_a_class_is_taken_at_its_own_word_only():
    env = jssa_gym.JSSAShield(Counts(arm()))
    env.reset(seed=0)
    env.step(np.zeros(6))
    assert env.env.seen == 1
    for kind in (Flips, Says, SaysToo):
        with pytest.raises(InterfaceError, match=rf"^{kind.__name__} belongs outside the shield"):
            jssa_gym.JSSAShield(kind(arm()))
    # a wrapper that overrides step and passes the action on needs no word
    jssa_gym.JSSAShield(Bottom(arm()))


def test_sb3s_repeater_is_refused():
    atari = pytest.importorskip("stable_baselines3.common.atari_wrappers", reason="stable_baselines3 is not installed")
    assert atari.StickyActionEnv.__name__ in REPEATERS
    with pytest.raises(InterfaceError, match="MaxAndSkipEnv belongs outside the shield"):
        jssa_gym.JSSAShield(atari.MaxAndSkipEnv(arm(), 2))


def test_a_second_shield_is_refused():
    inner = gym.make("jssa_gym/HomeShielded-v0")
    for again in (inner, gym.wrappers.TransformReward(inner, float)):
        with pytest.raises(InterfaceError, match="has a shield already, JSSAShield"):
            jssa_gym.JSSAShield(again)
