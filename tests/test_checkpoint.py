# ruff: noqa: E402
"""Checkpoints: complete and unchanged, or a typed error and the one before; nothing in them is ever run."""

import errno
import hashlib
import io
import json
import os
import pickle
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")

from trainings import newest, results, tiny

from jssa_gym.exceptions import CheckpointError
from jssa_gym.train import build, checkpoint, loop, train
from jssa_gym.train.checkpoint import KEEP, MANIFEST, latest_checkpoint, read_checkpoint, write_checkpoint
from jssa_gym.train.state import BUFFER, PARAMETERS, STATISTICS


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


CONFIG = tiny("sac")


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A training of three legs; not to be changed."""
    folder = tmp_path_factory.mktemp("original")
    train(CONFIG, folder)
    return folder


@pytest.fixture
def folder(original, tmp_path):
    """A copy of it."""
    return Path(shutil.copytree(original, tmp_path / "copy"))


@pytest.fixture(scope="module")
def model():
    model = build(CONFIG)
    yield model
    model.get_env().close()


def content(path) -> dict[str, bytes]:
    return {str(one.relative_to(path)): one.read_bytes() for one in sorted(path.rglob("*")) if one.is_file()}


def seal(one, **changes):
    """Write a manifest that fits the files, as somebody does who knows how."""
    body = json.loads((one / MANIFEST).read_text())
    del body["sha256"]
    body["files"] = {name: hashlib.sha256((one / name).read_bytes()).hexdigest() for name in body["files"]}
    body |= changes
    (one / MANIFEST).write_text(json.dumps({**body, "sha256": checkpoint._digest(body)}))


def write_text(text):
    return lambda path: path.write_text(text)


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


@pytest.mark.parametrize("how", SPOILT)
def test_a_training_goes_on_from_the_one_before_and_says_so(how, original, folder):
    SPOILT[how](newest(folder))
    told: list[str] = []
    if how == "a file in its place":
        with pytest.raises(CheckpointError, match="cannot write"):
            train(CONFIG, folder, say=told.append)
    else:
        train(CONFIG, folder, say=told.append)
        assert results(folder) == results(original)
    assert told[0].startswith("passed over a checkpoint: ")
    assert told[1] == "going on from 128 policy steps"


def test_all_of_them_bad_is_an_error_and_nothing_begins_anew(folder):
    for one in (folder / "checkpoints").iterdir():
        spoil_bit(one)
    before = content(folder)
    with pytest.raises(CheckpointError, match=r"none of the checkpoints .* can be used; delete it to begin anew"):
        train(CONFIG, folder)
    assert content(folder) == before


# ---- forged, with a manifest that fits ---------------------------------------------------------------


def manifest_text(one, text):
    (one / MANIFEST).write_text(text)


FORGED = {
    "deep JSON": lambda one: manifest_text(one, "[" * 200_000 + "]" * 200_000),
    "deep data": lambda one: manifest_text(one, '{"sha256": "", "version": 1, "data": ' + '{"a":' * 100_000 + "1"),
    "a list": lambda one: manifest_text(one, "[]"),
    "no text": lambda one: (one / MANIFEST).write_bytes(b"\xff\xfe\x00"),
    "another version": lambda one: seal(one, version=2),
    "steps without end": lambda one: seal(one, steps=float("inf")),
    "steps that are none": lambda one: seal(one, steps="192"),
    "other steps": lambda one: seal(one, steps=10**6),
    "data that are none": lambda one: seal(one, data=[]),
    "files that are none": lambda one: seal(one, files=[]),
    "a file above": lambda one: seal(one, files={"../../history.csv": ""}),
    "a file elsewhere": lambda one: seal(one, files={"/etc/hostname": ""}),
    "its folder": lambda one: seal(one, files={".": ""}),
    "its parent": lambda one: seal(one, files={"..": ""}),
    "no name": lambda one: seal(one, files={"": ""}),
    "a name with a zero": lambda one: seal(one, files={"a\0b": ""}),
    "a device": lambda one: (
        (one / BUFFER).unlink(),
        (one / BUFFER).symlink_to("/dev/zero"),
    ),
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("how", FORGED)
def test_a_forged_manifest_is_refused(how, folder):
    one = newest(folder)
    FORGED[how](one)
    with pytest.raises(CheckpointError):
        read_checkpoint(one)
    found, (error,) = latest_checkpoint(folder / "checkpoints")
    assert found.steps == 128
    assert isinstance(error, CheckpointError)


def test_files_elsewhere_are_refused_as_such_even_if_their_sums_fit(folder):
    one = newest(folder)
    outside = hashlib.sha256((folder / "history.csv").read_bytes()).hexdigest()
    seal(one, files={"../../history.csv": outside})
    with pytest.raises(CheckpointError, match="names a file outside its folder"):
        read_checkpoint(one)


def test_larger_than_a_file_may_be(folder, monkeypatch, tmp_path):
    one = newest(folder)
    size = max(path.stat().st_size for path in one.iterdir())
    monkeypatch.setattr(checkpoint, "LARGEST", size - 1)
    with pytest.raises(CheckpointError, match="is larger than"):
        read_checkpoint(one)
    with pytest.raises(CheckpointError, match="more than"):
        write_checkpoint(tmp_path / "new", 1, {}, {"x": write_text("x" * size)})
    assert list((tmp_path / "new").iterdir()) == []
    monkeypatch.setattr(checkpoint, "LARGEST", size)
    read_checkpoint(one)
    monkeypatch.setattr(checkpoint, "LARGEST_MANIFEST", 10)
    with pytest.raises(CheckpointError, match="is larger than"):
        read_checkpoint(one)


class Sentinel:
    ran = False

    def __reduce__(self):
        return _run, ()


def _run():
    Sentinel.ran = True
    return {}


def arrays_of(one, name):
    with np.load(one / name) as arrays:
        return dict(arrays)


def change_arrays(name, change):
    def forge(one):
        arrays = arrays_of(one, name)
        arrays = change(arrays) or arrays
        np.savez(one / name, **arrays)

    return forge


def change_state(change):
    def forge(one):
        state = torch.load(one / PARAMETERS, weights_only=True)
        change(state)
        torch.save(state, one / PARAMETERS)

    return forge


def compress(name):
    def forge(one):
        with zipfile.ZipFile(one / name) as archive:
            members = {entry: archive.read(entry) for entry in archive.namelist()}
        with zipfile.ZipFile(one / name, "w", zipfile.ZIP_DEFLATED) as archive:
            for entry, data in members.items():
                archive.writestr(entry, data)

    return forge


def bomb(one):
    """Small on the disk, 2 GB in memory."""
    with zipfile.ZipFile(one / BUFFER, "w", zipfile.ZIP_DEFLATED) as archive:
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": (250_000_000,)})
        with archive.open("rewards.npy", "w", force_zip64=True) as member:
            member.write(header.getvalue())
            for _ in range(20):
                member.write(bytes(2**20))


def claims(shape):
    """An array whose header claims more than there is."""

    def forge(one):
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": shape})
        with zipfile.ZipFile(one / BUFFER) as archive:
            members = {entry: archive.read(entry) for entry in archive.namelist()}
        members["rewards.npy"] = header.getvalue() + bytes(64)
        with zipfile.ZipFile(one / BUFFER, "w") as archive:
            for entry, data in members.items():
                archive.writestr(entry, data)

    return forge


def first(mapping):
    return next(iter(mapping))


def transposed(state):
    weights = state["parameters"]["policy"]
    weights["actor.latent_pi.0.weight"] = weights["actor.latent_pi.0.weight"].T


CHANGED = {
    "a pickle": lambda one: (one / PARAMETERS).write_bytes(pickle.dumps(Sentinel())),
    "a pickle by torch": lambda one: torch.save({"parameters": Sentinel()}, one / PARAMETERS),
    "an old pickle by torch": lambda one: torch.save(
        {"parameters": Sentinel()}, one / PARAMETERS, _use_new_zipfile_serialization=False
    ),
    "objects": change_arrays(BUFFER, lambda a: {**a, "rewards": np.array([Sentinel()], object)}),
    "statistics of objects": change_arrays(STATISTICS, lambda a: {**a, "obs_mean": np.array([Sentinel()], object)}),
    "compressed arrays": compress(BUFFER),
    "compressed parameters": compress(PARAMETERS),
    "a bomb": bomb,
    "a claim": claims((100, 2)),
    "a large claim": claims((10**12,)),
    "a negative claim": claims((-1,)),
    "an array too many": change_arrays(BUFFER, lambda a: {**a, "more": np.zeros(1)}),
    "an array missing": change_arrays(BUFFER, lambda a: {k: v for k, v in a.items() if k != "dones"}),
    "an array that fits by broadcasting": change_arrays(BUFFER, lambda a: {**a, "rewards": a["rewards"][:1]}),
    "a scalar": change_arrays(BUFFER, lambda a: {**a, "actions": np.float32(1.0)}),
    "another type": change_arrays(BUFFER, lambda a: {**a, "rewards": a["rewards"].astype(np.float64)}),
    "another order": change_arrays(BUFFER, lambda a: {**a, "observations": np.asfortranarray(a["observations"])}),
    "a cursor beyond": change_arrays(BUFFER, lambda a: {**a, "cursor": np.array([100, 1], np.int64)}),
    "a cursor below": change_arrays(BUFFER, lambda a: {**a, "cursor": np.array([-1, 1], np.int64)}),
    "a cursor of another kind": change_arrays(BUFFER, lambda a: {**a, "cursor": np.array([0, 2], np.int64)}),
    "no archive": lambda one: (one / BUFFER).write_bytes(b"nothing of the kind"),
    "an empty file": lambda one: (one / STATISTICS).write_bytes(b""),
    "statistics of another shape": change_arrays(STATISTICS, lambda a: {**a, "obs_var": np.ones(1)}),
    "statistics that are not finite": change_arrays(STATISTICS, lambda a: {**a, "obs_var": a["obs_var"] * np.nan}),
    "a variance below 0": change_arrays(STATISTICS, lambda a: {**a, "obs_var": -a["obs_var"]}),
    "no statistics": change_arrays(STATISTICS, lambda a: a.clear()),
    "no parameters": change_state(lambda s: s.clear()),
    "weights missing": change_state(lambda s: s["parameters"]["policy"].popitem()),
    "weights of another shape": change_state(transposed),
    "weights of another type": change_state(
        lambda s: s["parameters"]["policy"].update({k: v.double() for k, v in s["parameters"]["policy"].items()})
    ),
    "no optimiser": change_state(lambda s: s["parameters"].pop("actor.optimizer")),
    "another optimiser": change_state(
        lambda s: s["parameters"]["actor.optimizer"]["param_groups"][0].update(betas=(0.0, 0.0))
    ),
    "moments of another shape": change_state(
        lambda s: s["parameters"]["critic.optimizer"]["state"][0].update(exp_avg=torch.zeros(3))
    ),
    "a tensor of another name": change_state(lambda s: s["tensors"].update(policy=torch.zeros(1))),
    "a tensor of another shape": change_state(lambda s: s["tensors"].update(log_ent_coef=torch.zeros(()))),
    "counters that are none": change_state(lambda s: s["counters"].update(updates="many")),
}


@pytest.mark.filterwarnings("ignore:.*weights_only")
@pytest.mark.parametrize("how", CHANGED)
def test_forged_files_are_refused_and_never_run(how, folder, model):
    Sentinel.ran = False
    one = newest(folder)
    CHANGED[how](one)
    seal(one)
    found = read_checkpoint(one)
    with pytest.raises(CheckpointError, match=str(one)):
        loop._restore(model, found)
    assert not Sentinel.ran


def test_the_sentinel_does_run_where_pickles_are_trusted(tmp_path):
    Sentinel.ran = False
    torch.save(Sentinel(), tmp_path / "x")
    torch.load(tmp_path / "x", weights_only=False)
    assert Sentinel.ran


@pytest.mark.parametrize("data", [{}, {"history": None}, {"history": [{"steps": 192}]}, {"history": []}])
def test_a_forged_history_is_refused(data, folder, model):
    one = newest(folder)
    seal(one, data={"config": CONFIG.digest, **data})
    with pytest.raises(CheckpointError, match="history"):
        train(CONFIG, folder)
    with pytest.raises(CheckpointError, match="history"):
        loop._restore(model, read_checkpoint(one))


def test_a_history_that_ends_elsewhere_is_refused(folder, model):
    one = newest(folder)
    rows = json.loads((one / MANIFEST).read_text())["data"]["history"]
    seal(one, data={"config": CONFIG.digest, "history": rows[:-1]})
    with pytest.raises(CheckpointError, match="history"):
        loop._restore(model, read_checkpoint(one))


def test_another_training_s_checkpoint_is_refused(folder, tmp_path):
    other = replace(CONFIG, seed=7)
    train(other, tmp_path / "other")
    shutil.rmtree(newest(folder))
    shutil.copytree(newest(tmp_path / "other"), folder / "checkpoints" / "000000000192")
    with pytest.raises(CheckpointError, match="another training"):
        train(CONFIG, folder)


# ---- a full disk -------------------------------------------------------------------------------------


class Full(OSError):
    def __init__(self):
        super().__init__(errno.ENOSPC, os.strerror(errno.ENOSPC))


def full(*arguments, **more):
    raise Full


DISK = {
    "parameters": (Path, "write_bytes"),
    "arrays": (np, "savez"),
    "manifest": (Path, "write_text"),
    "rename": (Path, "replace"),
    "folder": (Path, "mkdir"),
    "policy": (loop, "save_policy"),
    "history": (loop, "write_history"),
    "flush": (checkpoint, "_to_disk"),
}


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
            train(CONFIG, folder)
    after = content(folder / "checkpoints")
    assert {name: data for name, data in after.items() if name in earlier} == earlier
    assert (set(after) == set(earlier)) == (where != "history")
    train(CONFIG, folder)
    assert results(folder) == results(original)


@pytest.mark.parametrize("save", ["parameters", "arrays"])
def test_a_disk_that_fills_up_in_the_middle_of_a_file(save, tmp_path, model):
    resource = pytest.importorskip("resource", reason="no limits on this system")
    from jssa_gym.train import state

    writers = {"parameters": lambda path: state.save_parameters(model, path)}
    writers["arrays"] = lambda path: state.write_arrays(path, {"x": np.zeros(10_000)})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        with pytest.raises(CheckpointError, match="cannot write"):
            write_checkpoint(tmp_path, 1, {}, {"x": writers[save]})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []
