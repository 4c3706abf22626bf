"""The kernels give the same numbers compiled and interpreted (and run at all without the compiler)."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from places import TESTS

SCRIPT = TESTS / "kernel_values.py"


def values(disable_jit: str) -> dict[str, list[float]]:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": disable_jit}
    run = subprocess.run([sys.executable, str(SCRIPT)], env=environment, capture_output=True, text=True, check=True)
    return json.loads(run.stdout)


@pytest.mark.long
def test_compiled_and_interpreted_kernels_agree() -> None:
    compiled, interpreted = values("0"), values("1")
    assert compiled.keys() == interpreted.keys()
    assert len(compiled) >= 10
    for name, numbers in compiled.items():
        assert len(numbers) > 0
        # multiply-add contraction and another summation order are all that may differ
        np.testing.assert_allclose(numbers, interpreted[name], rtol=1e-9, atol=1e-11, err_msg=name)
