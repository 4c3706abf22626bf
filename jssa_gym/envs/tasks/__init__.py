"""What the arm is to do; a task gets its name and its ids in ``ENTRIES`` of ``jssa_gym/registration.py``."""

from jssa_gym.envs.tasks.deliver import Deliver
from jssa_gym.envs.tasks.joints import Home, Track
from jssa_gym.envs.tasks.task import COMMON_TERMS, Moment, Progress, RewardTerm, Task
from jssa_gym.envs.tasks.tip import Handover, Reach
from jssa_gym.registration import ENTRIES
from jssa_gym.validation import known_name

__all__ = [
    "COMMON_TERMS",
    "TASKS",
    "Deliver",
    "Handover",
    "Home",
    "Moment",
    "Progress",
    "Reach",
    "RewardTerm",
    "Task",
    "Track",
    "make_task",
]

TASKS: dict[str, type[Task]] = {name: entry.load() for name, entry in ENTRIES.items()}
"""Tasks by name, those of :data:`jssa_gym.registration.ENTRIES`."""


def make_task(task: str | Task) -> Task:
    """A task from its name in :data:`TASKS`, or as it is.

    Raises:
        ParameterError: Unknown name.
    """
    if isinstance(task, Task):
        return task
    return TASKS[known_name("task", task, TASKS)]()
