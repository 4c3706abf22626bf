"""What a person can reach of an arm: nearest links, by walking and by hand."""

import numpy as np

from jssa_gym.kernels.capsules import capsule_pair
from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.vector import along


@jit
def nearest_to_point(point, start, end, radius):
    """The capsule nearest to a point, by surface distance.

    Args:
        point: Three coordinates [m].
        start, end: Capsule ends, shape (m, 3) [m].
        radius: Shape (m,) [m].

    Returns:
        Distance [m] and the closest point of the capsule's axis, a tuple [m]; inf and the point without capsules.
    """
    nearest, closest = np.inf, (point[0], point[1], point[2])
    for i in range(radius.shape[0]):
        distance, s, _ = capsule_pair(start[i], end[i], point, point, radius[i])
        if distance < nearest:
            nearest, closest = distance, along(start[i], end[i], s)
    return nearest, closest


@part
def nearest_to_walker(start, end, radius, x, y, link_start, link_end, link_radius):
    """The robot capsule that a standing body can touch soonest by walking.

    Pairs whose closest axis points differ in height by more than both radii are overlooked, unless all do: a walker
    cannot close such a gap.

    Args:
        start, end: Body capsules relative to the root, shape (m, 3) [m].
        radius: Shape (m,) [m].
        x, y: Root [m].
        link_start, link_end: Robot capsules, shape (k, 3) [m].
        link_radius: Shape (k,) [m].

    Returns:
        Surface distance [m], and x and y of the way from the body's axis point to the robot's [m]; inf, 0, 0 without
        a robot.
    """
    nearest, way_x, way_y, level = np.inf, 0.0, 0.0, False
    for i in range(radius.shape[0]):
        a = (start[i, 0] + x, start[i, 1] + y, start[i, 2])
        b = (end[i, 0] + x, end[i, 1] + y, end[i, 2])
        for j in range(link_radius.shape[0]):
            radii = radius[i] + link_radius[j]
            distance, s, r = capsule_pair(a, b, link_start[j], link_end[j], radii)
            own, link = along(a, b, s), along(link_start[j], link_end[j], r)
            touchable = abs(link[2] - own[2]) < radii
            if (touchable and not level) or (touchable == level and distance < nearest):
                nearest, way_x, way_y, level = distance, link[0] - own[0], link[1] - own[1], touchable
    return nearest, way_x, way_y
