"""What would have happened without an intervention, known only afterwards.

An intervention begins with the first of a row of steps in which the filter changes the jerk, and not only because the
jerk was wanted outside its bounds. It is called **false** if what was wanted would have done no harm: from the state
before that step the arm obeys the wanted jerk, clipped to its bounds, for the step, makes its jerk-limited stop and
rests, beside the people as they were recorded, until 1 s after the onset or until the recording ends. No harm is done
if

- no robot-human distance is below d_min at a control step of that time, and the arm keeps off half-spaces and itself;
- step and stop keep all joint limits, at every instant.

What it does not say: whether the intervention was wrong. It looks at people's future, of which a filter knows only what
it assumes, so that a false one may have been right given what was known. The recorded people do not react to the other
arm; only one step is granted, not the plan behind it; and an onset shortly before the end is judged by what is left.
"""

import numpy as np
from numpy.typing import NDArray

from jssa_gym.evaluation.spans import spans
from jssa_gym.kernels.capsules import measure_agents, measure_planes, measure_self
from jssa_gym.kernels.chain import forward, place
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import FRAME, PAIR, SEGMENT, STOP, records
from jssa_gym.kernels.stopping import plan_stop
from jssa_gym.kernels.verification import keeps_limits
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import levers
from jssa_gym.shields.reasons import OUTSIDE
from jssa_gym.types import Array, Trace

HORIZON = 1.0
"""How long after its onset an intervention is judged [s]."""


def along_stop(state: Array, plans: NDArray, dt: float, t: float | Array) -> Array:
    """Joint positions (..., n) the time t [s] after stops began, in the end for inf: Eq. (1) part by part.

    ``state`` (..., 3, n) is where the stops of ``plans`` (..., n) began; all have to broadcast.
    """
    q, v, a = state[..., 0, :], state[..., 1, :], state[..., 2, :]
    for part, jerk in (("ramp", plans["jerk_in"]), ("hold", 0.0), ("release", plans["jerk_out"])):
        span = np.minimum(plans[part] * dt, t)
        t = t - span
        q = q + span * (v + span * (a / 2.0 + span * jerk / 6.0))
        v, a = v + span * (a + span * jerk / 2.0), a + span * jerk
    return q


def false_interventions(
    trace: Trace, robot: RobotModel, states: Array, bounds: Array, agents: NDArray, planes: NDArray
) -> NDArray[np.bool_]:
    """Whether each intervention of a kinematic episode was false; see the module's docstring.

    Args:
        trace: The episode.
        robot: Its robot, where it stood.
        states: Joint states, that before the first step too, shape (T + 1, 3, n) [rad, rad/s, rad/s²].
        bounds: Lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        agents: People after every step, moving as from the step before, shape (T, k) of ``AGENT``.
        planes: Half-spaces, shape (p,) of ``PLANE``.

    Returns:
        One an onset; none without people.
    """
    onsets = [first for first, _ in spans(trace.intervened & (trace.reason != OUTSIDE))]
    if not (onsets and agents.shape[1]):
        return np.zeros(0, np.bool_)
    dt, shape = trace.dt, (len(onsets), robot.n)
    after, plans, unharmed = np.zeros((len(onsets), 3, robot.n)), records(shape, STOP), np.zeros(len(onsets), np.bool_)
    for i, first in enumerate(onsets):
        if np.isfinite(trace.nominal[first]).all():
            jerk = np.clip(trace.nominal[first], -bounds[4], bounds[4])
            integrate(states[first], jerk, dt, after[i])
            plan_stop(after[i], bounds, dt, plans[i])
            unharmed[i] = keeps_limits(states[first], jerk, after[i], plans[i], bounds, dt)
    late = np.arange(round(HORIZON / dt), dtype=np.float64)[:, None] * dt
    position = along_stop(after[:, None], plans[:, None], dt, late)
    # from sample to sample no point of the arm, and none of a person, comes farther than this
    turned = np.abs(np.diff(position, axis=1, prepend=position[:, :1]))
    arm = (turned @ levers(robot).T).max(axis=2).cumsum(axis=1)
    ends = np.stack([agents["start_velocity"], agents["end_velocity"]])
    human = np.linalg.norm(ends, axis=-1).max(axis=(0, 2)).cumsum() * dt
    clearance = _Clearance(robot, planes, agents.shape[1])
    for i in np.flatnonzero(unharmed):
        people, k = agents[onsets[i] : onsets[i] + len(late)], 0
        alone = arm[i, : len(people)]
        both = alone + human[onsets[i] : onsets[i] + len(late)]
        unharmed[i] = np.isfinite(both[-1])
        while unharmed[i] and k < len(people):
            far, free = clearance(position[i, k], people[k])
            room = far - trace.d_min
            unharmed[i] = room >= 0.0 and free > 0.0
            # until that room is used up nothing can happen; two parts of the arm use it up together
            k = min(both.searchsorted(both[k] + room, "right"), alone.searchsorted(alone[k] + free / 2.0, "right"))
    return unharmed


class _Clearance:
    """Distance of an arm to people, and to half-spaces and itself [m]."""

    def __init__(self, robot: RobotModel, planes: NDArray, people: int) -> None:
        m = len(robot.capsules)
        self._robot, self._planes, self._state = robot, planes, np.zeros((3, robot.n))
        self._frames, self._segments = records(robot.n, FRAME), records(m, SEGMENT)
        self._pairs, self._heights = records((m, people), PAIR), records((m, len(planes)), PAIR)
        self._own = np.full(len(robot.self_pairs), np.inf)

    def __call__(self, position: Array, people: NDArray) -> tuple[float, float]:
        self._state[0] = position
        forward(self._robot.links, self._state, self._frames)
        place(self._frames, self._robot.capsules, self._segments)
        measure_agents(self._segments, people, self._pairs)
        measure_planes(self._segments, self._planes, self._heights)
        measure_self(self._segments, self._robot.self_pairs, self._own)
        free = min(self._heights["distance"].min(initial=np.inf), self._own.min(initial=np.inf))
        return float(self._pairs["distance"].min()), float(free)
