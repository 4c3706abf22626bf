"""Policies that act more slowly than arms are controlled, for many arms at once."""

from collections.abc import Collection, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray

from jssa_gym.envs.repeat import ANY, LARGEST, REASONS
from jssa_gym.envs.vector.env import VectorArmEnv, final_infos
from jssa_gym.envs.vector.options import checked_mode
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.types import Array
from jssa_gym.validation import positive_integer
from jssa_gym.vectors import Infos, Mask, as_infos


class VectorActionRepeat(VectorWrapper):
    """Repeats actions for some ticks, as :class:`~jssa_gym.ActionRepeat` around each of the environments would.

    It goes around a :class:`VectorArmEnv` with ``autoreset_mode="Disabled"``, outside of its shield: an episode that
    ends while its action is repeated waits for the others, and what begins anew does so here, between two actions.

    Args:
        env: The vector.
        ticks: How often actions are applied, at least 1.
        autoreset_mode: When those that are over begin anew, an ``AutoresetMode`` or its value.
        keys: What ``infos`` tells; None for everything that the vector does.

    Raises:
        InterfaceError: It is another vector.
        ParameterError: ``ticks`` is no positive integer, the mode unknown, or the vector begins episodes by itself.
    """

    outside_shield: ClassVar[bool] = True
    """Shields refuse to go around it."""

    def __init__(
        self,
        env: VectorEnv,
        ticks: int,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        keys: Collection[str] | None = None,
    ) -> None:
        super().__init__(env)
        self.ticks, self.autoreset_mode = positive_integer("ticks", ticks), checked_mode(autoreset_mode)
        arms = env.unwrapped
        if not isinstance(arms, VectorArmEnv):
            raise InterfaceError(f"{env} is no VectorArmEnv: put an ActionRepeat around each environment")
        if arms.autoreset_mode != AutoresetMode.DISABLED:
            raise ParameterError(
                f"the vector begins episodes by itself, in mode {arms.autoreset_mode.value}, between two ticks of one "
                'action: make it with autoreset_mode="Disabled", and give VectorActionRepeat the mode'
            )
        self.metadata = {**env.metadata, "autoreset_mode": self.autoreset_mode}
        arms.waits = True
        self._arms, self._keys = arms, keys
        self._over: Mask = np.zeros(env.num_envs, np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, Infos]:
        """Begin episodes; see :meth:`VectorArmEnv.reset`."""
        observations, infos = self.env.reset(seed=seed, options=options)  # ty: ignore[invalid-argument-type]  # or a list
        self._over &= ~self._arms.began
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Infos]:
        """Apply actions for ``ticks`` control steps, or to the ends of their episodes.

        Raises:
            gymnasium.error.ResetNeeded: Of one that is over, with ``DISABLED``.
        """
        waiting = self._over
        if self.autoreset_mode == AutoresetMode.DISABLED and waiting.any():
            over = np.flatnonzero(waiting).tolist()
            raise ResetNeeded(f"environments {over} are over: reset(options={{'reset_mask': ...}}) them")
        seen, rewards, terminated, truncated, infos = self._repeated(actions, ~waiting)
        self._over = done = terminated | truncated
        ends: Infos = {}
        if self.autoreset_mode == AutoresetMode.SAME_STEP and done.any():
            ends = final_infos(seen, _as_infos(infos, done), done)
            # copies: in what is said now, beginnings take the place of ends
            infos = {key: value.copy() for key, value in infos.items() if not isinstance(value, dict)}
        again = {AutoresetMode.NEXT_STEP: waiting, AutoresetMode.SAME_STEP: done}.get(self.autoreset_mode)
        if again is not None and again.any():
            fresh, told = self.env.reset(options={"reset_mask": again})
            self._over = done & ~again
            seen = np.where(again[:, None], fresh, seen)
            if not infos:  # nobody took a step
                self._merge(infos, told, again)
            for key in infos.keys() & told.keys():
                infos[key][again] = told[key][again]
        return seen, rewards, terminated, truncated, ends | _as_infos(infos, np.ones_like(done))

    def _repeated(self, actions: Any, running: Mask) -> tuple[NDArray[np.float32], Array, Mask, Mask, Infos]:
        """What comes of the ticks to those that run, and what they say of them all, without masks."""
        seen = np.zeros(self.observation_space.shape or (), np.float32)
        rewards, infos = np.zeros(self.num_envs), Infos()
        terminated, truncated = np.zeros((2, self.num_envs), np.bool_)
        running = running.copy()
        for _ in range(self.ticks):
            if not running.any():
                break
            observations, gained, ended, late, told = self.env.step(actions)
            self._merge(infos, told, running)
            seen = observations if running.all() else np.where(running[:, None], observations, seen)
            rewards[running] += gained[running]
            terminated |= running & ended
            truncated |= running & late
            running &= ~(ended | late)
        return seen, rewards, terminated, truncated, infos

    def _merge(self, infos: Infos, told: Infos, running: Mask) -> None:
        """Put what a tick says into what is said of all ticks, of those that were in it."""
        worse = None
        if "shield/status" in infos:
            worse = running & (told["shield/status"] > infos["shield/status"])
        for key, value in told.items():
            if key[0] == "_" or not (self._keys is None or key in self._keys):
                continue
            if isinstance(value, dict):  # is said at ends alone
                for name, last in value.items():
                    infos.setdefault(key, {}).setdefault(name, np.zeros_like(last))[running] = last[running]
            elif key not in infos:
                infos[key] = value.copy()
            elif key == "distance":
                infos[key][running] = np.minimum(infos[key], value)[running]
            elif key == "cost":
                infos[key][running] += value[running]
            elif key in ANY:
                infos[key][running] |= value[running]
            elif key in LARGEST:
                # numpy's maximum is NaN if any tick's is: a fault must not be hidden
                infos[key][running] = np.maximum(infos[key], value)[running]
            else:
                last = worse if key in REASONS and worse is not None else running
                infos[key][last] = value[last]


def _as_infos(values: Infos, who: Mask) -> Infos:
    """Values with masks of who says them; what is said at ends alone has masks of its own."""
    nested = {key: value for key, value in values.items() if isinstance(value, dict)}
    said = {f"_{key}": _said(value) for key, value in nested.items()}
    return as_infos({key: value for key, value in values.items() if key not in nested}, who) | nested | said


def _said(values: Infos) -> Mask:
    """Who says anything of what is said at ends."""
    return np.any([mask for name, mask in values.items() if name[0] == "_"], axis=0)
