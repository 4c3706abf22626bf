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
from jssa_gym.kernels.apart import along_stops, stays_apart
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import PAIR, STOP, records
from jssa_gym.kernels.stopping import plan_stop
from jssa_gym.kernels.verification import keeps_limits
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import levers
from jssa_gym.safety.postures import standing
from jssa_gym.shields.reasons import OUTSIDE
from jssa_gym.types import Array, Planes, Trace

LOOKED_AT = 1.0
"""How long after its onset an intervention is judged [s]."""


def false_interventions(
    trace: Trace, robot: RobotModel, states: Array, bounds: Array, agents: NDArray
) -> NDArray[np.bool_]:
    """Whether each intervention of a kinematic episode was false; see the module's docstring.

    Args:
        trace: The episode.
        robot: Its robot, where it stood.
        states: Joint states, that before the first step too, shape (T + 1, 3, n) [rad, rad/s, rad/s²].
        bounds: Lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        agents: People after every step, moving as from the step before, shape (T, k) of ``AGENT``.

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
    late = np.arange(round(LOOKED_AT / dt), dtype=np.float64) * dt
    position = np.empty((len(onsets), len(late), robot.n))
    along_stops(after, plans, dt, late, position)
    # from sample to sample no point of the arm, and none of a person, comes farther than this
    turned = np.abs(np.diff(position, axis=1, prepend=position[:, :1]))
    arm = (turned @ levers(robot).T).max(axis=2).cumsum(axis=1)
    ends = np.stack([agents["start_velocity"], agents["end_velocity"]])
    human = np.linalg.norm(ends, axis=-1).max(axis=(0, 2)).cumsum() * dt
    around = standing(robot, Planes(trace.plane_normal, trace.plane_offset, trace.plane_names))
    pairs = records((len(robot.capsules), agents.shape[1]), PAIR)
    for i in np.flatnonzero(unharmed):
        people = agents[onsets[i] : onsets[i] + len(late)]
        alone = arm[i, : len(people)]
        both = alone + human[onsets[i] : onsets[i] + len(late)]
        unharmed[i] = np.isfinite(both[-1]) and stays_apart(
            around, position[i], people, pairs, trace.d_min, alone, both
        )
    return unharmed
