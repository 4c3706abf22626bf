"""``jssa-gym certify``: where an index can be kept, and where not."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table

from jssa_gym import plots, robots
from jssa_gym.certificate.boundary import KEPT, Domain
from jssa_gym.certificate.census import Part
from jssa_gym.certificate.certify import Certificate, certify
from jssa_gym.certificate.counterexample import load_counterexample, play_on, save_counterexample
from jssa_gym.certificate.lambda_map import LambdaMap, sweep
from jssa_gym.cli.engine import Engine
from jssa_gym.cli.files import own_folder, writable_folder, write_figure
from jssa_gym.cli.progress import Bar, counting
from jssa_gym.cli.terminal import Terminal
from jssa_gym.evaluation import judge
from jssa_gym.robots import RobotModel, make_robot
from jssa_gym.safety.index import DEFAULT, PUBLISHED, IndexParams
from jssa_gym.storage import file_name, write_json
from jssa_gym.validation import positive_integer

_RESULTS = ("certificate.json", "chunks.jsonl", "map.json")
"""Files of which there is one as soon as there is anything."""


@dataclass(frozen=True)
class Certify:
    """Does some admissible jerk always keep the safety index, Eq. (7)? Sampled, then searched for worse.

    It is about a domain of states, which --tip-speed, --human-speed, --distance and the options up to --viable bound.
    The exit code is 1 if a counter-example was found in the domain. What was interrupted goes on when the same command
    is given again; a map (--sweep) begins anew. With the defaults it takes about half a minute of one core, ten million
    states some minutes.
    """

    lambda1: float = DEFAULT.lambda1
    """λ₁ of the index [m·s]."""
    lambda2: float = DEFAULT.lambda2
    """λ₂ of the index [m·s²]."""
    d_min: float = DEFAULT.d_min
    """Margin of the index [m]."""
    robot: str = robots.DEFAULT
    """Name of a robot, an MJCF file with its limits beside it, or a folder of jssa-gym robot check --write."""
    capsules: tuple[str, ...] = ()
    """Names of the capsules; all that more than one joint moves if there is none."""
    domain: Annotated[Domain, tyro.conf.arg(name="")] = field(default_factory=Domain)
    states: int | None = None
    """How many of each capsule, 100,000 unless given; with --sweep of each capsule and pair, 5,000."""
    seed: int = 0
    """Seed of the draws."""
    search: bool = True
    """Whether to search for worse than was drawn, which takes longer than 100,000 draws."""
    out: Path = Path("certificate")
    """Folder for counts, certificate, counter-examples and map."""
    sweep: bool = False
    """Draw the map of lambda1 and lambda2 instead, and name the pair that loses the fewest boundary states."""
    lambda1_range: tuple[float, float] = (0.5, 8.0)
    """λ₁ of the map, least and most [m·s]."""
    lambda2_range: tuple[float, float] = (0.05, 8.0)
    """λ₂ of the map, least and most [m·s²]."""
    grid: int = 7
    """Values of either parameter in the map's first grid."""
    trigger: float | None = None
    """Trigger of the map: the best pair slows nobody down who is farther away than this [m]; the domain's largest
    distance unless given."""
    replay: Path | None = None
    """Play a counter-example's recording again instead: exit code 1 if it does not go as it was recorded."""
    workers: Annotated[Engine, tyro.conf.arg(name="")] = field(default_factory=Engine)
    json: bool = False
    """Print JSON instead of a table."""

    def run(self) -> None:
        """Certify, draw the map, or play again."""
        if self.replay is not None:
            self._replay(self.replay)
            return
        if self.states is not None:
            positive_integer("states", self.states)
        if self.sweep:
            self._sweep()
        else:
            self._certify()

    def _certify(self) -> None:
        own_folder(self.out, *_RESULTS)
        index = IndexParams(d_min=self.d_min, lambda1=self.lambda1, lambda2=self.lambda2)
        robot, console = make_robot(self.robot), Terminal(stderr=True)
        try:
            with Bar(console, *counting()) as progress:
                task = progress.add_task("states", total=None)
                found = certify(
                    robot,
                    index,
                    domain=self.domain,
                    capsules=self.capsules,
                    states=100_000 if self.states is None else self.states,
                    seed=self.seed,
                    jobs=self.workers.chosen(),
                    folder=self.out,
                    search=self.search,
                    progress=lambda count: progress.advance(task, count),
                )
        except KeyboardInterrupt:
            console.say(f"stopped; the same command goes on from the counts in {self.out}")
            raise SystemExit(130) from None
        written = [self.out / "certificate.json"]
        plain = found.as_json() | _what_is_uncovered(robot)
        write_json(written[0], plain)
        for link in found.links:
            path = self.out / f"counterexample-{file_name(link.capsule)}.npz"
            path.unlink(missing_ok=True)
            if not link.worst.ahead <= KEPT:
                save_counterexample(path, robot, index, link.worst, dt=found.dt, viable=self.domain.viable)
                written.append(path)
        if self.json:
            print(json.dumps(plain, indent=2))
        else:
            _say_what_is_uncovered(robot)
            _show(found, self.search)
        console.say(f"wrote {', '.join(map(str, written))}")
        if not found.holds:
            raise SystemExit(1)

    def _sweep(self) -> None:
        plots.require()
        robot, console = make_robot(self.robot), Terminal(stderr=True)
        writable_folder(self.out, *_RESULTS)
        with Bar(console, *counting()) as progress:
            task, total = progress.add_task("pairs", total=0), 0

            def done(count: int) -> None:
                nonlocal total
                total -= min(count, 0)
                progress.update(task, total=total, advance=max(count, 0))

            swept = sweep(
                robot,
                lambda1=self.lambda1_range,
                lambda2=self.lambda2_range,
                d_min=self.d_min,
                grid=self.grid,
                trigger=self.trigger,
                domain=self.domain,
                capsules=self.capsules,
                states=5_000 if self.states is None else self.states,
                seed=self.seed,
                jobs=self.workers.chosen(),
                progress=done,
            )
        plain = swept.as_json() | _what_is_uncovered(robot)
        write_json(self.out / "map.json", plain)
        marked = {"asked about": (self.lambda1, self.lambda2), "the paper's": (PUBLISHED.lambda1, PUBLISHED.lambda2)}
        figure = plots.lambda_map(swept, marked)
        write_figure(self.out / "map.png", figure)
        if self.json:
            print(json.dumps(plain, indent=2))
        else:
            _say_what_is_uncovered(robot)
            _show_map(swept)
        console.say(f"wrote {self.out / 'map.json'}, {self.out / 'map.png'}")

    def _replay(self, path: Path) -> None:
        recorded, index, found, viable = load_counterexample(path)
        robot = make_robot(self.robot)
        verdict = judge(recorded, robot)
        again = play_on(robot, index, found, dt=recorded.dt, viable=viable, ticks=len(recorded.time))
        same = again.jerk.tobytes() == recorded.jerk.tobytes() and again.phi.tobytes() == recorded.phi.tobytes()
        if self.json:
            ticks = [{"time": float(t), "phi": float(p)} for t, p in zip(again.time, again.phi, strict=True)]
            values = {"capsule": found.capsule, "infeasible": bool(again.phi[0] > KEPT), "ticks": ticks}
            print(json.dumps({**values, "same": same, "mujoco_agrees": verdict.agrees}, indent=2))
        else:
            table = Table("time", "φ", "distance of the arm", "what the filter says", title=recorded.name)
            table.add_row("0.000 s", "0 m²", "", "")
            for k in range(0, len(again.time), 1 if len(again.time) < 12 else 3):
                row = (f"{again.time[k]:.3f} s", f"{again.phi[k]:+.3g} m²", f"{again.distance[k]:.3f} m")
                table.add_row(*row, str(again.reason[k]))
            console = Terminal()
            console.print(table)
            console.say(
                f"the recording is {'the same' if same else 'ANOTHER'}; MuJoCo's distances "
                f"{'agree' if verdict.agrees else 'DISAGREE'}"
            )
        if not (same and verdict.agrees):
            raise SystemExit(1)


def _what_is_uncovered(robot: RobotModel) -> dict[str, list[str]]:
    return {"uncovered": list(robot.uncovered)} if robot.uncovered else {}


def _say_what_is_uncovered(robot: RobotModel) -> None:
    if robot.uncovered:
        Terminal().say(robot.unpromised)


def _words(part: Part | None) -> str:
    if part is None:
        return "none"
    near, far = part.distance
    return (
        f"tip ≤ {part.tip_speed:.3g} m/s, {near:.2f} to {far:.2f} m, authority ≥ {part.authority:g} m/s³ "
        f"(0 / {part.states:,}, ≤ {100.0 * part.bound:.2g} %)"
    )


def _show(found: Certificate, searched: bool) -> None:
    console = Terminal(width=150)
    index = found.index
    table = Table(
        title=f"states with φ = 0 that no jerk keeps: λ = ({index.lambda1:g}, {index.lambda2:g}), {index.d_min:g} m",
    )
    titles = ("", "infeasible", "outside 𝒞", "infeasible inside", "worst φ after a step", "found at")
    for title in (*titles, "jerk: least, 1 %, median"):
        table.add_column(title)
    for link in found.links:
        worst = link.worst
        table.add_row(
            link.capsule,
            str(link.infeasible),
            f"{100.0 * link.outside.value:.2g} %",
            f"{link.infeasible_inside:,} / {link.outside.n - link.outside.k:,}",
            f"{worst.ahead:+.3g} m² (drawn {link.worst_drawn:+.3g})",
            f"{worst.distance:.2f} m, tip {worst.tip_speed:.2f} m/s, authority {worst.authority:.1f} m/s³",
            f"{link.least_jerk:.3g}, {link.jerk[0.01]:.3g}, {link.jerk[0.5]:.3g} m/s³",
        )
    console.print(table)
    kept = Table("", "largest part without an infeasible draw")
    if searched:
        kept.add_column("and without one that a search in it found")
    for link in found.links:
        row = (link.capsule, _words(link.sampled_part), f"{_words(link.part)}; {link.searched} found")
        kept.add_row(*row[: len(kept.columns)])
    console.print(kept)
    edge = ", ".join(f"{speed:.2f} m/s at {D:g} m" for D, speed in found.fastest_approach.items())
    console.say(f"the index alone ends approaches up to: {edge}")
    if (inside := found.inside) is not None:
        said = "the set does not hold" if inside.k else "none that was drawn leaves it"
        console.say(f"of the states inside the set 𝒞 of such approaches {inside} are infeasible: {said}")
    console.say(
        f"the sufficient condition asks for a jerk of {found.needed_jerk:.3g} m/s³: "
        f"{'holds' if found.suffices else 'does not hold'} on the domain"
    )
    verdict = "no counter-example was found" if found.holds else "counter-examples were found: the certificate FAILS"
    console.say(f"on the domain {verdict}")


def _show_map(swept: LambdaMap) -> None:
    console = Terminal()
    table = Table("λ₁", "λ₂", "lost: worst capsule", "infeasible: worst capsule", "first slowed down at")
    for cell in sorted(swept.allowed, key=lambda cell: cell.cost)[:8]:
        table.add_row(
            f"{cell.lambda1:.3g}",
            f"{cell.lambda2:.3g}",
            f"≤ {100.0 * cell.cost:.2g} %",
            f"≤ {100.0 * max(rate.high for rate in cell.infeasible.values()):.2g} %",
            f"{cell.trigger:.2f} m",
        )
    console.print(table)
    best = swept.best
    console.say(
        f"of the pairs that slow nobody down beyond {swept.trigger:g} m, λ = ({best.lambda1:.3g}, {best.lambda2:.3g}) "
        "loses the fewest boundary states of the worst capsule (no jerk keeps the index, or the index alone ends the "
        "approach too late); how often it intervenes is not weighed"
    )
