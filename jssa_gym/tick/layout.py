"""What a control step reads, remembers and answers: tuples of arrays, made once.

Settings, memory and scratch are three things, and only :class:`Memory` survives a tick. The arrays of
:class:`Memory`, :class:`SceneRecord` and :class:`Answer` have a leading axis, an entry for each arm, which the shapes
below leave out; functions of this package are told by ``e`` which arm they are about.
n joints, m robot capsules, k human capsules, c static capsules, p half-spaces.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.lanes import LANES
from jssa_gym.kernels.projection import scratch
from jssa_gym.kernels.records import AGENT, CONFINED, FRAME, PAIR, PLANE, SEGMENT, STOP, TRACK, records
from jssa_gym.kernels.verification import NO_FACES, NO_PIECES

Floats = NDArray[np.float64]

REMEMBERED = 32
"""Ticks by which a joint reading may lag and still be told so."""

ALTERNATIVES = 8
"""Jerks that may be offered beside the nominal."""


class ArmRecord(NamedTuple):
    """An arm, where it stands."""

    links: NDArray
    """Shape (n,) of ``LINK``."""
    capsules: NDArray
    """Shape (m,) of ``CAPSULE``."""
    self_pairs: NDArray
    """Robot capsules that could collide, shape (s, 2)."""
    levers: Floats
    """How far a capsule's axis can be from each joint's (:func:`jssa_gym.safety.failsafe.levers`), shape (m, n) [m]."""
    limits: Floats
    """Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n)."""


class StepSettings(NamedTuple):
    """Numbers that never change: how the arm is looked after, whoever proposes."""

    dt: float
    """Control step [s]."""
    guarded: bool
    """Whether nothing is applied that a verified stop does not follow."""
    viability: bool
    """Whether the box keeps the joint limits recoverable; else it is the jerk bounds."""
    static_rows: bool
    """Whether static capsules and half-spaces make rows too."""
    diagonal: bool
    """Whether V of Eq. (14) is diagonal."""
    weight: Floats
    """The diagonal of V, shape (n,)."""
    inverse: Floats
    """V's inverse, shape (n, n)."""
    stop_limits: Floats
    """The limits that stops keep, shape (5, n): the arm's."""
    hardness: Floats
    """Shares of acceleration and jerk limit that stops are planned with, softest first, the last 1; shape (c,)."""
    soft_limits: Floats
    """The limits that stops are planned with, shape (c, 5, n)."""
    tolerance: Floats
    """How far a reading of the joints may be from where the applied jerks must have led, shape (3, n)."""
    position_error: float
    """Bound on the error of a measured capsule end [m]."""
    max_age: float
    """Largest age of a measurement that is relied on [s]."""
    lag: float
    """Time from a command to the arm's motion [s]."""
    astray: float
    """How far a point of the arm may be from where it is expected [m]."""
    paced: bool = False
    """Whether the clock is that of whoever asks for decisions, one a tick, and right while it goes on; else it is the
    scene's, which is not believed, once it has lagged, until it has caught up with the decisions."""
    faces: NDArray = NO_FACES
    """Faces of the watched region, see :mod:`~jssa_gym.kernels.region`; without one nobody may come or go."""
    pieces: NDArray[np.int64] = NO_PIECES
    """Where those of each piece begin, shape (pieces + 1,)."""
    entry_speed: float = 0.0
    """How fast whoever is unseen may come into it [m/s]."""


MEMORY = np.dtype(
    [
        # the joints' readings
        ("begun", np.bool_),  # whether it is known where the arm began
        ("time", np.float64),  # the clock's last reading that counts, NaN for none
        ("ticks", np.int64),  # since then
        ("clock", np.int64),  # what is wrong with this tick's: a reason's code
        ("offset", np.float64),  # ticks by which the clock is ahead of the control steps ...
        ("settled", np.float64),  # ... when a reading was right for the last time
        ("due", np.float64),  # ... that a lag asks it to reach
        ("late", np.int64),  # ticks without a decision since a reading was right
        ("newest", np.int64),  # place in the rings of what was one tick ago
        ("owed", np.int64),  # readings that have to be right before they are believed again
        ("wrong", np.int64),  # readings in a row that were wrong
        ("believed", np.int64),  # ... that were believed
        ("lapses", np.int64),  # times that readings were wrong after they had been believed
        ("why", np.int64),  # what was wrong last: a reason's code ...
        ("lag", np.int64),  # ... and the ticks by which it lagged
        # the stored stop
        ("step", np.int64),  # number of its ticks that are over
        ("verified", np.bool_),  # whether it is verified, or the arm rests inside its limits
        ("rests", np.bool_),  # whether it is over and has ended in rest
        # the filter
        ("resume", np.float64),  # distance from which an arm that it stopped goes on, NaN where it did not stop it [m]
        # the people's readings, and what stands still
        ("met", np.bool_),  # whether it is known who there is
        ("people_time", np.float64),  # of the last reading, -inf for none
        ("seen", np.float64),  # the scene's clock when it was read last, NaN for never
        ("ahead", np.float64),  # what people are ahead of it [s]
        ("missed", np.int64),  # ticks since then
        ("frame", np.float64),  # when the watched region was seen completely for the last time, -inf for never
        ("fixed", np.bool_),  # whether it is known what stands still
    ],
    align=True,
)
"""What is remembered of one arm, but for arrays."""


class Memory(NamedTuple):
    """All that one arm's shield remembers from tick to tick."""

    arm: NDArray
    """Shape (1,) of ``MEMORY``."""
    state: Floats
    """The joint state that was decided from last, shape (3, n)."""
    applied: Floats
    """The jerk that was applied last, shape (n,) [rad/s³]."""
    expected: Floats
    """Where the applied jerks have led, shape (3, n)."""
    last: Floats
    """The last reading of the joints, shape (3, n), NaN for none."""
    anchor: Floats
    """What was expected when it came for the first time, shape (3, n)."""
    past: Floats
    """What was expected before, a ring of shape (32, 3, n)."""
    offsets: Floats
    """The clock's offsets before, a ring of shape (32,)."""
    stored: NDArray
    """The stored stop, shape (n,) of ``STOP``."""
    tracks: NDArray
    """What is remembered of human capsules, shape (k,) of ``TRACK``."""
    growth: Floats
    """How fast people can come, at their faster ends, shape (k,) [m/s]."""
    touch: Floats
    """Speed of a point of the arm with which they may be touched, shape (k,) [m/s]."""
    statics: NDArray
    """Static capsules of the beginning, shape (c,) of ``AGENT``."""
    planes: NDArray
    """Half-spaces of the beginning, shape (p,) of ``PLANE``."""


SCENE = np.dtype(
    [
        ("time", np.float64),  # [s], NaN if it cannot be read
        ("timed", np.bool_),  # whether it can
        ("joints", np.bool_),  # whether the joint state could be read; what could not is not in the arrays
        ("people", np.bool_),  # whether the people could
        ("seen", np.bool_),  # whether there was a scene to read them from
        ("fixtures", np.bool_),  # whether static capsules and half-spaces could
        ("alternatives", np.int64),  # how many jerks are offered beside the nominal
        ("frame", np.float64),  # age of the newest complete frame of the watched region [s]; NaN for none
    ],
    align=True,
)
"""What is shown of one arm's surroundings, but for arrays."""


class SceneRecord(NamedTuple):
    """The present as it is shown: sound in shape and type, nothing else."""

    now: NDArray
    """Shape (1,) of ``SCENE``."""
    joints: Floats
    """Rows position, velocity, acceleration, shape (3, n)."""
    ends: Floats
    """Starts, ends and their velocities of human capsules, shape (4, k, 3) [m, m/s]."""
    radius: Floats
    """Shape (k,) [m]."""
    age: Floats
    """Shape (k,) [s]."""
    valid: NDArray[np.bool_]
    """Shape (k,)."""
    person: NDArray[np.int64]
    """Shape (k,)."""
    static_ends: Floats
    """The same of static capsules, shape (4, c, 3)."""
    static_radius: Floats
    """Shape (c,) [m]."""
    normal: Floats
    """Outward normals of half-spaces, shape (p, 3)."""
    offset: Floats
    """Shape (p,) [m]."""
    alternatives: Floats
    """Jerks that a planner would rather see applied, in order of preference, shape (8, n) [rad/s³]."""


ANSWER = np.dtype(
    [
        ("status", np.int64),
        ("phi", np.float64),
        ("distance", np.float64),
        ("row", np.int64),
        ("column", np.int64),
        ("slack", np.float64),
        ("rows", np.int64),
        ("code", np.int64),  # why, see jssa_gym.tick.codes
        ("detail", np.int64),  # ... and what stood in the way of a stop, or behind a fault
        ("capsule", np.int64),  # the robot's capsule that it is about, -1 for none
        ("other", np.int64),  # the other's number
        ("moment", np.float64),  # when [s]
        ("ticks", np.int64),  # by how many
        ("unverified", np.bool_),  # no verified stop is stored
        ("persistent", np.bool_),  # joint readings are wrong for so long or so often that it is no accident
        ("fresh", np.bool_),  # all people were measured at this very moment
        ("sample", np.int64),  # what became of the sample of the capsule that is worst off, see jssa_gym.kernels.people
        ("inside", np.bool_),  # the nominal lay in the box
        ("attempt", np.int64),  # times that rows were linearised anew; of printed rows, how many there are
        ("recovering", np.bool_),  # a row asks for less than 0 at once
        ("kept", np.bool_),  # all rows are kept
        ("chosen", np.int64),  # what is applied, see jssa_gym.tick.admit; -1 on a fault
        ("choice", np.int64),  # which alternative is applied, -1 for none
        ("margin", np.float64),  # room that the stop behind the nominal leaves to people [m]
    ],
    align=True,
)
"""What was decided, but for the jerk; fields as of :class:`~jssa_gym.types.Decision`."""


class Answer(NamedTuple):
    """What was decided."""

    told: NDArray
    """Shape (1,) of ``ANSWER``."""
    jerk: Floats
    """The jerk to be applied, shape (n,) [rad/s³]."""


class Work(NamedTuple):
    """Scratch: nothing in it outlives a tick."""

    lower: Floats
    """The box, shape (n,) [rad/s³]."""
    upper: Floats
    clipped: Floats
    """The nominal in the box, shape (n,)."""
    wanted: Floats
    """The jerk that is proposed, shape (n,)."""
    jerk: Floats
    """The jerk that is looked at, shape (n,)."""
    halt: Floats
    """The stored stop's jerk, shape (n,)."""
    people: Floats
    """Trusted starts, ends and velocities, shape (4, k, 3)."""
    radius: Floats
    """Trusted radii, shape (k,)."""
    age: Floats
    """How old they are, shape (k,) [s]."""
    agents: NDArray
    """What rows see: people, then static capsules, shape (k + c,) of ``AGENT`` ..."""
    agents_now: NDArray
    """... and the same at the beginning of the step, where rows look at its end."""
    planes: NDArray
    """Half-spaces that rows see, shape (p,) of ``PLANE``."""
    grown: NDArray
    """What the stop sees: people as they were measured, shape (k,) of ``AGENT``."""
    reach: Floats
    """How far they can have come since, shape (k,) [m]."""
    confined: NDArray
    """What confines them more closely, shape (k,) of ``CONFINED``."""
    frames: NDArray
    """The arm, shape (n,) of ``FRAME`` ..."""
    segments: NDArray
    """... and its capsules, shape (m,) of ``SEGMENT``, at the end of the step ..."""
    frames_now: NDArray
    segments_now: NDArray
    """... and at its beginning, or wherever else is looked at."""
    present: Floats
    """Joint position of which the next two are, shape (n,) [rad]; NaN for none."""
    frames_present: NDArray
    segments_present: NDArray
    """The arm at present, see :func:`~jssa_gym.kernels.chain.place_present`."""
    met: NDArray[np.int64]
    """Robot capsule and person in the way of the last stop in whose way somebody was, shape (2,); -1 for nobody."""
    pairs: NDArray
    """Shape (m, k + c + p) of ``PAIR``."""
    pairs_now: NDArray
    after: Floats
    """Joint state at the end of the step, shape (3, n)."""
    L: Floats
    """Rows, shape (m (k + c + p), n)."""
    S: Floats
    owner: NDArray[np.int64]
    target: Floats
    motion: Floats
    """Distances now and their derivatives, shape (m k, 4) ..."""
    pushes: Floats
    """... what a joint jerk adds to the third of them, shape (m k, n) ..."""
    normals: Floats
    """... and their directions, shape (m k, 3); see :func:`~jssa_gym.kernels.derivatives.pair_motion`."""
    needed: Floats
    """Distances that are asked for, shape (m k,) [m]."""
    own: Floats
    """Scratch of the filter that proposes, shape (4, n)."""
    multipliers: Floats
    active: NDArray[np.int64]
    relief: Floats
    """Scratch of the projection, see :func:`~jssa_gym.kernels.projection.scratch`."""
    next: NDArray
    """The stop after a jerk that is looked at, shape (n,) of ``STOP``."""
    hardest_after: Floats
    """State from which the hardest stop was planned last in this tick, shape (3, n); NaN for none ..."""
    hardest_next: NDArray
    """... and that stop, shape (n,) of ``STOP``."""
    quickest: Floats
    """Speed of the fastest capsule in the stop that the last margin is of, shape (1,) [m/s]."""
    posture: Floats
    """Shape (n,)."""
    fastest: Floats
    """Shape (n,)."""
    later: Floats
    """Shape (n,)."""
    room: Floats
    """Shape (m,) [m]."""
    balls: Floats
    """Around people, shape (k, 4), see :func:`~jssa_gym.kernels.capsules.put_balls`."""
    axes: Floats
    """People's capsules number by number, shape (7, k or more), see :func:`~jssa_gym.kernels.capsules.put_axes`."""
    people_off: Floats
    """Shape (m, k) ..."""
    planes_off: Floats
    """... (m, p) ..."""
    statics_off: Floats
    """... (m, c) ..."""
    self_off: Floats
    """... and (s,) [s], of :func:`~jssa_gym.kernels.verification.keeps_clear`."""
    spare: Floats
    """A joint state, shape (3, n)."""
    told: NDArray
    """Shape (1,) of ``ANSWER``, about a jerk that is not the one proposed first."""


def memory(arms: int, n: int, people: int, statics: int, planes: int) -> Memory:
    """Memory of arms that nothing is known of; see :func:`jssa_gym.tick.decide.start`."""
    tracks = records((arms, people), TRACK)
    tracks["trusted"] = tracks["seen"] = tracks["radius"] = np.nan
    tracks["anchor"] = tracks["anchor_radius"] = np.nan
    tracks["stamp"] = tracks["first"] = tracks["anchor_stamp"] = -np.inf
    arm = records(arms, MEMORY)
    arm["time"], arm["due"] = np.nan, -np.inf
    arm["people_time"], arm["seen"], arm["resume"] = -np.inf, np.nan, np.nan
    arm["frame"] = -np.inf
    return Memory(
        arm=arm,
        state=np.zeros((arms, 3, n)),
        applied=np.zeros((arms, n)),
        expected=np.zeros((arms, 3, n)),
        last=np.full((arms, 3, n), np.nan),
        anchor=np.full((arms, 3, n), np.nan),
        past=np.full((arms, REMEMBERED, 3, n), np.nan),
        offsets=np.full((arms, REMEMBERED), -np.inf),
        stored=records((arms, n), STOP),
        tracks=tracks,
        growth=np.zeros((arms, people)),
        touch=np.zeros((arms, people)),
        statics=records((arms, statics), AGENT),
        planes=records((arms, planes), PLANE),
    )


def scene_record(arms: int, n: int, people: int, statics: int, planes: int) -> SceneRecord:
    """An empty one."""
    return SceneRecord(
        now=records(arms, SCENE),
        joints=np.zeros((arms, 3, n)),
        ends=np.zeros((arms, 4, people, 3)),
        radius=np.zeros((arms, people)),
        age=np.zeros((arms, people)),
        valid=np.zeros((arms, people), np.bool_),
        person=np.zeros((arms, people), np.int64),
        static_ends=np.zeros((arms, 4, statics, 3)),
        static_radius=np.zeros((arms, statics)),
        normal=np.zeros((arms, planes, 3)),
        offset=np.zeros((arms, planes)),
        alternatives=np.zeros((arms, ALTERNATIVES, n)),
    )


def answer(arms: int, n: int) -> Answer:
    """An empty one."""
    return Answer(records(arms, ANSWER), np.zeros((arms, n)))


def work(robot: ArmRecord, people: int, statics: int, planes: int, *, static_rows: bool) -> Work:
    """Scratch for arms one after the other; ``static_rows`` as of :class:`StepSettings`."""
    n, m = len(robot.links), len(robot.capsules)
    others, sides = (people + statics, planes) if static_rows else (people, 0)
    pairs = (m, others + sides)
    rows = max(m * (others + sides), 1)
    multipliers, active, relief = scratch(n, rows)
    return Work(
        lower=-robot.limits[4],
        upper=robot.limits[4].copy(),
        clipped=np.zeros(n),
        wanted=np.zeros(n),
        jerk=np.zeros(n),
        halt=np.zeros(n),
        people=np.zeros((4, people, 3)),
        radius=np.zeros(people),
        age=np.zeros(people),
        agents=records(others, AGENT),
        agents_now=records(others, AGENT),
        planes=records(sides, PLANE),
        grown=records(people, AGENT),
        reach=np.zeros(people),
        confined=records(people, CONFINED),
        frames=records(n, FRAME),
        segments=records(m, SEGMENT),
        frames_now=records(n, FRAME),
        segments_now=records(m, SEGMENT),
        present=np.full(n, np.nan),
        frames_present=records(n, FRAME),
        segments_present=records(m, SEGMENT),
        met=np.full(2, -1),
        pairs=records(pairs, PAIR),
        pairs_now=records(pairs, PAIR),
        after=np.zeros((3, n)),
        L=np.zeros((rows, n)),
        S=np.zeros(rows),
        owner=np.zeros(rows, np.int64),
        target=np.zeros(rows),
        motion=np.zeros((m * people, 4)),
        pushes=np.zeros((m * people, n)),
        normals=np.zeros((m * people, 3)),
        needed=np.zeros(m * people),
        own=np.zeros((4, n)),
        multipliers=multipliers,
        active=active,
        relief=relief,
        next=records(n, STOP),
        hardest_after=np.full((3, n), np.nan),
        hardest_next=records(n, STOP),
        quickest=np.zeros(1),
        posture=np.zeros(n),
        fastest=np.zeros(n),
        later=np.zeros(n),
        room=np.zeros(m),
        balls=np.zeros((people, 4)),
        axes=np.zeros((7, -(-people // LANES) * LANES)),
        people_off=np.zeros((m, people)),
        planes_off=np.zeros((m, planes)),
        statics_off=np.zeros((m, statics)),
        self_off=np.zeros(len(robot.self_pairs)),
        spare=np.zeros((3, n)),
        told=records(1, ANSWER),
    )
