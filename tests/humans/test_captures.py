"""Motion capture in the dialects that are about, beside joints worked out by scipy."""

import numpy as np
import pytest
from gait import BODY, BVH_JOINTS, DIALECTS, bvh_text, joints_of, walk

from jssa_gym.exceptions import ParameterError, RecordingError
from jssa_gym.humans import Recorded, bvh, make_human
from jssa_gym.humans.body import NAMES
from jssa_gym.humans.bvh import UNITS, CaptureOptions, convert_told

SIX = {
    "head": ("head", "head"),
    "core_body": ("hips", "neck"),
    "right_arm": ("right upper arm", "right hand"),
    "left_arm": ("left upper arm", "left hand"),
    "right_leg": ("right thigh", "right foot"),
    "left_leg": ("left thigh", "left foot"),
}
JOINTED = {
    "head": ("head", "head"),
    "core_body": ("hips", "neck"),
    **{
        f"{side}_{part}": (f"{side} {one}", f"{side} {other}")
        for side in ("right", "left")
        for part, one, other in (
            ("upper_arm", "upper arm", "forearm"),
            ("forearm", "forearm", "hand"),
            ("hand", "hand", "hand end"),
            ("thigh", "thigh", "shin"),
            ("knee_to_ankle", "shin", "foot"),
            ("foot", "foot", "foot end"),
        )
    },
}


def check_places(recording, expected, ends, frames=slice(None)):
    """Every capsule's ends are at the joints: heights as they are, and all distances."""
    assert sorted(recording.names) == sorted(ends)
    ours = np.concatenate([recording.start, recording.end], axis=1)
    first, last = zip(*(ends[name] for name in recording.names), strict=True)
    theirs = np.stack([expected[joint] for joint in (*first, *last)], axis=1)[frames]
    np.testing.assert_allclose(ours[..., 2], theirs[..., 1], atol=1e-9)
    # one turn about the vertical and one way along the floor for all frames
    a, b = ours[..., 0] + 1j * ours[..., 1], theirs[..., 2] + 1j * theirs[..., 0]
    turn = (a[-1, 1] - a[0, 0]) / (b[-1, 1] - b[0, 0])
    assert abs(turn) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(a - a[0, 0], turn * (b - b[0, 0]), atol=1e-9)


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("unit", UNITS)
def test_unit_and_axis_are_told_from_the_skeleton(unit, up):
    motion = walk()
    made = convert_told(bvh.parse(bvh_text(*motion, unit=UNITS[unit], up=up)), CaptureOptions(start=(1.5, 0.0)))
    assert (made.up, made.dropped, made.unusual) == (up, 0, (unit, up) != ("cm", "y"))
    assert {"m": "metres", "in": "inches"}.get(unit, made.unit) == made.unit
    check_places(made.recording, joints_of(*motion), SIX)
    same = bvh.convert(bvh.parse(bvh_text(*motion, unit=UNITS[unit], up=up)), scale=unit, up=up)
    np.testing.assert_array_equal(same.end, made.recording.end)


def test_a_person_has_one_unit():
    """The tallest in one unit are smaller than the smallest in the next, whom one person's skeleton could be, too."""
    sizes = sorted(UNITS.values())
    assert min(np.divide(sizes[1:], sizes[:-1])) > 2.1
    for stature in np.linspace(0.65, 1.34, 8):  # of 1.56 m to the head
        motion = walk(frames=2)
        for unit, metres in UNITS.items():
            skeleton = bvh.parse(bvh_text(*motion, unit=metres / stature))
            assert convert_told(skeleton, CaptureOptions()).unit == bvh.guess.UNIT_NAMES[unit]


@pytest.mark.parametrize("dialect", DIALECTS)
def test_joints_are_known_by_the_names_of_common_dialects(dialect):
    motion = walk(frames=8)
    skeleton = bvh.parse(bvh_text(*motion, dialect=dialect))
    check_places(bvh.convert(skeleton), joints_of(*motion), SIX)
    check_places(bvh.convert(skeleton, body="jointed"), joints_of(*motion), JOINTED)


@pytest.mark.parametrize("placed", ["all", "zeros"])
def test_position_channels_stand_for_the_offset(placed):
    """They repeat it, and it counts once; nothing but zeros says nothing."""
    motion = walk(frames=8)
    made = convert_told(bvh.parse(bvh_text(*motion, placed=placed)), CaptureOptions())
    assert made.length == pytest.approx(1.556, abs=2e-3)
    check_places(made.recording, joints_of(*motion), SIX)


def test_position_channels_replace_the_offset_by_hand():
    text = """HIERARCHY
ROOT Hips
{
OFFSET 0 90 0
CHANNELS 3 Xposition Yposition Zposition
JOINT Neck
{
OFFSET 0 50 0
CHANNELS 3 Xposition Yposition Zposition
JOINT Head
{
OFFSET 1 10 2
CHANNELS 1 Yposition
End site
{
OFFSET 0 20 0
}
}
}
}
MOTION
Frames: 2
Frame Time: 0.5
0 90 0 0 50 0 0
5 91 0 0 49 1 12
"""
    skeleton = bvh.parse(text)
    expected = [[[0, 90, 0], [0, 140, 0], [1, 140, 2]], [[5, 91, 0], [5, 140, 1], [6, 152, 3]]]
    np.testing.assert_allclose(skeleton.positions(), expected, atol=1e-12)
    np.testing.assert_allclose(skeleton.points()[:, 3], [[1, 160, 2], [6, 172, 3]], atol=1e-12)


@pytest.mark.parametrize("site", ["End Site", "End site", "end site", "END SITE", "EndSite"])
def test_end_sites_in_any_case(site):
    motion = walk(frames=3)
    text = bvh_text(*motion, site=site)
    skeleton = bvh.parse(text)
    assert len(skeleton.tip_parents) == 5
    expected = joints_of(*motion)
    assert skeleton.point_names[18:] == tuple(
        f"the end site of {skeleton.names[skeleton.names.index(name)]}"
        for name in (BVH_JOINTS[joint] for joint in ("head", "right hand", "left hand", "right foot", "left foot"))
    )
    np.testing.assert_allclose(skeleton.points()[:, 18] / 100.0, expected["head end"], atol=1e-12)


def test_keywords_and_channels_in_any_case():
    text = bvh_text(*walk(frames=3))
    other = text.replace("HIERARCHY", "Hierarchy").replace("JOINT", "Joint").replace("rotation", "Rotation")
    other = other.replace("CHANNELS", "Channels").replace("Frame Time", "frame time").replace("MOTION", "Motion")
    np.testing.assert_array_equal(bvh.parse(other).positions(), bvh.parse(text).positions())


# ---- what cannot be told ------------------------------------------------------------------------------


def test_a_skeleton_of_no_persons_size_is_refused_with_advice(tmp_path):
    (tmp_path / "doll.bvh").write_text(bvh_text(*walk(frames=4), unit=0.2))
    with pytest.raises(RecordingError, match=r"doll\.bvh: the unit cannot be told: .*7\.7\d? m in metres.*scale=0\.19"):
        make_human(str(tmp_path / "doll.bvh"))
    recording = bvh.convert(tmp_path / "doll.bvh", scale=0.2)
    assert recording.start[0, 0, 2] == pytest.approx(1.58, abs=0.01)


@pytest.mark.parametrize(
    ("tip", "word"),
    [
        ((0.0, 0.0, 90.0), "along -x, which has to be y or z"),
        ((180.0, 0.0, 0.0), "along -y, which has to be y or z"),
        ((44.0, 0.0, 0.0), "along neither y nor z"),
    ],
)
def test_an_axis_that_cannot_be_told_is_refused_with_advice(tip, word):
    angles, hips = walk(frames=6)
    angles["hips"][:] = tip
    skeleton = bvh.parse(bvh_text(angles, hips))
    with pytest.raises(RecordingError, match=f"{word}.*give up, 'y' or 'z'"):
        bvh.convert(skeleton)
    if tip[2] == 0.0:
        assert bvh.convert(skeleton, up="y").names == NAMES


@pytest.mark.parametrize("scale", ["km", "AUTO", True, -1.0, np.nan])
def test_a_scale_is_a_unit_or_a_length(scale):
    with pytest.raises(ParameterError, match="scale"):
        bvh.convert(bvh.parse(bvh_text(*walk(frames=3))), scale=scale)


# ---- frames -------------------------------------------------------------------------------------------


def with_pose(frames, count=1, *, away=(0.0, 0.0, 0.0), rest=True):
    """A walk that begins with frames of a T in its place moved by ``away`` [m]."""
    angles, hips = walk(frames=frames)
    for joint in BODY:
        angles[joint][:count] = 0.0
    if not rest:
        angles["right upper arm"][:count] = [3.0, 4.0, 2.0]
    hips[:count] = np.array([0.0, 0.95, 0.0]) + away
    return angles, hips


@pytest.mark.parametrize("rest", [True, False], ids=["rest pose", "T by hand"])
@pytest.mark.parametrize("count", [1, 5])
def test_a_pose_for_calibration_is_left_out_and_told(count, rest):
    motion = with_pose(20, count, away=(2.2, 0.0, 0.0), rest=rest)
    skeleton = bvh.parse(bvh_text(*motion))
    made = convert_told(skeleton, CaptureOptions())
    assert (made.dropped, made.first, len(made.recording.time)) == (count, count, 20 - count)
    assert made.recording.time[0] == 0.0
    assert made.recording.speed < 5.0
    check_places(made.recording, joints_of(*motion), SIX, slice(count, None))
    with pytest.warns(UserWarning, match="a pose for calibration"):
        bvh.convert(skeleton)
    # who says which frames gets those
    assert len(bvh.convert(skeleton, frames=(0, None)).time) == 20
    assert bvh.convert(skeleton, frames=(0, None)).speed > 50.0


def test_a_pose_that_the_motion_goes_on_from_stays():
    angles, hips = walk(frames=30, rate=30.0)
    ramp = np.minimum(np.arange(30) / 15.0, 1.0)[:, None]
    angles = {joint: ramp * values for joint, values in angles.items()}
    made = convert_told(bvh.parse(bvh_text(angles, hips)), CaptureOptions())
    assert made.dropped == 0
    # nor does a jump from a pose in which nobody is calibrated
    angles, hips = walk(frames=30)
    hips[:1] += [3.0, 0.0, 0.0]
    assert convert_told(bvh.parse(bvh_text(angles, hips)), CaptureOptions()).dropped == 0


def test_frames_are_chosen():
    motion = walk(frames=20)
    skeleton = bvh.parse(bvh_text(*motion))
    for frames, chosen in (((4, 9), slice(4, 9)), ((None, 5), slice(0, 5)), ((15, None), slice(15, 20))):
        recording = bvh.convert(skeleton, frames=frames)
        check_places(recording, joints_of(*motion), SIX, chosen)
        np.testing.assert_allclose(recording.root[0], [1.5, 0.0], atol=1e-12)


@pytest.mark.parametrize("frames", [(5, 6), (9, 4), (-3, 9), (0, 21), (0.0, 5), (1, 2, 3), 5, "4:9"])
def test_frames_that_are_not_there_are_refused(frames):
    with pytest.raises(ParameterError, match="the file has 20"):
        bvh.convert(bvh.parse(bvh_text(*walk(frames=20))), frames=frames)


# ---- bodies -------------------------------------------------------------------------------------------


def outside(recording, points):
    """How far points (T, 3) are outside of all capsules at most, by brute force along their axes [m]."""
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    worst = -np.inf
    for k, point in enumerate(points):
        gaps = [
            np.linalg.norm(a + share * (b - a) - point, axis=1).min() - r
            for a, b, r in zip(recording.start[k], recording.end[k], recording.radius, strict=True)
        ]
        worst = max(worst, min(gaps))
    return worst


def test_a_jointed_body_covers_what_one_capsule_a_limb_does_not():
    motion = walk(frames=12, elbow=100.0, bend=80.0)
    skeleton = bvh.parse(bvh_text(*motion))
    six, jointed = (convert_told(skeleton, CaptureOptions(body=body)) for body in ("six", "jointed"))
    for made in (six, jointed):
        told = made.outside()
        for name, points in zip(made.point_names, np.moveaxis(made.points, 1, 0), strict=True):
            assert told.get(name, 0.0) == pytest.approx(max(outside(made.standing, points), 0.0), abs=1e-4)
    assert six.outside()[BVH_JOINTS["right shin"]] > 0.1
    assert six.outside()["the end site of mixamorig:RightFoot"] > 0.1
    assert max(jointed.outside().values(), default=0.0) < 0.01
    # capsules are as long as the bones
    recording = jointed.recording
    for name, length in (("right_upper_arm", 0.28), ("left_forearm", 0.25), ("right_thigh", 0.42), ("left_hand", 0.18)):
        i = recording.names.index(name)
        assert np.linalg.norm(recording.end[:, i] - recording.start[:, i], axis=1) == pytest.approx(length, abs=1e-9)


def test_hands_without_a_length_get_one_and_feet_without_one_end_at_the_ankle():
    motion = walk(frames=4)
    text = bvh_text(*motion)
    for tip in ("-18.0 0.0 0.0", "18.0 0.0 0.0", "0.0 -6.0 20.0"):
        assert tip in text
        text = text.replace(f"OFFSET {tip}", "OFFSET 0 0 0")
    recording = bvh.convert(bvh.parse(text), body="jointed")
    assert bvh.convert(bvh.parse(text)).names == NAMES
    hand, forearm, foot = (recording.names.index(f"right_{part}") for part in ("hand", "forearm", "foot"))
    along = recording.end[:, forearm] - recording.start[:, forearm]
    np.testing.assert_allclose(recording.end[:, hand] - recording.start[:, hand], 0.74 * along, atol=1e-12)
    np.testing.assert_array_equal(recording.end[:, foot], recording.start[:, foot])


def test_a_limb_without_a_joint_between_is_refused():
    skeleton = bvh.parse(bvh_text(*walk(frames=3)))
    joints = {"right_arm": ("mixamorig:RightForeArm", "mixamorig:RightHand")}
    with pytest.raises(RecordingError, match=r"no joint between .*RightForeArm.*'six'"):
        bvh.convert(skeleton, joints=joints, body="jointed")
    with pytest.raises(ParameterError, match="valid: six, jointed"):
        bvh.convert(skeleton, body="seven")


def test_a_capture_is_played_as_it_is(tmp_path):
    path = tmp_path / "walk.BVH"
    path.write_text(bvh_text(*walk(frames=30)))
    assert Recorded(path).recording.names == NAMES
    path.write_text(bvh_text(*walk(frames=30), unit=0.0254, up="z"))
    with pytest.warns(UserWarning, match="inches with z up: 1.5"):
        Recorded(path)
