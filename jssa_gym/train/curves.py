"""Learning curves of trainings that have ended, or not yet, read from their folders and put together by seeds."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path

import numpy as np

from jssa_gym.exceptions import CheckpointError, ParameterError
from jssa_gym.rates import Rate
from jssa_gym.storage import read_text, refused
from jssa_gym.train.aggregate import interquartile_mean, stratified_interval
from jssa_gym.train.config import TrainConfig
from jssa_gym.train.history import RECORD, Leg, from_rows
from jssa_gym.types import Array

_LARGEST = 2**24
"""Most bytes of what a folder says of its training."""

MEASURES = {
    "success": "success without a violation",
    "reached": "success",
    "return": "return of an episode",
    "contacts": "moving contacts while learning",
}
"""What curves are of: the first three of the evaluations, the last one of the learner's own episodes so far."""


@dataclass(frozen=True, slots=True)
class Band:
    """A measure over a training's legs; one entry a leg."""

    value: tuple[float, ...]
    """Interquartile mean over the seeds."""
    low: tuple[float, ...]
    high: tuple[float, ...]
    """Ends of its stratified bootstrap interval of 95 %, each point by itself."""


@dataclass(frozen=True, slots=True)
class LearningCurve:
    """What the trainings of one label come to, up to where the shortest of them has come."""

    label: str
    runs: int
    """Trainings, which differ in their seed and may in their task, people and robot."""
    steps: tuple[int, ...]
    """Policy steps at the ends of legs."""
    seconds: tuple[float, ...]
    """Time that learning had taken by then, evaluations not counted, median over the runs [s]."""
    processor: bool
    """Whether that is processor time; else it is what a clock on the wall says."""
    bands: Mapping[str, Band]
    """By the names in :data:`MEASURES`."""
    moving_contacts: Rate | None
    """Episodes of all learners up to there in which the moving arm touched somebody; None if no episode ended."""


@dataclass(frozen=True, slots=True)
class _Run:
    config: TrainConfig
    history: tuple[Leg, ...]


def find_trainings(folder: Path) -> tuple[Path, ...]:
    """The folder itself if it is a training's, else those of trainings directly below it.

    Raises:
        ParameterError: There is none.
    """
    if (folder / RECORD).is_file():
        return (folder,)
    if found := sorted(path.parent for path in folder.glob(f"*/{RECORD}")):
        return tuple(found)
    raise ParameterError(f"{folder} holds no training that has ended its first leg, nor do the folders in it")


def learning_curves(
    folders: Sequence[tuple[str, Path]], *, resamples: int = 2000, seed: int = 0
) -> tuple[LearningCurve, ...]:
    """Put trainings together by label.

    Trainings of one label with different tasks, people or robots are strata of the bootstrap.

    Args:
        folders: Label and folder, of one training or of several as :func:`~jssa_gym.train.train_seeds` leaves them;
            folders of one label count together.
        resamples: Of the bootstrap.
        seed: Of the bootstrap.

    Returns:
        One curve a label, in the order in which labels come first.

    Raises:
        ParameterError: A folder holds none, or trainings of one label differ in more, or are the same one twice.
        CheckpointError: A file is none of a training.
    """
    grouped: dict[str, list[_Run]] = {}
    for label, folder in folders:
        grouped.setdefault(label, []).extend(_read(one) for one in find_trainings(folder))
    return tuple(_curve(label, runs, resamples, seed) for label, runs in grouped.items())


def _read(folder: Path) -> _Run:
    path = folder / RECORD
    with refused(CheckpointError, f"{path} is no record of a training"):
        data = json.loads(read_text(path, CheckpointError, _LARGEST))
        run = _Run(TrainConfig.of(data["training"]), from_rows(data["history"]))
        if not run.history:
            raise ValueError("its history is empty")
        return run


def _curve(label: str, runs: list[_Run], resamples: int, seed: int) -> LearningCurve:
    strata = _strata(label, runs)
    legs = min(len(run.history) for run in runs)
    cut = {key: [run.history[:legs] for run in part] for key, part in strata.items()}
    histories = [history for part in cut.values() for history in part]
    steps = [tuple(leg.steps for leg in history) for history in histories]
    if len(set(steps)) != 1:
        raise ParameterError(f"trainings of {label!r} end their legs at different steps; give them labels of their own")
    processor = all(leg.processor_seconds == leg.processor_seconds for history in histories for leg in history)
    clock = "processor_seconds" if processor else "seconds"
    times = np.cumsum([[getattr(leg, clock) for leg in history] for history in histories], axis=1)
    bands = {}
    for name in MEASURES:
        scores = [np.array([_measured(name, history) for history in part]) for part in cut.values()]
        low, high = stratified_interval(scores, seed, resamples=resamples)
        bands[name] = Band(*map(_plain, (interquartile_mean(np.concatenate(scores)), low, high)))
    touched = sum(leg.moving_contacts for history in histories for leg in history)
    played = sum(leg.episodes for history in histories for leg in history)
    return LearningCurve(
        label=label,
        runs=len(runs),
        steps=steps[0],
        seconds=_plain(np.median(times, axis=0)),
        processor=processor,
        bands=bands,
        moving_contacts=Rate.of(touched, played) if played else None,
    )


def _strata(label: str, runs: Sequence[_Run]) -> dict[tuple[str | None, ...], list[_Run]]:
    """Runs by task, people and robot, which have to be one training with different seeds but for that."""
    strata: dict[tuple[str | None, ...], list[_Run]] = {}
    first = runs[0].config
    for run in runs:
        same = {"task": first.task, "human": first.human, "robot": first.robot, "seed": first.seed}
        alike = replace(run.config, **same, steps=first.steps, processes=first.processes, vector=first.vector)
        if alike.digest != first.digest:
            names = [name for name, value in first.as_dict().items() if alike.as_dict()[name] != value]
            raise ParameterError(
                f"trainings of {label!r} differ in {', '.join(names)}; give each a label of its own: --labels"
            )
        strata.setdefault((run.config.task, run.config.human, run.config.robot), []).append(run)
    for part in strata.values():
        seeds = [run.config.seed for run in part]
        if len(set(seeds)) != len(seeds):
            raise ParameterError(f"trainings of {label!r} have one seed twice, among {sorted(seeds)}: give each once")
    return strata


def _measured(name: str, history: Sequence[Leg]) -> list[float]:
    if name == "contacts":
        return [float(count) for count in accumulate(leg.moving_contacts for leg in history)]
    column = {"success": "eval_safe", "reached": "eval_success", "return": "eval_return"}[name]
    return [float(getattr(leg, column)) for leg in history]


def _plain(values: Array) -> tuple[float, ...]:
    return tuple(values.tolist())
