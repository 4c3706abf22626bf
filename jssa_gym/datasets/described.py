"""The data sets that docs/datasets.md describes: small, made by one command, and known by their digests."""

from dataclasses import replace
from typing import NamedTuple

from jssa_gym.datasets.recipe import Recipe


class Described(NamedTuple):
    """A data set with a card."""

    recipe: Recipe
    digest: str
    """What :func:`~jssa_gym.datasets.write_dataset` finds for it with the pinned versions, on x86-64 with the
    environment variable ``OPENBLAS_CORETYPE=Haswell``."""


_REACH = Recipe("reach", "reach-sac", human="random", episodes=100, seed=8_000_000)

DESCRIBED: dict[str, Described] = {
    "jssa_gym/reach-expert-v0": Described(
        _REACH,
        "a87a43fb292a5a665e9345ab99f11e25babe9902fb372ba56b7f577c7cfa4bdb",
    ),
    "jssa_gym/reach-unshielded-v0": Described(
        replace(_REACH, shield="none"),
        "42bd1cb8f8c27074809a9c65bfb3f445bd59e75bd129527e4e8bd07f167a3ecc",
    ),
    "jssa_gym/home-random-v0": Described(
        Recipe("home", "random", "jssa+stop", "approach_retreat", episodes=40, seed=8_100_000),
        "1c38e6ea633fc30c97664aca14b8e9e6c1af1e6a83f23fdff9dd61195aa60bdc",
    ),
}
"""Data sets by name, namespace and version included."""
