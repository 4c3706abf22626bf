"""Who could have walked up to the arm in the paper's Fig. 6?

The paper's person was moved by mouse and is not published. This searches a family of walks for one with which the
filter *as published*, λ = (3, 1), gives the numbers of Fig. 6; the result is frozen in
``jssa_gym/paper/person.py``. Fig. 8 and Table 1 play no part in the search.

The person starts to the left of the arm and walks to its front until 1.84 s (in Fig. 6 the left arm is closest at
first), then towards it, slowing down as the distance D falls: at c D²/λ₁, where c = 1 is the speed that triggers the
filter while the arm rests at home. c has one value up to 2.2 s and one after it. One quicker leg follows, and the way
back.

    python benchmarks/stand_in.py                                   # Nelder and Mead's simplex from START
    python benchmarks/stand_in.py --generations 60 --seed 1         # differential evolution over the family first

Objective: the squares of what the first and the last trigger differ from 1.856 s and 4.240 s (by 0.1 s), the smallest
distance from 0.446 m (by 0.02 m), the active time from 0.352 s (by 0.1 s) and the peak jerk, if above, from 2000 °/s³
(by 2000 °/s³); 3 if the person's critical links are not 4-2-1-2, 2 if they do not begin with 4, and 20 times the share
of time in which the arm's is not its end effector.
"""

import argparse
import itertools
import time

import numpy as np
from scipy.optimize import differential_evolution, minimize

from jssa_gym.evaluation.identity import made_with
from jssa_gym.exceptions import JSSAGymError
from jssa_gym.humans import Body
from jssa_gym.paper import person, reported
from jssa_gym.paper.claims import sequence
from jssa_gym.paper.experiments import SHIELDS, play
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.safety.index import PUBLISHED
from jssa_gym.safety.proximity import measure
from jssa_gym.types import JointState, Planes

LAMBDA1, LAMBDA2 = PUBLISHED.lambda1, PUBLISHED.lambda2

TURN = 1.84
"""When the person turns towards the arm [s]."""

LEG = 0.2
"""Longest part of the approach at one speed [s]."""

SHORTEST = 0.02
"""Shortest [s]."""

STEPS = 600

FAMILY = {
    "start x [m]": (1.4, 2.6),
    "start y [m]": (0.6, 1.4),
    "y in front of the arm [m]": (-0.2, 0.2),
    "x where the person turns [m]": (1.4, 2.2),
    "c up to 2.2 s": (0.5, 1.6),
    "c after it": (0.5, 1.3),
    "begin of the quick leg [s]": (2.2, 3.9),
    "its speed [m/s]": (0.1, 1.2),
    "its duration [s]": (0.05, 0.8),
    "begin of the way back [s]": (3.6, 4.6),
    "its speed [m/s] ": (0.3, 1.2),
}
"""What varies, and in which range."""

START = (1.5, 1.05, 0.025, 1.515, 0.96, 0.85, 3.875, 0.3, 0.37, 4.235, 0.93)
"""Where the simplex starts: what some thirty generations of differential evolution came to, rounded."""

ROBOT = lr_mate_200id_7l().mounted([0.0, 0.0, 0.87])
REST = JointState(np.array(ROBOT.home), np.zeros(ROBOT.n), np.zeros(ROBOT.n))
BODY, NOWHERE = Body.facing(), Planes(np.zeros((0, 3)), np.zeros(0), ())


def distance(x: float, y: float) -> float:
    """From somebody at a place to the arm at home [m]."""
    return measure(ROBOT, REST, BODY.at((x, y), (0.0, 0.0)), NOWHERE).smallest


def table(p: np.ndarray) -> np.ndarray:
    """Rows of time [s], x and y [m] of a walk of the family, rounded to milliseconds and millimetres."""
    x0, y0, y, x, before, after, quick, speed, duration, back, leaving = p
    moments = sorted({*np.arange(TURN, back, LEG).tolist(), quick, quick + duration, back})
    moments = [t for t in moments if t < back - SHORTEST] + [back]
    rows = [(0.0, x0, y0), (TURN, x, y)]
    for begin, end in itertools.pairwise(moments):
        if end - rows[-1][0] < SHORTEST:
            continue
        middle = (begin + end) / 2.0
        c = before if middle < 2.2 else after
        pace = speed if quick <= middle < quick + duration else c * max(distance(x, y), 0.0) ** 2 / LAMBDA1
        x -= pace * (end - rows[-1][0])
        rows.append((end, x, y))
    rows.append((back + 1.5, x + 1.5 * leaving, y))
    return np.array(rows).round(3)


def score(p: np.ndarray) -> float:
    """The objective; see above."""
    try:
        trace, limits = play(
            lambda env: SHIELDS["as published"](env, LAMBDA1, LAMBDA2), "", STEPS, person.walk(table(p))
        )
    except JSSAGymError:
        return 1e3
    seen, wanted = reported.measures(trace, limits), reported.FIG6
    if seen.first_trigger is None:
        return 500.0
    links, jerk = sequence(trace.pair[:, 1]), np.abs(trace.jerk).max()
    return float(
        ((seen.first_trigger - wanted.first_trigger) / 0.1) ** 2
        + ((seen.last_trigger - wanted.last_trigger) / 0.1) ** 2
        + ((seen.min_distance - wanted.min_distance) / 0.02) ** 2
        + ((seen.active_duration - wanted.active_duration) / 0.1) ** 2
        + max(jerk / reported.FIG6_JERK - 1.0, 0.0) ** 2
        + 3.0 * (links != reported.FIG6_HUMAN_LINKS)
        + 2.0 * (links[0] != reported.FIG6_HUMAN_LINKS[0])
        + 20.0 * (trace.pair[:, 0] != reported.FIG6_ROBOT_LINK - 1).mean()
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--generations", type=int, default=0)
    parser.add_argument("--polish", type=int, default=300, help="evaluations of the simplex")
    chosen = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    started = time.time()

    def tell(intermediate_result):
        best = intermediate_result
        print(
            f"{time.time() - started:5.0f} s, generation {best.nit}: {best.fun:.2f}",
            best.x.round(3).tolist(),
            flush=True,
        )

    start = np.array(START)
    if chosen.generations > 0:
        settings = {"popsize": 4, "maxiter": chosen.generations, "init": "sobol", "polish": False, "tol": 0.0}
        start = differential_evolution(score, list(FAMILY.values()), rng=chosen.seed, callback=tell, **settings).x
    # a simplex as wide as a tenth of the family
    width = np.array([high - low for low, high in FAMILY.values()]) / 10.0
    simplex = np.vstack([start, start + np.diag(width)])
    options = {"maxfev": chosen.polish, "adaptive": True, "initial_simplex": simplex}
    best = minimize(score, start, method="Nelder-Mead", options=options)
    for name, value in zip(FAMILY, best.x, strict=True):
        print(f"{name:30} {value:.4f}")
    print(f"{time.time() - started:.0f} s, objective {best.fun:.3f}")
    for row in table(best.x).tolist():
        print(f"    ({', '.join(f'{number:g}' for number in row)}),")


if __name__ == "__main__":
    main()
