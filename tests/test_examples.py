"""The examples run, and the README begins with what can be pasted and links to what there is."""

import re
import runpy
import sys
from pathlib import Path

import pytest
from places import ROOT


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", sorted(path.name for path in (ROOT / "examples").glob("*.py")))
def test_example_runs(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    short = {
        "train_ppo.py": ("stable_baselines3", ["--steps", "320"]),
        "02_train_inside.py": ("stable_baselines3", ["--steps", "100", "--episodes", "1"]),
        "03_compare_filters.py": ("gymnasium", ["--episodes", "2"]),
        "05_own_person.py": ("gymnasium", ["--episodes", "1"]),
        "cleanrl_ppo.py": ("torch", ["--total-timesteps", "128", "--num-envs", "2", "--num-steps", "32"]),
    }
    needed, arguments = short.get(name, ("gymnasium", []))
    pytest.importorskip(needed)
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")


def test_the_numbered_examples_are_short_and_shown() -> None:
    numbered = sorted(path for path in (ROOT / "examples").glob("*.py") if path.name[0].isdigit())
    assert [path.name[:2] for path in numbered] == ["01", "02", "03", "04", "05"]
    page = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    for path in numbered:
        assert len(path.read_text(encoding="utf-8").splitlines()) < 60
        assert f"literalinclude}} ../examples/{path.name}" in page


def test_readme_commands_are_single_lines_that_install_under_the_constraints() -> None:
    commands = re.findall(r"```bash\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    assert len(commands) == 2
    for command in commands:
        assert command.count("\n") == 1
        assert "-c constraints.txt" in command


def test_pictures_and_links_of_the_readme_exist() -> None:
    text = (ROOT / "README.md").read_text()
    targets = re.findall(r"\]\(((?!http)[^)#]+)\)", text)
    assert targets
    for target in targets:
        assert (ROOT / target).exists(), target
