"""The lowest versions that are allowed are those that were tried."""

import os
import re
import subprocess
import sys
import tomllib

import pytest
from places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_lowest_versions_that_are_tried_are_the_lowest_that_are_allowed():
    allowed = dict(
        re.match(r"([\w-]+)>=([\d.]+)", one).groups()
        for one in (*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["plots"])
    )
    lines = (ROOT / "constraints-lowest.txt").read_text().splitlines()
    tried = dict(line.split("==") for line in lines if not line.startswith("#"))
    # 1.2 is 1.2.0
    assert tried == {name: ".".join([*low.split("."), "0", "0"][:3]) for name, low in allowed.items()}


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.skipif(not (ROOT / ".ci").exists(), reason="only a clone has .ci")
@pytest.mark.skipif(sys.version_info >= (3, 14), reason="the lowest versions were not made for this Python")
def test_the_package_works_with_the_lowest_versions():
    run = subprocess.run(
        [ROOT / ".ci" / "lowest"],
        env=os.environ | {"PYTHON": sys.executable},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-3000:] + run.stderr[-3000:]
    assert " passed" in run.stdout
