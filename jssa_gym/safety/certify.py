r"""Which parameters of the index an arm can keep: Eq. (7), sampled, and a condition that suffices.

Both are about one capsule of the robot and one person at constant velocity. They say nothing about several rows at
once, nor about a person who changes pace: that is what the verified stop is for.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.feasibility import probe
from jssa_gym.kernels.index import index_value
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, PLANE, SEGMENT, records
from jssa_gym.robots import RobotModel
from jssa_gym.safety.index import IndexParams
from jssa_gym.types import Array
from jssa_gym.validation import known_name, low_high, number_within, positive_number, real_array

_KEPT = 1e-6
"""Index [m²] up to which a state counts as kept, as in the filter."""

_DRAWS = 1 << 14
"""States drawn at a time."""

_RAREST = 1e-3
"""Share of the draws that have to lie in the domain."""


@dataclass(frozen=True, slots=True)
class Domain:
    """States that :func:`sample_feasibility` draws from; its answer holds for these.

    Raises:
        ParameterError: A number is out of range.
    """

    tip_speed: float = 1.0
    """The tool centre point is no faster [m/s]."""
    human_speed: float = 1.0
    """Nor is the person [m/s]."""
    distance: tuple[float, float] = (0.05, 1.2)
    """Range of the surface distance [m]."""
    speed_share: float = 0.3
    """Joint speeds, as a share of their limits."""
    acceleration_share: float = 0.5
    """Joint accelerations, as a share of their limits."""
    radius: float = 0.1
    """Of the person, a sphere [m]."""
    band: float = 0.0
    r"""How far below 0 :math:`\phi` may lie [m²]."""
    viable: bool = True
    """Whether the jerk has to keep the joint limits recoverable, or only its own bounds."""

    def __post_init__(self) -> None:
        for name in ("tip_speed", "human_speed", "radius"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        object.__setattr__(self, "distance", low_high("distance", self.distance))
        for name in ("speed_share", "acceleration_share"):
            object.__setattr__(self, name, number_within(name, getattr(self, name), 0.0, 1.0))
        object.__setattr__(self, "band", number_within("band", self.band, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Feasibility:
    r"""Whether some admissible jerk keeps :math:`\phi_{k+1} \le 0`, Eq. (7), for one capsule of the robot."""

    capsule: str
    infeasible: int
    """States for which none does; ``Rate.of(infeasible, states)`` of ``jssa_gym.evaluation`` is its interval."""
    states: int
    """States drawn."""
    margin: float
    r"""Smallest :math:`-\phi_{k+1}` under the best jerk [m²]; negative where Eq. (7) fails."""
    worst: Array
    """Joint state with that margin, shape (3, n)."""
    sphere: Array
    """Person in that state: centre [m] and velocity [m/s], shape (2, 3)."""
    jerk: dict[float, float]
    r"""Quantiles of :math:`\dddot D` under the best jerk [m/s³], by their level: :math:`j^*` of :func:`suffices`."""


def sample_feasibility(
    robot: RobotModel,
    index: IndexParams,
    *,
    capsule: str,
    states: int = 100_000,
    seed: int = 0,
    domain: Domain | None = None,
    dt: float = 0.008,
) -> Feasibility:
    r"""Draw states with :math:`\phi = 0` and count those in which no jerk keeps it.

    Joint states are uniform in the domain, and so is the distance; the person is anywhere around the capsule and
    moves so that :math:`\phi` is 0 (or in the band below). Draws whose person were too fast for that, or whose arm
    cannot keep its joint limits, are drawn again.

    Args:
        robot: The arm.
        index: Parameters of the index.
        capsule: Name of one of the robot's capsules.
        states: How many.
        seed: Of the draws.
        domain: Where the states are drawn from.
        dt: Control step [s].

    Raises:
        ParameterError: An unknown capsule, no state asked for, or a domain in which hardly any state has that index.
    """
    domain = domain or Domain()
    known_name("capsule", capsule, robot.capsule_names)
    if isinstance(states, bool) or not isinstance(states, int) or states < 1:
        raise ParameterError(f"states has to be a positive integer, got {states!r}")
    row = robot.capsule_names.index(capsule)
    limits, n, rng = robot.limits, robot.n, np.random.default_rng(seed)
    low, high = limits.position.T
    bounds = np.array([low, high, limits.velocity, limits.acceleration, limits.jerk])
    region = np.array(
        [domain.tip_speed, domain.human_speed, *domain.distance, domain.radius, domain.band], dtype=np.float64
    )
    scratch: Any = (
        records(0, PLANE),
        records((1, 1), PAIR),
        records((1, 1), PAIR),
        records(n, FRAME),
        records(1, SEGMENT),
        np.zeros((3, n)),
    )
    found: list[Array] = []
    margin, worst, sphere, count, tries = np.inf, np.zeros((3, n)), np.zeros((2, 3)), 0, 0
    while count < states:
        drawn = np.stack(
            [
                rng.uniform(low, high, (_DRAWS, n)),
                domain.speed_share * limits.velocity * rng.uniform(-1.0, 1.0, (_DRAWS, n)),
                domain.acceleration_share * limits.acceleration * rng.uniform(-1.0, 1.0, (_DRAWS, n)),
            ],
            axis=1,
        )
        draws = np.hstack([rng.random((_DRAWS, 4)), rng.normal(size=(_DRAWS, 6)), rng.random((_DRAWS, 1))])
        agents, out = records(_DRAWS, AGENT), np.zeros((_DRAWS, 2))
        probe(
            robot.links,
            robot.capsules[row : row + 1],
            robot.tool_link,
            robot.tool_offset,
            bounds,
            dt,
            index.array(),
            region,
            domain.viable,
            drawn,
            draws,
            agents,
            *scratch,
            out,
        )
        inside = np.flatnonzero(~np.isnan(out[:, 0]))[: states - count]
        count, tries = count + len(inside), tries + _DRAWS
        if count < min(_RAREST * tries, states):
            raise ParameterError(f"hardly any state of {domain} has an index of 0: {count} of {tries} draws")
        found.append(out[inside])
        k = inside[np.argmax(out[inside, 0])]
        if -out[k, 0] < margin:
            margin, worst = float(-out[k, 0]), drawn[k].copy()
            sphere = np.array([agents[k]["start"], agents[k]["start_velocity"]])
    ahead, jerk = np.concatenate(found).T
    levels = (0.0, 0.01, 0.05, 0.5)
    return Feasibility(
        capsule=capsule,
        infeasible=int(np.sum(~(ahead <= _KEPT))),
        states=count,
        margin=margin,
        worst=worst,
        sphere=sphere,
        jerk=dict(zip(levels, np.quantile(jerk, levels).tolist(), strict=True)),
    )


def suffices(index: IndexParams, *, jerk: float, approach: float, distance: float) -> bool:
    r"""Whether the parameters are kept wherever the arm has enough jerk, in continuous time.

    With :math:`|\dot D| \le \bar v` and :math:`D \le \hat d`, Eq. (7) holds on
    :math:`\mathcal C = \{D \ge d_{min}, \dot D \ge p^*(D), \phi \le 0\}` if

    .. math:: \lambda_1^2 \ge \max(8\lambda_2 d_{min}, 2\lambda_2\hat d),\qquad
              \lambda_2^2 j^* \ge \lambda_1^2\bar v + \lambda_1(\hat d^2 - d_{min}^2).

    Args:
        index: Parameters of the index.
        jerk: :math:`j^*`: some admissible jerk gives :math:`\dddot D \ge j^*` everywhere [m/s³].
        approach: :math:`\bar v` [m/s].
        distance: :math:`\hat d` [m].
    """
    d_min, one, two = index.d_min, index.lambda1, index.lambda2
    damped = one**2 >= max(8.0 * two * d_min, 2.0 * two * distance)
    return damped and two**2 * jerk >= one**2 * approach + one * max(distance**2 - d_min**2, 0.0)


def propose(*, jerk: float, approach: float, distance: float, d_min: float = 0.05, damping: float = 8.0) -> IndexParams:
    r"""The smallest :math:`\lambda_2` that :func:`suffices`, with :math:`\lambda_1^2 = c\lambda_2\hat d`.

    Small parameters intervene late; a small damping c, at least 2, asks for more of the arm's jerk than a large one.

    Args:
        jerk, approach, distance: As of :func:`suffices`, positive.
        d_min: Margin of the index [m].
        damping: c, from 2 to 8; raised where :math:`8\lambda_2 d_{min}` is more.

    Raises:
        ParameterError: A number is out of range.
    """
    jerk, approach = positive_number("jerk", jerk), positive_number("approach", approach)
    distance, d_min = positive_number("distance", distance), positive_number("d_min", d_min)
    c = max(number_within("damping", damping, 2.0, 8.0) * distance, 8.0 * d_min)
    # x = sqrt(lambda2): x³ j* - c v x - sqrt(c) (d² - d_min²) = 0 has one positive root
    gap = math.sqrt(c) * max(distance**2 - d_min**2, 0.0)
    roots = np.roots([jerk, 0.0, -c * approach, -gap])
    root = float(np.max(roots.real[np.abs(roots.imag) < 1e-9])) * (1.0 + 1e-12)
    return IndexParams(d_min=d_min, lambda1=math.sqrt(c) * root * (1.0 + 1e-12), lambda2=root**2)


def fastest_approach(index: IndexParams, distance: ArrayLike) -> Array:
    r"""Fastest approach from which :math:`\phi \le 0` alone keeps :math:`d_{min}`: :math:`p^*(D)`, negative [m/s].

    While :math:`\phi = 0` is held, :math:`\lambda_2\ddot D = d_{min}^2 - D|D| - \lambda_1\dot D`. Its fast stable
    manifold through :math:`(d_{min}, 0)` is :math:`\dot D = p^*(D)`: whoever is on it stops at :math:`d_{min}`, whoever
    is faster does not. With it, :math:`\{D \ge d_{min}, \dot D \ge p^*(D), \phi \le 0\}` is forward invariant as long
    as :math:`\phi \le 0` is kept; it is the largest set of which that alone is enough.

    Args:
        index: Parameters of the index.
        distance: Surface distances of at least ``d_min``, increasing, shape (k,) [m].

    Raises:
        ParameterError: The distances are something else.
    """
    from scipy.integrate import solve_ivp

    wanted = real_array("distance", distance, np.shape(distance), "distances [m]")
    if wanted.ndim != 1 or np.any(np.diff(wanted) <= 0.0) or not np.all(wanted >= index.d_min):
        raise ParameterError(f"distances have to increase from d_min = {index.d_min} on, got {distance!r}")
    kernel, d_min, one, two = index.kernel(), index.d_min, index.lambda1, index.lambda2
    slope = (one + math.sqrt(one**2 - 8.0 * two * d_min)) / (2.0 * two)
    begin = 1e-6

    def growth(D: float, p: Array) -> Array:
        return np.array([index_value(D, p[0], 0.0, kernel) / (two * p[0])])

    out = -slope * (wanted - d_min)
    far = wanted > d_min + begin
    if far.any():
        span = (d_min + begin, float(wanted[-1]))
        out[far] = solve_ivp(growth, span, [-slope * begin], t_eval=wanted[far], rtol=1e-8, atol=1e-12).y[0]
    return out
