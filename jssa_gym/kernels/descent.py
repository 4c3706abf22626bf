"""Steps of a search for postures by damped least squares, from many seeds at once; the algebra between is LAPACK's."""

from jssa_gym.kernels.jit import jit


@jit
def weigh(far, limits, power, nearest, since, on, squares):
    """Who goes on, and how much each is damped.

    Args:
        far: How far tools are from their target, shape (s,) [m].
        limits: The distance that counts as reached [m]; the damping at most [m], which is no more than a tool is far;
            and the number of steps that bring a tool no nearer after which it is given up.
        power: 2.0; as a variable it is the C library's power, as Python's own is.
        nearest: The last distances that counted as nearer, shape (s,) [m]; updated.
        since: Steps since then, shape (s,); updated.
        on: Who has gone on so far, shape (s,); updated.
        squares: Result: squares of the dampings and a little, shape (s,) [m²].

    Returns:
        Whether anybody goes on.
    """
    precision, damping, stall = limits
    somebody = False
    for k in range(far.shape[0]):
        if far[k] < 0.98 * nearest[k]:
            nearest[k], since[k] = far[k], 0
        else:
            since[k] += 1
        on[k] = on[k] and far[k] > precision and since[k] < stall
        somebody = somebody or on[k]
        squares[k] = min(damping, far[k]) ** power + 1e-9
    return somebody


@jit
def step_on(steps, on, stride, low, high, q):
    """Postures after a step of those who go on, in which no joint moves further than ``stride`` [rad].

    Args:
        steps: Three parts, each of shape (s, n) [rad]: towards the target, towards the wanted posture, and what that
            would move the tool, to be taken off.
        on: Who goes on, shape (s,).
        stride: [rad].
        low, high: Of the joints, shape (n,) [rad].
        q: Shape (s, n) [rad]; updated.
    """
    there, home, back = steps
    for k in range(q.shape[0]):
        if not on[k]:
            continue
        most = 1e-12
        for j in range(q.shape[1]):
            most = max(most, abs(there[k, j] + home[k, j] - back[k, j]))
        share = min(1.0, stride / most)
        for j in range(q.shape[1]):
            moved = q[k, j] + (there[k, j] + home[k, j] - back[k, j]) * share
            q[k, j] = min(max(moved, low[j]), high[j])
