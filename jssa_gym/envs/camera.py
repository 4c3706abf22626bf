"""Where a picture is taken from: far enough to have all in the frame, and from a side where people hide little."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jssa_gym.types import Array, CapsuleSet

FIELD = 38.0
"""Vertical field of view [degrees]."""

_ROOM = 0.93
"""Share of the picture, from its middle, that what is framed may fill."""

_NEAREST = 0.1
"""No ball is nearer to the eye [m]."""

ELEVATION = -12.0
"""Elevation of cameras unless told otherwise: a little from above [degrees]."""

_SIDES = tuple(range(0, 360, 15))
"""Directions that a camera may be chosen from [degrees]."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole camera, by MuJoCo's numbers for one that looks at a point."""

    azimuth: float
    """Direction of looking, counted from +x towards +y [degrees]."""
    elevation: float
    """Elevation of looking, negative downwards [degrees]."""
    distance: float
    """From the eye to the point that is looked at [m]."""
    lookat: Array
    """That point, shape (3,) [m]."""

    @property
    def axes(self) -> Array:
        """Unit vectors to the right, up and ahead in the picture, rows of shape (3, 3)."""
        return _axes(self.azimuth, self.elevation)

    @property
    def eye(self) -> Array:
        """Where it stands, shape (3,) [m]."""
        return self.lookat - self.distance * self.axes[2]

    def project(self, points: Array, aspect: float = 1.0) -> Array:
        """Where points (k, 3) [m] are in a picture, shape (k, 2): -1 to 1 from left to right and from below to above.

        Args:
            points: In the world; NaN where behind the camera.
            aspect: Width of the picture over its height.
        """
        right, up, ahead = ((points - self.eye) @ self.axes.T).T
        tan = np.tan(np.radians(FIELD) / 2.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.stack([right / (ahead * tan * aspect), up / (ahead * tan)], axis=-1)
        return np.where(ahead[:, None] > 0.0, seen, np.nan)


def framing(points: Array, radius: Array, azimuth: float, elevation: float = ELEVATION, aspect: float = 1.0) -> Camera:
    """The nearest camera of a direction that has all in its picture.

    Seen along the axes of the picture, a ball is inside if it is inside of the four planes through the eye; the
    outermost balls say where the planes are, and those, in pairs, where the eye is.

    Args:
        points: Middles of balls, shape (k, 3) [m], at least one.
        radius: Of the balls, shape (k,) [m].
        azimuth, elevation: See :class:`Camera`.
        aspect: Width of the picture over its height.
    """
    axes = _axes(azimuth, elevation)
    right, up, ahead = (points @ axes.T).T
    tan = _ROOM * np.tan(np.radians(FIELD) / 2.0) * np.array([aspect, 1.0])
    middle, depth = np.empty(2), np.empty(2)
    for k, (across, slope) in enumerate(zip((right, up), tan, strict=True)):
        grown = radius * np.sqrt(1.0 + slope**2)
        most, least = (across - slope * ahead + grown).max(), (-across - slope * ahead + grown).max()
        middle[k], depth[k] = (most - least) / 2.0, -(most + least) / (2.0 * slope)
    # nothing may be behind the eye either
    back = min(float(depth.min()), float((ahead - radius).min()) - _NEAREST)
    distance = float(np.median(ahead)) - back
    return Camera(azimuth, elevation, distance, np.array([*middle, back + distance]) @ axes)


def chosen(
    points: Array,
    radius: Array,
    moments: Sequence[tuple[Array, CapsuleSet, tuple[Array, Array] | None]],
    elevation: float = ELEVATION,
    aspect: float = 1.0,
) -> Camera:
    """A camera that frames all and, of all sides, has people hide the arm least and the shortest line be longest.

    Args:
        points, radius: What has to be in the picture, see :func:`framing`.
        moments: Points of the arm (k, 3) [m], the people then, and the ends of the shortest line between them.
        elevation: See :class:`Camera`.
        aspect: Width of the picture over its height.
    """

    def merit(camera: Camera) -> float:
        hidden = np.mean([hides(camera.eye, arm, people).sum() for arm, people, _ in moments]) if moments else 0.0
        across = [np.linalg.norm((b - a) @ camera.axes[:2].T) / max(np.linalg.norm(b - a), 1e-9) for a, b in lines]
        return -3.0 * float(hidden) + float(np.mean(across or [0.0])) - 0.15 * camera.distance

    lines = [line for *_, line in moments if line is not None]
    return max((framing(points, radius, azimuth, elevation, aspect) for azimuth in _SIDES), key=merit)


def hides(eye: Array, points: Array, people: CapsuleSet) -> Array:
    """Share of points (k, 3) [m] that each capsule hides from an eye (3,) [m], shape (m,)."""
    if not len(people.radius) or not len(points):
        return np.zeros(len(people.radius))
    return _behind(eye, points, people).mean(axis=0)


def _behind(eye: Array, points: Array, people: CapsuleSet) -> NDArray[np.bool_]:
    """Whether the line from the eye to each point meets each capsule, shape (k, m)."""
    ray, bone = points - eye, people.end - people.start  # (k, 3), (m, 3)
    off = eye - people.start  # (m, 3)
    a, b, c = (ray**2).sum(axis=1)[:, None], ray @ bone.T, (bone**2).sum(axis=1)[None]
    d, e = ray @ off.T, (bone * off).sum(axis=1)[None]
    # closest points of two segments: along the ray first, then along the bone, then along the ray again
    determinant = np.maximum(a * c - b * b, 1e-12)
    s = np.clip((b * e - c * d) / determinant, 0.0, 1.0)
    t = np.clip((b * s + e) / np.maximum(c, 1e-12), 0.0, 1.0)
    s = np.clip((b * t - d) / np.maximum(a, 1e-12), 0.0, 1.0)
    gap = off[None] + s[..., None] * ray[:, None] - t[..., None] * bone[None]
    return (gap**2).sum(axis=-1) < people.radius**2


def balls_of(people: Iterable[CapsuleSet]) -> tuple[Array, Array]:
    """Both ends of all capsules as balls: points (k, 3) [m] and radii (k,) [m]."""
    sets = list(people)
    points = [np.zeros((0, 3)), *(end for one in sets for end in (one.start, one.end))]
    radius = [np.zeros(0), *(one.radius for one in sets for _ in range(2))]
    return np.concatenate(points), np.concatenate(radius)


def _axes(azimuth: float, elevation: float) -> Array:
    turn, tilt = np.radians(azimuth), np.radians(elevation)
    ahead = np.array([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)])
    right = np.array([np.sin(turn), -np.cos(turn), 0.0])
    return np.stack([right, np.cross(right, ahead), ahead])
