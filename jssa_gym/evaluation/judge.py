"""The second judge: recorded episodes played again in MuJoCo, finer than they were recorded."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.evaluation.judgement import Contact, Excess, Judgement, Overlap
from jssa_gym.evaluation.oracle import FAR, Oracle
from jssa_gym.evaluation.spans import spans
from jssa_gym.evaluation.trace import every_step
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import JointLimits, RobotModel
from jssa_gym.types import Array, Trace
from jssa_gym.validation import positive_integer, positive_number


def judge(trace: Trace, robot: RobotModel, *, substeps: int = 8, tolerance: float = 1e-6) -> Judgement:
    r"""Play an episode again in MuJoCo and compare.

    Nothing of the package's kinematics takes part: the arm is read from its MJCF file, the joints follow Eq. (1) from
    the recorded state before each step under the recorded jerk, people move on straight lines from tick to tick, and
    distances, touching points and Jacobians are MuJoCo's. At the ticks the recorded states themselves are judged.

    Args:
        trace: The episode; with kinematic dynamics, since nothing is recorded of a servoed arm's motion.
        robot: The robot that it was recorded with, where it stood.
        substeps: Moments looked at in every control step; 8 are 1 kHz.
        tolerance: Largest disagreement of :attr:`Judgement.agrees` [m, m/s, share of a limit].

    Raises:
        ParameterError: The trace is not of this robot, not kinematic, or its rows are not one control step apart.
        RobotModelError: The robot's file has changed.
    """
    substeps = positive_integer("substeps", substeps)
    tolerance = positive_number("tolerance", tolerance)
    _check(trace, robot)
    motion = _motion(trace, robot.limits, substeps)
    oracle = Oracle(robot, motion.start, motion.end, trace.human_radius, trace.plane_normal, trace.plane_offset)
    parts, bodies = range(len(oracle.arm)), range(len(oracle.human))
    human = [(i, j) for i in parts for j in bodies]
    own = [(int(i), int(j)) for i, j in robot.self_pairs]
    solid = [(i, j) for i in parts for j in range(len(oracle.planes)) if not oracle.stands(i, j)]
    geoms = [(oracle.arm[i], oracle.human[j]) for i, j in human]
    everything = [
        *geoms,
        *((oracle.arm[i], oracle.arm[j]) for i, j in own),
        *((oracle.arm[i], oracle.planes[j]) for i, j in solid),
    ]
    distance = np.empty((len(motion.time), len(everything)))
    for k in range(len(motion.time)):
        oracle.place(k)
        oracle.move(motion.state[k, 0])
        distance[k] = oracle.distances(everything)
    human_distance, own_distance, solid_distance = np.split(distance, [len(human), len(human) + len(own)], axis=1)
    speeds = _contact_speeds(oracle, geoms, motion, ~(human_distance > 0.0))

    names = robot.capsule_names
    contacts = [
        Contact(
            *_overlap(names[i], trace.human_names[j], motion.time[span], human_distance[span, pair]),
            int(trace.human_person[j]),
            *(float(speed[span, pair].max()) for speed in speeds),
        )
        for pair, (i, j) in enumerate(human)
        for span in _touching(human_distance[:, pair])
    ]
    self_collisions, plane_collisions = (
        tuple(
            Overlap(*_overlap(names[i], others[j], motion.time[span], of[span, pair]))
            for pair, (i, j) in enumerate(pairs)
            for span in _touching(of[:, pair])
        )
        for pairs, others, of in ((own, names, own_distance), (solid, trace.plane_names, solid_distance))
    )
    smallest = human_distance.min(axis=1, initial=np.inf)
    found = smallest[substeps::substeps]
    recorded = np.minimum(trace.distance, FAR) if human else trace.distance
    gap = np.subtract(recorded, found, out=np.zeros_like(found), where=recorded != found)
    touching = ~(found > 0.0)
    fastest = np.where(human_distance > 0.0, 0.0, speeds[0]).max(axis=1, initial=0.0)[substeps::substeps]
    # a contact within rounding of none has no speed to compare
    faster = np.where(trace.contact == touching, trace.contact_speed - fastest, 0.0)
    return Judgement(
        samples=len(motion.time),
        distance=float(smallest.min()),
        distance_error=float(np.abs(gap).max()),
        contact_error=int(((trace.contact != touching) & ~(np.abs(found) <= tolerance)).sum()),
        speed_error=float(np.abs(faster).max()),
        state_error=motion.error,
        contacts=tuple(sorted(contacts, key=lambda contact: contact.start)),
        self_collisions=self_collisions,
        plane_collisions=plane_collisions,
        excess=Excess.of(motion.state, trace.jerk, robot.limits),
        tolerance=tolerance,
    )


def _check(trace: Trace, robot: RobotModel) -> None:
    if trace.dynamics != "kinematic":
        raise ParameterError(f"only kinematic episodes can be played again, this one's dynamics is {trace.dynamics!r}")
    if trace.robot != robot.name or trace.initial_state.shape != (3, robot.n):
        raise ParameterError(f"the episode is of the robot {trace.robot!r}, not of {robot.name!r}")
    if not np.array_equal(trace.mount, robot.mount):
        raise ParameterError(f"the episode's robot stands at {trace.mount}, this one at {robot.mount}; use mounted()")
    if len(trace.time) == 0 or not every_step(trace):
        raise ParameterError("the rows of a trace have to be one control step apart, from the first step on")


class _Motion(NamedTuple):
    """Arm and people at all moments that are looked at: the beginning and the sub-steps."""

    time: Array
    """Shape (s,) [s]."""
    state: Array
    """Shape (s, 3, n)."""
    start: Array
    """Shape (s, m, 3) [m]."""
    end: Array
    """Shape (s, m, 3) [m]."""
    velocity: Array
    """Velocity of the people's starts and ends in the step that leads to the moment, shape (s, 2, m, 3) [m/s]."""
    error: float
    """Largest difference of a recorded state from the one that follows, as a share of the limits."""


def _motion(trace: Trace, limits: JointLimits, substeps: int) -> _Motion:
    count, dt = len(trace.time), trace.dt
    fraction = np.arange(1, substeps + 1) / substeps
    recorded = np.stack([trace.position, trace.velocity, trace.acceleration], axis=1)
    before = np.concatenate([trace.initial_state[None], recorded[:-1]])
    q, v, a = (before[:, None, i] for i in range(3))
    t, u = (dt * fraction)[:, None], trace.jerk[:, None]
    state = np.stack([q + t * v + t**2 / 2.0 * a + t**3 / 6.0 * u, v + t * a + t**2 / 2.0 * u, a + t * u], axis=2)
    scale = limits.state_scale
    error = float((np.abs(state[:, -1] - recorded) / scale).max())
    state[:, -1] = recorded

    after = np.stack([trace.human_start, trace.human_end], axis=1)
    people = np.concatenate([trace.initial_human[None], after])
    velocity = np.diff(people, axis=0) / dt
    between = people[:-1, None] + (dt * fraction)[:, None, None, None] * velocity[:, None]
    between[:, -1] = after
    ends = np.concatenate([trace.initial_human[None], between.reshape(count * substeps, *after.shape[1:])])
    return _Motion(
        time=np.linspace(0.0, count * dt, count * substeps + 1),
        state=np.concatenate([trace.initial_state[None], state.reshape(count * substeps, *trace.initial_state.shape)]),
        start=ends[:, 0],
        end=ends[:, 1],
        velocity=np.concatenate([velocity[:1], np.repeat(velocity, substeps, axis=0)]),
        error=error,
    )


def _contact_speeds(
    oracle: Oracle, geoms: list[tuple[int, int]], motion: _Motion, touching: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Speed of the robot's touching point, and how fast it and the person's approach each other, NaN elsewhere.

    Args:
        oracle: The scene.
        geoms: Pairs of robot and human capsule.
        motion: Of both.
        touching: Whether each pair does at each moment, shape (s, pairs).

    Returns:
        Three arrays of shape (s, pairs) [m/s].
    """
    speed, approach, human_approach = (np.full(touching.shape, np.nan) for _ in range(3))
    humans = len(oracle.human)
    for k in np.flatnonzero(touching.any(axis=1)):
        oracle.place(int(k))
        oracle.move(motion.state[k, 0])
        for pair in np.flatnonzero(touching[k]):
            j = pair % humans
            (_, on_human), moves = oracle.touch(*geoms[pair], motion.state[k, 1])
            start, axis = motion.start[k, j], motion.end[k, j] - motion.start[k, j]
            length2 = float(axis @ axis)
            share = min(max(float((on_human - start) @ axis) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
            # from the robot into the person: a surface point's normal leads to the axis
            inward = start + share * axis - on_human
            normal = inward / max(float(np.linalg.norm(inward)), 1e-300)
            human_moves = (1.0 - share) * motion.velocity[k, 0, j] + share * motion.velocity[k, 1, j]
            speed[k, pair] = np.linalg.norm(moves)
            approach[k, pair] = moves @ normal
            human_approach[k, pair] = -(human_moves @ normal)
    return speed, approach, human_approach


def _touching(distance: Array) -> list[slice]:
    """Where a distance (s,) is not positive."""
    return [slice(*span) for span in spans(~(distance > 0.0))]


def _overlap(one: str, other: str, time: Array, distance: Array) -> tuple[str, str, float, float, float]:
    return one, other, float(time[0]), float(time[-1]), float(-distance.min())
