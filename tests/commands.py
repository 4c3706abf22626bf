"""``jssa-gym`` in processes of its own, run as users run it."""

import os
import subprocess
import sys

WITHOUT = """
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Blocked())
"""
"""Python after which some modules are not installed; to be formatted with ``blocked``, their names."""

TINY = (
    *("train", "--algorithm", "ppo", "--steps", "128", "--interval", "64", "--envs", "2", "--eval-episodes", "1"),
    *("--set", "width=16", "rollout=64", "batch_size=32", "n_epochs=2"),
)
"""Arguments of a training of two legs."""


def cli(*arguments, cwd=None, before=""):
    """``jssa-gym`` in another process; ``before`` is Python run ahead of it."""
    script = f"{before}\nimport sys\nsys.argv[0] = 'jssa-gym'\nfrom jssa_gym.cli import main\nmain()"
    return subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, "COLUMNS": "120"},
        check=False,
    )


def one_line(run) -> str:
    """The only line on stderr of a command that was refused."""
    assert run.returncode == 2, run.stderr
    assert "Traceback" not in run.stderr
    assert run.stdout == ""
    (line,) = (line for line in run.stderr.splitlines() if line.strip())
    assert line.startswith("jssa-gym: ")
    return line
