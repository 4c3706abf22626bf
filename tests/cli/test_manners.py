"""How commands behave towards those who type them, pipe them, and keep other things in their folders."""

import ast
import itertools

import pytest
from commands import one_line
from places import ROOT

from jssa_gym.cli import COMMANDS, demo, names, progress
from jssa_gym.cli.files import own_folder
from jssa_gym.cli.progress import Bar
from jssa_gym.cli.terminal import Terminal
from jssa_gym.exceptions import ParameterError

TIMED = sorted(set(COMMANDS) - {"recording", "robot"})


# ---- help --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", [("evaluate", "--tusk", "x"), ("evaluate", "--episodes", "x"), ("robot", "chek")])
def test_what_cannot_be_parsed_names_the_commands_own_help(words, here, tmp_path):
    run = here(*words, cwd=tmp_path)
    assert run.returncode == 2
    assert f"jssa-gym {words[0]} --help" in " ".join(run.stderr.split())


@pytest.mark.parametrize(
    ("command", "wrong"),
    [
        ("evaluate", ("--task", "swim")),
        ("demo", ("--speed", "-1")),
        ("bench", ("--rounds", "0")),
        ("leaderboard submit", ()),
        ("leaderboard", ("--board", "a", "--board", "b")),
    ],
)
def test_wrong_values_name_the_commands_own_help(command, wrong, here, tmp_path):
    assert one_line(here(*command.split(), *wrong, cwd=tmp_path)).endswith(f"; see jssa-gym {command} --help")


def test_errors_that_no_help_helps_with_name_none(here, tmp_path):
    assert "--help" not in one_line(here("replay", "missing.npz", cwd=tmp_path))


@pytest.mark.parametrize("command", TIMED)
def test_help_says_how_long_it_takes(command, here):
    run = here(command, "--help")
    assert run.returncode == 0
    assert any(word in " ".join(run.stdout.split()) for word in ("takes about", "take about", "takes some"))


def helped_twice(source):
    """Options whose words of their own ``tyro`` leaves out, since their annotation brings some along."""
    for command in ast.walk(ast.parse(source)):
        if isinstance(command, ast.ClassDef):
            for option, after in itertools.pairwise(command.body):
                if isinstance(option, ast.AnnAssign) and isinstance(after, ast.Expr):
                    brought = ast.unparse(option.annotation).replace("tyro.conf.Positional", "")
                    if "Annotated" in brought and ("help=" in brought or any(name in brought for name in NAMES)):
                        yield f"{command.name}.{ast.unparse(option.target)}"


NAMES = [name for name in vars(names) if name.isupper()]


def test_no_words_about_an_option_are_lost():
    lost = (
        'class Fly:\n    human: Annotated[str, HUMAN]\n    "Who."\n    to: Annotated[str, arg(name="")]\n    "Where."'
    )
    assert list(helped_twice(lost)) == ["Fly.human"]
    files = sorted((ROOT / "jssa_gym" / "cli").glob("*.py"))
    assert [found for file in files for found in helped_twice(file.read_text(encoding="utf-8"))] == []


def test_what_is_left_out_is_told(here):
    run = here("dataset", "--help")
    assert "without any the task's own" in " ".join(run.stdout.replace("│", " ").split())
    run = here("leaderboard", "submit", "--help")
    assert "without any all of them" in " ".join(run.stdout.replace("│", " ").split())


# ---- progress ----------------------------------------------------------------------------------------


def lines_of(capsys, steps=5):
    with Bar(Terminal(stderr=True)) as bar:
        task = bar.add_task("episodes", total=steps)
        for _ in range(steps - 1):
            bar.advance(task)
        bar.update(task, completed=steps, description="the last one")
    return capsys.readouterr().err.splitlines()


def test_a_pipe_gets_a_line_now_and_then(capsys, monkeypatch):
    monkeypatch.setattr(progress, "PERIOD", 0.0)
    lines = lines_of(capsys)
    assert [line.partition(",")[0] for line in lines[:4]] == [f"episodes: {k} of 5" for k in range(1, 5)]
    assert lines[4].startswith("the last one: 5 of 5, 0 s gone")


def test_not_one_for_every_step(capsys, monkeypatch):
    moments = iter([0.0, 1.0, 4.9, 5.0, 9.9, 10.1])
    monkeypatch.setattr(progress, "monotonic", lambda: next(moments))
    lines = lines_of(capsys)
    assert [line.partition(",")[0] for line in lines] == ["episodes: 3 of 5", "the last one: 5 of 5"]


# ---- folders -----------------------------------------------------------------------------------------

WRITERS = {
    "demo": (),
    "reproduce": (),
    "evaluate": ("--policy", "hold"),
    "compare": (),
    "stress": (),
    "certify": (),
}


@pytest.mark.parametrize("command", WRITERS)
def test_somebody_elses_folder_is_refused(command, here, tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    line = one_line(here(command, *WRITERS[command], "--out", tmp_path))
    assert "thesis.tex" in line
    assert "another --out" in line
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_training_refuses_it_too(here, tmp_path):
    pytest.importorskip("stable_baselines3")
    (tmp_path / "thesis.tex").write_text("mine")
    assert "thesis.tex" in one_line(here("train", "--no-video", "--out", tmp_path))


def test_an_own_folder_may_have_more_in_it(tmp_path):
    own_folder(tmp_path / "none", "campaign.json")
    (tmp_path / ".hidden").write_text("")
    own_folder(tmp_path, "campaign.json")
    (tmp_path / "notes.txt").write_text("")
    with pytest.raises(ParameterError, match=r"has notes\.txt in it"):
        own_folder(tmp_path, "campaign.json")
    (tmp_path / "campaign.json").write_text("")
    own_folder(tmp_path, "campaign.json")


# ---- names -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words",
    [
        ("compare", "--filters", "stop", "none", "stop"),
        ("compare", "--humans", "hand", "hand"),
        ("stress", "--policies", "hold", "hold"),
    ],
    ids=" ".join,
)
def test_a_name_given_twice_is_refused(words, here, tmp_path):
    line = one_line(here(*words, cwd=tmp_path))
    assert f"{words[1]} has {words[2]!r} twice" in line
    assert list(tmp_path.iterdir()) == []


# ---- the demo of a policy ----------------------------------------------------------------------------


@pytest.mark.long
def test_a_policys_demo_tells_success_and_shows_something(here, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    asked = []
    monkeypatch.setattr(demo, "TRIED", 3)
    rollout = demo.rollout

    def seen(env, policy, *, seed, **options):
        asked.append((seed, rollout(env, policy, seed=seed, **options)))
        return asked[-1][1]

    monkeypatch.setattr(demo, "rollout", seen)
    words = ("demo", "--policy", "reach-sac", "--no-video", "--seconds", "1", "--out", tmp_path / "out")
    run = here(*words)
    assert run.returncode == 0, run.stderr
    assert [seed for seed, _ in asked[:3]] == [0, 1, 2]
    nearest = min(range(3), key=lambda seed: asked[seed][1].distance.min())
    assert {seed for seed, _ in asked[3:]} == {nearest}
    assert f"seed {nearest}" in run.stdout
    assert "success" in run.stdout
    assert "time to the goal" in run.stdout
    asked.clear()
    here(*words, "--seed", "7")
    assert {seed for seed, _ in asked} == {7}


@pytest.mark.long
def test_the_papers_scene_has_no_goal(here, tmp_path):
    pytest.importorskip("matplotlib")
    run = here("demo", "--no-video", "--seconds", "0.2", "--out", tmp_path / "out")
    assert run.returncode == 0, run.stderr
    assert "success" not in run.stdout
