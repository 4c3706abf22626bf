"""Reasons as numbers: every text that a decision can give has a code of its own, and `info` has both."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import jssa_gym
from jssa_gym import FILTERS, ArmEnv, SensorModel, Shield, Status, make_filter
from jssa_gym.safety import joints, monitor
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import reasons
from jssa_gym.shields.reasons import REASONS, reason_code
from jssa_gym.types import Decision

PACKAGE = Path(jssa_gym.__file__).parent

GIVES = ("_failed", "_brake", "_fault", "_blind", "_decided", "_replace", "_UnsolvedError", "Decision", "Watch")
"""Calls that take a reason."""

MONITORS = ("monitor", "joints")

RETURNS = ("_describe", "follow", "of_clipping", "_take", "_date", "_undated", "_lagging")
"""Functions that return one."""


def code_of(reason, status):
    nothing = np.zeros(6)
    return reason_code(Decision(nothing, nothing, status, reason, 0.0, 1.0, (0, 0), 0.0, 0))


def texts_in(node):
    """The texts that an expression can come to, with "x" for what is filled in; none that begin with another reason."""
    match node:
        case ast.Constant(value=str(text)):
            yield text
        case ast.JoinedStr(values=values):
            verdicts = [v for v in values if isinstance(v, ast.FormattedValue) and "_VERDICTS" in ast.unparse(v)]
            for verdict in monitor._VERDICTS if verdicts else ("",):
                yield "".join(
                    str(v.value) if isinstance(v, ast.Constant) else verdict if v in verdicts else "x" for v in values
                )
        case ast.IfExp(body=body, orelse=other):
            yield from texts_in(body)
            yield from texts_in(other)
        case ast.BinOp(op=ast.Add(), left=left):
            yield from texts_in(left)
        case ast.Tuple(elts=elements):
            for element in elements:
                yield from texts_in(element)
        case ast.Name(id=name) if hasattr(reasons, name):
            yield getattr(reasons, name)


def given(tree):
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in GIVES:
                for argument in (*node.args, *(k.value for k in node.keywords if k.arg == "reason")):
                    yield from texts_in(argument)
            case ast.Assign(targets=[target], value=value) if re.search(r"\breason\b", ast.unparse(target)):
                yield from texts_in(value)
            case ast.FunctionDef(name=name) if name in RETURNS:
                for inner in ast.walk(node):
                    if isinstance(inner, ast.Return) and inner.value is not None:
                        yield from texts_in(inner.value)


def every_text():
    found = {*reasons.FAULTS, *reasons.UNFIT, *joints.WRONG.values(), joints.MOVING, joints.NOT_FINITE}
    for path in [*(PACKAGE / "shields").glob("*.py"), *(PACKAGE / "safety" / f"{name}.py" for name in MONITORS)]:
        found |= set(given(ast.parse(path.read_text())))
    # what begins with another reason adds to it
    return sorted(text for text in found if text and not text.startswith("x; "))


def known(text):
    return {code for status in Status if (code := code_of(text, status)) % 100}


def test_every_reason_that_the_sources_give_has_a_code():
    texts = every_text()
    assert len(texts) > 30
    assert [text for text in texts if not known(text)] == []


def test_every_code_has_a_reason_that_the_sources_give():
    assert set().union(*(known(text) for text in every_text())) == set(REASONS)


def test_no_two_reasons_share_a_code_by_chance():
    assert all(known(text.replace("...", "x")) == {code} for code, text in REASONS.items())
    assert all(1 <= code // 100 <= 4 and code % 100 for code in REASONS)


@pytest.mark.parametrize("status", list(Status))
def test_what_filters_of_users_say_is_the_rest_of_its_status(status):
    assert code_of("tired", status) == (0 if status == Status.NOMINAL else 100 * status)
    assert code_of("", status) == 100 * status


def test_a_quoted_reason_is_not_taken_for_the_reason():
    assert code_of("the filter failed: ValueError: head of person 1: too old", Status.FAULT) == 421
    assert code_of("head of person 1: too old, nothing to trust for 0.3 s; no verified stop", Status.FAULT) == 411
    assert code_of("a can reach b can reach part before it rests, in 0.1 s", Status.FAILSAFE) == 303


@pytest.mark.parametrize("stop", [True, False])
@pytest.mark.parametrize("name", FILTERS)
def test_no_built_in_filter_says_what_has_no_code(name, stop):
    env = ArmEnv(human="pursuit", terminate_on=())
    sensor = SensorModel(env, "all that is reported")
    params = FailsafeParams(position_error=0.01) if stop else None
    shield = Shield(sensor, make_filter(name, env.robot, env.dt, viability=stop, failsafe=params))
    _, info = shield.reset(seed=0)
    rng, seen = np.random.default_rng(0), set()
    for k in range(150):
        action = np.full(6, np.nan) if k % 40 == 39 else rng.uniform(-1.5, 1.5, 6)
        info = shield.step(action)[4]
        code, status = info["shield/reason_code"], info["shield/status"]
        assert type(code) is int
        assert (code % 100 > 0) == (status != Status.NOMINAL), info["shield/reason"]
        seen.add(code)
    assert 401 in seen
    assert code // 100 == status


def test_the_docs_list_every_code():
    text = (PACKAGE.parent / "docs" / "filters.md").read_text()
    rows = dict(re.findall(r"^\| (\d{3}) \| `?(.*?)`? \|$", text, re.MULTILINE))
    assert {int(code): reason for code, reason in rows.items()} == REASONS
