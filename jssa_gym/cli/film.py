"""Films of recorded episodes."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from jssa_gym import plots
from jssa_gym.envs.opengl import check_opengl
from jssa_gym.envs.world import SCENES, World
from jssa_gym.exceptions import DisplayError
from jssa_gym.robots import RobotModel
from jssa_gym.safety.proximity import measure
from jssa_gym.types import CapsuleSet, JointState, Planes, Trace

EVERY = 5
"""A picture every so many control steps: 25 a second."""


def require_film() -> None:
    """Find out before long work whether films can be made.

    Raises:
        MissingExtraError: matplotlib or PyAV is not installed.
        DisplayError: There is no OpenGL.
    """
    plots.require(film=True)
    try:
        check_opengl()
    except DisplayError as error:
        raise DisplayError(f"{error}; or give --no-video") from error


def pictures(traces: Sequence[Trace]) -> int:
    """How many pictures a film of them has."""
    return len(range(0, len(traces[0].time), EVERY))


def film(
    traces: Sequence[Trace], robot: RobotModel, *, d_min: float, pretty: bool = False
) -> Iterator[NDArray[np.uint8]]:
    """The runs side by side, the critical point pair drawn in red; below them distances, and jerks of two seconds.

    Args:
        traces: Episodes of the same length, robot and half-spaces.
        robot: The robot, where it stands.
        d_min: Marked on the gauge [m].
        pretty: Shadows and smooth edges: ten times slower.
    """
    size, first = 480, traces[0]
    scene = next((name for name in first.plane_names if name in SCENES), "floor")
    planes = Planes(first.plane_normal, first.plane_offset, first.plane_names)
    world = World(robot, scene, pretty=pretty, width=size, height=size)
    labels = [plots.label(trace.name, size) for trace in traces]
    zero = np.zeros(robot.n)
    try:
        for k in range(0, len(first.time), EVERY):
            columns = []
            for trace, label in zip(traces, labels, strict=True):
                people = _people(trace, k)
                near = measure(robot, JointState(trace.position[k], zero, zero), people, planes)
                picture = world.picture(trace.position[k], people, pair=near.points)
                bar = plots.gauge(trace.distance[k], d_min, bool(trace.intervened[k]), bool(trace.contact[k]), size)
                jerks = plots.ribbon(trace.jerk[: k + 1] / robot.limits.jerk, size)
                columns.append(np.vstack([label, picture, bar, jerks]))
            yield np.hstack(columns)
    finally:
        world.close()


def _people(trace: Trace, k: int) -> CapsuleSet:
    still = np.zeros_like(trace.human_start[k])
    return CapsuleSet(
        trace.human_start[k],
        trace.human_end[k],
        still,
        still,
        trace.human_radius,
        trace.human_names,
        trace.human_person,
    )
