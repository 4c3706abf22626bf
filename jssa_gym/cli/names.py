"""Options that take names: what their help says is what the registries hold."""

from collections.abc import Iterable

import tyro

from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.contenders import CONTENDERS, FAULTS
from jssa_gym.evaluation.people import PEOPLE
from jssa_gym.policies import POLICIES, shipped_policies
from jssa_gym.robots import MENAGERIE, ROBOTS
from jssa_gym.shields import FILTERS, PROFILES, STOP, TASK_SHIELD
from jssa_gym.shields.registry import UNSHIELDED


def _says(text: str, names: Iterable[str]) -> object:
    return tyro.conf.arg(help=f"{text}: {', '.join(names)}.")


TASK = _says("Task of the environment by name", TASKS)
SOME_TASKS = _says("Tasks of the board by name; without any all of them", TASKS)
FILTER = _says(
    f"Filter by name, with {STOP} behind it inside the viability box and the verified stop; {', '.join(PROFILES)} for "
    f"a whole shield; {TASK_SHIELD} for that of the task's shielded id",
    FILTERS,
)
HUMAN = _says("People by name, or a file .npz, .csv or .bvh", PEOPLE)
OWN_HUMAN = _says("People by name, or a file .npz, .csv or .bvh; without any the task's own", PEOPLE)
POLICY = _says("Policy by name, file .npz or .zip, or package.module:factory", (*POLICIES, *shipped_policies()))
"""The policy that is evaluated."""

TRUST = tyro.conf.arg(
    help="Have Stable-Baselines3 load a policy's .zip, which runs what is in it: only for files whose origin you know."
)

ROBOT = _says(
    "Robot by name, its MJCF file with limits beside it, or a folder of jssa-gym robot check --write",
    (*ROBOTS, *MENAGERIE),
)

SENSOR = _says("What the filter sees of the people, by name, where none is the truth", FAULTS)
SHIELDS = _says(
    f"Shields by name, whole and weakened; filters by their own names too, bare or with {STOP} behind them; full is "
    f"jssa{STOP}, published jssa_published, and {UNSHIELDED} no shield at all",
    CONTENDERS,
)
OPPONENTS = _says("Policies by name", POLICIES)
WRONG = _says("Faults by name", FAULTS)
"""Options of what is tried in campaigns, besides people."""
