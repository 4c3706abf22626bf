"""Somebody beside the base stops the joints that carry it, and leaves the others their freedom."""

import numpy as np
import pytest
from monitors import keeps_safe, stored

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


@pytest.mark.long
@pytest.mark.parametrize("kind", [JSSAFilter, NoFilter])
def test_what_is_applied_is_verified(kind, robot, make_scene):
    shield = kind(robot, DT, viability=True, failsafe=FailsafeParams())
    scene = make_scene([robot.home, np.zeros(6), np.zeros(6)], beside_the_base())
    shield.reset(scene)
    decision = shield.decide(scene, 0.2 * robot.limits.jerk)
    assert not keeps_safe(shield, 0.2 * robot.limits.jerk)
    assert keeps_safe(shield, decision.jerk)
    np.testing.assert_array_equal(shield.records.work.next, stored(shield))


def amending(how):
    """A filter of which another jerk is asked for; ``how`` answers, given what the base class would."""

    class Amending(JSSAFilter):
        asked = 0

        def amend(self, tick, decision, held, halt):
            self.asked += 1
            return how(super().amend(tick, decision, held, halt))

    return Amending


def fail(jerk):
    raise ZeroDivisionError("sick")


@pytest.mark.parametrize(
    "how",
    [
        lambda jerk: np.full(6, np.nan), lambda jerk: jerk[:5], lambda jerk: jerk.astype(np.float32), lambda jerk: None,
        lambda jerk: jerk + np.eye(6)[0], fail,
    ],
    ids=["NaN", "shape", "type", "none", "what is in the way moves", "raises"],
)  # fmt: skip
def test_an_amendment_that_is_none_ends_in_the_stored_stop(how, robot, make_scene, caplog):
    shield = amending(how)(robot, DT, viability=True, failsafe=FailsafeParams())
    scene = make_scene([robot.home, np.zeros(6), np.zeros(6)], beside_the_base())
    shield.reset(scene)
    decision = shield.decide(scene, 0.2 * robot.limits.jerk)
    assert shield.asked == 1
    assert decision.status == Status.FAILSAFE
    assert np.all(decision.jerk == 0.0)


def test_an_amendment_of_a_filter_of_a_users_own_is_heard(robot, make_scene):
    """Though it is one of a filter that is compiled otherwise."""
    shield = amending(lambda jerk: jerk * [1.0, 0.5, 1, 1, 1, 1])(robot, DT, viability=True, failsafe=FailsafeParams())
    scene = make_scene([robot.home, np.zeros(6), np.zeros(6)], beside_the_base())
    shield.reset(scene)
    decision = shield.decide(scene, 0.2 * robot.limits.jerk)
    np.testing.assert_allclose(decision.jerk, 0.2 * robot.limits.jerk * [0, 0.5, 1, 1, 1, 1], rtol=1e-12)
