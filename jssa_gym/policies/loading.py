"""Policies by name or path: those that come with the package, one's own files, Stable-Baselines3's."""

from pathlib import Path

from jssa_gym.exceptions import ParameterError
from jssa_gym.policies.files import read_policy
from jssa_gym.policies.foreign import convert_sb3, unpickle_sb3
from jssa_gym.policies.scripted import Policy

SHIPPED = Path(__file__).parent / "shipped"
"""Folder of the policies that come with the package."""


def shipped_policies() -> tuple[str, ...]:
    """Names of the trained policies that come with the package."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.npz")))


def policy_file(name_or_path: str | Path) -> Path | None:
    """The file that a name or path stands for, there or not; None if it is no shipped name and no ``.npz`` or ``.zip``.

    Args:
        name_or_path: Of :func:`shipped_policies`, or a path.
    """
    if isinstance(name_or_path, str) and name_or_path in shipped_policies():
        return SHIPPED / f"{name_or_path}.npz"
    path = Path(name_or_path)
    return path if path.suffix in (".npz", ".zip") else None


def load_policy(name_or_path: str | Path, *, trust_pickle: bool = False) -> Policy:
    """A trained policy, ready to act; by default nothing in a file is ever run.

    Args:
        name_or_path: Of :func:`shipped_policies`; or a file ``.npz`` of :func:`~jssa_gym.policies.save_policy`; or a
            model ``.zip`` of Stable-Baselines3, which is rebuilt by :func:`~jssa_gym.policies.convert_sb3`, for jerk
            and without normalisation of observations.
        trust_pickle: Have Stable-Baselines3 load a ``.zip``, which runs whatever its author put into it: only for files
            whose origin you know.

    Returns:
        A :class:`~jssa_gym.policies.LearnedPolicy`; with ``trust_pickle`` and a ``.zip``, what asks the model.

    Raises:
        ParameterError: Unknown name, or a path with another ending.
        PolicyFileError: The file is damaged, or holds something else.
        MissingExtraError: A ``.zip`` without PyTorch.
    """
    path = policy_file(name_or_path) if isinstance(name_or_path, str | Path) else None
    if path is None:
        known = ", ".join(shipped_policies()) or "none"
        raise ParameterError(f"unknown policy {name_or_path!r}; shipped: {known}; or a file that ends in .npz or .zip")
    if path.suffix == ".npz":
        return read_policy(path)
    return unpickle_sb3(path) if trust_pickle else convert_sb3(path)
