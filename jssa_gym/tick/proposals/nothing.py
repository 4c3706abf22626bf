"""No filter: the nominal goes on, inside the box."""

from typing import NamedTuple

from jssa_gym.kernels.jit import jit


class Nothing(NamedTuple):
    """Nobody proposes anything but the nominal."""


class Foreign(NamedTuple):
    """A filter that is not compiled proposes; it is asked between the parts of a control step."""


@jit
def keep_nominal(robot, settings, proposal, memory, nominal, work, told, e):
    """Arguments as of :mod:`jssa_gym.tick.proposals`."""
    return 0
