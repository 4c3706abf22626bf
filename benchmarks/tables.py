"""Every published table: the commands that make it, how long that takes, and the machine that did it.

    python benchmarks/tables.py                    # what there is
    python benchmarks/tables.py --run              # those of at most five minutes, one after the other
    python benchmarks/tables.py --run Table1 --minutes 600

The commands are read from the pages that show the tables, block by block, and run in the folder --out, where campaigns,
comparisons and trainings that were interrupted go on. Minutes are of one core that has nothing else to do, roughly.
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
    "Bench": Table("benchmarks.md", "jssa-gym bench", 5),
    "ControlStep": Table("benchmarks.md", "benchmarks/control_step.py", 5),
    "Peer": Table("benchmarks.md", "benchmarks/cbfpy_peer.py", 3),
    "Paper": Table("reproducing.md", "jssa-gym reproduce all", 1),
    "TurningPerson": Table("reproducing.md", "benchmarks/turning_person.py", 1),
    "StandIn": Table("reproducing.md", "benchmarks/stand_in.py", 10),
    "Certificate": Table("certificate.md", "--sweep", 60),
    "Certificate10M": Table("certificate.md", "--out paper_10m", 15),
    "Leaderboard": Table("leaderboard.md", "benchmarks/leaderboard.py home reach_track handover rest --ours", 270),
    "Thousand": Table("leaderboard.md", "--out thousand", 40),
    "Receive": Table("leaderboard.md", "--out receive", 8),
    "AssumedSpeed": Table("leaderboard.md", "benchmarks/assumed_speed.py", 5),
    "Profiles": Table("filters.md", "--out compared", 40),
    "Tuning": Table("filters.md", "benchmarks/tune_filters.py", 60),
    "Scene": Table("filters.md", "benchmarks/paper_scene.py", 1),
    "Retreat": Table("filters.md", "retreat_and_split.py retreat", 20),
    "Split": Table("filters.md", "retreat_and_split.py split", 20),
    "CloserReach": Table("guarantees.md", "benchmarks/closer_reach.py", 10),
    "Visitors": Table("guarantees.md", "benchmarks/visitors.py", 20),
    "Claim": Table("guarantees.md", "--out claim-more", 120),
    "ClaimAgain": Table("guarantees.md", "--out claim-20000", 10),
    "Joints": Table("guarantees.md", "--out joints-unchecked", 40),
    "Power": Table("guarantees.md", "--preset power", 12),
    "Avoid": Table("guarantees.md", "--out rows", 60),
    "Attack": Table("guarantees.md", "benchmarks/attack.py", 60),
    "Energy": Table("guarantees.md", "benchmarks/contact_energy.py", 2),
    "Servo": Table("guarantees.md", "benchmarks/servo_residual.py", 15),
    "Robots": Table("robots.md", "--out cells_ur5e", 4),
    "Camera": Table("sensors.md", "--out camera", 20),
    "CameraCost": Table("sensors.md", "--out by_camera", 5),
    "Feet": Table("humans.md", "benchmarks/feet.py", 3),
    "Sliding": Table("maths.md", "benchmarks/sliding.py", 10),
    "Lambda": Table("maths.md", "--episodes 300 --only 2,0.25", 120),
    "Near": Table("maths.md", "benchmarks/choose_near.py", 60),
    "Controller": Table("control.md", "benchmarks/jpc.py", 5),
    "VectorController": Table("control.md", "benchmarks/vector_jpc.py", 4),
    "HandoverController": Table("control.md", "benchmarks/handover.py", 10),
    "Tasks": Table("tasks.md", "--out handed-straight", 8),
    "Handover": Table("tasks.md", "benchmarks/handover.py --episodes 20", 10),
    "HandoverPatient": Table("tasks.md", "--stay 60 --seconds 20", 4),
    "Deliver": Table("tasks.md", "--out delivered-straight", 3),
    "Guard": Table("controller.md", "benchmarks/guard_tick.py", 2),
    "Stream": Table("controller.md", "benchmarks/fanuc_stream.py", 10),
    "LeaderboardRate": Table("leaderboard.md", "benchmarks/leaderboard_rate.py", 8),
    "Campaign": Table("evaluation.md", "benchmarks/campaign_rate.py", 5),
    "Vector": Table("vector.md", "benchmarks/vector_step.py", 2),
    "Viewer": Table("viewer.md", "benchmarks/viewer_rate.py --seconds 15", 1),
    "ViewerBrowser": Table("viewer.md", "benchmarks/viewer_rate.py --seconds 8 --browser", 1),
    "Trainings": Table("training.md", "--out reach-0", 1500),
    "Trained": Table("training.md", "benchmarks/trained.py reach-0/best.npz", 60),
    "Baselines": Table("training.md", "jssa-gym curves ppo-inside ppo-without ppo-lagrangian", 120),
    "TrainedInside": Table("training.md", "benchmarks/trained.py sac-inside/seed-0/best.npz", 2),
    "Clock": Table("training.md", "--out envs-512", 25),
    "BaselinesTrack": Table("training.md", "--out track-inside", 15),
    "BaselinesDeliver": Table("training.md", "--out deliver-ppo", 15),
    "TrainedHandover": Table("training.md", "--task Handover --episodes 1000", 600),
    "PenaltyHandover": Table("training.md", "--out handover-02", 15),
    "Told": Table("training.md", "--out both-0", 15),
    "Overhead": Table("training.md", "benchmarks/training_overhead.py", 10),
    "Blocked": Table("training.md", "benchmarks/blocked_goals.py", 1),
}
"""Tables by a word of their own."""


def blocks(page: str) -> list[str]:
    """The commands of a page, as a shell would read them: its indented blocks, and what stands in a sentence."""
    text = re.sub(r"^```.*?^```", "", (DOCS / page).read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    found = re.findall(r"(?:^    .*\n)+", text, flags=re.MULTILINE)
    found = ["".join(line[4:] + "\n" for line in block.splitlines()) for block in found]
    return found + [f"{one}\n" for one in re.findall(r"`((?:chrt \S+ \S+ )?(?:jssa-gym|python) [^`\n]+)`", text)]


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
