"""The controller as a policy on whole environments, and the wrapper that takes positions and velocities."""

import warnings
from dataclasses import dataclass
from typing import ClassVar

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import jssa_gym
from jssa_gym.control import Commands, Phase
from jssa_gym.control.commands import MODES, TIP_SPEED
from jssa_gym.control.inverse import postures_for
from jssa_gym.envs import ArmEnv
from jssa_gym.envs.tasks import Home, Reach, Track
from jssa_gym.exceptions import InvalidActionError, ParameterError
from jssa_gym.humans import ApproachRetreat
from jssa_gym.policies import POLICIES, JPCPolicy
from jssa_gym.safety.postures import tool_point
from jssa_gym.types import JointState, Status
from jssa_gym.validation import real_array


@dataclass(frozen=True, slots=True)
class Tour(Home):
    """Waypoints in joint space, a period apart."""

    period: float = 0.6
    count: ClassVar[int] = 6

    def draw_goal(self, rng, robot, planes):
        steps = rng.uniform(-0.35, 0.35, (self.count, robot.n)) * np.array([1.0, 0.5, 0.5, 1.0, 0.6, 1.0])
        return np.array(robot.home) + steps

    def check_goal(self, goal, robot):
        return real_array("goal", goal, (self.count, robot.n), "waypoints [rad]")

    def observe(self, goal, moment):
        return goal[-1] - moment.position

    def value(self, goal, moment):
        return float(np.abs(goal[-1] - moment.position).max())


class Visitor(ApproachRetreat):
    """Comes, stays a while and walks away, out of reach."""

    def _write(self, walker, rng, start):
        begin = super()._write(walker, rng, start)
        walker["moments"][-1] += 6.0
        return begin


class MovingGoal(ArmEnv):
    """The goal of the tool moves on in every step, until it stops."""

    def __init__(self, velocity, until, **options):
        super().__init__(Reach(), terminate_on=(), **options)
        self._goal_velocity, self._until = np.array(velocity), until

    def step(self, action):
        if self._time < self._until:
            self._goal = self._goal + self._goal_velocity * self.dt
        return super().step(action)


def drive(env, policy, steps, seed=0, options=None):
    """Infos and joint states of an episode."""
    observation, _ = env.reset(seed=seed, options=options)
    infos, states = [], []
    for _ in range(steps):
        observation, _, terminated, truncated, info = env.step(policy(observation))
        infos.append(info)
        state = env.unwrapped.scene.robot
        states.append((state.position, state.velocity, state.acceleration))
        if terminated or truncated:
            break
    return infos, np.array(states)


def test_it_is_a_public_policy():
    assert jssa_gym.JPCPolicy is JPCPolicy is POLICIES["jpc"]


def test_it_reaches_every_target_within_all_limits():
    env = gym.make("jssa_gym/Reach-v0", human="none")
    for seed in range(15):
        infos, _ = drive(env, JPCPolicy(env, seed), 1000, seed)
        assert infos[-1]["success"]
        assert not any(info["limit_violation"] for info in infos)


def test_its_usual_call_plans_nothing(monkeypatch):
    env = gym.make("jssa_gym/Reach-v0", human="none", terminate_on=())
    policy = JPCPolicy(env, 0, host_delay=0.0)
    plans = []

    def counted(*args, **options):  # what every plan to a point begins with
        plans.append(1)
        return postures_for(*args, **options)

    monkeypatch.setattr("jssa_gym.policies.jpc.postures_for", counted)
    drive(env, policy, 400)
    assert len(plans) == 1


def test_it_goes_home_and_stays(robot):
    env = gym.make("jssa_gym/Home-v0", human="none", terminate_on=())
    for seed in range(5):
        start = robot.home + np.random.default_rng(seed).uniform(-0.5, 0.5, 6)
        policy = JPCPolicy(env, seed)
        infos, states = drive(env, policy, 500, seed, {"joint_position": start})
        assert not any(info["limit_violation"] for info in infos)
        np.testing.assert_allclose(states[-1, 0], robot.home, atol=1e-8)
        assert np.abs(states[-1, 1:]).max() < 1e-8
        assert policy.jpc.phase is Phase.IDLE


def test_it_serves_any_environment_with_robot_dt_and_scene(robot):
    class Bare(gym.Env):
        """Nothing but what a shield needs."""

        action_space = gym.spaces.Box(-1.0, 1.0, (6,), np.float32)
        observation_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)

        def __init__(self):
            self._inner = ArmEnv("home", human="none", terminate_on=())
            self.robot, self.dt = self._inner.robot, self._inner.dt

        @property
        def scene(self):
            return self._inner.scene

        def reset(self, *, seed=None, options=None):
            self._inner.reset(seed=seed, options={"joint_position": robot.home + 0.3})
            return np.zeros(1, np.float32), {}

        def step(self, action):
            _, reward, *_, info = self._inner.step(action)  # as it is: single precision leads elsewhere
            return np.zeros(1, np.float32), reward, False, False, info

    env = jssa_gym.JSSAShield(Bare())
    _, states = drive(env, JPCPolicy(env, 0), 400)
    np.testing.assert_allclose(states[-1, 0], robot.home, atol=1e-5)


def test_it_meets_waypoints_on_time():
    env = ArmEnv(Tour(), human="none", terminate_on=())
    for seed in range(4):
        policy = JPCPolicy(env, seed, host_delay=0.0)
        infos, states = drive(env, policy, 800, seed)
        assert not any(info["limit_violation"] for info in infos)
        begin = next(k for k, info in enumerate(infos) if np.abs(info["jerk"]).max() > 0.0)
        each = round(0.6 / env.dt)
        for k, waypoint in enumerate(env.goal):
            np.testing.assert_allclose(states[begin + each * (k + 1) - 1, 0], waypoint, atol=1e-6)
        assert policy.jpc.met == Tour.count


def test_a_period_that_is_too_short_is_stretched():
    env = ArmEnv(Tour(period=0.08), human="none", terminate_on=())
    policy = JPCPolicy(env, 0)
    infos, states = drive(env, policy, 800)
    assert not any(info["limit_violation"] for info in infos)
    for waypoint in env.goal:
        assert np.abs(states[:, 0] - waypoint).max(axis=1).min() < 1e-6


def interrupted(at, ticks=5):
    """Track without people; from ``at(env)`` on somebody brakes the arm for some ticks. Last info, first request."""
    env = ArmEnv(Track(), human="none", terminate_on=())
    policy = JPCPolicy(env, 0, host_delay=0.0, yielding=False)
    observation, _ = env.reset(seed=0)
    left, begun, request = ticks, False, None
    for _ in range(1000):
        action = policy(observation)
        begun = begun or at(env)
        if begun and left:
            action, left = -0.2 * np.ones(6), left - 1
        observation, _, _, _, info = env.step(action)
        if begun and request is None and policy.jpc.phase is Phase.SETTLING:
            request = policy.jpc.request
    return info, request


def test_a_waypoint_that_the_arm_was_near_when_it_was_interrupted_is_not_gone_back_to():
    def visited(env):
        return env.scene.time > 0.5 and np.linalg.norm(env.goal[0] - env.scene.robot.position) <= 0.05 * 6**0.5

    info, request = interrupted(visited)
    assert request.met == 1
    assert info["success"]
    assert info["track/lateness"] <= 0.1


def test_an_interrupted_schedule_loses_little_more_than_the_interruption():
    info, request = interrupted(lambda env: env.scene.time >= 1.0)
    assert request.met == 0
    assert info["success"]
    assert info["track/lateness"] <= 0.4


def test_it_follows_a_goal_that_moves():
    env = MovingGoal([0.0, 0.1, 0.0], until=3.0, human="none")
    policy = JPCPolicy(env, 0, host_delay=(0.02, 0.06))
    observation, _ = env.reset(seed=0, options={"goal": [0.55, -0.15, 1.3]})
    gaps = []
    for _ in range(600):
        observation, *_, info = env.step(policy(observation))
        assert not info["limit_violation"]
        gaps.append(np.linalg.norm(tool_point(env.robot, env.scene.robot.position) - env.goal))
    assert gaps[-1] <= 0.011 * np.sqrt(3.0)
    # on its way it is behind by what the goal makes in the time of a replan, not by all of it
    assert np.max(gaps[200:375]) < 0.12


def test_an_unreachable_goal_leaves_the_arm_at_rest(robot, caplog):
    caplog.set_level("INFO", logger="jssa_gym")
    env = gym.make("jssa_gym/Reach-v0", human="none", terminate_on=())
    _, states = drive(env, JPCPolicy(env, 0), 300, options={"goal": [0.3, 0.0, 0.3]})
    np.testing.assert_array_equal(states[-1, 0], robot.home)
    assert "no posture" in caplog.text


@pytest.mark.sampled(1)
@pytest.mark.parametrize("period", [1.5, 1.2, 1.6])
def test_waypoints_are_tracked_whether_or_not_their_period_is_on_the_grid(period):
    env = jssa_gym.ArmEnv(Track(period=period), human="none", terminate_on=())
    policy = JPCPolicy(env, 0, host_delay=0.0)
    for seed in range(3):
        observation, info = env.reset(seed=seed)
        for _ in range(1000):
            observation, *_, info = env.step(policy(observation))
            if info["success"]:
                break
        assert info["success"]
        assert info["track/lateness"] < 0.1


def test_a_goal_that_comes_within_reach_is_not_kept_waiting():
    env = jssa_gym.ArmEnv("handover", terminate_on=())
    policy = JPCPolicy(env, 0, host_delay=0.0)
    observation, _ = env.reset(seed=3)
    reachable, began = None, None
    for k in range(1000):
        if reachable is None and env.goal[2] > 0.95 and np.linalg.norm(env.goal - [0.0, 0.0, 1.2]) < 0.9:
            reachable = k
        observation, *_ = env.step(policy(observation))
        if began is None and np.abs(env.scene.robot.velocity).max() > 0.0:
            began = k
    assert reachable > 20, "the hand begins at rest, below the table's height"
    # what was asked before and refused would be asked again after seconds
    assert began - reachable < 25


def test_an_episode_begins_anew():
    env = gym.make("jssa_gym/Reach-v0", human="none", terminate_on=())
    policy = JPCPolicy(env, 0, host_delay=0.0)
    first = [drive(env, policy, 120, seed)[1] for seed in (1, 2, 3)]
    again = [drive(env, JPCPolicy(env, 0, host_delay=0.0), 120, seed)[1] for seed in (1, 2, 3)]
    np.testing.assert_array_equal(first[0], again[0])
    for one, other in zip(first, again, strict=True):
        assert np.abs(one[-1, 0] - one[0, 0]).max() > 0.05
        assert np.abs(other[-1, 0] - other[0, 0]).max() > 0.05


def test_an_episode_is_the_same_whatever_came_before(robot):
    env = gym.make("jssa_gym/Home-v0", human="none", terminate_on=())
    policy = JPCPolicy(env, 0, host_delay=0.0)
    for steps in (40, 3, 60):
        options = {"joint_position": robot.home + 0.3}
        _, states = drive(env, policy, steps, 0, options)
        _, fresh = drive(env, JPCPolicy(env, 0, host_delay=0.0), steps, 0, options)
        np.testing.assert_array_equal(states, fresh)


def test_a_goal_that_never_stops_does_not_void_every_answer():
    env = MovingGoal([0.0, 0.1, 0.0], until=np.inf, human="none")
    policy = JPCPolicy(env, 0, host_delay=0.25)
    _, states = drive(env, policy, 350, options={"goal": [0.55, -0.2, 1.3]})
    assert np.linalg.norm(tool_point(env.robot, states[-1, 0]) - env.goal) < 0.12


def test_a_seed_fixes_delays_and_postures():
    env = gym.make("jssa_gym/Reach-v0", human="none", terminate_on=())
    one, two, other = (drive(env, JPCPolicy(env, k, host_delay=(0.0, 0.3)), 150, 5)[1] for k in (1, 1, 2))
    np.testing.assert_array_equal(one, two)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("delay", [-0.1, (0.2, 0.1), "soon", (0.1,), np.nan])
def test_a_delay_is_a_number_a_range_or_a_function(delay):
    env = gym.make("jssa_gym/Reach-v0", human="none")
    with pytest.raises(ParameterError, match="host_delay"):
        JPCPolicy(env, 0, host_delay=delay)


def test_a_host_that_never_answers_once_is_asked_again():
    env = gym.make("jssa_gym/Reach-v0", human="none")
    delays = iter([np.inf, np.inf])
    policy = JPCPolicy(env, 0, host_delay=lambda rng: next(delays, 0.1), patience=0.2)
    infos, _ = drive(env, policy, 1000)
    assert infos[-1]["success"]


def resumed(seed, shielded=True):
    """A tour that somebody interrupts and leaves: interference noticed, interventions, finished, moving contact."""
    rng = np.random.default_rng(seed)
    person = Visitor(start=1.5, nearest=(0.62, 0.75), wait=(0.0, 0.5), speed=(0.5, 0.8), stay=(0.5, 1.5))
    base = ArmEnv(Tour(), human=person, terminate_on=())
    env = jssa_gym.JSSAShield(base) if shielded else base
    policy = JPCPolicy(env, seed, host_delay=float(rng.uniform(0.0, 2.0)), yielding=False)
    observation, _ = env.reset(seed=seed)
    interventions, yielded, moving_contact = 0, False, False
    for _ in range(4000):
        observation, _, _, _, info = env.step(policy(observation))
        interventions += info.get("shield/intervened", False)
        yielded |= policy.jpc.phase is Phase.YIELDING
        moving_contact |= info["contact_speed"] > 1e-3
        assert info.get("shield/status", 0) != Status.FAULT
        if policy.jpc.phase is Phase.IDLE and not policy.jpc.open and base.scene.time > 5.0:
            break
    at_goal = np.abs(base.scene.robot.position - base.goal[-1]).max() < 1e-4
    return yielded, interventions, policy.jpc.met == Tour.count and at_goal, moving_contact


def run_resumed(seeds):
    runs = [resumed(seed) for seed in seeds]
    assert all(finished for _, _, finished, _ in runs)
    assert not any(moving for *_, moving in runs)
    # not vacuous: in most of them the shield did step in, and it was noticed
    assert sum(yielded for yielded, *_ in runs) > 0.5 * len(runs)
    for yielded, interventions, *_ in runs:
        assert yielded == (interventions > 0)
    return runs


@pytest.mark.long
def test_after_the_person_has_left_the_task_is_finished():
    run_resumed(range(20))


@pytest.mark.slow
def test_after_the_person_has_left_the_task_is_finished_many_times():
    run_resumed(range(300))


class TestJPCAction:
    @pytest.mark.parametrize("mode", MODES)
    @pytest.mark.parametrize("name", ["Reach-v0", "ReachShielded-v0"])
    def test_gymnasium_finds_nothing_to_complain_about(self, mode, name):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*is different from the unwrapped version")
            check_env(jssa_gym.JPCAction(gym.make(f"jssa_gym/{name}"), mode=mode), skip_render_check=True)

    def test_positions_are_reached_within_all_limits(self, robot):
        env = jssa_gym.JPCAction(gym.make("jssa_gym/Home-v0", human="none", terminate_on=()))
        low, high = robot.limits.position.T
        rng = np.random.default_rng(0)
        for _ in range(4):
            target = rng.uniform(low, high)
            action = ((target - (low + high) / 2.0) / ((high - low) / 2.0)).astype(np.float32)
            infos, states = drive(env, lambda _, action=action: action, 900)
            assert not any(info["limit_violation"] for info in infos)
            np.testing.assert_allclose(states[-1, 0], target, atol=2e-3)

    def test_velocities_are_a_share_of_the_limits(self, robot):
        env = jssa_gym.JPCAction(
            gym.make("jssa_gym/Home-v0", human="none", terminate_on=()), mode="velocity", share=0.25
        )
        action = np.array([1.0, 0.0, 0.0, -0.5, 0.0, 0.5], np.float32)
        _, states = drive(env, lambda _: action, 120)
        np.testing.assert_allclose(states[-1, 1], 0.25 * action * robot.limits.velocity, rtol=0.02, atol=1e-3)

    def test_the_tool_moves_as_commanded(self, robot):
        """Against MuJoCo-free differences of the tool's position, where the arm is far from singular."""
        env = jssa_gym.JPCAction(gym.make("jssa_gym/Home-v0", human="none", terminate_on=()), mode="tip", share=1.0)
        for action in np.vstack([np.eye(3), -np.eye(3)]) * 0.3:
            _, states = drive(env, lambda _, action=action: action.astype(np.float32), 60)
            tips = np.array([tool_point(robot, state[0]) for state in states[-20:]])
            np.testing.assert_allclose(np.diff(tips, axis=0).mean(axis=0) / 0.008, action * TIP_SPEED, atol=0.02)

    @pytest.mark.parametrize("mode", MODES)
    def test_a_state_that_meets_a_command_is_told_as_that_command(self, robot, mode):
        env = jssa_gym.JPCAction(gym.make("jssa_gym/Home-v0", human="none", terminate_on=()), mode=mode, share=1.0)
        home = Commands(robot.limits, "position").met_by(JointState(np.array(robot.home), *np.zeros((2, robot.n))))
        action = (home if mode == "position" else np.full(env.action_space.shape, 0.1)).astype(np.float32)
        _, states = drive(env, lambda _: action, 90)
        met = Commands(robot.limits, mode, 1.0, robot).met_by(JointState(*states[-1]))
        assert met.shape == env.action_space.shape
        np.testing.assert_allclose(met, action, atol=0.02)

    def test_tools_need_a_robot(self, robot):
        with pytest.raises(ParameterError, match="robot"):
            Commands(robot.limits, "tip")

    def test_a_shield_filters_what_it_makes(self):
        base = gym.make("jssa_gym/Home-v0", human="pursuit", terminate_on=())
        env = jssa_gym.JPCAction(jssa_gym.JSSAShield(base), mode="velocity", share=1.0)
        rng = np.random.default_rng(0)
        infos, _ = drive(env, lambda _: rng.uniform(-1.0, 1.0, 6), 500)
        assert any(info["shield/intervened"] for info in infos)
        assert not any(info["limit_violation"] for info in infos)
        assert max(info["contact_speed"] for info in infos) <= 1e-3

    def test_what_is_no_number_is_for_the_shield_to_answer(self):
        env = jssa_gym.JPCAction(jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human="none")))
        env.reset(seed=0)
        *_, info = env.step(np.full(6, np.inf))
        assert info["shield/status"] == Status.FAULT
        env = jssa_gym.JPCAction(jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human="none")), mode="tip")
        env.reset(seed=0)
        *_, info = env.step(np.full(3, np.nan))
        assert info["shield/status"] == Status.FAULT
        bare = jssa_gym.JPCAction(gym.make("jssa_gym/Home-v0", human="none"))
        bare.reset(seed=0)
        with pytest.raises(InvalidActionError):
            bare.step(np.full(6, np.nan))
        with pytest.raises(InvalidActionError):
            bare.step(np.zeros(5))

    @pytest.mark.parametrize("options", [{"mode": "torque"}, {"share": 0.0}, {"share": 1.5}])
    def test_bad_options_are_refused(self, options):
        with pytest.raises(ParameterError):
            jssa_gym.JPCAction(gym.make("jssa_gym/Home-v0", human="none"), **options)

    def test_its_arguments_can_be_rebuilt(self):
        env = jssa_gym.JPCAction(gym.make("jssa_gym/Home-v0", human="none"), mode="velocity", share=0.3)
        again = env.spec.make()
        assert again.mode == "velocity"
        assert again.action_space == env.action_space
