"""Write the tables of the pages that are made from the code anew: ``python docs/make_tables.py``."""

from collections.abc import Sequence
from pathlib import Path

from jssa_gym.envs.goals import GOAL_TERMS
from jssa_gym.envs.observation import Feature, arm_features, body_features
from jssa_gym.envs.tasks import COMMON_TERMS, TASKS, RewardTerm
from jssa_gym.evaluation.definitions import markdown, metrics_of
from jssa_gym.evaluation.metrics import Summary
from jssa_gym.evaluation.steps import StepSummary
from jssa_gym.humans import Body
from jssa_gym.robots import DEFAULT, make_robot

DOCS = Path(__file__).parent


def metrics() -> dict[str, str]:
    """Tables of ``metrics.md`` by the marker that they stand between."""
    early = tuple(metrics_of(StepSummary))
    known = {metric.name for metric in early}
    late = tuple(metric for metric in metrics_of(Summary) if metric.name not in known)
    return {"steps": markdown(early), "trace": markdown(late)}


def spaces() -> dict[str, str]:
    """Tables of ``spaces.md``: the default arm beside one person."""
    robot, parts = make_robot(DEFAULT), len(Body.facing().radius)
    common = arm_features(robot, parts)
    begin = sum(feature.size for feature in common)
    tables = {"observation": _observed(common), "reward": _rewarded(COMMON_TERMS)}
    tables |= {"full observation": _observed(body_features(parts), begin), "goal reward": _rewarded(GOAL_TERMS)}
    for name, task in TASKS.items():
        tables[f"{name} observation"] = _observed(task().features(robot), begin)
        tables[f"{name} reward"] = _rewarded(task.terms)
    return tables


def _observed(features: Sequence[Feature], begin: int = 0) -> str:
    lines = ["| index | name | within | meaning |", "|---|---|---|---|"]
    for feature in features:
        end = begin + feature.size
        index = f"{begin}" if feature.size == 1 else f"{begin}–{end - 1}"
        lines.append(f"| {index} | `{feature.name}` | [{feature.low:g}, {feature.high:g}] | {feature.text} |")
        begin = end
    return "\n".join(lines)


def _rewarded(terms: Sequence[RewardTerm]) -> str:
    lines = ["| weight | term | value |", "|---|---|---|"]
    return "\n".join(lines + [f"| {term.weight:+g} | `reward/{term.name}` | {term.text} |" for term in terms])


PAGES = {"metrics.md": metrics, "spaces.md": spaces}
"""What makes the tables of each page."""


def filled(name: str, page: str) -> str:
    """A page with its tables as they have to be."""
    for marker, table in PAGES[name]().items():
        before, rest = page.split(f"<!-- {marker} -->")
        _, after = rest.split(f"<!-- /{marker} -->")
        page = f"{before}<!-- {marker} -->\n{table}\n<!-- /{marker} -->{after}"
    return page


if __name__ == "__main__":
    for name in PAGES:
        path = DOCS / name
        path.write_text(filled(name, path.read_text(encoding="utf-8")), encoding="utf-8")
