"""The docstring of ``ArmEnv``, which is written by hand: what it says is what the tables and the code say."""

import inspect
import re
from typing import get_args, get_type_hints

import gymnasium as gym
import pytest

import jssa_gym
from jssa_gym.envs import TASKS, ArmEnv
from jssa_gym.envs.arm import DT, MOVING, START_CLEARANCE
from jssa_gym.envs.observation import arm_features, feature_table
from jssa_gym.envs.options import ENDINGS, OPTIONS
from jssa_gym.envs.surroundings import OVER_POSITION, OVER_VELOCITY
from jssa_gym.envs.tasks import COMMON_TERMS
from jssa_gym.envs.world import SCENES
from jssa_gym.registration import ENTRIES

TEXT, _, ARGUMENTS = (inspect.getdoc(ArmEnv) or "").partition("\nArgs:\n")
PROSE = " ".join(TEXT.split())
SIGNATURE = inspect.signature(ArmEnv)


def told(begin: str, end: str) -> str:
    """What the docstring says between two phrases, each of which occurs once."""
    assert PROSE.count(begin) == 1
    return PROSE.partition(begin)[2].partition(end)[0]


def literals(text: str) -> list[str]:
    """Names and values in double backquotes."""
    return [name.strip('"') for name in re.findall(r"``([^`]+)``", text)]


def test_the_tables_are_those_of_the_code(robot):
    tables = [
        [line.strip() for line in block.strip("\n").splitlines()]
        for block in re.findall(r"::\n\n((?:    .+\n?)+)", TEXT)
    ]
    common = arm_features(robot, 6)
    expected = [feature_table(common).splitlines()]
    for task in (kind() for kind in TASKS.values()):
        features = feature_table((*common, *task.features(robot))).splitlines()[len(common) :]
        terms = [f"{t.weight:+7.2f} · {t.name:<10} {t.text}".strip() for t in (*task.terms, *COMMON_TERMS)]
        expected.append(features + terms)
    assert tables == expected


def test_the_tasks_are_described_as_they_describe_themselves():
    described = re.findall(r"\*\*(\w+)\*\* \(default human: ``(\w+)``\)\. (.*?) ::", PROSE)
    assert described == [(task.name, task.human, task.text) for task in (kind() for kind in TASKS.values())]


def test_the_numbers_are_those_of_the_code():
    assert f"beside moving people, {1.0 / DT:g} Hz" in PROSE
    assert f"held over each step of {DT} s" in PROSE
    assert f"swing over by {1e3 * OVER_POSITION:g} mrad" in PROSE
    assert f"whose velocity by {100.0 * OVER_VELOCITY:g} % of its limit" in PROSE
    assert told("touching point faster than ", " m/s") == f"{MOVING:.0e}".replace("e-0", "e-")
    assert told("nobody closer than ", " m.") == str(START_CLEARANCE)
    steps = {gym.spec(entry.env_id()).max_episode_steps for entry in ENTRIES.values()}
    assert [f"after {n:,} steps ({n * DT:g} s)" in PROSE for n in steps] == [True]
    assert f"(the base stands at {SCENES['table']:g} m" in ARGUMENTS


def test_endings_and_options_are_those_that_are_accepted():
    said = literals(told("**Termination**: what ``terminate_on`` names:", "; the default"))
    assert sorted(said) == sorted(ENDINGS)
    default = SIGNATURE.parameters["terminate_on"].default
    assert told("the default is ", ". A contact") == " and ".join(default).replace("_", " ")
    assert literals(told("``reset(options={...})`` takes", "**info**")) == list(OPTIONS)


def test_info_is_what_is_reported():
    env = ArmEnv(human="none")
    _, info = env.reset(seed=0)
    names = literals(told("the same keys and types after reset and step:", "and what the task says"))
    common = {key for key in info if not key.startswith("reward/")}
    assert set(names) == common | {"d_min", "reward/<term>"}


def test_the_arguments_are_those_of_the_class():
    entries = re.findall(r"^    ([\w, ]+): (.*)$", ARGUMENTS.partition("\nRaises:")[0], re.MULTILINE)
    assert [name for names, _ in entries for name in names.split(", ")] == list(SIGNATURE.parameters)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("task", list(TASKS)),
        *(
            (name, list(get_args(get_type_hints(ArmEnv.__init__)[name])))
            for name in ("dynamics", "scene", "observation")
        ),
        ("render_mode", ["rgb_array", "human"]),
    ],
)
def test_the_choices_are_those_that_are_accepted(name, values):
    (text,) = re.findall(rf"^    {name}: (.*)$", ARGUMENTS, re.MULTILINE)
    assert literals(text) == values
    for value in values:
        if (name, value) != ("render_mode", "human"):  # asks for a display
            ArmEnv(**{name: value})


def test_the_errors_are_those_of_the_package():
    raised = re.findall(r"^    (\w+): ", ARGUMENTS.partition("\nRaises:")[2], re.MULTILINE)
    assert [issubclass(getattr(jssa_gym.exceptions, name), Exception) for name in raised] == [True] * 3
