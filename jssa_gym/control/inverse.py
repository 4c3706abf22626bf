"""Postures that bring the tool to a point."""

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import UnreachableError
from jssa_gym.kernels.descent import step_on, weigh
from jssa_gym.kernels.passage import passes_clear
from jssa_gym.kernels.postures import smallest_gap, stays_clear
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.robots import RobotModel
from jssa_gym.safety.postures import farther_than_stretched, standing
from jssa_gym.tick.moves import look_at_tools
from jssa_gym.types import Array, CapsuleSet, Planes
from jssa_gym.validation import real_array

PRECISION = 1e-5
"""Distance of the tool centre point from its target that counts as reached [m]."""

_DAMPING = 0.03
"""Damping of the inverse [m]; the last steps go without."""

_STEPS = 60
_STRIDE = 0.3
"""No joint moves further in one step [rad]."""

_STALL = 12
"""After so many steps that bring the tool no nearer a descent is given up."""

_ENDS = (PRECISION, _DAMPING, _STALL)

_PULL = 0.1
"""Share of the way back to the present posture that every step takes where it does not move the tool."""

_EVERY = 0.02
"""No joint moves further between two postures of a motion that are looked at [rad]."""


def descend(robot: RobotModel, point: Array, seeds: Array, near: Array, margin: float = 0.0) -> list[Array | None]:
    r"""A posture by damped least squares from every seed, or None where there is none.

    .. math:: \Delta q = J^\top (J J^\top + \mu^2 I)^{-1} e + (I - J^+ J)\, k\, (q_{near} - q)

    All seeds take their steps at once, each as it would by itself, bit for bit.

    Args:
        robot: The arm, where it stands.
        point: Of the tool, shape (3,) [m].
        seeds: Postures to begin with, shape (s, n) [rad].
        near: Posture to stay close to, shape (n,) [rad].
        margin: From the position limits [rad].
    """
    low, high = robot.limits.position[:, 0] + margin, robot.limits.position[:, 1] - margin
    q, count = np.clip(seeds, low, high), len(seeds)
    # copies: arrays for reading alone are of another type to kernels, which would be compiled for both
    arm, frames = (np.array(robot.links), robot.tool_link, np.array(robot.tool_offset)), records(robot.n, FRAME)
    state, tool, J = np.zeros((count, 3, robot.n)), np.empty((count, 2, 3)), np.empty((count, 3, robot.n))
    transposed, eye, squares = J.transpose(0, 2, 1), np.eye(3), np.empty(count)
    nearest, since, on = np.full(count, np.inf), np.zeros(count, np.int64), np.ones(count, np.bool_)
    for _ in range(_STEPS):
        state[:, 0] = q
        look_at_tools(*arm, state, frames, tool, J)
        gap = point - tool[:, 0]
        far = np.sqrt((gap[:, None] @ gap[:, :, None])[:, 0, 0])
        if not weigh(far, _ENDS, 2.0, nearest, since, on, squares):
            break
        inverse = transposed @ np.linalg.inv(J @ transposed + squares[:, None, None] * eye)
        home = _PULL * (near - q) * np.minimum(1.0, far / 0.1)[:, None]  # fades, so that it ends
        there, back = inverse @ gap[:, :, None], inverse @ (J @ home[:, :, None])
        step_on((there[:, :, 0], home, back[:, :, 0]), on, _STRIDE, low, high, q)
    return [posture if reached else None for posture, reached in zip(q, far <= PRECISION, strict=True)]


def way_is_clear(robot: RobotModel, start: Array, goal: Array, planes: Planes, clear: float) -> bool:
    """Whether the straight way in joint space, every 0.02 rad of it, stays clear or comes no closer than it starts."""
    count = max(2, int(np.ceil(np.abs(goal - start).max() / _EVERY)) + 1)
    around = standing(robot, planes)
    least = min(clear, smallest_gap(around, np.array(start, float)))
    shares = np.linspace(1.0, 0.0, count)[-2::-1]
    return stays_clear(around, start + shares[:, None] * (goal - start), least)


def path_is_clear(robot: RobotModel, positions: Array, planes: Planes, static: CapsuleSet, clear: float) -> bool:
    """Whether a whole motion stays clear of what stands still and of the arm itself, or comes no closer than it starts.

    Args:
        robot: The arm, where it stands.
        positions: Of the joints along the motion, shape (m, n) [rad]; every 0.02 rad is looked at.
        planes: Half-spaces.
        static: Capsules that stand still.
        clear: Distance to all of them [m].
    """
    around, at = standing(robot, planes, static), np.array(positions)
    return passes_clear(around, at, _EVERY, clear, np.empty(len(at)), np.empty(robot.n))


def postures_for(
    robot: RobotModel,
    point: ArrayLike,
    planes: Planes,
    near: Array,
    rng: np.random.Generator,
    *,
    restarts: int = 8,
    clear: float = 0.01,
) -> list[Array]:
    """Postures that bring the tool centre point to a point, any orientation, the nearest to a posture first.

    Args:
        robot: The arm, where it stands.
        point: In the world, shape (3,) [m].
        planes: Half-spaces to keep clear of.
        near: The present posture, shape (n,) [rad]; the slowest joint's time decides what is nearest.
        rng: Draws the seeds of the restarts.
        restarts: How many further seeds are tried, half around the present posture, half anywhere.
        clear: Distance to half-spaces and of the arm to itself [m].

    Raises:
        UnreachableError: None was found.
    """
    target = real_array("point", point, (3,), "a point in world coordinates [m]")
    if farther_than_stretched(robot, target):
        raise UnreachableError(f"no posture of {robot.name} brings the tool to {target.tolist()} m: it is not so long")
    low, high = robot.limits.position.T
    seeds = [near]
    for k in range(restarts):
        anywhere = rng.uniform(low, high)
        seeds.append(near + 0.3 * (anywhere - near) if k % 2 == 0 else anywhere)
    found: list[Array] = []
    around = standing(robot, planes)
    for posture in descend(robot, target, np.array(seeds), near, margin=1e-3):
        if posture is None or any(np.abs(posture - other).max() < 1e-2 for other in found):
            continue
        if smallest_gap(around, posture) >= clear:
            found.append(posture)
    if not found:
        raise UnreachableError(
            f"no posture of {robot.name} brings the tool to {target.tolist()} m, {clear:g} m clear of table and arm"
        )
    return sorted(found, key=lambda posture: float(np.max(np.abs(posture - near) / robot.limits.velocity)))
