"""From a BVH motion capture file to capsules.

``convert("walk.bvh").save("walk.npz")`` makes what :class:`~jssa_gym.humans.Recorded` plays. A BVH file is a tree of
joints with offsets and Euler angles (``HIERARCHY``) and a row of numbers a frame (``MOTION``). The frame of a joint in
its parent's is a translation, by its offset or, where it has position channels, by those instead, then the rotations in
the order of its channels, each about an axis that the ones before have turned. Position channels that are 0 in every
frame say nothing, and the offset holds.

Most limbs are bent: as one straight capsule from shoulder to hand, or from hip to ankle, which is the paper's body,
they leave it at the elbow or the knee. ``convert(..., body="jointed")`` gives every bone its own.
"""

from jssa_gym.humans.bvh.bodies import BODIES
from jssa_gym.humans.bvh.convert import CaptureOptions, Conversion, convert, convert_told
from jssa_gym.humans.bvh.guess import UNITS
from jssa_gym.humans.bvh.names import JOINTS
from jssa_gym.humans.bvh.reader import parse, read
from jssa_gym.humans.bvh.skeleton import Skeleton

__all__ = [
    "BODIES",
    "JOINTS",
    "UNITS",
    "CaptureOptions",
    "Conversion",
    "Skeleton",
    "convert",
    "convert_told",
    "parse",
    "read",
]
