"""A saved episode is complete and unchanged, or an error of one type; nothing in a file is ever run."""

import dataclasses
import hashlib
import io
import json
import os
import pickle
import zipfile
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation import load_trace, read_meta, rollout, save_trace
from jssa_gym.evaluation import trace as module
from jssa_gym.exceptions import JSSAGymError, TraceError
from jssa_gym.types import Trace


@pytest.fixture(scope="module")
def trace() -> Trace:
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human=["random", "approach_retreat"], terminate_on=()))
    return rollout(env, lambda _: np.ones(6), seed=0, steps=40, name="shielded")


@pytest.fixture
def path(trace, tmp_path) -> Path:
    save_trace(trace, tmp_path / "episode.npz", {"seed": 0})
    return tmp_path / "episode.npz"


def same(one: Trace, other: Trace) -> None:
    for field in dataclasses.fields(Trace):
        ours, theirs = getattr(one, field.name), getattr(other, field.name)
        assert type(ours) is type(theirs), field.name
        if isinstance(ours, np.ndarray):
            assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape), field.name
            assert ours.tobytes() == theirs.tobytes(), field.name
        else:
            assert ours == theirs, field.name


def sealed(content: bytes) -> bytes:
    """An archive with the digest that belongs to it: what a forger would write."""
    buffer = io.BytesIO(content)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.comment = b"0" * 64
    body = buffer.getvalue()[:-64]
    return body + hashlib.sha256(body).hexdigest().encode()


def repacked(path: Path, change) -> bytes:
    """The file's arrays, changed, sealed again."""
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(arrays["header"].tobytes())
    change(header, arrays)
    if "header" in arrays:
        arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return sealed(buffer.getvalue())


@pytest.mark.parametrize("task", TASKS)
def test_an_episode_of_every_task_can_be_saved(task, tmp_path):
    env = jssa_gym.ArmEnv(task, terminate_on=())
    recorded = rollout(env, lambda _: np.zeros(6), seed=0, steps=5)
    save_trace(recorded, tmp_path / "episode.npz")
    same(recorded, load_trace(tmp_path / "episode.npz"))
    np.testing.assert_array_equal(recorded.goal[-1], env.goal.ravel())


VERSION_3 = {
    "f8": "mount initial_state initial_human human_radius plane_normal plane_offset time position velocity "
    "acceleration jerk nominal goal reward distance speed acceleration_of_distance contact_speed correction phi slack "
    "margin override shield_time human_start human_end",
    "b1": "success limit_violation contact intervened",
    "i8": "human_person pair status choice",
    "U": "reason kind",
    "header": "format version meta name dt robot dynamics task holds d_min ended human_names plane_names",
}
"""What is in a file, whatever becomes of :class:`Trace`: another content is another version."""


def test_a_file_has_what_its_version_says(path):
    found: dict[str, set[str]] = {}
    with np.load(path, allow_pickle=False) as archive:
        header = json.loads(archive["header"].tobytes())
        for name in set(archive.files) - {"header"}:
            dtype = archive[name].dtype
            found.setdefault("U" if dtype.kind == "U" else dtype.str[1:], set()).add(name)
    assert (header["format"], header["version"]) == ("jssa_gym trace", 3)
    assert found | {"header": set(header)} == {kind: set(names.split()) for kind, names in VERSION_3.items()}


def test_a_trace_comes_back_bit_for_bit(trace, path):
    assert len(trace.human_names) == 12
    assert set(trace.human_person) == {0, 1}
    assert trace.status.any()
    assert len(set(trace.reason)) > 1
    same(trace, load_trace(path))
    assert read_meta(path) == {"seed": 0}


def earlier(header, arrays):
    """What an episode was before shields told of margin, kind, choice and override."""
    header.update(version=2)
    for name in ("margin", "kind", "choice", "override"):
        arrays.pop(name)


def test_a_file_of_the_version_before_says_nothing_of_what_came_later(trace, path):
    path.write_bytes(repacked(path, earlier))
    old = load_trace(path)
    assert np.isnan([old.margin, old.override]).all()
    assert (set(old.kind), set(old.choice)) == ({""}, {-1})
    later = {name: getattr(old, name) for name in ("margin", "kind", "choice", "override")}
    same(dataclasses.replace(trace, **later), old)
    assert read_meta(path) == {"seed": 0}
    save_trace(old, path)
    same(old, load_trace(path))


class Telling(gym.Wrapper):
    """A shield that says of every step what is recorded of it."""

    def step(self, action):
        *rest, info = self.env.step(action)
        k = round(125.0 * self.unwrapped.scene.time)
        kind = "alternative" if k % 3 else "graded"
        info |= {"shield/margin": np.inf if k % 4 else 0.25 * k, "shield/kind": kind, "shield/choice": k % 3 - 1}
        info |= {"shield/override": 1.0 / k}
        return *rest, info


def test_what_a_shield_says_of_a_step_is_recorded(tmp_path):
    recorded = rollout(Telling(gym.make("jssa_gym/Home-v0", terminate_on=())), lambda _: np.zeros(6), seed=0, steps=6)
    assert recorded.margin.tolist() == [np.inf, np.inf, np.inf, 1.0, np.inf, np.inf]
    assert recorded.kind.tolist() == ["alternative", "alternative", "graded"] * 2
    assert recorded.choice.tolist() == [0, 1, -1] * 2
    assert recorded.override.tolist() == [1.0 / k for k in range(1, 7)]
    save_trace(recorded, tmp_path / "told.npz")
    same(recorded, load_trace(tmp_path / "told.npz"))


def test_so_does_one_with_nobody_without_a_shield(tmp_path):
    env = gym.make("jssa_gym/Reach-v0", human="none", terminate_on=())
    trace = rollout(env, jssa_gym.RandomPolicy(env, 0), seed=0, steps=3)
    path = tmp_path / "episode.npz"
    save_trace(trace, str(path))
    same(trace, load_trace(str(path)))
    assert np.isnan(load_trace(path).phi).all()
    assert read_meta(path) == {}


def test_numpy_reads_the_file_without_pickles(path):
    with np.load(path, allow_pickle=False) as archive:
        assert json.loads(archive["header"].tobytes())["meta"] == {"seed": 0}
        assert archive["position"].shape == (40, 6)


def test_a_truncated_file_is_refused(path):
    whole = path.read_bytes()
    for length in sorted({0, 1, 63, 64, 65, len(whole) - 1, *np.linspace(0, len(whole) - 1, 100).astype(int)}):
        path.write_bytes(whole[:length])
        with pytest.raises(TraceError):
            load_trace(path)
    path.write_bytes(whole + b"0")
    with pytest.raises(TraceError):
        load_trace(path)


def test_a_flipped_bit_is_found_wherever_it_is(path):
    whole = path.read_bytes()
    for bit in np.random.default_rng(0).integers(8 * len(whole), size=300):
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(changed)
        for read in (load_trace, read_meta):
            with pytest.raises(TraceError, match="SHA-256"):
                read(path)


@pytest.mark.parametrize("content", [b"", b"hello", b"x" * 1000, sealed(b""), sealed(b"not an archive" * 50)])
def test_a_foreign_file_is_refused(tmp_path, content):
    (tmp_path / "foreign.npz").write_bytes(content)
    with pytest.raises(TraceError):
        load_trace(tmp_path / "foreign.npz")


def test_other_archives_are_refused(tmp_path):
    buffer = io.BytesIO()
    np.savez(buffer, observations=np.zeros(3))
    for content in (buffer.getvalue(), sealed(buffer.getvalue())):
        (tmp_path / "foreign.npz").write_bytes(content)
        with pytest.raises(TraceError):
            load_trace(tmp_path / "foreign.npz")


def test_what_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(TraceError, match="No such file"):
        load_trace(tmp_path / "missing.npz")
    with pytest.raises(TraceError, match="cannot read"):
        load_trace(tmp_path)
    assert issubclass(TraceError, JSSAGymError)


class _Sentinel:
    """Leaves a file behind if it is ever unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_a_pickle_inside_a_file_never_runs(path, tmp_path):
    trap = tmp_path / "ran"
    bait = np.array([_Sentinel(trap)], dtype=object)
    pickle.loads(pickle.dumps(bait))
    assert trap.exists()
    trap.unlink()
    whole = path.read_bytes()
    for field in ("header", "position", "reason", "unknown"):
        path.write_bytes(whole)
        path.write_bytes(_with_object(path, field, bait))
        if field == "unknown":
            load_trace(path)
        else:
            with pytest.raises(TraceError, match="allow_pickle"):
                load_trace(path)
        assert not trap.exists()


def _with_object(path: Path, field: str, bait: np.ndarray) -> bytes:
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    pickled = io.BytesIO()
    np.save(pickled, bait, allow_pickle=True)
    members[f"{field}.npy"] = pickled.getvalue()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return sealed(buffer.getvalue())


@pytest.mark.sampled(13)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h, a: a.pop("jerk"), "jerk"),
        (lambda h, a: a.pop("header"), "header"),
        (lambda h, a: a.update(jerk=a["jerk"][:-1]), "jerk has to have shape"),
        (lambda h, a: a.update(jerk=a["jerk"][0]), "jerk has to have shape"),
        (lambda h, a: a.update(human_end=a["human_end"][:, :-1]), "human_end has to have shape"),
        (lambda h, a: a.update(position=a["position"].astype(np.float32)), "position has to be an array of type f8"),
        (lambda h, a: a.update(contact=a["contact"].astype(int)), "contact has to be an array of type b1"),
        (lambda h, a: a.update(reason=np.zeros(40)), "reason has to be an array of type U"),
        (lambda h, a: h.update(human_names=["head"]), "human_names have to be 12 strings"),
        (lambda h, a: h.update(human_names=3), "not iterable"),
        (lambda h, a: h.update(plane_names=[1]), "plane_names have to be 1 strings"),
        (lambda h, a: h.update(dt="fast"), "dt has to be"),
        (lambda h, a: h.update(dt=-1.0), "dt has to be"),
        (lambda h, a: h.update(robot=None), "robot has to be a string"),
        (lambda h, a: a.pop("margin"), "margin"),
        (lambda h, a: (earlier(h, a), a.pop("slack")), "slack"),
        (lambda h, a: h.pop("robot"), "robot"),
        (lambda h, a: h.update(version=1), "version 1"),
        (lambda h, a: h.update(version=4), "version 4; this package reads 2 and 3"),
        (lambda h, a: h.update(d_min=0), "d_min has to be"),
        (lambda h, a: h.update(holds=1), "holds has to be"),
        (lambda h, a: h.pop("ended"), "ended"),
        (lambda h, a: h.update(format="other"), "no complete trace: its header does not say"),
    ],
)
def test_a_file_with_something_missing_or_wrong_is_refused(path, change, message):
    path.write_bytes(repacked(path, change))
    with pytest.raises(TraceError, match=message):
        load_trace(path)


def test_an_archive_that_unpacks_to_too_much_is_not_unpacked(path, monkeypatch):
    with zipfile.ZipFile(path) as archive:
        monkeypatch.setattr(module, "LARGEST", 1000 + sum(member.file_size for member in archive.infolist()))
    load_trace(path)
    path.write_bytes(repacked(path, lambda h, a: a.update(bomb=np.zeros(10_000))))
    assert path.stat().st_size < module.LARGEST
    with pytest.raises(TraceError, match="unpacks to"):
        load_trace(path)
    monkeypatch.setattr(module, "LARGEST", 100)
    with pytest.raises(TraceError, match="bytes, more than"):
        load_trace(path)


@pytest.mark.parametrize(
    "changes",
    [{"jerk": np.zeros((3, 6))}, {"pair": np.zeros((40, 2))}, {"dt": float("nan")}, {"name": 3}, {"plane_names": ()}],
)
def test_what_could_not_be_read_is_not_written(trace, tmp_path, changes):
    with pytest.raises(TraceError):
        save_trace(dataclasses.replace(trace, **changes), tmp_path / "episode.npz")
    with pytest.raises(TraceError, match="JSON"):
        save_trace(trace, tmp_path / "episode.npz", {"filter": object()})
    with pytest.raises(TraceError, match="JSON"):
        save_trace(trace, tmp_path / "episode.npz", {"loss": float("nan")})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_an_interrupted_save_leaves_the_old_file(trace, path, monkeypatch, step):
    before = path.read_bytes()

    def fails(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr(os if step == "fsync" else Path, step, fails)
    with pytest.raises(OSError, match="no space"):
        save_trace(dataclasses.replace(trace, name="other"), path)
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    assert path.read_bytes() == before
