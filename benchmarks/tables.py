"""Every published table: the commands that make it, how long that takes, and the machine that did it.

    python benchmarks/tables.py                    # what there is
    python benchmarks/tables.py --run              # those of at most five minutes, one after the other
    python benchmarks/tables.py --run Table1 --minutes 600

The commands are read from the pages that show the tables, block by block, and run in the folder --out, where campaigns
and comparisons that were interrupted go on. Minutes are of one core that has nothing else to do, roughly.
"""

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from jssa_gym.evaluation.identity import made_with

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


class Table(NamedTuple):
    """A table, or several that one block of commands makes."""

    page: str
    sign: str
    """In the block of commands, and in no other of the page."""
    minutes: float


TABLES = {
    "Paper": Table("reproducing.md", "jssa-gym reproduce all", 1),
    "TurningPerson": Table("reproducing.md", "benchmarks/turning_person.py", 1),
    "Certificate": Table("certificate.md", "--sweep", 60),
    "Certificate10M": Table("certificate.md", "--out paper_10m", 15),
    "Leaderboard": Table("leaderboard.md", "benchmarks/leaderboard.py home reach_track handover rest --ours", 270),
    "Thousand": Table("leaderboard.md", "--out thousand", 40),
    "Receive": Table("leaderboard.md", "--out receive", 8),
    "AssumedSpeed": Table("leaderboard.md", "benchmarks/assumed_speed.py", 5),
    "Profiles": Table("filters.md", "--out compared", 40),
    "Retreat": Table("filters.md", "retreat_and_split.py retreat", 20),
    "Split": Table("filters.md", "retreat_and_split.py split", 20),
    "Claim": Table("guarantees.md", "--out claim-more", 120),
    "Joints": Table("guarantees.md", "--out joints-unchecked", 40),
    "Power": Table("guarantees.md", "--preset power", 12),
    "Avoid": Table("guarantees.md", "--out rows", 60),
    "Attack": Table("guarantees.md", "benchmarks/attack.py", 60),
    "Energy": Table("guarantees.md", "benchmarks/contact_energy.py", 2),
    "Robots": Table("robots.md", "--out cells_ur5e", 4),
    "Camera": Table("sensors.md", "--out camera", 20),
    "Sliding": Table("maths.md", "benchmarks/sliding.py", 10),
    "Lambda": Table("maths.md", "--episodes 300 --only 2,0.25", 120),
    "Tasks": Table("tasks.md", "--out reached", 4),
    "Guard": Table("controller.md", "benchmarks/guard_tick.py", 2),
    "Vector": Table("vector.md", "benchmarks/vector_step.py", 2),
}
"""Tables by a word of their own. Those of trained policies take days: docs/training.md has the commands."""


def blocks(page: str) -> list[str]:
    """The indented blocks of a page, as a shell would read them."""
    text = re.sub(r"^```.*?^```", "", (DOCS / page).read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    found = re.findall(r"(?:^    .*\n)+", text, flags=re.MULTILINE)
    return ["".join(line[4:] + "\n" for line in block.splitlines()) for block in found]


def block(table: Table) -> str:
    """The commands of a table.

    Raises:
        SystemExit: Its page has not just one such block.
    """
    found = [one for one in blocks(table.page) if table.sign in one]
    if len(found) != 1:
        raise SystemExit(f"docs/{table.page} has {len(found)} blocks of commands with {table.sign!r}")
    return found[0]


def run(script: str, out: Path) -> int:
    """Run commands as they stand on a page, in a folder from which the scripts are found."""
    out.mkdir(parents=True, exist_ok=True)
    for name in ("benchmarks", "docs"):
        if not (out / name).exists():
            (out / name).symlink_to(ROOT / name)
    place = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    command = ["bash", "-e", "-u", "-o", "pipefail", "-c", script]
    return subprocess.run(command, cwd=out, env={**os.environ, "PATH": place}, check=False).returncode


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(TABLES)}; all by default")
    parser.add_argument("--run", action="store_true", help="run the commands, and do not only say them")
    parser.add_argument("--minutes", type=float, default=5.0, help="leave out what takes longer; 5 by default")
    parser.add_argument("--out", type=Path, default=ROOT / "tables", help="folder to run them in")
    args = parser.parse_args()
    if unknown := sorted({*args.names} - {*TABLES}):
        parser.error(f"nothing of {', '.join(unknown)}; there is {', '.join(TABLES)}")
    print(made_with())
    failed = []
    for name in args.names or TABLES:
        table = TABLES[name]
        script = block(table)
        long = table.minutes > args.minutes
        later = f"; too long for now: --run {name} --minutes {table.minutes:g}" if args.run and long else ""
        print(f"\n{name} (docs/{table.page}), about {table.minutes:g} min of one core{later}\n{script}", flush=True)
        if args.run and not long and run(script, args.out) != 0:
            failed.append(name)
    if failed:
        raise SystemExit(f"did not end well: {', '.join(failed)}")


if __name__ == "__main__":
    main()
