"""``jssa-gym recording`` and ``--human FILE``: what is said of recorded people, and that they play."""

import json
import math
import re

import gymnasium as gym
import numpy as np
import pytest
from commands import one_line
from gait import bvh_text, joints_of, walk

import jssa_gym
from jssa_gym.evaluation.campaign import Campaign, Grid
from jssa_gym.evaluation.contenders import within_assumptions
from jssa_gym.evaluation.study import Single, Study
from jssa_gym.exceptions import ParameterError, RecordingError
from jssa_gym.humans import Body, Crowd, Recorded, Recording, make_human
from jssa_gym.humans.body import NAMES
from jssa_gym.safety.failsafe import LEG_SPEEDS, FailsafeParams
from jssa_gym.safety.speeds import legs_of_feet, part_speeds, sufficient, time_beyond
from jssa_gym.types import Status

RATE = 120.0
MOTION = walk(frames=480, rate=RATE)
"""A gait of four seconds: 1.2 m/s, feet at 3.7 m/s."""


def write(path, motion=MOTION, **options):
    path.write_text(bvh_text(*motion, rate=RATE, **options))
    return path


def speeds(joint):
    """Of a joint from frame to frame [m/s]."""
    return RATE * np.linalg.norm(np.diff(joints_of(*MOTION)[joint], axis=0), axis=1)


def stander(path):
    """Somebody who stands in front of the arm, as a recording."""
    body = Body.facing()
    place = np.array([1.2, 0.0, 0.0])
    Recording([0.0, 8.0], [body.start + place] * 2, [body.end + place] * 2, body.radius, NAMES).save(path)
    return path


# ---- check --------------------------------------------------------------------------------------------


def test_check_says_all_of_a_gait(tmp_path, here):
    path = write(tmp_path / "walk.bvh", unit=0.0254, up="z", dialect="biped")
    run = here("recording", "check", path, "--json")
    assert run.returncode == 1, run.stderr
    told = json.loads(run.stdout)
    expected = joints_of(*MOTION)
    assert told["read_as"] == {"unit": "inches", "up": "z", "first_frame": 0, "dropped": 0}
    assert (told["samples"], told["duration"]) == (480, pytest.approx(479 / RATE))
    assert told["head"] == pytest.approx(np.median(expected["head"][:, 1]), abs=1e-9)
    lowest = np.minimum(expected["right foot"][:, 1], expected["left foot"][:, 1])
    assert told["lowest"] == pytest.approx(np.median(lowest), abs=1e-9)
    assert told["findings"] == []
    parts = {part["name"]: part for part in told["parts"]}
    leg = np.maximum(speeds("right foot"), speeds("right thigh"))
    assert parts["right_leg"]["speed"] == pytest.approx(leg.max(), rel=1e-9)
    assert parts["right_leg"]["time"] == pytest.approx((int(leg.argmax()) + 1) / RATE)
    assert parts["right_leg"]["beyond"] == pytest.approx((leg > 1.6).mean(), abs=1e-9)
    assert parts["right_arm"]["beyond"] == 0.0
    fast = np.max([speeds(joint) for joint in ("right foot", "left foot", "right thigh", "left thigh")], axis=0)
    assert told["beyond"] == pytest.approx((fast > 1.6).mean(), abs=1e-9)
    params = FailsafeParams(**told["sufficient"])
    assert all(part["speed"] <= params.speed_of(name) for name, part in parts.items())
    assert told["legs_of_feet"] == ["right_leg", "left_leg"]
    assert any("R Foot" in name and far > 0.1 for name, far in told["outside"].items())


def test_check_says_it_in_words(tmp_path, here):
    path = write(tmp_path / "walk.bvh")
    run = here("recording", "check", path)
    assert run.returncode == 1
    for word in (
        "walk.bvh: 480 frames in 3.99 s, 120 a second; 6 capsules",
        "taken as centimetres with y up: 1.5",
        "head 1.56 m above the floor",
        "failsafe=FailsafeParams(end_speeds=LEG_SPEEDS) (jssa_gym.safety.failsafe has LEG_SPEEDS: hips walk, ",
        "Recorded(FILE, pace=0.4",
        "outside of all capsules by up to: the end site of mixamorig:RightFoot 0.11 m",
        "--body jointed",
    ):
        assert word in run.stdout
    run = here("recording", "check", path, "--body", "jointed", "--frames", "120:240", "--scale", "0.01", "--up", "y")
    assert "120 frames" in run.stdout
    assert "14 capsules" in run.stdout
    assert "outside" not in run.stdout


def test_nothing_to_change_is_exit_code_0(tmp_path, here):
    run = here("recording", "check", stander(tmp_path / "still.npz"))
    assert (run.returncode, run.stderr) == (0, "")
    assert "nothing to change" in run.stdout
    assert "head 1.50 m above the floor, what is lowest 0.10 m" in run.stdout


def test_a_jump_is_told_and_exit_code_1(tmp_path, here):
    angles, hips = walk(frames=480, rate=RATE)
    hips[200:] += [0.0, 0.0, 2.0]
    run = here("recording", "check", write(tmp_path / "walk.bvh", (angles, hips)), "--frames", "100:")
    assert run.returncode == 1
    assert "- frame 200, head.start." in run.stdout
    assert "jumps by 2.01 m within 0.00833 s" in run.stdout


@pytest.mark.sampled(10)
@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("nowhere.bvh",), "no recording at nowhere.bvh"),
        (("walk.txt",), ".npz, .csv, .bvh"),
        (("walk.bvh", "--frames", "7"), "frames has to be A:B"),
        (("walk.bvh", "--frames", "-1:7"), "frames has to be A:B"),
        (("walk.bvh", "--frames", "0:999"), "the file has 480"),
        (("walk.bvh", "--scale", "furlongs"), "scale has to be auto, m, cm, mm, in, cmu"),
        (("walk.bvh", "--scale", "-1"), "scale"),
        (("still.npz", "--scale", "cm"), "for motion capture, .bvh; got still.npz"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
@pytest.mark.parametrize("action", ["check", "convert"])
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, here, action, arguments, word):
    write(tmp_path / "walk.bvh")
    stander(tmp_path / "still.npz")
    file, *options = arguments
    out = ("out.npz",) if action == "convert" else ()
    assert word in one_line(here("recording", action, file, *out, *options, cwd=tmp_path))
    assert not (tmp_path / "out.npz").exists()


def test_convert_writes_what_was_read(tmp_path, here):
    run = here(
        "recording", "convert", write(tmp_path / "walk.bvh"), tmp_path / "out.npz", "--body", "jointed", "--pace", "0.5"
    )
    assert run.returncode == 0, run.stderr
    assert "taken as centimetres with y up" in run.stderr
    written, read = Recording.load(tmp_path / "out.npz"), make_human(tmp_path / "walk.bvh").recording
    assert len(written.names) == 14
    np.testing.assert_array_equal(written.start[:, 0], read.start[:, 0])
    np.testing.assert_allclose(written.time, read.time * 2.0)


# ---- speeds -------------------------------------------------------------------------------------------


def test_the_speeds_that_suffice_are_the_fewest():
    body, time = Body.facing(), np.array([0.0, 1.0, 2.0])
    start = np.repeat(body.start[None] + [3.0, 0.0, 0.0], 3, axis=0)
    end = np.repeat(body.end[None] + [3.0, 0.0, 0.0], 3, axis=0)
    end[1, NAMES.index("right_arm"), 1] += 2.35
    recording, params = Recording(time, start, end, body.radius, NAMES), FailsafeParams()
    parts = {part.name: part for part in part_speeds(recording, params)}
    assert parts["right_arm"].speed == pytest.approx(2.35)
    assert parts["right_arm"].excess == pytest.approx(0.35)
    assert (parts["right_arm"].beyond, parts["left_arm"].excess) == (1.0, 0.0)
    assert time_beyond(recording, params) == 1.0
    assert sufficient(list(parts.values()), params) == {"limb_speed": 2.4}
    end[1, NAMES.index("head"), 1] += 1.9
    recording = Recording(time, start, end, body.radius, NAMES)
    assert sufficient(part_speeds(recording, params), params) == {"limb_speed": 2.4, "human_speed": 1.9}


@pytest.mark.parametrize(
    ("speeds", "legs"),
    [
        ({"right_leg": (1.0, 3.9), "left_leg": (1.5, 4.7)}, ("right_leg", "left_leg")),
        ({"right_leg": (1.0, 1.5), "left_leg": (1.5, 4.7)}, ("left_leg",)),
        ({"right_leg": (1.7, 3.9), "left_leg": (1.5, 4.7)}, ()),  # a hip that runs
        ({"right_leg": (1.0, 4.9), "left_leg": (1.5, 4.7)}, ()),  # a foot that kicks
        ({"right_leg": (1.0, 1.5), "right_arm": (1.0, 4.7)}, ()),
    ],
)
def test_a_leg_that_is_too_fast_at_its_foot_alone_needs_bounds_of_its_own(speeds, legs):
    body = Body.facing()
    start, end = (np.repeat(ends[None] + [3.0, 0.0, 0.0], 2, axis=0) for ends in (body.start, body.end))
    for name, (near, far) in speeds.items():
        start[1, NAMES.index(name), 1] += near
        end[1, NAMES.index(name), 1] += far
    recording = Recording(np.array([0.0, 1.0]), start, end, body.radius, NAMES)
    assert legs_of_feet(recording, FailsafeParams()) == legs


# ---- wherever a name does -----------------------------------------------------------------------------


def test_a_file_is_a_human_in_an_environment(tmp_path):
    path = write(tmp_path / "walk.bvh")
    for given in (str(path), path):
        env = gym.make("jssa_gym/Home-v0", human=given)
        env.reset(seed=0)
        assert env.unwrapped.scene.human.names == NAMES
    crowd = make_human([str(path), "walk_by"])
    assert isinstance(crowd, Crowd)
    assert crowd.people == 2
    path = write(tmp_path / "inches.bvh", unit=0.0254)
    with pytest.warns(UserWarning, match=r"inches\.bvh: taken as inches with y up"):
        gym.make("jssa_gym/Home-v0", human=path)


@pytest.mark.parametrize("heading", [0.0, 90.0])
def test_who_walks_at_the_arm_is_put_beside_it(tmp_path, heading):
    """A gait of five metres would lead over the base: all of what is drawn keeps its distance."""
    angles, hips = walk(frames=480, rate=RATE)
    if heading:  # along the file's x: across
        hips = hips[:, [2, 1, 0]]
    motion = make_human(write(tmp_path / "walk.bvh", (angles, hips)))
    for seed in range(20):
        people = motion.reset(np.random.default_rng(seed))
        for _ in range(math.ceil(480 / RATE / 0.008)):
            people = motion.step(0.008, people)
            assert math.hypot(*people.start[0, :2]) >= 0.6
    nearest = np.hypot(*motion.recording.root.T).min()
    assert nearest == pytest.approx(0.75, abs=0.01) if not heading else nearest >= 0.75 - 1e-6


def test_a_pace_slows_down_all_that_is_played(tmp_path):
    path = write(tmp_path / "walk.bvh")
    slow, usual = Recorded(path, pace=0.5), Recorded(path)
    assert slow.speed_bound == pytest.approx(0.5 * usual.speed_bound)
    assert slow.recording.duration == pytest.approx(2.0 * usual.recording.duration)
    with pytest.raises(ParameterError, match="pace"):
        Recorded(path, pace=0.0)


def play(human, ticks=480, **options):
    """Status of every tick of a shielded arm at home that is asked to stay there."""
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human=human, terminate_on=()), **options)
    env.reset(seed=0)
    return np.array([env.step(np.zeros(6))[4]["shield/status"] for _ in range(ticks)])


@pytest.mark.long
def test_a_gait_stops_a_shield_that_assumes_less_until_one_does_as_was_said(tmp_path, here):
    path = write(tmp_path / "walk.bvh")
    assert (play(path) == Status.FAULT).sum() > 200
    said = here("recording", "check", path).stdout
    assert "failsafe=FailsafeParams(end_speeds=LEG_SPEEDS)" in said
    assert (play(path, failsafe=FailsafeParams(end_speeds=LEG_SPEEDS)) == Status.FAULT).sum() == 0
    speeds = json.loads(here("recording", "check", path, "--json").stdout)["sufficient"]
    assert (play(path, failsafe=FailsafeParams(**speeds)) == Status.FAULT).sum() == 0
    pace = float(re.search(r"pace=([\d.]+)", said)[1])
    assert (play(Recorded(path, pace=pace)) == Status.FAULT).sum() == 0


def test_evaluations_and_campaigns_take_files(tmp_path):
    path = str(stander(tmp_path / "still.npz"))
    study = Study(("home",), ("none",), (path,), ("hold",), episodes=1, steps=3)
    (cell,) = study.seeds()
    assert isinstance(study.make_env(cell).unwrapped.human, Recorded)
    grid = Grid(("none",), (path, "walk_by"), ("hold",), episodes=1)
    campaign = Campaign((grid,), steps=3)
    assert isinstance(campaign.make_env(next(iter(grid.cells()))).unwrapped.human, Recorded)
    # another file of that name is another evaluation
    single = Single("jssa_gym/Home-v0", "hold", {"human": [tmp_path / "still.npz", "walk_by"]})
    before = study.config(), campaign.config(), single.config()
    assert json.loads(json.dumps(before[0]["people"])) == {path: before[0]["people"][path]}
    write(tmp_path / "walk.bvh")
    Recorded(tmp_path / "walk.bvh").recording.save(path)
    assert study.config() != before[0]
    assert campaign.config() != before[1]
    assert single.config() != before[2]
    assert "people" not in Study(("home",), ("none",), ("walk_by",), ("hold",)).config()
    with pytest.raises(RecordingError, match="no recording at"):
        Study(("home",), ("none",), (path + ".npz",), ("hold",))
    with pytest.raises(ParameterError, match="unknown human"):
        Study(("home",), ("none",), ("walk",), ("hold",))


def test_files_of_people_faster_than_assumed_break_the_assumption(tmp_path):
    assert within_assumptions(str(stander(tmp_path / "still.npz")), "none")
    assert not within_assumptions(str(write(tmp_path / "walk.bvh")), "none")


@pytest.mark.long
def test_people_from_a_file_are_evaluated_and_played_again(tmp_path, here):
    path = stander(tmp_path / "still.npz")
    out = tmp_path / "out"
    common = ("--task", "home", "--filter", "jssa+stop", "--policy", "hold", "--seconds", "0.4", "--episodes", "1")
    run = here("evaluate", *common, "--human", path, "--out", out, "--json")
    assert run.returncode == 0, run.stderr
    assert json.loads((out / "campaign.json").read_text())["humans"] == [str(path)]
    (trace,) = (out / "traces").glob("*.npz")
    again = ("replay", trace, "--no-figure", "--no-video", "--again")
    assert f"repeat it: --human {path}" in one_line(here(*again))
    run = here(*again, "--human", path)
    assert run.returncode == 0, run.stderr
    assert "the same bit for bit" in run.stdout
