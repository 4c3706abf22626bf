"""A second process compiles parts of a kernel into the same cache; whatever becomes of it, nothing but time is lost."""

import gc
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numba import config, njit, typeof
from numba.core import event
from numba.core.errors import TypingError
from places import PATIENCE

from jssa_gym.envs import ArmEnv
from jssa_gym.kernels import compiled, second_compiler
from jssa_gym.kernels import jit as compiler
from jssa_gym.kernels.garbage import SELDOM
from jssa_gym.kernels.walkers import walking_parts
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import FILTERS
from jssa_gym.tick import loop
from jssa_gym.tick.parts import parts_of

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")

START = """
import os, signal, sys, time
import numpy as np
from numba import typeof, float64
from numba.core import event
from jssa_gym.kernels import second_compiler
from jssa_gym.kernels.compiled import compile_together
from jssa_gym.kernels.capsules import capsule_pair, closest_points
class Compiled(event.Listener):
    names = []
    def on_start(self, event):
        Compiled.names.append(event.data["dispatcher"].__name__)
    def on_end(self, event):
        pass
event.register("numba:compile", Compiled())
os.sched_getaffinity = lambda pid: {0, 1}
points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 1]])
ends = tuple(map(typeof, points))
compile_together(capsule_pair, (*ends, float64), lambda: PARTS)
"""
BEGUN = """
deadline = time.monotonic() + 60.0
while not second_compiler.running[0]._has_said("begun", 0) and time.monotonic() < deadline:
    second_compiler.running[0]._read(0.1)
"""
MUCH = """
for _ in range(4):
    if second_compiler.running[0].runs:
        second_compiler.running[0].ask([(os.urandom(8).hex(), ())], [(os.urandom(40_000).hex(), ())])
assert not second_compiler.running[0].runs, "it is waited for"
"""
USE = """
assert abs(capsule_pair(*points, 0.5)[0] - 0.5) < 1e-12
print(*Compiled.names)
assert not [other for other in second_compiler.running if other.runs], "it outlives what it was started for"
"""
TWO = {"JSSA_GYM_SECOND_COMPILER": "1"}
BOTH = START.replace("PARTS", "[(closest_points, ends)]")


def run(source: str, cache: Path, **environment: str) -> list[str]:
    """What a new process with a cache of its own prints; no warning is let pass."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", source],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache), **environment},
        capture_output=True, text=True, check=False, timeout=PATIENCE,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


def files(cache: Path) -> set[str]:
    return {path.relative_to(cache).as_posix() for path in cache.rglob("*.nb?")}


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> tuple[list[str], set[str]]:
    """What one process compiles, and its files."""
    cache = tmp_path_factory.mktemp("alone")
    names = run(BOTH + USE, cache, JSSA_GYM_SECOND_COMPILER="0")
    return names, files(cache)


@pytest.mark.long
def test_a_part_is_compiled_elsewhere_and_loaded_here(tmp_path, alone) -> None:
    names, written = alone
    compiled_here = run(BOTH + BEGUN + USE, tmp_path, **TWO)
    assert "closest_points" in names
    assert "closest_points" not in compiled_here
    assert "capsule_pair" in compiled_here
    assert files(tmp_path) == written


@pytest.mark.long
@pytest.mark.parametrize(
    "what",
    [
        START.replace("PARTS", "[(closest_points, (float64,))]"),  # it fails: no such arguments
        BOTH + "second_compiler.running[0]._process.kill()",
        BOTH + BEGUN + "second_compiler.running[0]._process.kill()",
        # it hangs: the other waits in vain
        BOTH
        + BEGUN
        + "os.kill(second_compiler.running[0]._process.pid, signal.SIGSTOP); second_compiler.LONGEST = 0.5",
        BOTH + "os.kill(second_compiler.running[0]._process.pid, signal.SIGSTOP)\n" + MUCH,
        BOTH + "def unable(*a):\n    raise OSError(10038)\nsecond_compiler.selectors.DefaultSelector.register = unable",
    ],
    ids=["fails", "killed at once", "killed while it compiles", "hangs", "reads nothing", "cannot be heard"],
)
def test_whatever_becomes_of_it_everything_is_compiled(tmp_path, what, alone) -> None:
    assert run(f"{what}\n{USE}", tmp_path, **TWO)[0] == "capsule_pair"
    assert files(tmp_path) >= alone[1]


@pytest.mark.long
def test_it_ends_with_the_process_that_started_it(tmp_path) -> None:
    (number,) = run(BOTH + "print(second_compiler.running[0]._process.pid, flush=True)\nos._exit(0)", tmp_path, **TWO)
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        state = Path(f"/proc/{number}/stat")
        if not state.exists() or state.read_text().split()[2] == "Z":  # whose child it has become reaps it
            return
        time.sleep(0.1)
    pytest.fail("it goes on")


def twice(x):
    return 2.0 * x


def test_while_kernels_are_compiled_garbage_is_looked_for_less_often() -> None:
    seen = []

    class Look(event.Listener):
        def on_start(self, event) -> None:
            seen.append(gc.get_threshold())

        def on_end(self, event) -> None:
            pass

    before = gc.get_threshold()
    with event.install_listener("numba:compile", Look()):
        assert njit(twice)(1.0) == 2.0
        assert gc.get_threshold() == before
        with pytest.raises(TypingError):
            njit(twice)("word")
    assert gc.get_threshold() == before
    assert [threshold[0] for threshold in seen] == [SELDOM] * 2


# ---- when there is one -------------------------------------------------------------------------------


@pytest.fixture
def started(tmp_path, monkeypatch):
    """Makes a kernel with an empty cache, and has it compiled together; whether a process was started for it."""
    begun = []

    class Recorded:
        runs = True

        def __init__(self, cache: Path) -> None:
            begun.append(cache)

        def ask(self, wholes, parts) -> None:
            begun.append((*wholes, parts))

        def has_compiled(self, part) -> bool:
            return False

        def tell_of(self, part) -> None:
            pass

    for module in (compiler, compiled):
        monkeypatch.setattr(module, "CACHE_DIRECTORY", tmp_path / "version")
        monkeypatch.setattr(module, "CACHE_IS_WRITABLE", True)
    monkeypatch.setattr(second_compiler, "SecondCompiler", Recorded)
    monkeypatch.setattr(second_compiler, "running", [])
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1}, raising=False)
    monkeypatch.delenv("JSSA_GYM_SECOND_COMPILER", raising=False)

    def ask(kernel=None) -> list:
        kernel = compiler.jit(twice) if kernel is None else kernel
        begun.clear()
        compiled.compile_together(kernel, (typeof(1.0),), list)
        return begun

    return ask


def test_one_is_started_for_what_is_not_cached(started, tmp_path) -> None:
    whole = f"{__name__}:twice", (typeof(1.0),)
    assert started() == [tmp_path, (whole, [])]
    assert started() == [(whole, [])]  # another kernel: the same process
    kernel = compiler.jit(twice)
    assert kernel(1.0) == 2.0
    assert started(kernel) == []  # compiled
    assert started() == []  # cached


@pytest.mark.parametrize(
    "forbid",
    [
        lambda patch: patch.setenv("JSSA_GYM_SECOND_COMPILER", "0"),
        lambda patch: patch.setattr(os, "sched_getaffinity", lambda pid: {0}, raising=False),
        lambda patch: patch.setattr(compiled, "CACHE_IS_WRITABLE", False),
        lambda patch: patch.setattr(config, "DISABLE_JIT", 1),
        lambda patch: patch.setattr("multiprocessing.parent_process", lambda: "another"),
        lambda patch: patch.setattr(sys, "executable", "/usr/bin/blender"),
        lambda patch: patch.setattr(sys, "executable", None),
        lambda patch: patch.setattr(sys, "platform", "win32"),
        lambda patch: patch.setattr(sys, "flags", SimpleNamespace(ignore_environment=1)),
    ],
    ids=[
        "switched off",
        "one core",
        "unwritable",
        "no compiler",
        "a worker",
        "embedded",
        "no executable",
        "Windows",
        "no environment",
    ],
)
def test_none_is_started(started, monkeypatch, forbid) -> None:
    kernel = compiler.jit(twice)
    forbid(monkeypatch)
    assert started(kernel) == []


def test_that_none_can_be_started_is_said_to_whoever_debugs(started, monkeypatch, caplog) -> None:
    def no_more(cache: Path) -> None:
        raise BlockingIOError("no more processes")

    monkeypatch.setattr(second_compiler, "SecondCompiler", no_more)
    with caplog.at_level("DEBUG", "jssa_gym"):
        assert started() == []
    (record,) = caplog.records
    assert record.levelname == "DEBUG"


# ---- which parts -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["jssa", "cbf", "none"])
def test_parts_have_the_types_that_a_control_step_asks_for(name) -> None:
    """They are in the cache, or in this process, once the step has been compiled, whoever compiled it."""
    env = ArmEnv("home")
    filter = FILTERS[name](env.robot, 0.008, viability=True, failsafe=FailsafeParams())
    filter.reset(env.scene)
    filter.decide(env.scene, np.zeros(env.robot.n))
    parts = parts_of(typeof(filter.records.view.arms))
    assert len(parts) >= (1 if name == "none" else 2)
    for part, types in parts:
        assert types in part.overloads or part._cache.holds(types, part.targetctx)
    # nor is there one beside it, of other types, that nobody has asked for
    (arms,) = {types for part, types in parts if part.__name__ == "take_alternative"}
    steps = loop.decide_all._cache._cache_file._load_index()
    alternatives = parts[0][0]._cache._cache_file._load_index()
    assert len({key[0][0] for key in alternatives}) == len({key[0][0] for key in steps}), arms


def test_people_who_walk_have_the_types_that_are_compiled_for_them() -> None:
    env = ArmEnv("home", human="walk_by")
    env.reset(seed=0)
    env.step(np.zeros(env.robot.n))
    for kernel, of in walking_parts():
        assert list(kernel.overloads) == [of]
