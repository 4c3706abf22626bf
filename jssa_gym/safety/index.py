"""Parameters of the safety index."""

from dataclasses import dataclass

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.index import Index
from jssa_gym.types import Array
from jssa_gym.validation import check_fields, positive_number, true_or_false


@dataclass(frozen=True, slots=True)
class IndexParams:
    r"""Parameters of :math:`\phi = d_{min}^2 - D|D| - \lambda_1\dot D - \lambda_2\ddot D`, Eq. (6).

    ``sliding``: whether the motion of the closest points along the capsules' axes is accounted for in
    :math:`\ddot D`. Without it the distance's curvature is over-stated, on the unsafe side.

    Raises:
        ParameterError: A parameter is not positive and finite, or :math:`\lambda_1^2 < 8\lambda_2 d_{min}`: then
            :math:`\phi \le 0` keeps no distance, because an approach can oscillate across :math:`d_{min}`.
    """

    d_min: float = 0.05
    """[m]."""
    lambda1: float = 2.0
    """[m·s]."""
    lambda2: float = 0.25
    """[m·s²]."""
    sliding: bool = False
    sliding_limit: float = 20.0
    """Largest sliding term [m/s²]; it would grow without bound between parallel axes."""
    sin2_floor: float = 0.01
    """Smallest sin² of the angle between two axes that the sliding term resolves."""

    def __post_init__(self) -> None:
        check_fields(self, ("d_min", "lambda1", "lambda2", "sliding_limit", "sin2_floor"), positive_number)
        check_fields(self, ("sliding",), true_or_false)
        if self.lambda1**2 < 8.0 * self.lambda2 * self.d_min:
            raise ParameterError(
                f"lambda1² has to be at least 8 lambda2 d_min: {self.lambda1**2:.4g} is below "
                f"{8.0 * self.lambda2 * self.d_min:.4g}; raise lambda1 or lower lambda2 or d_min"
            )

    @property
    def has_real_roots(self) -> bool:
        r"""The paper's condition: :math:`1 + \lambda_1 s + \lambda_2 s^2` has only negative real roots."""
        return self.lambda1**2 >= 4.0 * self.lambda2

    def kernel(self) -> Index:
        """The parameters as the kernels see them."""
        return Index(
            float(self.d_min),
            float(self.lambda1),
            float(self.lambda2),
            bool(self.sliding),
            float(self.sin2_floor),
            float(self.sliding_limit),
        )

    def array(self) -> Array:
        """The parameters as an array, shape (6,), for the kernels that are called in every tick."""
        return np.array(self.kernel(), dtype=np.float64)


DEFAULT = IndexParams()
"""What is used where nothing else is said."""

PUBLISHED = IndexParams(lambda1=3.0, lambda2=1.0)
"""The paper's, section 4.1."""

NEAR = IndexParams(lambda1=0.4, lambda2=0.1)
"""Gives way later, to get something done beside people: at 0.6 m instead of 1.4 m of one who comes at 1 m/s."""
