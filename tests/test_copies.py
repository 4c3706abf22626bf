"""A contract of everything that has a state: a copy, or what was pickled, goes on like the original, bit for bit."""

import copy
import dataclasses
import importlib
import inspect
import pickle
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from types import ModuleType

import gymnasium as gym
import numpy as np
import picklable
import pytest
from picklable import Push, bits, go_on
from places import environment

import jssa_gym
from jssa_gym.control import JPCAction
from jssa_gym.envs import TASKS, ArmEnv
from jssa_gym.envs.faults import FAULTS
from jssa_gym.envs.repeat import ActionRepeat
from jssa_gym.envs.sensor import MissedTicks, SensorModel
from jssa_gym.evaluation import RecordSafety
from jssa_gym.evaluation.contenders import CONTENDERS, Ageless, Late, shielded
from jssa_gym.exceptions import InterfaceError
from jssa_gym.humans import HUMANS, ApproachRetreat, Steered
from jssa_gym.policies import POLICIES, JPCPolicy, SteeredPolicy, load_policy, shipped_policies
from jssa_gym.robots import RobotModel, lr_mate_200id_7l
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import FILTERS, JSSAFilter, JSSAShield, NoFilter, SafetyFilter, Shield
from jssa_gym.train import Curriculum, DomainRandomisation
from jssa_gym.train.wrappers import ExecutedAction, InterventionPenalty, ObserveIntervention
from jssa_gym.types import Status


def pickled(thing):
    return pickle.loads(pickle.dumps(thing))


COPIES = {"copied": copy.deepcopy, "pickled": pickled}
copies = pytest.mark.parametrize("duplicate", COPIES.values(), ids=COPIES)


def close_by(task="home", **kwargs) -> ArmEnv:
    """Somebody comes so near that every filter has something to do; nothing ends the episode."""
    human = ApproachRetreat(start=0.8, nearest=(0.62, 0.62), wait=(0.0, 0.0))
    return ArmEnv(task, human=human, terminate_on=(), **kwargs)


def begin(env: gym.Env, policy, steps: int = 40, seed: int = 3):
    observation, _ = env.reset(seed=seed)
    for _ in range(steps):
        observation, *_ = env.step(policy(observation))
    return observation


def check(env: gym.Env, policy, duplicate, steps: int = 60) -> list:
    """Copy both in mid-episode, let the original go on, then the copy; what was seen of the original."""
    observation = begin(env, policy)
    other = duplicate((env, policy))
    expected = go_on(env, policy, observation, steps)
    assert go_on(*other, observation, steps) == expected
    # and a copy is whole: a new episode is the same, too
    assert bits(other[0].reset(seed=5)) == bits(env.reset(seed=5))
    return expected


def statuses(seen: list) -> set[int]:
    return {step[5]["shield/status"] for step in seen}


# ---- filters -----------------------------------------------------------------------------------------

LAYERS = {
    "bare": {},
    "with viability box and verified stop": {"viability": True, "failsafe": FailsafeParams()},
}
OPTIONS = {
    "osqp": lambda robot, dt, **layers: JSSAFilter(robot, dt, projector="osqp", **layers),
    "static rows": lambda robot, dt, **layers: JSSAFilter(robot, dt, static_rows=True, **layers),
    "a user's, of pairs": picklable.Distant,
    "a user's": picklable.Sluggish,
}
ALL_FILTERS = {**FILTERS, **OPTIONS}
filters = pytest.mark.parametrize("build", ALL_FILTERS.values(), ids=ALL_FILTERS)
layers = pytest.mark.parametrize("layers", LAYERS.values(), ids=LAYERS)


def shield(build, layers) -> Shield:
    env = close_by()
    return Shield(env, build(env.robot, env.dt, **layers))


@pytest.mark.sampled(7)
@copies
@layers
@filters
def test_a_filter_goes_on(build, layers, duplicate) -> None:
    env = shield(build, layers)
    found = statuses(check(env, Push(env), duplicate))
    assert Status.FAULT not in found
    if build is not FILTERS["none"]:
        # else a blind copy could not be told from one that sees
        assert found - {Status.NOMINAL}


@pytest.mark.sampled(5)
@layers
@filters
def test_a_filter_that_has_decided_goes_on_in_another_shield(build, layers) -> None:
    env = shield(build, layers)
    policy = Push(env)
    observation = begin(env, policy)
    other = Shield(copy.deepcopy(env.env), env.filter)
    expected = go_on(env, copy.deepcopy(policy), observation, 60)
    assert go_on(other, policy, observation, 60) == expected


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", CONTENDERS)
def test_a_weakened_shield_goes_on(name) -> None:
    env = shielded(close_by(), name)
    check(env, Push(env), copy.deepcopy)


# ---- what lies in the same memory --------------------------------------------------------------------


def arrays(thing, path: str = "", seen: dict | None = None) -> dict[int, tuple[str, np.ndarray]]:
    """All arrays that an object leads to, by their identity, with the way there."""
    seen = {} if seen is None else seen
    found = {}
    if id(thing) in seen or isinstance(thing, RobotModel | type | ModuleType | str | bytes):
        return found
    if type(thing).__module__.startswith("mujoco"):  # its arrays are windows on memory that it copies as a whole
        return found
    seen[id(thing)] = thing
    if isinstance(thing, np.ndarray):
        return {id(thing): (path, thing)}
    if isinstance(thing, dict):
        items = [(f"{path}[{key!r}]", value) for key, value in thing.items()]
    elif isinstance(thing, tuple | list | set | frozenset):
        items = [(f"{path}[{k}]", value) for k, value in enumerate(thing)]
    elif isinstance(thing, SafetyFilter):  # lets go of its views of one arm's entries, and makes them anew
        items = [(f"{path}.{name}", value) for name, value in thing.__getstate__().items()]
    else:
        slots = [name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ())]
        names = {*getattr(thing, "__dict__", {}), *slots}
        items = [(f"{path}.{name}", getattr(thing, name)) for name in sorted(names) if hasattr(thing, name)]
    for where, value in items:
        found |= arrays(value, where, seen)
    return found


def shared(thing) -> set[tuple[str, str]]:
    """Pairs of arrays that are no single object but share memory that can be written: copying parts them."""
    found = list(arrays(thing).values())
    return {
        (one, other)
        for k, (one, a) in enumerate(found)
        for other, b in found[k + 1 :]
        if (a.flags.writeable or b.flags.writeable) and np.shares_memory(a, b)
    }


@pytest.mark.sampled(9)
@layers
@filters
def test_no_array_of_a_filter_is_a_view_of_another(build, layers) -> None:
    env = shield(build, layers)
    begin(env, Push(env))
    assert len(arrays(env.filter)) > 5
    assert shared(env.filter) == set()
    assert shared(copy.deepcopy(env.filter)) == set()


class Peeking(NoFilter):
    """A user's filter that keeps a view of its own memory once it knows how much it needs."""

    where = "speed"

    def __init__(self, *args, **options) -> None:
        super().__init__(*args, **options)
        self._resize(0)

    def _resize(self, count) -> None:
        self.rows = np.zeros((3, count))
        setattr(self, self.where, {"kept": [self.rows[1]]} if self.where == "nested" else self.rows[1])

    def respond(self, tick):
        if self.rows.shape[1] != len(tick.people):
            self._resize(len(tick.people))
        return super().respond(tick)


class Hiding(Peeking):
    where = "nested"


@copies
@pytest.mark.parametrize("kind", [Peeking, Hiding])
def test_a_filter_that_a_copy_would_blind_is_refused_by_name(kind, duplicate) -> None:
    base = ArmEnv("home")
    env = Shield(base, kind(base.robot, base.dt))
    env.reset(seed=0)
    env.step(np.zeros(6))
    with pytest.raises(InterfaceError, match=f"{kind.__name__} cannot be copied: its attributes rows and {kind.where}"):
        duplicate(env)
    with pytest.raises(InterfaceError, match="share memory"):
        Shield(ArmEnv("home"), env.filter)


def test_views_are_found() -> None:
    class Holder:
        def __init__(self) -> None:
            self.whole = np.zeros((2, 3))
            self.again = self.whole  # the same object stays the same
            self.inner = {"row": [self.whole[1]]}

    assert shared(Holder()) == {(".inner['row'][0]", ".whole")} or shared(Holder()) == {(".again", ".inner['row'][0]")}
    assert shared(copy.deepcopy(Holder())) == set()


# ---- environments ------------------------------------------------------------------------------------


@pytest.mark.sampled(5)
@copies
@pytest.mark.parametrize("dynamics", ["kinematic", "servo"])
@pytest.mark.parametrize("task", TASKS)
def test_an_environment_goes_on(task, dynamics, duplicate) -> None:
    env = ArmEnv(task, dynamics=dynamics, terminate_on=())
    check(env, Push(env), duplicate)
    assert shared(env) == set()


@pytest.mark.sampled(3)
@copies
@pytest.mark.parametrize("dynamics", ["kinematic", "servo"])
def test_a_shielded_environment_goes_on(dynamics, duplicate) -> None:
    env = JSSAShield(gym.wrappers.TimeLimit(close_by(dynamics=dynamics), 1000))
    assert statuses(check(env, Push(env), duplicate)) - {Status.NOMINAL}


@pytest.mark.sampled(12)
@copies
@pytest.mark.parametrize("human", [*HUMANS, "two", "steered"])
def test_people_go_on(human, duplicate) -> None:
    who = {"two": ("pursuit", "hand"), "steered": Steered([[-1.0, 0.0, 1.0]] * 5)}.get(human, human)
    env = ArmEnv("home", human=who, terminate_on=())
    check(env, Push(env), duplicate, 100)
    assert shared(env) == set()


@pytest.mark.sampled(1)
@pytest.mark.gl
@copies
@pytest.mark.parametrize("dynamics", ["kinematic", "servo"])
def test_an_environment_that_has_drawn_goes_on_and_draws(dynamics, duplicate) -> None:
    env = close_by(dynamics=dynamics, render_mode="rgb_array", width=64, height=48)
    observation = begin(env, Push(env), 10)
    env.world.camera.azimuth = 40.0
    before = env.render()
    other = duplicate(env)
    assert other.world is not env.world
    np.testing.assert_array_equal(other.render(), before)
    push = Push(env)
    assert go_on(other, copy.deepcopy(push), observation, 20) == go_on(env, push, observation, 20)
    np.testing.assert_array_equal(other.render(), env.render())
    env.close()
    other.render()
    other.close()


ELSEWHERE = """
import pickle, sys
from picklable import go_on
env, policy, observation = pickle.load(open(sys.argv[1], "rb"))
print(repr(go_on(env, policy, observation, 30)))
"""


@pytest.mark.long
def test_what_was_pickled_goes_on_in_another_process(tmp_path) -> None:
    env = JSSAShield(close_by(dynamics="servo"))
    policy = Push(env)
    observation = begin(env, policy)
    path = tmp_path / "env.pickle"
    path.write_bytes(pickle.dumps((env, policy, observation)))
    command = [sys.executable, "-c", ELSEWHERE, str(path)]
    answer = subprocess.run(command, env=environment(), capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == repr(go_on(env, policy, observation, 30))


# ---- wrappers ----------------------------------------------------------------------------------------


def told(env: gym.Env) -> gym.Env:
    return JSSAShield(env)


WRAPPERS = {
    "SensorModel": lambda: told(SensorModel(close_by(), "all that is reported")),
    **{f"SensorModel, {name}": lambda name=name: told(SensorModel(close_by(), name)) for name in FAULTS},
    "MissedTicks": lambda: told(MissedTicks(close_by(), 0.2)),
    "Late": lambda: told(Late(close_by(), 5)),
    "Ageless": lambda: told(Ageless(SensorModel(close_by(), "latency 100 ms"))),
    "ActionRepeat": lambda: ActionRepeat(told(close_by()), 3),
    "RecordSafety": lambda: RecordSafety(gym.wrappers.TimeLimit(told(close_by()), 60)),
    "JPCAction": lambda: JPCAction(told(close_by()), mode="position"),
    "JPCAction, velocity": lambda: JPCAction(told(close_by()), mode="velocity"),
    "JPCAction, tip": lambda: JPCAction(told(close_by()), mode="tip"),
    "InterventionPenalty": lambda: InterventionPenalty(told(close_by())),
    "ObserveIntervention": lambda: ObserveIntervention(told(close_by())),
    "ExecutedAction": lambda: ExecutedAction(told(close_by())),
    "Curriculum": lambda: Curriculum(told(close_by()), 0.5),
    "DomainRandomisation": lambda: DomainRandomisation(
        told(SensorModel(close_by(), {"latency": 0.0})), limits=(0.4, 0.9), pace=(0.3, 0.9), latency=(0.0, 0.1)
    ),
    "Shield": lambda: Shield(env := close_by(), FILTERS["ssa"](env.robot, env.dt)),
    "JSSAShield": lambda: told(close_by()),
}


@pytest.mark.sampled(2)
@copies
@pytest.mark.parametrize("build", WRAPPERS.values(), ids=WRAPPERS)
def test_a_wrapper_goes_on(build, duplicate) -> None:
    env = build()
    check(env, Push(env), duplicate)
    assert shared(env) == set()


@pytest.mark.long
def test_every_wrapper_is_among_them() -> None:
    found = set()
    for module in pkgutil.walk_packages(jssa_gym.__path__, "jssa_gym."):
        if not module.name.endswith("__main__"):
            members = vars(importlib.import_module(module.name)).values()
            found |= {kind for kind in members if inspect.isclass(kind) and issubclass(kind, gym.Wrapper)}
    ours = {kind.__name__ for kind in found if kind.__module__.startswith("jssa_gym")}
    assert ours == {name.split(",")[0] for name in WRAPPERS}


# ---- policies ----------------------------------------------------------------------------------------

MORE_POLICIES = {
    "jpc, constant delay": lambda env, seed: JPCPolicy(env, seed, host_delay=0.05),
    "steered": lambda env, seed: SteeredPolicy(env, np.random.default_rng(seed).uniform(-1, 1, (6, 6))),
}
ALL_POLICIES = {**POLICIES, **MORE_POLICIES}


def policies_at_tasks() -> Iterator[tuple[str, str]]:
    """Those that look at a goal at every task, the others, to which tasks are all the same, at one."""
    tasks = list(TASKS)
    for number, name in enumerate(ALL_POLICIES):
        looks = name == "straight" or name.startswith("jpc")
        yield from ((name, task) for task in (tasks if looks else [tasks[number % len(tasks)]]))


@pytest.mark.sampled(3)
@copies
@pytest.mark.parametrize(("name", "task"), list(policies_at_tasks()))
def test_a_policy_goes_on(name, task, duplicate) -> None:
    env = JSSAShield(ArmEnv(task, terminate_on=()))
    policy = ALL_POLICIES[name](env, 7)
    check(env, policy, duplicate)
    assert shared(policy) == set()


@pytest.mark.sampled(3)
@copies
@pytest.mark.parametrize("name", shipped_policies())
def test_a_learned_policy_goes_on(name, duplicate) -> None:
    policy = load_policy(name)
    env = JSSAShield(ArmEnv(policy.task, terminate_on=()))
    if policy.observes_intervention:
        env = ObserveIntervention(env)
    check(env, policy, duplicate)


# ---- robots ------------------------------------------------------------------------------------------


def test_what_cannot_change_stays_so_in_a_copy() -> None:
    robot = lr_mate_200id_7l()
    for duplicate in COPIES.values():
        for one in (duplicate(robot), duplicate(robot.limits), duplicate(JPCPolicy(close_by()))._robot):
            fields = {field.name: getattr(one, field.name) for field in dataclasses.fields(one)}
            held = [array for _, array in arrays(fields).values()]
            assert len(held) >= 4
            assert not any(array.flags.writeable for array in held)


@copies
def test_a_copy_needs_no_kernels_of_its_own(duplicate) -> None:
    """Arrays that came back with other flags or strides would be other types, and half a minute of compilation."""

    def signatures() -> int:
        kernels = {
            id(value): value
            for name, module in sys.modules.items()
            if name.startswith("jssa_gym.kernels.")
            for value in vars(module).values()
            if hasattr(value, "nopython_signatures")
        }
        assert not kernels or len(kernels) > 20
        return sum(len(kernel.nopython_signatures) for kernel in kernels.values())

    env = JSSAShield(close_by("reach"))
    policy = POLICIES["straight"](env, 0)
    observation = begin(env, policy)
    other = duplicate((env, policy))
    go_on(env, policy, observation, 60)
    before = signatures()
    go_on(*other, observation, 60)
    assert signatures() == before
