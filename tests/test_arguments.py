"""Integers of any kind are integers, and nothing is stepped that was not reset."""

import json

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym import ActionRepeat, ArmEnv, JPCAction, JSSAShield, RecordSafety, SensorModel
from jssa_gym.control.jpc import JPC
from jssa_gym.envs.faults import SensorFaults
from jssa_gym.envs.sensor import MissedTicks
from jssa_gym.envs.tasks.joints import Track
from jssa_gym.evaluation import evaluate, judge, rollout
from jssa_gym.evaluation.campaign import Campaign, Grid
from jssa_gym.evaluation.contenders import Ageless, Late
from jssa_gym.evaluation.runner import complete
from jssa_gym.evaluation.study import Study
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import HoldPolicy, JPCPolicy
from jssa_gym.rates import clopper_pearson
from jssa_gym.train.config import TrainConfig
from jssa_gym.train.wrappers import ExecutedAction, InterventionPenalty, ObserveIntervention

WHOLE = [int, np.int64, np.int32, np.uint8]

GRID = (("none",), ("walk_by",), ("hold",))


def played(cls):
    env = ArmEnv(human="none", terminate_on=())
    trace = rollout(env, HoldPolicy(env), seed=0, steps=cls(3))
    return trace, env.robot


TAKES = {
    "width": lambda x: ArmEnv(width=x).world,
    "height": lambda x: ArmEnv(height=x).world,
    "ticks": lambda x: ActionRepeat(ArmEnv(), x),
    "dropout_ticks": lambda x: SensorFaults(dropout=0.1, dropout_ticks=x),
    "longest": lambda x: MissedTicks(ArmEnv(), longest=x),
    "count": lambda x: ArmEnv(Track(count=x)).reset(seed=0),
    "buffer_length": lambda x: RecordSafety(ArmEnv(), buffer_length=x),
    "substeps": lambda x: judge(*played(int), substeps=x),
    "quiet": lambda x: JPC(ArmEnv().robot.limits, 0.008, quiet=x),
    "grid": lambda x: json.dumps(Campaign((Grid(*GRID, episodes=x),)).config()),
    "campaign": lambda x: json.dumps(Campaign((Grid(*GRID),), steps=x, seed=x).config()),
    "train": lambda x: json.dumps(TrainConfig(ticks=x, eval_episodes=x).as_dict()),
    "rate": lambda x: clopper_pearson(x, x),
}


@pytest.mark.sampled(31)
@pytest.mark.parametrize("whole", WHOLE)
@pytest.mark.parametrize("name", TAKES)
def test_integers_of_any_kind_are_taken(name, whole):
    TAKES[name](whole(5))


@pytest.mark.parametrize("wrong", [True, np.True_, 5.0, np.float64(5.0), "5", None, -5])
@pytest.mark.parametrize("name", TAKES)
def test_what_is_no_count_is_refused(name, wrong):
    with pytest.raises(ParameterError, match=r"positive integer|whole number|0 <= k <= n"):
        TAKES[name](wrong)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("whole", WHOLE)
def test_an_evaluation_takes_them_and_writes_them(tmp_path, whole):
    five, one = whole(5), whole(1)
    numbers = {"episodes": one, "seed": five, "steps": five, "jobs": one, "keep": one}
    report = evaluate("jssa_gym/Home-v0", "hold", out=tmp_path / "single", **numbers)
    assert report.episodes[0].summary.ep_len == 5
    known = json.loads((tmp_path / "single" / "campaign.json").read_text())
    assert (known["steps"], known["seed"], known["episodes"]) == (5, 5, 1)
    study = Study(("home",), *GRID, episodes=one, seed=five, steps=five, v_safe=np.float32(0.25))
    complete(study, tmp_path / "study")
    # the same in plain numbers is the same evaluation
    complete(Study(("home",), *GRID, episodes=1, seed=5, steps=5, v_safe=0.25), tmp_path / "study")


def test_a_delay_is_a_number_of_any_kind():
    env = gym.make("jssa_gym/Home-v0")
    for delay in (0, np.float32(0.1), np.int64(1), 0.1):
        JPCPolicy(env, host_delay=delay)
    for wrong in (True, "0.1", -1.0):
        with pytest.raises(ParameterError, match="host_delay"):
            JPCPolicy(env, host_delay=wrong)


def test_flags_of_numpy_are_flags():
    assert SensorFaults(blank=np.True_).blank is True
    assert json.loads(json.dumps(TrainConfig(shield=np.True_).as_dict()))["shield"] is True
    with pytest.raises(ParameterError, match="blank has to be True or False, got 1"):
        SensorFaults(blank=1)


# ---- before the first reset ----------------------------------------------------------------------------


UNREADY = {
    "kinematic": lambda: ArmEnv(),
    "servo": lambda: ArmEnv(dynamics="servo"),
    "alone": lambda: ArmEnv(human="none"),
    "reach": lambda: ArmEnv("reach"),
    "id": lambda: gym.make("jssa_gym/Home-v0"),
    "shielded id": lambda: gym.make("jssa_gym/HandoverShielded-v0"),
    "shield": lambda: JSSAShield(ArmEnv()),
    "sensor": lambda: SensorModel(ArmEnv(), "long dropouts"),
    "missed": lambda: MissedTicks(ArmEnv()),
    "late": lambda: Late(ArmEnv(), 3),
    "ageless": lambda: Ageless(ArmEnv()),
    "record": lambda: RecordSafety(JSSAShield(ArmEnv())),
    "repeat": lambda: ActionRepeat(JSSAShield(ArmEnv()), 5),
    "penalty": lambda: InterventionPenalty(JSSAShield(ArmEnv())),
    "observe": lambda: ObserveIntervention(JSSAShield(ArmEnv())),
    "executed": lambda: ExecutedAction(JSSAShield(ArmEnv())),
    "commands": lambda: JPCAction(JSSAShield(ArmEnv())),
}


@pytest.mark.parametrize("name", UNREADY)
def test_a_step_before_the_first_reset_is_refused(name):
    env = UNREADY[name]()
    action = np.full(env.action_space.shape, 0.5)
    with pytest.raises(gym.error.ResetNeeded, match=r"reset"):
        env.step(action)
    # and is forgotten: what follows is what a new environment does
    other = UNREADY[name]()
    observations = [(one.reset(seed=4)[0], one.step(action)[0]) for one in (env, other)]
    np.testing.assert_array_equal(*observations)


def test_people_of_every_kind_wait_for_the_reset():
    for human in jssa_gym.HUMANS:
        with pytest.raises(gym.error.ResetNeeded):
            ArmEnv(human=human).step(np.zeros(6))
