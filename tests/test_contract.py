"""What every robot and every task keeps to; a new entry of a registry is tested without being asked."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from jssa_gym import registration
from jssa_gym.cli.stress import Stress
from jssa_gym.envs.arm import ArmEnv
from jssa_gym.envs.tasks import TASKS, Moment, Progress, Task
from jssa_gym.envs.world import SCENES, planes_of
from jssa_gym.evaluation.campaign import Campaign, Grid
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import nobody
from jssa_gym.kernels.chain import forward, place
from jssa_gym.kernels.records import FRAME, SEGMENT, records
from jssa_gym.registration import ENTRIES, Entry, register_ids
from jssa_gym.robots import ROBOTS
from jssa_gym.safety.proximity import measure
from jssa_gym.types import JointState

HOOKS = ("present", "follow", "advance", "rewarded_at", "metrics")
"""What an environment calls of a task that evolves only."""


@pytest.mark.parametrize("name", ROBOTS)
class TestRobot:
    def test_home_is_a_rest_position_clear_of_table_and_itself(self, name: str) -> None:
        for scene, height in SCENES.items():
            robot = ROBOTS[name]().mounted([0.0, 0.0, height])
            low, high = robot.limits.position.T
            assert np.all((low < robot.home) & (robot.home < high))
            zero = np.zeros(robot.n)
            near = measure(robot, JointState(robot.home, zero, zero), nobody(), planes_of(scene))
            assert near.own.min(initial=np.inf) > 0.0
            assert near.planes.min(initial=np.inf) > 0.0

    def test_capsules_stand_where_mujoco_has_them(self, name: str) -> None:
        robot = ROBOTS[name]()
        model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
        data = mujoco.MjData(model)
        rng = np.random.default_rng(0)
        frames, segments = records(robot.n, FRAME), records(len(robot.capsules), SEGMENT)
        for _ in range(5):
            data.qpos[:] = rng.uniform(*robot.limits.position.T)
            mujoco.mj_kinematics(model, data)
            forward(robot.links, np.array([data.qpos, np.zeros(robot.n), np.zeros(robot.n)]), frames)
            place(frames, robot.capsules, segments)
            for segment, geom in zip(segments, robot.capsule_names, strict=True):
                middle = (segment["start"] + segment["end"]) / 2.0
                np.testing.assert_allclose(middle, data.geom(geom).xpos, atol=1e-12)

    def test_it_can_be_named_in_an_environment(self, name: str) -> None:
        env = gym.make("jssa_gym/Home-v0", robot=name, human="none")
        env.reset(seed=0)
        observation, *_ = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)


def drawn_goal(env: ArmEnv, seed: int = 0) -> np.ndarray:
    """All of the goal that ``reset(seed=seed)`` has drawn; ``env.goal`` is what of it comes first."""
    drawn = env.task.draw_goal(np.random.default_rng(seed), env.robot, env.planes)
    goal = env.task.follow(drawn, env.scene.human)
    np.testing.assert_array_equal(env.task.present(goal, Progress(np.array(env.robot.home))), env.goal)
    return goal


@pytest.mark.parametrize("name", TASKS)
class TestTask:
    def test_its_goals_are_goals(self, name: str) -> None:
        env = ArmEnv(name)
        for seed in range(20):
            env.reset(seed=seed)
            shapes = {"joints": [(env.robot.n,), (*env.goal.shape[:-1], env.robot.n)], "tip": [(3,)]}
            assert env.goal.shape in shapes[env.task.space]
            if type(env.task).follow is Task.follow:
                goal = drawn_goal(env, seed)
                np.testing.assert_array_equal(env.task.check_goal(goal, env.robot), goal)
            else:  # a goal that is somebody's cannot be set
                with pytest.raises(ParameterError):
                    env.reset(options={"goal": env.goal})

    def test_it_observes_what_its_features_announce(self, name: str) -> None:
        env = ArmEnv(name)
        env.reset(seed=0)
        moment = Moment(np.array(env.robot.home), np.array([0.4, 0.0, 1.4]), 0.0, np.zeros(6), np.inf, False)
        observed = env.task.observe(drawn_goal(env), moment)
        assert observed.shape == (sum(f.size for f in env.task.features(env.robot)),)

    def test_a_goal_that_is_met_is_reached_and_worth_most(self, name: str) -> None:
        env = ArmEnv(name)
        env.reset(seed=0)
        away = Moment(np.array(env.robot.home) + 0.5, np.array([9.0, 9.0, 9.0]), 0.0, np.zeros(6), np.inf, False)
        there, where = away, "position" if env.task.space == "joints" else "tip"
        goal = drawn_goal(env)
        for point in [*np.atleast_2d(goal)] * 2:  # one after the other and again, with all the time in the world
            there = there._replace(**{where: point})
            there = there._replace(progress=env.task.advance(goal, there, np.zeros(6), 1e3))
        away = away._replace(progress=there.progress)
        weight = env.task.terms[0].weight
        assert weight * env.task.value(goal, there) > weight * env.task.value(goal, away)
        assert env.task.reached(env.task.value(goal, there), there)
        assert not env.task.reached(env.task.value(goal, away), away)

    def test_it_evolves_if_it_says_so(self, name: str) -> None:
        # what an environment does not ask for must not be there
        task = TASKS[name]
        assert task.evolves == any(getattr(task, hook) is not getattr(Task, hook) for hook in HOOKS)

    def test_it_has_two_ids(self, name: str) -> None:
        assert TASKS[name].name == name
        for shielded in (False, True):
            spec = gym.spec(ENTRIES[name].env_id(shielded))
            assert spec.id == f"jssa_gym/{TASKS[name].__name__}{'Shielded' if shielded else ''}-v0"
            assert (spec.kwargs, spec.additional_wrappers) == ({"task": name}, ())
            made = spec.make()
            assert type(made.unwrapped.task) is TASKS[name]
            assert made.has_wrapper_attr("filter") == shielded

    def test_a_campaign_takes_it(self, name: str) -> None:
        grid = Grid(("none",), ("hand",), ("hold",), ("none",), 1)
        assert Campaign((grid,), name, steps=10).total() == 1
        assert Stress(task=name).campaign("quick", 10).task == name


def test_a_task_that_is_entered_is_registered(monkeypatch: pytest.MonkeyPatch) -> None:
    assert list(TASKS) == list(ENTRIES)
    registry = dict(gym.registry)
    monkeypatch.setattr(registration.gym, "registry", registry)  # the real one forgets nothing
    monkeypatch.setattr("gymnasium.envs.registration.registry", registry)
    monkeypatch.setitem(ENTRIES, "push", Entry("nowhere:Push", {"lambda1": 3.0}))
    before = set(registry)
    register_ids()
    assert set(registry) - before == {"jssa_gym/Push-v0", "jssa_gym/PushShielded-v0"}
    monkeypatch.setitem(TASKS, "push", TASKS["reach"])
    assert gym.make("jssa_gym/PushShielded-v0").get_wrapper_attr("filter").params.lambda1 == 3.0
