"""The MuJoCo side of a scene: pictures, and the servoed arm."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.backdrop import decorate
from jssa_gym.envs.camera import Camera
from jssa_gym.envs.drawing import Marks, add_to, solids
from jssa_gym.envs.figures import Rounded
from jssa_gym.envs.opengl import open_renderer
from jssa_gym.envs.window import Window
from jssa_gym.exceptions import DisplayError, ParameterError, RobotModelError
from jssa_gym.headless import choose_gl_backend
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


def placed(robot: RobotModel, scene: str) -> RobotModel:
    """A robot where it stands in a scene of :data:`SCENES`.

    Raises:
        ParameterError: There is no such scene, or the robot is mounted elsewhere.
    """
    mount = np.array([0.0, 0.0, SCENES[known_name("scene", scene, SCENES)]])
    if np.any(robot.mount != 0.0) and np.any(robot.mount != mount):
        raise ParameterError(f"the robot is mounted at {robot.mount}, scene {scene!r} puts it at {mount}")
    return robot.mounted(mount)


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
        self._floor = SCENES[scene]
        decorate(spec, TABLE_HEIGHT if scene == "table" else None, pretty, width, height)
        frame = spec.worldbody.add_frame(pos=robot.mount.tolist())
        arm = robot.spec()
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
        self._arm = np.flatnonzero(moving & (self.model.geom_group == COLLISION_GROUP))
        self._renderer: mujoco.Renderer | None = None
        self._window: Window | None = None
        self.camera = mujoco.MjvCamera()
        self.camera.azimuth, self.camera.elevation, self.camera.distance = 98.0, -10.0, 3.1
        self.camera.lookat[:] = robot.mount + np.array([0.5, 0.0, 0.27])

    def __getstate__(self) -> dict[str, Any]:
        """The simulated arm as it is; renderer and window stay here, a copy opens its own."""
        camera = {name: np.array(getattr(self.camera, name)) for name in _CAMERA}
        none = {"_mujoco": None, "model": None, "_renderer": None, "_window": None}
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

    def look_from(self, camera: Camera) -> None:
        """Choose where pictures are taken from, and the window begins."""
        for name in ("azimuth", "elevation", "distance"):
            setattr(self.camera, name, getattr(camera, name))
        self.camera.lookat[:] = camera.lookat

    def picture(self, position: Array, humans: CapsuleSet, marks: Marks = Marks()) -> NDArray[np.uint8]:  # noqa: B008
        """Draw a moment, shape (height, width, 3).

        Args:
            position: Joint position, shape (n,) [rad].
            humans: People.
            marks: What else is drawn.

        Raises:
            DisplayError: There is no OpenGL, or it belongs to another thread.
        """
        mujoco = self._mujoco
        if self._renderer is None:
            self._renderer = open_renderer(self.model, *self._size)
        self.pose(position)
        self._renderer.update_scene(self.data, camera=self.camera, scene_option=self._option(marks))
        scene = self._renderer.scene
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = self.pretty
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        add_to(scene, self._solids(humans, marks))
        try:
            return self._renderer.render()
        except Exception as error:  # every backend has errors of its own
            raise DisplayError(
                "OpenGL draws no more: all pictures of one environment have to be drawn in the thread that drew the "
                f"first one ({' '.join(str(error).split())})"
            ) from error

    def show(self, position: Array, humans: CapsuleSet, marks: Marks, period: float) -> None:
        """Draw a moment in a window, which opens with the first and keeps to real time.

        Args:
            position, humans, marks: As of :meth:`picture`.
            period: Time between moments [s].

        Raises:
            DisplayError: There is no display.
        """
        if self._window is None:
            self._window = Window(self.model, self.camera, *reversed(self._size))
        if self._window.is_open:
            self.pose(position)
            self._window.show(self.data, self._option(marks), self._solids(humans, marks), period)

    def _option(self, marks: Marks) -> "mujoco.MjvOption":
        option = self._mujoco.MjvOption()
        option.geomgroup[COLLISION_GROUP] = self._show_capsules or marks.capsules
        return option

    def _solids(self, humans: CapsuleSet, marks: Marks) -> list[Rounded]:
        camera = self.camera
        seen = Camera(camera.azimuth, camera.elevation, camera.distance, camera.lookat.copy())
        return solids(seen, self._arm_points(), humans, marks, self._floor)

    def _arm_points(self) -> Array:
        """Middles and ends of the arm's capsules, shape (3 k, 3) [m]."""
        middle, along = self.data.geom_xpos[self._arm], self.data.geom_xmat[self._arm].reshape(-1, 3, 3)[:, :, 2]
        half = self.model.geom_size[self._arm, 1:2] * along
        return np.vstack([middle - half, middle, middle + half])

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
