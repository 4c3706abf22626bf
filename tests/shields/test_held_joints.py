"""Somebody beside the base stops the joints that carry it, and leaves the others their freedom."""

import numpy as np
import pytest

from jssa_gym.kernels.verification import SAFE
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import JSSAFilter, NoFilter
from jssa_gym.types import CapsuleSet, Status

DT = 0.008


def ball(centre, radius=0.1):
    at, still = np.array([centre], float), np.zeros((1, 3))
    return CapsuleSet(at, at.copy(), still, still.copy(), np.array([radius]), ("core_body",), np.zeros(1, np.int64))


def beside_the_base():
    # 4 mm from the base column, behind it, far from everything else
    return ball((-0.262, 0.0, 0.98))


@pytest.mark.parametrize("kind", [JSSAFilter, NoFilter])
def test_only_the_joint_under_the_base_column_stays(kind, robot, make_scene):
    shield = kind(robot, DT, viability=True, failsafe=FailsafeParams())
    scene = make_scene([robot.home, np.zeros(6), np.zeros(6)], beside_the_base())
    nominal = 0.2 * robot.limits.jerk
    shield.reset(scene)
    decision = shield.decide(scene, nominal)
    assert decision.status == Status.FAILSAFE
    assert "base_column" in decision.reason
    assert decision.jerk[0] == 0.0
    assert np.all(decision.jerk[1:] == nominal[1:])
    # and alone the arm would have done as it was told
    alone = make_scene([robot.home, np.zeros(6), np.zeros(6)], ball((5.0, 0.0, 1.0)))
    shield.reset(alone)
    assert shield.decide(alone, nominal).status == Status.NOMINAL


def test_what_is_applied_is_verified(robot, make_scene, monkeypatch):
    import jssa_gym.shields.failsafe as layer

    answers = []

    def watched(*args):
        answers.append(choose(*args))
        return answers[-1]

    choose = layer.choose
    monkeypatch.setattr(layer, "choose", watched)
    shield = JSSAFilter(robot, DT, viability=True, failsafe=FailsafeParams())
    scene = make_scene([robot.home, np.zeros(6), np.zeros(6)], beside_the_base())
    shield.reset(scene)
    shield.decide(scene, 0.2 * robot.limits.jerk)
    assert len(answers) == 2
    assert answers[0][1] != SAFE
    assert answers[1][:2] == (0, SAFE)


def test_an_amendment_that_is_no_number_ends_in_the_stored_stop(robot, make_scene, monkeypatch):
    monkeypatch.setattr(JSSAFilter, "_amended", lambda *_: np.full(6, np.nan))
    shield = JSSAFilter(robot, DT, viability=True, failsafe=FailsafeParams())
    scene = make_scene([robot.home, np.zeros(6), np.zeros(6)], beside_the_base())
    shield.reset(scene)
    decision = shield.decide(scene, 0.2 * robot.limits.jerk)
    assert decision.status == Status.FAILSAFE
    assert np.all(decision.jerk == 0.0)
