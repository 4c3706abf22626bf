"""One moment as MuJoCo draws it: the arm, people as people, and marks."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jssa_gym.envs import figures
from jssa_gym.envs.camera import Camera, hides
from jssa_gym.envs.figures import Rounded
from jssa_gym.envs.surroundings import posed
from jssa_gym.humans.body import some_of
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array, CapsuleSet

if TYPE_CHECKING:
    import mujoco

_CLEAR = 0.22
"""How opaque somebody is who hides the arm."""

_ENOUGH = 0.25
"""Share of the arm from which somebody hides it as much as can be."""

_POINT = 1e-6
"""A capsule shorter than this is a ball [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """What is drawn of a moment besides arm and people."""

    pair: tuple[Array, Array] | None = None
    """Ends of the shortest line between them, (3,) [m] each."""
    goal: Array | None = None
    """Where the tool is to be, shape (k, 3) [m]; see :func:`goal_points`."""
    contact: Array | None = None
    """Where they touch, shape (3,) [m]."""
    capsules: bool = False
    """Whether the capsules of arm and people, which are what is measured, are drawn over what they stand for."""


def goal_points(robot: RobotModel, goal: Array, holds: bool) -> Array | None:
    """Where a goal wants the tool, shape (k, 3) [m]; None where there is nothing to be seen.

    Args:
        robot: The arm, where it stands.
        goal: A point (3,) [m], or joint positions one after the other (k n,) [rad].
        holds: Whether the goal is to stay as it is: the arm is there.
    """
    if holds or not goal.size:
        return None
    if goal.size == 3 and robot.n != 3:
        return goal.reshape(1, 3)
    return np.array([posed(robot, posture).tip[0] for posture in goal.reshape(-1, robot.n)])


def solids(camera: Camera, arm: Array, people: CapsuleSet, marks: Marks, floor: float) -> list[Rounded]:
    """All that is drawn besides the arm; whoever hides it, or its goal, can be seen through.

    Args:
        camera: Of the picture.
        arm: Points of the arm, shape (k, 3) [m].
        people: Everybody's capsules.
        marks: What else is drawn.
        floor: Height that a goal's stem stands on [m].
    """
    drawn: list[Rounded] = []
    if marks.goal is not None:
        drawn += figures.goal(marks.goal, floor)
        arm = np.vstack([arm, marks.goal])
    if marks.pair is not None:
        drawn += figures.shortest_line(marks.pair)
    if marks.contact is not None:
        drawn += figures.contact(marks.contact)
    for who in np.unique(people.person):
        one = member(people, int(who))
        hidden = min(float(hides(camera.eye, arm, one).sum()) / _ENOUGH, 1.0)
        opacity = 1.0 - (1.0 - _CLEAR) * hidden
        drawn += figures.person(one, opacity)
        if marks.capsules:
            drawn += figures.shells(one)
    return drawn


def member(people: CapsuleSet, who: int) -> CapsuleSet:
    """One person out of several."""
    return some_of(people, people.person == who)


def add_to(scene: "mujoco.MjvScene", drawn: Iterable[Rounded]) -> None:
    """Add shapes to a scene, as many as it has room for."""
    import mujoco

    for solid in drawn:
        if scene.ngeom >= scene.maxgeom:
            return
        geom, (start, end) = scene.geoms[scene.ngeom], (np.array(end, float) for end in (solid.start, solid.end))
        point = float(np.abs(end - start).max()) < _POINT
        kind = mujoco.mjtGeom.mjGEOM_SPHERE if point else mujoco.mjtGeom.mjGEOM_CAPSULE
        colour = np.array([*solid.colour, solid.opacity], np.float32)
        mujoco.mjv_initGeom(geom, kind, np.full(3, solid.radius), start, np.eye(3).ravel(), colour)
        if not point:
            mujoco.mjv_connector(geom, kind, solid.radius, start, end)
        scene.ngeom += 1
