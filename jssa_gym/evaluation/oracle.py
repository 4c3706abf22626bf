"""The same scene a second time: MuJoCo's kinematics, distances and masses instead of the package's kernels."""

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from jssa_gym.exceptions import RobotModelError
from jssa_gym.headless import choose_gl_backend
from jssa_gym.kernels.capsules import STANDING
from jssa_gym.robots import RobotModel
from jssa_gym.robots.mjcf import COLLISION_GROUP
from jssa_gym.types import Array

FAR = 10.0
"""Distance beyond which MuJoCo is not asked how far exactly [m]."""

_POINT = 1e-9
"""Length under which a capsule's axis is a point [m]."""


class Oracle:
    """An arm, people and half-spaces as MuJoCo sees them: capsules, spheres and planes that collide with nothing.

    Args:
        robot: The arm, where it stands; it is read from its MJCF file, not from what the kernels use.
        start, end: Ends of the people's capsules at all moments to look at, shape (s, m, 3) [m].
        radius: Shape (m,) [m].
        normal: Of the half-spaces, shape (p, 3).
        offset: Shape (p,) [m].

    Raises:
        RobotModelError: The robot's file does not have the capsules that the model has.
    """

    def __init__(
        self, robot: RobotModel, start: Array, end: Array, radius: Array, normal: Array, offset: Array
    ) -> None:
        choose_gl_backend()
        import mujoco

        self._mujoco = mujoco
        spec = mujoco.MjSpec()
        frame = spec.worldbody.add_frame(pos=robot.mount.tolist())
        spec.attach(robot.spec(), prefix="robot/", frame=frame)
        length = np.linalg.norm(end - start, axis=-1)
        self._half, self._middle = length / 2.0, (start + end) / 2.0
        self._turn = _turn((end - start) / np.maximum(length, _POINT)[..., None])
        for i in range(len(radius)):
            body = spec.worldbody.add_body(name=f"human {i}", mocap=True)
            size = [radius[i], max(float(self._half[:, i].max()), _POINT), 0.0]
            body.add_geom(name=f"human {i}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=size)
        for i in range(len(offset)):
            plane, turn = mujoco.mjtGeom.mjGEOM_PLANE, np.zeros(4)
            mujoco.mju_quatZ2Vec(turn, normal[i])
            foot = normal[i] * offset[i]
            spec.worldbody.add_geom(name=f"plane {i}", type=plane, size=[0.0, 0.0, 1.0], pos=foot, quat=turn)
        self.model: Any = spec.compile()
        self.data: Any = mujoco.MjData(self.model)
        moving = self.model.geom_bodyid > 0
        arm = np.flatnonzero(moving & (self.model.geom_group == COLLISION_GROUP)).tolist()
        if len(arm) != len(robot.capsules):
            raise RobotModelError(f"{robot.mjcf} has {len(arm)} capsules, {robot.name} has {len(robot.capsules)}")
        self.arm: list[int] = arm
        """Geom ids of the robot's capsules, in the model's order."""
        self.human: list[int] = [self.model.geom(f"human {i}").id for i in range(len(radius))]
        self.planes: list[int] = [self.model.geom(f"plane {i}").id for i in range(len(offset))]

    def place(self, k: int) -> None:
        """Put the people where they are at moment k; :meth:`move` takes it into account."""
        sphere, capsule = self._mujoco.mjtGeom.mjGEOM_SPHERE, self._mujoco.mjtGeom.mjGEOM_CAPSULE
        # before 3.17 MuJoCo finds capsules without a length far away from everything
        self.model.geom_type[self.human] = np.where(self._half[k] > _POINT, capsule, sphere)
        self.model.geom_size[self.human, 1] = self._half[k]
        self.data.mocap_pos[:] = self._middle[k]
        self.data.mocap_quat[:] = self._turn[k]

    def move(self, position: Array) -> None:
        """Set the joints, shape (n,) [rad], and find out where everything is."""
        self.data.qpos[:] = position
        self._mujoco.mj_kinematics(self.model, self.data)

    def distances(self, pairs: Sequence[tuple[int, int]]) -> list[float]:
        """Signed surface distances of pairs of geoms, :data:`FAR` where it is more [m]."""
        model, data, distance = self.model, self.data, self._mujoco.mj_geomDistance
        return [distance(model, data, one, other, FAR, None) for one, other in pairs]

    def stands(self, i: int, j: int) -> bool:
        """Whether no joint can change how far the arm's capsule i is from half-space j, wherever the joints are."""
        model, data, geom = self.model, self.data, self.arm[i]
        body = model.body_weldid[model.geom_bodyid[geom]]
        if model.body_dofadr[body] + model.body_dofnum[body] != 1:
            return False  # more than the first joint moves it
        self._mujoco.mj_kinematics(model, data)
        capsule = model.geom_type[geom] == self._mujoco.mjtGeom.mjGEOM_CAPSULE
        along = data.geom_xmat[geom].reshape(3, 3)[:, 2] * (model.geom_size[geom, 1] if capsule else 0.0)
        arms = data.geom_xpos[geom] + np.array([along, -along]) - data.xanchor[0]
        lever = np.linalg.norm(np.cross(data.xaxis[0], arms), axis=1).max()
        normal = data.geom_xmat[self.planes[j]].reshape(3, 3)[:, 2]
        return bool(lever * np.linalg.norm(np.cross(data.xaxis[0], normal)) <= STANDING)

    def touch(self, one: int, other: int, velocity: Array) -> tuple[Array, Array]:
        """Where two geoms touch, and how the first one's surface moves there.

        Args:
            one: Geom of the arm.
            other: Geom.
            velocity: Joint velocity, shape (n,) [rad/s].

        Returns:
            The touching point of each one's surface, shape (2, 3) [m], and the velocity of the first one's material
            point there, a spinning link's included, shape (3,) [m/s].
        """
        mujoco, model, data = self._mujoco, self.model, self.data
        points, jacobian = np.zeros(6), np.zeros((3, model.nv))
        mujoco.mj_geomDistance(model, data, one, other, FAR, points)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jac(model, data, jacobian, None, points[:3], model.geom_bodyid[one])
        return points.reshape(2, 3), jacobian @ velocity


def _turn(axis: Array) -> Array:
    """Quaternions that turn z into unit vectors or into their opposites, shape (..., 3) to (..., 4)."""
    # a capsule looks the same upside down, and the direction upwards is never opposite to z
    x, y, z = np.moveaxis(np.where(axis[..., 2:] < 0.0, -axis, axis), -1, 0)
    quaternion = np.stack([1.0 + z, -y, x, np.zeros_like(z)], axis=-1)
    return quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)


class Inertia:
    r"""An arm's operational-space inertia along a direction, :math:`m_r = 1 / (n^\top J M^{-1} J^\top n)`; indicative.

    Rotors count as far as its file has them as the joints' armature.

    Args:
        robot: The arm, where it stands; read from its file.
    """

    def __init__(self, robot: RobotModel) -> None:
        import mujoco

        self._mujoco: Any = mujoco
        compiled = _compiled(robot)
        self._model, self._arm, self._data = compiled.model, compiled.arm, mujoco.MjData(compiled.model)
        self._jacobian, self._accelerated = np.zeros((3, robot.n)), np.zeros((1, robot.n))
        self._placed = np.full(robot.n, np.nan)

    def mass(self, position: Array, capsule: int, point: Array, normal: Array) -> float:
        """Effective mass of a capsule's material point along a unit vector [kg]; inf where no joint moves it there.

        Args:
            position: Of the joints, shape (n,) [rad].
            capsule: Number of the capsule.
            point: In the world, shape (3,) [m].
            normal: Shape (3,).
        """
        mujoco, model, data = self._mujoco, self._model, self._data
        jacobian, accelerated = self._jacobian, self._accelerated
        if (position != self._placed).any():  # several capsules touch in the same step
            data.qpos[:] = self._placed[:] = position
            mujoco.mj_fwdPosition(model, data)
        body = model.geom_bodyid[self._arm[capsule]]
        mujoco.mj_jac(model, data, jacobian, None, np.ascontiguousarray(point), body)
        along = (normal @ jacobian)[None]
        mujoco.mj_solveM(model, data, accelerated, along)
        mobility = float(along[0] @ accelerated[0])
        return 1.0 / mobility if mobility > 0.0 else np.inf


@functools.lru_cache(maxsize=4)  # compiling takes longer than all that is asked of it in an episode
def _compiled(robot: RobotModel) -> Oracle:
    """The arm by itself as MuJoCo has it; of it only what does not change is looked at."""
    nobody = np.zeros((1, 0, 3))
    return Oracle(robot, nobody, nobody, np.zeros(0), np.zeros((0, 3)), np.zeros(0))
