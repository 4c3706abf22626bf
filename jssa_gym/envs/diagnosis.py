"""Why an arm is elsewhere than its jerks lead: what environments of one's own get wrong, told from joint states."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from jssa_gym.envs.deviation import ROWS, degrees, is_noise, largest, rounded_up
from jssa_gym.kernels.motion import integrate
from jssa_gym.robots import RobotModel
from jssa_gym.text import counted
from jssa_gym.types import Array

EXACT = 1e-12
"""Share of the limits by which joint states may differ for rounding."""

_ALIKE = 1e-9
"""Share of the limits within which a supposed mistake explains what is seen."""

_SINGLE = 1e-6
"""Share of the limits that rounding to single precision does not reach."""

_SMALL = 0.01
"""Share of its range within which a joint is measured, and not elsewhere."""

_USELESS = 0.1
"""Share of a limit from which a velocity or acceleration is better not measured at all."""

_CAUSES = 10
"""Ticks to look at for every jerk that a mistake may have been made of."""

Step = Callable[[Array, Array], Array]
"""A joint state (3, n) and a jerk (n,) to the state after a step."""


class Diagnosis(NamedTuple):
    """What is wrong with the motion of an arm."""

    name: str
    message: str
    tolerance: Array | None = None
    """For measured states: a tolerance that lets them pass, shape (3, n) [rad, rad/s, rad/s²]."""


class Motion:
    """The joint states that an environment reported under known actions.

    Args:
        robot: The arm.
        dt: Control step [s].
        actions: Shares of the jerk bounds, shape (T, n).
        states: Position, velocity and acceleration after reset and after every step, shape (T + 1, 3, n).
        tolerance: How far they may be from the exact motion, shape (3, n); what of the first lies within is rest, and
            what is inf is not measured: nothing is said about it.
    """

    def __init__(self, robot: RobotModel, dt: float, actions: Array, states: Array, tolerance: Array) -> None:
        self.dt, self.actions, self.states = dt, actions, states
        self._bound, self._robot = np.array(robot.limits.jerk), robot
        self._limit = robot.limits.state_scale
        self._allowed = tolerance + _ALIKE * self._limit
        self._measured = tolerance < np.inf
        self._scale = np.where(self._measured, self._limit, np.inf)  # no deviation is any share of that
        self._at_rest = np.array([states[0, 0], 0.0 * states[0, 0], 0.0 * states[0, 0]])
        begins_at_rest = np.all(np.abs(states[0] - self._at_rest) <= self._allowed)
        self._first = self._at_rest if begins_at_rest else states[0]
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
        seen, noise = self.states[1:, self._measured], self._noise()
        if np.all(seen == seen.astype(np.float32)) and (noise is None or np.all(noise / self._scale <= _SINGLE)):
            return Diagnosis(
                "float32", "scene.robot has values of single precision: keep and report the state as float64"
            )
        return next(self._explanations())

    def _explanations(self) -> Iterator[Diagnosis]:
        yield from self._late()
        yield from self._euler()
        yield from self._other_actions()
        yield from self._biased()
        yield from self._noisy()
        yield from self._rows()
        first = int(np.argmax(self._off(self.expected).max(axis=(1, 2)) > EXACT))
        yield Diagnosis(
            "motion",
            f"scene.robot is not where the jerks lead, by up to {self._largest(self.states - self.expected)}, from "
            f"tick {first} on: report the commanded state, integrated exactly (Eq. 1), and not one that is measured or "
            "simulated",
        )

    # ---- one mistake each ----------------------------------------------------------------------------

    def _late(self) -> Iterator[Diagnosis]:
        """States that are those of earlier ticks."""
        if np.all((self.states == self.states[0]) | ~self._measured):
            yield Diagnosis("frozen", "scene.robot never changes: it has to be the state after every step")
        ages = []
        for k, state in enumerate(self.states):
            same = [i for i in range(k + 1) if self._distance(state, self.expected[i]) <= _ALIKE]
            if not same:
                return
            ages.append(k - same[-1])
        lag, old = max(ages), int(np.count_nonzero(ages))
        late = counted(lag, "tick")
        if ages == [min(k, lag) for k in range(len(ages))]:
            yield Diagnosis(
                "lag",
                f"scene.robot lags by {late}, or actions are applied {late} late: it has to be the state after the "
                "step, with the step's own action applied",
            )
        yield Diagnosis(
            "stale",
            f"scene.robot is of an earlier tick at {old} of {len(ages) - 1} ticks, up to {late} old: it has to be the "
            "state after every step",
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
            if units := degrees(factor):
                yield Diagnosis("scaled", f"scene.robot is {text} times what the actions make of it: {units}")
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
        row = np.array([0.0 * bias, 0.0 * bias, bias])
        text = f"there is a bias of {self._largest(row)} a tick: what is applied is the action alone"
        if self._like(self._play(self.jerks, lambda state, jerk: self._exact(state, jerk) + row)):
            yield Diagnosis("bias", text)
        if self._like(self._play(self.jerks + bias / self.dt)):
            yield Diagnosis("bias", text)
        off = self.states - self.expected
        ticks = len(off) - 1
        if np.abs((off - np.arange(ticks + 1)[:, None, None] * off[-1] / ticks) / self._scale).max() <= _ALIKE:
            yield Diagnosis(
                "drift",
                f"scene.robot drifts off by {self._largest(off[-1] / ticks)} a tick: report the commanded state",
            )

    def _noise(self) -> Array | None:
        """The largest of deviations that are noise, shape (3, n) [rad, rad/s, rad/s²]; None if they are none."""
        # a velocity that is noise must not be reckoned with
        expected = self._play(self.jerks, first=self._at_rest)
        off = np.where(self._measured, self.states - expected, 0.0)
        most = np.abs(off).max(axis=0)
        if np.any(most[0] > _SMALL * self._scale[0]):
            return None
        # what is late, or computed from the motion wrongly, hangs together with the state and jerks before it
        jerks = self.actions.copy()
        past = []
        for _ in range(len(jerks) // _CAUSES):
            past.append(jerks)
            jerks = np.vstack([np.zeros_like(jerks[:1]), jerks[:-1]])
        known = np.stack([*np.moveaxis(expected[1:] / self._limit, 1, 0), *past], axis=-1)
        for row in np.flatnonzero(np.any(most > EXACT * self._scale, axis=1)):
            if not is_noise(off[1:, row] / self._limit[row], known, EXACT):
                return None
        return most

    def _noisy(self) -> Iterator[Diagnosis]:
        """States that are measured."""
        noise = self._noise()
        if noise is None:
            return
        shares = (noise / self._limit).max(axis=1)
        sizes = [
            rounded_up(2.0 * most) if share > EXACT else 0.0
            for most, share in zip(noise.max(axis=1), shares, strict=True)
        ]
        tolerance = np.where(self._measured.all(axis=1), sizes, np.inf)
        tolerance[1:][shares[1:] > _USELESS] = np.inf
        # the largest of all joints is what a tolerance has to allow for, whatever share of that joint's limit it is
        worst = np.where(noise == noise.max(axis=1, keepdims=True), noise, 0.0)
        said = [
            f"{ROWS[row]} by up to {self._largest(np.where(np.arange(3)[:, None] == row, worst, 0.0))}"
            for row in np.flatnonzero(shares > EXACT)
        ]
        text = f"scene.robot is measured: {', '.join(said)} off where the jerks lead, without drifting off"
        if not self.tolerated:
            values = ", ".join('float("inf")' if value == np.inf else f"{value:.2g}" for value in tolerance)
            text += (
                ". Report the commanded state, integrated exactly (Eq. 1), or allow for what was seen, doubled, and "
                f"for what grows with faster motions, by FailsafeParams(state_tolerance=({values}))"
            )
        yield Diagnosis("measured", text, np.broadcast_to(tolerance[:, None], noise.shape))

    def _rows(self) -> Iterator[Diagnosis]:
        """Some of position, velocity and acceleration are right, others are not."""
        worst = self._off(self.expected).max(axis=(0, 2))
        measured = self._measured.any(axis=1)
        right = [ROWS[row] for row in np.flatnonzero(measured & (worst <= EXACT))]
        wrong = np.flatnonzero(worst > EXACT)
        if not right:
            return
        said = []
        for row in wrong:
            # since the beginning, which is taken as it is read
            seen, true = (states[1:, row] - states[0, row] for states in (self.states, self.expected))
            factor = float((seen * true).sum() / (true**2).sum())
            if not self.states[1:, row].any():
                said.append(f"{ROWS[row]} reads 0 throughout")
            elif np.abs((seen - factor * true) / self._scale[row]).max() <= _ALIKE:
                units = degrees(np.array([factor]))
                said.append(f"{ROWS[row]} is {factor:.6g} times what it has to be{units and f' ({units})'}")
            else:
                off = np.zeros_like(self.states)
                off[:, row] = (self.states - self.expected)[:, row]
                said.append(f"{ROWS[row]} is not, by up to {self._largest(off)}")
        verb = "is" if len(right) == 1 else "are"
        yield Diagnosis(
            ROWS[wrong[0]], f"{' and '.join(right)} {verb} right, {', '.join(said)}: report what Eq. 1 gives"
        )

    # ---- motion --------------------------------------------------------------------------------------

    def _exact(self, state: Array, jerk: Array) -> Array:
        out = np.empty_like(state)
        integrate(state, jerk, self.dt, out)
        return out

    def _play(self, jerks: Array, step: Step | None = None, first: Array | None = None) -> Array:
        """States from the first one on, shape (len(jerks) + 1, 3, n)."""
        states = [self._first if first is None else first]
        for jerk in jerks:
            states.append((step or self._exact)(states[-1], jerk))
        return np.array(states)

    def _largest(self, off: Array) -> str:
        return largest(off, self._robot, self._scale)

    def _off(self, states: Array) -> Array:
        """Shares of the limits, shape (T + 1, 3, n)."""
        return np.abs(self.states - states) / self._scale

    def _distance(self, one: Array, other: Array) -> float:
        return float((np.abs(one - other) / self._scale).max())

    def _like(self, states: Array, tolerance: float = _ALIKE) -> bool:
        return bool(self._off(states).max() <= tolerance)
