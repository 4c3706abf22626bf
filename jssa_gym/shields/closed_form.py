"""Filters that need no projection: a repulsive field, a sliding mode, and the protective stop."""

from dataclasses import dataclass

import numpy as np

from jssa_gym.kernels.chain import forward, place
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import FRAME, SEGMENT, STOP, records
from jssa_gym.kernels.rest import REST_PLANNED
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import DEFAULT, IndexParams
from jssa_gym.safety.pairs import ROWS, Pairs, Rows
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.pairs import PairFilter
from jssa_gym.shields.tick import Tick
from jssa_gym.types import Array, Decision, Scene, Status
from jssa_gym.validation import known_name, number_within, positive_number, share

_NEAREST = 0.01
"""Distance below which the repulsive field, which has a pole at contact, is held [m]."""

_LONGEST = 5.0
"""A stop that takes longer than this is not followed to its end: no distance is enough for it [s]."""


@dataclass(frozen=True, slots=True)
class PFMParams:
    """Parameters of :class:`PFMFilter`.

    Raises:
        ParameterError: A number is not positive and finite, or ``rows`` unknown.
    """

    influence: float = 0.5
    """Distance beyond which there is no force [m]."""
    strength: float = 1.0
    """Of the potential, per unit of joint inertia [m²/s²]."""
    damping: float = 5.0
    """Of the approach, per unit of joint inertia [1/(m² s)]."""
    lag: float = 0.05
    """Time constant with which the arm's acceleration follows the force [s]."""
    rows: Rows = "closest"
    """Whether the closest pair repels, or all pairs do."""

    def __post_init__(self) -> None:
        for name in ("influence", "strength", "damping", "lag"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        known_name("rows", self.rows, ROWS)


class PFMFilter(PairFilter):
    r"""The potential field method: people repel the arm.

    The force of a pair within the distance of influence :math:`D_0` is Khatib's, with damping,

    .. math:: F = k \Bigl(\frac1D - \frac1{D_0}\Bigr)\frac1{D^2} - b\dot D,

    and acts through the closest point's Jacobian transpose on joints of unit inertia: the acceleration
    :math:`J^\top n F`. It is lifted to jerks by letting the distance's own acceleration follow it with a time constant
    T, :math:`u = \mathrm{clip}(\bar u + J^\top n \max(F - \ddot D, 0)/T)`: people repel, they never attract. Nothing is
    promised and no row is kept, so that the slack is always 0. The index that is reported is :math:`D_0^2 - D|D|`.

    Khatib: *Real-time obstacle avoidance for manipulators and mobile robots*, IEEE ICRA 1985.
    """

    params_type = PFMParams
    params: PFMParams

    def coefficients(self) -> tuple[float, float, float]:
        return self.params.influence, 0.0, 0.0

    def answer(self, tick: Tick, pairs: Pairs, index: Array) -> Decision:
        p, watched, phi = self.params, pairs.watched(self.params.rows, self.robot.limits.jerk), index.max()
        near = watched[index[watched] > 0.0]
        D, rate, curvature, _ = pairs.motion[near].T
        D = np.maximum(D, _NEAREST)
        force = p.strength * (1.0 / D - 1.0 / p.influence) / D**2 - p.damping * rate
        push = np.maximum(force - curvature, 0.0) / p.lag
        jerk = np.clip(tick.clipped + push @ pairs.rows[near], tick.lower, tick.upper)
        if np.array_equal(jerk, tick.clipped):
            return self.untouched(tick, phi)
        return self.decided(tick, jerk, Status.PROJECTED, "a repulsive force", phi)


@dataclass(frozen=True, slots=True)
class SMAParams:
    """Parameters of :class:`SMAFilter`.

    Raises:
        ParameterError: A number is not positive and finite, ``rows`` unknown, ``gain`` not in (0, 1], or the index is
            none: see :class:`~jssa_gym.safety.index.IndexParams`.
    """

    d_min: float = 0.05
    """[m]."""
    lambda1: float = DEFAULT.lambda1
    """[m·s]."""
    lambda2: float = DEFAULT.lambda2
    """[m·s²]."""
    gain: float = 1.0
    """Jerk that is added, as a share of the jerk bound of the joint that has to give most."""
    rows: Rows = "all"
    """Whether the closest pair counts, or all pairs do: then their gradients are added."""

    def __post_init__(self) -> None:
        IndexParams(d_min=self.d_min, lambda1=self.lambda1, lambda2=self.lambda2)
        for name in ("d_min", "lambda1", "lambda2", "gain"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        share("gain", self.gain)
        known_name("rows", self.rows, ROWS)


class SMAFilter(PairFilter):
    r"""The sliding mode algorithm: where :math:`\phi > 0`, a constant jerk along :math:`-\partial\dot\phi/\partial u`.

    The index is Eq. (6); its gradient is :math:`-\lambda_2 n^\top J`. The jerk that is added is as large as its gain
    says whatever the index is, and is gone where the index is 0 or less: the arm chatters along :math:`\phi = 0`.
    RELAXED where no joint moves the pair.

    Gracia, Garelli, Sala: *Reactive sliding-mode algorithm for collision avoidance in robotic systems*, IEEE
    Transactions on Control Systems Technology 21(6), 2013; as jerk added to a nominal, Wei and Liu, IEEE CDC 2019.
    """

    params_type = SMAParams
    params: SMAParams

    def coefficients(self) -> tuple[float, float, float]:
        return self.params.d_min, self.params.lambda1, self.params.lambda2

    def answer(self, tick: Tick, pairs: Pairs, index: Array) -> Decision:
        watched, bound = pairs.watched(self.params.rows, self.robot.limits.jerk), self.robot.limits.jerk
        phi = index[watched].max(initial=-np.inf)
        active = watched[index[watched] > 0.0]
        if not len(active):
            return self.untouched(tick, phi)
        away = pairs.rows[active].sum(axis=0)
        most = (np.abs(away) / bound).max()
        if not most > 1e-9:
            jerk, reason = tick.clipped.copy(), "no joint moves the pair"
            return self.decided(tick, jerk, Status.RELAXED, reason, phi, phi, len(active))
        jerk = np.clip(tick.clipped + self.params.gain / most * away, tick.lower, tick.upper)
        return self.decided(tick, jerk, Status.PROJECTED, "sliding mode", phi, 0.0, len(active))


@dataclass(frozen=True, slots=True)
class SSMParams:
    """Parameters of :class:`SSMFilter`, the terms of the protective separation distance.

    Raises:
        ParameterError: A number is negative or not finite, or ``human_speed`` not positive.
    """

    human_speed: float | None = 1.6
    """Speed of people towards the arm, :math:`v_h` [m/s]; None for the measured one."""
    latency: float = 0.0
    """Reaction time beyond one control step [s]."""
    intrusion: float = 0.0
    """Intrusion distance C [m]."""
    human_error: float = 0.0
    """Position uncertainty of people, :math:`Z_d` [m]."""
    robot_error: float = 0.0
    """Position uncertainty of the arm, :math:`Z_r` [m]."""
    hysteresis: float = 0.1
    """By how much the distance has to exceed the one at which the arm stopped before it goes on [m]."""

    def __post_init__(self) -> None:
        if self.human_speed is not None:
            object.__setattr__(self, "human_speed", positive_number("human_speed", self.human_speed))
        for name in ("latency", "intrusion", "human_error", "robot_error", "hysteresis"):
            object.__setattr__(self, name, number_within(name, getattr(self, name), 0.0))


class SSMFilter(PairFilter):
    r"""Speed and separation monitoring: stops the arm while anybody is closer than the protective distance,

    .. math:: S_p = S_h + S_r + S_s + C + Z_d + Z_r, \quad S_h = v_h (T_r + T_s).

    :math:`T_r` is one step, in which the nominal jerk is applied, and the latency. :math:`T_s` and
    :math:`S_r + S_s` are computed for each pair from the arm's own jerk-limited stop after that step: the farthest
    that the robot capsule comes towards the person, along the pair's normal. As a plane across the normal lies between
    the two capsules, a person who keeps :math:`v_h` is not met before the arm rests, if neither latency nor sensor
    adds more than is said. The arm goes on when every distance exceeds that at which it stopped by the hysteresis. The
    index that is reported is the largest :math:`S_p^2 - D|D|`.

    ISO/TS 15066:2016, 5.5.4.
    """

    params_type = SSMParams
    params: SSMParams

    def __init__(
        self,
        robot: RobotModel,
        dt: float,
        params: SSMParams | None = None,
        *,
        viability: bool = False,
        failsafe: FailsafeParams | None = None,
    ) -> None:
        super().__init__(robot, dt, params, viability=viability, failsafe=failsafe)
        self._resume: float | None = None

    def reset(self, scene: Scene) -> None:
        """Forget the past: the arm is not stopped."""
        super().reset(scene)
        self._resume = None

    def respond(self, tick: Tick) -> Decision:
        """Measure the pairs, and let :meth:`answer` decide; with nobody there the arm is not stopped."""
        if not len(tick.people):
            self._resume = None
        return super().respond(tick)

    def answer(self, tick: Tick, pairs: Pairs, index: Array) -> Decision:
        D = pairs.motion[:, 0]
        needed = self.protective_distance(tick, tick.clipped)
        phi, worst = (needed**2 - D * np.abs(D)).max(), (needed - D).argmax()
        enough = D[worst] >= needed[worst]
        if enough and (self._resume is None or D.min() >= self._resume):
            self._resume = None
            return self.untouched(tick, phi)
        if self._resume is None:
            stopped = needed[worst] if needed[worst] < np.inf else max(D[worst], 0.0)
            self._resume = float(stopped + self.params.hysteresis)
        jerk = np.zeros(self.robot.n)
        if np.abs(tick.state[1:]).max() >= REST_PLANNED:
            plan = records(self.robot.n, STOP)
            plan_stop(tick.state, self.robot.limits.bounds(), self.dt, plan)
            stop_jerk(plan, 0, jerk)
        jerk = np.clip(jerk, tick.lower, tick.upper)
        reason = "closer than the protective distance" if not enough else "waiting for more distance"
        return self.decided(tick, jerk, Status.PROJECTED, reason, phi, 0.0, len(D))

    def amend(self, tick: Tick, decision: Decision, held: int, halt: Array) -> Array:
        """The stored stop's jerk for the held joints: to be asked again would be to stop again."""
        return SafetyFilter.amend(self, tick, decision, held, halt)

    def protective_distance(self, tick: Tick, jerk: Array) -> Array:
        """:math:`S_p` of every pair, row-major, if ``jerk`` (n,) is applied in this step and then the arm stops [m]."""
        p, normals = self.params, tick.pairs.normals
        came, time = self._stop(tick, jerk)
        if not time < _LONGEST:
            return np.full(len(normals), np.inf)
        reaction, speed = self.dt + p.latency, p.human_speed
        if speed is None:
            ends = np.stack([tick.people["start_velocity"], tick.people["end_velocity"]])
            walk = np.tile(ends, (1, len(self.robot.capsules), 1))
            speed = np.maximum(np.einsum("epk,pk->ep", walk, normals).max(0), 0)
        return speed * (reaction + time) + came + p.intrusion + p.human_error + p.robot_error

    def _stop(self, tick: Tick, jerk: Array) -> tuple[Array, float]:
        """How far each pair's robot capsule comes towards the person until the arm rests [m]; how long the stop is [s].

        Of a stop that takes too long, only that it does.
        """
        robot, bounds = self.robot, self.robot.limits.bounds()
        plan, state, unwanted = records(robot.n, STOP), np.empty((3, robot.n)), np.empty(robot.n)
        before, _ = self._ends(tick.state)
        integrate(tick.state, jerk, self.dt, state)
        ticks = plan_stop(state, bounds, self.dt, plan)
        if ticks * self.dt >= _LONGEST:
            return np.zeros(0), np.inf
        path = np.empty((ticks + 1, *before.shape))
        path[0], speed = self._ends(state)
        for k in range(ticks):
            stop_jerk(plan, k, unwanted)
            integrate(state, unwanted, self.dt, state)
            path[k + 1], _ = self._ends(state)
        normals = tick.pairs.normals.reshape(len(robot.capsules), len(tick.people), 3)
        came = np.einsum("tiek,ijk->tije", before - path, normals).max(axis=(0, 3))
        late = self.params.latency * np.einsum("iek,ijk->ije", -speed, normals).max(axis=2)
        return (np.maximum(came, 0.0) + np.maximum(late, 0.0)).reshape(-1), ticks * self.dt

    def _ends(self, state: Array) -> tuple[Array, Array]:
        """Ends of the robot capsules, and their velocities, in a joint state (3, n): shape (m, 2, 3) [m, m/s]."""
        robot = self.robot
        frames, segments = records(robot.n, FRAME), records(len(robot.capsules), SEGMENT)
        forward(robot.links, state, frames)
        place(frames, robot.capsules, segments)
        ends = (segments["start"], segments["end"]), (segments["start_velocity"], segments["end_velocity"])
        return np.stack(ends[0], axis=1), np.stack(ends[1], axis=1)
