"""The bound on success of ``benchmarks/blocked_goals.py``: by hand, and against what arms achieve."""

import json
import runpy
import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from places import ROOT

import jssa_gym
from jssa_gym.control import plan_move
from jssa_gym.envs import ArmEnv
from jssa_gym.evaluation import rollout
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import Body, HumanMotion, Nobody
from jssa_gym.kernels.chain import forward
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.safety.postures import tool_point

PATH = ROOT / "benchmarks" / "blocked_goals.py"
BENCH = runpy.run_path(str(PATH))
EVERY = np.ones(1000, bool)
HEAD = np.array([0.8, 0.1, 1.5])
"""A goal at the height of a head."""


class Standing(HumanMotion):
    """Stands with the head above a point for some time; before and after that, 5 m farther away."""

    speed_bound, reacts = 0.0, False

    def __init__(self, x, y, comes=0.0, leaves=np.inf):
        self.x, self.y, self.comes, self.leaves = x, y, comes, leaves

    def _body(self):
        away = 0.0 if self.comes <= self._time < self.leaves else 5.0
        return Body.facing().at((self.x + away, self.y), (0.0, 0.0))

    def reset(self, rng, start=None, person=0):
        self._time = 0.0
        return self._body()

    def step(self, dt, robot):
        self._time += dt
        return self._body()


def beside(goal, human):
    """An environment whose goal is a point that the arm can reach."""
    env = ArmEnv("reach", human=human, terminate_on=())
    reset = env.reset
    env.reset = lambda seed: reset(seed=seed, options={"goal": goal})
    return env


# ---- by hand -----------------------------------------------------------------------------------------


def test_a_window_has_to_be_long_enough_free_and_within_reach():
    find, gap = BENCH["find"], np.full(1000, 0.0)
    gap[500:513] = 0.2
    assert find(gap, EVERY, 0.05, -0.04, 13) == (0.987, True)
    assert find(gap, EVERY, 0.05, -0.04, 14) == (0.987, False)
    # the tool's ball is nearer than the goal: 0.2 - 0.04 is what is left
    assert find(gap, EVERY, 0.16, -0.04, 13).possible
    assert not find(gap, EVERY, 0.161, -0.04, 13).possible
    assert find(gap, np.arange(1000) >= 500, 0.05, -0.04, 13).possible
    assert not find(gap, np.arange(1000) >= 501, 0.05, -0.04, 13).possible


def test_nobody_blocks_nothing():
    for findings in BENCH["survey"](ArmEnv("reach", human=Nobody()), range(3), (0.0, 0.05), 1000):
        assert findings == [(0.0, True)] * 3


def test_who_stands_on_the_goal_makes_it_impossible_and_who_leaves_does_not():
    (stays,) = BENCH["survey"](beside(HEAD, Standing(*HEAD[:2])), [0], [0.0], 1000)
    assert stays == [(1.0, False)]
    (leaves,) = BENCH["survey"](beside(HEAD, Standing(*HEAD[:2], leaves=4.0)), [0], [0.0], 1000)
    assert leaves == [(pytest.approx(0.5, abs=0.002), True)]
    # 0.1 s before the end is too late
    (late,) = BENCH["survey"](beside(HEAD, Standing(*HEAD[:2], leaves=7.95)), [0], [0.0], 1000)
    assert not late[0].possible


def test_a_window_before_the_tool_can_be_there_is_none():
    env = beside(HEAD, Standing(*HEAD[:2], comes=0.15))
    (found,) = BENCH["survey"](env, [0], [0.0], 1000)
    assert not found[0].possible
    (found,) = BENCH["survey"](env, [0], [0.0], 1000, not_before=0.0)
    assert found[0].possible


@pytest.mark.parametrize(("steps", "possible"), [(12, False), (13, True)])
def test_a_window_is_as_many_steps_as_success_takes(steps, possible):
    # 0.1 s are 12.5 steps of 0.008 s
    env = beside(HEAD, Standing(*HEAD[:2], comes=0.008 * (steps + 1) - 1e-3))
    (found,) = BENCH["survey"](env, [0], [0.0], 200, not_before=0.0)
    assert found == [(1.0 - steps / 200, possible)]


@pytest.mark.parametrize("clearance", [0.0, 0.05])
def test_blocked_is_what_no_place_within_the_tolerance_avoids(clearance):
    # beside a head of 0.2 m: the goal's nearest free place is 0.02 m farther out, and the tool a ball of 0.06 m
    x, y, _ = HEAD
    edge = 0.2 + 0.06 - 0.02 + clearance
    body = Standing(x, y)
    for gap, blocked in ((edge - 1e-6, True), (edge + 1e-6, False)):
        goal = np.array([x, y, 1.5 + gap])
        (found,) = BENCH["survey"](beside(goal, body), [0], [clearance], 50)
        assert (found[0].blocked == 1.0) is blocked


def test_the_ball_of_the_tool_is_inside_its_capsule(robot, toy_robot):
    assert BENCH["ball"](robot) == pytest.approx(0.06)
    assert BENCH["ball"](toy_robot) == pytest.approx(0.03)


# ---- it bounds what arms do --------------------------------------------------------------------------


def test_levers_are_the_largest_there_are(robot, toy_robot):
    rng = np.random.default_rng(0)
    for arm in (robot, toy_robot):
        (low, high), frames = arm.limits.position.T, records(arm.n, FRAME)
        found = np.zeros(arm.n)
        for _ in range(2000):
            posture = rng.uniform(low, high)
            forward(arm.links, np.array([posture, 0.0 * posture, 0.0 * posture]), frames)
            found = np.maximum(found, np.linalg.norm(tool_point(arm, posture) - frames["origin"], axis=1))
        bound = BENCH["levers"](arm)
        moves = np.arange(arm.n) <= arm.tool_link
        assert np.all(found[moves] <= bound[moves] + 1e-12)
        assert np.all(found[moves] >= 0.9 * bound[moves])
        assert not bound[~moves].any()


def test_no_move_brings_the_tool_farther_than_the_bound(robot):
    rng, (low, high) = np.random.default_rng(0), robot.limits.position.T
    farthest, begin = BENCH["farthest"](robot, 0.008, 400), tool_point(robot, robot.home)
    assert np.all(np.diff(farthest) > 0.0)
    for _ in range(5):
        plan = plan_move(robot.home, rng.uniform(0.9 * low, 0.9 * high), robot.limits, 0.008)
        for k in range(1, len(plan) + 1, 5):
            assert np.linalg.norm(tool_point(robot, plan.states[k, 0]) - begin) <= farthest[k - 1]
    # of one joint at its jerk's bound, from below: J t³/6 times its lever
    toy = replace(robot, limits=replace(robot.limits, jerk=np.array([60.0, *[1e-9] * 5])))
    t = 0.008 * np.arange(1, 11)
    exact = 60.0 * t**3 / 6.0 * BENCH["levers"](robot)[0]
    bound = BENCH["farthest"](toy, 0.008, 10)
    assert np.all((exact <= bound) & (bound <= exact + 60.0 * t**2 / 2.0 * 0.008 * 1.5))


def test_people_are_those_that_an_evaluation_meets_and_no_success_was_called_impossible():
    env = ArmEnv("reach", human="random", terminate_on=())
    shielded = gym.make("jssa_gym/ReachShielded-v0", human="random", terminate_on=())
    for seed in (3, 4):
        course = BENCH["follow"](env, seed, 300)
        trace = rollout(shielded, jssa_gym.JPCPolicy(shielded, seed), seed=seed, steps=300)
        along = np.linspace(0.0, 1.0, 400)[:, None, None, None]
        points = trace.human_start + along * (trace.human_end - trace.human_start)
        by_sampling = (np.linalg.norm(points - trace.goal[:, None], axis=3) - trace.human_radius).min(axis=(0, 2))
        np.testing.assert_allclose(course.gap, by_sampling, atol=2e-3)
        (found,) = BENCH["survey"](env, [seed], [0.0], 300)
        assert trace.success.any()
        assert found[0].possible


# ---- refusals and the command ------------------------------------------------------------------------


@pytest.mark.parametrize(("task", "human", "word"), [("reach", "pursuit", "look at"), ("home", "random", "no point")])
def test_what_says_nothing_is_refused(task, human, word):
    with pytest.raises(ParameterError, match=word):
        BENCH["follow"](ArmEnv(task, human=human), 0, 10)


def test_the_command_prints_and_writes(tmp_path, monkeypatch, capsys):
    out = tmp_path / "blocked.json"
    arguments = ["--episodes", "2", "--seed", "7", "--seconds", "1", "--not-before", "0.95", "--json", str(out)]
    monkeypatch.setattr(sys, "argv", [PATH.name, *arguments])
    BENCH["main"]()
    assert "no window: success is impossible  2 / 2" in capsys.readouterr().out
    told = json.loads(out.read_text())
    # 0.05 s are no window
    assert [one["impossible seeds"] for one in told["clearances"]] == [[7, 8], [7, 8]]
    monkeypatch.setattr(sys, "argv", [PATH.name, "--human", "hand"])
    with pytest.raises(SystemExit) as caught:
        BENCH["main"]()
    assert caught.value.code == 2
