"""What eight joints, or people, at once come to is what each of them comes to alone, bit for bit."""

import numpy as np
import pytest
from numba import njit

from jssa_gym.kernels import lanes, viability
from jssa_gym.kernels.capsules import capsule_pair
from jssa_gym.kernels.index import assess, evaluate, reassess
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, PLANE, SEGMENT, STOP, records
from jssa_gym.kernels.stopping import _stays, make_plan_representable, parts_keep, plan_stop, step_keeps, stop_joint
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
            and parts_keep(*after[:, j], *plan[j].item(), *bounds[:, j], TAU, TOLERANCE)
            for j in range(n)
        )
        assert keeps_limits(state, jerk, after, plan, bounds, TAU) == kept


ODD = np.array([0.0, -0.0, 5e-324, -1e-310, 1e-160, 1.0, 1e200, np.inf, -np.inf, np.nan])


@njit(error_model="numpy")
def asked_twice(step, stop):
    """A step of one joint and a stop: in lanes, and alone."""
    q, v, a, u, t, low, high, V, A, J = step
    x, ramp, hold, release, jerk_in, jerk_out = stop
    slack, more = TOLERANCE * (high - low), 1.0 + TOLERANCE
    limits = low - slack, high + slack, V * more, A * more, J * more
    return (
        lanes.keeps(q, v, a, u, t, *limits),
        _stays(q, v, a, u, t, *limits),
        lanes.stop_keeps(x, v, a, ramp, hold, release, jerk_in, jerk_out, *limits, t),
        parts_keep(x, v, a, ramp, hold, release, jerk_in, jerk_out, low, high, V, A, J, t, TOLERANCE),
    )


def test_what_is_no_number_or_nothing_at_all_is_in_lanes_what_it_is_alone():
    """NaN, infinity, what underflows, a jerk or a time of zero: in any one or two of the numbers, and in none."""
    rng, kept, refused = np.random.default_rng(0), np.zeros(2, int), np.zeros(2, int)
    for draw in range(3000):
        bounds = [-1.0, 1.0, 1.0, 4.0, 100.0]
        v, a = rng.uniform(-1.0, 1.0, 2) * rng.choice([0.0, 1e-9, 0.3, 1.0], 2) * bounds[2:4]
        step = np.array([rng.uniform(-1.1, 1.1), v, a, rng.uniform(-60.0, 60.0), rng.choice([TAU, 0.2]), *bounds])
        stop = np.array([rng.uniform(-1.0, 1.0), *stop_joint(v, a, 100.0, 4.0, step[4])])
        for _ in range(draw % 3):
            which = rng.integers(15)
            (step if which < 10 else stop)[which if which < 10 else which - 9] = rng.choice(ODD)
        together, alone, stop_together, stop_alone = asked_twice(step, stop)
        assert (together, stop_together) == (alone, stop_alone), (step, stop)
        kept += together, stop_together
        refused += not together, not stop_together
        # what everything is compared with or made of is never NaN
        assert not (together and np.isnan(step).any())
        assert not (stop_together and np.isnan([*step[1:3], *step[4:], *stop]).any())
    assert min(*kept, *refused) > 300


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
    agents, again = records(people, AGENT), records((m, people), PAIR)
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
        # what is looked at again, one by one
        reassess(robot.links, robot.capsules, after, agents, planes, index, -np.inf, pairs, frames, segments, again)
        np.testing.assert_array_equal(again["phi"], pairs["phi"])
