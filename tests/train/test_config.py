"""A training's description: what makes no sense is refused before anything runs, with what would."""

import json
import subprocess
import sys
from dataclasses import fields, replace

import numpy as np
import pytest
from commands import WITHOUT

from jssa_gym.exceptions import ParameterError
from jssa_gym.train import ALGORITHMS, PPO, PRESETS, SAC, TD3, TQC, TrainConfig, preset
from jssa_gym.train.settings import Settings

ODD = (None, "1", True, np.nan, np.inf, -1, [], 1j)

BAD = {
    "task": ("reach around", None, 3, ["reach"]),
    "settings": (None, "ppo", PPO, {}),
    "human": ("ghost", 3, ""),
    "shield": (None, 0, 1, "no", "True", []),
    "control": ("torque", None, ""),
    "share": (0.0, 1.1, -0.1, "0.5", None, True, np.nan),
    "ticks": (0, 1.0, *ODD),
    "learn_from": ("shield", None),
    "penalty": (-0.1, np.nan, np.inf, "0.1", None, True),
    "observe_intervention": (None, 0, "no"),
    "normalise": (None, 1, "yes"),
    "steps": (0, 1.5, *ODD),
    "seed": (-1, 0.0, 2**32, "0", None, True),
    "envs": (0, 2.0, *ODD),
    "processes": (None, 1, "no"),
    "vector": (1, "no"),
    "interval": (0, 10.0, *ODD),
    "eval_episodes": (0, 2.0, *ODD),
    "robot": ("ur3", 3, None, ["fr3"]),
}

BAD_SETTINGS = {
    "learning_rate": (0.0, 1.1, -1e-3, "1e-3", None, True, np.nan, np.inf),
    "decay": (None, 0, "no"),
    "batch_size": (0, 1, 64.0, *ODD),
    "gamma": (-0.1, 1.1, np.nan, "1", None, True),
    "width": (0, 5000, 64.0, *ODD),
    "layers": (0, 16, *ODD),
    "rollout": (0, 64.0, *ODD),
    "n_epochs": (0, *ODD),
    "gae_lambda": (-0.1, 1.1, np.nan, None),
    "clip_range": (0.0, 1.1, np.nan, None),
    "ent_coef": (-0.1, np.nan, np.inf, None),
    "log_std": (np.nan, np.inf, 5.0, None),
    "buffer_size": (0, 1e5, *ODD),
    "learning_starts": (0, *ODD),
    "tau": (0.0, 1.1, np.nan, None),
    "updates": (0.0, -1.0, np.nan, np.inf, None, True),
    "noise": (-0.1, np.nan, np.inf, None),
    "cost_limit": (0.0, 1.1, np.nan, "0.1", None, True),
    "multiplier_rate": (-0.1, np.nan, np.inf, None),
}


def test_every_field_has_bad_values():
    assert set(BAD) == {field.name for field in fields(TrainConfig)}
    assert set(BAD_SETTINGS) == {field.name for kind in ALGORITHMS.values() for field in fields(kind)}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_value_is_refused_by_name(name):
    for value in BAD[name]:
        with pytest.raises(ParameterError, match=name):
            TrainConfig(**{name: value})


@pytest.mark.parametrize("name", BAD_SETTINGS)
def test_a_bad_setting_is_refused_by_name(name):
    kinds = [kind for kind in ALGORITHMS.values() if name in {field.name for field in fields(kind)}]
    assert kinds
    for kind in kinds:
        for value in BAD_SETTINGS[name]:
            with pytest.raises(ParameterError, match=name):
                kind(**{name: value})


def test_names_are_listed():
    with pytest.raises(ParameterError, match="home, reach, track, handover"):
        TrainConfig(task="dance")
    with pytest.raises(ParameterError, match="jerk, velocity, position"):
        TrainConfig(control="torque")
    with pytest.raises(ParameterError, match="policy, executed, penalty, both"):
        TrainConfig(learn_from="shield")
    with pytest.raises(ParameterError, match="ppo, sac, td3, tqc"):
        preset("reach", "dqn")
    with pytest.raises(ParameterError, match="home, reach, track, handover"):
        preset("dance", "ppo")


@pytest.mark.parametrize("learn_from", ["executed", "both"])
def test_executed_actions_need_a_replay_buffer(learn_from):
    with pytest.raises(ParameterError, match=r"probability with which its policy chose .* sac, td3 or tqc"):
        TrainConfig(settings=PPO(), learn_from=learn_from)
    for kind in (SAC, TD3, TQC):
        assert TrainConfig(settings=kind(), learn_from=learn_from).stores_executed


@pytest.mark.parametrize(
    "change", [{"learn_from": "penalty"}, {"observe_intervention": True}, {"settings": SAC(), "learn_from": "executed"}]
)
def test_there_is_nothing_to_learn_of_a_shield_that_is_not_there(change):
    TrainConfig(**change)
    with pytest.raises(ParameterError, match="without a shield"):
        TrainConfig(shield=False, **change)


@pytest.mark.parametrize(("rollout", "envs"), [(100, 8), (8, 8), (4, 8)])
def test_a_rollout_is_shared_by_the_environments(rollout, envs):
    with pytest.raises(ParameterError, match="multiple of the 8 environments, at least 16"):
        TrainConfig(settings=PPO(rollout=rollout), envs=envs)


OTHER = {
    "task": "home",
    "settings": SAC(),
    "human": "pursuit",
    "shield": False,
    "control": "jerk",
    "share": 0.4,
    "ticks": 5,
    "learn_from": "penalty",
    "penalty": 0.2,
    "observe_intervention": True,
    "normalise": False,
    "steps": 5,
    "seed": 1,
    "envs": 4,
    "interval": 7,
    "eval_episodes": 3,
    "robot": "fr3",
}


def test_the_digest_tells_trainings_apart():
    config = TrainConfig()
    assert set(OTHER) | {"processes", "vector"} == {field.name for field in fields(TrainConfig)}
    digests = {config.digest, *(replace(config, **{name: value}).digest for name, value in OTHER.items())}
    assert len(digests) == 1 + len(OTHER)
    assert replace(config, processes=True).digest == config.digest
    assert {replace(config, vector=vector).digest for vector in (None, False, True)} == {config.digest}
    for kind in ALGORITHMS.values():
        settings = kind()
        mine = {replace(config, settings=settings).digest}
        for field in fields(settings):
            value = getattr(settings, field.name)
            changed = (
                not value if isinstance(value, bool) else value / 2 or 0.5 if isinstance(value, float) else 2 * value
            )
            mine.add(replace(config, settings=replace(settings, **{field.name: changed})).digest)
        assert len(mine) == 1 + len(fields(settings))


def test_steps_count_only_if_the_learning_rate_depends_on_them():
    falling, steady = (TrainConfig(settings=PPO(decay=decay)) for decay in (True, False))
    assert replace(falling, steps=5).digest != falling.digest
    assert replace(steady, steps=5).digest == steady.digest


@pytest.mark.long
def test_the_digest_is_the_same_in_another_process():
    code = "from jssa_gym.train import TrainConfig; print(TrainConfig().digest)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == TrainConfig().digest


def test_there_and_back_as_json():
    for kind in ALGORITHMS.values():
        config = TrainConfig(
            task="track", settings=kind(learning_rate=1e-3), human="hand", seed=np.int64(3), share=np.float64(0.4)
        )
        again = TrainConfig.of(json.loads(json.dumps(config.as_dict(), allow_nan=False)))
        assert again == config
        assert type(again.settings) is kind
        assert again.digest == config.digest


@pytest.mark.parametrize(
    "data",
    [
        None,
        [],
        {},
        {"settings": None},
        {"settings": {}},
        {"settings": {"algorithm": "dqn"}},
        {"settings": {"algorithm": []}},
        {"settings": {"algorithm": "ppo", "more": 1}},
        {"settings": {"algorithm": "ppo"}, "more": 1},
        {"settings": {"algorithm": "ppo"}, "task": []},
        {"settings": {"algorithm": "ppo"}, "steps": -1},
    ],
)
def test_what_is_no_training_is_refused(data):
    with pytest.raises(ParameterError, match="no training"):
        TrainConfig.of(data)


def test_settings_are_changed_by_text():
    changed = PPO().changed({"learning_rate": "1e-3", "width": "32", "decay": "False", "ent_coef": "0"})
    assert changed == PPO(learning_rate=1e-3, width=32, decay=False, ent_coef=0.0)
    assert PPO(ent_coef=0).changed({"ent_coef": "0.5"}).ent_coef == 0.5
    assert PPO().changed({}) == PPO()
    for name, text, match in (
        ("widht", "3", r"unknown setting 'widht' of ppo; valid: learning_rate, decay, .*width"),
        ("noise", "0.1", "unknown setting 'noise' of ppo"),
        ("algorithm", "sac", "unknown setting"),
        ("width", "3.5", "width has to be of type int"),
        ("width", "", "width has to be of type int"),
        ("width", "-3", "width"),
        ("learning_rate", "fast", "learning_rate has to be of type float"),
        ("learning_rate", "nan", "learning_rate"),
        ("decay", "1", "decay has to be of type bool"),
        ("decay", "yes", "decay has to be of type bool"),
    ):
        with pytest.raises(ParameterError, match=match):
            PPO().changed({name: text})


def test_presets_are_what_they_say():
    for (task, algorithm), config in PRESETS.items():
        assert (config.task, config.settings.algorithm) == (task, algorithm)
        assert config.shield
    for algorithm, kind in ALGORITHMS.items():
        config = preset("home", algorithm)
        assert isinstance(config.settings, kind)
        assert isinstance(config.settings, Settings)
        assert config.shield


@pytest.mark.long
@pytest.mark.parametrize("blocked", [("torch", "stable_baselines3"), ("torch",), ("stable_baselines3",)])
def test_without_the_extra_a_training_can_be_described_but_not_run(blocked):
    code = WITHOUT.format(blocked=blocked) + (
        "import jssa_gym.train as t\n"
        "config = t.TrainConfig(settings=t.SAC())\n"
        "t.training_env(config).reset(seed=0)\n"
        "assert 'torch' not in sys.modules and 'stable_baselines3' not in sys.modules\n"
        "from jssa_gym.exceptions import MissingExtraError\n"
        "for name in ('train', 'build', 'to_policy', 'ExecutedBuffer', 'Training'):\n"
        "    try:\n        getattr(t, name)\n"
        "    except MissingExtraError as error:\n        print(error)\n"
        "    else:\n        raise AssertionError(name)\n"
        "try:\n    t.nothing\nexcept AttributeError as error:\n    print(error)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    *told, unknown = run.stdout.splitlines()
    assert len(told) == 5
    for line in told:
        assert "pip install 'jssa-gym[train]'" in line
    assert "no attribute 'nothing'" in unknown
