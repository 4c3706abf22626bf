"""Why an arm is elsewhere than its jerks lead: what environments of one's own get wrong, told from joint states."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from jssa_gym.kernels.motion import integrate
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array

EXACT = 1e-12
"""Share of the limits by which joint states may differ for rounding."""

_ALIKE = 1e-9
"""Share of the limits within which a supposed mistake explains what is seen."""

_ROWS = ("position", "velocity", "acceleration")

Step = Callable[[Array, Array], Array]
"""A joint state (3, n) and a jerk (n,) to the state after a step."""


class Diagnosis(NamedTuple):
    """What is wrong with the motion of an arm."""

    name: str
    message: str


class Motion:
    """The joint states that an environment reported under known actions.

    Args:
        robot: The arm.
        dt: Control step [s].
        actions: Shares of the jerk bounds, shape (T, n).
        states: Position, velocity and acceleration after reset and after every step, shape (T + 1, 3, n).
        tolerance: How far they may be from the exact motion, shape (3, n); what of the first lies within is rest.
    """

    def __init__(self, robot: RobotModel, dt: float, actions: Array, states: Array, tolerance: Array) -> None:
        limits = robot.limits
        low, high = limits.position.T
        self.dt, self.actions, self.states = dt, actions, states
        self._bound = np.array(limits.jerk)
        self._scale = np.array([high - low, limits.velocity, limits.acceleration])
        self._allowed = tolerance + _ALIKE * self._scale
        at_rest = np.array([states[0, 0], 0.0 * states[0, 0], 0.0 * states[0, 0]])
        self._first = at_rest if np.all(np.abs(states[0] - at_rest) <= self._allowed) else states[0]
        self.jerks = actions * self._bound
        self.expected = self._play(self.jerks)

    @property
    def tolerated(self) -> bool:
        """Whether the states are within the tolerance of the exact motion."""
        return bool(np.all(np.abs(self.states - self.expected) <= self._allowed))

    def diagnose(self) -> Diagnosis | None:
        """The simplest mistake that explains the states; None if they are right."""
        if self._like(self.expected, EXACT):
            return None
        if np.all(self.states[1:] == self.states[1:].astype(np.float32)):
            return Diagnosis(
                "float32", "scene.robot has values of single precision: keep and report the state as float64"
            )
        return next(self._explanations())

    def _explanations(self) -> Iterator[Diagnosis]:
        yield from self._late()
        yield from self._euler()
        yield from self._other_actions()
        yield from self._biased()
        yield from self._rows()
        worst = self._off(self.expected).max(axis=(1, 2))
        first = int(np.argmax(worst > EXACT))
        yield Diagnosis(
            "motion",
            f"scene.robot is not where the jerks lead, by up to {worst.max():.2g} of a limit, from tick {first} on: "
            "report the commanded state, integrated exactly (Eq. 1), and not one that is measured or simulated",
        )

    # ---- one mistake each ----------------------------------------------------------------------------

    def _late(self) -> Iterator[Diagnosis]:
        """States that are those of earlier ticks."""
        if np.all(self.states == self.states[0]):
            yield Diagnosis("frozen", "scene.robot never changes: it has to be the state after every step")
        ages = []
        for k, state in enumerate(self.states):
            same = [i for i in range(k + 1) if self._distance(state, self.expected[i]) <= _ALIKE]
            if not same:
                return
            ages.append(k - same[-1])
        lag, count = max(ages), int(np.count_nonzero(ages))
        if ages == [min(k, lag) for k in range(len(ages))]:
            yield Diagnosis(
                "lag",
                f"scene.robot lags by {lag} ticks, or actions are applied {lag} ticks late: it has to be the state "
                "after the step, with the step's own action applied",
            )
        yield Diagnosis(
            "stale",
            f"scene.robot is of an earlier tick at {count} of {len(ages) - 1} ticks, up to {lag} ticks old: it has to "
            "be the state after every step",
        )

    def _euler(self) -> Iterator[Diagnosis]:
        dt = self.dt

        def explicit(state: Array, jerk: Array) -> Array:
            q, v, a = state
            return np.array([q + dt * v, v + dt * a, a + dt * jerk])

        def implicit(state: Array, jerk: Array) -> Array:
            q, v, a = state
            a = a + dt * jerk
            v = v + dt * a
            return np.array([q + dt * v, v, a])

        def second_order(state: Array, jerk: Array) -> Array:
            q, v, a = state
            return np.array([q + dt * v + dt**2 / 2.0 * a, v + dt * a, a + dt * jerk])

        if any(self._like(self._play(self.jerks, step)) for step in (explicit, implicit, second_order)):
            yield Diagnosis(
                "euler",
                "the motion is integrated by Euler: integrate the jerk exactly, q + t v + t²/2 a + t³/6 u, v + t a + "
                "t²/2 u, a + t u",
            )

    def _other_actions(self) -> Iterator[Diagnosis]:
        """Exact motion under other jerks than those asked for."""
        rounded = self.actions.astype(np.float32).astype(np.float64) * self._bound
        if any(self._like(self._play(jerks), EXACT) for jerks in (rounded, self.jerks.astype(np.float32) * 1.0)):
            yield Diagnosis("rounded", "actions are rounded to float32: apply them in double precision, as they come")
        for times in range(2, 9):
            played = self._play(np.repeat(self.jerks, times, axis=0))
            if self._like(played[::times]):
                yield Diagnosis("repeated", f"an action is applied {times} times a step: a step is one tick of dt")
        seen = np.diff(self.states[:, 2], axis=0) / self.dt
        share = seen / self._bound
        factor = (seen * self.jerks).sum(axis=0) / (self.jerks**2).sum(axis=0)
        if self._like(self._play(factor * self.jerks)):
            text = f"{factor[0]:.6g}" if np.ptp(factor) < 1e-6 else np.array2string(factor, precision=4)
            flipped = " (the sign is flipped)" if np.all(factor < 0.0) else ""
            yield Diagnosis(
                "scaled", f"actions are scaled by a factor {text}{flipped}: an action of 1 is the joint's jerk bound"
            )
        for top in (np.full(share.shape[1], np.abs(share).max()), np.abs(share).max(axis=0)):
            if self._like(self._play(np.clip(self.actions, -top, top) * self._bound)):
                yield Diagnosis(
                    "clipped", f"actions are clipped at {top.max():.4g}: all of [-1, 1] have to be applied as they are"
                )

    def _biased(self) -> Iterator[Diagnosis]:
        bias = (np.diff(self.states[:, 2], axis=0) - self.dt * self.jerks).mean(axis=0)
        share = np.abs(bias / self._scale[2]).max()
        text = f"the acceleration has a bias of {share:.2g} of its limit a tick: what is applied is the action alone"
        shift = np.array([np.zeros_like(bias), np.zeros_like(bias), bias])
        if self._like(self._play(self.jerks, lambda state, jerk: self._exact(state, jerk) + shift)):
            yield Diagnosis("bias", text)
        if self._like(self._play(self.jerks + bias / self.dt)):
            yield Diagnosis("bias", text)
        off = self.states - self.expected
        count = len(off) - 1
        if np.abs((off - np.arange(count + 1)[:, None, None] * off[-1] / count) / self._scale).max() <= _ALIKE:
            share = np.abs(off[-1] / self._scale).max() / count
            yield Diagnosis(
                "drift", f"scene.robot drifts off by {share:.2g} of a limit a tick: report the commanded state"
            )

    def _rows(self) -> Iterator[Diagnosis]:
        """Some of position, velocity and acceleration are right, others are not."""
        worst = self._off(self.expected).max(axis=(0, 2))
        right = [name for name, off in zip(_ROWS, worst, strict=True) if off <= EXACT]
        wrong = [row for row, off in enumerate(worst) if off > EXACT]
        if not right:
            return
        said = []
        for row in wrong:
            seen, true = self.states[1:, row], self.expected[1:, row]
            factor = float((seen * true).sum() / (true**2).sum())
            if not seen.any():
                said.append(f"{_ROWS[row]} reads 0 throughout")
            elif np.abs((seen - factor * true) / self._scale[row]).max() <= _ALIKE:
                said.append(f"{_ROWS[row]} is {factor:.6g} times what it has to be")
            else:
                said.append(f"{_ROWS[row]} is not, by up to {worst[row]:.2g} of its limit")
        verb = "is" if len(right) == 1 else "are"
        yield Diagnosis(
            _ROWS[wrong[0]], f"{' and '.join(right)} {verb} right, {', '.join(said)}: report what Eq. 1 gives"
        )

    # ---- motion --------------------------------------------------------------------------------------

    def _exact(self, state: Array, jerk: Array) -> Array:
        out = np.empty_like(state)
        integrate(state, jerk, self.dt, out)
        return out

    def _play(self, jerks: Array, step: Step | None = None) -> Array:
        """States from the first one on, shape (len(jerks) + 1, 3, n)."""
        states = [self._first]
        for jerk in jerks:
            states.append((step or self._exact)(states[-1], jerk))
        return np.array(states)

    def _off(self, states: Array) -> Array:
        """Shares of the limits, shape (T + 1, 3, n)."""
        return np.abs(self.states - states) / self._scale

    def _distance(self, one: Array, other: Array) -> float:
        return float((np.abs(one - other) / self._scale).max())

    def _like(self, states: Array, tolerance: float = _ALIKE) -> bool:
        return bool(self._off(states).max() <= tolerance)
