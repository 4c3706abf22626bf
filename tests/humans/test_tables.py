"""Recorded people as tables of every kind, and what in them cannot be people, by row and column."""

import dataclasses
import re

import numpy as np
import pytest

from jssa_gym.exceptions import RecordingError
from jssa_gym.humans import Body, Recording, make_human
from jssa_gym.humans.body import NAMES
from jssa_gym.humans.files import load
from jssa_gym.humans.survey import Source, survey

ENDS = tuple(f"{end}.{axis}" for end in ("start", "end") for axis in "xyz")


def stroll(samples=21, step=0.04, speed=0.5):
    """A body that walks past the arm."""
    time = step * np.arange(samples)
    body = Body.facing()
    root = np.array([1.2, -0.4, 0.0]) + speed * time[:, None] * np.array([0.0, 1.0, 0.0])
    return Recording(time, root[:, None] + body.start, root[:, None] + body.end, body.radius, NAMES)


def cells_of(recording):
    """Header and rows of the documented table."""
    columns = {"time": recording.time}
    for i, name in enumerate(recording.names):
        for k, end in enumerate(ENDS):
            columns[f"{name}.{end}"] = (recording.start, recording.end)[k // 3][:, i, k % 3]
        columns[f"{name}.radius"] = np.full(len(recording.time), recording.radius[i])
    return [list(columns), *([repr(float(x)) for x in row] for row in np.array(list(columns.values())).T)]


def text_of(rows, delimiter=","):
    return "\n".join(delimiter.join(row) for row in rows) + "\n"


def same(one, other):
    for field in ("time", "start", "end", "radius"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))
    assert one.names == other.names


def with_index(rows, name):
    return [[name, *rows[0]], *([str(k), *row] for k, row in enumerate(rows[1:]))]


def scaled(rows, time=1.0, lengths=1.0, names=lambda column: column):
    factors = [time if column == "time" else lengths for column in rows[0]]
    return [
        [names(column) for column in rows[0]],
        *([repr(float(cell) * factor) for cell, factor in zip(row, factors, strict=True)] for row in rows[1:]),
    ]


# ---- what is read -------------------------------------------------------------------------------------

ROWS = cells_of(stroll())

READ = {
    "semicolons": text_of(ROWS, ";"),
    "tabs": text_of(ROWS, "\t"),
    "sep=;": "sep=;\n" + text_of(ROWS, ";"),
    "quoted sep": '"sep=;"\n' + text_of(ROWS, ";"),
    "sep=tab": "sep=\t\n" + text_of(ROWS, "\t"),
    "decimal commas": text_of(
        [[cell.replace(".", ",") if k else cell for cell in row] for k, row in enumerate(ROWS)], ";"
    ),
    "decimal commas and tabs": text_of(
        [[cell.replace(".", ",") if k else cell for cell in row] for k, row in enumerate(ROWS)], "\t"
    ),
    "comments": "# by a camera\n% of 2025\n" + text_of(ROWS[:3]) + "\n// lost sight\n" + text_of(ROWS[3:]),
    "blank rows": text_of([*ROWS, [""] * len(ROWS[0])], ";"),
    "unnamed index": text_of(with_index(ROWS, "")),
    "index of pandas": text_of(with_index(ROWS, "Unnamed: 0")),
    "frame": text_of(with_index(ROWS, "Frame"), ";"),
    "index and trailing delimiters": text_of([[*row, ""] for row in with_index(ROWS, "")], ";"),
    "spaces": text_of([[f" {cell} " for cell in row] for row in ROWS]),
    "quotes": text_of([[f'"{cell}"' for cell in row] for row in ROWS]),
    "Windows": text_of(ROWS).replace("\n", "\r\n"),
    "Time": text_of([["Time", *ROWS[0][1:]], *ROWS[1:]]),
}


@pytest.mark.parametrize("kind", READ)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_tables_of_every_kind_are_read(tmp_path, kind, encoding):
    path = tmp_path / "walk.csv"
    path.write_text(READ[kind], encoding=encoding, newline="")
    same(Recording.load(path), stroll())


@pytest.mark.parametrize("suffix", [".CSV", ".Csv", ".NPZ"])
def test_endings_in_any_case(tmp_path, suffix):
    path = tmp_path / f"walk{suffix}"
    if suffix == ".NPZ":
        stroll().save(tmp_path / "walk.npz")
        (tmp_path / "walk.npz").rename(path)
    else:
        path.write_text(text_of(ROWS))
    same(Recording.load(path), stroll())
    same(make_human(str(path)).recording, stroll())


@pytest.mark.parametrize(
    "names",
    [lambda c: f"{c} [{'ms' if c == 'time' else 'mm'}]", lambda c: f"{c} ({'ms' if c == 'time' else 'mm'})",
     lambda c: f"{c}_{'ms' if c == 'time' else 'mm'}"],
)  # fmt: skip
def test_units_in_the_header_are_converted(tmp_path, names):
    path = tmp_path / "walk.csv"
    path.write_text(text_of(scaled(ROWS, 1000.0, 1000.0, names)))
    found, expected = Recording.load(path), stroll()
    for field in ("time", "start", "end", "radius"):
        np.testing.assert_allclose(getattr(found, field), getattr(expected, field), rtol=1e-12, atol=1e-15)


def test_a_unit_that_nobody_knows_is_refused(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text(text_of([["time [fortnights]", *ROWS[0][1:]], *ROWS[1:]]))
    with pytest.raises(RecordingError, match=r"column time \[fortnights\]: unknown unit 'fortnights'; valid: s, ms"):
        Recording.load(path)


# ---- what is not --------------------------------------------------------------------------------------


def changed(row, column, cell):
    """The table with one field changed; ``row`` is the line in the file, from 1."""
    rows = [list(one) for one in ROWS]
    rows[row - 1][rows[0].index(column)] = cell
    return rows


@pytest.mark.parametrize("delimiter", [",", ";"])
@pytest.mark.parametrize(
    ("row", "column", "cell", "word"),
    [
        (5, "head.start.x", "", "row 5, column head.start.x is empty"),
        (7, "left_leg.end.z", "0..1", "row 7, column left_leg.end.z holds '0..1', which is no number"),
        (3, "time", "NaN", "row 3, column time: numbers have to be finite, got 'NaN'"),
        (4, "head.end.y", "inf", "row 4, column head.end.y: numbers have to be finite"),
        (9, "head.radius", "0.3", "row 9, column head.radius: .*same in every row, 0.3 m is not 0.2 m"),
        (6, "time", "0.12", "row 6, column time: .*0.12 s stands after 0.12 s of row 5; leave one"),
        (8, "time", "0.05", "row 8, column time: .*0.05 s comes after 0.2 s of row 7; sort"),
    ],
)
def test_a_field_that_does_not_fit_is_named(tmp_path, delimiter, row, column, cell, word):
    path = tmp_path / "walk.csv"
    path.write_text(text_of(changed(row, column, cell), delimiter))
    with pytest.raises(RecordingError, match=rf"walk\.csv: {word}"):
        Recording.load(path)


def test_rows_are_counted_as_an_editor_does(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text("# one\nsep=;\n\n# two\n" + text_of(changed(5, "head.start.x", "x"), ";"))
    with pytest.raises(RecordingError, match=r"row 9, column head\.start\.x"):
        Recording.load(path)


def test_a_column_that_is_there_twice_is_named(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text(text_of([[*row, row[1]] for row in ROWS]))
    with pytest.raises(RecordingError, match=r"twice: \['head.start.x'\]"):
        Recording.load(path)


def moved(k, part, way, until=None):
    """The walk with one part displaced from sample k on, until another."""
    recording = stroll()
    start, end = recording.start.copy(), recording.end.copy()
    i = NAMES.index(part)
    start[k:until, i] += way
    end[k:until, i] += way
    return dataclasses.replace(recording, start=start, end=end)


UP = {"x": (2, 0, 1), "y": (0, 2, 1), "-x": (2, 1, 0), "-y": (0, 2, 1), "-z": (0, 1, 2)}
SIGNS = {"x": (1, 1, 1), "y": (1, 1, -1), "-x": (-1, 1, 1), "-y": (1, -1, 1), "-z": (1, -1, -1)}


def turned(axis):
    """The walk in a world whose axis points up."""

    def turn(points):
        return points[..., UP[axis]] * SIGNS[axis]

    recording = stroll()
    assert np.linalg.det(turn(np.eye(3))) == pytest.approx(1.0)
    assert turn(np.array([0.0, 0.0, 1.0]))["xyz".index(axis[-1])] == (-1.0 if axis[0] == "-" else 1.0)
    return dataclasses.replace(recording, start=turn(recording.start), end=turn(recording.end))


IMPOSSIBLE = {
    "millimetres": (
        scaled(ROWS, 1.0, 1000.0),
        r"row 2, column core_body\.radius: a radius of 250 m; .*'head.start.x \[mm\]'",
    ),
    "centimetres": (
        scaled(ROWS, 1.0, 100.0),
        r"row 2, column core_body\.radius: a radius of 25 m; metres are meant",
    ),
    "milliseconds": (
        scaled(ROWS, 1000.0, 1.0),
        r"row 3, column time: a sample comes every 40 s, .*convert milliseconds or microseconds",
    ),
    "a jump": (
        cells_of(moved(9, "left_arm", [0.0, 5.0, 0.0], 10)),
        r"row 11, column left_arm\.start\.y: jumps by 5.0\d m .*in 1 more step;",
    ),
    "a slow jump": (
        cells_of(dataclasses.replace(moved(9, "left_arm", [0.0, 5.0, 0.0], 10), time=0.6 * np.arange(21))),
        r"row 11, column left_arm\.start\.y: jumps by 5.0\d m within 0.6 s, 8.3",
    ),
    **{
        f"{axis} up": (
            cells_of(turned(axis)),
            rf"row 2, column head\.start\.{axis[-1]}: the head is above the legs along {axis}, .* by 1\.05 m",
        )
        for axis in UP
    },
}


@pytest.mark.parametrize("kind", IMPOSSIBLE)
def test_what_cannot_be_somebody_is_refused_by_row_and_column(tmp_path, kind):
    rows, word = IMPOSSIBLE[kind]
    path = tmp_path / "walk.csv"
    path.write_text(text_of(rows))
    for read in (Recording.load, make_human):
        with pytest.raises(RecordingError, match=word):
            read(path)


def test_lengths_are_looked_at_though_radii_are_metres(tmp_path):
    rows = scaled(ROWS, 1.0, 1000.0)
    for k, row in enumerate(rows[1:], 1):
        rows[k] = [ROWS[k][j] if rows[0][j].endswith("radius") else cell for j, cell in enumerate(row)]
    path = tmp_path / "walk.csv"
    path.write_text(text_of(rows))
    with pytest.raises(RecordingError, match=r"row \d+, column \w+\.end\.x: \w+ is 7\d\d(\.\d)? m long"):
        Recording.load(path)


@pytest.mark.parametrize("axis", UP)
def test_the_turn_that_is_proposed_is_right(axis):
    """No reflection, which would swap left and right: it is the same walk, turned about the vertical."""
    recording = turned(axis)
    (finding,) = (finding for finding in survey(recording) if finding.kind == "upright")
    told = re.search(r"write (\S+), (\S+) and (\S+) as x, y and z", finding.cure)
    columns = ["xyz".index(one[-1]) for one in told.groups()]
    signs = [-1.0 if one[0] == "-" else 1.0 for one in told.groups()]
    start, end = (ends[..., columns] * signs for ends in (recording.start, recording.end))
    upright, original = dataclasses.replace(recording, start=start, end=end), stroll()
    assert survey(upright) == []
    across, before = ((one.start[:, 2, :2] - one.start[:, 3, :2]) @ [1.0, 1.0j] for one in (upright, original))
    turn = across[0] / before[0]
    for ours, theirs in ((upright.start, original.start), (upright.end, original.end)):
        np.testing.assert_allclose(ours[..., :2] @ [1.0, 1.0j], turn * (theirs[..., :2] @ [1.0, 1.0j]), atol=1e-12)
        np.testing.assert_allclose(ours[..., 2], theirs[..., 2], atol=1e-12)


def gapped(gap):
    """A sample every 40 ms, and none for a while after the tenth."""
    recording = stroll(speed=0.9)
    time = recording.time + gap * (np.arange(21) > 9)
    return dataclasses.replace(recording, time=time)


def test_a_gap_is_told_by_row_and_played(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text(text_of(cells_of(gapped(0.5))))
    with pytest.warns(UserWarning, match=r"walk\.csv: row 12, column time: a gap of 0\.54 s after row 11, at 0\.360 s"):
        motion = make_human(str(path))
    same(motion.recording, gapped(0.5))
    gapped(0.5).save(tmp_path / "walk.npz")
    with pytest.warns(UserWarning, match="sample 10, time: a gap of 0.54 s after sample 9"):
        make_human(tmp_path / "walk.npz")


def test_where_nobody_moves_there_is_no_gap():
    recording = gapped(0.5)
    still = dataclasses.replace(recording, start=recording.start[:1].repeat(21, 0), end=recording.end[:1].repeat(21, 0))
    assert [finding.kind for finding in survey(recording)] == ["gap"]
    assert survey(still) == []
    assert survey(gapped(0.1)) == []  # nor within a quarter of a second


def lifted(way):
    recording = stroll()
    up = np.array([0.0, 0.0, way])
    return dataclasses.replace(recording, start=recording.start + up, end=recording.end + up)


def grown(factor):
    recording = stroll()
    height = [1.0, 1.0, factor]
    return dataclasses.replace(recording, start=recording.start * height, end=recording.end * height)


@pytest.mark.parametrize(
    ("recording", "kinds", "word"),
    [
        (stroll(), [], ""),
        (lifted(-0.9), ["floor"], "0.80 m below the floor.*add 0.88 m to all heights"),
        (lifted(0.5), ["floor"], "0.60 m above the floor.*add -0.52 m"),
        (grown(2.0), ["height"], "3.0. m tall"),
        (grown(0.4), ["height"], "0.7. m tall"),
        (moved(9, "head", [0.0, 0.0, 1.0], 12), ["jump"], "sample 9, head.start.z: jumps by 1.00 m within 0.04 s"),
    ],
    ids=["sound", "sunken", "floating", "giant", "dwarf", "jumping"],
)  # fmt: skip
def test_what_is_not_as_in_people_is_told(tmp_path, recording, kinds, word):
    findings = survey(recording)
    assert [finding.kind for finding in findings] == kinds
    recording.save(tmp_path / "walk.npz")
    same(Recording.load(tmp_path / "walk.npz"), recording)  # that is what its author wrote
    if kinds:
        with pytest.warns(UserWarning, match=rf"walk\.npz: .*{word}"):
            make_human(tmp_path / "walk.npz")
    else:
        make_human(tmp_path / "walk.npz")


def test_places_in_a_file():
    assert Source().value(3, "time") == "sample 3, time"
    assert Source(noun="frame", first=30).sample(2) == "frame 32"
    assert Source(rows=(2, 4, 9)).value(2, "time") == "row 9, column time"


def test_what_is_no_file_of_a_person_is_refused(tmp_path):
    for path in ("walk.txt", tmp_path / "walk"):
        with pytest.raises(RecordingError, match=r"\.npz, \.csv, \.bvh"):
            load(path)
    for path in ("nowhere.csv", "nowhere.npz", "nowhere.bvh"):
        with pytest.raises(RecordingError, match=f"no recording at {path}"):
            make_human(path)
