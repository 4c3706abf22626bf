# ruff: noqa: E402
"""Checkpoints by somebody who knows how to write a manifest: refused, and nothing in them is ever run."""

import hashlib
import io
import json
import pickle
import shutil
import zipfile
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")

from trainings import CHECKPOINTED, newest, seal

from jssa_gym.exceptions import CheckpointError
from jssa_gym.train import build, checkpoint, loop, train
from jssa_gym.train.checkpoint import MANIFEST, latest_checkpoint, read_checkpoint, write_checkpoint
from jssa_gym.train.state import BUFFER, PARAMETERS, STATISTICS


@pytest.fixture(scope="module")
def model():
    model = build(CHECKPOINTED)
    yield model
    model.get_env().close()


def write_text(text):
    return lambda file: file.write(text.encode())


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
    with pytest.raises(CheckpointError, match="bytes, more than"):
        read_checkpoint(one)
    with pytest.raises(CheckpointError, match="more than"):
        write_checkpoint(tmp_path / "new", 1, {}, {"x": write_text("x" * size)})
    assert list((tmp_path / "new").iterdir()) == []
    monkeypatch.setattr(checkpoint, "LARGEST", size)
    read_checkpoint(one)
    monkeypatch.setattr(checkpoint, "LARGEST_MANIFEST", 10)
    with pytest.raises(CheckpointError, match="bytes, more than"):
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


def full_with_cursor(arrays, pos, full):
    """A buffer of which every row is there; 100 are."""
    filled = {name: np.resize(array, (100, *array.shape[1:])) for name, array in arrays.items()}
    return {**filled, "cursor": np.array([pos, full], np.int64)}


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
    "another type of the same size": change_arrays(BUFFER, lambda a: {**a, "rewards": a["rewards"].view(np.int32)}),
    "another shape of the same size": change_arrays(BUFFER, lambda a: {**a, "rewards": a["rewards"].reshape(2, -1)}),
    "a cursor beyond": change_arrays(BUFFER, lambda a: full_with_cursor(a, 100, 1)),
    "a cursor below": change_arrays(BUFFER, lambda a: full_with_cursor(a, -1, 1)),
    "a cursor from the end": change_arrays(BUFFER, lambda a: {**a, "cursor": np.array([-4, 0], np.int64)}),
    "a cursor of another kind": change_arrays(BUFFER, lambda a: full_with_cursor(a, 0, 2)),
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


def test_a_full_buffer_with_a_cursor_in_it_is_read(folder, model):
    one = newest(folder)
    change_arrays(BUFFER, lambda a: full_with_cursor(a, 99, 1))(one)
    seal(one)
    loop.restore(model, read_checkpoint(one))
    assert (model.replay_buffer.pos, model.replay_buffer.full, model.replay_buffer.size()) == (99, True, 100)


@pytest.mark.sampled(5)
@pytest.mark.filterwarnings("ignore:.*weights_only")
@pytest.mark.parametrize("how", CHANGED)
def test_forged_files_are_refused_and_never_run(how, folder, model):
    Sentinel.ran = False
    one = newest(folder)
    CHANGED[how](one)
    seal(one)
    found = read_checkpoint(one)
    with pytest.raises(CheckpointError, match=str(one)):
        loop.restore(model, found)
    assert not Sentinel.ran


def test_the_sentinel_does_run_where_pickles_are_trusted(tmp_path):
    Sentinel.ran = False
    torch.save(Sentinel(), tmp_path / "x")
    torch.load(tmp_path / "x", weights_only=False)
    assert Sentinel.ran


@pytest.mark.parametrize("data", [{}, {"history": None}, {"history": [{"steps": 192}]}, {"history": []}])
def test_a_forged_history_is_refused(data, folder, model):
    one = newest(folder)
    seal(one, data={"config": CHECKPOINTED.digest, **data})
    with pytest.raises(CheckpointError, match="history"):
        train(CHECKPOINTED, folder)
    with pytest.raises(CheckpointError, match="history"):
        loop.restore(model, read_checkpoint(one))


def test_a_history_that_ends_elsewhere_is_refused(folder, model):
    one = newest(folder)
    rows = json.loads((one / MANIFEST).read_text())["data"]["history"]
    seal(one, data={"config": CHECKPOINTED.digest, "history": rows[:-1]})
    with pytest.raises(CheckpointError, match="history"):
        loop.restore(model, read_checkpoint(one))


@pytest.mark.long
def test_another_training_s_checkpoint_is_refused(folder, tmp_path):
    other = replace(CHECKPOINTED, seed=7)
    train(other, tmp_path / "other")
    shutil.rmtree(newest(folder))
    shutil.copytree(newest(tmp_path / "other"), folder / "checkpoints" / "000000000192")
    with pytest.raises(CheckpointError, match="another training"):
        train(CHECKPOINTED, folder)
