"""A skeleton as a BVH file has it, and where its joints are."""

from dataclasses import dataclass, field

import numpy as np

from jssa_gym.types import Array


@dataclass(frozen=True, slots=True, eq=False)
class Skeleton:
    """A BVH file as it is: its units, its axes."""

    names: tuple[str, ...]
    """Names of the joints, each after its parent."""
    parents: tuple[int, ...]
    """-1 for the root."""
    offsets: Array
    """Place of each joint in its parent's frame, shape (j, 3)."""
    channels: tuple[tuple[str, ...], ...]
    """Channels of each joint, in their order."""
    frames: Array
    """Values of all channels, shape (T, c); angles in degrees."""
    frame_time: float
    """[s]."""
    tip_parents: tuple[int, ...] = ()
    """Joint of each end site."""
    tip_offsets: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Place of each end site in its joint's frame, shape (k, 3)."""

    def positions(self) -> Array:
        """Where the joints are, by forward kinematics, shape (T, j, 3)."""
        return self._kinematics()[0]

    def points(self) -> Array:
        """Where the joints are and, after them, the end sites, shape (T, j + k, 3)."""
        places, turns = self._kinematics()
        tips = [
            places[:, joint] + np.einsum("tij,j->ti", turns[joint], offset)
            for joint, offset in zip(self.tip_parents, self.tip_offsets, strict=True)
        ]
        return np.concatenate([places, *(tip[:, None] for tip in tips)], axis=1)

    @property
    def point_parents(self) -> tuple[int, ...]:
        """Parents of all :meth:`points`."""
        return (*self.parents, *self.tip_parents)

    @property
    def point_names(self) -> tuple[str, ...]:
        """Names of all :meth:`points`."""
        return (*self.names, *(f"the end site of {self.names[joint]}" for joint in self.tip_parents))

    def turned(self) -> Array:
        """Largest angle by which any joint but the root is turned against its parent's frame, shape (T,) [deg]."""
        rotations = [
            column
            for column, (joint, channel) in enumerate((j, c) for j, own in enumerate(self.channels) for c in own)
            if self.parents[joint] >= 0 and channel.endswith("rotation")
        ]
        angles = np.abs((self.frames[:, rotations] + 180.0) % 360.0 - 180.0)
        return angles.max(axis=1, initial=0.0)

    def path(self, one: int, other: int) -> list[int]:
        """Points on the way along the bones from one to another, both included."""
        up, down = [one], [other]
        parents = self.point_parents
        while up[-1] != down[-1]:
            # whoever was made later is not above the other; end sites come after all joints
            longer = up if up[-1] > down[-1] else down
            longer.append(parents[longer[-1]])
        return up + down[-2::-1]

    def below(self, joint: int) -> list[int]:
        """Points that hang on a joint, nearer ones first."""
        hanging = [joint]
        for point, parent in enumerate(self.point_parents):
            if parent in hanging and point > joint:
                hanging.append(point)
        return hanging[1:]

    def _kinematics(self) -> tuple[Array, Array]:
        """Joints' places (T, j, 3) and frames (j, T, 3, 3)."""
        count = len(self.frames)
        places, turns = np.empty((count, len(self.names), 3)), np.empty((len(self.names), count, 3, 3))
        column = 0
        for j, parent in enumerate(self.parents):
            shift, turn = np.tile(self.offsets[j], (count, 1)), np.tile(np.eye(3), (count, 1, 1))
            own = range(column, column + len(self.channels[j]))
            moves = [k for k, channel in zip(own, self.channels[j], strict=True) if channel.endswith("position")]
            # where a joint is in its parent's frame, instead of its offset; nothing but zeros says nothing
            told = bool(self.frames[:, moves].any())
            for k, channel in zip(own, self.channels[j], strict=True):
                axis, values = "XYZ".index(channel[0]), self.frames[:, k]
                if channel.endswith("rotation"):
                    turn = turn @ _about(axis, np.radians(values))
                elif told:
                    shift[:, axis] = values
            column += len(self.channels[j])
            if parent < 0:
                places[:, j], turns[j] = shift, turn
            else:
                places[:, j] = places[:, parent] + np.einsum("tij,tj->ti", turns[parent], shift)
                turns[j] = turns[parent] @ turn
        return places, turns


def bones(points: Array, parents: tuple[int, ...]) -> Array:
    """Length of every point's bone, from its parent, in the median of the frames; 0 of the root; shape (j + k,)."""
    lengths = np.zeros(len(parents))
    for point, parent in enumerate(parents):
        if parent >= 0:
            lengths[point] = np.median(np.linalg.norm(points[:, point] - points[:, parent], axis=-1))
    return lengths


def _about(axis: int, angle: Array) -> Array:
    """Rotations about a coordinate axis, shape (T, 3, 3)."""
    out = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[:, axis, axis] = 1.0
    out[:, i, i] = out[:, j, j] = np.cos(angle)
    out[:, j, i] = np.sin(angle)
    out[:, i, j] = -out[:, j, i]
    return out
