"""The margin of a stop, and rows from a predicted miss, against arms and people moved by textbook formulas."""

import functools
from typing import NamedTuple

import numpy as np
import pytest
import reference as ref
from numba import njit

from jssa_gym.kernels.ahead import Foresight, predicted_rows
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.margin import clears_people, margin
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import AGENT, CONFINED, FACE, PLANE, STOP, records
from jssa_gym.kernels.rest import REST_SPEED
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.kernels.verification import (
    ENTRY,
    HALF_SPACE,
    REACH,
    SHORTEST,
    STATIC,
    Around,
    StepAndStop,
    beside_people,
    keeps_clear,
)
from jssa_gym.safety.failsafe import levers
from jssa_gym.tick import layout

DT = 0.008
FORESIGHT = Foresight(0.05, 0.05, 1.2, 0.04, 0.2, 0.15, 0.5)


class Case(NamedTuple):
    """An arm that takes a step and stops, and people."""

    arm: layout.ArmRecord
    motion: StepAndStop
    ticks: int
    people: np.ndarray
    work: layout.Work


def random_case(robot, rng, *, people=2, moves=True):
    limits, n = robot.limits.bounds(), robot.n
    state = np.zeros((3, n))
    state[0] = rng.uniform(-1.5, 1.5, n)
    if moves:
        state[1], state[2] = rng.uniform(-0.6, 0.6, n) * limits[2], rng.uniform(-0.5, 0.5, n) * limits[3]
    jerk = rng.uniform(-1.0, 1.0, n) * limits[4] * moves
    after, plan, agents = np.zeros((3, n)), records(n, STOP), records(people, AGENT)
    integrate(state, jerk, DT, after)
    ticks = plan_stop(after, limits, DT, plan)
    for agent in agents:
        agent["start"] = rng.uniform([-1.2, -1.2, 0.0], [1.2, 1.2, 1.6])
        agent["end"] = agent["start"] + rng.normal(size=3) * 0.2
        agent["start_velocity"], agent["end_velocity"] = rng.normal(size=(2, 3)) * 0.6
        agent["radius"] = rng.uniform(0.03, 0.15)
    parts = (np.array(part) for part in (robot.links, robot.capsules, robot.self_pairs))
    arm = layout.ArmRecord(*parts, levers(robot), limits)
    work = layout.work(arm, people, 0, 0, static_rows=False)
    return Case(arm, StepAndStop(state, jerk, after, plan, DT), ticks, agents, work)


def course(case):
    """Joint positions and velocities of step and stop, by the time t: whole ticks, then the rest."""
    ticks = [(case.motion.state, case.motion.jerk.copy())]

    def posture(t):
        tick = 0
        while t > DT:
            tick, t = tick + 1, t - DT
        while tick >= len(ticks):
            state, u = ticks[-1]
            after, u = np.array(ref.triple_integrator(*state, u, DT)), u.copy()
            stop_jerk(case.motion.plan, len(ticks) - 1, u)
            ticks.append((after, u))
        state, u = ticks[tick]
        return np.array(ref.triple_integrator(*state, u, t))

    return posture


def chain_of(robot):
    return [
        ref.Joint(np.array(link["rotation"]), np.array(link["offset"]), np.array(link["axis"])) for link in robot.links
    ]


def ends_of(robot, chain, q):
    """Ends of the robot's capsules, two of each, in a posture."""
    poses = ref.link_poses(chain, q)
    return [
        [(poses[capsule["link"] + 1] @ np.append(capsule[end], 1.0))[:3] for end in ("start", "end")]
        for capsule in robot.capsules
    ]


def gap_of(robot, ends, i, agent, t=0.0):
    """Distance of a robot capsule from somebody who goes on for the time t [m]."""
    c, d = (agent[end] + t * agent[f"{end}_velocity"] for end in ("start", "end"))
    return ref.segment_distance(*ends[i], c, d)[0] - robot.capsules[i]["radius"] - agent["radius"]


def around_of(case, reach, growth, touch):
    return Around(
        case.people, reach, growth, touch, records(len(reach), CONFINED), records(0, AGENT), records(0, PLANE), 0.0
    )


@njit
def margin_of(arm, motion, ticks, around, work):
    return margin(arm, motion, ticks, around, work)


@pytest.mark.parametrize(("slowest", "quickest"), [(0.5, 2.0), (0.0, 0.02)], ids=["grow", "hardly grow"])
@pytest.mark.long
def test_the_margin_is_what_its_formula_says(robot, slowest, quickest):
    """Also of people who hardly grow: then it may be any of the moments at which somebody is nearest."""
    rng, chain, seen, moments = np.random.default_rng(0), chain_of(robot), [], set()
    for draw in range(25):
        people = 2 if draw else 9
        case = random_case(robot, rng, people=people)
        if draw % 3 == 1:
            case.people["end"] = case.people["start"]  # balls
        reach, growth = rng.uniform(0.0, 0.1, people), rng.uniform(slowest, quickest, people)
        touch = np.append(np.zeros(people - 1), rng.choice([0.0, 0.3]))
        length, least, posture = DT * (case.ticks + 1), [], course(case)
        for t in length * np.arange(6) / 6:
            ends = ends_of(robot, chain, posture(t)[0])
            speeds = [np.abs(posture(later)[1]) for later in np.linspace(t, length, 60)]
            fastest = np.max(speeds, axis=0)
            least.append(np.inf)
            for i, capsule in enumerate(robot.capsules):
                link = int(capsule["link"]) + 1
                spin = (case.arm.levers[i, :link] + capsule["radius"]) @ fastest[:link]
                for k, agent in enumerate(case.people):
                    if spin > max(touch[k], REST_SPEED):
                        room = gap_of(robot, ends, i, agent) - reach[k]
                        least[-1] = min(least[-1], room - growth[k] * (t + DT + length / 6))
        found = margin_of(case.arm, case.motion, case.ticks, around_of(case, reach, growth, touch), case.work)
        seen.append(abs(found - min(least)))
        moments.add(int(np.argmin(least)))
    assert max(seen) < 1e-6
    assert slowest > 0.0 or len(moments) > 2


@pytest.mark.long
def test_the_margin_is_infinite_where_nothing_moves_and_where_nobody_is(robot):
    rng = np.random.default_rng(1)
    for people, moves in ((2, False), (0, True)):
        case = random_case(robot, rng, people=people, moves=moves)
        around = around_of(case, np.zeros(people), np.ones(people), np.zeros(people))
        assert margin_of(case.arm, case.motion, case.ticks, around, case.work) == np.inf


@njit
def seen_twice(arm, motion, ticks, around, room, work):
    return clears_people(motion, ticks, room, work.quickest[0]), keeps_clear(arm, motion, ticks, around, work)[0]


@jit  # what counts references must not be given a part of an array by what does not
def seen_without(arm, motion, ticks, around, work):
    return keeps_clear(arm, motion, ticks, beside_people(around), work)[0]


@pytest.mark.long
def test_only_a_wide_margin_says_that_people_need_not_be_looked_at(robot):
    """Between the moments of the margin people come closer: one of a hair is none."""
    rng, seen = np.random.default_rng(2), set()
    for _ in range(8):
        case = random_case(robot, rng)
        arm = case.arm._replace(self_pairs=case.arm.self_pairs[:0])
        growth = rng.choice([0.0, 1.0], 2)
        around = around_of(case, np.zeros(2), growth, np.zeros(2))
        room = margin_of(arm, case.motion, case.ticks, around, case.work)
        for left in (2e-4, 0.1, 1.0):
            near = around._replace(reach=around.reach + room - left)
            clears, verdict = seen_twice(arm, case.motion, case.ticks, near, left, case.work)
            assert not (clears and verdict == REACH)
            seen.add((left, clears, verdict == REACH))
        assert not seen_twice(arm, case.motion, case.ticks, around, np.nan, case.work)[0]
    assert {(2e-4, False, True), (1.0, True, False)} <= seen


def hall():
    """A region around everything that an arm does, with four open sides and a ceiling."""
    faces = records(5, FACE)
    faces["normal"] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1]]
    faces["offset"] = -3.0
    return faces, np.array([0, 5])


@pytest.mark.long
@pytest.mark.parametrize("watched", [False, True], ids=["people", "region"])
def test_who_is_not_looked_at_again_for_a_wide_margin_would_not_have_been_met(robot, watched):
    """Whatever is left of the gaps, however people grow: of those that are met some have a margin, one too narrow.

    What stands still is looked at in any case.
    """
    rng, refused, cleared, fixed, met = np.random.default_rng(4), 0, 0, 0, ENTRY if watched else REACH
    for _ in range(30):
        case = random_case(robot, rng, people=0 if watched else 2)
        k, slow = len(case.people), rng.choice([0.0, 0.0, 0.3, 2.0])
        arm = case.arm._replace(self_pairs=case.arm.self_pairs[:0])
        work = layout.work(arm, k, 1, 1, static_rows=False)
        around = around_of(case, np.zeros(k), slow * rng.choice([0.0, 1.0], k), rng.choice([0.0, 0.3], k))
        around = around._replace(statics=records(1, AGENT), planes=records(1, PLANE))
        around.statics["start"] = around.statics["end"] = rng.uniform(-3.0, 3.0, 3)
        around.statics["radius"], around.planes["normal"], around.planes["offset"] = 0.1, [0.0, 0.0, 1.0], -3.0
        if watched:
            faces, pieces = hall()
            around = around._replace(faces=faces, pieces=pieces, entry_speed=slow)
        if rng.random() < 0.3:
            around.planes["offset"] = robot.mount[2] + 0.6
        room = margin_of(arm, case.motion, case.ticks, around, work)
        for left in (*10.0 ** rng.uniform([-6.0, -6.0, -2.0], [-2.0, -2.0, 0.5]), 1.5, 0.0, -0.1):
            near = around._replace(reach=around.reach + room - left, entry_reach=around.entry_reach + room - left)
            true = margin_of(arm, case.motion, case.ticks, near, work)
            assert true == pytest.approx(left, abs=1e-9)
            clears, verdict = seen_twice(arm, case.motion, case.ticks, near, true, work)
            refused += verdict == met and true > 0.0
            cleared += clears
            if clears:
                assert verdict not in (REACH, ENTRY)
                assert seen_without(arm, case.motion, case.ticks, near, work) == verdict
                fixed += verdict in (STATIC, HALF_SPACE)
        for nothing in (np.nan, -np.inf, -1.0, 0.0):
            assert not seen_twice(arm, case.motion, case.ticks, around, nothing, work)[0]
        assert seen_twice(arm, case.motion, case.ticks, around, np.inf, work)[0]
        # people grow more in the shortest advancement than in a step, which is all that the margin has of it
        brief = case.motion._replace(dt=0.9 * SHORTEST)
        assert not seen_twice(arm, brief, case.ticks, around, np.inf, work)[0]
    assert refused >= 5
    assert cleared >= 10
    assert fixed >= 2


# ---- rows from a predicted miss ----------------------------------------------------------------------


@njit
def rows_of(arm, motion, people, foresight, work):
    return predicted_rows(arm, motion, people, foresight, work)


def first_jerk(x, v, a, T):
    """Of the polynomial of fifth degree that goes from 0 at v and a to x, and is at rest there at T."""
    times = np.array([[T**3, T**4, T**5], [3 * T**2, 4 * T**3, 5 * T**4], [6 * T, 12 * T**2, 20 * T**3]])
    c3, _, _ = np.linalg.solve(times, [x - v * T - a * T**2 / 2, -v - a * T, -a])
    return 6.0 * c3


def predicted(robot, chain, case):
    """Per pair the largest demand on the bounds, and its row, by finite differences; and the smallest gap."""
    best, least = {}, np.inf
    (q0, v0, a0), posture = case.motion.state, functools.cache(course(case))

    @functools.cache
    def ends(t, j=0, step=0.0):
        """With joint j turned by a step."""
        return ends_of(robot, chain, posture(t)[0] + step * np.eye(robot.n)[j])

    for i in range(len(robot.capsules)):
        for k, agent in enumerate(case.people):
            for t in np.arange(31) * FORESIGHT.step:
                gap = gap_of(robot, ends(t), i, agent, t)
                least = min(least, gap)
                short = FORESIGHT.d_min + FORESIGHT.growth * t - gap
                if short > FORESIGHT.deepest:
                    break
                if short <= 0.0:
                    continue
                row = np.zeros(robot.n)
                for j in range(robot.n):
                    ahead, behind = (gap_of(robot, ends(t, j, step), i, agent, t) for step in (1e-6, -1e-6))
                    row[j] = ahead - behind
                row /= 2e-6
                T, authority = max(t, FORESIGHT.soonest), np.abs(row) @ case.arm.limits[4]
                right = first_jerk(short + row @ (posture(t)[0] - q0), row @ v0, row @ a0, T)
                if authority >= FORESIGHT.authority and right / authority > best.get((i, k), (-np.inf,))[0]:
                    best[i, k] = right / authority, right, row
    return best, least


@pytest.mark.long
def test_predicted_rows_are_those_of_the_quintic(robot):
    rng, chain, rows, quiet = np.random.default_rng(2), chain_of(robot), 0, 0
    for _ in range(40):
        case = random_case(robot, rng, people=1)
        case.people["start"] = rng.uniform([-0.7, -0.7, 0.5], [0.7, 0.7, 1.5])
        case.people["end"] = case.people["start"] + [0.0, 0.0, 0.3]
        expected, least = predicted(robot, chain, case)
        count, found_least, *_ = rows_of(case.arm, case.motion, case.people, FORESIGHT, case.work)
        assert count == len(expected)
        if not count:
            quiet += least > FORESIGHT.d_min
            continue
        rows += count
        assert found_least == pytest.approx(least, abs=1e-9)
        for r in range(count):
            _, right, row = expected[divmod(int(case.work.owner[r]), 1)]
            np.testing.assert_allclose(case.work.L[r], row, atol=2e-5)
            assert case.work.S[r] == pytest.approx(right, rel=1e-3, abs=1e-2)
    assert rows > 20
    assert quiet > 3


@pytest.mark.long
def test_who_passes_by_asks_for_nothing_and_who_comes_closer_does(robot):
    """The index would answer to both: both come nearer as fast."""
    case = random_case(robot, np.random.default_rng(3), people=1, moves=False)
    case.motion.state[0] = case.motion.after[0] = robot.home
    agent = case.people[0]
    tip = ref.point(chain_of(robot), robot.home, robot.n, robot.capsules[-1]["end"])
    agent["radius"] = 0.1
    for aside, asks in ((0.6, False), (0.0, True)):
        for end in ("start", "end"):
            agent[end], agent[f"{end}_velocity"] = tip + np.array([0.9, aside, 0.0]), [-1.0, 0.0, 0.0]
        count, *_ = rows_of(case.arm, case.motion, case.people, FORESIGHT, case.work)
        assert (count > 0) == asks
