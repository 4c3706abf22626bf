"""What of a control step can be compiled by itself, beside the rest; see :mod:`jssa_gym.kernels.second_compiler`."""

from typing import Any

from numba import config, typeof, types

from jssa_gym.kernels.compiled import compile_together
from jssa_gym.tick import loop
from jssa_gym.tick.decide import take_alternative
from jssa_gym.tick.proposals.rows import project
from jssa_gym.tick.propose import KINDS

_JERK = types.Array(types.float64, 1, "C")


def parts_of(arms: Any) -> list[tuple[Any, tuple[Any, ...]]]:
    """Kernels and types of their arguments, in the order in which :func:`~jssa_gym.tick.loop.decide_all` needs them.

    Args:
        arms: The type of what it takes.
    """
    kinds = dict(zip(arms.layout.fields, arms.layout.types, strict=True))
    settings, work = kinds["settings"], kinds["work"]
    parts: list[tuple[Any, tuple[Any, ...]]] = [(take_alternative, (arms, _JERK, types.int64))]
    if KINDS[kinds["proposal"].instance_class].projected:
        parts.append((project, (settings, _JERK, types.int64, _JERK, _JERK, work)))
    return parts


def compile_parts(arms: Any, nominal: Any, asked: Any) -> None:
    """Let a second process begin to compile what :func:`~jssa_gym.tick.loop.decide_all` needs for these arguments.

    Nothing if that is compiled or cached.
    """
    if not config.DISABLE_JIT:
        of_arms, *others = map(typeof, (arms, nominal, asked))
        compile_together(loop.decide_all, (of_arms, *others), lambda: parts_of(of_arms))
