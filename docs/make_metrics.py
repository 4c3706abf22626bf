"""Write the tables of ``docs/metrics.md`` anew from the code: ``python docs/make_metrics.py``."""

from pathlib import Path

from jssa_gym.evaluation.definitions import markdown, metrics_of
from jssa_gym.evaluation.metrics import Summary
from jssa_gym.evaluation.steps import StepSummary

PAGE = Path(__file__).parent / "metrics.md"


def tables() -> dict[str, str]:
    """Tables by the marker that they stand between."""
    early = tuple(metrics_of(StepSummary))
    known = {metric.name for metric in early}
    late = tuple(metric for metric in metrics_of(Summary) if metric.name not in known)
    return {"steps": markdown(early), "trace": markdown(late)}


def filled(page: str) -> str:
    """The page with its tables as they have to be."""
    for name, table in tables().items():
        before, rest = page.split(f"<!-- {name} -->")
        _, after = rest.split(f"<!-- /{name} -->")
        page = f"{before}<!-- {name} -->\n{table}\n<!-- /{name} -->{after}"
    return page


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text()))
