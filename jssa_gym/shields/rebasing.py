"""Taking a resting arm to be where something else has put it."""

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.joints import deviates
from jssa_gym.kernels.rest import at_rest
from jssa_gym.shields.reading import Reading, part_of
from jssa_gym.shields.reasons import BAD_INPUTS
from jssa_gym.shields.records import Records
from jssa_gym.tick import loop
from jssa_gym.types import Scene


def rebase(records: Records, reading: Reading, scene: Scene) -> None:
    """Take a resting arm to be where a scene says; what was wrong with its readings is forgotten.

    Where velocity or acceleration are not measured nothing shows that it rests.

    Raises:
        ParameterError: The arm is expected to move still, or the reading cannot be used, is no newer than the last
            one, moves, or is outside the position limits.
    """
    arm, expected, settings = records.memory.arm[0], records.memory.expected[0], records.settings
    if not at_rest(expected):
        raise ParameterError("the arm is still braking: rebase it when it rests")
    (robot, lost), (time, _) = part_of(scene, "robot"), part_of(scene, "time")
    wrong = lost or reading.read_joints(robot)
    if wrong:
        raise ParameterError(f"the joint state cannot be read: {wrong}")
    joints = records.view.joints
    if not (np.isfinite(joints) | (settings.tolerance == np.inf)).all():
        raise ParameterError(BAD_INPUTS[2])
    try:
        old = not float(time) < np.inf or float(time) <= arm["time"]
    except (TypeError, ValueError) as error:
        raise ParameterError(f"the clock cannot be read: {error}") from error
    if old:
        raise ParameterError(f"the reading is of {time} s, the last one of {arm['time']:g} s: it has to be newer")
    still = np.zeros_like(joints)
    still[0] = joints[0]
    if deviates(joints, still, settings.stop_limits, settings.tolerance):
        raise ParameterError(f"the arm moves, at {joints[1]} rad/s: rebase it when it rests")
    if not np.all((settings.stop_limits[0] <= joints[0]) & (joints[0] <= settings.stop_limits[1])):
        raise ParameterError(f"the arm is outside its position limits, at {joints[0]} rad")
    expected[:] = still
    loop.rebase(records.view.arms)
