"""Policies of a comparison: ranked, in pairs where they met the same seeds, and told where they did not."""

import dataclasses
import re
from html import unescape
from pathlib import Path

import pytest

import jssa_gym
from jssa_gym.cli.compare import Compare
from jssa_gym.evaluation import Report, Study
from jssa_gym.evaluation.comparison_page import page
from jssa_gym.evaluation.definitions import WORDS, in_words
from jssa_gym.evaluation.report import METRICS
from jssa_gym.evaluation.standings import policy_standings


@pytest.fixture(scope="module")
def episode():
    """Any episode; what is asked of it is written over."""
    return jssa_gym.evaluate("jssa_gym/Reach-v0", "hold", 1, env_kwargs={"human": "none"}, steps=5).episodes[0]


def report(episode, policy, safe, first=0, guard="stop"):
    """Episodes of one policy, from a first seed on; whether each was a safe success."""
    rows = []
    for seed, good in enumerate(safe, first):
        summary = dataclasses.replace(
            episode.summary, success=good, success_and_safe=good, success_untouched=good, moving_contact=not good
        )
        change = {"task": "reach", "human": "none", "filter": guard, "policy": policy, "seed": seed, "summary": summary}
        rows.append(dataclasses.replace(episode, **change))
    return Report.of(rows)


def study(**changes):
    return Study(("reach",), ("stop",), ("none",), ("hold", "straight"), episodes=4, seed=0, steps=5, **changes)


def section(html):
    return unescape(re.sub(r"<[^>]+>", " ", html.split("<h2>Policies</h2>")[1].split("<h2>")[0]))


def test_policies_are_ranked_and_paired_on_the_same_seeds(episode):
    reports = [
        report(episode, "hold", [False, True, False, False]),
        report(episode, "straight", [True, True, True, False]),
    ]
    best, other = policy_standings(reports)["stop"]
    assert [(one.policy, one.rank) for one in (best, other)] == [("straight", 1), ("hold", 2)]
    assert best.rates == {}
    difference = other.rates["success_and_safe"]
    assert (difference.n, difference.first_only, difference.second_only) == (4, 0, 2)
    assert difference.value == -0.5
    text = section(page(study(pair_policies=True), reports, "x", Path()))
    assert "4 of 4" in text
    assert "-50.0 %" in text
    assert "All policies met the same seeds." in text
    assert text.index("straight") < text.index("hold")


def test_policies_on_other_seeds_are_ranked_and_not_paired(episode):
    reports = [report(episode, "hold", [True] * 4), report(episode, "straight", [False] * 4, first=1000)]
    best, other = policy_standings(reports)["stop"]
    assert (best.policy, other.paired, other.rates) == ("hold", 0, {})
    text = section(page(study(), reports, "x", Path()))
    assert "none: other seeds" in text
    assert "--pair-policies" in text
    assert "met the same seeds" not in text


def test_only_shared_episodes_are_paired(episode):
    reports = [report(episode, "hold", [True] * 4), report(episode, "straight", [False] * 4, first=2)]
    other = policy_standings(reports)["stop"][1]
    assert other.paired == other.rates["success"].n == 2


def test_every_filter_has_a_ranking_of_its_own(episode):
    reports = [
        report(episode, who, [good] * 2, guard=guard)
        for guard, well in (("stop", "hold"), ("none", "straight"))
        for who in ("hold", "straight")
        for good in [who == well]
    ]
    ranked = policy_standings(reports)
    assert {name: some[0].policy for name, some in ranked.items()} == {"stop": "hold", "none": "straight"}


def test_one_policy_needs_no_ranking(episode):
    alone = Study(("reach",), ("stop",), ("none",), ("hold",), episodes=4, seed=0, steps=5)
    assert "<h2>Policies</h2>" not in page(alone, [report(episode, "hold", [True])], "x", Path())


def test_seeds_are_shared_by_policies_only_if_asked_for():
    apart, paired = study(), study(pair_policies=True)
    one, other = apart.seeds().values()
    assert not set(one) & set(other)
    one, other = paired.seeds().values()
    assert one == other
    # what was begun before there was a choice goes on
    assert "pair_policies" not in apart.config()
    assert paired.config()["pair_policies"] is True


@pytest.mark.long
def test_the_command_pairs_policies(tmp_path, capsys):
    command = Compare(
        filters=("none",), humans=("none",), policies=("hold", "straight"), episodes=2, seconds=0.1, keep=0
    )
    dataclasses.replace(command, out=tmp_path / "out", pair_policies=True).run()
    html = (tmp_path / "out" / "report.html").read_text()
    assert "2 of 2" in section(html)
    assert "--pair-policies" in html.split("<code>")[1].split("</code>")[0]
    capsys.readouterr()


def test_every_word_is_a_metrics_and_no_two_are_alike():
    names = [metric.over_episodes for metric in METRICS]
    assert set(WORDS) <= set(names)
    words = [in_words(name) for name in names]
    assert len(set(words)) == len(words), [word for word in words if words.count(word) > 1]
    assert not any("_" in word.replace("d_min", "").replace("v_safe", "") for word in words)
    assert in_words("contact_speed", "m/s") == "fastest contact [m/s]"
