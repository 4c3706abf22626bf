"""Plans are finished here: what is left is played; of evaluations the worst is kept, and all is reported."""

import logging
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym

from jssa_gym.engine.cluster import Cluster, whose
from jssa_gym.engine.workers import run
from jssa_gym.envs.arm import MOVING
from jssa_gym.evaluation.batch import at_once
from jssa_gym.evaluation.blocked import warning
from jssa_gym.evaluation.ledger import Chunk, Ledger, Results, worst
from jssa_gym.evaluation.metrics import SeparationParams
from jssa_gym.evaluation.plan import AnyRow
from jssa_gym.evaluation.play import play, record
from jssa_gym.evaluation.policy import AsTrained
from jssa_gym.evaluation.report import Report, write_reports
from jssa_gym.evaluation.rows import EvaluationRow
from jssa_gym.evaluation.study import Evaluation, Single
from jssa_gym.evaluation.trace import read_meta
from jssa_gym.exceptions import ParameterError, TraceError
from jssa_gym.policies.vector import has_vector_form
from jssa_gym.validation import whole_number

_logger = logging.getLogger("jssa_gym")

_CHUNK = 10
"""Most episodes of one cell that are played one after the other: what a crash loses at most, for every job."""

Progress = Callable[[int, int], Any]
"""Called with the number of episodes played so far and of all."""


def evaluate(
    env: str | Callable[[], gym.Env] | gym.Env,
    policy: Any,
    episodes: int = 100,
    seed: int = 0,
    *,
    env_kwargs: Mapping[str, Any] | None = None,
    filter: str | None = None,
    steps: int = 1000,
    jobs: int | Cluster = 1,
    out: str | Path | None = None,
    keep: int = 3,
    v_safe: float = MOVING,
    separation: SeparationParams | None = None,
    ticks: int = 1,
    normalise: str | Path | None = None,
    progress: Progress | None = None,
) -> Report:
    """Play episodes and put them into numbers.

    Args:
        env: An id, a function that makes an environment, or, with one job, an environment. Ids of this package run to
            the horizon unless ``env_kwargs`` has ``terminate_on``.
        policy: See :func:`~jssa_gym.evaluation.policy.make_policy`: a name, a file, ``"module:factory"``, a
            model with ``predict`` or a callable.
        episodes: How many.
        seed: First seed; episode k has seed + k, so that two evaluations with the same seed are paired.
        env_kwargs: Of ``gymnasium.make``.
        filter: Put around the environment: a name of ``FILTERS``, bare or with ``+stop`` behind it.
        steps: Control steps of an episode, at most.
        jobs: How many processes, or a :class:`~jssa_gym.evaluation.Cluster` of Ray's; with several, environment and
            policy have to be picklable.
        out: Folder for ``episodes.csv``, ``summary.json`` and the worst episodes' recordings; an evaluation that is
            there already is continued.
        keep: How many recordings of the worst episodes are kept.
        v_safe: Speed of the robot's touching point from which a contact is critical [m/s].
        separation: Parameters of ``ssm_margin`` and its kin.
        ticks: For how many control steps an action of a trained policy holds, as an
            :class:`~jssa_gym.ActionRepeat` had it in training; everything is measured in every step all the same.
        normalise: File that ``VecNormalize.save`` wrote in its training: its observations are normalised with these
            statistics. Nothing in the file is run.
        progress: Called after every few episodes.

    Raises:
        ParameterError: An argument is unknown, out of range or cannot be sent to another process, or the folder holds
            another evaluation.
        PolicyFileError: A file is damaged, or holds something else.
    """
    plan = Single(
        env,
        str(policy) if isinstance(policy, Path) else policy,
        env_kwargs,
        filter,
        episodes,
        seed,
        steps,
        v_safe,
        SeparationParams() if separation is None else separation,
        AsTrained(ticks, None if normalise is None else str(normalise)),
    )
    folder = None if out is None else Path(out)
    report = complete(plan, folder, jobs=jobs, keep=keep, progress=progress)[0]
    if report.blocked:
        _logger.warning("%s: %s", ", ".join(part for part in report.setting if part), warning(report.blocked))
    return report


def complete(
    plan: Evaluation, folder: Path | None, *, jobs: int | Cluster = 1, keep: int = 1, progress: Progress | None = None
) -> list[Report]:
    """Play what is left of a plan and report on all of it, a report a setting.

    Args:
        plan: What is evaluated.
        folder: Where results are kept, and continued; None to keep none.
        jobs: How many processes, or the cluster.
        keep: How many recordings of the worst episodes of every setting are kept.
        progress: Called after every few episodes.

    Raises:
        ParameterError: As of :func:`evaluate`.
    """
    jobs = whose(jobs)
    keep = whole_number("keep", keep)
    if jobs != 1:
        _check_sendable(plan)
    results = Results(plan) if folder is None else Ledger(folder, plan)
    total = plan.total()

    def told(new: Sequence[EvaluationRow] = ()) -> None:
        if progress is not None:
            progress(len(results.episodes), total)

    told()
    finish(results, jobs, told)
    uncovered = plan.uncovered()
    reports = [replace(Report.of(episodes), uncovered=uncovered) for episodes in results.by_cell().values()]
    if isinstance(results, Ledger):
        reports = _with_worst(results, reports, keep, jobs)
        write_reports(results.folder / "summary.json", reports)
    return reports


def finish(results: Results[AnyRow], jobs: int | Cluster, done: Callable[[list[AnyRow]], Any]) -> None:
    """Play what is left of a plan.

    Args:
        results: What was played already; what is played is added.
        jobs: How many processes, or the cluster.
        done: Called with every few episodes when they have been added.
    """
    # small enough that nobody waits for the last one
    count = jobs.jobs if isinstance(jobs, Cluster) else jobs
    plan = results.plan
    share = max(1, plan.total() // (4 * count))

    def size(cell: Any) -> int:
        return min(at_once(plan.steps) if has_vector_form(plan.named_policy(cell)) else _CHUNK, share)

    def add(episodes: list[AnyRow]) -> None:
        results.append(episodes)
        done(episodes)

    run(play, results.chunks(size), jobs, add)


def _with_worst(
    ledger: Ledger[EvaluationRow], reports: Sequence[Report], keep: int, jobs: int | Cluster
) -> list[Report]:
    """Record the worst episodes, by playing them again: recording all would cost more than playing them."""
    chosen = {report.setting: worst(report.episodes, keep) for report in reports}
    missing = {
        setting: [episode.seed for episode in episodes if _digest(ledger.traces / episode.trace_name) != episode.digest]
        for setting, episodes in chosen.items()
    }
    saved: dict[Path, str] = {}
    # a process takes seconds to start: a few episodes are played here, and so are those of a cluster, whose machines
    # need not have the folder
    count = sum(len(some) for some in missing.values())
    run(
        record,
        [Chunk(ledger.plan, setting, some, ledger.traces) for setting, some in missing.items() if some],
        1 if isinstance(jobs, Cluster) or count < _CHUNK * jobs else jobs,
        saved.update,
    )
    return [
        replace(
            report,
            traces=tuple(ledger.traces / episode.trace_name for episode in chosen[report.setting]),
            unlike=tuple(
                episode.seed
                for episode in chosen[report.setting]
                if saved.get(ledger.traces / episode.trace_name, episode.digest) != episode.digest
            ),
        )
        for report in reports
    ]


def _digest(path: Path) -> str | None:
    """What a recording says of itself; None if there is none."""
    try:
        return read_meta(path).get("digest")
    except TraceError:
        return None


def _check_sendable(plan: Evaluation) -> None:
    if isinstance(plan, Single) and isinstance(plan.env, gym.Env):
        raise ParameterError("an environment cannot be shared between processes; give an id or a factory, or jobs=1")
    try:
        pickle.dumps(plan)
    except Exception as error:  # what pickling an object raises is up to the object
        raise ParameterError(
            f"with several jobs environment and policy have to be picklable ({error}); give names, functions of a "
            "module or 'module:factory', or jobs=1"
        ) from error
