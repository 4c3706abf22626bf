"""What is wrong with the scenes that an environment shows: fields, clock, people."""

from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.people import CLAIMS_MOTION, STAMP_ROUNDING
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.parts import FOOT_PARTS, LIMB_PARTS, SLOW_PARTS, is_called
from jssa_gym.types import Array, CapsuleSet, JointState, Planes, Scene

_CLOCK = 1e-6
"""Share of a control step by which the clock may be off."""

_LENGTH = 1e-6
"""Rounding of lengths, as a monitor of people forgives it [m]."""

_UNIT = 1e-6
"""By how much the square of a normal's length may differ from 1."""

_MOVES = 0.1
"""Speed from which it is looked at whether a velocity is right [m/s]."""


class Trouble(NamedTuple):
    """Something wrong with a scene."""

    name: str
    severity: Literal["error", "warning"]
    what: str
    """The field or body part: the same trouble of the same part is told once."""
    message: str


_BLINDING = ("scene", "fields", "masked", "time", "names")
"""Troubles after which a scene cannot be compared with others."""

_PARTS = {"robot": JointState, "human": CapsuleSet, "static": CapsuleSet, "planes": Planes}


def leaves(scene: Any) -> Iterator[tuple[str, Any]]:
    """Every value of a scene with its dotted name.

    Raises:
        AttributeError: There is no such field.
    """
    for field in Scene._fields:
        value = getattr(scene, field)
        if field in _PARTS:
            for name in _PARTS[field]._fields:
                yield f"{field}.{name}", getattr(value, name)
        else:
            yield field, value


def scene_troubles(scenes: Sequence[Any], robot: RobotModel, dt: float, params: FailsafeParams) -> Iterator[Trouble]:
    """All that is wrong with the scenes of successive ticks."""
    sound: list[Scene] = []
    for k, scene in enumerate(scenes):
        try:
            found = list(_fields(scene, robot, params.tolerance_of(robot)))
        except AttributeError as error:
            found = [Trouble("scene", "error", "", f"scene has to be a Scene with all its fields: {error}")]
        yield from (one._replace(message=f"{one.message} (tick {k})") for one in found)
        if any(one.name in _BLINDING for one in found):
            break
        sound.append(scene)
    yield from _clock(sound, dt)
    yield from _constant(sound)
    yield from _names(sound, params)
    yield from _ages(sound, params)
    yield from _people(sound, params)


# ---- fields of one scene -------------------------------------------------------------------------------


def _array(name: str, value: Any, shape: tuple[int, ...], kinds: str = "f") -> Trouble | None:
    """What is wrong with an array; ``kinds`` are numpy's letters of what it may hold."""
    said = f"scene.{name}"
    if isinstance(value, np.ma.MaskedArray):
        text = f"{said} is a masked array, whose masked values would count: set valid to False instead"
        return Trouble("masked", "error", name, text)
    if not isinstance(value, np.ndarray):
        return Trouble("fields", "error", name, f"{said} has to be a numpy array, got {type(value).__name__}")
    if value.shape != shape:
        return Trouble("fields", "error", name, f"{said} has to have the shape {shape}, got {value.shape}")
    if value.dtype.kind not in kinds:
        wanted = {"f": "float64", "iu": "of integers", "b": "of bool"}[kinds]
        return Trouble("fields", "error", name, f"{said} has to be {wanted}, got {value.dtype}")
    return None


def _fields(scene: Any, robot: RobotModel, tolerance: Array) -> Iterator[Trouble]:
    """What is wrong with a scene's fields; ``tolerance`` (3, n) is inf for what is not measured of the joints."""
    values = dict(leaves(scene))
    time = values["time"]
    if isinstance(time, bool) or not isinstance(time, int | float | np.floating | np.integer) or not np.isfinite(time):
        yield Trouble("time", "error", "time", f"scene.time has to be a finite number of seconds, got {time!r}")
    m, parts = len(values["human.names"]), len(values["static.names"])
    p = len(values["planes.names"])
    shapes = {
        **{f"robot.{name}": (robot.n,) for name in JointState._fields},
        **{f"human.{name}": (m, 3) for name in CapsuleSet._fields[:4]},
        **{f"static.{name}": (parts, 3) for name in CapsuleSet._fields[:4]},
        "human.radius": (m,),
        "static.radius": (parts,),
        "planes.normal": (p, 3),
        "planes.offset": (p,),
        "age": (m,),
    }
    kinds = {"human.person": ((m,), "iu"), "static.person": ((parts,), "iu"), "valid": ((m,), "b")}
    wrong = [
        trouble
        for name, (shape, kind) in {**{name: (shape, "f") for name, shape in shapes.items()}, **kinds}.items()
        if (trouble := _array(name, values[name], shape, kind))
    ]
    yield from wrong
    if wrong:
        return
    for name in shapes:
        if values[name].dtype != np.float64:
            if name.startswith("robot"):
                if np.all(tolerance > 0.0):
                    continue
                text = f"scene.{name} has to be float64, got {values[name].dtype}: rounding adds up"
                yield Trouble("float32", "error", "robot", text)
            else:
                text = f"scene.{name} is {values[name].dtype}: its rounding belongs into position_error"
                yield Trouble("precision", "warning", name.split(".")[0], text)
    valid, age = values["valid"], values["age"]
    for name in shapes:
        measured = values[name][valid] if name.startswith("human") else values[name]
        if name.startswith("robot"):
            measured = measured[tolerance[JointState._fields.index(name.removeprefix("robot."))] < np.inf]
        if name != "age" and not np.all(np.isfinite(measured)):
            also = " where valid" if name.startswith("human") else ""
            yield Trouble("fields", "error", name, f"scene.{name} has to be finite{also}, got {values[name]}")
    if not np.all(age[valid] >= 0.0) or not np.all(np.isfinite(age[valid])):
        text = f"scene.age has to be the time since each capsule was measured, finite and at least 0; got {age}"
        yield Trouble("age", "error", "age", text)
    if not np.all(valid):
        lost = ", ".join(str(name) for name, known in zip(values["human.names"], valid, strict=True) if not known)
        yield Trouble("valid", "warning", "valid", f"not measured, a fault if it lasts: {lost}")
    for part in ("human", "static"):
        if not np.all(values[f"{part}.radius"] > 0.0):
            text = f"scene.{part}.radius has to be above 0, got {values[f'{part}.radius']}"
            yield Trouble("radius", "error", part, text)
    normal = values["planes.normal"]
    if not np.all(np.abs((normal**2).sum(axis=1) - 1.0) < _UNIT):
        text = f"scene.planes.normal has to be unit vectors out of the solid, got {normal.tolist()}"
        yield Trouble("planes", "error", "normal", text)
    for part in ("human", "static", "planes"):
        if not all(isinstance(name, str) for name in values[f"{part}.names"]):
            text = f"scene.{part}.names has to hold a string a member, got {values[f'{part}.names']!r}"
            yield Trouble("names", "error", part, text)


# ---- scenes of an episode ------------------------------------------------------------------------------


def _clock(scenes: Sequence[Scene], dt: float) -> Iterator[Trouble]:
    steps = np.diff([float(scene.time) for scene in scenes])
    off = np.flatnonzero(~(np.abs(steps - dt) <= _CLOCK * dt))
    if len(off):
        said = (
            "stands still" if not steps.any() else f"advances by {steps[off[0]]:.6g} s from tick {off[0]} to the next"
        )
        yield Trouble("time", "error", "", f"scene.time {said}: it has to advance by dt, {dt:g} s, in every step")


def _constant(scenes: Sequence[Scene]) -> Iterator[Trouble]:
    """What has to stay as it is for an episode: who is there, and what stands still."""
    for k, scene in enumerate(scenes):
        for (name, value), (_, first) in zip(leaves(scene), leaves(scenes[0]), strict=True):
            if name.startswith(("static", "planes")) or name in ("human.names", "human.person"):
                same = tuple(value) == tuple(first) if name.endswith("names") else np.array_equal(value, first)
                if not same:
                    text = f"scene.{name} has to stay as it was at reset, it changes at tick {k}"
                    yield Trouble("constant", "error", name, text)


def _names(scenes: Sequence[Scene], params: FailsafeParams) -> Iterator[Trouble]:
    if not scenes:
        return
    people = scenes[0].human
    known = (*SLOW_PARTS, *LIMB_PARTS, *FOOT_PARTS)
    unknown = [name for name in dict.fromkeys(people.names) if not is_called(name, known)]
    if unknown:
        text = (
            f"{', '.join(map(repr, unknown))}: no body part that is known by name, so it may move as fast as a limb, "
            f"{params.speed_of(unknown[0]):g} m/s"
        )
        yield Trouble("names", "warning", "unknown", text)
    twice = [name for name, who in _counted(zip(people.names, people.person.tolist(), strict=True)) if who > 1]
    if twice:
        text = f"{', '.join(map(repr, twice))}: a person has several capsules of that name; messages cannot tell which"
        yield Trouble("names", "warning", "twice", text)


def _counted(pairs: Any) -> list[tuple[str, int]]:
    counts: dict[Any, int] = {}
    for pair in pairs:
        counts[pair] = counts.get(pair, 0) + 1
    return [(name, count) for (name, _), count in counts.items()]


def _ages(scenes: Sequence[Scene], params: FailsafeParams) -> Iterator[Trouble]:
    """Whether measurements are young enough to be used."""
    ages = [age[np.isfinite(age)].max() for s in scenes if np.any(np.isfinite(age := s.age[s.valid]))]
    old = np.array(ages) > params.max_age + STAMP_ROUNDING
    if not np.any(old):
        return
    lasting = np.count_nonzero(old) * 2 > len(old)
    yield Trouble(
        "age",
        "error" if lasting else "warning",
        "max_age",
        f"people's measurements are older than max_age, {params.max_age:g} s, at {np.count_nonzero(old)} of "
        f"{len(old)} ticks, up to {max(ages):.3g} s: the shield stands still{'' if lasting else ' meanwhile'}; measure "
        "them sooner or, if people keep their speed bounds, allow more by FailsafeParams(max_age=...)",
    )


def _people(scenes: Sequence[Scene], params: FailsafeParams) -> Iterator[Trouble]:
    """Whether people keep their speed bounds, and move as they say."""
    if len(scenes) < 2 or any(len(scene.human.names) != len(scenes[0].human.names) for scene in scenes):
        return
    ends = np.array([[s.human.start, s.human.end] for s in scenes], np.float64)  # (T, 2, m, 3)
    told = np.array([[s.human.start_velocity, s.human.end_velocity] for s in scenes], np.float64)
    radius = np.array([s.human.radius for s in scenes], np.float64)
    with np.errstate(invalid="ignore"):  # of what was never measured
        stamps = np.array([np.where(s.valid, s.time - s.age, np.nan) for s in scenes])  # (T, m)
        frozen = _repeated(ends, told) & (np.diff(stamps, axis=0) > STAMP_ROUNDING)  # (T - 1, m)
        for k, again in enumerate(frozen):
            # the same sample again is as old as when it came first
            stamps[k + 1, again] = stamps[k, again]
        between = np.diff(stamps, axis=0)
        # where nothing new was measured there is nothing to compare
        between = np.where(between > STAMP_ROUNDING, between, np.nan)
        moved = np.diff(ends, axis=0) / between[:, None, :, None]
        way = np.linalg.norm(np.diff(ends, axis=0), axis=-1) + np.abs(np.diff(radius, axis=0))[:, None]
        # of starts and ends, shape (T - 1, 2, m)
        speed = np.nan_to_num(np.maximum(way - _LENGTH - 2.0 * params.position_error, 0.0) / between[:, None])
    if np.any(frozen):
        yield _hanging(scenes[0].human.names, frozen, told[:-1])
    for j, name in enumerate(scenes[0].human.names):
        bounds = np.array(params.end_speeds_of(name))
        too_fast = speed[:, :, j] > bounds * (1.0 + 1e-9)
        fast = too_fast.any(axis=1)
        if np.any(fast):
            k = int((speed[:, :, j].max(axis=0) / bounds).argmax())
            which = name if bounds[0] == bounds[1] else f"the {('start', 'end')[k]} of {name}"
            yield Trouble(
                "speed",
                "error",
                name,
                f"{which} moves at {speed[:, k, j].max():.3g} m/s, first from tick {int(fast.argmax())} to the next; "
                f"its bound is {bounds[k]:g} m/s: nobody may be faster than FailsafeParams says",
            )
        if params.position_error == 0.0:
            yield from _velocity(name, moved[~fast, :, j], told[:-1][~fast, :, j], told[1:][~fast, :, j])


def _repeated(ends: Array, told: Array) -> NDArray[np.bool_]:
    """Whether each sample is bit for bit the one before although that one claimed to move, shape (T - 1, m)."""
    same = [np.all(values[1:] == values[:-1], axis=(1, 3)) for values in (ends, told)]
    return same[0] & same[1] & (np.linalg.norm(told[:-1], axis=-1).max(axis=1) > CLAIMS_MOTION)


def _hanging(names: Sequence[str], frozen: NDArray[np.bool_], told: Array) -> Trouble:
    """Samples that came again as if they were new, shape (k, m), and what they said, shape (k, 2, m, 3) [m/s]."""
    ticks, capsules = np.nonzero(frozen)
    who = ", ".join(dict.fromkeys(names[j] for j in np.unique(capsules)))
    speed = np.linalg.norm(told, axis=-1).max(axis=1)[frozen].max()
    return Trouble(
        "frozen",
        "error",
        "human",
        f"{who} said to move, at up to {speed:.3g} m/s, and the same again at {len(np.unique(ticks))} of {len(frozen)} "
        f"ticks, first from tick {ticks[0]} to the next, as if measured anew: the shield takes them as frozen; let age "
        "grow until there is a new measurement",
    )


def _velocity(name: str, moved: Array, before: Array, after: Array) -> Iterator[Trouble]:
    """Compare how a capsule's ends moved with their velocities before and after, shape (k, 2, 3) [m/s] each."""
    real = np.linalg.norm(moved, axis=-1)
    said = np.minimum(*(np.linalg.norm(told, axis=-1) for told in (before, after)))
    moving = np.maximum(real, said) > _MOVES  # NaN, of what was not measured anew, is not
    # a velocity may be that of the step before or of the one to come, and change meanwhile
    off = np.minimum(*(np.linalg.norm(moved - told, axis=-1) for told in (before, after)))
    wrong = moving & (off > _MOVES + 0.25 * real)
    if np.count_nonzero(wrong) * 2 <= np.count_nonzero(moving):
        return
    if not before.any():
        text = f"{name} moves and has a velocity of 0: a frozen source cannot be told from somebody who stands still"
        yield Trouble("velocities", "warning", name, text)
        return
    k, end = np.argwhere(wrong)[0]
    yield Trouble(
        "velocities",
        "error",
        name,
        f"{name} moves by {np.round(moved[k, end], 3).tolist()} m/s and is said to by "
        f"{np.round(before[k, end], 3).tolist()}: velocities are those of the capsules' ends, in the world [m/s]",
    )
