"""What has to be said once in several places says the same."""

import re
import tomllib

from places import ROOT

import jssa_gym


def test_the_version_is_the_same_everywhere():
    said = {
        "pyproject.toml": tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"],
        "jssa_gym": jssa_gym.__version__,
        "CITATION.cff": re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)[1],
        "citing.md": re.search(r"version = \{(.*)\}", (ROOT / "docs" / "citing.md").read_text())[1],
    }
    assert len(set(said.values())) == 1, said
