"""Recorded people: files and what is refused, placement and playing; BVH against a skeleton worked out by hand."""

import dataclasses
import itertools
import runpy
import zipfile

import gymnasium as gym
import numpy as np
import pytest
from places import ROOT
from scipy.spatial.transform import Rotation

from jssa_gym.exceptions import JSSAGymError, ParameterError, RecordingError
from jssa_gym.humans import Body, Recorded, Recording, bvh
from jssa_gym.humans.body import NAMES
from jssa_gym.humans.recorded import REACH_AND_RETREAT

DT = 0.008
EXAMPLE = ROOT / "examples" / "make_recording.py"


def stroll(speed=0.5, seconds=2.0, samples=21, start=(1.5, 0.0), way=(1.0, 0.0)):
    """A body that walks straight at one speed."""
    time = np.linspace(0.0, seconds, samples)
    body = Body.facing()
    root = np.array([*start, 0.0]) + speed * time[:, None] * np.array([*way, 0.0])
    return Recording(time, root[:, None] + body.start, root[:, None] + body.end, body.radius, NAMES)


def still(**options):
    return {"turn": (0.0, 0.0), "offset": ((0.0, 0.0), (0.0, 0.0)), **options}


def csv_of(recording):
    """The recording as the documented table."""
    columns = {"time": recording.time}
    for i, name in enumerate(recording.names):
        for end in ("start", "end"):
            for k, axis in enumerate("xyz"):
                columns[f"{name}.{end}.{axis}"] = getattr(recording, end)[:, i, k]
        columns[f"{name}.radius"] = np.full(len(recording.time), recording.radius[i])
    rows = [",".join(columns), *(",".join(repr(float(x)) for x in row) for row in np.array(list(columns.values())).T)]
    return "\n".join(rows) + "\n"


def same(one, other):
    for field in ("time", "start", "end", "radius"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))
    assert one.names == other.names


# ---- files --------------------------------------------------------------------------------------------


def test_what_was_saved_is_loaded(tmp_path):
    recording = stroll()
    recording.save(tmp_path / "walk.npz")
    same(Recording.load(tmp_path / "walk.npz"), recording)
    (tmp_path / "walk.csv").write_text(csv_of(recording))
    same(Recording.load(str(tmp_path / "walk.csv")), recording)
    # nothing but the file is left
    assert sorted(path.name for path in tmp_path.iterdir()) == ["walk.csv", "walk.npz"]


@pytest.mark.parametrize("gone", ["right_arm.radius", "head.start.x"])
def test_a_missing_column_is_named(tmp_path, gone):
    header, *rows = csv_of(stroll()).splitlines()
    k = header.split(",").index(gone)
    lines = [",".join(cell for j, cell in enumerate(line.split(",")) if j != k) for line in (header, *rows)]
    (tmp_path / "walk.csv").write_text("\n".join(lines))
    with pytest.raises(RecordingError, match=rf"missing: \['{gone}'\], unknown: none"):
        Recording.load(tmp_path / "walk.csv")


def test_columns_may_stand_in_any_order(tmp_path):
    lines = [line.split(",") for line in csv_of(stroll()).splitlines()]
    order = np.random.default_rng(0).permutation(len(lines[0]))
    (tmp_path / "walk.csv").write_text("\n".join(",".join(line[i] for i in order) for line in lines))
    shuffled, plain = Recording.load(tmp_path / "walk.csv"), stroll()
    for i, name in enumerate(shuffled.names):
        np.testing.assert_array_equal(shuffled.start[:, i], plain.start[:, plain.names.index(name)])
        np.testing.assert_array_equal(shuffled.radius[i], plain.radius[plain.names.index(name)])


def test_the_shipped_recording_is_what_the_example_synthesises():
    made = runpy.run_path(str(EXAMPLE))["synthesise"]()
    shipped = Recording.load(REACH_AND_RETREAT)
    for field in ("time", "start", "end", "radius"):
        np.testing.assert_allclose(getattr(shipped, field), getattr(made, field), rtol=0.0, atol=1e-12)
    assert shipped.names == NAMES


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"time": np.linspace(0.0, 2.0, 20)}, "start"),
        ({"time": np.r_[np.linspace(0.0, 1.0, 20), 0.5]}, "sample 20"),
        ({"time": np.r_[0.0, 0.0, np.linspace(0.1, 1.0, 19)]}, "sample 1 "),
        ({"time": np.full(21, np.nan)}, "finite"),
        ({"time": np.zeros((21, 1))}, "time"),
        ({"start": np.zeros((21, 5, 3))}, "start"),
        ({"end": np.full((21, 6, 3), np.inf)}, "finite"),
        ({"end": np.zeros((21, 6, 2))}, "end"),
        ({"radius": np.zeros(6)}, "radius"),
        ({"radius": -np.ones(6)}, "radius"),
        ({"radius": np.ones(5)}, "radius"),
        ({"radius": ["wide"] * 6}, "radius"),
        ({"names": ("head",) * 6}, "name"),
        ({"names": ("", *NAMES[1:])}, "name"),
        ({"names": None}, "names"),
        ({"names": "abcdef"}, "names"),
        ({"time": [0.0], "start": np.zeros((1, 6, 3)), "end": np.zeros((1, 6, 3))}, "two samples"),
        ({"start": np.zeros((21, 0, 3)), "end": np.zeros((21, 0, 3)), "radius": [], "names": ()}, "capsule"),
    ],
    ids=str,
)
def test_an_unsound_recording_is_refused(change, word):
    with pytest.raises(RecordingError, match=word) as caught:
        dataclasses.replace(stroll(), **change)
    assert isinstance(caught.value, JSSAGymError)
    assert isinstance(caught.value, ValueError)


def test_every_truncation_of_a_file_is_a_typed_error(tmp_path):
    stroll(samples=3).save(tmp_path / "whole.npz")
    whole, cut = (tmp_path / "whole.npz").read_bytes(), tmp_path / "cut.npz"
    for length in range(0, len(whole), 61):
        cut.write_bytes(whole[:length])
        with pytest.raises(RecordingError, match=r"cut\.npz"):
            Recording.load(cut)
    for at in range(0, len(whole), 37):
        # a damaged byte is noticed, or it is one that nothing depends on
        cut.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        try:
            loaded = Recording.load(cut)
        except RecordingError:
            continue
        same(loaded, stroll(samples=3))


@pytest.mark.parametrize("header", [b"'shape': (10000000000000,)", b"'shape': (2, 3", b"'shape': (-2,)"])
def test_an_array_that_cannot_be_is_a_typed_error(tmp_path, header):
    """More than any memory holds, or no header that can be read."""
    text = b"{'descr': '<f8', 'fortran_order': False, " + header + b", }\n"
    content = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for field in ("time", "start", "end", "radius", "names"):
            archive.writestr(f"{field}.npy", content)
    with pytest.raises(RecordingError, match=r"a\.npz"):
        Recording.load(tmp_path / "a.npz")


def test_a_byte_order_mark_is_no_part_of_a_text(tmp_path):
    (tmp_path / "walk.csv").write_text(csv_of(stroll()), encoding="utf-8-sig")
    same(Recording.load(tmp_path / "walk.csv"), stroll())
    text = person(np.random.default_rng(0))[0]
    (tmp_path / "walk.bvh").write_text(text, encoding="utf-8-sig")
    assert bvh.read(tmp_path / "walk.bvh").names == bvh.parse(text).names


def test_no_pickle_is_loaded(tmp_path):
    values = {field: getattr(stroll(), field) for field in ("time", "start", "end", "radius")}
    np.savez(tmp_path / "a.npz", **values, names=np.array(NAMES, object))
    with pytest.raises(RecordingError):
        Recording.load(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", **values, names=np.arange(6))
    with pytest.raises(RecordingError, match="strings"):
        Recording.load(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", **values)
    with pytest.raises(RecordingError, match="names"):
        Recording.load(tmp_path / "c.npz")
    np.save(tmp_path / "d.npy", np.zeros(3))
    (tmp_path / "d.npy").rename(tmp_path / "d.npz")
    with pytest.raises(RecordingError):
        Recording.load(tmp_path / "d.npz")


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda text: "", "columns"),
        (lambda text: text.splitlines()[0], "two samples"),
        (lambda text: text.replace("time", "seconds", 1), "seconds"),
        (lambda text: text.replace("head.start.x", "head.start.q", 1), r"head\.start"),
        (lambda text: text.replace("head.radius", "head.width", 1), "head"),
        (lambda text: text + "1.0,2.0\n", "row 23"),
        (lambda text: text.replace("0.25", "wide"), "no number"),
        (lambda text: text.replace("0.25", "nan"), "same in every row|finite"),
        (lambda text: text.replace("0.25", "0.3", 1), "same in every row"),
        (lambda text: text[: len(text) // 2], "row"),
        (lambda text: "\0" + text, "columns|NUL"),
    ],
)
def test_a_malformed_table_is_refused(tmp_path, spoil, word):
    path = tmp_path / "walk.csv"
    path.write_text(spoil(csv_of(stroll())))
    with pytest.raises(RecordingError, match=word):
        Recording.load(path)


@pytest.mark.parametrize("name", ["nowhere.npz", "walk.txt", "walk"])
def test_a_file_that_is_not_there_or_of_another_kind_is_refused(tmp_path, name):
    with pytest.raises(RecordingError, match=name):
        Recorded(tmp_path / name)
    with pytest.raises(RecordingError, match="npz"):
        stroll().save(tmp_path / "walk.csv")
    with pytest.raises(RecordingError, match="folder"):
        stroll().save(tmp_path / "no" / "walk.npz")
    assert not list(tmp_path.iterdir())


# ---- playing ------------------------------------------------------------------------------------------


def play(motion, steps, dt=DT, seed=0, start=None):
    seen = [motion.reset(np.random.default_rng(seed), start)]
    return seen + [motion.step(dt, None) for _ in range(steps)]


@pytest.mark.parametrize("dt", [0.008, 0.013, 0.37])
def test_it_is_played_linearly_between_samples(dt):
    rng = np.random.default_rng(1)
    time = np.r_[0.0, np.cumsum(rng.uniform(0.02, 0.3, 12))]
    start, end = rng.normal(size=(2, 13, 2, 3)) + np.array([5.0, 0.0, 0.0])
    recording = Recording(time, start, end, [0.1, 0.2], ("one", "two"))
    steps = int(time[-1] / dt)
    seen = play(Recorded(recording, **still()), steps, dt)
    # one step later: everything stands still in the first
    for k, capsules in enumerate(seen[1:]):
        for field in ("start", "end"):
            for i, axis in itertools.product(range(2), range(3)):
                expected = np.interp(k * dt, time, getattr(recording, field)[:, i, axis])
                assert getattr(capsules, field)[i, axis] == pytest.approx(expected, abs=1e-12)
    np.testing.assert_array_equal(seen[0].start_velocity, 0.0)


def test_the_bound_is_the_fastest_of_the_data():
    recording = stroll(speed=0.7)
    assert recording.speed == pytest.approx(0.7, rel=1e-9)
    assert Recorded(recording).speed_bound == recording.speed
    end = recording.end.copy()
    end[10, 2] += [0.0, 0.3, 0.0]  # a hand that jumps for one sample: 0.3 m in 0.1 s, across the walk
    recording = dataclasses.replace(recording, end=end)
    assert recording.speed == pytest.approx(np.hypot(3.0, 0.7), rel=1e-9)
    expected = np.full((6, 2), 0.7)
    expected[2, 1] = np.hypot(3.0, 0.7)
    np.testing.assert_allclose(recording.end_speeds, expected, rtol=1e-9)


def test_what_comes_afterwards():
    line = stroll(speed=0.5, seconds=1.0, samples=11)

    def at(afterwards, time, recording=line):
        seen = play(Recorded(recording, **still(afterwards=afterwards)), round(time / 0.01) + 1, 0.01)
        return seen[-1].start[0, 0]

    assert at("hold", 0.7) == pytest.approx(1.85, abs=1e-9)
    assert at("hold", 5.0) == pytest.approx(2.0, abs=1e-9)
    assert at("back_and_forth", 1.3) == pytest.approx(1.85, abs=1e-9)
    assert at("back_and_forth", 2.3) == pytest.approx(1.65, abs=1e-9)
    with pytest.raises(ParameterError, match=r"0\.5 m off.*back_and_forth"):
        Recorded(line, afterwards="loop")
    there_and_back = dataclasses.replace(
        line, start=np.r_[line.start[:6], line.start[4::-1]], end=np.r_[line.end[:6], line.end[4::-1]]
    )
    assert at("loop", 0.3, there_and_back) == pytest.approx(1.65, abs=1e-9)
    assert at("loop", 3.3, there_and_back) == pytest.approx(1.65, abs=1e-9)
    assert at("loop", 3.8, there_and_back) == pytest.approx(1.6, abs=1e-9)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("afterwards", ["hold", "loop", "back_and_forth"])
def test_no_seam_is_faster_than_the_bound(afterwards):
    motion = Recorded(dataclasses.replace(Recording.load(REACH_AND_RETREAT)), afterwards=afterwards)
    for dt in (0.008, 0.03):
        seen = play(motion, int(20.0 / dt), dt)
        for now, then in itertools.pairwise(seen):
            np.testing.assert_allclose(now.end + dt * now.end_velocity, then.end, rtol=0.0, atol=1e-12)
        fastest = max(np.linalg.norm(c.end_velocity, axis=1).max() for c in seen)
        assert 0.9 * motion.speed_bound < fastest <= motion.speed_bound + 1e-12


def test_placement_is_drawn_or_given():
    recording = stroll()
    # a quarter turn about the base axis, then 0.2 m along y
    motion = Recorded(recording, turn=(np.pi / 2.0,) * 2, offset=((0.0, 0.0), (0.2, 0.2)))
    begun = motion.reset(np.random.default_rng(0))
    np.testing.assert_allclose(begun.start[0], [0.0, 1.7, 1.5], atol=1e-12)
    # the right arm, at +y of the body before, is at -x of it now
    np.testing.assert_allclose(begun.start[2], [-0.2, 1.7, 1.3], atol=1e-12)
    drawn = [Recorded(recording).reset(np.random.default_rng(seed)).start[0, :2] for seed in range(30)]
    bearings = np.arctan2(*np.array(drawn).T[::-1])
    assert bearings.min() < -0.3
    assert bearings.max() > 0.3
    # somebody told where to begin: turned until the root is in that direction
    begun = Recorded(recording).reset(np.random.default_rng(0), np.array([0.0, -2.0]))
    np.testing.assert_allclose(begun.start[0], [0.0, -2.0, 1.5], atol=1e-12)
    np.testing.assert_allclose(begun.start[2], [0.2, -2.0, 1.3], atol=1e-12)


def test_clearance_is_kept_between_the_samples_too():
    # two samples at either side of the base: the way between leads over it
    across = stroll(speed=3.0, seconds=1.0, samples=2, start=(-1.5, 0.1))
    with pytest.raises(ParameterError, match=r"0\.6 m"):
        Recorded(across, **still()).reset(np.random.default_rng(0))
    with pytest.raises(ParameterError, match=r"0\.10 m"):
        Recorded(across).check_start(np.array([-1.5, 0.1]))
    seen = play(Recorded(across, **still(clearance=0.0)), 10)
    assert len(seen) == 11


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"turn": (1.0, 0.0)}, "turn"),
        ({"turn": (np.nan, 0.0)}, "turn"),
        ({"offset": (0.0, 1.0, 2.0)}, "offset"),
        ({"offset": 0.1}, "offset"),
        ({"recording": 5}, "npz"),
        ({"offset": ((0.0, 1.0), (1.0, 0.0))}, "offset"),
        ({"afterwards": "explode"}, "back_and_forth"),
        ({"clearance": -1.0}, "clearance"),
    ],
    ids=str,
)
def test_bad_arguments_are_named(arguments, word):
    with pytest.raises(RecordingError if "recording" in arguments else ParameterError, match=word):
        Recorded(**arguments)


def test_an_environment_plays_a_file(tmp_path):
    stroll().save(tmp_path / "walk.npz")
    env = gym.make("jssa_gym/Home-v0", human=Recorded(tmp_path / "walk.npz"))
    env.reset(seed=0)
    before = env.unwrapped.scene.human.start[0, :2]
    for _ in range(126):
        env.step(np.zeros(6))
    after = env.unwrapped.scene.human.start[0, :2]
    assert np.linalg.norm(after - before) == pytest.approx(0.5, abs=1e-9)


# ---- BVH ----------------------------------------------------------------------------------------------

SMALL = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Neck
  {
    OFFSET 0 50 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Head
    {
      OFFSET 0 10 0
      CHANNELS 3 Yrotation Xrotation Zrotation
      End Site
      {
        OFFSET 0 20 0
      }
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.5
1 90 2 0 0 0 0 0 0 0 0 0
1 90 2 90 0 0 0 0 0 0 0 0
0 0 0 0 0 0 0 90 0 0 0 0
"""


def test_forward_kinematics_by_hand():
    skeleton = bvh.parse(SMALL)
    assert skeleton.names == ("Hips", "Neck", "Head")
    assert skeleton.parents == (-1, 0, 1)
    assert skeleton.frame_time == 0.5
    expected = [
        [[1, 90, 2], [1, 140, 2], [1, 150, 2]],
        # a quarter turn about z: up becomes -x
        [[1, 90, 2], [-49, 90, 2], [-59, 90, 2]],
        # the neck's quarter turn about x: up becomes +z, above it only
        [[0, 0, 0], [0, 50, 0], [0, 50, 10]],
    ]
    np.testing.assert_allclose(skeleton.positions(), expected, atol=1e-12)


PARENTS = {
    "Hips": None,
    "Spine": "Hips",
    "Neck": "Spine",
    "Head": "Neck",
    "RightShoulder": "Spine",
    "RightArm": "RightShoulder",
    "RightForeArm": "RightArm",
    "RightHand": "RightForeArm",
    "LeftShoulder": "Spine",
    "LeftArm": "LeftShoulder",
    "LeftForeArm": "LeftArm",
    "LeftHand": "LeftForeArm",
    "RightUpLeg": "Hips",
    "RightLeg": "RightUpLeg",
    "RightFoot": "RightLeg",
    "LeftUpLeg": "Hips",
    "LeftLeg": "LeftUpLeg",
    "LeftFoot": "LeftLeg",
}
# a person in centimetres, y up, looking along z: the right side is at -x
PLACES = {
    "Hips": (0, 90, 0), "Spine": (0, 110, 0), "Neck": (0, 140, 0), "Head": (0, 150, 0),
    "RightShoulder": (-5, 135, 0), "RightArm": (-20, 135, 0), "RightForeArm": (-45, 135, 0), "RightHand": (-70, 135, 0),
    "LeftShoulder": (5, 135, 0), "LeftArm": (20, 135, 0), "LeftForeArm": (45, 135, 0), "LeftHand": (70, 135, 0),
    "RightUpLeg": (-10, 85, 0), "RightLeg": (-10, 45, 0), "RightFoot": (-10, 8, 0),
    "LeftUpLeg": (10, 85, 0), "LeftLeg": (10, 45, 0), "LeftFoot": (10, 8, 0),
}  # fmt: skip


def person(rng, frames=5, size=60.0, prefix=""):
    """A BVH text of a whole person with random rotation orders and angles, and where scipy puts the joints."""
    orders = {name: "".join(rng.permutation(list("XYZ"))) for name in PARENTS}
    values = {name: rng.uniform(-size, size, (frames, 3)) for name in PARENTS}
    root = rng.uniform(-20.0, 20.0, (frames, 3))
    offsets = {n: np.subtract(PLACES[n], PLACES[p] if p else PLACES[n]).astype(float) for n, p in PARENTS.items()}
    root[:, 1] += 90.0

    def lines(name):
        yield f"{'JOINT' if PARENTS[name] else 'ROOT'} {prefix}{name}"
        yield "{"
        yield "OFFSET " + " ".join(str(x) for x in offsets[name])
        turns = " ".join(f"{axis}rotation" for axis in orders[name])
        yield f"CHANNELS 3 {turns}" if PARENTS[name] else f"CHANNELS 6 Xposition Yposition Zposition {turns}"
        children = [child for child, parent in PARENTS.items() if parent == name]
        for child in children:
            yield from lines(child)
        if not children:
            yield from ("End Site", "{", "OFFSET 0 1 0", "}")
        yield "}"

    def depth_first(name):
        yield name
        for child, parent in PARENTS.items():
            if parent == name:
                yield from depth_first(child)

    order = list(depth_first("Hips"))
    rows = np.concatenate([root, *(values[name] for name in order)], axis=1)
    text = "\n".join(
        ["HIERARCHY", *lines("Hips"), "MOTION", f"Frames: {frames}", "Frame Time: 0.04"]
        + [" ".join(repr(float(x)) for x in row) for row in rows]
    )
    places = {}
    turns = {}
    for name in order:
        # capital letters: about axes that turn along, as BVH has it
        own, parent = Rotation.from_euler(orders[name], values[name], degrees=True), PARENTS[name]
        places[name] = places[parent] + turns[parent].apply(offsets[name]) if parent else root
        turns[name] = turns[parent] * own if parent else own
    return text, order, places


def test_forward_kinematics_is_that_of_scipy():
    for seed in range(10):
        text, order, places = person(np.random.default_rng(seed), size=180.0)
        skeleton = bvh.parse(text)
        assert list(skeleton.names) == order
        expected = np.stack([places[name] for name in order], axis=1)
        np.testing.assert_allclose(skeleton.positions(), expected, atol=1e-10)


@pytest.mark.parametrize("prefix", ["", "mixamorig:"])
def test_a_skeleton_becomes_the_six_capsules(prefix):
    text, _, places = person(np.random.default_rng(3), size=15.0, prefix=prefix)
    recording = bvh.convert(bvh.parse(text), start=(1.4, 0.3))
    assert recording.names == NAMES
    np.testing.assert_array_equal(recording.radius, Body.facing().radius)
    np.testing.assert_allclose(recording.time, 0.04 * np.arange(5))
    joints = {
        "head": ("Head", "Head"),
        "core_body": ("Hips", "Neck"),
        "right_arm": ("RightArm", "RightHand"),
        "left_arm": ("LeftArm", "LeftHand"),
        "right_leg": ("RightUpLeg", "RightFoot"),
        "left_leg": ("LeftUpLeg", "LeftFoot"),
    }
    # heights are the file's, in metres; distances stay; the person looks along -x at first, from start
    for i, name in enumerate(NAMES):
        first, last = (places[joint] for joint in joints[name])
        np.testing.assert_allclose(recording.start[:, i, 2], first[:, 1] / 100.0, atol=1e-12)
        np.testing.assert_allclose(recording.end[:, i, 2], last[:, 1] / 100.0, atol=1e-12)
        length = np.linalg.norm(recording.end[:, i] - recording.start[:, 0], axis=1)
        np.testing.assert_allclose(length, np.linalg.norm(last - places["Head"], axis=1) / 100.0, atol=1e-12)
    np.testing.assert_allclose(recording.root[0], [1.4, 0.3], atol=1e-12)
    across = recording.start[0, NAMES.index("right_arm")] - recording.start[0, NAMES.index("left_arm")]
    assert across[0] == pytest.approx(0.0, abs=1e-12)
    assert across[1] > 0.3


def test_a_person_at_rest_is_turned_upright_and_to_the_arm():
    text, *_ = person(np.random.default_rng(0), size=1e-9)
    recording = bvh.convert(bvh.parse(text))
    right = NAMES.index("right_arm")
    for ours, theirs in ((recording.start[0, right], (0.0, 0.2)), (recording.end[0, right], (0.0, 0.7))):
        np.testing.assert_allclose(ours[:2] - recording.start[0, 0, :2], theirs, atol=1e-8)
    # no reflection: a hand held forwards, the file's +z, is held towards -x
    lines = text.splitlines()
    shoulder = [line for line in lines if "JOINT" in line or "ROOT" in line].index("JOINT RightArm")
    rows = [line.split() for line in lines[-5:]]
    for row in rows:
        row[3 + 3 * shoulder : 6 + 3 * shoulder] = ["0", "0", "0"]
    order = next(line for k, line in enumerate(lines) if lines[k - 3] == "JOINT RightArm").split()[2:]
    for row in rows:
        row[3 + 3 * shoulder + order.index("Yrotation")] = "90"
    turned = bvh.convert(bvh.parse("\n".join(lines[:-5] + [" ".join(row) for row in rows])))
    np.testing.assert_allclose(turned.end[0, right] - turned.start[0, right], [-0.5, 0.0, 0.0], atol=1e-7)


def test_other_names_units_and_axes(tmp_path):
    text, _, places = person(np.random.default_rng(3), size=15.0)
    (tmp_path / "walk.bvh").write_text(text.replace("RightHand", "Paw"))
    with pytest.raises(RecordingError, match=r"RightHand or RightWrist for right_arm.*Paw"):
        bvh.convert(tmp_path / "walk.bvh")
    recording = bvh.convert(tmp_path / "walk.bvh", joints={"right_arm": ("RightArm", "Paw")}, scale=0.1, up="z")
    right = NAMES.index("right_arm")
    np.testing.assert_allclose(recording.end[:, right, 2], places["RightHand"][:, 2] / 10.0, atol=1e-12)
    classic = text
    for name, other in (
        *(("RightShoulder", "RightCollar"), ("RightArm", "RightShoulder")),
        *(("LeftShoulder", "LeftCollar"), ("LeftArm", "LeftShoulder")),
        *(("Hand", "Wrist"), ("UpLeg", "Hip"), ("Foot", "Ankle")),
    ):
        classic = classic.replace(name, other)
    same(bvh.convert(bvh.parse(classic)), bvh.convert(bvh.parse(text)))
    bvh.convert(bvh.parse(text)).save(tmp_path / "walk.npz")
    assert Recorded(tmp_path / "walk.npz", clearance=0.0).speed_bound > 0.0


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda text: "", "HIERARCHY"),
        (lambda text: text.replace("HIERARCHY", "HIER"), "line 1"),
        (lambda text: text.replace("ROOT Hips", "ROOT"), "line 2: ROOT"),
        (lambda text: text.replace("OFFSET 0 50 0", "OFFSET 0 50"), "line 8"),
        (lambda text: text.replace("OFFSET 0 50 0", "OFFSET 0 high 0"), "line 8.*high"),
        (lambda text: text.replace("OFFSET 0 50 0", "OFFSET 0 nan 0"), "line 8.*finite"),
        (lambda text: text.replace("CHANNELS 6", "CHANNELS 5"), "line 5"),
        (lambda text: text.replace("Zposition", "Qposition"), "line 5"),
        (lambda text: text.replace("End Site", "Stop Site"), "line 14"),
        (lambda text: text.replace("MOTION", ""), "MOTION"),
        (lambda text: text.replace("Frames: 3", "Frames: 4"), "frame 4 of 4"),
        (lambda text: text.replace("Frames: 3", "Frames: 2"), "2 frames"),
        (lambda text: text.replace("Frames: 3", "Frames: many"), "many"),
        (lambda text: text.replace("Frames: 3", "Frames: 1.5"), "Frames"),
        (lambda text: text.replace("Time: 0.5", "Time: 0"), "positive"),
        (lambda text: text.replace("1 90 2 90", "1 90 2"), "11 values for 12"),
        (lambda text: text.replace("1 90 2 90", "1 90 2 inf"), "finite"),
        (lambda text: text[: text.index("JOINT Head")], "ends where"),
        (lambda text: "HIERARCHY\nROOT a\n" + "{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\nJOINT b\n" * 5000, "deep"),
    ],
)
def test_a_malformed_skeleton_is_refused(tmp_path, spoil, word):
    (tmp_path / "a.bvh").write_text(spoil(SMALL))
    with pytest.raises(RecordingError, match=word) as caught:
        bvh.read(tmp_path / "a.bvh")
    assert "a.bvh" in str(caught.value)


def test_bad_arguments_of_the_conversion_are_named(tmp_path):
    skeleton = bvh.parse(person(np.random.default_rng(0))[0])
    for arguments, word in (
        ({"scale": 0.0}, "scale"),
        ({"up": "x"}, "up"),
        ({"joints": {"tail": ("a", "b")}}, "tail"),
        ({"start": (1.0, np.nan)}, "start"),
        ({"joints": ["head"]}, "joints"),
        ({"joints": {"head": "Head"}}, "two joints"),
        ({"joints": {"head": ("Head", 5)}}, "two joints"),
    ):
        with pytest.raises(ParameterError, match=word):
            bvh.convert(skeleton, **arguments)
    with pytest.raises(RecordingError, match="two frames"):
        bvh.convert(dataclasses.replace(skeleton, frames=skeleton.frames[:1]))
    with pytest.raises(RecordingError, match="BVH file"):
        bvh.convert(5)
    with pytest.raises(RecordingError, match="nowhere"):
        bvh.convert(tmp_path / "nowhere.bvh")
