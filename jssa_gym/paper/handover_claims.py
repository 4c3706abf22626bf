"""What the paper says about its handover, Fig. 10, held against episodes."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from jssa_gym.paper.claims import Claim, Evidence, stays_above
from jssa_gym.paper.handover import ARRIVED, BEGIN, Delivery

_SOON = 0.1
"""Until when after an activity of the shield a replan goes along with it [s]: the controller asks when the filter has
let go."""

_MOST = 0.9
"""Share of the replans that have to."""

_BACK = 0.01
"""How far the arm has to give way to count as moving away [m]."""


def handover_claims(runs: Mapping[str, Delivery], d_min: float) -> list[Claim]:
    """What section 4.4 says about Fig. 10.

    Args:
        runs: By shield, the published one first.
        d_min: The margin [m].
    """

    def claim(text: str, judge: Callable[[Delivery], Evidence]) -> Claim:
        return Claim(text, "Fig. 10", {name: judge(run) for name, run in runs.items()})

    def replans(run: Delivery) -> Evidence:
        count, along = int(run.replans.sum()), int((run.replans & _shortly_after(run)).sum())
        return Evidence(count > 0 and along >= _MOST * count, f"{along} of {count}")

    def yields(run: Delivery) -> Evidence:
        back = retreat(run)
        return Evidence(back > _BACK, f"by {back:.2f} m")

    def arrives(run: Delivery) -> Evidence:
        left = float(run.error[-1])
        return Evidence(left < ARRIVED, f"{left:.3f} m from it")

    return [
        claim("the distance stays above d_min", lambda run: stays_above(run.trace, d_min)),
        claim("replans go along with the shield's activity", replans),
        claim("the arm moves away from the goal meanwhile", yields),
        claim("it reaches the goal in the end", arrives),
    ]


def retreat(run: Delivery) -> float:
    """How far the tool moves away from the goal during the delivery [m], the goal's own motion left out."""
    own = run.error[1:] - np.linalg.norm(run.tip[:-1] - run.goal[1:], axis=1)
    away = np.r_[0.0, np.cumsum(np.where(run.trace.time[1:] >= BEGIN, own, 0.0))]
    return float((away - np.minimum.accumulate(away)).max())


def _shortly_after(run: Delivery) -> NDArray[np.bool_]:
    """Steps that begin at most so long after one in which the shield was active, shape (T,)."""
    active = np.where(run.trace.intervened, run.trace.time, -np.inf)
    return run.trace.time - np.maximum.accumulate(active) <= _SOON
