"""A filter between a policy and many environments that are seen through sensors."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.vector import Names, VectorShield
from jssa_gym.tick.layout import SceneRecord
from jssa_gym.vectors import Mask

_NO_SCENE = "there is no scene"

_WRONG = {"joints": _NO_SCENE, "clock": "", "people": _NO_SCENE, "fixtures": _NO_SCENE}
"""What cannot be read without a scene, and why; as of :class:`~jssa_gym.shields.reading.Reading`."""

_PARTS = ("timed", "joints", "people", "seen", "fixtures")
"""What can be read of a scene."""


class Sensors(Protocol):
    """What shows arms to their shields; see :class:`jssa_gym.envs.vector.sensors.VectorSensors`."""

    lost: Mask

    def begin(self, which: Mask) -> None:
        """Episodes of those arms begin."""
        ...

    def look(self, live: Mask) -> None:
        """Those arms have made a step."""
        ...

    def show(self, which: Mask, scene: SceneRecord) -> None:
        """Write what is seen of those arms, but for those that are lost."""
        ...


class PerceivingShield(VectorShield):
    """A :class:`~jssa_gym.shields.vector.VectorShield` that sees arms and people through sensors, one for each arm.

    What environment ``e`` gives is what ``Shield(sensor, filter)`` around a sensor around a single one gives, bit for
    bit, as long as the sensor shows arrays of float64 of those who are there: always the same ones.

    Args:
        env: As of :class:`~jssa_gym.shields.vector.VectorShield`.
        filter: The same.
        sensors: What it sees; None for the truth.

    Raises:
        ParameterError: As of :class:`~jssa_gym.shields.vector.VectorShield`; or there are sensors and the filter has no
            verified stop, which alone judges what it is shown.
        InterfaceError: As of :class:`~jssa_gym.shields.vector.VectorShield`.
    """

    def __init__(
        self, env: VectorEnv, filter: SafetyFilter | str | Mapping[str, Any], sensors: Sensors | None = None
    ) -> None:
        super().__init__(env, filter)
        if sensors is not None and not self._guarded:
            raise ParameterError(
                f"{type(self.filter).__name__} without a verified stop takes what it is shown for the truth, one arm "
                "at a time: take '+stop' behind its name, or a Shield around each environment"
            )
        # of which arms nothing was seen when they decided last
        self._sensors, self._lost = sensors, np.zeros(env.num_envs, np.bool_)
        self._lost_words = self._words._replace(wrong=_WRONG)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Filter actions, shape (E, n), step the environments, and look at what has become of them."""
        live = self._arms.ready()
        stepped = super().step(actions)
        if self._sensors is not None:
            self._sensors.look(live & ~self._arms.began)
        return stepped

    def _begin(self, which: Mask) -> dict[str, NDArray[Any]]:
        if self._sensors is not None:
            self._sensors.begin(which)
        return super()._begin(which)

    def _show(self, which: Mask) -> None:
        if self._sensors is None:
            super()._show(which)
            return
        scene = self._batch.scene
        self._sensors.show(which, scene)
        self._lost[which] = self._sensors.lost[which]
        for part in _PARTS:
            scene.now[part][which] = ~self._lost[which]

    def _named(self, e: int) -> Names:
        return self._lost_words if self._lost[e] else super()._named(e)
