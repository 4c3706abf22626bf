"""Capsules on the page."""

from typing import Any

import numpy as np
import viser

from jssa_gym.types import Array
from jssa_gym.viewer.shapes import dome, tube, turned_to


class CapsuleBatch:
    """Capsules that move, stretch and grow: two messages a moment, however many there are.

    Args:
        server: viser.
        name: Of the node.
        colours: One a capsule, shape (k, 3).
        opacity: Of all; None for solid ones.
    """

    def __init__(self, server: viser.ViserServer, name: str, colours: Array, opacity: float | None = None) -> None:
        k = len(colours)
        self.colours = np.array(colours, np.uint8).reshape(-1, 3)
        common: dict[str, Any] = {"opacity": opacity, "lod": "off", "cast_shadow": False, "receive_shadow": False}
        nowhere = np.zeros((k, 3), np.float32)
        upright = np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (k, 1))
        self.tubes = server.scene.add_batched_meshes_simple(
            f"{name}/middle",
            *tube(),
            upright,
            nowhere,
            batched_scales=nowhere + 1e-6,
            batched_colors=self.colours,
            **common,
        )
        self.domes = server.scene.add_batched_meshes_simple(
            f"{name}/ends", *dome(), np.tile(upright, (2, 1)), np.tile(nowhere, (2, 1)),
            batched_scales=np.tile(nowhere + 1e-6, (2, 1)), batched_colors=np.tile(self.colours, (2, 1)), **common,
        )  # fmt: skip

    def show(self, start: Array, end: Array, radius: Array) -> None:
        """Move the capsules: starts and ends (k, 3), radii (k,) [m]."""
        along = end - start
        length = np.linalg.norm(along, axis=1)
        up, down = turned_to(along), turned_to(-along)
        r = np.asarray(radius, np.float32)
        self.tubes.batched_positions = start.astype(np.float32)
        self.tubes.batched_wxyzs = up
        self.tubes.batched_scales = np.stack([r, r, np.maximum(length, 1e-6)], axis=1).astype(np.float32)
        self.domes.batched_positions = np.concatenate([start, end]).astype(np.float32)
        self.domes.batched_wxyzs = np.concatenate([np.where(length[:, None] > 1e-9, down, _DOWN), up])
        self.domes.batched_scales = np.tile(r[:, None], (2, 3)).astype(np.float32)

    def paint(self, colour: tuple[int, int, int]) -> None:
        """All in one colour."""
        if not np.array_equal(self.colours[0], colour):
            self.colours = np.tile(np.array(colour, np.uint8), (len(self.colours), 1))
            self.tubes.batched_colors, self.domes.batched_colors = self.colours, np.tile(self.colours, (2, 1))

    def appear(self, visible: bool) -> None:
        """Show or hide all."""
        for part in (self.tubes, self.domes):
            if part.visible != visible:
                part.visible = visible


_DOWN = np.array([0.0, 1.0, 0.0, 0.0], np.float32)
"""The turn of a sphere's lower half."""
