"""One training with several seeds, each in a folder of its own, none of which ends with another."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from jssa_gym.engine.cluster import Cluster, whose
from jssa_gym.engine.workers import run
from jssa_gym.exceptions import ParameterError
from jssa_gym.train.config import TrainConfig
from jssa_gym.train.history import Leg
from jssa_gym.validation import positive_integer


@dataclass(frozen=True, slots=True)
class SeedOutcome:
    """How the training with one seed ended."""

    seed: int
    folder: Path
    history: tuple[Leg, ...] = ()
    """Its legs; empty if it failed."""
    error: str = ""
    """Why it failed; empty if it did not."""


def seed_folder(folder: Path, seed: int) -> Path:
    """Where the training with a seed is, below a folder for all seeds."""
    return folder / f"seed-{seed}"


def train_seeds(
    config: TrainConfig,
    seeds: Sequence[int],
    folder: str | Path,
    jobs: int | Cluster = 1,
    *,
    threads: int | None = None,
    say: Callable[[str], Any] | None = None,
    command: str = "",
) -> tuple[SeedOutcome, ...]:
    """Train with several seeds, each as :func:`jssa_gym.train.train` does it; the same call goes on where it ended.

    Results do not depend on ``jobs``. A training that fails is told of and tried again by the next call; the others go
    on. On a Ray cluster of several machines the folder has to be one that all of them see.

    Args:
        config: The training; its own seed does not count.
        seeds: As many trainings.
        folder: Each has ``seed-0``, ``seed-1``, … below it.
        jobs: How many processes train at once, or the cluster that does.
        threads: Of torch, in each of them; None leaves it to torch, which takes one where there are several jobs.
        say: Told in a line what happens, by whoever trains; with several jobs it has to be picklable.
        command: Noted in the policy files.

    Returns:
        One outcome a seed, in the order of ``seeds``.

    Raises:
        ParameterError: A seed is there twice, or none is; or ``threads`` is no positive integer.
        WorkerError: A process was killed; its training goes on by the same call.
    """
    if not seeds or len(set(seeds)) != len(seeds):
        raise ParameterError(f"seeds have to be at least one, each once, got {tuple(seeds)}")
    if threads is not None:
        threads = positive_integer("threads", threads)
    configs = [replace(config, seed=seed) for seed in seeds]
    ended: list[SeedOutcome] = []
    run(partial(_trained, Path(folder), threads, say, command), configs, whose(jobs), ended.extend)
    return tuple(sorted(ended, key=lambda one: seeds.index(one.seed)))


def _trained(
    folder: Path, threads: int | None, say: Callable[[str], Any] | None, command: str, config: TrainConfig
) -> Generator[SeedOutcome]:
    """Train with one seed, in whatever process."""
    from jssa_gym.train.loop import train

    import torch  # isort: skip

    before = torch.get_num_threads()
    if threads is not None:
        torch.set_num_threads(threads)
    own = seed_folder(folder, config.seed)

    def tell(line: str) -> None:
        if say is not None:
            say(f"seed {config.seed}: {line}")

    try:
        yield SeedOutcome(config.seed, own, train(config, own, say=tell, command=command).history)
    except Exception as error:  # of whatever kind: the other seeds are none the worse for it
        tell(f"failed: {error}")
        yield SeedOutcome(config.seed, own, error=f"{type(error).__name__}: {error}")
    finally:
        if threads is not None:  # with one job this is the caller's process
            torch.set_num_threads(before)
