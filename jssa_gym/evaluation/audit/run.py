"""A logged motion beside logged people: what was, and what a shield would have made of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jssa_gym.envs.surroundings import Surroundings
from jssa_gym.envs.world import SCENES, planes_of
from jssa_gym.evaluation.audit.course import Bystanders, Course, traced
from jssa_gym.evaluation.audit.log import RobotLog, read_log
from jssa_gym.evaluation.audit.motion import Gap, Stretch, gaps_of, stretches
from jssa_gym.evaluation.audit.result import Audit, AuditedStretch, ClosestApproach
from jssa_gym.evaluation.audit.shadow import shadow
from jssa_gym.evaluation.geometry import geometry
from jssa_gym.evaluation.metrics import SeparationParams, separation_margin, summarise
from jssa_gym.exceptions import LogError, RecordingError
from jssa_gym.humans import Recording
from jssa_gym.humans.files import load
from jssa_gym.perception.files import capsules_of, holds_keypoints, read_keypoints
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import SafetyFilter, make_filter, read_name
from jssa_gym.types import Array, Planes, Trace
from jssa_gym.validation import positive_number


@dataclass(frozen=True, slots=True, eq=False)
class PersonTrack:
    """Somebody who was recorded beside the robot."""

    name: str
    """Name of the file."""
    recording: Recording
    gaps: tuple[Gap, ...]


def read_person(path: str | Path, assumed: FailsafeParams, *, body: str = "jointed", shift: float = 0.0) -> PersonTrack:
    """Read a person's track: capsules or motion capture as everywhere, or keypoints.

    Args:
        path: ``.csv``, ``.npz`` or ``.bvh``.
        assumed: Of the shield; its ``position_error`` says which keypoints are good enough.
        body: Of keypoints, ``"jointed"`` or ``"six"``.
        shift: Added to its clock to make it the robot's [s].

    Raises:
        RecordingError: The file is no sound one; the message names row and column.
    """
    path = Path(path)
    if holds_keypoints(path):
        try:
            recording, seen = capsules_of(read_keypoints(path), assumed, body=body)
        except RecordingError as error:
            said = str(error)
            raise RecordingError(said if path.name in said else f"{path.name}: {said}") from error
        stamps = seen
    else:
        recording = load(path).recording
        stamps = {"": recording.time}
    moved = Recording(recording.time + shift, recording.start, recording.end, recording.radius, recording.names)
    gaps = dict.fromkeys(
        Gap(f"{path.name} {part}".rstrip(), gap.start + shift, gap.end + shift)
        for part, time in stamps.items()
        for gap in gaps_of("", time)
    )
    return PersonTrack(path.name, moved, tuple(gaps))


def audit(
    log: RobotLog | str | Path,
    people: Sequence[PersonTrack],
    robot: RobotModel,
    *,
    filter: str = "jssa+stop",
    assumed: FailsafeParams | None = None,
    scene: str = "table",
    dt: float = 0.008,
    separation: SeparationParams | None = None,
) -> Audit:
    """Judge a log.

    Args:
        log: Of the robot, or its file.
        people: Everybody who was there; nobody for a log without people.
        robot: The robot; it stands where ``scene`` puts it.
        filter: The shield's, as :func:`~jssa_gym.shields.read_name` reads it.
        assumed: What its verified stop assumes; None for the defaults.
        scene: ``"table"`` or ``"floor"``.
        dt: Control step [s].
        separation: Of speed and separation monitoring; None for the defaults.

    Raises:
        LogError: The log is not sound, or there is no time at which robot and people are known.
        ParameterError: Unknown filter or scene, or a number is out of range.
    """
    dt, assumed = positive_number("dt", dt), FailsafeParams() if assumed is None else assumed
    planes = planes_of(scene)
    robot = robot.mounted(np.array([0.0, 0.0, SCENES[scene]]))
    name = log.name if isinstance(log, Path) else Path(log).name if isinstance(log, str) else "log"
    if not isinstance(log, RobotLog):
        log = read_log(log, robot.n)
    recordings = [person.recording for person in people]
    gaps = (*gaps_of("robot", log.time), *(gap for person in people for gap in person.gaps))
    found = stretches(log, recordings, gaps, dt)
    if not found:
        times = ", ".join(
            f"{who} {time[0]:.3f} s to {time[-1]:.3f} s"
            for who, time in (("robot", log.time), *((one.name, one.recording.time) for one in people))
        )
        raise LogError(f"there is no time at which robot and people are known for two steps without a gap: {times}")
    bystanders = Bystanders(
        tuple(part for one in recordings for part in one.names),
        np.concatenate([np.zeros(0), *(one.radius for one in recordings)]),
        np.repeat(np.arange(len(recordings)), [len(one.names) for one in recordings]).astype(np.int64),
    )
    guarded = read_name(filter).guarded
    chosen = make_filter(filter, robot, dt, viability=guarded, failsafe=assumed if guarded else None)
    separation = SeparationParams() if separation is None else separation
    judged = [_judged(one, robot, chosen, bystanders, planes, separation) for one in found]
    files = tuple(person.name for person in people)
    return Audit(
        name, files, robot.name, filter, assumed, dt, tuple(sorted(gaps, key=lambda g: g.start)), tuple(judged)
    )


def _judged(
    stretch: Stretch,
    robot: RobotModel,
    filter: SafetyFilter,
    people: Bystanders,
    planes: Planes,
    separation: SeparationParams,
) -> AuditedStretch:
    dt = filter.dt
    jerk = np.diff(stretch.states[:, 2], axis=0) / dt
    was = traced("as logged", robot, dt, planes, people, stretch.ends, Course(stretch.states, jerk, jerk))
    made = shadow(filter, stretch.states, stretch.ends, people, planes, float(stretch.time[0]))
    safe = traced("with the shield", robot, dt, planes, people, stretch.ends, made.course)
    moments = stretch.time[1:]
    seen = [geometry(one, robot) for one in (was, safe)]
    margins = [separation_margin(one, separation) for one in seen]
    summaries = [
        summarise(one, robot.limits, of, separation=separation) for one, of in zip((was, safe), seen, strict=True)
    ]
    closest = [closest_of(one, robot, people, moments) for one in (was, safe)]
    return AuditedStretch(
        moments,
        was,
        safe,
        made.lateness,
        (margins[0], margins[1]),
        (summaries[0], summaries[1]),
        (closest[0], closest[1]),
        made.off,
    )


def closest_of(trace: Trace, robot: RobotModel, people: Bystanders, time: Array) -> ClosestApproach | None:
    """The closest approach of a trace; None without people."""
    if not len(people.names):
        return None
    k = int(trace.distance.argmin())
    around = Surroundings(robot, len(people.names))
    ends = np.array([trace.human_start[k], trace.human_end[k]])
    around.take(people.at(ends, ends, trace.dt))
    around.look(np.ascontiguousarray([trace.position[k], trace.velocity[k], trace.acceleration[k]]))
    i, j = around.closest.robot, around.closest.human
    near, arm = around.line, around.robot_capsules
    point = near[0] if near is not None else arm.start[i]
    axis = arm.end[i] - arm.start[i]
    share = float(np.clip((point - arm.start[i]) @ axis / max(float(axis @ axis), 1e-18), 0.0, 1.0))
    velocity = (1.0 - share) * arm.start_velocity[i] + share * arm.end_velocity[i]
    return ClosestApproach(
        float(time[k]),
        float(trace.distance[k]),
        robot.capsule_names[i],
        people.names[j],
        float(np.linalg.norm(velocity)),
        float(-trace.speed[k]),
    )
