"""Commands in the tests' own process: most of a command's time is what another process would have to import."""

import sys
from typing import NamedTuple

import pytest

from jssa_gym.cli import main


class Ended(NamedTuple):
    """What ``commands.cli`` has of another process."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def here(monkeypatch, capsys):
    """``jssa-gym`` in this process."""

    def run(*arguments, cwd=None):
        with monkeypatch.context() as patch:
            patch.setattr(sys, "argv", ["jssa-gym", *map(str, arguments)])
            patch.setenv("COLUMNS", "120")
            if cwd is not None:
                patch.chdir(cwd)
            capsys.readouterr()
            code = 0
            try:
                main()
            except SystemExit as ended:
                code = ended.code
        return Ended(code, *capsys.readouterr())

    return run
