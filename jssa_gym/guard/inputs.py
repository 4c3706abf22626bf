"""What a controller passes on of people and joints, as the control step reads it; whatever it is, nothing raises."""

from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.types import Array, CapsuleSet, JointState, MeasuredPeople


class _Missing:
    """What stands in the place of what there is not: asked for anything, it says so."""

    def __init__(self, what: str) -> None:
        self._what = what

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # what copies and pickles ask
            raise AttributeError(name)
        raise ValueError(self._what)

    def __iter__(self) -> Any:
        raise ValueError(self._what)


class PeopleReader:
    """People as :class:`~jssa_gym.types.Scene` has them: capsules, their ages and whether they were measured."""

    def __init__(self) -> None:
        self._age, self._all = np.zeros(0), np.ones(0, np.bool_)
        self._none = _Missing("there are none in this tick; an empty CapsuleSet says that nobody is there")
        self._odd = _Missing("they are no MeasuredPeople and no CapsuleSet")

    def read(self, people: Any) -> tuple[Any, Any, Any, Any]:
        """Capsules, ages, validity and the frame's age; what cannot be read is for the control step to refuse."""
        if type(people) is CapsuleSet:
            human, age, valid, frame_age = people, 0.0, None, None
        elif type(people) is MeasuredPeople:
            human, age, valid, frame_age = people.capsules, people.age, people.valid, people.frame_age
        else:
            return (self._none if people is None else self._odd), self._age, self._all, None
        if frame_age is None and not (type(age) is np.ndarray and age.ndim):
            frame_age = age
        if valid is None or type(age) is not np.ndarray:
            with suppress(Exception):  # what this stumbles over the control step refuses in words
                age, valid = self._filled(human, age), self._whole(human) if valid is None else valid
        return human, age, valid, frame_age

    def _filled(self, human: CapsuleSet, age: Any) -> Any:
        """One age for all capsules."""
        if type(age) is np.ndarray and age.ndim:
            return age
        if len(self._age) != len(human.radius):
            self._age = np.zeros(len(human.radius))
        self._age.fill(float(age))
        return self._age

    def _whole(self, human: CapsuleSet) -> NDArray[np.bool_]:
        """All of them measured."""
        if len(self._all) != len(human.radius):
            self._all = np.ones(len(human.radius), np.bool_)
        return self._all


class JointReader:
    """Joint states as :class:`~jssa_gym.types.Scene` has them.

    Args:
        n: Number of joints.
    """

    def __init__(self, n: int) -> None:
        self._unknown = np.full(n, np.nan)
        self._none = _Missing("nothing was measured in this tick")

    def read(self, measured: Any) -> Any:
        """A measured state, of which positions may be all."""
        if measured is None:
            return self._none
        if isinstance(measured, JointState):
            return measured
        if not isinstance(measured, np.ndarray):
            try:
                measured = np.asarray(measured)
            except Exception:  # refused as it is
                return measured
        return JointState(measured, self._unknown, self._unknown)

    def commanded(self, state: Array) -> JointState:
        """The commanded state, shape (3, n), where none is measured."""
        return JointState(state[0], state[1], state[2])
