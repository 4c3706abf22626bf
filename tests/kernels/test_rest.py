"""What is at rest: who asks, in which unit, and that it is said in one place."""

import ast
from pathlib import Path

import numpy as np
import pytest

import jssa_gym
from jssa_gym.kernels import rest

PACKAGE = Path(jssa_gym.__file__).parent


@pytest.mark.parametrize("row", [1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_joints_rest_below_their_threshold_wherever_they_are(row, sign):
    state = np.zeros((3, 6))
    state[0] = 1.0
    assert rest.at_rest(state)
    state[row, 4] = sign * np.nextafter(rest.REST_JOINTS, 0.0)
    assert rest.at_rest(state)
    for speed in (sign * rest.REST_JOINTS, np.nan):
        state[row, 4] = speed
        assert not rest.at_rest(state)


def test_what_ends_in_rest_is_taken_to_rest():
    # of a plan's end both would have to be true where it is played without rounding
    assert rest.REST_PLANNED < rest.REST_JOINTS


@pytest.mark.long
def test_no_other_module_has_a_threshold_of_rest_of_its_own():
    found = {
        (path.relative_to(PACKAGE).as_posix(), target.id)
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name) and {"REST", "RESTING", "RESTS"} & set(target.id.split("_"))
    }
    names = ("REST_SPEED", "REST_JOINTS", "REST_PLANNED", "REST_COMMAND")
    assert found == {("kernels/rest.py", name) for name in names}
