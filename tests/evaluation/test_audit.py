"""Audits: what is found of a log is what the environment says of the same episode; bad files are named."""

import csv
import dataclasses
import functools
import json
import sys
import types

import numpy as np
import pytest

from jssa_gym.envs.arm import ArmEnv
from jssa_gym.evaluation.audit import PersonTrack, RobotLog, audit, read_log, read_person
from jssa_gym.evaluation.audit.motion import gaps_of, stretches
from jssa_gym.evaluation.audit.page import page, summary_line
from jssa_gym.evaluation.audit.result import FIGURES, write_safe_trajectory
from jssa_gym.evaluation.audit.shadow import plan_of
from jssa_gym.evaluation.geometry import geometry
from jssa_gym.evaluation.metrics import SeparationParams, separation_margin, summarise
from jssa_gym.evaluation.policy import make_policy
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.evaluation.study import put_filter
from jssa_gym.exceptions import LogError, MissingExtraError, ParameterError, RecordingError
from jssa_gym.humans import Recording
from jssa_gym.perception import SKELETONS
from jssa_gym.perception.files import capsules_of, read_keypoints
from jssa_gym.perception.synthetic import keypoints_of
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.types import CapsuleSet, Status

DT = 0.008


@functools.cache
def episode(filter=None, human="hand", policy="wander", seed=3, steps=380):
    """An episode of the environment's, its robot, and what the environment's own machinery says of it."""
    base = ArmEnv("reach", human=human, terminate_on=())
    env = base if filter is None else put_filter(base, filter)
    trace = rollout(env, make_policy(policy, base, seed, seen=env), seed=seed, steps=steps)
    seen = geometry(trace, base.robot)
    return trace, base.robot, summarise(trace, base.robot.limits, seen), seen


def log_of(trace, kinds=3):
    names = ("position", "velocity", "acceleration")[:kinds]
    states = [np.concatenate([trace.initial_state[i][None], getattr(trace, name)]) for i, name in enumerate(names)]
    return RobotLog(np.concatenate([[0.0], trace.time]), *states)


def person_of(trace, name="person"):
    start, end = (
        np.concatenate([trace.initial_human[i][None], ends])
        for i, ends in enumerate((trace.human_start, trace.human_end))
    )
    time = np.concatenate([[0.0], trace.time])
    return PersonTrack(name, Recording(time, start, end, trace.human_radius, trace.human_names), ())


def audited(trace, robot, kinds=3, **options):
    return audit(log_of(trace, kinds), [person_of(trace)], robot, **options)


# ---- agreement ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("filter", [None, "jssa+stop"])
def test_an_audit_agrees_with_the_environments_own_metrics(filter):
    trace, robot, own, seen = episode(filter)
    found = audited(trace, robot)
    (one,) = found.stretches
    np.testing.assert_array_equal(one.logged.distance, trace.distance)
    np.testing.assert_array_equal(one.logged.contact_speed, trace.contact_speed)
    np.testing.assert_array_equal(one.logged.pair, trace.pair)
    np.testing.assert_array_equal(one.logged.limit_violation, trace.limit_violation)
    np.testing.assert_array_equal(one.margins[0], separation_margin(seen, SeparationParams()))
    for name in FIGURES:
        ours, theirs = getattr(one.summaries[0], name), getattr(own, name)
        assert ours == (pytest.approx(theirs, rel=1e-12, abs=1e-12) if isinstance(theirs, float) else theirs), name
    assert own.collision or filter is not None  # something happens in it
    k = int(trace.distance.argmin())
    closest = found.closest(0)
    assert (closest.time, closest.distance) == (trace.time[k], trace.distance[k])
    assert closest.approach == pytest.approx(-trace.speed[k], abs=1e-9)
    if trace.contact[k]:
        # the nearest point of several that touch is no faster than the fastest
        assert closest.speed <= trace.contact_speed.max() + 1e-9


def test_positions_alone_give_the_same_but_for_rounding():
    trace, robot, own, _ = episode("jssa+stop")
    for kinds in (1, 2):
        one = audited(trace, robot, kinds).stretches[0].logged
        inner = slice(25, -25)  # of positions alone the outermost pieces of the spline are guessed
        assert np.abs(one.acceleration - trace.acceleration)[inner].max() < 1e-5
        np.testing.assert_allclose(one.velocity[inner], trace.velocity[inner], atol=1e-7)
        np.testing.assert_array_equal(one.distance, trace.distance)
    assert own.min_distance == trace.distance.min()


def test_the_shield_of_an_audit_is_that_of_the_environment_until_it_intervenes():
    # the same jerks as nominals in both: the first tick that is not left alone, and why
    trace, robot, _, _ = episode(None, human="walk_by", policy="jpc", seed=11)
    base = ArmEnv("reach", human="walk_by", terminate_on=())
    env = put_filter(base, "jssa+stop")
    for seed in range(11, 20):
        trace, robot, _, _ = episode(None, human="approach_retreat", policy="jpc", seed=seed)
        base = ArmEnv("reach", human="approach_retreat", terminate_on=())
        env = put_filter(base, "jssa+stop")
        env.reset(seed=seed)
        first, reason = None, ""
        for k, jerk in enumerate(trace.jerk):
            *_, info = env.step(jerk / robot.limits.jerk)
            if info["shield/status"] != Status.NOMINAL:
                first, reason = k, info["shield/reason"]
                break
        found = audited(trace, robot).stretches[0].safe
        changed = np.flatnonzero(found.status != Status.NOMINAL)
        if first is None:
            assert not len(changed)
            continue
        assert changed[0] == first
        np.testing.assert_allclose(found.position[:first], trace.position[:first], atol=1e-9)
        assert reason
        return
    raise AssertionError("in no episode did the shield have anything to do")


def test_the_safe_trajectory_keeps_the_promise_where_the_log_breaks_it():
    trace, robot, own, _ = episode(None)
    assert own.moving_contact
    found = audited(trace, robot)
    logged, safe = found.totals()
    assert logged["moving_contact"]
    assert found.interventions
    assert not safe["moving_contact"]
    assert safe["limit_violation_rate"] == 0.0
    assert found.lateness > 0.0
    assert found.held > 0.0
    # what it is made of is Eq. (1), from step to step
    one = found.stretches[0].safe
    states = np.concatenate([one.initial_state[None], np.stack([one.position, one.velocity, one.acceleration], 1)])
    q, v, a = states[:-1].transpose(1, 0, 2)
    np.testing.assert_allclose(q + DT * v + DT**2 / 2 * a + DT**3 / 6 * one.jerk, one.position, atol=1e-12)


def test_without_people_nothing_is_in_the_way():
    trace, robot, _, _ = episode("jssa+stop", policy="jpc", human="walk_by")
    found = audit(log_of(trace), [], robot)
    assert found.closest(0) is None
    assert not found.interventions
    assert found.lateness == pytest.approx(0.0, abs=1e-9)
    assert "would not have intervened" in summary_line(found)
    np.testing.assert_allclose(found.stretches[0].safe.position, trace.position, atol=1e-6)


def test_a_log_beyond_the_limits_is_followed_within_them():
    trace, robot, _, _ = episode("jssa+stop")
    noisy = log_of(trace, 1)
    rng = np.random.default_rng(0)
    log = RobotLog(noisy.time, noisy.position + rng.normal(0.0, 1e-4, noisy.position.shape))
    found = audit(log, [person_of(trace)], robot)
    (one,) = found.stretches
    assert one.summaries[0].limit_violation_rate > 0.5  # its spline's jerks are noise
    assert one.summaries[1].limit_violation_rate == 0.0
    assert 0.0 < one.off < 0.05
    plan, off = plan_of(
        np.concatenate(
            [
                one.logged.initial_state[None],
                np.stack([one.logged.position, one.logged.velocity, one.logged.acceleration], 1),
            ]
        ),
        DT,
        robot,
    )
    assert plan.keeps(robot.limits, 1e-6)
    assert off == one.off


# ---- time --------------------------------------------------------------------------------------------


def test_stamps_off_the_grid_are_resampled_by_the_stated_rule():
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.004, 0.02, 400))
    angle = np.outer(np.sin(time), np.arange(1, 7) / 6.0)
    rate = np.outer(np.cos(time), np.arange(1, 7) / 6.0)
    for log, most in ((RobotLog(time, angle), 1e-6), (RobotLog(time, angle, rate), 1e-7)):
        (one,) = stretches(log, [], [], DT)
        np.testing.assert_allclose(np.diff(one.time), DT, atol=1e-9)
        assert one.time[0] == time[0]
        inner = slice(10, -10)
        wanted = np.outer(np.sin(one.time), np.arange(1, 7) / 6.0)
        assert np.abs(one.states[inner, 0] - wanted[inner]).max() < most


def test_a_gap_is_a_gap():
    trace, robot, _, _ = episode("jssa+stop")
    whole = log_of(trace)
    keep = np.ones(len(whole.time), np.bool_)
    keep[120:150] = False  # 0.248 s
    cut = RobotLog(*(getattr(whole, name)[keep] for name in ("time", "position", "velocity", "acceleration")))
    found = audit(cut, [person_of(trace)], robot)
    assert [(gap.of, round(gap.start, 3), round(gap.end, 3)) for gap in found.gaps] == [("robot", 0.952, 1.2)]
    first, second = found.stretches
    assert first.time[-1] == pytest.approx(0.952)
    assert second.time[0] == pytest.approx(1.2 + DT)
    np.testing.assert_array_equal(second.logged.distance, trace.distance[150:])
    # of people too
    person = person_of(trace).recording
    with_gap = Recording(person.time[keep], person.start[keep], person.end[keep], person.radius, person.names)
    track = PersonTrack("p", with_gap, tuple(gaps_of("p", with_gap.time)))
    both = audit(whole, [track], robot)
    assert [len(one.time) for one in both.stretches] == [len(first.time), len(second.time)]
    assert "p" in page(both, "jssa-gym audit")
    totals = both.totals()[0]
    assert totals["min_distance"] == min(one.summaries[0].min_distance for one in both.stretches)


def test_a_log_beside_people_of_another_day_is_refused():
    trace, robot, _, _ = episode("jssa+stop")
    person = person_of(trace)
    later = dataclasses.replace(person.recording, time=person.recording.time + 100.0)
    with pytest.raises(LogError, match=r"no time at which robot and people are known.*person 100.000 s"):
        audit(log_of(trace), [PersonTrack("person", later, ())], robot)


# ---- files -------------------------------------------------------------------------------------------


def written(path, header, rows, delimiter=","):
    lines = [delimiter.join(header), *(delimiter.join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


HEADER = ["time", *(f"q{j}" for j in range(1, 7))]
ROWS = [[0.008 * k, *(0.01 * k + 0.1 * j for j in range(6))] for k in range(6)]


def test_a_table_is_read_whatever_its_manners(tmp_path):
    plain = read_log(written(tmp_path / "plain.csv", HEADER, ROWS), 6)
    np.testing.assert_allclose(plain.position[1], [0.01, 0.11, 0.21, 0.31, 0.41, 0.51])
    assert plain.velocity is None
    degrees = [[1e3 * row[0], *np.degrees(row[1:]), "on"] for row in ROWS]
    units = ["time [ms]", *(f"joint_{j} [deg]" for j in range(1, 7)), "gripper"]
    other = read_log(written(tmp_path / "other.csv", units, degrees, ";"), 6)
    np.testing.assert_allclose(other.time, plain.time)
    np.testing.assert_allclose(other.position, plain.position)
    # by number, not by place
    turned = [[row[0], *row[:0:-1]] for row in ROWS]
    back = read_log(written(tmp_path / "back.csv", ["time", *HEADER[:0:-1]], turned), 6)
    np.testing.assert_array_equal(back.position, plain.position)
    rates = [*HEADER, *(f"q{j}.velocity [deg/s]" for j in range(1, 7))]
    full = read_log(written(tmp_path / "full.csv", rates, [[*row, *([90.0] * 6)] for row in ROWS]), 6)
    np.testing.assert_allclose(full.velocity, np.pi / 2.0)
    np.savez(tmp_path / "a.npz", time=plain.time, position=plain.position, velocity=full.velocity)
    archive = read_log(tmp_path / "a.npz", 6)
    np.testing.assert_array_equal(archive.position, plain.position)
    np.testing.assert_array_equal(archive.velocity, full.velocity)


def spoiled(row, column, value):
    rows = [list(one) for one in ROWS]
    rows[row][column] = value
    return rows


@pytest.mark.parametrize(
    ("header", "rows", "message"),
    [
        (HEADER, spoiled(2, 3, "x"), r"bad.csv: row 4, column q3 holds 'x', which is no number"),
        (HEADER, spoiled(2, 3, ""), "row 4, column q3 is empty"),
        (HEADER, spoiled(2, 3, "nan"), "row 4, column q3: numbers have to be finite"),
        (HEADER, spoiled(3, 0, 0.016), "row 5, column time: time has to increase"),
        (HEADER, spoiled(1, 2, 90.0), r"row 3, column q2: a joint at 90 rad has turned twice; if these are degrees"),
        (HEADER[:-1], [row[:-1] for row in ROWS], r"positions of 6 joints, q1 ... q6.*found 1 time and the joints: q1"),
        (["t", *HEADER[1:]], ROWS, "found no time"),
        (["time [h]", *HEADER[1:]], ROWS, r"column time \[h\]: unknown unit 'h'; valid: s, ms"),
        ([*HEADER, "q1"], [[*row, 0.0] for row in ROWS], "column q1 is there twice"),
        ([*HEADER, "q1.velocity"], [[*row, 0.0] for row in ROWS], "for all joints or for none"),
        (HEADER, [*ROWS[:2], ROWS[2][:4]], "row 4 has 4 values for 7 columns"),
        (HEADER, ROWS[:1], "two samples at least"),
    ],
)
def test_bad_tables_are_named_by_row_and_column(tmp_path, header, rows, message):
    with pytest.raises(LogError, match=message) as told:
        read_log(written(tmp_path / "bad.csv", header, rows), 6)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.mcap", b"x", "a.mcap: .mcap is not read"),
        ("a.db3", b"x", "not read"),
        ("a.txt", b"x", "read from .csv, .npz, .parquet"),
        ("a.npz", b"x", "no complete .npz archive"),
        ("none.csv", None, "no log at"),
    ],
)
def test_other_files_are_refused_by_name(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError, match=message):
        read_log(tmp_path / name, 6)


def test_parquet_says_what_to_install(tmp_path, monkeypatch):
    (tmp_path / "a.parquet").write_bytes(b"x")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match="pip install pyarrow"):
        read_log(tmp_path / "a.parquet", 6)


def test_parquet_is_read_as_a_table_is(tmp_path, monkeypatch):
    # pyarrow's part of it, played by a table of columns
    table = dict(zip(HEADER, np.array(ROWS).T, strict=True))
    column = type("Column", (), {"__init__": lambda self, x: setattr(self, "x", x), "to_numpy": lambda self: self.x})
    read = type("Table", (), {"column_names": list(table), "column": lambda self, k: column(list(table.values())[k])})
    pyarrow = types.ModuleType("pyarrow")
    pyarrow.parquet = types.SimpleNamespace(read_table=lambda path: read())
    monkeypatch.setitem(sys.modules, "pyarrow", pyarrow)
    (tmp_path / "a.parquet").write_bytes(b"x")
    np.testing.assert_allclose(read_log(tmp_path / "a.parquet", 6).position, np.array(ROWS)[:, 1:])


def test_a_log_of_another_robot_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", time=np.arange(4.0), position=np.zeros((4, 7)))
    with pytest.raises(LogError, match="it has 7 joints, the robot 6"):
        read_log(tmp_path / "a.npz", 6)
    np.savez(tmp_path / "b.npz", time=np.arange(4.0))
    with pytest.raises(LogError, match="misses position"):
        read_log(tmp_path / "b.npz", 6)


def test_the_safe_trajectory_is_a_log_again(tmp_path):
    trace, robot, _, _ = episode(None)
    found = audited(trace, robot)
    write_safe_trajectory(tmp_path / "safe.csv", found)
    again = read_log(tmp_path / "safe.csv", 6)
    np.testing.assert_array_equal(again.position[1:], found.stretches[0].safe.position)
    np.testing.assert_array_equal(again.acceleration[1:], found.stretches[0].safe.acceleration)
    with (tmp_path / "safe.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["status"] for row in rows[1:]} >= {"NOMINAL", "FAILSAFE"}
    # what was made safe is safe: the same numbers in the next audit
    second = audit(again, [person_of(trace)], robot)
    assert second.totals()[0] == {
        name: pytest.approx(value, abs=1e-9) if isinstance(value, float) else value
        for name, value in found.totals()[1].items()
    }
    assert not second.totals()[1]["moving_contact"]


# ---- people who were seen as keypoints ----------------------------------------------------------------


def keypoint_table(path, trace, hidden=(), noise=0.0):
    """The person of an episode as a camera's program would write it, 31 pictures a second."""
    skeleton, rng = SKELETONS["coco17"], np.random.default_rng(0)
    rows = []
    for k in range(0, len(trace.time), 4):
        zero = np.zeros_like(trace.human_start[k])
        people = CapsuleSet(
            trace.human_start[k],
            trace.human_end[k],
            zero,
            zero,
            trace.human_radius,
            trace.human_names,
            trace.human_person,
        )
        _, points = keypoints_of(people, skeleton)
        points = points[0] + noise * rng.uniform(-0.5, 0.5, points[0].shape)
        gone = [name in hidden and 40 <= k < 120 for name in skeleton.keypoints]
        cells = [
            ["", "", "", 0.0] if lost else [*map(repr, map(float, point)), 0.9]
            for point, lost in zip(points, gone, strict=True)
        ]
        rows.append([repr(float(trace.time[k])), *(cell for four in cells for cell in four)])
    header = ["time", *(f"{name}.{axis}" for name in skeleton.keypoints for axis in ("x", "y", "z", "confidence"))]
    return written(path, header, rows)


def test_keypoints_become_the_person_that_they_are_of(tmp_path):
    trace, robot, _, _ = episode(None, human="walk_by", policy="jpc", seed=11)
    assumed = FailsafeParams(position_error=0.05)
    person = read_person(keypoint_table(tmp_path / "p.csv", trace), assumed, body="six")
    assert set(person.recording.names) == set(trace.human_names)
    assert not person.gaps
    found = audit(log_of(trace), [person], robot, assumed=assumed)
    arm, ours_arm = (names.index("right_arm") for names in (trace.human_names, person.recording.names))
    ours = found.stretches[0].logged
    same = np.isin(np.round(trace.time, 3), np.round(person.recording.time, 3))
    shared = np.isin(np.round(trace.time, 3), np.round(found.stretches[0].time, 3))
    np.testing.assert_allclose(
        ours.human_end[np.isin(np.flatnonzero(shared), np.flatnonzero(same)), ours_arm],
        trace.human_end[same & shared, arm],
        atol=0.03,
    )
    jointed = read_person(tmp_path / "p.csv", assumed)
    assert len(jointed.recording.names) == 14


def test_a_part_that_is_not_seen_is_a_gap(tmp_path):
    trace, robot, _, _ = episode(None, human="walk_by", policy="jpc", seed=11)
    assumed = FailsafeParams(position_error=0.05)
    person = read_person(keypoint_table(tmp_path / "p.csv", trace, hidden=("left_wrist",)), assumed, body="six")
    assert {gap.of for gap in person.gaps} == {"p.csv left_arm"}
    found = audit(log_of(trace), [person], robot, assumed=assumed)
    assert len(found.stretches) == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("nose.x", "beak.x", 1), r"p.csv: .*beak"),
        (lambda text: text.replace(",nose.y", ",nose.w", 1), "unknown: nose.w"),
        (lambda text: text.replace("0.9", "high", 1), r"row 2, column nose.confidence holds 'high'"),
        (lambda text: "\n".join([*text.split("\n")[:3], text.split("\n")[2], ""]), "time has to increase"),
    ],
)
def test_bad_keypoints_are_named_by_row_and_column(tmp_path, change, message):
    trace, *_ = episode(None, human="walk_by", policy="jpc", seed=11)
    path = keypoint_table(tmp_path / "p.csv", trace)
    path.write_text(change(path.read_text()))
    with pytest.raises(RecordingError, match=message):
        read_person(path, FailsafeParams(position_error=0.05))


def test_keypoints_need_an_error_that_lets_some_be_believed(tmp_path):
    trace, *_ = episode(None, human="walk_by", policy="jpc", seed=11)
    path = keypoint_table(tmp_path / "p.csv", trace)
    with pytest.raises(RecordingError, match="no keypoint would be believed"):
        read_person(path, FailsafeParams())
    with pytest.raises(RecordingError, match="hardly ever seen"):
        capsules_of(read_keypoints(path), FailsafeParams(position_error=0.021))  # all are of confidence 0.9


def test_keypoints_of_an_archive(tmp_path):
    trace, *_ = episode(None, human="walk_by", policy="jpc", seed=11)
    table = read_keypoints(keypoint_table(tmp_path / "p.csv", trace))
    np.savez(
        tmp_path / "p.npz", time=table.time, keypoints=table.position, confidence=table.confidence,
        names=np.array(table.skeleton.keypoints),
    )  # fmt: skip
    again = read_keypoints(tmp_path / "p.npz")
    np.testing.assert_array_equal(again.position, table.position)
    assumed = FailsafeParams(position_error=0.05)
    assert len(read_person(tmp_path / "p.npz", assumed, body="six").recording.time) == len(table.time)


# ---- what is told ------------------------------------------------------------------------------------


def test_all_that_is_found_is_json_and_a_page():
    trace, robot, _, _ = episode(None)
    found = audited(trace, robot)
    told = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert told["would_intervene"] is True
    assert told["interventions"][0]["reason"]
    assert told["logged"]["moving_contact"] is True
    assert told["with_shield"]["moving_contact"] is False
    html = page(found, "jssa-gym audit <log>")
    assert "&lt;log&gt;" in html
    assert "<svg" in html
    assert "\\n" not in html
    assert "The shield would have intervened" in html
    assert "http" not in html.replace("http://www.w3.org/2000/svg", "")
    gone = sum(one.slowed for one in found.interventions)
    assert gone == pytest.approx(found.lateness)


@pytest.mark.parametrize("options", [{"filter": "nothing"}, {"scene": "moon"}, {"dt": 0.0}])
def test_unknown_options_are_refused(options):
    trace, robot, _, _ = episode("jssa+stop")
    with pytest.raises(ParameterError):
        audited(trace, robot, **options)
