"""Compiled kernels on disk: what is damaged there, missing, or cannot be written costs a compilation and no more."""

import errno
import logging
import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import config

from jssa_gym.kernels import jit as compiler
from jssa_gym.kernels.cache import KernelCache

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")


def twice(x):
    return 2.0 * x


@pytest.fixture
def kernel(tmp_path, monkeypatch):
    """Makes the same kernel anew, as another process would, with an empty cache of its own at first."""

    def make(writable: bool = True):
        monkeypatch.setattr(compiler, "CACHE_DIRECTORY", tmp_path)
        monkeypatch.setattr(compiler, "CACHE_IS_WRITABLE", writable)
        return compiler.jit(twice)

    return make


def came_from_disk(kernel, x=2.0) -> bool:
    """Call a kernel for the first time."""
    assert kernel(x) == 2.0 * x
    assert sum(kernel.stats.cache_hits.values()) + sum(kernel.stats.cache_misses.values()) == 1
    return sum(kernel.stats.cache_hits.values()) == 1


def files(folder: Path, ending: str) -> list[Path]:
    return sorted(folder.rglob(f"*.{ending}"))


def flip_a_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def become_a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


DAMAGE = {
    "empty": lambda path: path.write_bytes(b""),
    "cut": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "its end is missing": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "garbage": lambda path: path.write_bytes(np.random.default_rng(0).bytes(1000)),
    "a bit": flip_a_bit,
    "missing": lambda path: path.unlink(),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_file_is_compiled_anew_and_written_over(kernel, tmp_path, damage, ending, caplog) -> None:
    assert not came_from_disk(kernel())
    assert came_from_disk(kernel())
    (file,) = files(tmp_path, ending)
    damage(file)
    with caplog.at_level(logging.WARNING, "jssa_gym"):
        assert not came_from_disk(kernel())
    assert [record.message.split(" are ")[-1] for record in caplog.records] == (
        [] if damage is DAMAGE["missing"] else ["damaged; compiling them anew."]
    )
    assert came_from_disk(kernel())
    assert len(files(tmp_path, ending)) == 1


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_a_file_that_may_not_be_read_is_compiled_anew(kernel, tmp_path, ending, monkeypatch, caplog) -> None:
    came_from_disk(kernel())
    (file,) = files(tmp_path, ending)
    become_a_folder(file)  # root may read whatever it likes, but no folder
    with caplog.at_level(logging.WARNING, "jssa_gym"):
        for _ in range(2):
            assert not came_from_disk(kernel())
    unread, unwritten = (record.message for record in caplog.records)  # once each
    assert "cannot be read" in unread
    assert "cannot be kept" in unwritten


def test_whole_files_that_hold_something_else_are_compiled_anew(kernel, tmp_path, caplog) -> None:
    def fill(cache: KernelCache, data) -> None:
        (key,) = cache._cache_file._load_index()
        cache._cache_file.save(key, data)

    first = kernel()
    came_from_disk(first)
    fill(first._cache, ("no", "machine code"))
    with caplog.at_level(logging.WARNING, "jssa_gym"):
        assert not came_from_disk(kernel())
    assert "do not load" in caplog.text
    assert came_from_disk(kernel())


def test_code_of_another_signature_is_not_run(kernel, tmp_path) -> None:
    """Two processes that compile two signatures at once may give their files one name."""
    both = kernel()
    both(2.0)
    both(2)
    one, other = files(tmp_path, "nbc")
    other.write_bytes(one.read_bytes())
    assert came_from_disk(kernel(), 2.0)
    assert not came_from_disk(kernel(), 2)


@pytest.mark.parametrize("call", ["os.replace", "os.makedirs", "tempfile.TemporaryFile"])
def test_a_full_disk_is_said_once_and_never_raised(kernel, tmp_path, call, monkeypatch, caplog) -> None:
    def full(*args, **kwargs):
        raise OSError(errno.ENOSPC, "No space left on device")

    first, second = kernel(), kernel()
    with monkeypatch.context() as patch, caplog.at_level(logging.WARNING, "jssa_gym"):
        patch.setattr(f"numba.core.caching.{call}", full)
        assert not came_from_disk(first)
        assert not came_from_disk(second)
    (record,) = caplog.records
    assert "No space left on device" in record.message
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
    assert not came_from_disk(kernel())
    assert came_from_disk(kernel())


def test_where_nothing_may_be_written_what_is_there_is_used(kernel, tmp_path) -> None:
    came_from_disk(kernel())
    before = files(tmp_path, "nb?")
    reader = kernel(writable=False)
    assert came_from_disk(reader)
    reader(2)  # of this signature there is nothing
    assert files(tmp_path, "nb?") == before


# ---- in a process of its own -------------------------------------------------------------------------

TINY = """
from jssa_gym.kernels.vector import dot
import numpy as np
from jssa_gym.kernels import jit
assert dot(np.ones(3), np.ones(3)) == 3.0
print("cached" if sum(dot.stats.cache_hits.values()) else "compiled", jit.CACHE_DIRECTORY)
"""
NO_HOME = """
import os, pwd
def nobody(uid):
    raise KeyError(f"getpwuid(): uid not found: {uid}")
pwd.getpwuid = nobody
"""
SAID = """
from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.vector import dot
announce_compilation(dot)
announce_compilation(dot)
"""


def run(source: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """In a new process, without what says where caches are, but for what is given."""
    away = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME")
    kept = {name: value for name, value in os.environ.items() if name not in away}
    command = [sys.executable, "-c", source]
    return subprocess.run(command, env={**kept, **environment}, capture_output=True, text=True, check=True)


@pytest.mark.long
def test_a_cut_index_of_the_package_is_compiled_anew(tmp_path) -> None:
    cache = {"NUMBA_CACHE_DIR": str(tmp_path)}
    assert run(TINY, **cache).stdout.startswith("compiled")
    (index,) = tmp_path.rglob("vector.dot-*.nbi")
    index.write_bytes(b"")
    again = run(TINY, **cache)
    assert again.stdout.startswith("compiled")
    assert "are damaged; compiling them anew." in again.stderr
    assert run(TINY, **cache).stdout.startswith("cached")


@pytest.mark.long
def test_a_folder_of_somebody_elses_is_read(tmp_path) -> None:
    """All checks for whether it can be written to say no, as they do where it belongs to another user."""
    cache = {"NUMBA_CACHE_DIR": str(tmp_path)}
    run(TINY, **cache)
    unwritable = """
import os, tempfile
os.access = lambda *args: False
def no(*args, **kwargs):
    raise PermissionError(13, "Permission denied")
tempfile.TemporaryFile = no
"""
    answer = run(unwritable + TINY, **cache)
    assert answer.stdout.startswith("cached")
    assert answer.stderr == ""


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "getuid"), reason="homes of Windows are found otherwise")
@pytest.mark.parametrize(
    ("before", "environment"), [(NO_HOME, {}), ("", {"HOME": "/dev/null/nowhere"})], ids=["no home", "no such home"]
)
def test_without_a_home_kernels_are_kept_where_nobody_else_writes(tmp_path, before, environment) -> None:
    environment = {"TMPDIR": str(tmp_path), **environment}
    folder = tmp_path / f"jssa_gym-{os.getuid()}"
    first = run(before + SAID + TINY, **environment)
    assert first.stdout.startswith(f"compiled {folder}")
    assert first.stderr.count("there is no home directory") == 1
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    again = run(before + SAID + TINY, **environment)
    assert again.stdout == first.stdout.replace("compiled", "cached")
    assert again.stderr == ""


def planted_by_another_user(folder: Path) -> None:
    folder.mkdir(mode=0o700)


def open_to_all(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o777)


def a_link(folder: Path) -> None:
    (folder.parent / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(folder.parent / "elsewhere")


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "getuid"), reason="homes of Windows are found otherwise")
@pytest.mark.parametrize("plant", [planted_by_another_user, open_to_all, a_link])
def test_code_that_another_user_may_have_planted_is_never_run(tmp_path, plant) -> None:
    uid = os.getuid() + (plant is planted_by_another_user)
    plant(tmp_path / f"jssa_gym-{uid}")
    answer = run(f"{NO_HOME}\nos.getuid = lambda: {uid}\n" + TINY, TMPDIR=str(tmp_path))
    assert answer.stdout.split() == ["compiled", "None"]
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.long
def test_the_command_runs_without_a_home(tmp_path) -> None:
    source = f"{NO_HOME}\nimport sys\nfrom jssa_gym.cli import main\nsys.argv = ['jssa-gym', '--version']\nmain()"
    try:
        answer = run(source, TMPDIR=str(tmp_path))
    except subprocess.CalledProcessError as error:
        pytest.fail(error.stderr)
    assert answer.stdout.split()[-1][0].isdigit()
