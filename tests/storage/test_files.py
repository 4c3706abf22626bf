"""Files that are written whole or not at all, and readers that are given something else."""

import ast
import errno
import io
import json
import os
import stat
import subprocess
import sys
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

import jssa_gym
from jssa_gym import plots, storage
from jssa_gym.certificate.chunks import ChunkFile
from jssa_gym.cli import main
from jssa_gym.cli.files import write_figure
from jssa_gym.evaluation import load_trace
from jssa_gym.evaluation.ledger import Ledger
from jssa_gym.evaluation.report import write_reports
from jssa_gym.evaluation.rows import trace_name
from jssa_gym.evaluation.study import Study
from jssa_gym.exceptions import (
    CheckpointError,
    JSSAGymError,
    ParameterError,
    PolicyFileError,
    RecordingError,
    RobotModelError,
    StorageError,
    TraceError,
)
from jssa_gym.humans import bvh
from jssa_gym.humans.recording import Recording
from jssa_gym.policies import load_policy, save_policy, shipped_policies
from jssa_gym.robots import make_robot
from jssa_gym.storage import (
    append_whole,
    file_name,
    open_archive,
    read_array,
    read_sealed,
    read_text,
    read_whole,
    refused,
    whole_file,
    whole_lines,
    write_archive,
    write_json,
    write_sealed,
    write_whole,
)
from jssa_gym.train.checkpoint import read_checkpoint
from jssa_gym.train.history import write_history, write_record

PACKAGE = Path(jssa_gym.__file__).parent


@pytest.fixture
def recording():
    return Recording([0.0, 1.0], np.zeros((2, 1, 3)), np.ones((2, 1, 3)), [0.1], ("head",))


def writers(recording):
    """Everything that writes a whole file, by name of the file."""
    study = Study(("reach",), ("none",), ("none",), ("hold",), episodes=1)

    def film(path):
        pytest.importorskip("av", reason="PyAV is not installed")
        plots.write_film(path, iter(np.zeros((3, 64, 96, 3), np.uint8)), 25)

    def figure(path):
        pytest.importorskip("matplotlib", reason="matplotlib is not installed")
        from matplotlib.figure import Figure

        write_figure(path, Figure())

    return {
        "x.json": lambda path: write_json(path, {"a": 1}),
        "x.png": figure,
        "x.mp4": film,
        "policy.npz": lambda path: save_policy(path, load_policy(shipped_policies()[0])),
        "recording.npz": lambda path: recording.save(path),
        "history.csv": lambda path: write_history(path, ()),
        "training.json": lambda path: write_record(path, {}, ()),
        "campaign.json": lambda path: Ledger(path.parent, study),
        "chunks.jsonl": lambda path: ChunkFile(path.parent, {"a": 1}),
        "summary.json": lambda path: write_reports(path, ()),
    }


NAMES = tuple(writers(None))


# ---- written -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_a_file_has_the_umasks_mode_and_its_folder_nothing_else(tmp_path, recording, name):
    before = os.umask(0o027)
    try:
        writers(recording)[name](tmp_path / name)
    finally:
        os.umask(before)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o640
    assert (tmp_path / name).stat().st_size > 0


@pytest.mark.parametrize("name", NAMES)
def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch, recording, name):
    def full(handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    if name not in ("campaign.json", "chunks.jsonl"):  # whose content would be looked at
        (tmp_path / name).write_text("mine")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises((StorageError, ParameterError), match=f"{name}: No space left on device"):
        writers(recording)[name](tmp_path / name)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_names_of_unfinished_files_cannot_be_taken_beforehand(tmp_path, monkeypatch):
    """Nor is a link followed, or a file taken over, that somebody put there who guessed."""
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / "out").mkdir()
    names = []
    monkeypatch.setattr(storage.files.secrets, "token_hex", lambda count: names.append("guessed") or "guessed")
    (tmp_path / "out" / ".guessed.part").symlink_to(victim)
    with pytest.raises(StorageError, match="File exists"):
        write_whole(tmp_path / "out" / "x", b"theirs")
    assert names == ["guessed"]
    assert victim.read_text() == "mine"
    monkeypatch.undo()
    seen = set()
    for _ in range(20):
        with whole_file(tmp_path / "out" / "y"):
            seen |= {path.name for path in (tmp_path / "out").glob(".*.part")}
    assert len(seen) == 21


@pytest.mark.long
def test_every_writer_of_the_package_goes_through_storage():
    """No other module opens a file to write into it; archives open their members."""
    allowed = {"storage/files.py", "storage/archives.py"}
    words = {"write_text", "write_bytes", "savefig", "mkstemp", "NamedTemporaryFile"}
    found = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            modes = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
            writes = called == "open" and any(set(mode) <= set("wabx+t") and mode for mode in modes)
            to_file = called == "savefig" and ast.unparse(node.args[0]) == "file"
            film = writes and "av.open(file" in ast.unparse(node)
            if (called in words or writes) and not (to_file or film):
                found.add(path.relative_to(PACKAGE).as_posix())
    assert found <= allowed


def test_what_is_raised_while_a_file_is_written_leaves_nothing(tmp_path):
    def interrupted():
        with whole_file(tmp_path / "x") as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_what_is_wrong_with_another_file_is_not_said_of_this_one(tmp_path):
    def filled():
        with whole_file(tmp_path / "x") as file:
            file.write(b"half")
            (tmp_path / "picture").read_bytes()

    with pytest.raises(FileNotFoundError) as error:
        filled()
    assert not isinstance(error.value, StorageError)
    assert error.value.filename == str(tmp_path / "picture")
    assert list(tmp_path.iterdir()) == []


def test_what_no_buffer_holds_is_told_as_well(tmp_path):
    """Of which the writing fails before the end, in the hands of whoever fills the file."""
    script = (
        "import resource, signal, sys, pathlib\n"
        "from jssa_gym.storage import whole_file\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))\n"
        "with whole_file(pathlib.Path(sys.argv[1])) as file:\n"
        "    for _ in range(100): file.write(bytes(1000))\n"
    )
    ran = subprocess.run([sys.executable, "-c", script, tmp_path / "x"], capture_output=True, text=True, check=False)
    assert ran.stderr.splitlines()[-1].endswith(f"StorageError: cannot write {tmp_path / 'x'}: File too large")
    assert list(tmp_path.iterdir()) == []


def test_text_is_written_as_utf_8(tmp_path):
    write_whole(tmp_path / "x", "≤ é")
    assert (tmp_path / "x").read_bytes() == "≤ é".encode()


def test_appended_all_or_nothing(tmp_path):
    path = tmp_path / "x"
    assert append_whole(path, b"one\n") == 4
    assert append_whole(path, b"two\n", 4) == 8
    assert append_whole(path, b"three\n", 4) is None
    assert path.read_bytes() == b"one\ntwo\n"
    script = (
        "import resource, signal, pathlib\n"
        "from jssa_gym.storage import append_whole\n"
        "from jssa_gym.exceptions import StorageError\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))\n"
        "try:\n    append_whole(pathlib.Path('x'), b'three\\n')\n"
        "except StorageError as error:\n    print(error)\n"
    )
    run = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert run.stdout == "cannot write x: File too large\n"
    assert path.read_bytes() == b"one\ntwo\n"


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("full_after", "arguments", "name"),
    [
        (0, "evaluate --filter none --human none --episodes 1 --seconds 0.2", "campaign.json"),
        (1, "evaluate --filter none --human none --episodes 1 --seconds 0.2", "episodes.csv"),
        (2, "evaluate --filter none --human none --episodes 1 --seconds 0.2", "traces/reach-none-none-jpc-0.npz"),
        (3, "evaluate --filter none --human none --episodes 1 --seconds 0.2", "summary.json"),
        (4, "compare --filters none stop --humans none --episodes 1 --seconds 0.2 --keep 0", "report.html"),
        (1, "stress --filters none --humans pursuit --policies hold --episodes 1 --seconds 0.2", "episodes.csv"),
        (1, "certify --states 100 --no-search --capsules elbow", "chunks.jsonl"),
        (2, "certify --states 100 --no-search --capsules elbow", "certificate.json"),
        (0, "demo --seconds 0.2 --no-video", "metrics.json"),
        (1, "demo --seconds 0.2 --no-video", "profile.png"),
        (0, "reproduce fig3", "fig3.png"),
        (1, "reproduce fig3", "fig3.json"),
    ],
)
def test_a_full_disk_is_one_line(tmp_path, monkeypatch, capsys, full_after, arguments, name):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    left = iter([True] * full_after)
    flush = os.fsync

    def fills_up(handle):
        if not next(left, False):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(handle)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "fsync", fills_up)
    monkeypatch.setattr(sys, "argv", ["jssa-gym", *arguments.split(), "--out", "out"])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert capsys.readouterr().err.splitlines()[-1].endswith(f"cannot write out/{name}: No space left on device")
    assert not [path for path in tmp_path.rglob("*") if path.suffix == ".part"]
    whole = tmp_path / "out" / name
    assert not whole.exists() or whole.read_bytes().count(b"\n") == (name == "chunks.jsonl")


def test_names_from_files_stay_in_their_folder():
    """A capsule's or a person's name is a part of files' names."""
    for name in ("../../x", "a/b", "C:\\x", "a\x1b[31m\nb", "x" * 300, "\ud800"):
        plain = file_name(name)
        assert Path(plain).name == plain
        assert plain.isprintable()
        assert len(plain.encode()) < 120
    assert file_name("upper_arm-1.5+x") == "upper_arm-1.5+x"
    assert file_name("a b") != file_name("a_b") != file_name("a\tb") != file_name("a b")
    assert trace_name(("reach", "jssa+stop", "", "hold"), 3) == "reach-jssa+stop-hold-3.npz"


# ---- read --------------------------------------------------------------------------------------------


def checkpoint_of(path):
    """The reader of a manifest."""
    return read_checkpoint(path.parent)


def limits_of(path):
    """The reader of an arm's limits."""
    return make_robot(path.with_name(path.name.replace(".limits.toml", ".xml")))


def ledger_of(path):
    """The reader of a campaign's configuration."""
    path.with_name("episodes.csv").write_text("x\n")
    return Ledger(path.parent, Study(("reach",), ("none",), ("none",), ("hold",), episodes=1))


def table_of(path):
    """The reader of a campaign's episodes."""
    other = path.with_name("other")
    study = Study(("reach",), ("none",), ("none",), ("hold",), episodes=1)
    Ledger(other, study)
    path.with_name("campaign.json").write_bytes((other / "campaign.json").read_bytes())
    return Ledger(path.parent, study)


READERS = {
    "arm.limits.toml": (limits_of, RobotModelError),
    "toy.xml": (make_robot, RobotModelError),
    "walk.bvh": (bvh.read, RecordingError),
    "walk.csv": (Recording.load, RecordingError),
    "walk.npz": (Recording.load, RecordingError),
    "trace.npz": (load_trace, TraceError),
    "policy.npz": (load_policy, PolicyFileError),
    "manifest.json": (checkpoint_of, CheckpointError),
    "campaign.json": (ledger_of, ParameterError),
    "episodes.csv": (table_of, ParameterError),
    "chunks.jsonl": (lambda path: ChunkFile(path.parent, {"a": 1}), ParameterError),
}
CONTENTS = {
    "Latin-1": "# für\nunit = 'rad'\n".encode("latin-1"),
    "UTF-16": "unit = 'rad'\n".encode("utf-16"),
    "NUL": b"unit = 'rad'\0\n",
    "nothing": b"",
    "noise": bytes(range(256)) * 10,
    "deep": b"[" * 100_000 + b"\n",
    "no end of line": b"x" * 100,
    "a long number": b"a = " + b"9" * 10_000 + b"\n",
}


def put(tmp_path, toy_mjcf, name):
    """Where a reader looks for its file."""
    if name == "arm.limits.toml":
        (tmp_path / "arm.xml").write_bytes(toy_mjcf.read_bytes())
    folder = tmp_path / "000000000001"
    folder.mkdir()
    path = (tmp_path if name.startswith(("arm", "toy")) else folder) / name
    path.unlink(missing_ok=True)
    return path


@pytest.mark.sampled(38)
@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_such_file_is_a_typed_error_that_names_it(tmp_path, toy_mjcf, name, content):
    path = put(tmp_path, toy_mjcf, name)
    path.write_bytes(CONTENTS[content])
    read, failure = READERS[name]
    if content == "nothing" and name in ("episodes.csv", "chunks.jsonl"):
        read(path)  # a crash left it: anybody's
        return
    with pytest.raises(failure) as caught:
        read(path)
    assert path.name in str(caught.value) or path.parent.name in str(caught.value)


@pytest.mark.parametrize("name", READERS)
def test_a_folder_is_no_file(tmp_path, toy_mjcf, name):
    path = put(tmp_path, toy_mjcf, name)
    path.mkdir()
    read, failure = READERS[name]
    with pytest.raises(failure):
        read(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")
@pytest.mark.parametrize("name", READERS)
def test_a_pipe_is_not_waited_for(tmp_path, toy_mjcf, name):
    path = put(tmp_path, toy_mjcf, name)
    os.mkfifo(path)
    read, failure = READERS[name]
    with pytest.raises(failure):
        read(path)


def test_the_line_of_a_wrong_byte_is_told(tmp_path):
    (tmp_path / "x").write_bytes(b"a\nb\n\xe4\n")
    with pytest.raises(ParameterError, match=r"x is no text in UTF-8: byte 0xe4 in line 3; save it in UTF-8"):
        read_text(tmp_path / "x", ParameterError)
    (tmp_path / "x").write_bytes(b"a\n\0")
    with pytest.raises(ParameterError, match="a NUL in line 2"):
        read_text(tmp_path / "x", ParameterError)


def test_a_byte_order_mark_and_any_ends_of_lines_are_read(tmp_path, toy_mjcf):
    (tmp_path / "x").write_bytes(b"\xef\xbb\xbfa\r\nb\rc\n")
    assert read_text(tmp_path / "x", ParameterError) == "a\nb\nc\n"
    limits = toy_mjcf.with_name("toy.limits.toml")
    limits.write_bytes(b"\xef\xbb\xbf" + limits.read_bytes().replace(b"\n", b"\r\n"))
    assert make_robot(toy_mjcf).n == 3


def test_a_file_that_is_too_large_is_not_read(tmp_path, monkeypatch):
    (tmp_path / "x").write_bytes(b"12345")
    assert read_whole(tmp_path / "x", ParameterError, 5) == b"12345"
    with pytest.raises(ParameterError, match="5 bytes, more than 4"):
        read_whole(tmp_path / "x", ParameterError, 4)
    with pytest.raises(ParameterError, match="x"):
        read_whole(tmp_path / "x\0", ParameterError)
    with pytest.raises(ParameterError, match="No such file"):
        read_whole(tmp_path / "y", ParameterError)


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="everything can be read")
def test_a_file_that_may_not_be_read(tmp_path):
    (tmp_path / "x").write_text("x")
    (tmp_path / "x").chmod(0)
    with pytest.raises(ParameterError, match="Permission denied"):
        read_text(tmp_path / "x", ParameterError)


@pytest.mark.parametrize("number", ["[1e999, 1, 1]", "[1" + "0" * 400 + ", 1, 1]", "['a', 1, 1]", "{}", "[nan, 1, 1]"])
def test_limits_that_are_no_numbers(toy_mjcf, number):
    limits = toy_mjcf.with_name("toy.limits.toml")
    limits.write_text(f"unit = 'rad'\nvelocity = {number}\nacceleration = [8, 8, 8]\njerk = [80, 80, 80]\n")
    with pytest.raises(RobotModelError):
        make_robot(toy_mjcf)


def test_an_arm_whose_names_are_not_utf_8(tmp_path, toy_mjcf):
    toy_mjcf.write_bytes(toy_mjcf.read_bytes().replace(b'name="first"', b'name="f\xfcrst"'))
    with pytest.raises(RobotModelError, match=r"toy.xml is no text in UTF-8"):
        make_robot(toy_mjcf)
    # nor those of a file that it includes
    whole = toy_mjcf.read_bytes()
    toy_mjcf.with_name("part.xml").write_bytes(whole)
    toy_mjcf.write_text('<mujoco><include file="part.xml"/></mujoco>')
    with pytest.raises(RobotModelError, match="UTF-8"):
        make_robot(toy_mjcf)


def test_errors_of_storage_are_what_users_of_files_expect(tmp_path):
    with pytest.raises(OSError, match="cannot write") as caught:
        write_whole(tmp_path / "no" / "x", b"")
    assert isinstance(caught.value, JSSAGymError)
    assert isinstance(caught.value.__cause__, FileNotFoundError)
    assert json.dumps(str(caught.value))


def test_lines_that_a_crash_cut_off_are_told_apart(tmp_path):
    assert whole_lines(tmp_path / "x", ParameterError) == (b"", b"")
    for content, found in ((b"a\nb\nc", (b"a\nb\n", b"c")), (b"a\n", (b"a\n", b"")), (b"a", (b"", b"a"))):
        (tmp_path / "x").write_bytes(content)
        assert whole_lines(tmp_path / "x", ParameterError) == found


def test_what_goes_wrong_with_a_content_is_one_error():
    for error, told in ((KeyError("dt"), "bad: 'dt' is missing"), (MemoryError(), "bad: MemoryError")):
        with pytest.raises(TraceError, match=told), refused(TraceError, "bad"):
            raise error
    with pytest.raises(TraceError, match=r"^mine$"), refused(TraceError, "bad"):
        raise TraceError("mine")
    with pytest.raises(KeyboardInterrupt), refused(TraceError, "bad"):
        raise KeyboardInterrupt


# ---- archives ----------------------------------------------------------------------------------------

ARRAYS = {
    "numbers": np.arange(6.0).reshape(2, 3),
    "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "one": np.array(3, np.int64),
    "none": np.zeros((0, 3)),
    "no_width": np.zeros((3, 0)),
    "yes": np.array([True, False]),
    "texts": np.array(["ö", "", "abc"]),
    "empty_texts": np.array([""]),
    "foreign": np.arange(3, dtype=">f4"),
    "five": np.zeros((1, 2, 1, 2, 1), np.uint8),
}


def archive_of(write, *arguments, **options) -> bytes:
    write(buffer := io.BytesIO(), *arguments, **options)
    return buffer.getvalue()


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("writer", ["ours", "numpy"])
def test_arrays_are_what_numpy_makes_of_them(writer, compressed):
    if writer == "ours":
        content = archive_of(write_archive, ARRAYS, compressed=compressed)
    else:
        content = archive_of(np.savez_compressed if compressed else np.savez, **ARRAYS)
    with np.load(io.BytesIO(content), allow_pickle=False) as theirs, open_archive(content, 10_000) as archive:
        assert theirs.files == list(ARRAYS)
        for name, array in ARRAYS.items():
            found = read_array(archive, name)
            assert (found.dtype, found.shape) == (theirs[name].dtype, theirs[name].shape) == (array.dtype, array.shape)
            np.testing.assert_array_equal(found, array)
            assert found.flags.writeable


def test_the_same_members_are_the_same_bytes(tmp_path):
    members = {**ARRAYS, "header.json": b"{}"}
    for name in ("a", "b"):
        write_sealed(tmp_path / name, members, TraceError, 10_000)
    content = (tmp_path / "a").read_bytes()
    assert content == (tmp_path / "b").read_bytes() == read_sealed(tmp_path / "a", "x", TraceError, 10_000)
    with pytest.raises(TraceError, match="more than 100"):
        write_sealed(tmp_path / "a", members, TraceError, 100)
    assert (tmp_path / "a").read_bytes() == content
    (tmp_path / "a").write_bytes(content[:-1])
    with pytest.raises(TraceError, match="a is no x, or not as it was written: its SHA-256"):
        read_sealed(tmp_path / "a", "x", TraceError, 10_000)


def test_a_member_that_unpacks_to_more_than_it_says_is_not_unpacked():
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", bytes(2**24))
    content = bytearray(buffer.getvalue())
    at = content.index(b"PK\x01\x02") + 24
    content[at : at + 4] = (100).to_bytes(4, "little")
    tracemalloc.start()
    try:
        with open_archive(bytes(content), 1000) as archive, pytest.raises((ValueError, zipfile.BadZipFile)):
            read_array(archive, "x")
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("header", ["{'descr': '|O', %s}", "{'descr': [('a', '<f8')], %s}", "__import__('os')"])
def test_no_header_of_an_array_is_evaluated(header):
    text = (header.replace("%s", "'fortran_order': False, 'shape': (1,), ") + "\n").encode()
    array = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(8)
    with (
        open_archive(archive_of(write_archive, {"x.npy": array})) as archive,
        pytest.raises(ValueError, match="no plain array"),
    ):
        read_array(archive, "x")
