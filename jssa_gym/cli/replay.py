"""``jssa-gym replay``: a recorded episode, drawn, judged by MuJoCo, played again."""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from jssa_gym import plots
from jssa_gym.cli.evaluate import find_policies_here
from jssa_gym.cli.files import writable_folder, write_figure
from jssa_gym.cli.film import require_film, save_film
from jssa_gym.cli.names import TRUST
from jssa_gym.cli.progress import Bar
from jssa_gym.cli.terminal import Terminal
from jssa_gym.evaluation.identity import code_version
from jssa_gym.evaluation.judge import judge
from jssa_gym.evaluation.judgement import Judgement
from jssa_gym.evaluation.play import played_again, recorded_setting
from jssa_gym.evaluation.rows import digest_of
from jssa_gym.evaluation.trace import load_trace, read_meta
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import ROBOTS, RobotModel, make_robot
from jssa_gym.text import counted
from jssa_gym.types import Trace


@dataclass(frozen=True)
class Replay:
    """Draw a recorded episode; with --verify have MuJoCo judge it, with --again play it anew and compare.

    The exit code is 1 if MuJoCo finds something else than the recording says, or the new episode differs in a bit. It
    takes some seconds, most of them for the film.
    """

    episode: Annotated[Path, tyro.conf.Positional]
    """Recording, as evaluate, compare and stress leave them."""
    out: Path | None = None
    """Folder for figure and film; by default the recording's name without its ending."""
    figure: bool = True
    """Draw distance, its derivatives, critical capsules and jerks."""
    video: bool = True
    """Also film it."""
    capsules: bool = False
    """Also draw the capsules, which are what is measured, in the film."""
    verify: bool = False
    """Judge it with MuJoCo's kinematics and distances, at 1 kHz."""
    again: bool = False
    """Play it anew from its seed and compare bit for bit."""
    policy: str | None = None
    """For --again: its policy, if that is a file or code, package.module:factory; nothing that a recording names is
    read or run unless it is repeated here."""
    human: str | None = None
    """For --again: its people, if they are a file."""
    trust_pickle: Annotated[bool, TRUST] = False
    robot: str | None = None
    """MJCF file or prepared folder of a robot that is not the package's own."""

    def run(self) -> None:
        """Read, judge, draw."""
        if self.video:
            require_film()
        elif self.figure:
            plots.require()
        trace, meta = load_trace(self.episode), read_meta(self.episode)
        robot = self._robot(trace)
        if self.again:
            recorded_setting(meta, self.policy, self.human)  # before anything is shown, or takes time
        console = Terminal()
        console.say(f"{trace.name}: {counted(len(trace.time), 'step')} of {trace.dt:g} s, {trace.ended}")
        console.say(f"recorded from {json.dumps(meta)}")
        agrees = True
        if self.verify:
            verdict = judge(trace, robot)
            agrees = verdict.same_course
            _tell(verdict, console)
        if self.again:
            find_policies_here([self.policy or ""])
            again = played_again(
                meta, policy=self.policy, robot=self.robot, human=self.human, trust_pickle=self.trust_pickle
            )
            same = _same(trace, again)
            agrees = agrees and same
            console.say(
                f"played again: {'the same bit for bit' if same else 'DIFFERENT'} (SHA-256 {digest_of(trace)[:16]})"
            )
            if not same:
                console.say(_made_by(meta))
        if self.figure or self.video:
            self._draw(trace, robot)
        if not agrees:
            raise SystemExit(1)

    def _robot(self, trace: Trace) -> RobotModel:
        if self.robot is None and trace.robot not in ROBOTS:  # nor is a file that a recording names
            raise ParameterError(f"the robot {trace.robot!r} is not the package's own; give its file as --robot")
        return make_robot(trace.robot if self.robot is None else self.robot).mounted(trace.mount)

    def _draw(self, trace: Trace, robot: RobotModel) -> None:
        out = self.episode.with_suffix("") if self.out is None else self.out
        writable_folder(out)
        console, written = Terminal(stderr=True), []
        with Bar(console) as progress:
            if self.figure:
                figure = plots.profile([trace], robot.limits, trace.d_min)
                write_figure(out / "profile.png", figure)
                written.append(out / "profile.png")
            if self.video:
                save_film(out / "episode.mp4", [trace], robot, progress, capsules=self.capsules)
                written.append(out / "episode.mp4")
        console.say(f"wrote {', '.join(map(str, written))}")


def _tell(verdict: Judgement, console: Terminal) -> None:
    word = "agrees" if verdict.same_course else "DISAGREES"
    console.say(
        f"MuJoCo {word} at {verdict.samples} moments: smallest distance {verdict.distance:.4g} m, "
        f"{counted(len(verdict.contacts), 'contact')}, {sum(contact.moving for contact in verdict.contacts)} of them "
        f"with the arm moving, {counted(len(verdict.self_collisions), 'self-collision')}, "
        f"{len(verdict.plane_collisions)} with table or floor"
    )
    console.say(
        f"largest disagreements: distance {verdict.distance_error:.1e} m, contact at {verdict.contact_error} steps, "
        f"joint state {verdict.state_error:.1e} of the limits; contact speed {verdict.speed_error:.1e} m/s, which "
        "counts for nothing where capsules are deep inside each other"
    )
    for contact in verdict.contacts[:10]:
        console.say(
            f"  {contact.start:.3f} s to {contact.end:.3f} s: {contact.one} and {contact.other}, {contact.depth:.3g} m "
            f"deep, arm at {contact.speed:.3g} m/s, fault: {contact.fault}"
        )


def _made_by(meta: Mapping[str, Any]) -> str:
    """Whether a difference may come from the code."""
    made, here = {name: meta.get(name) for name in ("version", "source")}, code_version()
    if None in made.values():
        return "the recording does not say which version of the code made it: another one may be why"
    if made == here:
        return "the same version of the code made the recording"
    told = " and ".join(f"version {code['version']} (source {code['source']})" for code in (made, here))
    return f"the recording was made by another version of the code, which may be why: {told} now"


def _same(one: Trace, other: Trace) -> bool:
    """Whether two recordings have the same bits in everything but decision times."""

    def bits(value: Any) -> Any:
        return (value.dtype, value.shape, value.tobytes()) if hasattr(value, "tobytes") else value

    names = [field.name for field in dataclasses.fields(Trace) if field.name not in ("name", "shield_time")]
    return all(bits(getattr(one, name)) == bits(getattr(other, name)) for name in names)
