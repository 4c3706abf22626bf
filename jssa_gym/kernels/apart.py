"""What would become of an arm that stops, and whether it and people keep apart meanwhile."""

from jssa_gym.kernels.capsules import measure_agents, nearest
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.postures import smallest_gap


@jit
def along_stops(states, plans, dt, times, out):
    """Joint positions along stops, Eq. (1) part by part.

    Args:
        states: Where they begin, shape (s, 3, n).
        plans: Shape (s, n) of ``STOP``.
        dt: Control step [s].
        times: After they began, shape (t,) [s]; inf is the end.
        out: Result, shape (s, t, n) [rad].
    """
    for i in range(states.shape[0]):
        for j in range(plans.shape[1]):
            plan = plans[i, j]
            for k in range(times.shape[0]):
                q, v, a, t = states[i, 0, j], states[i, 1, j], states[i, 2, j], times[k]
                for ticks, jerk in (
                    (plan["ramp"], plan["jerk_in"]), (plan["hold"], 0.0), (plan["release"], plan["jerk_out"])
                ):  # fmt: skip
                    span = min(ticks * dt, t)
                    t -= span
                    q += span * (v + span * (a / 2.0 + span * jerk / 6.0))
                    v, a = v + span * (a + span * jerk / 2.0), a + span * jerk
                out[i, k, j] = q


@jit
def stays_apart(standing, positions, people, pairs, d_min, alone, both):
    """Whether an arm keeps off people, and off what stands still and itself, at every sample of a motion.

    Args:
        standing: The arm, and what stands still.
        positions: Of the joints, shape (t, n) or more [rad].
        people: Shape (t, k) of ``AGENT``.
        pairs: Scratch, shape (m, k) of ``PAIR``.
        d_min: Distance to be kept from people [m].
        alone: How far a point of the arm can have come by each sample, shape (t,) [m], ascending ...
        both: ... and that and what a point of a person can have come, shape (t,) [m], ascending.
    """
    k, count = 0, people.shape[0]
    while k < count:
        free = smallest_gap(standing, positions[k])
        measure_agents(standing.segments, people[k], pairs)
        room = nearest(pairs, people.shape[1])[2] - d_min
        if not (room >= 0.0 and free > 0.0):
            return False
        # until that room is used up nothing can happen; two parts of the arm use it up together
        near, touching = both[k] + room, alone[k] + free / 2.0
        while k < count and both[k] <= near and alone[k] <= touching:
            k += 1
    return True
