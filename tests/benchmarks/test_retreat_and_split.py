"""The retreat and the split index that were tried."""

import dataclasses
import runpy

import gymnasium as gym
import numpy as np
import pytest
from places import ROOT

from jssa_gym.safety.pairs import measure_pairs
from jssa_gym.safety.proximity import agent_records, measure
from jssa_gym.types import CapsuleSet, JointState

BENCH = runpy.run_path(str(ROOT / "benchmarks" / "retreat_and_split.py"))
SplitFilter, SplitParams = BENCH["SplitFilter"], BENCH["SplitParams"]
NO_PLANES = BENCH["NO_PLANES"]
away, plan_retreat, predicted_touch = BENCH["away"], BENCH["plan_retreat"], BENCH["predicted_touch"]


@pytest.fixture(scope="module")
def alone():
    """An arm at home, and its scene."""
    env = gym.make("jssa_gym/Home-v0", human="none", terminate_on=())
    env.reset(seed=0)
    return env.unwrapped.robot, env.unwrapped.scene, env.unwrapped.dt


def ball(place, velocity, radius=0.1):
    """Somebody round."""
    place, velocity = np.array([place], float), np.array([velocity], float)
    return CapsuleSet(place, place, velocity, velocity, np.array([radius]), ("ball",), np.zeros(1, np.int64))


def tool(robot, scene):
    """Middle of the outermost end of the arm, shape (3,) [m]: what is nearest to a ball far ahead."""
    near = measure(robot, scene.robot, ball([1.5, 0.0, 1.2], [0.0, 0.0, 0.0]), NO_PLANES)
    return near.points[0]


def ways_out(robot, posture, someone):
    """Where the retreats lead that would leave the arm untouched, by their lengths."""
    near = predicted_touch(robot, posture, someone).near
    ends = {way: away(robot, posture, near, way) for way in BENCH["WAYS"]}
    return {way: end for way, end in ends.items() if predicted_touch(robot, end, someone) is None}


def test_the_smallest_retreat_is_chosen_that_leaves_the_arm_untouched(alone):
    robot, scene, dt = alone
    someone, posture = ball(np.add(tool(robot, scene), [0.35, 0.0, 0.13]), [-0.2, 0.0, 0.0]), scene.robot.position
    ends = ways_out(robot, posture, someone)
    path = plan_retreat(robot, scene._replace(human=someone), dt)
    assert sorted(ends) == [0.1, 0.2]
    np.testing.assert_allclose(path.plan.states[-1, 0], ends[0.1], atol=1e-9)
    assert path.plan.duration <= predicted_touch(robot, posture, someone).after
    np.testing.assert_allclose(path.plan.states[-1, 1:], 0.0, atol=1e-9)


def test_there_is_no_retreat_that_would_not_be_over_in_time(alone):
    robot, scene, dt = alone
    someone = ball(np.add(tool(robot, scene), [0.35, 0.0, 0.13]), [-0.3, 0.0, 0.0])
    assert list(ways_out(robot, scene.robot.position, someone)) == [0.2]
    assert plan_retreat(robot, scene._replace(human=someone), dt) is None


def test_nobody_is_retreated_from_who_goes_away(alone):
    robot, scene, dt = alone
    someone = ball(np.add(tool(robot, scene), [0.4, 0.0, 0.0]), [1.0, 0.0, 0.0])
    assert plan_retreat(robot, scene._replace(human=someone), dt) is None


def test_the_split_adds_the_persons_share_of_the_approach_where_a_miss_is_small(alone):
    robot, scene, dt = alone
    filter = SplitFilter(robot, dt, SplitParams(own=0.4, theirs=1.6))
    state = np.array(JointState(scene.robot.position, *np.zeros((2, robot.n))))
    arm = tool(robot, scene)

    def added(velocity):
        people = agent_records(ball(np.add(arm, [0.6, 0.0, 0.0]), velocity))
        pairs = measure_pairs(robot, state, people)
        return filter.extra(people, pairs)[pairs.closest], pairs.motion[pairs.closest, 1]

    towards, rate = added([-1.0, 0.0, 0.0])
    assert towards == pytest.approx(1.2 * -rate, rel=1e-6)  # all of the approach is the person's
    assert added([1.0, 0.0, 0.0])[0] == 0.0
    assert added([-1.0, 3.0, 0.0])[0] == 0.0  # comes nearer, and passes far off
    plain = SplitFilter(robot, dt, dataclasses.replace(filter.params, theirs=0.4))
    people = agent_records(ball(np.add(arm, [0.6, 0.0, 0.0]), [-1.0, 0.0, 0.0]))
    assert not plain.extra(people, measure_pairs(robot, state, people)).any()
