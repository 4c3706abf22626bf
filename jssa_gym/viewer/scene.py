"""What is drawn of a moment: arms, table, people, goal, critical pair, and what a verified stop sees."""

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from jssa_gym.envs.world import SCENES, World
from jssa_gym.palette import GREEN, RED, SKY, rgb
from jssa_gym.types import Array, CapsuleSet, Status
from jssa_gym.viewer.capsules import CapsuleBatch
from jssa_gym.viewer.choices import DRAGGED
from jssa_gym.viewer.gate import Speech
from jssa_gym.viewer.person import HANDS
from jssa_gym.viewer.shapes import looks
from jssa_gym.viewer.snapshot import ArmView, Snapshot
from jssa_gym.viewer.words import COLOURS, WORDS

APART = 2.6
"""Distance between two arms [m]: each has the same person beside it."""

_LEVEL = 1e-9
"""A ray that rises or falls less than this meets the floor nowhere [m]."""

LAYERS = {
    "body": "arm as it looks",
    "capsules": "arm's capsules in the colour of the status",
    "people": "people",
    "goal": "goal",
    "pair": "critical pair and its distance",
    "stop": "the arm on its way to rest, if it stopped now",
    "reach": "where people can be by then",
}
"""What can be shown or not, in words."""

SHOWN = ("body", "capsules", "people", "goal", "pair")
"""What is at first."""

_CLOTHES = {
    "head": (219, 171, 140),
    "core_body": (52, 108, 174),
    "right_arm": (72, 132, 196),
    "left_arm": (72, 132, 196),
    "right_leg": (58, 66, 86),
    "left_leg": (58, 66, 86),
}
_CLOTH = (120, 128, 142)
_STOP, _REACH, _GOAL, _LINE = rgb(RED), rgb(SKY), rgb(GREEN), (204, 51, 51)

Drag = Callable[[str, tuple[float, ...]], None]
"""What a dragged body part does: its name, and where the mouse is on the floor (2,) or in the world (3,) [m]."""


class SceneryOfArm:
    """One arm, its table, and the people beside it.

    Args:
        server: viser.
        name: Of the node.
        aside: Where it stands along y [m].
        view: What it is of.
        people: Who is there.
        world: What the arm looks like.
    """

    def __init__(
        self, server: viser.ViserServer, name: str, aside: float, view: ArmView, people: CapsuleSet, world: World
    ) -> None:
        self._name, self._world, scene = name, world, server.scene
        self.aside = aside
        scene.add_frame(name, show_axes=False, position=(0.0, aside, 0.0))
        height = float(world.robot.mount[2])
        if height > 0.0:
            scene.add_box(f"{name}/table/top", (186, 189, 194), (0.68, 0.80, 0.04), position=(0.03, 0.0, height - 0.02))
            legs = height - 0.04
            scene.add_box(f"{name}/table/body", (92, 98, 107), (0.60, 0.72, legs), position=(0.03, 0.0, legs / 2.0))
        meshes = looks(world)
        self._bodies = {body: scene.add_frame(f"{name}/body/{body}", show_axes=False) for body in meshes}
        for body, parts in meshes.items():
            for k, part in enumerate(parts):
                scene.add_mesh_simple(
                    f"{name}/body/{body}/{k}", part.mesh.vertices, part.mesh.faces, color=part.colour,
                    flat_shading=True, cast_shadow=False, receive_shadow=False,
                )  # fmt: skip
        m = len(view.capsules.radius)
        self._capsules = CapsuleBatch(
            server, f"{name}/capsules", np.tile(COLOURS[Status.NOMINAL], (m, 1)), 0.3 if meshes else None
        )
        clothes = np.array([_CLOTHES.get(part, _CLOTH) for part in people.names]).reshape(-1, 3)
        self.people = CapsuleBatch(server, f"{name}/people", clothes) if len(clothes) else None
        self._reach = (
            CapsuleBatch(server, f"{name}/reach", np.tile(_REACH, (len(clothes), 1)), 0.16) if len(clothes) else None
        )
        self._stop: CapsuleBatch | None = None
        self._server = server
        self._goal = scene.add_icosphere(f"{name}/goal", 0.03, _GOAL, cast_shadow=False)
        self._halo = scene.add_icosphere(f"{name}/halo", 0.07, _GOAL, opacity=0.25, cast_shadow=False)
        self._line = CapsuleBatch(server, f"{name}/pair", np.tile(_LINE, (3, 1)))
        self._far = scene.add_label(f"{name}/distance", "", anchor="bottom-center")
        self._label = scene.add_label(
            f"{name}/label",
            view.name,
            position=(0.0, 0.0, height + 1.35),
            anchor="bottom-center",
            font_screen_scale=1.2,
        )

    def show(self, view: ArmView, people: CapsuleSet, layers: set[str]) -> None:
        """A moment."""
        if self._bodies:
            self._world.pose(view.position)
            for body, handle in self._bodies.items():
                handle.visible = "body" in layers
                handle.position, handle.wxyz = self._world.data.xpos[body], self._world.data.xquat[body]
        capsules = view.capsules
        self._capsules.show(capsules.start, capsules.end, capsules.radius * (1.0 if self._bodies else 0.999))
        self._capsules.paint(COLOURS[view.status])
        self._capsules.appear("capsules" in layers or not self._bodies)
        if self.people is not None:
            self.people.show(people.start, people.end, people.radius)
            self.people.appear("people" in layers)
        self._show_overlays(view, layers)
        goal = view.goal
        for handle in (self._goal, self._halo):
            handle.visible = goal is not None and "goal" in layers
            if goal is not None:
                handle.position = goal
        self._show_pair(view, "pair" in layers)
        if self._label.text != (text := f"{view.name}: {WORDS[view.status]}"):
            self._label.text = text

    def _show_overlays(self, view: ArmView, layers: set[str]) -> None:
        stop, reach = view.stop, view.reach
        if stop is not None:
            if self._stop is None:
                self._stop = CapsuleBatch(
                    self._server, f"{self._name}/stop", np.tile(_STOP, (len(stop.radius), 1)), 0.12
                )
            self._stop.show(*stop)
        if self._stop is not None:
            self._stop.appear(stop is not None and "stop" in layers)
        if self._reach is not None:
            if reach is not None:
                self._reach.show(*reach)
            self._reach.appear(reach is not None and "reach" in layers)

    def _show_pair(self, view: ArmView, wanted: bool) -> None:
        shown = wanted and view.line is not None
        self._line.appear(shown)
        self._far.visible = shown
        if view.line is not None:
            one, other = view.line
            self._line.show(np.array([one, one, other]), np.array([other, one, other]), np.array([0.006, 0.014, 0.014]))
            self._far.position = (one + other) / 2.0
            self._far.text = f"{view.distance:.2f} m"


class Picture:
    """The whole scene, made anew when what is played changes.

    Args:
        server: viser.
        speech: Where it is entered which nodes can be dragged.
        drag: Called, in viser's thread, with what the mouse does to the person.
    """

    def __init__(self, server: viser.ViserServer, speech: Speech, drag: Drag) -> None:
        self._server, self._speech, self._drag = server, speech, drag
        self._arms: list[SceneryOfArm] = []
        self._epoch = -1
        self._shown: tuple[int, int, frozenset[str]] | None = None
        """Moment, commands until then and layers that were sent last."""
        self._looked: tuple[str, World] | None = None
        self._people: CapsuleSet | None = None
        self._grabs: dict[int, tuple[float, Array]] = {}
        """By visitor: height of the point that was grabbed, and from there to what is moved [m]."""
        server.scene.world_axes.visible = False
        server.scene.add_grid("/floor", 16.0, 16.0, cell_size=0.5, section_size=1.0, cell_color=(232, 234, 238),
                              section_color=(214, 217, 222), shadow_opacity=0.0)  # fmt: skip

    def show(self, snapshot: Snapshot, layers: set[str]) -> bool:
        """A moment; whether anything was sent."""
        with self._server.atomic():
            now = snapshot.number, snapshot.answered, frozenset(layers)
            if snapshot.epoch != self._epoch:
                self._build(snapshot)
            elif now == self._shown:
                return False
            self._shown, self._people = now, snapshot.people
            for arm, view in zip(self._arms, snapshot.arms, strict=True):
                arm.show(view, snapshot.people, layers)
        return True

    def _build(self, snapshot: Snapshot) -> None:
        for name in [f"/arm{k}" for k in range(len(self._arms))]:
            self._server.scene.remove_by_name(name)
        self._speech.nodes.clear()
        robot = snapshot.robot
        scene = next((name for name, height in SCENES.items() if height == robot.mount[2]), "floor")
        if self._looked is None or self._looked[0] != robot.name:
            self._looked = robot.name, World(robot, scene)
        world, count = self._looked[1], len(snapshot.arms)
        self._arms = [
            SceneryOfArm(self._server, f"/arm{k}", APART * ((count - 1) / 2.0 - k), view, snapshot.people, world)
            for k, view in enumerate(snapshot.arms)
        ]
        self._epoch = snapshot.epoch
        self._grabs.clear()
        if snapshot.choices.human == DRAGGED and not snapshot.scrubbed:
            for arm in self._arms:
                if arm.people is not None:
                    self._let_drag(arm.people, snapshot.people.names, arm.aside)

    def _let_drag(self, people: CapsuleBatch, names: tuple[str, ...], aside: float) -> None:
        """Let every capsule of the person be taken by the mouse."""
        for handle, parts in ((people.tubes, names), (people.domes, names * 2)):
            self._speech.nodes[handle.name] = len(parts)

            # as a coroutine: others of viser's callbacks may overtake each other
            async def dragged(event: Any, parts: tuple[str, ...] = parts) -> None:
                self.follow(event, parts[event.instance_index], np.array([0.0, aside, 0.0]))

            handle.on_drag("left")(dragged)

    def follow(self, event: Any, part: str, origin: Array) -> None:
        """Move a part to where the pointer is, in the plane of the floor, or a hand in that of the screen."""
        people, pointer = self._people, np.array(event.end_position) - origin
        if event.phase == "end" or people is None:
            self._grabs.pop(event.client_id, None)
            return
        hand = part in HANDS
        if event.phase == "start" or event.client_id not in self._grabs:
            # what is grabbed stays under the pointer
            held = people.end[people.names.index(part)] if hand else people.start[people.names.index("core_body")]
            grabbed = np.array(event.start_position) - origin
            self._grabs[event.client_id] = float(grabbed[2]), held - grabbed
        height, offset = self._grabs[event.client_id]
        if hand:
            self._drag(part, tuple((pointer + offset).tolist()))
            return
        eye = np.array(event.client.camera.position) - origin
        ray = pointer - eye
        # the pointer is not beyond the horizon, nor so near to it that the place is nowhere
        if abs(ray[2]) > _LEVEL and ray[2] * (height - eye[2]) > 0.0:
            pointer = eye + ray * (height - eye[2]) / ray[2]
        self._drag(part, tuple((pointer + offset)[:2].tolist()))
