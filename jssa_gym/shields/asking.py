"""Filters that propose in Python: asked between the two halves of the compiled control step, whatever they answer."""

from typing import TYPE_CHECKING

import numpy as np

from jssa_gym.shields.alarm import Alarm
from jssa_gym.shields.reading import words_of
from jssa_gym.shields.reasons import REASONS
from jssa_gym.shields.tick import Tick
from jssa_gym.tick import codes, loop
from jssa_gym.tick.decide import ANSWERED, ASK
from jssa_gym.types import Array, Decision, Scene, Status

if TYPE_CHECKING:
    from jssa_gym.shields.filter import SafetyFilter

_MOST = 2**31
"""Numbers of capsules and rows lie below."""


def ask(filter: "SafetyFilter", alarm: Alarm, scene: Scene | None, nominal: Array) -> Decision | None:
    """Let a filter's ``respond`` propose; the control step before and after it. The proposal, if it got that far."""
    view, work = filter.records.view, filter.records.work
    stage = loop.prepare(view.arms, view.nominal)
    if stage == ANSWERED or scene is None:  # without a scene it always is
        return None
    decision, tick = None, _tick(filter, scene, nominal)
    if stage == ASK:
        decision = _response(filter, alarm, tick)
        if decision.status == Status.FAULT:
            loop.stop(view.arms, codes.FOREIGN)
            return decision
        work.wanted[:] = decision.jerk
        told, (row, column) = view.told, decision.pair
        told["status"], told["code"] = decision.status, 0
        told["phi"], told["distance"] = decision.phi, decision.distance
        told["row"], told["column"], told["slack"], told["rows"] = row, column, decision.slack, decision.rows
    held = loop.settle(view.arms, view.nominal)
    if held:
        work.wanted[:] = _amended(filter, alarm, tick, decision, held)
        loop.settle_held(view.arms)
    return decision


def _tick(filter: "SafetyFilter", scene: Scene, nominal: Array) -> Tick:
    """What ``respond`` may see, and change as it likes."""
    records, people = filter.records, filter.records.sizes[0]
    work = records.work
    return Tick(
        filter.robot,
        scene,
        records.view.state.copy(),
        work.agents[:people].copy(),
        nominal.copy(),
        work.lower.copy(),
        work.upper.copy(),
        work.clipped.copy(),
    )


def _response(filter: "SafetyFilter", alarm: Alarm, tick: Tick) -> Decision:
    try:
        return _sound(filter.respond(tick), tick.nominal.shape)
    except Exception as error:  # whatever a filter runs into, the arm must go on safely
        reason = f"{REASONS[codes.FILTER_FAILED]}: {type(error).__name__}: {words_of(error)}"
        alarm.failure("filter", f"{reason}; the arm brakes")
        return filter.failed(tick, reason)


def _amended(filter: "SafetyFilter", alarm: Alarm, tick: Tick, decision: Decision | None, held: int) -> Array:
    """Another jerk, in which the first ``held`` joints go on with the stored stop."""
    work, proposed = filter.records.work, filter.records.view.jerk
    halt = work.halt.copy()
    try:
        if decision is None:
            return np.concatenate([halt[:held], proposed[held:]])
        jerk = filter.amend(tick, decision._replace(jerk=proposed.copy()), held, halt)
        if jerk.shape != halt.shape or jerk.dtype != np.float64:
            raise ValueError(f"the answer has shape {jerk.shape} and type {jerk.dtype}")
    except Exception:  # whatever a filter runs into, the arm must go on safely
        alarm.failure("joints", "the filter failed to spare joints; all follow the stored stop")
        return halt
    return jerk


def foreseen(filter: "SafetyFilter", decision: Decision, jerk: Array) -> tuple[float, float, tuple[int, int]]:
    """What a filter's ``foresee`` says of another jerk than the one that it proposed; NaN where it fails."""
    try:
        phi, distance, (row, column) = filter.foresee(decision, jerk)
        return float(phi), float(distance), (int(row), int(column))
    except Exception:  # what it says is for the eye; the stop is on its way
        return np.nan, np.nan, (-1, -1)


def _sound(decision: Decision, shape: tuple[int, ...]) -> Decision:
    """A filter's answer, its numbers as Python's.

    Raises:
        AttributeError, TypeError, ValueError: It is no decision, its jerk no float64 array of that shape, or another
            field not what it should be.
    """
    if not isinstance(decision, Decision):
        raise TypeError(f"the answer has to be a Decision, got {type(decision).__name__}")
    jerk = decision.jerk
    if jerk.shape != shape or jerk.dtype != np.float64:
        raise ValueError(f"the answer has shape {jerk.shape} and type {jerk.dtype}")
    if (
        type(decision.phi) is type(decision.distance) is type(decision.slack) is float
        and type(decision.status) is Status
        and type(decision.reason) is str
        and type(decision.pair) is tuple
        and len(decision.pair) == 2
        and type(decision.pair[0]) is type(decision.pair[1]) is type(decision.rows) is int
        and max(decision.pair[0], decision.pair[1], decision.rows) < _MOST
        and min(decision.pair[0], decision.pair[1], decision.rows) >= -1
    ):
        return decision
    row, column = decision.pair
    if not all(-1 <= int(number) < _MOST for number in (row, column, decision.rows)):
        raise ValueError(f"the answer's pair {decision.pair} or rows {decision.rows} are no numbers")
    return decision._replace(
        status=Status(decision.status),
        reason=str(decision.reason),
        phi=float(decision.phi),
        distance=float(decision.distance),
        pair=(int(row), int(column)),
        slack=float(decision.slack),
        rows=int(decision.rows),
    )
