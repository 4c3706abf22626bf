"""``--sensor`` of evaluate and compare: what the filter sees is spoiled, and what is left says so."""

import json
import shlex

import pytest

from jssa_gym.cli import parse
from jssa_gym.exceptions import ParameterError


def run(*words):
    """A command in this process."""
    parse([str(word) for word in words]).run()


@pytest.mark.long
def test_an_evaluation_as_a_camera_sees_it_is_played_again_as_it_was(tmp_path, capsys):
    common = ("--episodes", 1, "--seconds", 1.0, "--human", "random", "--json")
    for name, sensor in (("camera", ("--sensor", "camera 30 Hz")), ("truth", ())):
        run("evaluate", *common, *sensor, "--out", tmp_path / name)
    told = capsys.readouterr().out
    assert told.count('"fault_rate"') == 2
    camera, truth = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("camera", "truth"))
    faults = [one[0]["means"]["fault_rate"]["value"] if isinstance(one, list) else None for one in (camera, truth)]
    assert faults[0] > 0.1 > faults[1]  # nothing is known for the first 0.1 s
    (recording,) = (tmp_path / "camera").rglob("*.npz")
    run("replay", recording, "--again", "--no-video", "--no-figure")
    assert "the same bit for bit" in capsys.readouterr().out


def test_compare_writes_the_command_that_makes_its_page_again(tmp_path):
    out = tmp_path / "page"
    names = ("--filters", "jssa+stop", "--humans", "none", "--policies", "hold")
    run("compare", *names, "--episodes", 1, "--seconds", 0.2, "--out", out, "--sensor", "noise", "--keep", 0)
    assert shlex.join(["--sensor", "noise"]) in (out / "report.html").read_text()
    with pytest.raises(ParameterError, match="unknown sensor 'fog'"):
        run("compare", "--out", out, "--sensor", "fog")
