"""What a perception system delivers, whatever it is, taken down where the control step reads it.

Kernels look neither at shapes nor at types: everything is compared before they see it, and nothing that is delivered
makes a :class:`Reading` raise.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.records import AGENT, PLANE, records
from jssa_gym.kernels.verification import CHANGED_PLANES, CHANGED_STATICS, load_fixtures
from jssa_gym.safety.proximity import check_capsules, checked_array, checked_capsules
from jssa_gym.shields.association import Association
from jssa_gym.shields.reasons import FIXTURES
from jssa_gym.shields.records import Records, View
from jssa_gym.shields.shapes import fit_together, unlike
from jssa_gym.tick.assumed import Assumed, assume
from jssa_gym.types import Array, CapsuleSet, Planes, Scene

_FLOAT64, _INT64, _BOOL = np.dtype(np.float64), np.dtype(np.int64), np.dtype(np.bool_)


def part_of(scene: Any, name: str) -> tuple[Any, str]:
    """A part of a scene, or None and why it cannot be had: whatever a perception system throws, the arm goes on."""
    try:
        return getattr(scene, name), ""
    except Exception as error:
        return None, words_of(error)


def words_of(error: Exception) -> str:
    """What an error says, whatever comes of asking it."""
    try:
        return str(error) or type(error).__name__
    except Exception:
        return type(error).__name__


class Reading:
    """Takes down scenes in an arm's records, and says in words what of the last one could not be read.

    Args:
        records: Where to; they are made to fit who is there.
        trusting: Whether what is shown is the present, whoever it is; else joint states have to be what a monitor can
            compare, and people those of the beginning.
        exact: Whether joint states have to be of double precision then.
        fixed: Whether what stands still is of interest.
        assumed: Called with the names of human capsules: how they move, and how an arm may touch them.
        capacity: As many capsules people may have who come and go; None: nobody may.
    """

    def __init__(
        self,
        records: Records,
        trusting: bool,
        exact: bool,
        fixed: bool,
        assumed: Callable[[tuple[str, ...]], Assumed],
        capacity: int | None = None,
    ) -> None:
        self._records, self._assumed = records, assumed
        self._trusting, self._exact, self._fixed = trusting, exact, fixed
        self._visitors = None if capacity is None or trusting else Association(records, capacity, assumed)
        self.forget()

    def forget(self) -> None:
        """Whoever and whatever is shown next is who and what there is."""
        self.names: tuple[str, ...] | None = None
        """Names of the human capsules; None while nobody knows."""
        if self._visitors is not None:
            self._visitors.forget()
        # whether it is settled who there is
        self._met = False
        self.planes: tuple[str, ...] = ()
        """Names of the half-spaces."""
        self.statics: tuple[str, ...] = ()
        """Names of the static capsules."""
        self._shown: tuple[Any, Any] = (None, None)
        self.wrong = {"joints": "", "clock": "", "people": "", "fixtures": ""}
        """What of the last scene could not be read, and why."""
        self._spoiled = True

    def read(self, scene: Scene | None) -> None:
        """Take down a scene; never raises: a tick that is not looked at would not be counted."""
        try:
            self._read(scene)
        except Exception as error:  # whatever a scene throws that nobody has thought of
            self._lose(words_of(error))

    def _lose(self, why: str) -> None:
        """Nothing of a scene can be read."""
        view = self._records.view
        for part in ("joints", "people", "fixtures", "timed", "seen"):
            self._spoil(view, part, why)

    def _read(self, scene: Scene | None) -> None:
        view = self._records.view
        if self._spoiled:
            self._spoiled, self.wrong = False, dict.fromkeys(self.wrong, "")
            view.now[0] = (0.0, True, True, True, True, True, 0, np.nan)
        if scene is None:
            self._lose("there is no scene")
            return
        try:
            robot, time, lost = scene.robot, scene.time, ""
        except Exception:  # whatever a perception system throws, the arm must go on safely
            (robot, lost), (time, _) = part_of(scene, "robot"), part_of(scene, "time")
        try:
            view.now["time"] = time = float(time)
        except Exception as error:  # whatever a clock delivers
            self.wrong["clock"] = words_of(error)
            self._spoil(view, "timed", "")
        if lost := lost or self.read_joints(robot):
            self._spoil(view, "joints", lost)
        self._look_for_people(scene)
        if self._fixed:
            try:
                self._read_fixtures(scene.static, scene.planes)
            except Exception as error:  # whatever static agents a scene has, the arm must go on safely
                self._spoil(self._records.view, "fixtures", words_of(error))

    def _spoil(self, view: View, part: str, why: str) -> None:
        """Say that a part could not be read."""
        view.now[part] = False
        self.wrong[part] = why
        self._spoiled = True

    # ---- joints --------------------------------------------------------------------------------------

    def read_joints(self, robot: Any) -> str:
        """Take down a joint state; why that is impossible, or nothing."""
        view = self._records.view
        joints, shape = (view.position, view.velocity, view.acceleration), view.jerk.shape
        try:
            for row, values in zip(joints, (robot.position, robot.velocity, robot.acceleration), strict=True):
                if type(values) is not np.ndarray or values.dtype is not _FLOAT64:
                    self._check_joints(values)
                if values.shape != shape:
                    raise ValueError(f"it has shape {values.shape}, expected {shape}")
                row[:] = values
        except Exception as error:  # whatever a driver delivers, the arm must go on safely
            return words_of(error)
        return ""

    def _check_joints(self, values: Any) -> None:
        """Raises if an array is not what is taken for one."""
        if self._trusting:
            checked_array(values)
            return
        kind, size = values.dtype.kind, values.dtype.itemsize
        if isinstance(values, np.ma.MaskedArray):
            raise ValueError("it is masked")
        if kind not in "fiu":
            raise ValueError(f"it is {values.dtype}, expected real numbers")
        if self._exact and kind == "f" and size < 8:
            raise ValueError(f"it is {values.dtype}, which without a state_tolerance has to be float64")

    # ---- people --------------------------------------------------------------------------------------

    def _look_for_people(self, scene: Scene) -> None:
        try:
            human, age, valid = scene.human, scene.age, scene.valid
            if self._visitors is not None:
                human, age, valid = self._sort_out(scene)
            elif not (self._met or self._trusting):
                self._meet(tuple(human.names))
        except Exception as error:  # whatever a perception system delivers, the arm must go on safely
            view = self._records.view
            view.now["seen"] = False
            self._spoil(view, "people", words_of(error))
            return
        try:
            if self._trusting:
                self._read_anybody(human, valid)
            else:
                self._read_people(human, age, valid)
                self._met = True
        except Exception as error:
            why = words_of(error)
            if not self._trusting:
                with suppress(Exception):
                    why = unlike(human, age, valid) or why
            self._spoil(self._records.view, "people", why)

    def shown(self, column: int) -> int:
        """Which capsule of the scene a remembered one is; -1 for one that it has not."""
        return column if self._visitors is None or column < 0 else self._visitors.shown[column]

    def _sort_out(self, scene: Scene) -> tuple[CapsuleSet, Array, NDArray[np.bool_]]:
        """People who come and go, each in the place of their tracks."""
        view, visitors = self._records.view, self._visitors
        assert visitors is not None
        if not view.now[0]["timed"]:
            raise ValueError(self.wrong["clock"])
        people = visitors.arrange(scene, float(view.now[0]["time"]))
        view, self.names = self._records.view, visitors.names
        view.now["frame"] = visitors.frame_age
        return people

    def _meet(self, names: tuple[str, ...]) -> None:
        """Make room for people who are seen for the first time."""
        if names == self.names:
            return
        assumed = self._assumed(names)
        self._records.make_room(people=len(names))
        assume(self._records.memory, assumed)
        self.names = names

    def _read_people(self, human: CapsuleSet, age: Any, valid: Any) -> None:
        """Take down people whom a monitor will judge.

        Raises:
            ValueError, TypeError, AttributeError: They do not fit together, or are not those of the beginning.
        """
        view, (start, end, start_velocity, end_velocity, radius, names, person) = self._records.view, human
        shape = radius.shape
        if not fit_together(human, age, valid):
            raise ValueError("the arrays' shapes do not fit together")
        if view.radius.shape != shape:
            raise ValueError(f"{shape[0]} capsules instead of {len(view.radius)}")
        if names is not self.names and tuple(names) != self.names:
            raise ValueError("the capsules have other names than before")
        if not (
            type(start) is type(end) is type(start_velocity) is type(end_velocity) is type(radius) is np.ndarray
            and type(person) is type(age) is type(valid) is np.ndarray
        ) and (wrong := unlike(human, age, valid)):
            raise ValueError(wrong)
        # into arrays of one's own: of the type that the kernel is compiled for, whatever comes
        if (
            start.dtype is end.dtype is start_velocity.dtype is end_velocity.dtype is _FLOAT64
            and radius.dtype is age.dtype is _FLOAT64
            and valid.dtype is _BOOL
            and person.dtype is _INT64
        ):
            view.start[:], view.end[:] = start, end
            view.start_velocity[:], view.end_velocity[:] = start_velocity, end_velocity
            view.radius[:], view.age[:], view.valid[:], view.person[:] = radius, age, valid, person
        else:  # slower, but raises for what is no number
            mine = view.start, view.end, view.start_velocity, view.end_velocity, view.radius, view.age
            for array, other in zip(
                (*mine, view.valid, view.person), (*human[:5], age, valid, person), strict=True
            ):  # fmt: skip
                np.copyto(array, other)

    def _read_anybody(self, human: CapsuleSet, valid: Any) -> None:
        """Take down people who are taken for granted, as many as there are.

        Raises:
            ValueError, TypeError: They do not fit together.
        """
        human, valid = checked_capsules(human), checked_array(valid)
        check_capsules(human)
        if valid.shape != human.radius.shape or valid.dtype != np.bool_:
            raise ValueError(f"valid has shape {valid.shape} for {len(human.radius)} capsules")
        self._records.make_room(people=len(human.radius))
        view = self._records.view
        view.start[:], view.end[:] = human.start, human.end
        view.start_velocity[:], view.end_velocity[:] = human.start_velocity, human.end_velocity
        view.radius[:], view.valid[:] = human.radius, valid

    # ---- what stands still ---------------------------------------------------------------------------

    def _read_fixtures(self, static: CapsuleSet, planes: Planes) -> None:
        """Take down static capsules and half-spaces.

        Raises:
            ValueError, TypeError: They are no such thing, or have other names or numbers than at first.
        """
        shown = self._shown
        if static is shown[0] and planes is shown[1]:
            capsules, normal, offset = static, planes.normal, planes.offset
        else:
            capsules, normal, offset = self._recognise(static, planes)
        view = self._records.view
        view.normal[:], view.offset[:] = normal, offset
        if len(capsules.radius):
            scene = self._records.scene
            for row, ends in zip(scene.static_ends[0], capsules[:4], strict=True):
                row[:] = ends
            scene.static_radius[0] = capsules.radius

    def _recognise(self, static: CapsuleSet, planes: Planes) -> tuple[CapsuleSet, Array, Array]:
        """Take other objects for the fixtures."""
        capsules, normal, offset = checked_capsules(static), checked_array(planes.normal), checked_array(planes.offset)
        names = tuple(planes.names), tuple(static.names)
        check_capsules(capsules)
        if normal.shape != (len(offset), 3):
            raise ValueError(f"{len(offset)} half-spaces with normals of shape {normal.shape}")
        if (len(offset), len(capsules.radius)) != (len(names[0]), len(names[1])):
            raise ValueError(f"half-spaces and static capsules have the names {names}")
        normal, offset = np.asarray(normal, np.float64), np.asarray(offset, np.float64)
        if self._records.memory.arm[0]["fixed"] and names != (self.planes, self.statics):
            counts = records(len(capsules.radius), AGENT), records(len(offset), PLANE)
            unsound = load_fixtures(capsules.start, capsules.end, capsules.radius, normal, offset, *counts, True)
            changed = CHANGED_STATICS if names[0] == self.planes else CHANGED_PLANES
            raise ValueError(FIXTURES[unsound or changed])
        self.planes, self.statics = names
        self._records.make_room(statics=len(capsules.radius), planes=len(offset))
        # copies in another type are made anew each time: what they were made of may have changed
        same = capsules is static and planes.normal.dtype == planes.offset.dtype == np.float64
        self._shown = (static, planes) if same else (None, None)
        return capsules, normal, offset
