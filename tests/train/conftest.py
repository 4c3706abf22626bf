"""What the tests of trainings share: one thread, and a training that is only looked at."""

import shutil
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def one_thread():
    """Networks of this size are no faster on several, whose sums are in another order."""
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    with one_thread():
        yield


@pytest.fixture(scope="session")
def original(tmp_path_factory):
    """A training of three legs; not to be changed."""
    from trainings import CHECKPOINTED

    from jssa_gym.train import train

    folder = tmp_path_factory.mktemp("original")
    with one_thread():  # made before any module's own
        train(CHECKPOINTED, folder)
    return folder


@pytest.fixture
def folder(original, tmp_path):
    """A copy of it."""
    return Path(shutil.copytree(original, tmp_path / "copy"))
