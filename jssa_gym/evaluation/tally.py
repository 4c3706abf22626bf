"""What the episodes of a campaign amount to."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jssa_gym.evaluation.rows import Cell, StressRow
from jssa_gym.evaluation.statistics import Rate
from jssa_gym.validation import known_name


@dataclass(frozen=True, slots=True)
class Tally:
    """Episodes that have something in common; rates of episodes with Clopper-Pearson 95 % intervals."""

    group: tuple[str, ...]
    """What they have in common."""
    contacts: Rate
    """Any contact."""
    moving: Rate
    """A contact with a touching point of the arm faster than 1e-3 m/s, at a tick or seen by MuJoCo between."""
    violations: Rate
    """A joint limit exceeded, at a tick or seen by MuJoCo between."""
    contact_speed: float
    """Largest [m/s]."""
    excess: float
    """By what share of its limit a joint exceeded it at most; 0 if none did."""
    stored: float
    """Share of the ticks in which a stored stop went on and nothing was faulty."""
    faulty: float
    """Share of the ticks with a FAULT."""
    intervened: float
    """Share of the ticks with an intervention."""
    no_stop: float
    """Share of the ticks in which the wanted jerk had no stop inside the joint limits."""
    joint_speed: float
    """Mean Euclidean norm of the joint velocities [rad/s]."""
    judged: int
    """Episodes that MuJoCo judged."""
    disagreements: int
    """Of them, those in which it found something else."""
    overlaps: int
    """Of them, those in which the arm met the table or itself."""


def tally(episodes: Sequence[StressRow], by: Sequence[str]) -> list[Tally]:
    """Group episodes and count.

    Args:
        episodes: Of one campaign.
        by: What makes a group: fields of :class:`~jssa_gym.evaluation.rows.Cell`.

    Returns:
        A tally a group, in the order in which the groups appear.

    Raises:
        ParameterError: ``by`` names something else.
    """
    for name in by:
        known_name("column to group by", name, Cell._fields)
    groups: dict[tuple[str, ...], list[StressRow]] = {}
    for episode in episodes:
        groups.setdefault(tuple(getattr(episode, name) for name in by), []).append(episode)
    return [_tally(group, members) for group, members in groups.items()]


def _tally(group: tuple[str, ...], episodes: Sequence[StressRow]) -> Tally:
    count, ticks = len(episodes), sum(e.steps for e in episodes)
    judged = [e for e in episodes if e.judged]
    return Tally(
        group,
        contacts=Rate.of(sum(e.contact for e in episodes), count),
        moving=Rate.of(sum(e.touched_moving for e in episodes), count),
        violations=Rate.of(sum(e.exceeds for e in episodes), count),
        contact_speed=max(max(e.contact_speed, e.judged_speed) for e in episodes),
        excess=max(0.0, *(max(e.excess, e.judged_excess) for e in episodes)),
        stored=sum(e.failsafe for e in episodes) / ticks,
        faulty=sum(e.faulty for e in episodes) / ticks,
        intervened=sum(e.interventions for e in episodes) / ticks,
        no_stop=sum(e.no_stop for e in episodes) / ticks,
        joint_speed=float(np.mean([e.joint_speed for e in episodes])),
        judged=len(judged),
        disagreements=sum(not e.agrees for e in judged),
        overlaps=sum(e.overlaps > 0 for e in judged),
    )
