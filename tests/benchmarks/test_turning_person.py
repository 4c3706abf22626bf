"""The person of ``benchmarks/turning_person.py``: walks as it says, and what comes out beside it."""

import runpy

import numpy as np
import pytest
from places import ROOT

from jssa_gym.exceptions import ParameterError

BENCH = runpy.run_path(str(ROOT / "benchmarks" / "turning_person.py"))
Turn, walker, FOUND, DT = BENCH["Turn"], BENCH["walker"], BENCH["FOUND"], BENCH["DT"]


def roots(turn, steps=750):
    human = walker(turn)
    people = [human.reset(np.random.default_rng(0))]
    people += [human.step(DT, people[0]) for _ in range(steps)]
    return np.array([one.start[0, :2] for one in people])


@pytest.mark.parametrize(
    "turn",
    [
        FOUND,
        FOUND._replace(speed=1.5, deceleration=0.2),  # too fast for the way
        FOUND._replace(wait=0.0, stay=0.0, leaving=0.2),
        Turn(2.0, 0.3, 0.8, 0.0, 0.5, 0.6, 2.0, 0.5, 0.3, 1.5),
    ],
)
def test_the_person_goes_to_the_turn_and_back_within_the_accelerations(turn):
    path = roots(turn)
    begin, end = np.array([turn.start, turn.offset]), np.array([turn.turn, turn.side])
    np.testing.assert_allclose(path[0], begin, atol=1e-12)
    velocity = np.diff(path, axis=0) / DT
    change = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    assert change.max() <= max(turn.acceleration, turn.deceleration) * DT + 1e-9
    assert np.linalg.norm(velocity, axis=1).max() <= max(turn.speed, turn.leaving) + 1e-9
    gap = np.linalg.norm(path - end, axis=1)
    assert gap.min() < 1e-3
    # all on the line through both
    way = (end - begin) / np.linalg.norm(end - begin)
    np.testing.assert_allclose((path - begin) @ (-way[1], way[0]), 0.0, atol=1e-9)
    # it slows down before the turn as it should
    before = np.linalg.norm(velocity, axis=1)[: gap.argmin()]
    slowing = -np.diff(before)[np.diff(before) < -1e-9]
    assert np.median(slowing) == pytest.approx(turn.deceleration * DT, rel=1e-6)


def test_who_comes_too_near_scores_worst():
    assert BENCH["score"](np.array(FOUND._replace(turn=0.4, side=0.0))) == 1e3
    with pytest.raises(ParameterError):
        walker(FOUND._replace(turn=0.4, side=0.0)).reset(np.random.default_rng(0))


@pytest.mark.long
def test_what_comes_out_beside_the_person_found():
    found = BENCH["outcome"](FOUND)
    assert BENCH["error"](found) < 19.0
    jssa, ssa = (trace.distance.min() for trace in (found.jssa, found.ssa))
    assert (jssa, ssa) == (pytest.approx(0.446, abs=0.01), pytest.approx(0.360, abs=0.01))
    verdicts = {claim.text: claim.verdicts["as published"].holds for claim in BENCH["verdicts"](found)}
    assert {text for text, holds in verdicts.items() if not holds} == {
        "the jerk stays within about 2000 °/s³",
        "the person's are left arm, core, head, core (4-2-1-2)",
        "SSA: active for longer",
        "SSA: the distance fluctuates more (mean |D̈|)",
        "λ₂ up: triggered later",
    }
