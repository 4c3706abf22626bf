"""``jssa-gym recording``: recorded people, looked at and converted."""

import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from jssa_gym.cli.terminal import Terminal, table_of
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.bvh import JOINTS, UNITS, CaptureOptions
from jssa_gym.humans.files import Person, load
from jssa_gym.humans.survey import height_of, lowest_of
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.speeds import PartSpeed, legs_of_feet, part_speeds, sufficient, time_beyond
from jssa_gym.storage import as_json
from jssa_gym.text import counted
from jssa_gym.validation import positive_number

_OUTSIDE = 0.05
"""How far a joint may be outside of the capsules without a word [m]."""


@dataclass(frozen=True)
class Capture:
    """How motion capture, .bvh, is read."""

    scale: str = "auto"
    """Unit of the file: m, cm, mm, in, cmu (1/0.45 in), or metres in a unit; auto: told from the skeleton."""
    up: Literal["auto", "y", "z"] = "auto"
    """The file's upward axis; auto: the one along which the head is above the feet."""
    frames: str | None = None
    """A:B, the frames from A, counted from 0, up to but without B; either may be left out. Without it, a pose for
    calibration at the beginning is left out."""
    body: Literal["six", "jointed"] = "six"
    """The paper's six capsules, or one for every bone of arms and legs."""

    def load(self, file: Path) -> Person:
        """What is in a file.

        Raises:
            ParameterError: An option is out of range or unknown, or is for motion capture and the file is none.
            RecordingError: The file is not sound.
        """
        if file.suffix.casefold() != ".bvh" and self == Capture():
            return load(file)
        return load(file, CaptureOptions(_scale(self.scale), self.up, frames=_frames(self.frames), body=self.body))


@dataclass(frozen=True)
class CheckRecording:
    """Look at a recorded person, .npz, .csv or .bvh: say what is in it, and what to change before it is played.

    The exit code is 1 if anything is to be changed, or moves faster than a shield assumes by default.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Recording or motion capture."""
    capture: Annotated[Capture, tyro.conf.arg(name="")] = field(default_factory=Capture)
    json: bool = False
    """Print JSON instead of a table."""

    def run(self) -> None:
        """Read, say."""
        person = self.capture.load(self.file)
        params = FailsafeParams()
        parts, findings = part_speeds(person.recording, params), person.findings()
        outside = _outside(person)
        if self.json:
            print(json.dumps(_plain(person, parts, params), indent=2, allow_nan=False))
        else:
            _show(self.file.name, person, parts, params)
        if findings or outside or any(part.excess > 0.0 for part in parts):
            raise SystemExit(1)


@dataclass(frozen=True)
class ConvertRecording:
    """Write what was read from a recorded person, .csv or .bvh, as an .npz file, which says all for itself."""

    file: Annotated[Path, tyro.conf.Positional]
    """Recording or motion capture."""
    out: Annotated[Path, tyro.conf.Positional]
    """The .npz file to write."""
    capture: Annotated[Capture, tyro.conf.arg(name="")] = field(default_factory=Capture)
    pace: float = 1.0
    """How fast it is to be; 0.5 takes twice the time, at half the speed."""

    def run(self) -> None:
        """Read, write."""
        pace = positive_number("pace", self.pace)
        person = self.capture.load(self.file)
        replace(person.recording, time=person.recording.time / pace).save(self.out)
        console = Terminal(stderr=True)
        if person.conversion is not None:
            console.say(person.conversion.said)
        for finding in person.findings():
            console.say(f"warning: {finding}")
        console.say(f"wrote {self.out}; use it as --human {self.out}")


@dataclass(frozen=True)
class RecordingCommand:
    """Recorded people: looked at, and converted."""

    action: Annotated[
        Annotated[CheckRecording, tyro.conf.subcommand("check")]
        | Annotated[ConvertRecording, tyro.conf.subcommand("convert")],
        tyro.conf.arg(name=""),
    ]

    def run(self) -> None:
        """Run the chosen action."""
        self.action.run()


def _scale(scale: str) -> float | str:
    """A unit, or metres in one."""
    if scale in ("auto", *UNITS):
        return scale
    try:
        return float(scale)
    except ValueError:
        raise ParameterError(f"scale has to be auto, {', '.join(UNITS)}, or metres in a unit, got {scale!r}") from None


def _frames(frames: str | None) -> tuple[int | None, int | None] | None:
    if frames is None:
        return None
    first, colon, last = frames.partition(":")
    if not colon or not all(one == "" or (one.isascii() and one.isdigit()) for one in (first, last)):
        raise ParameterError(f"frames has to be A:B, such as 30:400, 30: or :400, got {frames!r}")
    return (int(first) if first else None, int(last) if last else None)


def _outside(person: Person) -> dict[str, float]:
    """Joints and end sites that are too far outside of the capsules to go without a word [m], farthest first."""
    if person.conversion is None:
        return {}
    found = {name: far for name, far in person.conversion.outside().items() if far > _OUTSIDE}
    return dict(sorted(found.items(), key=lambda one: -one[1]))


def _head(person: Person) -> float | None:
    """Height of the head in the median of the samples [m]."""
    recording = person.recording
    for i, name in enumerate(recording.names):
        if "head" in name.casefold():
            return float(np.median(recording.start[:, i, 2]))
    return None


def _advice(person: Person, parts: list[PartSpeed], params: FailsafeParams) -> list[str]:
    """What to change, most of it in so many words."""
    said = [str(finding) for finding in person.findings()]
    fast = [part for part in parts if part.excess > 0.0]
    if fast:
        legs = legs_of_feet(person.recording, params)
        beside = sufficient([part for part in parts if part.name not in legs], params)
        raised = ", ".join(
            ["end_speeds=LEG_SPEEDS"][: len(legs)] + [f"{name}={bound:g}" for name, bound in beside.items()]
        )
        feet = " (jssa_gym.safety.failsafe has LEG_SPEEDS: hips walk, feet swing)" if legs else ""
        worst = max(part.speed / part.bound for part in fast)
        said.append(
            f"{', '.join(part.name for part in fast)}: faster than a shield assumes, in "
            f"{100.0 * time_beyond(person.recording, params):.0f} % of the time; it does not believe such measurements "
            f"and stays stopped meanwhile (FAULT). Give it failsafe=FailsafeParams({raised}){feet}, or play "
            f"it as Recorded(FILE, pace={math.floor(100.0 / worst) / 100.0:g})"
        )
    if outside := _outside(person):
        named = ", ".join(f"{name} {far:.2f} m" for name, far in list(outside.items())[:6])
        more = f", and {len(outside) - 6} more" if len(outside) > 6 else ""
        cure = "; --body jointed has more capsules" if len(person.recording.names) == len(JOINTS) else ""
        said.append(f"outside of all capsules by up to: {named}{more}{cure}")
    return said


def _show(name: str, person: Person, parts: list[PartSpeed], params: FailsafeParams) -> None:
    console, recording, head = Terminal(), person.recording, _head(person)
    samples, noun = len(recording.time), "frame" if person.conversion is not None else "sample"
    console.say(
        f"{name}: {counted(samples, noun)} in {recording.duration:.2f} s, {(samples - 1) / recording.duration:.4g} a "
        f"second; {counted(len(recording.names), 'capsule')}"
    )
    if person.conversion is not None:
        console.say(person.conversion.said)
    said = "" if head is None else f"head {head:.2f} m above the floor, "
    console.say(
        f"{said}what is lowest {lowest_of(recording):.2f} m; {height_of(recording):.2f} m from there to the top of the "
        "highest capsule, in most samples"
    )
    table = table_of("", "fastest [m/s]", "at [s]", "bound [m/s]", "beyond it")
    for part in parts:
        beyond = f"{100.0 * part.beyond:.0f} % of the time" if part.excess > 0.0 else "-"
        table.add_row(part.name, f"{part.speed:.2f}", f"{part.time:.2f}", f"{part.bound:g}", beyond)
    console.print(table)
    advice = _advice(person, parts, params)
    for line in advice:
        console.say(f"- {line}")
    if not advice:
        console.say("nothing to change")


def _plain(person: Person, parts: list[PartSpeed], params: FailsafeParams) -> dict[str, Any]:
    recording, made = person.recording, person.conversion
    return {
        "samples": len(recording.time),
        "duration": recording.duration,
        "head": _head(person),
        "lowest": lowest_of(recording),
        "height": height_of(recording),
        "read_as": None
        if made is None
        else {"unit": made.unit, "up": made.up, "first_frame": made.first, "dropped": made.dropped},
        "parts": as_json(parts),
        "beyond": time_beyond(recording, params),
        "sufficient": sufficient(parts, params),
        "legs_of_feet": as_json(legs_of_feet(recording, params)),
        "outside": _outside(person),
        "findings": as_json(person.findings()),
    }
