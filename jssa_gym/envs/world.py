"""The MuJoCo side of a scene: pictures, and the servoed arm."""

import threading
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.opengl import open_renderer
from jssa_gym.exceptions import DisplayError, RobotModelError
from jssa_gym.headless import choose_gl_backend, has_display
from jssa_gym.robots import RobotModel
from jssa_gym.robots.mjcf import COLLISION_GROUP
from jssa_gym.types import Array, CapsuleSet, Planes
from jssa_gym.validation import known_name

if TYPE_CHECKING:
    import mujoco

TABLE_HEIGHT = 0.87
"""The paper's table [m]; the robot's base stands on it."""

SCENES: dict[str, float] = {"table": TABLE_HEIGHT, "floor": 0.0}
"""Height of the robot's base by the name of the scene [m]."""

_CLOTHES = {
    "head": (0.86, 0.67, 0.55, 1.0),
    "core_body": (0.20, 0.42, 0.68, 1.0),
    "right_arm": (0.24, 0.48, 0.76, 1.0),
    "left_arm": (0.24, 0.48, 0.76, 1.0),
    "right_leg": (0.22, 0.25, 0.33, 1.0),
    "left_leg": (0.22, 0.25, 0.33, 1.0),
}
SUBSTEP = 0.001
"""Period of the position servos [s]."""

_CAMERA = ("azimuth", "elevation", "distance", "lookat", "type", "fixedcamid", "trackbodyid")
"""What a camera is, for MuJoCo's own cannot be pickled."""


def planes_of(scene: str) -> Planes:
    """The solid half-space that the arm must stay above.

    Raises:
        ParameterError: Unknown scene.
    """
    known_name("scene", scene, SCENES)
    return Planes(np.array([[0.0, 0.0, 1.0]]), np.array([SCENES[scene]]), (scene,))


class World:
    """A compiled MuJoCo model of robot, table and floor.

    Args:
        robot: The arm, where it stands.
        scene: A key of :data:`SCENES`.
        pretty: Shadows and multisampling, for pictures that people keep; ten times slower.
        width, height: Size of pictures [pixels].
    """

    def __init__(
        self, robot: RobotModel, scene: str, *, pretty: bool = False, width: int = 640, height: int = 480
    ) -> None:
        choose_gl_backend()
        import mujoco

        self._mujoco = mujoco
        self.robot = robot
        self.pretty = pretty
        self._size = (height, width)
        spec = mujoco.MjSpec()
        _decorate(spec, scene, pretty, width, height)
        frame = spec.worldbody.add_frame(pos=robot.mount.tolist())
        arm = mujoco.MjSpec.from_file(str(robot.mjcf))
        for geom in arm.geoms:
            # the shield keeps the arm off itself; MuJoCo would push apart what overlaps by its make
            geom.contype = geom.conaffinity = 0
        spec.attach(arm, prefix="robot/", frame=frame)
        spec.option.timestep = SUBSTEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        moving = self.model.geom_bodyid > 0
        # an arm without a visual body is drawn by its capsules
        self._show_capsules = not bool(np.any(self.model.geom_group[moving] != COLLISION_GROUP))
        self._renderer: mujoco.Renderer | None = None
        self._window = None
        self._window_threads: set[threading.Thread] = set()
        self.camera = mujoco.MjvCamera()
        self.camera.azimuth, self.camera.elevation, self.camera.distance = 98.0, -10.0, 3.1
        self.camera.lookat[:] = robot.mount + np.array([0.5, 0.0, 0.27])

    def __getstate__(self) -> dict[str, Any]:
        """The simulated arm as it is; renderer and window stay here, a copy opens its own."""
        camera = {name: np.array(getattr(self.camera, name)) for name in _CAMERA}
        none = {"_mujoco": None, "model": None, "_renderer": None, "_window": None, "_window_threads": set()}
        return {**self.__dict__, **none, "camera": camera}

    def __setstate__(self, state: dict[str, Any]) -> None:
        choose_gl_backend()
        import mujoco

        # the data come with their model
        self.__dict__.update(state, _mujoco=mujoco, model=state["data"].model, camera=mujoco.MjvCamera())
        for name, value in state["camera"].items():
            setattr(self.camera, name, value if value.ndim else value.item())

    def pose(self, position: Array) -> None:
        """Set the joints, shape (n,) [rad]; for pictures."""
        self.data.qpos[:] = position
        self._mujoco.mj_kinematics(self.model, self.data)
        self._mujoco.mj_camlight(self.model, self.data)

    def picture(
        self,
        position: Array,
        humans: CapsuleSet,
        *,
        pair: tuple[Array, Array] | None = None,
        goal: Array | None = None,
        capsules: bool = False,
    ) -> NDArray[np.uint8]:
        """Draw a moment, shape (height, width, 3).

        Args:
            position: Joint position, shape (n,) [rad].
            humans: People.
            pair: The two ends of the critical point pair [m], drawn as a line.
            goal: A point to mark [m].
            capsules: Whether the arm's capsules are drawn over what it draws.

        Raises:
            DisplayError: There is no OpenGL, or it belongs to another thread.
        """
        mujoco = self._mujoco
        if self._renderer is None:
            self._renderer = open_renderer(self.model, *self._size)
        self.pose(position)
        option = mujoco.MjvOption()
        option.geomgroup[COLLISION_GROUP] = self._show_capsules or capsules
        self._renderer.update_scene(self.data, camera=self.camera, scene_option=option)
        scene = self._renderer.scene
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = self.pretty
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._draw(scene, humans, pair, goal)
        try:
            return self._renderer.render()
        except Exception as error:  # every backend has errors of its own
            raise DisplayError(
                "OpenGL draws no more: all pictures of one environment have to be drawn in the thread that drew the "
                f"first one ({' '.join(str(error).split())})"
            ) from error

    def show(
        self,
        position: Array,
        humans: CapsuleSet,
        *,
        pair: tuple[Array, Array] | None = None,
        goal: Array | None = None,
    ) -> None:
        """Draw a moment in a window; arguments as of :meth:`picture`.

        Raises:
            DisplayError: There is no display.
        """
        if self._window is None:
            if not has_display():
                raise DisplayError("no display for a window; use render_mode='rgb_array'")
            import mujoco.viewer

            others = set(threading.enumerate())
            self._window = mujoco.viewer.launch_passive(self.model, self.data, show_left_ui=False, show_right_ui=False)
            self._window_threads = set(threading.enumerate()) - others
            self._window.opt.geomgroup[COLLISION_GROUP] = self._show_capsules
            with self._window.lock():
                for name in ("azimuth", "elevation", "distance"):
                    setattr(self._window.cam, name, getattr(self.camera, name))
                self._window.cam.lookat[:] = self.camera.lookat
        with self._window.lock():
            self.pose(position)
            self._window.user_scn.ngeom = 0
            self._draw(self._window.user_scn, humans, pair, goal)
        self._window.sync()

    def _draw(
        self,
        scene: "mujoco.MjvScene",
        humans: CapsuleSet,
        pair: tuple[Array, Array] | None,
        goal: Array | None,
    ) -> None:
        capsule = self._mujoco.mjtGeom.mjGEOM_CAPSULE
        for i, name in enumerate(humans.names):
            colour = _CLOTHES.get(name, (0.5, 0.5, 0.55, 1.0))
            self._connect(scene, capsule, humans.start[i], humans.end[i], humans.radius[i], colour)
        if pair is not None:
            self._connect(scene, capsule, pair[0], pair[1], 0.006, (0.9, 0.1, 0.1, 1.0))
            for end in pair:
                self._connect(scene, capsule, end, end, 0.016, (0.9, 0.1, 0.1, 1.0))
        if goal is not None:
            self._connect(scene, capsule, goal, goal, 0.02, (0.1, 0.7, 0.3, 0.9))

    def _connect(
        self,
        scene: "mujoco.MjvScene",
        kind: "mujoco.mjtGeom",
        start: Array,
        end: Array,
        radius: float,
        colour: tuple[float, float, float, float],
    ) -> None:
        """Add a capsule, or a sphere where both ends are one point."""
        mujoco = self._mujoco
        if scene.ngeom >= scene.maxgeom:
            return
        geom = scene.geoms[scene.ngeom]
        point = bool(np.allclose(start, end))
        sphere = mujoco.mjtGeom.mjGEOM_SPHERE
        mujoco.mjv_initGeom(
            geom,
            sphere if point else kind,
            np.full(3, radius),
            np.array(start, float),
            np.eye(3).ravel(),
            np.array(colour, np.float32),
        )
        if not point:
            mujoco.mjv_connector(geom, kind, radius, np.array(start, float), np.array(end, float))
        scene.ngeom += 1

    def servo_gains(self) -> Array:
        """Ratio of velocity to position gain of each joint's position servo, shape (n,) [s].

        Raises:
            RobotModelError: A joint has no position actuator.
        """
        mujoco, model = self._mujoco, self.model
        ratio = np.zeros(model.nv)
        served = np.zeros(model.nv, bool)
        for i in range(model.nu):
            joint = model.actuator_trnid[i, 0]
            is_servo = (
                model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
                and model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_AFFINE
                and model.actuator_gainprm[i, 0] > 0.0
                and model.actuator_biasprm[i, 1] == -model.actuator_gainprm[i, 0]
            )
            if is_servo and i == joint:
                ratio[joint] = -model.actuator_biasprm[i, 2] / model.actuator_gainprm[i, 0]
                served[joint] = True
        if not served.all():
            missing = [self.robot.joint_names[j] for j in np.flatnonzero(~served)]
            raise RobotModelError(
                f"dynamics='servo' needs one <position> actuator a joint, in their order; missing: {missing}"
            )
        return ratio

    def servo_reset(self, position: Array) -> None:
        """Put the simulated arm at rest at a joint position, shape (n,) [rad]."""
        self._mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = position
        self.data.ctrl[:] = position
        self._mujoco.mj_forward(self.model, self.data)

    def servo_step(self, state: Array, jerk: Array, dt: float, ratio: Array) -> tuple[Array, Array, Array]:
        """Simulate one control step; the servos track the command of Eq. (1) at 1 kHz, velocity fed forward.

        Their force is of the position with which a millisecond begins and, since damping is integrated implicitly, of
        the velocity with which it ends: the references are those of these moments.

        Args:
            state: Commanded state at the beginning, shape (3, n).
            jerk: Commanded jerk, shape (n,) [rad/s³].
            dt: Control step, a multiple of 1 ms [s].
            ratio: From :meth:`servo_gains`.

        Returns:
            The arm's position, velocity, acceleration, each of shape (n,).
        """
        q, v, a = state
        for k in range(1, round(dt / SUBSTEP) + 1):
            before, t = (k - 1) * SUBSTEP, k * SUBSTEP
            reference = q + v * before + a * before**2 / 2.0 + jerk * before**3 / 6.0
            rate = v + a * t + jerk * t**2 / 2.0
            self.data.ctrl[:] = reference + ratio * rate
            self._mujoco.mj_step(self.model, self.data)
        return self.data.qpos.copy(), self.data.qvel.copy(), self.data.qacc.copy()

    def close(self) -> None:
        """Close renderer and window."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
        if self._window is not None:
            self._window.close()
            self._window = None
            # the window's own thread must be gone before the interpreter is, or it takes it down
            for thread in self._window_threads:
                thread.join(timeout=5.0)


def _decorate(spec: "mujoco.MjSpec", scene: str, pretty: bool, width: int, height: int) -> None:
    """Floor, table, lights, background: nothing of it collides."""
    import mujoco

    visual = spec.visual
    visual.global_.offwidth, visual.global_.offheight, visual.global_.fovy = width, height, 38.0
    visual.quality.shadowsize = 2048 if pretty else 0
    visual.quality.offsamples = 4 if pretty else 0
    visual.map.shadowclip, visual.map.shadowscale = 2.0, 0.9
    visual.map.znear, visual.map.zfar = 0.02, 40.0
    visual.rgba.haze = [0.74, 0.78, 0.82, 1.0]
    visual.headlight.ambient = [0.40, 0.40, 0.42]
    visual.headlight.diffuse = [0.25, 0.25, 0.25]
    visual.headlight.specular = [0.2, 0.2, 0.2]
    spec.stat.extent, spec.stat.center = 1.5, [0.4, 0.0, 1.0]
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.97],
        rgb2=[0.62, 0.67, 0.73],
        width=256,
        height=1536,
    )
    spec.add_material(name="floor", rgba=[0.60, 0.62, 0.65, 1.0], specular=0.1, shininess=0.2)
    spec.add_material(name="table_top", rgba=[0.70, 0.71, 0.73, 1.0], specular=0.05, shininess=0.3)
    spec.add_material(name="table_body", rgba=[0.32, 0.34, 0.37, 1.0], specular=0.05, shininess=0.3)
    world = spec.worldbody
    for position, direction, diffuse, specular, casts in (
        ([1.5, -1.6, 3.6], [-0.42, 0.45, -1.0], 0.50, 0.6, True),
        ([-1.5, -1.5, 2.5], [0.8, 0.75, -0.45], 0.22, 0.15, False),
        ([0.0, 2.0, 2.5], [0.1, -1.0, -0.35], 0.22, 0.25, False),
    ):
        world.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=position,
            dir=direction,
            diffuse=[diffuse] * 3,
            specular=[specular] * 3,
            ambient=[0.0] * 3,
            castshadow=casts,
        )

    def box(size: list[float], pos: list[float], material: str) -> None:
        world.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=pos, material=material, contype=0, conaffinity=0)

    world.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05], material="floor", contype=0, conaffinity=0)
    if scene == "table":
        box([0.34, 0.40, 0.02], [0.03, 0.0, TABLE_HEIGHT - 0.02], "table_top")
        box([0.30, 0.36, (TABLE_HEIGHT - 0.04) / 2.0], [0.03, 0.0, (TABLE_HEIGHT - 0.04) / 2.0], "table_body")
