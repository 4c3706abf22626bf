"""What eight joints, or people, at once come to is what each of them comes to alone, bit for bit."""

import numpy as np
import pytest

from jssa_gym.kernels import viability
from jssa_gym.kernels.capsules import capsule_pair
from jssa_gym.kernels.index import assess, evaluate
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, PLANE, SEGMENT, STOP, records
from jssa_gym.kernels.stopping import make_plan_representable, plan_stop, step_keeps, stop_joint, stop_keeps
from jssa_gym.kernels.verification import keeps_limits
from jssa_gym.robots import make_robot
from jssa_gym.safety.index import IndexParams

TAU, TOLERANCE = 0.008, 1e-10


def drawn(rng, n):
    """Limits and a state of n joints: anywhere, at the edge, at rest, and now and then no number."""
    bounds = np.array([-rng.uniform(1, 3, n), rng.uniform(1, 3, n), *(rng.uniform(1, 2, (3, n)) * [[1], [4], [100]])])
    state = np.array([rng.uniform(bounds[0], bounds[1]), *(rng.uniform(-1, 1, (2, n)) * bounds[2:4])])
    state[1:] *= rng.choice([0.0, 1e-9, 0.3, 1.0, 1.02], (2, n))
    state[0] = np.where(rng.random(n) < 0.1, bounds[1], state[0])
    if rng.random() < 0.05:
        state[rng.integers(3), rng.integers(n)] = rng.choice([np.nan, np.inf, 1e200])
    return state, bounds


@pytest.mark.parametrize("n", [1, 6, 8, 9])
def test_joints_together_are_joints_alone(n):
    rng = np.random.default_rng(n)
    for _ in range(300):
        state, bounds = drawn(rng, n)
        lower, upper, plan, after = np.zeros(n), np.zeros(n), records(n, STOP), np.zeros((3, n))
        complete = viability.jerk_box(state, bounds, TAU, lower, upper)
        alone = [viability._interval(*state[:, j], tuple(bounds[:, j]), TAU) for j in range(n)]
        np.testing.assert_array_equal([lower, upper], np.array([one[:2] for one in alone]).T)
        assert complete == all(one[2] for one in alone)

        jerk = rng.uniform(lower, upper)
        integrate(state, jerk, TAU, after)
        plan_stop(after, bounds, TAU, plan)
        for j in range(n):
            np.testing.assert_array_equal(
                list(plan[j].item()), stop_joint(after[1, j], after[2, j], bounds[4, j], bounds[3, j], TAU)
            )

        make_plan_representable(plan, bounds)
        kept = all(
            step_keeps(*state[:, j], jerk[j], *bounds[:, j], TAU, TOLERANCE)
            and stop_keeps(*after[:, j], plan[j], *bounds[:, j], TAU, TOLERANCE)
            for j in range(n)
        )
        assert keeps_limits(state, jerk, after, plan, bounds, TAU) == kept


@pytest.mark.parametrize("people", [1, 6, 9])
def test_people_together_are_people_alone(people):
    robot, rng, index = make_robot("lr_mate_200id_7l"), np.random.default_rng(people), IndexParams().kernel()
    n, m, planes = len(robot.links), len(robot.capsules), records(0, PLANE)
    frames, segments, after, pairs = (
        records(n, FRAME),
        records(m, SEGMENT),
        np.zeros((3, n)),
        records((m, people), PAIR),
    )
    agents = records(people, AGENT)
    for draw in range(100):
        for field in AGENT.names[:4]:
            agents[field] = rng.uniform(-1.5, 1.5, (people, 3))
        agents["radius"] = rng.uniform(0.05, 0.2, people)
        state = np.array([robot.home, np.zeros(n), np.zeros(n)]) + rng.normal(size=(3, n)) * [[0.5], [2.0], [5.0]]
        if draw % 4 == 1:
            agents["end"][-1] = agents["start"][-1]  # a ball
        if draw % 4 == 2:
            agents["start"][-1], agents["end"][-1] = segments["start"][-1], segments["end"][-1]  # one in another
        jerk = np.zeros(n)
        assess(robot.links, robot.capsules, state, jerk, agents, planes, TAU, index, after, frames, segments, pairs)
        for i, one in enumerate(segments):
            for j, agent in enumerate(agents):
                pair, radii = pairs[i, j], one["radius"] + agent["radius"]
                distance, s, r = capsule_pair(one["start"], one["end"], agent["start"], agent["end"], radii)
                phi, _, _, _ = evaluate(one, agent, s, r, distance, index)
                np.testing.assert_array_equal(list(pair.item()), [distance, s, r, phi])
