"""Data sets: episodes of a policy beside people, step by step, as Minari's loader reads them.

A ``Recipe`` says all that a data set is made of, ``collect`` plays an episode of it, ``write_dataset`` makes the files,
and ``DESCRIBED`` are the ones that docs/datasets.md has cards of.
"""

from jssa_gym.datasets.described import DESCRIBED, Described
from jssa_gym.datasets.episode import EpisodeData, collect
from jssa_gym.datasets.minari import DatasetSummary, read_digest, write_dataset
from jssa_gym.datasets.recipe import Recipe

__all__ = [
    "DESCRIBED",
    "DatasetSummary",
    "Described",
    "EpisodeData",
    "Recipe",
    "collect",
    "read_digest",
    "write_dataset",
]
