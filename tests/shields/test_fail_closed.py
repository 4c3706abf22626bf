"""Whatever goes wrong, the arm brakes, says so, and nobody else's state is touched."""

import copy
import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from monitors import Unsolvable
from picklable import Distant

import jssa_gym
from jssa_gym.humans import ApproachRetreat, RandomWalk
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.projection import project_rows, scratch
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.projectors import PROJECTORS, Projection
from jssa_gym.shields import JSSAFilter, SafetyFilter, Shield, make_filter
from jssa_gym.types import CapsuleSet, Decision, Planes, Scene, Status


def moving_scene(env: gym.Env) -> Scene:
    """A scene with the joints turning, so that braking and doing nothing differ."""
    env.reset(seed=0)
    for _ in range(20):
        env.step(np.full(6, 0.3))
    return env.unwrapped.scene


def assert_brakes(decision: Decision, scene: Scene, robot, word: str) -> None:
    assert decision.status == Status.FAULT
    assert word in decision.reason
    # against the motion: the joints turn forwards and still accelerate
    assert np.all(scene.robot.velocity > 0.0)
    assert np.all(decision.jerk < 0.0)
    assert np.all(np.abs(decision.jerk) <= robot.limits.jerk)


def post(**changes) -> CapsuleSet:
    fields = {
        "start": np.array([[0.9, 0.0, 0.9]]),
        "end": np.array([[0.9, 0.0, 1.4]]),
        "start_velocity": np.zeros((1, 3)),
        "end_velocity": np.zeros((1, 3)),
        "radius": np.array([0.1]),
        "names": ("post",),
        "person": np.zeros(1, np.int64),
    }
    return CapsuleSet(**(fields | changes))


BAD_STATIC = {
    "end is NaN": {"static": post(end=np.array([[0.9, 0.0, np.nan]]))},
    "radius is infinite": {"static": post(radius=np.array([np.inf]))},
    "radius is negative": {"static": post(radius=np.array([-1.0]))},
    "radius of another shape": {"static": post(radius=np.array([0.1, 0.1]))},
    "normal is NaN": {"planes": Planes(np.full((1, 3), np.nan), np.zeros(1), ("table",))},
    "normal is no unit": {"planes": Planes(np.array([[0.0, 0.0, 5.0]]), np.zeros(1), ("table",))},
    "normal of another shape": {"planes": Planes(np.zeros((2, 2)), np.zeros(1), ("table",))},
    "offset is NaN": {"planes": Planes(np.array([[0.0, 0.0, 1.0]]), np.full(1, np.nan), ("table",))},
}


@pytest.mark.parametrize("human", ["approach_retreat", "none"])
@pytest.mark.parametrize("case", BAD_STATIC)
def test_a_bad_static_scene_brakes(case: str, human: str) -> None:
    env = gym.make("jssa_gym/Home-v0", human=human, terminate_on=())
    scene = moving_scene(env)
    robot = env.unwrapped.robot
    filter = JSSAFilter(robot, env.unwrapped.dt, static_rows=True)
    assert filter.decide(scene, np.zeros(6)).status != Status.FAULT
    bad = scene._replace(**BAD_STATIC[case])
    assert_brakes(filter.decide(bad, np.zeros(6)), scene, robot, "the filter failed")


def test_a_static_capsule_that_moves_in_place_is_seen() -> None:
    env = gym.make("jssa_gym/Home-v0", human="none")
    scene = moving_scene(env)._replace(static=post(start=np.full((1, 3), 9.0), end=np.full((1, 3), 9.0)))
    filter = JSSAFilter(env.unwrapped.robot, env.unwrapped.dt, static_rows=True)
    assert filter.decide(scene, np.zeros(6)).status == Status.NOMINAL
    tip = env.unwrapped.robot_capsules.end[-1]
    scene.static.start[:] = scene.static.end[:] = tip + np.array([0.05, 0.0, 0.0])
    assert filter.decide(scene, np.zeros(6)).status != Status.NOMINAL


class Sick(SafetyFilter):
    """Answers as it is told."""

    def answer(self, nominal):
        raise ZeroDivisionError("sick")

    def respond(self, tick):
        jerk, status = self.answer(tick.nominal)
        return Decision(jerk, tick.nominal, status, "", 0.0, 1.0, (0, 0), 0.0, 0)


@pytest.mark.parametrize(
    ("answer", "word"),
    [
        (None, "ZeroDivisionError"),
        (lambda nominal: (np.full(6, np.nan), Status.PROJECTED), "not finite"),
        (lambda nominal: (np.full(6, 1e4), Status.PROJECTED), "outside the jerk bounds"),
        (lambda nominal: (np.zeros(1), Status.PROJECTED), "shape"),
        (lambda nominal: (np.zeros(6, np.float32), Status.PROJECTED), "type"),
        (lambda nominal: (nominal / 2.0, Status.NOMINAL), "not the nominal"),
        (lambda nominal: (None, Status.PROJECTED), "AttributeError"),
    ],
)
def test_a_filter_is_not_trusted(answer, word: str, caplog: pytest.LogCaptureFixture) -> None:
    env = gym.make("jssa_gym/Home-v0", terminate_on=())
    scene = moving_scene(env)
    robot = env.unwrapped.robot
    filter = Sick(robot, env.unwrapped.dt)
    if answer is not None:
        filter.answer = answer
    assert_brakes(filter.decide(scene, np.full(6, 1.0)), scene, robot, word)


@pytest.mark.parametrize("projector", PROJECTORS)
def test_a_projection_without_a_solution_brakes(projector: str, monkeypatch: pytest.MonkeyPatch) -> None:
    env = gym.make("jssa_gym/Home-v0", terminate_on=(), human=ApproachRetreat(start=0.9, nearest=(0.65, 0.65)))
    env.reset(seed=0)
    filter = Unsolvable(env.unwrapped.robot, env.unwrapped.dt, projector=projector)
    nominal = np.full(6, 3.0)
    while filter.decide(env.unwrapped.scene, nominal).rows == 0:
        env.step(nominal / env.unwrapped.robot.limits.jerk)
    scene = env.unwrapped.scene
    unsolved = Projection(nominal.copy(), False, np.nan, "")
    if projector == "exact":
        filter.make_unsolvable()
    monkeypatch.setattr(filter.projector, "project", lambda *_: unsolved)
    decision = filter.decide(scene, nominal)
    assert decision.status == Status.FAULT
    assert "no solution" in decision.reason
    assert not np.array_equal(decision.jerk, nominal)


def test_an_unsolvable_projection_does_not_answer_with_the_nominal() -> None:
    nominal, out = np.full(3, 0.5), np.zeros(3)
    L, S = np.full((2, 3), np.nan), np.ones(2)
    feasible, left = project_rows(nominal, L, S, 2, -np.ones(3), np.ones(3), np.eye(3), *scratch(3, 2), out)
    assert not feasible
    assert np.isnan(left)
    np.testing.assert_array_equal(out, np.zeros(3))


@pytest.mark.parametrize("where", ["L", "S"])
def test_an_infinite_row_is_not_projected_onto(where: str) -> None:
    L, S, out = np.eye(2, 3), np.full(2, 0.5), np.zeros(3)
    (L if where == "L" else S)[(1, 0) if where == "L" else 1] = np.inf
    bound = np.ones(3)
    feasible, left = project_rows(-0.9 * bound, L, S, 2, -bound, bound, np.eye(3), *scratch(3, 2), out)
    assert not feasible
    assert np.isnan(left)
    np.testing.assert_array_equal(out, np.zeros(3))


def test_a_nominal_that_is_no_number_is_not_projected() -> None:
    L, S, out, bound = np.eye(2, 3), np.full(2, 0.5), np.zeros(3), np.ones(3)
    nominal = np.array([0.0, 0.0, np.nan])
    feasible, left = project_rows(nominal, L, S, 2, -bound, bound, np.eye(3), *scratch(3, 2), out)
    assert not feasible
    assert np.isnan(left)
    np.testing.assert_array_equal(out, np.zeros(3))


def test_one_hopeless_row_does_not_switch_off_the_others() -> None:
    """Row 1 is beyond every jerk; row 2 can be kept besides, so it has to be."""
    lower, upper, out = -np.full(6, 60.0), np.full(6, 60.0), np.zeros(6)
    L = np.array([[1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 5e-3, 0.0, 0.0]])
    S = np.array([1.0, 0.1])
    nominal = np.array([0.0, 0.0, 0.0, -60.0, 0.0, 0.0])
    feasible, left = project_rows(nominal, L, S, 2, lower, upper, np.eye(6), *scratch(6, 2), out)
    assert not feasible
    assert left == pytest.approx(1.0 - 3 * 0.06, rel=1e-6)
    np.testing.assert_allclose(out[:3], 60.0, rtol=1e-6)
    assert L[1] @ out >= S[1] - 1e-6


def test_a_scene_that_cannot_be_had_brakes() -> None:
    class Broken(gym.Wrapper):
        broken = False

        @property
        def scene(self):
            if self.broken:
                raise OSError("camera gone")
            return self.env.unwrapped.scene

    env = Broken(gym.make("jssa_gym/Home-v0", human="none", terminate_on=()))
    shield = jssa_gym.JSSAShield(env)
    shield.reset(seed=0)
    for _ in range(20):
        shield.step(np.full(6, 0.3))
    env.broken = True
    for _ in range(200):
        *_, info = shield.step(np.full(6, 0.3))
        assert info["shield/status"] == Status.FAULT
    # by dead reckoning, without ever seeing the arm again, it has come to rest
    arm = env.unwrapped.scene.robot
    assert np.abs(arm.velocity).max() < 1e-6
    assert np.abs(arm.acceleration).max() < 1e-6


MACHINERY = {JSSAFilter: ("loop.decide_all", "Reading.read"), Distant: ("loop.prepare", "loop.settle")}
"""What a control step is made of, for a compiled filter and for one that is not."""


@pytest.mark.parametrize(("kind", "what"), [(kind, what) for kind, parts in MACHINERY.items() for what in parts])
@pytest.mark.parametrize("stop", [True, False])
def test_machinery_that_fails_is_no_bad_scene(kind, what, stop, monkeypatch, caplog) -> None:
    env = gym.make("jssa_gym/Home-v0", human="none", terminate_on=())
    assumed = FailsafeParams() if stop else None
    env = Shield(env, kind(env.unwrapped.robot, env.unwrapped.dt, viability=stop, failsafe=assumed))
    env.reset(seed=0)
    for _ in range(10):
        assert env.step(np.full(6, 0.2))[4]["shield/status"] == Status.NOMINAL

    def broken(*_):
        raise EOFError("Ran out of input")

    monkeypatch.setattr(f"jssa_gym.shields.filter.{what}", broken)
    for _ in range(130):
        *_, info = env.step(np.full(6, 0.2))
        assert info["shield/status"] == Status.FAULT
        assert "EOFError: Ran out of input" in info["shield/reason"]
        assert "scene" not in info["shield/reason"]
    assert sum("Every decision of the last" in record.message for record in caplog.records) == 1
    state = env.unwrapped.scene.robot
    assert max(np.abs(state.velocity).max(), np.abs(state.acceleration).max()) < 1e-6
    monkeypatch.undo()
    assert env.step(np.zeros(6))[4]["shield/status"] == Status.NOMINAL


@pytest.mark.parametrize("stop", [True, False])
@pytest.mark.parametrize("scene", [None, Scene(*(None for _ in Scene._fields))], ids=["none", "empty"])
def test_machinery_that_fails_without_a_scene_brakes_by_dead_reckoning(scene, stop, robot, make_scene, monkeypatch):
    filter = make_filter("jssa", robot, 0.008, failsafe=FailsafeParams() if stop else None)
    state = np.array([robot.home, np.zeros(6), np.zeros(6)])
    filter.reset(make_scene(state))
    for k in range(10):
        integrate(state, filter.decide(make_scene(state, time=0.008 * k), 0.2 * robot.limits.jerk).jerk, 0.008, state)
    assert np.abs(state[1]).min() > 0.01
    monkeypatch.setattr("jssa_gym.shields.filter.loop.decide_all", lambda *_: 1 // 0)
    for _ in range(100):
        decision = filter.decide(scene, 0.2 * robot.limits.jerk)
        assert decision.status == Status.FAULT
        assert "ZeroDivisionError" in decision.reason
        integrate(state, decision.jerk, 0.008, state)
    assert np.abs(state[1:]).max() < 1e-6


class Nameless:
    """A name that cannot be said."""

    def __format__(self, spec):
        raise ZeroDivisionError("nameless")


@pytest.mark.parametrize("kind", MACHINERY)
def test_a_name_that_cannot_be_said_changes_nothing_but_the_reason(kind, robot, make_scene) -> None:
    """The stop goes on by one tick and no more: what is decided is decided, whatever can be said of it."""
    answers = []
    for wall in ("wall", Nameless()):
        filter = kind(robot, 0.008, viability=True, failsafe=FailsafeParams())
        planes = Planes(np.array([[-1.0, 0.0, 0.0]]), np.array([-0.9]), (wall,))
        state, seen = np.array([robot.home, np.zeros(6), np.zeros(6)]), []
        filter.reset(make_scene(state))
        for k in range(200):
            scene = make_scene(state, time=0.008 * k)._replace(planes=planes)
            decision = filter.decide(scene, 0.3 * robot.limits.jerk * [0, 1, 1, 0, 0, 0])
            seen.append((*decision.jerk, decision.status, decision.reason == ""))
            assert decision.status != Status.FAULT, decision.reason
            assert (" would meet ... (ZeroDivisionError)" in decision.reason) == (
                wall != "wall" and decision.status == Status.FAILSAFE and "joint limits" not in decision.reason
            )
            integrate(state, decision.jerk, 0.008, state)
        assert Status.FAILSAFE in {status for *_, status, _ in seen}
        answers.append(seen)
    assert answers[0] == answers[1]


class Doubling(gym.Wrapper):
    """No action wrapper, and yet the arm does something else than it is told."""

    def step(self, action):
        return self.env.step(np.clip(2.0 * np.asarray(action), -1.0, 1.0))


def test_whatever_else_moves_the_arm_is_told_once_and_loudly(caplog) -> None:
    env = jssa_gym.JSSAShield(Doubling(gym.make("jssa_gym/Home-v0", human="none", terminate_on=())))
    for seed in range(2):
        env.reset(seed=seed)
        infos = [env.step(np.full(6, 0.2))[4] for _ in range(100)]
        assert infos[0]["shield/status"] == Status.NOMINAL
        assert sum(info["shield/status"] == Status.FAULT for info in infos) > 90
    assert sum("something else moves it" in record.message for record in caplog.records) == 1


def test_two_environments_never_share_a_person() -> None:
    human = RandomWalk()
    first, second = (gym.make("jssa_gym/Home-v0", human=human, terminate_on=()) for _ in range(2))
    alone = gym.make("jssa_gym/Home-v0", human=RandomWalk(), terminate_on=())
    first.reset(seed=1)
    second.reset(seed=2)
    alone.reset(seed=1)
    for k in range(60):
        second.step(np.zeros(6))
        if k == 30:
            gym.make("jssa_gym/Home-v0", human=human)
        first.step(np.zeros(6))
        alone.step(np.zeros(6))
        np.testing.assert_array_equal(first.unwrapped.scene.human.start, alone.unwrapped.scene.human.start)


def test_the_same_motion_twice_is_two_people() -> None:
    human = RandomWalk()
    env = gym.make("jssa_gym/Home-v0", human=[human, human])
    env.reset(seed=0)
    people = env.unwrapped.scene.human
    assert sorted(set(people.person.tolist())) == [0, 1]
    assert not np.allclose(people.start[:6], people.start[6:])


def test_writing_into_a_scene_moves_nothing() -> None:
    env, twin = (gym.make("jssa_gym/Home-v0", terminate_on=()) for _ in range(2))
    for one in (env, twin):
        one.reset(seed=3)
    for _ in range(5):
        scene = env.unwrapped.scene
        for array in (scene.robot.position, scene.robot.velocity, scene.age, scene.human.start, scene.human.end):
            array += 1.0
        scene.valid[:] = False
        *_, info = env.step(np.zeros(6))
        *_, expected = twin.step(np.zeros(6))
        assert info["distance"] == expected["distance"]
        np.testing.assert_array_equal(env.unwrapped.scene.robot.position, twin.unwrapped.scene.robot.position)
        assert env.unwrapped.scene.valid.all()


def test_a_rebuilt_shield_has_a_filter_of_its_own() -> None:
    env = gym.make("jssa_gym/Home-v0")
    shield = Shield(env, JSSAFilter(env.unwrapped.robot, env.unwrapped.dt, projector="osqp"))
    shield.reset(seed=0)
    shield.step(np.zeros(6, np.float32))
    one, two = shield.spec.make(), shield.spec.make()
    assert len({id(s.filter) for s in (shield, one, two)}) == 3
    one.reset(seed=0)
    one.step(np.zeros(6, np.float32))


def test_a_used_osqp_filter_can_be_copied() -> None:
    env = gym.make("jssa_gym/Home-v0", terminate_on=(), human=ApproachRetreat(start=0.9, nearest=(0.65, 0.65)))
    env.reset(seed=0)
    filter = JSSAFilter(env.unwrapped.robot, env.unwrapped.dt, projector="osqp")
    nominal = np.full(6, 3.0)
    while (decision := filter.decide(env.unwrapped.scene, nominal)).rows == 0:
        env.step(nominal / env.unwrapped.robot.limits.jerk)
    again = copy.deepcopy(filter).decide(env.unwrapped.scene, nominal)
    np.testing.assert_array_equal(again.jerk, decision.jerk)


SHIELD_LATER = """
import sys
from pathlib import Path
import gymnasium as gym, jssa_gym
from jssa_gym.tick.move import move

def compiled(kernel):  # as numba leaves it
    folder = Path(kernel.stats.cache_path)
    folder.mkdir(parents=True, exist_ok=True)
    stem = Path(kernel.py_func.__code__.co_filename).stem
    (folder / f"{stem}.{kernel.__name__}-{kernel.py_func.__code__.co_firstlineno}.py311.nbi").touch()

def said(what):
    print(what, file=sys.stderr)

said("bare")
env = gym.make("jssa_gym/Home-v0", human="none")
said("again")
jssa_gym.JSSAShield(gym.make("jssa_gym/Reach-v0"))
compiled(move)
said("shield")
jssa_gym.JSSAShield(env)
said("more shields")
jssa_gym.JSSAShield.as_published(env)
"""
SMALL_KERNELS = """
import sys
import numpy as np
from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.vector import along, cross, dot
for kernel in (dot, cross):
    announce_compilation(kernel)
    print("called", file=sys.stderr)
dot(np.ones(3), np.ones(3))
announce_compilation(along)
"""
SHIELDED = """
import gymnasium as gym, numpy as np, jssa_gym
from jssa_gym.cli.demo import paper_scene
for shield in (jssa_gym.JSSAShield, jssa_gym.JSSAShield.as_published):
    env = shield(gym.make("jssa_gym/Home-v0", human=paper_scene(0.8), terminate_on=()))
    env.reset(seed=0)
    while not env.step(np.zeros(6, np.float32))[-1]["shield/intervened"]:
        pass
"""
ANNOUNCED = "Compiling kernels once"


def said(source: str, cache: Path | None = None) -> list[str]:
    """What a new process writes to stderr, the path of its cache left out."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "0"}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    run = subprocess.run([sys.executable, "-c", source], env=environment, capture_output=True, text=True, check=True)
    return [ANNOUNCED if line.startswith(ANNOUNCED) else line for line in run.stderr.splitlines()]


@pytest.mark.long
def test_the_first_compilation_is_announced_by_whoever_needs_it(tmp_path) -> None:
    """Once a start, and again where more than that start compiled is needed later."""
    assert said(SHIELD_LATER, tmp_path) == ["bare", ANNOUNCED, "again", "shield", ANNOUNCED, "more shields"]
    assert said(SHIELD_LATER, tmp_path) == ["bare", "again", ANNOUNCED, "shield", "more shields"]


@pytest.mark.long
def test_a_compilation_is_announced_while_it_is_ahead(tmp_path) -> None:
    assert said(SMALL_KERNELS, tmp_path) == [ANNOUNCED, "called", "called", ANNOUNCED]
    assert said(SMALL_KERNELS, tmp_path) == ["called", ANNOUNCED, "called"]


@pytest.mark.long
def test_nothing_is_announced_once_all_is_cached() -> None:
    said(SHIELDED)
    assert said(SHIELDED) == []
