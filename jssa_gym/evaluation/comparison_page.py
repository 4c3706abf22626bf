"""A comparison of filters as one page that loads nothing; its columns are chosen in ``evaluation/standings.py``."""

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote_from_bytes

import numpy as np

from jssa_gym.evaluation.definitions import in_words
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.metrics import SeparationParams
from jssa_gym.evaluation.report import METRICS, Report, column
from jssa_gym.evaluation.standings import (
    PAIRED_MEANS,
    PAIRED_RATES,
    RATE_COLUMNS,
    UNFILTERED,
    Standing,
    columns,
    policy_standings,
    profile,
    slowdown_beside_people,
    standings,
    titles,
)
from jssa_gym.evaluation.statistics import Mean, PairedDifference, clopper_pearson
from jssa_gym.evaluation.study import Study
from jssa_gym.evaluation.svg import Markup, Panel, colour, dashes, document, figure, marker, note, rows_of, tag
from jssa_gym.robots.model import unpromised
from jssa_gym.storage import write_whole
from jssa_gym.text import counted

_BOXES = (
    *("min_distance_arm", "contact_speed", "intervention_rate", "path_length", "time_to_goal"),
    *("jerk_jumps_shield", "status_switches", "jerk_rms"),
)
"""What distributions are drawn of."""

_RANKED = ("success_and_safe", "moving_contact")
"""Rates by which policies are compared in pairs."""

_PAIRED = tuple(f"{name}_rate" for name in PAIRED_RATES)

_TIMES = (
    f"The median time to the goal is over the episodes in which it was reached. Its ratio to {UNFILTERED} compares "
    f"goal by goal, over those reached both ways beside the same people; lost are those that {UNFILTERED} reached and "
    "this filter did not, of which the ratio says nothing. Tasks that hold a goal from the beginning count in neither."
)

_READING = """Rates are k of n episodes with exact (Clopper-Pearson) 95 % intervals; means are over episodes with
bootstrap 95 % intervals. All filters met the same seeds: the same people, goals and draws of the policy. Intervals say
how sure one can be of these numbers <em>for these simulated people, policies and tasks</em>; they say nothing about
other ones, and nothing about a real cell. A filter without a collision in n episodes may still have a rate of up to the
upper bound. Differences are not corrected for having looked at many. This is research software, not a safety-rated
device."""


def write_page(path: Path, study: Study, reports: Sequence[Report], command: str) -> None:
    """Write the comparison; the file appears when it is complete.

    Args:
        path: Of the file.
        study: What was compared.
        reports: A report a setting.
        command: That made it.
    """
    write_whole(path, page(study, reports, command, path.parent))


def page(study: Study, reports: Sequence[Report], command: str, folder: Path) -> str:
    """The comparison as HTML; recordings are linked from ``folder``."""
    ranked = standings(reports)
    number = {name: k for k, name in enumerate(study.filters)}
    episodes, steps = counted(study.episodes, "episode"), counted(study.steps, "step")
    tried = (("Tasks", study.tasks), ("People", study.humans), ("Policies", study.policies))
    about = " ".join(f"{what}: {', '.join(names)}." for what, names in tried)
    keys = legend(number)
    sections = {
        "Over everything": [keys, *_leaderboard(ranked, len(study.policies)), note(_TIMES), *_paired(ranked)],
        **({"Policies": _policies(reports)} if len(study.policies) > 1 else {}),
        "Safety against getting there": [keys, *_tradeoff(ranked, number)],
        "Performance profiles": [keys, *_profiles(ranked, number)],
        "Distributions": [*_boxes(ranked, number), note("Least, quartiles and largest over all episodes.")],
        "Setting by setting": _settings(reports),
        "Worst episodes": _worst(reports, folder),
        "What the numbers are": _definitions(study.v_safe, study.separation),
        "All numbers": [_everything(report) for report in reports],
    }
    parts = [
        tag("h1", "Filters compared"),
        tag("p", f"{episodes} of at most {steps} a combination, first seed {study.seed}. {about}"),
        tag("p", tag("code", command)),
        note(f"Made with {made_with()}."),
        *([tag("p", f"Of the robot, {told}.")] if (told := unpromised(reports[0].uncovered)) else []),
        note(Markup(_READING)),
        *(part for title, inside in sections.items() for part in (tag("h2", title), *inside)),
    ]
    return document("Filters compared", parts)


def legend(number: dict[str, int]) -> Markup:
    """Which line and marker is whose."""
    line = {"x1": 0, "x2": 48, "y1": 7, "y2": 7, "stroke_width": 2}
    keys = []
    for name, k in number.items():
        stroke = tag("line", **line, stroke=colour(k), stroke_dasharray=dashes(k))
        keys.append(
            tag("span", tag("svg", stroke, marker(k, 24.0, 7.0), width=48, height=14), f" {name}", class_="key")
        )
    return tag("p", *keys)


def _leaderboard(ranked: Sequence[Standing], policies: int) -> list[Markup]:
    rows = [[one.filter, len(one.pooled.episodes), *columns(one.pooled, one.slowdown)] for one in ranked]
    pools = f"Each row pools {policies} policies, which are ranked below."
    return [*([note(pools)] if policies > 1 else []), *_in_two(["filter", "episodes"], rows, text=1)]


def _in_two(heads: Sequence[str], rows: Sequence[Sequence[Any]], text: int) -> list[Markup]:
    """Rows that begin with ``heads`` and go on with :func:`columns`, as two tables that fit a page."""
    first, cut = len(heads), len(heads) + RATE_COLUMNS
    return [
        tag("h3", "How often"),
        rows_of([*heads, *titles()[:RATE_COLUMNS]], [row[:cut] for row in rows], text),
        tag("h3", "How near, how smoothly, how fast"),
        rows_of([*heads, *titles()[RATE_COLUMNS:]], [[*row[:first], *row[cut:]] for row in rows], text),
    ]


def _policies(reports: Sequence[Report]) -> list[Markup]:
    """A ranking of the policies under each filter."""
    rows, strangers = [], False
    for name, ranked in policy_standings(reports).items():
        for one in ranked:
            rates, count = one.pooled.rates, len(one.pooled.episodes)
            compared = [_difference(one.rates[of]) if one.rates else "-" for of in _RANKED]
            pairs = "best" if one.rank == 1 else f"{one.paired} of {count}" if one.paired else "none: other seeds"
            strangers = strangers or (one.rank > 1 and one.paired < count)
            shown = [str(rates[f"{of}_rate"]) for of in ("success_and_safe", "success", "collision", "moving_contact")]
            rows.append([name, one.policy, one.rank, count, *shown, pairs, *compared])
    named = [in_words(f"{of}_rate") for of in ("success_and_safe", "success", "collision", "moving_contact")]
    minus = [f"{in_words(f'{of}_rate')}, minus the best" for of in _RANKED]
    unpaired = (
        "Where pairs are missing, a policy met other people, goals and draws than the best one: their rates can be "
        "compared by their own intervals only. --pair-policies gives all policies the same seeds."
    )
    titles = ["filter", "policy", "rank", "episodes", *named, "pairs with the best", *minus]
    return [rows_of(titles, rows, text=2), note(unpaired if strangers else "All policies met the same seeds.")]


def _paired(ranked: Sequence[Standing]) -> list[Markup]:
    others = [one for one in ranked if one.rates]
    if not others:
        return []
    (first,) = (one.filter for one in ranked if not one.rates)
    rows = [
        (
            one.filter,
            [_difference(one.rates[name]) for name in PAIRED_RATES],
            [_shift(one.means.get(name)) for name in PAIRED_MEANS],
        )
        for one in others
    ]
    said = (
        "Rates: difference with Bonett and Price's interval, and p of McNemar's exact test. Means: bootstrap of the "
        "paired differences."
    )
    return [
        tag("h2", f"Minus {first}, on the same episodes"),
        rows_of(["filter", *map(in_words, _PAIRED)], [[name, *rates] for name, rates, _ in rows]),
        rows_of(["filter", *map(in_words, PAIRED_MEANS)], [[name, *means] for name, _, means in rows]),
        note(said),
    ]


def _difference(of: PairedDifference) -> str:
    return f"{100 * of.value:+.1f} % ({100 * of.low:+.1f} to {100 * of.high:+.1f}), p = {of.p_value:.2g}"


def _shift(mean: Mean | None) -> str:
    return "-" if mean is None else f"{mean.value:+.3g} ({mean.low:+.3g} to {mean.high:+.3g})"


def _tradeoff(ranked: Sequence[Standing], number: dict[str, int]) -> list[Markup]:
    figures = []
    for bad, what in (("moving_contact_rate", "contact with the arm moving"), ("collision_rate", "any contact")):
        panel = Panel((0.0, 1.0), (0.0, 1.0), "success rate", f"share without {what}")
        for one in ranked:
            reached, met = one.pooled.rates["success_rate"], one.pooled.rates[bad]
            panel.cross(
                (reached.value, reached.low, reached.high),
                (1.0 - met.value, 1.0 - met.high, 1.0 - met.low),
                number[one.filter],
                f"{one.filter}: success {reached}, {what} {met}",
            )
        figures.append(figure(panel, f"Without {what}. Up and right is better."))
    return figures


def _profiles(ranked: Sequence[Standing], number: dict[str, int]) -> list[Markup]:
    tasks = dict.fromkeys(episode.task for episode in ranked[0].pooled.episodes)
    returns = (_profile(ranked, number, "ep_return", f"task {task}", task) for task in tasks)
    return [_profile(ranked, number, "min_distance_arm", "m", None), *returns]


def _profile(ranked: Sequence[Standing], number: dict[str, int], name: str, what: str, task: str | None) -> Markup:
    values = {one.filter: column([e for e in one.pooled.episodes if task in (None, e.task)], name) for one in ranked}
    finite = np.concatenate([x[np.isfinite(x)] for x in values.values()])
    if not len(finite):
        return Markup()
    thresholds = np.linspace(finite.min(), finite.max(), 80)
    panel = Panel((thresholds[0], thresholds[-1]), (0.0, 1.0), in_words(name, what), "share of episodes ≥ x")
    for of, x in values.items():
        share, count = profile(x, thresholds), len(x)
        bounds = np.array([clopper_pearson(round(s * count), count) for s in share])
        panel.band(thresholds, bounds[:, 0], bounds[:, 1], number[of])
        panel.curve(thresholds, share, number[of], of)
    return figure(panel, "Share of the episodes with at least so much; pointwise 95 % intervals.")


def _boxes(ranked: Sequence[Standing], number: dict[str, int]) -> list[Markup]:
    figures, units = [], {metric.name: metric.unit for metric in METRICS}
    for name in _BOXES:
        values = {one.filter: column(one.pooled.episodes, name) for one in ranked}
        quantiles = {
            of: np.quantile(x[np.isfinite(x)], [0, 0.25, 0.5, 0.75, 1])
            for of, x in values.items()
            if np.isfinite(x).any()
        }
        if not quantiles:
            continue
        ends = (min(q[0] for q in quantiles.values()), max(q[-1] for q in quantiles.values()))
        names = [one.filter for one in ranked]
        title = in_words(name, units[name])
        panel = Panel(ends, (len(names) - 0.5, -0.5), title, "", names=names, height=58.0 + 24.0 * len(names))
        for row, of in enumerate(names):
            if of in quantiles:
                told = ", ".join(f"{value:.3g}" for value in quantiles[of])
                panel.box(row, quantiles[of].tolist(), number[of], f"{of}: {told}")
        figures.append(figure(panel))
    return figures


def _settings(reports: Sequence[Report]) -> list[Markup]:
    unfiltered = {report.setting: report for report in reports if report.setting.filter == UNFILTERED}
    rows = []
    for report in reports:
        other = unfiltered.get(report.setting._replace(filter=UNFILTERED))
        rows.append([*report.setting, *columns(report, slowdown_beside_people(report, other))])
    return _in_two(["task", "filter", "people", "policy"], rows, text=4)


def _worst(reports: Sequence[Report], folder: Path) -> list[Markup]:
    rows = []
    for report in reports:
        by_name = {episode.trace_name: episode for episode in report.episodes}
        for path in report.traces:
            episode = by_name[path.name]
            speed, distance = episode.summary.contact_speed, episode.summary.min_distance
            told = [*report.setting, episode.seed, f"{speed:.3g} m/s", f"{distance:.3g} m"]
            rows.append([*told, _link(path, folder)])
    if not rows:
        return [tag("p", "None were recorded.")]
    titles = ["task", "filter", "people", "policy", "seed", "contact speed", "min distance", "to see it again"]
    unlike = [f"{', '.join(r.setting)}, seed {seed}" for r in reports for seed in r.unlike]
    note = [tag("p", f"Went otherwise when played again: {'; '.join(unlike)}.")] if unlike else []
    return [rows_of(titles, rows, text=4), *note]


def _link(path: Path, folder: Path) -> Markup:
    place = quote_from_bytes(os.fsencode(Path(os.path.relpath(path, folder)).as_posix()))
    command = shlex.join(["jssa-gym", "replay", str(path), "--verify"])
    return Markup(f"{tag('a', 'recording', href=place)} {tag('code', command)}")


def _definitions(v_safe: float, separation: SeparationParams) -> list[Markup]:
    speed = "measured" if separation.human_speed is None else f"{separation.human_speed:g} m/s"
    stated = (
        f"v_safe = {v_safe:g} m/s. Speed and separation monitoring with v_h = {speed}, T_r = "
        f"{separation.reaction_time:g} s, C = {separation.intrusion:g} m, Z = {separation.uncertainty:g} m; T_s and "
        "S_s are those of the jerk-limited stop. Decision times are those of the machine that ran this, and of "
        "all that ran beside it."
    )
    rows = [[in_words(metric.over_episodes), metric.name, metric.unit, metric.text] for metric in METRICS]
    table = rows_of(["metric", "in files", "unit", "definition"], rows, text=4, kind="text long")
    return [note(stated), tag("details", tag("summary", "All metrics"), table)]


def _everything(report: Report) -> Markup:
    units = {metric.over_episodes: metric.unit for metric in METRICS}
    rows = [
        *([in_words(name), rate, "", "", "", rate.n] for name, rate in report.rates.items()),
        *([in_words(name, units[name]), mean, *_ends(mean), mean.n] for name, mean in report.means.items()),
    ]
    titles = ["", "rate or mean", "least", "5th percentile", "largest", "episodes"]
    return tag("details", tag("summary", ", ".join(report.setting)), rows_of(titles, rows))


def _ends(mean: Mean) -> list[str]:
    return [f"{value:.3g}" for value in (mean.least, mean.p05, mean.most)]
