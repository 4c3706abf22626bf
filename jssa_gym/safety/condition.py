r"""What :math:`\phi \le 0` keeps, and a condition on its parameters that suffices to keep it, in continuous time."""

import math

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.safety.index import IndexParams
from jssa_gym.types import Array
from jssa_gym.validation import number_within, positive_number


def fastest_approach(index: IndexParams, distance: ArrayLike) -> Array:
    r"""The fastest approach that :math:`\phi \le 0` alone still ends at :math:`d_{min}` [m/s], not positive.

    The certificate set is :math:`\mathcal C = \{D \ge d_{min}, \dot D \ge p^*(D), \phi \le 0\}`. With :math:`p^*` the
    strong stable manifold of :math:`\lambda_2\ddot y + \lambda_1\dot y + y^2 - d_{min}^2 = 0` through
    :math:`(d_{min}, 0)`,

    .. math:: p^{*\prime} p^* = (d_{min}^2 - D^2 - \lambda_1 p^*)/\lambda_2,\qquad
              p^{*\prime}(d_{min}) = -\frac{\lambda_1 + \sqrt{\lambda_1^2 - 8\lambda_2 d_{min}}}{2\lambda_2},

    whoever keeps :math:`\phi \le 0` stays in it, and it is the largest such set: an approach that is faster may pass
    :math:`d_{min}` with :math:`\phi \le 0` all the way.

    Args:
        index: Parameters of the index.
        distance: D, any shape [m]. Below :math:`d_{min}`, and beyond where the curve returns to 0 (poorly damped
            parameters: even rest comes in too fast from there), nothing is certified: the answer is inf.
    """
    from scipy.integrate import solve_ivp

    D = np.asarray(distance, dtype=np.float64)
    d_min, one, two = index.d_min, index.lambda1, index.lambda2
    slope = -(one + math.sqrt(max(one**2 - 8.0 * two * d_min, 0.0))) / (2.0 * two)
    # the equation is singular where the approach is 0: begin a little beside it, on the tangent
    beside = 1e-5 * d_min

    def ends(_: float, p: Array) -> float:
        return float(p[0]) - 0.5 * slope * beside

    vars(ends)["terminal"] = True
    top = max(float(np.max(D, initial=0.0)), d_min + 2.0 * beside)
    grid = np.linspace(d_min + beside, top, 2001)
    curve = solve_ivp(
        lambda y, p: (d_min**2 - y**2 - one * p) / (two * p),
        (grid[0], grid[-1]),
        [slope * beside],
        t_eval=grid,
        events=ends,
        rtol=1e-8,
        atol=1e-12,
    )
    approach = np.interp(D, np.r_[d_min, curve.t], np.r_[0.0, curve.y[0]])
    return np.where((d_min > D) | (curve.t[-1] < D), np.inf, approach)


def needed_jerk(index: IndexParams, *, approach: float, distance: float) -> float:
    r"""The jerk :math:`j^*` that :func:`suffices` asks for [m/s³]; inf if the parameters are not damped enough for it.

    Args:
        index: Parameters of the index.
        approach: :math:`\bar v` [m/s].
        distance: :math:`\hat d` [m].
    """
    d_min, one, two = index.d_min, index.lambda1, index.lambda2
    if not one**2 >= max(8.0 * two * d_min, 2.0 * two * distance):
        return math.inf
    return (one**2 * approach + one * max(distance**2 - d_min**2, 0.0)) / two**2


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
    return jerk >= needed_jerk(index, approach=approach, distance=distance)


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
