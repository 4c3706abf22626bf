"""What the paper says about its safety index, Fig. 3 and 7, held against the formula."""

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.index import index_value
from jssa_gym.paper.claims import Claim, Evidence
from jssa_gym.safety.condition import fastest_approach
from jssa_gym.safety.index import IndexParams
from jssa_gym.types import Array


def portrait_claims(index: IndexParams) -> list[Claim]:
    """What section 3.1 says about Fig. 3: keeping the index at 0 keeps the margin."""
    begin = np.array([0.1, 0.2, 0.5, 1.0])
    fastest = fastest_approach(index, begin)
    held = [_closest(index, D, 0.98 * rate) for D, rate in zip(begin, fastest, strict=True)]
    lost = [_closest(index, D, 1.05 * rate) for D, rate in zip(begin, fastest, strict=True)]
    seen = f"from 1 m up to {-fastest[-1]:.2f} m/s, not from {-1.05 * fastest[-1]:.2f} m/s"
    evidence = Evidence(min(held) > index.d_min - 1e-4 and max(lost) < index.d_min, seen)
    return [
        Claim("holding φ = 0 stops every approach from inside the set before d_min", "Fig. 3", {"formula": evidence})
    ]


def _closest(index: IndexParams, distance: float, rate: float) -> float:
    """Smallest distance while the index is held at 0 [m]: Eq. (6) solved for the second derivative, integrated."""
    kernel, dt = index.kernel(), 1e-3
    least = distance
    for _ in range(20_000):
        rate += index_value(distance, rate, 0.0, kernel) / index.lambda2 * dt
        distance += rate * dt
        least = min(least, distance)
        if rate >= 0.0 or distance < 0.0:
            break
    return least


def shift_claims(index: IndexParams, lambda1: float, lambda2: float) -> list[Claim]:
    """What section 4.2 says about Fig. 7.

    Args:
        index: Before.
        lambda1: The larger λ₁ [m·s].
        lambda2: The larger λ₂ [m·s²].
    """
    d_min = index.d_min
    more1 = IndexParams(d_min=d_min, lambda1=lambda1, lambda2=index.lambda2)
    more2 = IndexParams(d_min=d_min, lambda1=index.lambda1, lambda2=lambda2)
    D, rate, curvature = (
        x.ravel() for x in np.meshgrid(np.linspace(0.0, 1.5, 7), np.linspace(-1.0, 1.0, 9), np.linspace(-3.0, 3.0, 9))
    )

    def rise(changed: IndexParams) -> Array:
        new, old = changed.kernel(), index.kernel()
        values = zip(D, rate, curvature, strict=True)
        return np.array([index_value(*at, new) - index_value(*at, old) for at in values])

    rise1, rise2 = rise(more1), rise(more2)

    def everywhere(holds: NDArray[np.bool_]) -> dict[str, Evidence]:
        return {"formula": Evidence(bool(holds.all()), f"in {holds.mean():.0%} of {holds.size} states")}

    return [
        Claim("λ₁ up: φ larger wherever somebody approaches", "Fig. 7a", everywhere(rise1[rate < 0.0] > 0.0)),
        Claim("λ₂ up: φ larger where the approach speeds up", "Fig. 7b", everywhere(rise2[curvature < 0.0] > 0.0)),
        Claim("λ₂ up: φ smaller where it slows down", "Fig. 7b", everywhere(rise2[curvature > 0.0] < 0.0)),
    ]
