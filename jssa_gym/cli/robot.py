"""``jssa-gym robot``: anybody's arm file, looked at, prepared and proved."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from jssa_gym import plots
from jssa_gym.cli.certify import Certify
from jssa_gym.cli.files import writable_folder, write_picture
from jssa_gym.cli.progress import Bar
from jssa_gym.cli.terminal import Terminal, table_of
from jssa_gym.envs.drawing import Marks
from jssa_gym.envs.opengl import check_opengl
from jssa_gym.envs.world import SCENES, World
from jssa_gym.evaluation.proof import Proof, prove
from jssa_gym.exceptions import DisplayError, MissingExtraError, ParameterError
from jssa_gym.humans import nobody
from jssa_gym.robots import MENAGERIE, ROBOTS, RobotModel, guessed_limits, make_robot
from jssa_gym.robots.prepare import Cover, Examination, Preparation, examine, write_prepared
from jssa_gym.storage import as_json


@dataclass(frozen=True)
class _Decided(Preparation):
    """What is decided about a file by options of these names; its packages come from ``--package``."""

    packages: Annotated[Mapping[str, Path], tyro.conf.Suppress] = field(default_factory=dict)


@dataclass(frozen=True)
class Check:
    """Look at an arm's file, MJCF or URDF: say all at once what is in the way, prepare it, prove it.

    Without --write the exit code is 1 if anything has to be decided or prepared before the file can be used; with it,
    if anything has to be decided, or if the proof fails.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """MJCF or URDF."""
    package: tuple[str, ...] = ()
    """NAME=DIR of the packages that a URDF names; those in and beside the file's folders are found without."""
    preparation: Annotated[_Decided, tyro.conf.arg(name="")] = field(default_factory=_Decided)
    write: Path | None = None
    """Folder for the prepared model, for `--robot FOLDER`."""
    prove: bool = True
    """Prove what was written: motion against MuJoCo, shielded episodes, a picture."""
    certify: bool = False
    """Also look for states in which the index cannot be kept (`jssa-gym certify`)."""
    json: bool = False
    """Print JSON instead of tables."""

    def run(self) -> None:
        """Read, say, write, prove."""
        preparation = replace(self.preparation, packages=_packages(self.package))
        console = Terminal(stderr=True)
        with Bar(console) as progress:
            progress.add_task(f"examining {self.file.name}", total=None)
            arm = examine(self.file, preparation)
        proof = None
        if self.write is not None and not arm.obstacles:
            # a new folder appears when all of it is there
            writable_folder(self.write if self.write.exists() else self.write.parent)
            write_prepared(arm, self.write)
            if self.prove:
                with Bar(console) as progress:
                    progress.add_task("proving it", total=None)
                    proof = prove(arm, make_robot(self.write))
        if self.json:
            print(json.dumps(_plain(arm, proof), indent=2, allow_nan=False))
        else:
            _show(arm, self.write is not None)
            if proof is not None:
                _show_proof(proof)
        if self.write is not None and not arm.obstacles:
            self._draw(make_robot(self.write), console)
            console.say(f"wrote {self.write}; use it as --robot {self.write}")
            if self.certify:
                Certify(robot=str(self.write), out=self.write / "certificate").run()
        failed = proof is not None and not proof.holds
        if arm.obstacles or failed or (self.write is None and not arm.acceptable):
            raise SystemExit(1)

    def _draw(self, robot: RobotModel, console: Terminal) -> None:
        assert self.write is not None
        try:
            plots.require()
            check_opengl()
        except (DisplayError, MissingExtraError) as error:
            console.say(f"no picture: {error}")
            return
        write_picture(self.write / "robot.png", _picture(robot))


@dataclass(frozen=True)
class List:
    """Arms by name, for --robot and `robot=`."""

    json: bool = False
    """Print JSON instead of lines."""

    def run(self) -> None:
        """Print names."""
        guessed = {name: guessed_limits(name) for name in sorted((*ROBOTS, *MENAGERIE))}
        if self.json:
            print(json.dumps({"shipped": sorted(ROBOTS), "menagerie": sorted(MENAGERIE), "limits_guessed": guessed}))
            return
        console = Terminal()
        console.say(f"shipped: {', '.join(sorted(ROBOTS))}")
        console.say(f"of MuJoCo Menagerie, downloaded at the first use (extra robots): {', '.join(sorted(MENAGERIE))}")
        for which in dict.fromkeys(sorted(filter(None, guessed.values()), key=len)):
            names = [name for name, limits in guessed.items() if limits == which]
            console.say(f"{', '.join(which)} limits are a guess: {', '.join(names)}")


@dataclass(frozen=True)
class RobotCommand:
    """Arms: of one's own, and by name."""

    action: Annotated[
        Annotated[Check, tyro.conf.subcommand("check")] | Annotated[List, tyro.conf.subcommand("list")],
        tyro.conf.arg(name=""),
    ]

    def run(self) -> None:
        """Run the chosen action."""
        self.action.run()


def _packages(given: Sequence[str]) -> dict[str, Path]:
    packages = {}
    for one in given:
        name, sign, folder = one.partition("=")
        if not (name and sign and Path(folder).is_dir()):
            raise ParameterError(f"--package takes NAME=DIR with a folder that is there, got {one!r}")
        packages[name] = Path(folder)
    return packages


def _picture(robot: RobotModel) -> Any:
    """The arm at home, its capsules over what it draws."""
    world = World(robot.mounted((0.0, 0.0, SCENES["table"])), "table", pretty=True, width=720, height=720)
    reach = float(np.linalg.norm(robot.links["offset"], axis=1).sum())
    world.camera.distance = 0.9 + 1.4 * reach
    world.camera.lookat[:] = (0.2 * reach, 0.0, SCENES["table"] + 0.35 * reach)
    world.camera.azimuth, world.camera.elevation = 130.0, -15.0
    try:
        return world.picture(np.array(robot.home), nobody(), Marks(capsules=True))
    finally:
        world.close()


# ---- what is said --------------------------------------------------------------------------------------


def _plain(arm: Examination, proof: Proof | None) -> dict[str, Any]:
    told = {
        "file": arm.source.path,
        "joints": arm.anatomy.joints,
        "frozen": [arm.source.model.joint(j).name for j in arm.chain.frozen],
        "reach": arm.anatomy.reach,
        "home": arm.home,
        "limits_guessed": arm.limits.guessed,
        "findings": [{**as_json(one), "message": str(one)} for one in arm.findings],
        "links": [
            {
                "joint": cover.joint,
                "body": cover.body,
                "capsules_found": len(cover.found),
                "outside_own_mm": _millimetres(cover.own),
                "outside_all_mm": _millimetres(cover.arm),
                "capsules": len(cover.capsules),
                "outside_prepared_mm": _millimetres(max(cover.left, 0.0)),
                "volume_ratios": [round(ratio, 3) for ratio in cover.ratios],
                "volume_ratio_of_one": round(cover.alone, 3),
            }
            for cover in arm.covers
        ],
        "acceptable": arm.acceptable,
        "proof": proof and {**as_json(proof), "holds": proof.holds},
    }
    return as_json(told)


def _millimetres(metres: float) -> float:
    return round(1e3 * metres, 2)


def _show(arm: Examination, written: bool) -> None:
    console = Terminal(width=160)
    for finding in arm.findings:
        mark = "!" if finding.stands else "-" if not finding.fits else " "
        console.say(f"{mark} {finding}")
    title = f"{arm.source.path.name}: {arm.anatomy.n} joints, reach {arm.anatomy.reach:.2f} m"
    found, made = ("capsules found", "outside of own", "of all"), ("capsules", "outside of these", "of hull")
    table = table_of("link", "joint", *found, *made, left=2, title=title)
    for cover in arm.covers:
        table.add_row(cover.body, cover.joint, str(len(cover.found)), *_row(cover))
    console.print(table)
    console.say("of hull: volume of each new capsule over that of the convex hull of what it holds")
    if arm.obstacles:
        console.say("what is marked with ! has to be decided; no model is written before")
    elif not written and not arm.acceptable:
        console.say("what is marked with - keeps the file itself from being used; --write DIR makes a model without it")


def _row(cover: Cover) -> tuple[str, ...]:
    def said(value: float) -> str:
        return "-" if not np.isfinite(value) else f"{1e3 * max(value, 0.0):.1f} mm"

    wasted = ", ".join(f"×{ratio:.1f}" for ratio in cover.ratios) or "-"
    return said(cover.own), said(cover.arm), str(len(cover.capsules)), said(cover.left), wasted


def _show_proof(proof: Proof) -> None:
    console = Terminal(width=120)
    titles = ("capsule", "moved by", "reach", "largest jerk of its far end")
    parts = table_of(*titles, left=2, title="reach and authority over random postures")
    for part in proof.parts:
        parts.add_row(part.name, part.joint, f"{part.reach:.2f} m", f"{part.authority:.0f} m/s³")
    console.print(parts)
    titles = ("policy", "moving contacts", "limit violations", "collisions", "MuJoCo agrees", "joints travelled")
    about = "shielded episodes beside a person who goes for the arm, judged by MuJoCo at 1 kHz"
    played = table_of(*titles, title=about)
    for one in proof.episodes:
        counts = (one.moving_contacts, one.limit_violations, one.collisions)
        agrees = "yes" if one.agrees else "no"
        played.add_row(one.policy, *map(str, counts), agrees, f"{one.travelled:.1f} rad")
    console.print(played)
    console.say(
        f"joints and axes are within {proof.kinematic_error:.1e} m of MuJoCo's on the file; what links draw is within "
        f"{1e3 * proof.uncovered:.2f} mm of their capsules"
    )
