"""The mass that an arm presents to whoever is touched, by MuJoCo's mass matrix; indicative, as all energies here."""

import functools
from typing import Any

import numpy as np

from jssa_gym.evaluation.oracle import Oracle
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array


class Inertia:
    r"""An arm's operational-space inertia along a direction, :math:`m_r = 1 / (n^\top J M^{-1} J^\top n)`.

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
