"""Reasons as numbers: every text that a decision can give has a code of its own, and `info` has both."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import jssa_gym
from jssa_gym import FILTERS, ArmEnv, SensorModel, Shield, Status, make_filter
from jssa_gym.kernels.people import BROKEN, COVERED, LOST, NEVER
from jssa_gym.kernels.verification import ENTRY, HALF_SPACE, REACH, SELF, STATIC
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import reasons
from jssa_gym.shields.reasons import BAD_INPUTS, FIXTURES, REASONS, SAMPLES, UNFIT, reason_code
from jssa_gym.shields.words import Told, in_words
from jssa_gym.tick import codes
from jssa_gym.tick.people import BACK, NO_TIME
from jssa_gym.types import CapsuleSet, Decision

PACKAGE = Path(jssa_gym.__file__).parent

GIVES = ("failed", "decided", "_emergency", "_replace", "Decision")
"""Calls that take a reason."""

CODES = {value: name for name, value in vars(codes).items() if isinstance(value, int) and value >= 100}
"""What the control step says, by numbers, under the names that it has for them."""

INDIRECT = {"TRUST", "FOREIGN", "OTHER_TICK"}
"""The first of several; an answer that somebody else words; a reason that has no number."""

BY_WAY_OF = {"NOT_FINITE_PEOPLE"}
"""Reckoned from the first of its kind."""


def code_of(reason, status):
    nothing = np.zeros(6)
    return reason_code(Decision(nothing, nothing, status, reason, 0.0, 1.0, (0, 0), 0.0, 0))


def texts_in(node):
    """The texts that an expression can come to, with "x" for what is filled in; none that begin with another reason."""
    match node:
        case ast.Constant(value=str(text)):
            yield text
        case ast.Subscript(value=ast.Name(id="REASONS"), slice=ast.Attribute(value=ast.Name(id="codes"), attr=name)):
            yield REASONS[getattr(codes, name)]
        case ast.JoinedStr(values=values):
            yield "".join(next(iter(texts_in(v)), "x") for v in values)
        case ast.FormattedValue(value=value):
            yield from texts_in(value)
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
            case ast.FunctionDef(name="of_clipping"):
                for inner in ast.walk(node):
                    if isinstance(inner, ast.Return) and inner.value is not None:
                        yield from texts_in(inner.value)


def every_text():
    """What filters say that are not compiled, and what is said of them."""
    found = set()
    for path in (PACKAGE / "shields").glob("*.py"):
        # what the control step says becomes text there, in test_every_code_is_told_in_words_of_its_own
        found |= set(given(ast.parse(path.read_text()))) if path.name != "words.py" else set()
    # what begins with another reason adds to it
    return sorted(text for text in found if text and not text.startswith(("x; ", "x (")))


def known(text):
    return {code for status in Status if (code := code_of(text, status)) % 100}


@pytest.fixture
def tell(robot, make_scene):
    """Words for an answer of the control step, given by its fields."""
    chosen = make_filter("stop", robot, 0.008, failsafe=FailsafeParams())
    at, still = np.array([[3.0, 0.0, 1.2]]), np.zeros((1, 3))
    post = CapsuleSet(at, at, still, still, np.array([0.1]), ("hand",), np.zeros(1, np.int64))
    scene = make_scene([robot.home, np.zeros(6), np.zeros(6)], post)._replace(static=post)
    chosen.reset(scene)
    assert chosen.decide(scene, np.zeros(6)).status == Status.NOMINAL
    chosen.reading.wrong.update(dict.fromkeys(chosen.reading.wrong, "no such thing"))
    fine = Told(*chosen.records.answer.told.item())

    def say(code, nominal=None, **fields):
        told = fine._replace(**{"status": abs(code) // 100, "code": code, "capsule": 0, "other": 0, **fields})
        return in_words(told, np.zeros(6) if nominal is None else nominal, robot, chosen.records, chosen.reading)

    return say


VARIETIES = {
    codes.REACH: [{"detail": REACH}],
    codes.ENTRY: [{"detail": ENTRY}],
    codes.MEETS: [{"detail": kind} for kind in (HALF_SPACE, STATIC, SELF)],
    codes.SCENE: [{"detail": what} for what in range(len(FIXTURES))],
    codes.PEOPLE: [{"detail": what} for what in (0, NO_TIME, BACK)],
    codes.ANSWER: [{"detail": what} for what in range(1, len(UNFIT))],
    codes.LAGS: [{"ticks": ticks} for ticks in (1, 3)],
    **{
        codes.TRUST + 1 + k: [{"detail": cover} for cover in (COVERED, LOST, NEVER, BROKEN)]
        for k in range(len(SAMPLES))
    },
}
"""What a code can be said of, where that is more than one thing."""

SAID = sorted({*VARIETIES, *(code for code, name in CODES.items() if name not in {*INDIRECT, "UNVERIFIED"})})


@pytest.mark.parametrize("code", SAID)
def test_every_code_is_told_in_words_of_its_own(tell, code):
    status, said = code // 100, set()
    for fields in VARIETIES.get(code, [{}]):
        text = tell(code, **fields)
        said.add(text)
        assert code_of(text, status) == code, text
        if status != Status.FAULT:
            continue
        assert code_of(tell(code, unverified=True, **fields), status) == code
        assert tell(code, unverified=True, **fields).endswith("no verified stop")
        assert code_of(tell(-code, **fields), status) == code
        both = tell(code, np.full(6, np.nan), **fields)
        assert code_of(both, status) == codes.NOT_FINITE_NOMINAL
        assert text in both
    assert len(said) == len(VARIETIES.get(code, [{}])) - (codes.TRUST < code < codes.TRUST + 10)


def test_a_stop_that_is_not_verified_says_what_is_in_the_way(tell):
    for code in (codes.LIMITS, codes.UNDECIDED, codes.REACH, codes.MEETS, codes.ENTRY):
        kind = VARIETIES.get(code, [{}])[0]
        alone, text = tell(code, **kind), tell(code, status=Status.FAULT, **kind)
        assert text == f"no verified stop: {alone}"
        assert code_of(text, Status.FAULT) == codes.UNVERIFIED


def test_people_of_another_tick_have_words_without_a_number(tell):
    assert tell(codes.OTHER_TICK) == "the people are of another tick"
    assert code_of(tell(codes.OTHER_TICK), Status.FAULT) == codes.OTHER_TICK


def test_every_code_is_said_somewhere():
    """What nobody says any more is no code of the control step."""
    said = {
        node.attr
        for folder in ("tick", "shields")
        for path in (PACKAGE / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "codes"
    }
    assert set(CODES.values()) - said == BY_WAY_OF
    assert len(BAD_INPUTS) - 1 == codes.UNMEASURED - codes.NOT_FINITE_NOMINAL + 1


def test_every_reason_that_the_sources_give_has_a_code():
    texts = every_text()
    assert len(texts) > 4
    assert [text for text in texts if not known(text)] == []


def test_every_code_has_a_reason_that_somebody_gives():
    others = set().union(*(known(text) for text in every_text()))
    assert others | {*SAID, codes.UNVERIFIED} == set(REASONS)
    # all that is said of a compiled filter is a code of the control step
    assert {*SAID, codes.UNVERIFIED} == set(REASONS)


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


@pytest.mark.sampled(3)
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
