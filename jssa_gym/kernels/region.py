r"""Where everybody is seen: a union of convex pieces, and how far capsules are inside and outside of it.

A piece is what its faces leave: each is the half-space beyond it, ``normal · x <= offset`` with the normal pointing
into the piece. Through a *closed* face, a floor or a wall, nobody comes; only the open ones have to be kept off.
Faces are of ``FACE``, those of piece p from ``pieces[p]`` up to ``pieces[p + 1]``.
"""

import numpy as np

from jssa_gym.kernels.capsules import plane_pair
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.vector import along, dot


@jit
def room_inside(start, end, radius, faces, pieces):
    """How far all of a capsule is at least from wherever somebody could come in [m].

    Of some piece it is that far from every open face; below 0, or -inf, where it is wholly inside of none.
    """
    room = -np.inf
    for p in range(pieces.shape[0] - 1):
        least = np.inf
        for f in range(pieces[p], pieces[p + 1]):
            if faces[f]["closed"]:
                continue
            gap, _ = plane_pair(start, end, radius, faces[f])
            if not (gap >= least):
                least = gap
        if least > room:  # a NaN is no room
            room = least
    return room


@jit
def outside(start, end, radius, faces, pieces):
    """Whether a capsule is wholly outside: of every piece it is beyond one of the faces."""
    for p in range(pieces.shape[0] - 1):
        beyond = False
        for f in range(pieces[p], pieces[p + 1]):
            normal, offset = faces[f]["normal"], faces[f]["offset"] - radius
            beyond = beyond or (dot(normal, start) < offset and dot(normal, end) < offset)
        if not beyond:
            return False
    return True


@jit
def _shallowest(point, faces, first, last):
    """How far a point is from the nearest open face of a piece [m]."""
    least = np.inf
    for f in range(first, last):
        if not faces[f]["closed"]:
            depth = dot(faces[f]["normal"], point) - faces[f]["offset"]
            if not (depth >= least):
                least = depth
    return least


@jit
def deepest(start, end, radius, faces, pieces):
    """How far the innermost point of a capsule is at most from where it can have come in [m]; NaN where nobody knows.

    Along the axis the distance to the nearest open face is concave and made of straight lines: its maximum is at an end
    or where two faces are equally far.
    """
    most = -np.inf
    for p in range(pieces.shape[0] - 1):
        first, last = pieces[p], pieces[p + 1]
        inmost = max(_shallowest(start, faces, first, last), _shallowest(end, faces, first, last))
        for f in range(first, last):
            for g in range(first, f):
                begin = dot(faces[f]["normal"], start) - faces[f]["offset"]
                begin -= dot(faces[g]["normal"], start) - faces[g]["offset"]
                finish = dot(faces[f]["normal"], end) - faces[f]["offset"]
                finish -= dot(faces[g]["normal"], end) - faces[g]["offset"]
                if begin * finish < 0.0:
                    there = along(start, end, begin / (begin - finish))
                    inmost = max(inmost, _shallowest(there, faces, first, last))
        if not (inmost <= most):
            most = inmost
    return most + radius
