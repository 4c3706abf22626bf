"""Capsules around triangles: nothing sticks out, by construction; several where one would be loose."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from jssa_gym.types import Array

MARGIN = 5e-4
"""Added to every radius [m]: rounding of files, and of single precision in meshes."""

_MOST = 3
"""Capsules that a link gets at most."""

LOOSE = 0.75
"""Share of one capsule's volume that two have to get by with, to be worth their time in every control step."""

_FILLED = 0.45
"""Share of a capsule that the hull of what it holds has to fill to be no reason to look for two."""

_ROUGH, _FINE = 100, 400
"""Capsules that are looked at along one axis: to compare cuts, and to keep."""

_EXACT = 1e-4
"""How well it is known how far a shape lies outside of capsules [m]."""

_HALVINGS = 12
"""How often a triangle's edges are halved at most to find that out; 0.4 m become 0.2 mm."""

_CUTS = (0.3, 0.5, 0.7)
"""Where along an axis a shape is cut to be enclosed by parts."""


_SIDES = np.array([sign * side for side in np.eye(3) for sign in (-1.0, 1.0)])
"""Where on a ball it is looked at to find out whether a capsule is loose."""

_BALL = np.array(
    [
        (np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt))
        for tilt in np.linspace(0.0, np.pi, 17)
        for turn in np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    ]
)
"""The same to say how loose it is: 2 % short of a ball's volume."""


class Enclosure(NamedTuple):
    """A capsule around something."""

    start: Array
    """Shape (3,) [m]."""
    end: Array
    """Shape (3,) [m]."""
    radius: float
    """[m]."""

    @property
    def volume(self) -> float:
        """[m³]."""
        return float(np.pi * self.radius**2 * (np.linalg.norm(self.end - self.start) + 4.0 / 3.0 * self.radius))


class Solid(NamedTuple):
    """Triangles, or lines and points, each thickened by a ball."""

    triangles: Array
    """Shape (t, 3, 3) [m]."""
    radius: Array
    """Radius of the balls, shape (t,) [m]."""

    def points(self) -> tuple[Array, Array]:
        """Corners that a convex shape has to hold to hold all of it, shape (p, 3) [m], and their balls', shape (p,)."""
        corners, radii = self.triangles.reshape(-1, 3), np.repeat(self.radius, 3)
        kept, kept_radii = [], []
        for radius in np.unique(radii):
            some = corners[radii == radius]
            some = some[_outermost(some)]
            kept.append(some)
            kept_radii.append(np.full(len(some), radius))
        return np.concatenate(kept), np.concatenate(kept_radii)


def joined(solids: list[Solid]) -> Solid:
    """Several as one."""
    return Solid(np.concatenate([one.triangles for one in solids]), np.concatenate([one.radius for one in solids]))


class Fit(NamedTuple):
    """A capsule and what it was made for."""

    capsule: Enclosure
    hull: float
    """Volume of the convex hull of what it holds [m³]; 0 where that is flat."""

    @property
    def ratio(self) -> float:
        """The capsule's volume over the hull's: what it wastes."""
        return self.capsule.volume / self.hull if self.hull > 0.0 else np.inf


def enclose(solid: Solid, most: int = _MOST, whole: Fit | None = None) -> list[Fit]:
    """Capsules that hold a shape, every triangle in one of them as a whole or cut where two meet.

    Args:
        solid: The shape, at least one triangle.
        most: How many at most.
        whole: One capsule around all of it; None to find it.
    """
    whole = whole or fit(solid)
    one = whole.capsule
    if most < 2 or _hull_volume(solid) > _FILLED * one.volume:
        return [whole]
    best = None
    for part_a, part_b in _parts(solid, one):
        pair = (around(part_a, _ROUGH), around(part_b, _ROUGH))
        volume = pair[0].volume + pair[1].volume
        if volume < LOOSE * one.volume and (best is None or volume < best[0]):
            best = volume, part_a, part_b
    if best is None:
        return [whole]
    _, part_a, part_b = best
    first = enclose(part_a, most - 1)
    return first + enclose(part_b, most - len(first))


def fit(solid: Solid) -> Fit:
    """One capsule around all of a shape."""
    return Fit(around(solid), _hull_volume(solid, _BALL))


def around(solid: Solid, effort: int = _FINE) -> Enclosure:
    """The capsule of least volume that was found around all of a shape, looking at ``effort`` about each axis."""
    points, radii = solid.points()
    centre = points.mean(axis=0)
    spread = _axes(points)
    scale = max(float(np.ptp(points, axis=0).max() + radii.max()), 1e-4)
    found = []
    for turned in range(3):
        frame = np.roll(spread, -turned, axis=0)
        local = (points - centre) @ frame.T

        def volume(x: Array, local: Array = local) -> float:
            start, end, radius = _fitted(local, radii, x * [1.0, 1.0, scale, scale, scale])
            return Enclosure(start, end, radius).volume

        low, high = local.min(axis=0), local.max(axis=0)
        guess = np.array([0.0, 0.0, *(low + high)[1:] / 2.0 / scale, 0.0])
        simplex = np.vstack([guess, guess + np.diag([0.1, 0.1, 0.05, 0.05, 0.05])])
        options = {"initial_simplex": simplex, "maxfev": effort, "xatol": 1e-4, "fatol": 1e-10}
        answer = minimize(volume, guess, method="Nelder-Mead", options=options)
        found.append((float(answer.fun), answer.x * [1.0, 1.0, scale, scale, scale], frame, local))
    _, x, frame, local = min(found, key=lambda one: one[0])
    start, end, radius = _fitted(local, radii, x)
    radius = np.ceil((radius + MARGIN) * 1e4) / 1e4
    return Enclosure(centre + start @ frame, centre + end @ frame, float(radius))


def outside(points: Array, radii: Array, capsules: list[Enclosure]) -> Array:
    """How far balls lie outside of the nearest of some capsules, shape (p,) [m]; negative inside."""
    nearest = np.full(len(points), np.inf)
    for start, end, radius in capsules:
        way = end - start
        share = np.clip((points - start) @ way / max(float(way @ way), 1e-30), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(points - start - share[:, None] * way, axis=1) - radius)
    return nearest + radii


def farthest_out(solid: Solid, capsules: list[Enclosure]) -> float:
    """How far the farthest point of a shape lies outside of the nearest of some capsules, to 0.1 mm [m].

    Negative if all corners lie inside; inf without capsules. Several capsules together are not convex: between corners
    that lie in different ones a triangle may reach out, so it is divided until its corners say what lies between.
    """
    if not capsules:
        return np.inf
    triangles, radius, worst, open_up_to = solid.triangles, solid.radius, -np.inf, -np.inf
    for _ in range(_HALVINGS):
        corners, radii = triangles.reshape(-1, 3), np.repeat(radius, 3)
        each = np.array([outside(corners, radii, [one]).reshape(-1, 3) for one in capsules])
        worst = max(worst, float(each.min(axis=0).max()))
        # the distance from one capsule is convex: at no point of a triangle is it larger than at its corners
        bound = each.max(axis=2).min(axis=0)
        still = bound > max(worst, 0.0) + _EXACT
        if not np.any(still):
            return worst
        triangles, radius, open_up_to = triangles[still], radius[still], float(bound[still].max())
        a, b, c = np.moveaxis(triangles, 1, 0)
        ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(one, axis=1) for one in quarters])
        radius = np.tile(radius, 4)
    return open_up_to


def _fitted(local: Array, radii: Array, x: Array) -> tuple[Array, Array, float]:
    """The least capsule about a line: slopes and offset of the line, and by how much more than needed it is thick."""
    way = np.array([1.0, x[0], x[1]])
    way /= np.linalg.norm(way)
    foot = np.array([0.0, x[2], x[3]])
    from_foot = local - foot
    along = from_foot @ way
    aside = np.linalg.norm(from_foot - along[:, None] * way, axis=1)
    radius = float((aside + radii).max()) + abs(float(x[4]))
    # how far the axis may end before a point without leaving it outside of the cap
    cap = np.sqrt(np.maximum((radius - radii) ** 2 - aside**2, 0.0))
    high, low = float((along - cap).max()), float((along + cap).min())
    if low > high:  # one ball holds all
        low = high = (low + high) / 2.0
    return foot + low * way, foot + high * way, radius


def _parts(solid: Solid, whole: Enclosure) -> list[tuple[Solid, Solid]]:
    """The shape cut across its longest directions, in two parts each."""
    points, _ = solid.points()
    axes = list(_axes(points))
    if (length := np.linalg.norm(whole.end - whole.start)) > 1e-6:
        axes.append((whole.end - whole.start) / length)
    found = []
    for axis in axes:
        heights = points @ axis
        for share in _CUTS:
            cut = _cut(solid, axis, float(heights.min() + share * np.ptp(heights)))
            if cut is not None:
                found.append(cut)
    return found


def _cut(solid: Solid, axis: Array, height: float) -> tuple[Solid, Solid] | None:
    """Both sides of a plane; triangles that cross it are cut, so that each side holds its part of them."""
    over = solid.triangles @ axis - height
    sides = [_side(solid, sign * over) for sign in (-1.0, 1.0)]
    return (sides[0], sides[1]) if all(len(side.triangles) for side in sides) else None


def _side(solid: Solid, over: Array) -> Solid:
    """What lies where the corners' heights, shape (t, 3), are not below 0."""
    on = over >= 0.0
    count = on.sum(axis=1)
    pieces = [Solid(solid.triangles[count == 3], solid.radius[count == 3])]
    for alone in (1, 2):
        some = count == alone
        if not np.any(some):
            continue
        # the corner that is alone on its side comes first; the plane cuts the two edges from it
        first = (on if alone == 1 else ~on)[some].argmax(axis=1)
        order = (first[:, None] + np.arange(3)) % 3
        d = np.take_along_axis(over[some], order, axis=1)
        a, b, c = np.moveaxis(np.take_along_axis(solid.triangles[some], order[:, :, None], axis=1), 1, 0)
        ab, ac = (a + (d[:, 0] / (d[:, 0] - d[:, k]))[:, None] * (end - a) for k, end in ((1, b), (2, c)))
        for corners in [(a, ab, ac)] if alone == 1 else [(ab, b, c), (ab, c, ac)]:
            pieces.append(Solid(np.stack(corners, axis=1), solid.radius[some]))
    return joined(pieces)


def _axes(points: Array) -> Array:
    """Directions of the spread of points, the longest first, as rows of an orthogonal matrix (3, 3)."""
    away = points - points.mean(axis=0)
    return np.linalg.eigh(away.T @ away)[1].T[::-1]


def _hull_volume(solid: Solid, sides: Array = _SIDES) -> float:
    """The hull's volume, of points on the balls around a shape, on these sides of their centres [m³]."""
    points, radii = solid.points()
    corners = np.concatenate([points + radii[:, None] * side for side in sides])
    try:
        return float(ConvexHull(corners).volume)
    except QhullError:  # flat
        return 0.0


def _outermost(points: Array) -> NDArray[np.integer]:
    """Indices of points whose hull is that of all."""
    if len(points) < 20:
        return np.arange(len(points))
    try:
        return ConvexHull(points).vertices
    except QhullError:  # flat: all count
        return np.arange(len(points))
