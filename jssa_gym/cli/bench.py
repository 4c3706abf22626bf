"""``jssa-gym bench``: speed, with what others need for the same beside it."""

import json
from dataclasses import dataclass
from typing import Annotated, Any

import gymnasium as gym

from jssa_gym.cli import stopwatch
from jssa_gym.cli.demo import paper_scene
from jssa_gym.cli.names import ROBOT
from jssa_gym.cli.progress import Bar
from jssa_gym.cli.stopwatch import Timing
from jssa_gym.cli.terminal import Terminal, table_of
from jssa_gym.evaluation.blocked import warning
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import DEFAULT
from jssa_gym.shields import JSSAShield
from jssa_gym.storage import as_json


@dataclass(frozen=True)
class Bench:
    """Time decisions, steps, projections and distances; medians and p99 from this one run.

    It takes about 20 s of one core, and up to two minutes more for compiling anew, which --no-compile leaves out.
    """

    rounds: int = 10
    """How often every scene of the recorded episode is timed."""
    robot: Annotated[str, ROBOT] = DEFAULT
    compile: bool = True
    """Also time the first use in a new process, with an empty and with a filled compile cache."""
    json: bool = False
    """Print JSON instead of a table."""

    def run(self) -> None:
        """Measure and print."""
        if self.rounds < 1:
            raise ParameterError(f"rounds has to be at least 1, got {self.rounds}")
        timings: list[Timing] = []
        first: tuple[float, float] | None = None
        with Bar(Terminal(stderr=True)) as progress:
            task = progress.add_task("recording an episode", total=7)

            def done(next_task: str) -> None:
                progress.update(task, advance=1, description=next_task)

            robot, dt, scenes = stopwatch.record_scenes(paper_scene(0.8), self.robot)
            done("decisions")
            timings += stopwatch.time_decisions(robot, dt, scenes, self.rounds)
            done("steps")
            scene: dict[str, Any] = {"human": paper_scene(0.8), "robot": self.robot, "terminate_on": ()}
            plain = lambda: gym.make("jssa_gym/Home-v0", **scene)  # noqa: E731
            steps = 1000 * self.rounds
            timings.append(stopwatch.time_steps(plain, "env.step", steps))
            for name, shield in (
                ("env.step, shielded, rows alone", lambda: JSSAShield(plain(), viability=False, failsafe=False)),
                ("env.step, shielded, all layers", lambda: JSSAShield(plain())),
            ):
                timings.append(stopwatch.time_steps(shield, name, steps))
            done("projections")
            timings += stopwatch.time_projectors(robot, dt, scenes, max(self.rounds // 5, 1))
            done("distances")
            timings += stopwatch.time_distances(robot, scenes, self.rounds)
            done("first use")
            if self.compile:
                first = stopwatch.time_first_use(self.robot)
            done("cbfpy, if it is installed")
            peer = stopwatch.cbfpy_report()
            done("")
        if missing := stopwatch.cbfpy_missing():
            Terminal(stderr=True).say(f"no times of CBFpy: {missing}")
        blocked = [timing for timing in timings if timing.blocked]
        for timing in blocked:
            Terminal(stderr=True).say(f"warning: {timing.name}: {warning(timing.blocked)}")
        self._show(timings, first, peer)
        if blocked:
            raise SystemExit(1)

    def _show(self, timings: list[Timing], first: tuple[float, float] | None, peer: str | None) -> None:
        if self.json:
            result: dict[str, Any] = {"timings": as_json(timings), "cbfpy": peer}
            if first:
                result["first_use"] = {"compiling": first[0], "cached": first[1]}
            print(json.dumps(result, indent=2))
            return
        table = table_of("", "median [µs]", "p99 [µs]", "per second", title="one core, one run")
        for t in timings:
            table.add_row(t.name, f"{t.median * 1e6:.1f}", f"{t.p99 * 1e6:.1f}", f"{1.0 / t.median:,.0f}")
        console = Terminal()
        console.print(table)
        if peer:
            for line in ("CBFpy on the same arm and pairs:", *peer.splitlines()):
                console.say(line)
        if first:
            console.say(
                f"a shielded environment and 100 steps in a new process: {first[0]:.1f} s compiling, "
                f"{first[1]:.2f} s cached"
            )
