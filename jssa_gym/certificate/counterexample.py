r"""Boundary states played on: what the index alone can make of them, recorded so that others can look."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.certificate.boundary import BoundaryState
from jssa_gym.evaluation.identity import code_version
from jssa_gym.evaluation.trace import TASKLESS, TASKLESS_STEP, beginning, load_trace, read_meta, save_trace, trace_of
from jssa_gym.exceptions import TraceError
from jssa_gym.humans import nobody
from jssa_gym.kernels.motion import integrate, violates
from jssa_gym.robots import RobotModel
from jssa_gym.safety.index import IndexParams
from jssa_gym.safety.proximity import measure
from jssa_gym.shields import JSSAFilter
from jssa_gym.types import Array, CapsuleSet, JointState, Planes, Scene, Trace
from jssa_gym.validation import known_name, positive_integer, real_array

_NO_PLANES = Planes(np.zeros((0, 3)), np.zeros(0), ())


def play_on(
    robot: RobotModel,
    index: IndexParams,
    found: BoundaryState,
    *,
    dt: float = 0.008,
    viable: bool = True,
    ticks: int = 25,
) -> Trace:
    r"""Let :class:`~jssa_gym.shields.JSSAFilter` do its best in a boundary state, the person going on as before.

    The filter has one row, of the capsule that the state is about, whatever its authority, and may use the whole box:
    where no jerk keeps the row it answers with the least violation. ``phi`` of the trace is that capsule's index after
    each step, distances are those of the whole arm.

    Args:
        robot: The arm, where it stood.
        index: Parameters of the index.
        found: The state.
        dt: Control step [s].
        viable: Whether the jerk keeps the joint limits recoverable.
        ticks: How many steps.

    Raises:
        ParameterError: The state is of another robot, or ticks is not positive.
    """
    row = robot.capsule_names.index(known_name("capsule", found.capsule, robot.capsule_names))
    joints, ticks = (
        real_array("joints", found.joints, (3, robot.n), "position, velocity and acceleration of every joint"),
        positive_integer("ticks", ticks),
    )
    alone = replace(
        robot,
        capsules=robot.capsules[row : row + 1],
        capsule_names=(found.capsule,),
        self_pairs=np.zeros((0, 2), np.int64),
    )
    shield = JSSAFilter(alone, dt, index, min_authority=0.0, recovery=0.0, viability=viable)
    bounds = robot.limits.bounds()
    wanted, state = np.zeros(robot.n), joints.copy()
    first = scene = _scene(found, state, 0.0)
    shield.reset(scene)
    rows: list[dict[str, Any]] = []
    for k in range(1, ticks + 1):
        decision = shield.decide(scene, wanted)
        integrate(state, decision.jerk, dt, state)
        scene = _scene(found, state, k * dt)
        near = measure(robot, scene.robot, scene.human, _NO_PLANES)
        rows.append(
            {
                "time": scene.time,
                **TASKLESS_STEP,
                **scene.robot._asdict(),
                "jerk": decision.jerk,
                "nominal": wanted,
                "limit_violation": bool(violates(state, decision.jerk, bounds, 1e-9)),
                "distance": near.smallest,
                "speed": near.rate,
                "acceleration_of_distance": near.curvature,
                "pair": near.pair,
                "contact": near.smallest <= 0.0,
                "contact_speed": near.contact_speed,
                "status": int(decision.status),
                "reason": decision.reason,
                "intervened": True,
                "correction": float(np.abs(decision.jerk / robot.limits.jerk).max()),
                "phi": decision.phi,
                "slack": decision.slack,
                "human_start": scene.human.start,
                "human_end": scene.human.end,
            }
        )
    once = {
        **TASKLESS,
        **beginning(robot, found.joints, first.human, _NO_PLANES),
        "name": f"{found.capsule}, lambda = ({index.lambda1:g}, {index.lambda2:g})",
        "dt": dt,
        "d_min": index.d_min,
        "ended": "running",
    }
    return trace_of(once, rows)


def _scene(found: BoundaryState, state: Array, time: float) -> Scene:
    centre, velocity = (found.centre + time * found.velocity)[None], found.velocity[None]
    person = CapsuleSet(
        centre, centre.copy(), velocity, velocity, np.array([found.radius]), ("person",), np.zeros(1, np.int64)
    )
    return Scene(time, JointState(*state.copy()), person, nobody(), _NO_PLANES, np.zeros(1), np.ones(1, np.bool_))


def save_counterexample(
    path: str | Path, robot: RobotModel, index: IndexParams, found: BoundaryState, *, dt: float, viable: bool
) -> Trace:
    """Write a boundary state, played on, as a trace that :func:`load_counterexample` and ``judge`` understand.

    Raises:
        StorageError: The file cannot be written.
    """
    trace = play_on(robot, index, found, dt=dt, viable=viable)
    state = {name: value for name, value in asdict(found).items() if not isinstance(value, np.ndarray)}
    meta = {"boundary": state, "velocity": found.velocity.tolist(), "index": asdict(index), "viable": viable}
    save_trace(trace, path, meta | code_version())
    return trace


def load_counterexample(path: str | Path) -> tuple[Trace, IndexParams, BoundaryState, bool]:
    """Read what :func:`save_counterexample` wrote: the recording, the index, the state, and ``viable``.

    Raises:
        TraceError: The file is no recording of a boundary state.
    """
    trace, meta = load_trace(path), read_meta(path)
    try:
        found = BoundaryState(
            **meta["boundary"],
            joints=trace.initial_state,
            centre=trace.initial_human[0, 0],
            velocity=np.array(meta["velocity"], np.float64).reshape(3),
        )
        return trace, IndexParams(**meta["index"]), found, bool(meta["viable"])
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise TraceError(f"{path} is no recording of a boundary state: {error}") from error
