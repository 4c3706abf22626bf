"""Below what something is at rest: one threshold for each unit and purpose."""

from jssa_gym.kernels.jit import jit

REST_SPEED = 1e-6
"""Speed of a point of the arm below which it is at rest [m/s]: what rounding leaves. It is what a verification goes by;
what counts as a moving contact is coarser (:data:`jssa_gym.envs.arm.MOVING`)."""

REST_JOINTS = 1e-6
"""Speed [rad/s] and acceleration [rad/s²] of joints below which they rest: what rounding leaves of a stop that was
played tick by tick."""

REST_PLANNED = 1e-9
"""Speed [rad/s] and acceleration [rad/s²] up to which a plan, a stop or a move, ends in rest. Its end is computed at
once: less is lost to rounding than where it is played tick by tick, and what is left of it here is left there too."""

REST_COMMAND = 1e-9
"""By how much the command of a joint that rests may change in a tick [rad]: rounding of recorded positions."""


@jit
def at_rest(state):
    """Whether a joint state (3, n) rests, up to rounding."""
    for row in range(1, 3):
        for j in range(state.shape[1]):
            if not abs(state[row, j]) < REST_JOINTS:
                return False
    return True
