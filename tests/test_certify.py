"""Sampled feasibility of Eq. (7), and the condition that suffices for it."""

import numpy as np
import pytest

from jssa_gym.evaluation.statistics import Rate
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.safety.certify import Domain, propose, sample_feasibility, suffices
from jssa_gym.safety.index import IndexParams
from jssa_gym.shields import JSSAFilter
from jssa_gym.types import CapsuleSet

ROBOT = lr_mate_200id_7l()
DT = 0.008
SLOW = Domain(tip_speed=0.05, human_speed=0.5, distance=(0.2, 0.5), speed_share=0.1, acceleration_share=0.05)
FAST = Domain(tip_speed=2.0, human_speed=2.0, speed_share=1.0, acceleration_share=1.0)


def sampled(index, capsule, domain=None, states=4000, **options):
    return sample_feasibility(ROBOT, index, capsule=capsule, states=states, domain=domain, **options)


def rate(result):
    return Rate.of(result.infeasible, result.states)


def person(sphere, radius):
    """The sphere of a result as somebody in a scene."""
    centre, velocity = sphere[:1], sphere[1:]
    return CapsuleSet(centre, centre.copy(), velocity, velocity.copy(), np.array([radius]), ("ball",), np.zeros(1, int))


def test_the_papers_parameters_fail_at_the_shoulder_and_for_fast_people():
    index = IndexParams(lambda1=3.0, lambda2=1.0)
    shoulder = sampled(index, "upper_arm")
    assert rate(shoulder).low > 0.01
    assert shoulder.margin < 0.0
    inside, outside = sampled(index, "wrist_tool", SLOW), sampled(index, "wrist_tool", FAST)
    assert rate(inside).high < 0.005
    assert rate(outside).low > rate(inside).high


def test_a_slow_tool_is_kept_in_every_state():
    result = sampled(IndexParams(lambda1=6.0, lambda2=8.0), "wrist_tool", SLOW)
    assert result.infeasible == 0
    assert result.margin > 0.0


def test_a_planted_infeasible_pair_is_found():
    # hardly any weight on the acceleration: a step changes the index by next to nothing
    planted = sampled(IndexParams(lambda1=3.0, lambda2=1e-3), "wrist_tool")
    assert rate(planted).value > 0.2


def test_the_index_of_the_worst_state_is_zero_and_the_shield_cannot_keep_it(make_scene):
    index, domain = IndexParams(lambda1=3.0, lambda2=1.0), Domain()
    result = sampled(index, "upper_arm", domain)
    scene = make_scene(result.worst, person(result.sphere, domain.radius))
    row = ROBOT.capsule_names.index("upper_arm")
    shield = JSSAFilter(ROBOT, DT, index, min_authority=0.0, recovery=0.0, viability=True)
    shield.reset(scene)
    decision = shield.decide(scene, np.zeros(6))
    # other capsules may be worse off; this one is as the sampler says, or the projection gave it up for them
    assert shield._pairs[row, 0]["phi"] >= -result.margin - 1e-6
    assert decision.phi >= -result.margin - 1e-6
    shield._look_back(result.worst, shield._seen)
    assert shield._pairs_now[row, 0]["phi"] == pytest.approx(0.0, abs=1e-9)


def test_states_are_in_the_domain_and_seeded():
    domain = Domain(tip_speed=0.3, human_speed=0.4, distance=(0.1, 0.3), band=0.05)
    index = IndexParams()
    one, two = (sampled(index, "forearm", domain, 500, seed=3) for _ in range(2))
    assert one.margin == two.margin
    assert np.array_equal(one.worst, two.worst)
    assert one.states == 500
    assert np.linalg.norm(one.sphere[1]) <= 0.4
    low, high = ROBOT.limits.position.T
    assert np.all((low <= one.worst[0]) & (one.worst[0] <= high))
    assert sampled(index, "forearm", domain, 500, seed=4).margin != one.margin


def test_a_domain_without_such_states_is_an_error():
    with pytest.raises(ParameterError, match="hardly any state"):
        sampled(IndexParams(), "forearm", Domain(distance=(8.0, 9.0)), states=100)
    with pytest.raises(ParameterError, match="capsule"):
        sampled(IndexParams(), "nose")
    with pytest.raises(ParameterError, match="states"):
        sampled(IndexParams(), "forearm", states=0)


def test_the_condition_holds_where_it_should():
    # written out for lambda = (6, 8), d = 0.5 m, v = 1 m/s: 64 j >= 36 + 6 (0.25 - 0.0025)
    index, least = IndexParams(lambda1=6.0, lambda2=8.0), (36.0 + 6.0 * 0.2475) / 64.0
    assert suffices(index, jerk=least * 1.001, approach=1.0, distance=0.5)
    assert not suffices(index, jerk=least * 0.999, approach=1.0, distance=0.5)
    # its other half: lambda1² >= 2 lambda2 d
    assert not suffices(index, jerk=1e9, approach=1.0, distance=2.3)


@pytest.mark.parametrize("damping", [2.0, 5.0, 8.0])
def test_the_proposal_is_the_smallest_that_suffices(damping):
    asked = {"jerk": 10.0, "approach": 1.0, "distance": 0.5}
    index = propose(**asked, damping=damping)
    assert suffices(index, **asked)
    smaller = IndexParams(lambda1=index.lambda1 * 0.999, lambda2=index.lambda2 * 0.999**2)
    assert not suffices(smaller, **asked)
