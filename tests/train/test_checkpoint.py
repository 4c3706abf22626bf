# ruff: noqa: E402
"""Checkpoints: complete and unchanged, or a typed error and the one before; nothing in them is ever run."""

import errno
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")

from trainings import CHECKPOINTED, newest, results

from jssa_gym.exceptions import CheckpointError
from jssa_gym.storage import write_archive
from jssa_gym.train import build, checkpoint, loop, state, train
from jssa_gym.train.checkpoint import KEEP, MANIFEST, latest_checkpoint, read_checkpoint, write_checkpoint
from jssa_gym.train.state import BUFFER, PARAMETERS, STATISTICS


@pytest.fixture(scope="module")
def model():
    model = build(CHECKPOINTED)
    yield model
    model.get_env().close()


def content(path) -> dict[str, bytes]:
    return {str(one.relative_to(path)): one.read_bytes() for one in sorted(path.rglob("*")) if one.is_file()}


def write_text(text):
    return lambda file: file.write(text.encode())


# ---- written and read --------------------------------------------------------------------------------


def test_what_was_written_is_read(tmp_path):
    written = write_checkpoint(tmp_path, 7, {"a": [1, None]}, {"x.txt": write_text("x"), "y.txt": write_text("y")})
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["000000000007", MANIFEST, "x.txt", "y.txt"]
    assert read_checkpoint(tmp_path / "000000000007") == written
    assert latest_checkpoint(tmp_path) == (written, [])
    assert (written.steps, written.data, written.file("y.txt").read_text()) == (7, {"a": [1, None]}, "y")
    with pytest.raises(CheckpointError, match=r"no z.txt; it has x.txt, y.txt"):
        written.file("z.txt")


def test_the_last_few_are_kept_and_bad_ones_do_not_displace_them(tmp_path):
    assert latest_checkpoint(tmp_path / "nothing") == (None, [])
    for steps in range(1, KEEP + 3):
        write_checkpoint(tmp_path, steps, {}, {"x": write_text("x")})
    names = [path.name for path in sorted(tmp_path.iterdir())]
    assert names == [f"{steps:012d}" for steps in range(3, KEEP + 3)]
    for k in range(KEEP):
        (tmp_path / f"99999999999{k}").mkdir()
    write_checkpoint(tmp_path, KEEP + 3, {}, {"x": write_text("x")})
    found, refused = latest_checkpoint(tmp_path)
    assert (found.steps, len(refused)) == (KEEP + 3, KEEP)
    assert not (tmp_path / f"{3:012d}").exists()


def test_what_a_crash_left_is_no_checkpoint_and_is_swept_up(tmp_path):
    (tmp_path / "000000000009.part").mkdir()
    (tmp_path / "000000000009.part" / "x").write_text("half")
    (tmp_path / "notes").mkdir()
    assert latest_checkpoint(tmp_path) == (None, [])
    write_checkpoint(tmp_path, 3, {}, {"x": write_text("x")})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["000000000003", "notes"]


# ---- damaged -----------------------------------------------------------------------------------------


def refused_or_the_same(one, before):
    """Whether it is refused with the typed error; what JSON reads the same may be accepted."""
    try:
        found = read_checkpoint(one)
    except CheckpointError:
        return True
    assert (found.steps, found.data, found.files) == (before.steps, before.data, before.files)
    return False


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", [MANIFEST, PARAMETERS, STATISTICS, BUFFER])
def test_truncated_anywhere(name, folder):
    one = newest(folder)
    before, whole = read_checkpoint(one), (one / name).read_bytes()
    cuts = np.unique(np.linspace(0, len(whole) - 1, 100).astype(int))
    accepted = 0
    for cut in cuts.tolist():
        (one / name).write_bytes(whole[:cut])
        accepted += not refused_or_the_same(one, before)
    assert accepted <= (name == MANIFEST)  # its last newline


@pytest.mark.long
def test_a_thousand_flipped_bits(folder):
    rng = np.random.default_rng(0)
    one = newest(folder)
    before, accepted = read_checkpoint(one), 0
    for name in (MANIFEST, PARAMETERS, STATISTICS, BUFFER):
        whole = (one / name).read_bytes()
        for bit in rng.integers(8 * len(whole), size=250).tolist():
            changed = bytearray(whole)
            changed[bit // 8] ^= 1 << bit % 8
            (one / name).write_bytes(changed)
            accepted += not refused_or_the_same(one, before)
        (one / name).write_bytes(whole)
    assert accepted <= 2
    read_checkpoint(one)


def spoil_nothing(one):
    for path in one.iterdir():
        path.unlink()


def spoil_bit(one):
    data = bytearray((one / PARAMETERS).read_bytes())
    data[len(data) // 2] ^= 4
    (one / PARAMETERS).write_bytes(data)


def spoil_pipe(one):
    (one / BUFFER).unlink()
    os.mkfifo(one / BUFFER)


SPOILT = {
    "a bit": spoil_bit,
    "all files": spoil_nothing,
    "a file": lambda one: (one / STATISTICS).unlink(),
    "the manifest": lambda one: (one / MANIFEST).unlink(),
    "a file that is a folder": lambda one: ((one / BUFFER).unlink(), (one / BUFFER).mkdir()),
    "a pipe": spoil_pipe,
    "a file in its place": lambda one: (shutil.rmtree(one), one.write_text("no folder")),
}


@pytest.mark.long
@pytest.mark.parametrize("how", SPOILT)
def test_a_training_goes_on_from_the_one_before_and_says_so(how, original, folder):
    SPOILT[how](newest(folder))
    told: list[str] = []
    if how == "a file in its place":
        with pytest.raises(CheckpointError, match="cannot write"):
            train(CHECKPOINTED, folder, say=told.append)
    else:
        train(CHECKPOINTED, folder, say=told.append)
        assert results(folder) == results(original)
    assert told[0].startswith("passed over a checkpoint: ")
    assert told[1] == "going on from 128 policy steps"


def test_all_of_them_bad_is_an_error_and_nothing_begins_anew(folder):
    for one in (folder / "checkpoints").iterdir():
        spoil_bit(one)
    before = content(folder)
    with pytest.raises(CheckpointError, match=r"none of the checkpoints .* can be used; delete it to begin anew"):
        train(CHECKPOINTED, folder)
    assert content(folder) == before


# ---- a full disk -------------------------------------------------------------------------------------


class Full(OSError):
    def __init__(self):
        super().__init__(errno.ENOSPC, os.strerror(errno.ENOSPC))


def full(*arguments, **more):
    raise Full


DISK = {
    "parameters": (torch, "save"),
    "arrays": (state, "write_archive"),
    "manifest": (checkpoint, "write_json"),
    "rename": (Path, "replace"),
    "folder": (Path, "mkdir"),
    "policy": (loop, "save_policy"),
    "history": (loop, "write_history"),
    "flush": (os, "fsync"),
    "log": (loop, "_log"),
}


@pytest.mark.long
@pytest.mark.parametrize("where", DISK)
def test_a_full_disk_is_said_and_earlier_checkpoints_stay(where, original, folder, monkeypatch):
    shutil.rmtree(newest(folder))
    earlier = content(folder / "checkpoints")
    real = loop.evaluate
    with monkeypatch.context() as patch:

        def evaluated(*arguments):
            report = real(*arguments)
            patch.setattr(*DISK[where], full)  # after everything that a leg does before it writes
            return report

        patch.setattr(loop, "evaluate", evaluated)
        with pytest.raises(CheckpointError, match="No space left on device"):
            train(CHECKPOINTED, folder)
    after = content(folder / "checkpoints")
    assert {name: data for name, data in after.items() if name in earlier} == earlier
    assert (set(after) == set(earlier)) == (where != "history")
    train(CHECKPOINTED, folder)
    assert results(folder) == results(original)


@pytest.mark.parametrize("save", ["parameters", "arrays"])
def test_a_disk_that_fills_up_in_the_middle_of_a_file(save, tmp_path, model):
    resource = pytest.importorskip("resource", reason="no limits on this system")
    writers = {"parameters": lambda file: state.save_parameters(model, file)}
    writers["arrays"] = lambda file: write_archive(file, {"x": np.zeros(10_000)})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        with pytest.raises(CheckpointError, match="cannot write"):
            write_checkpoint(tmp_path, 1, {}, {"x": writers[save]})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []
