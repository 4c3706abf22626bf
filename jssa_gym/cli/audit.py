"""``jssa-gym audit``: a robot's log beside people, judged by a shield."""

import json
import shlex
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from jssa_gym import plots
from jssa_gym.cli.evaluate import Separation
from jssa_gym.cli.files import writable_folder, write_figure
from jssa_gym.cli.names import FILTER, ROBOT
from jssa_gym.cli.terminal import Terminal, table_of
from jssa_gym.envs.arm import DT
from jssa_gym.evaluation.audit import Audit, audit, read_log, read_person
from jssa_gym.evaluation.audit.page import page, summary_line
from jssa_gym.evaluation.audit.result import write_safe_trajectory
from jssa_gym.robots import DEFAULT, make_robot
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.storage import write_json, write_whole
from jssa_gym.text import counted

_SHOWN = 10
"""Interventions that are told one by one."""


@dataclass(frozen=True)
class AuditLog:
    """Say what a shield would have made of a logged motion beside people: whether it intervenes, when, why, how long.

    The folder gets report.html, audit.json, audit.png and safe.csv, the motion with the shield. The exit code is 1 if
    the shield would have intervened. A log of a minute takes some seconds.
    """

    log: Annotated[Path, tyro.conf.Positional]
    """The robot's log: .csv (time, q1 ... qn in rad or with a unit, as in 'q1 [deg]'; maybe q1.velocity ...), .npz or
    .parquet."""
    people: tuple[Path, ...] = ()
    """Tracks of people, one file each: capsules or keypoints, .csv or .npz, or motion capture, .bvh; in metres, z up
    from the floor, the robot's base on the z axis, by the robot's clock."""
    robot: Annotated[str, ROBOT] = DEFAULT
    filter: Annotated[str, FILTER] = "jssa+stop"
    scene: Literal["table", "floor"] = "table"
    """Where the robot stands: on the environments' table, 0.87 m high, or on the floor."""
    position_error: float = 0.0
    """Largest error of the people's places [m]; keypoints that may be farther off are not believed."""
    human_speed: float = 1.6
    """No point of a person is faster [m/s], arms and feet aside."""
    shift: float = 0.0
    """Added to the people's clock to make it the robot's [s]."""
    body: Literal["six", "jointed"] = "jointed"
    """Capsules that are made of keypoints: the paper's six, or one for every bone."""
    dt: float = DT
    """Control step of the shield [s]."""
    out: Path | None = None
    """Folder for the results; by default the log's name with -audit behind."""
    figure: bool = True
    """Draw audit.png."""
    separation: Annotated[Separation, tyro.conf.arg(name="")] = field(default_factory=Separation)
    json: bool = False
    """Print JSON instead of a table."""

    def run(self) -> None:
        """Read, judge, write."""
        if self.figure:
            plots.require()
        assumed = FailsafeParams(human_speed=self.human_speed, position_error=self.position_error)
        robot = make_robot(self.robot)
        read_log(self.log, robot.n)  # before people take time
        people = [read_person(path, assumed, body=self.body, shift=self.shift) for path in self.people]
        found = audit(
            self.log,
            people,
            robot,
            filter=self.filter,
            assumed=assumed,
            scene=self.scene,
            dt=self.dt,
            separation=self.separation.params(),
        )
        out = self.log.with_name(f"{self.log.stem}-audit") if self.out is None else self.out
        writable_folder(out)
        write_whole(out / "report.html", page(found, shlex.join(["jssa-gym", *sys.argv[1:]])))
        write_json(out / "audit.json", found.as_dict())
        write_safe_trajectory(out / "safe.csv", found)
        written = ["report.html", "audit.json", "safe.csv"]
        if self.figure:
            write_figure(out / "audit.png", plots.audited(found.stretches, found.log))
            written.append("audit.png")
        if self.json:
            print(json.dumps(found.as_dict(), indent=2, allow_nan=False))
        else:
            _show(found)
        Terminal(stderr=True).say(f"wrote {', '.join(written)} to {out}")
        if found.interventions:
            raise SystemExit(1)


def _show(found: Audit) -> None:
    console = Terminal(width=120)
    console.say(summary_line(found))
    logged, safe = found.totals()
    title = f"{found.log} beside {', '.join(found.people) or 'nobody'}"
    table = table_of("", "as logged", "with the shield", title=title)
    for name, values in {
        "smallest distance [m]": [one["min_distance"] for one in (logged, safe)],
        "distance - S_p, smallest [m]": [one["ssm_margin"] for one in (logged, safe)],
        "time with distance < S_p [s]": [one["ssm_violation_time"] for one in (logged, safe)],
        "arm's speed then, nearest point [m/s]": [(one := found.closest(k)) and one.speed for k in (0, 1)],
        "fastest contact [m/s]": [one["contact_speed"] for one in (logged, safe)],
        "limits exceeded, share of steps": [one["limit_violation_rate"] for one in (logged, safe)],
        "behind the log at the end [s]": [0.0, found.lateness],
    }.items():
        table.add_row(name, *("-" if value is None else f"{value:.4g}" for value in values))
    console.print(table)
    for one in found.interventions[:_SHOWN]:
        console.say(
            f"  {one.start:.3f} s to {one.end:.3f} s, {one.status}, {one.distance:.3f} m from somebody as logged, "
            f"{one.slowed:.3f} s later: {one.reason}"
        )
    if (more := len(found.interventions) - _SHOWN) > 0:
        console.say(f"  and {counted(more, 'more intervention')}, in report.html")
    for gap in found.gaps:
        console.say(f"  a gap of {gap.of}: {gap.start:.3f} s to {gap.end:.3f} s")
    for stretch in found.stretches:
        if stretch.off > 0.0:
            console.say(
                f"  from {stretch.time[0]:.3f} s on the log exceeds the robot's limits; the shield was asked for a "
                f"motion within them, at most {stretch.off:.3g} rad from it"
            )
