"""What tells things that are evaluated from others, in another process too."""

import importlib.metadata
import inspect
import os
import pickle
import platform
import re
from pathlib import Path
from typing import Any

import gymnasium as gym

from jssa_gym.engine.source import package_version, source_hash
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import DEFAULT, ROBOTS, make_robot
from jssa_gym.robots.mjcf import COLLISION_GROUP
from jssa_gym.storage import sha256


def named(thing: Any) -> str:
    """A name as it is; of an environment its id, else the name of its class or of a function."""
    if isinstance(thing, str):
        return thing
    if isinstance(thing, gym.Env):
        return thing.spec.id if thing.spec is not None else type(thing.unwrapped).__name__
    return getattr(thing, "__name__", type(thing).__name__)


def robot_identity(robot: str) -> str:
    """What tells a robot from others: its name, or the digest of the files that it is read from.

    Raises:
        ParameterError, RobotModelError: There is no such robot.
    """
    if robot in ROBOTS:
        return robot
    model = make_robot(robot)
    content = model.mjcf.read_bytes() + pickle.dumps((model.limits, model.home, model.uncovered))
    if model.group != COLLISION_GROUP:
        content += str(model.group).encode()
    return f"{model.name} {sha256(content)[:16]}"


def without_default(config: dict[str, Any]) -> dict[str, Any]:
    """A configuration whose entry ``robot`` tells the robot from others, and is left out for the default one.

    What was begun or recorded before there were others is the same as ever.
    """
    rest = {name: value for name, value in config.items() if name != "robot"}
    return rest if config["robot"] == DEFAULT else {**rest, "robot": robot_identity(config["robot"])}


def without_sensor(config: dict[str, Any]) -> dict[str, Any]:
    """A configuration without the entry ``sensor`` where the truth is seen, as it was before there were any."""
    return {name: value for name, value in config.items() if (name, value) != ("sensor", "none")}


def code_version() -> dict[str, str]:
    """Which code this is: ``version`` of the package and ``source``, the hash of what decides how an episode goes."""
    return {"version": package_version(), "source": source_hash()}


_COUNTED_ON = ("numpy", "numba", "mujoco", "scipy")
"""Packages whose versions may change what comes out."""


def made_with() -> str:
    """What stands beside a published table: versions, hash of the code, processor and how many of it there are."""
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in _COUNTED_ON)
    code = code_version()
    package = f"jssa_gym {code['version']} (source {code['source']})"
    return f"{package}, Python {platform.python_version()}, {versions}; {_processor()}, {os.cpu_count()} threads"


def _processor() -> str:
    """Name of the processor, as far as the system tells."""
    try:
        found = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), flags=re.MULTILINE)
    except OSError:
        found = None
    return found[1].strip() if found else platform.processor() or platform.machine() or "an unknown processor"


def code_digest(thing: Any) -> str:
    """Digest of the file that defines a thing, or its class.

    Empty where there is none, and for names and this package, whose code the ledger looks at as a whole.
    """
    maker = thing if inspect.isfunction(thing) or inspect.isclass(thing) else type(thing)
    if (maker.__module__ or "").split(".")[0] in ("builtins", "jssa_gym"):
        return ""
    try:
        file = inspect.getsourcefile(maker)
        return "" if file is None else sha256(Path(file).read_bytes())[:16]
    except (TypeError, OSError):  # made in C, or at a prompt
        return ""


def identity(name: str, thing: Any) -> str:
    """What tells a thing from others in another process: itself if it is a name, else a digest of its content."""
    if isinstance(thing, str):
        return thing
    try:
        content = pickle.dumps(thing)
    except Exception as error:  # what pickling an object raises is up to the object
        raise ParameterError(
            f"{name} cannot be told again after a crash, nor sent to another process ({error}); give a name, a "
            "function of a module, or 'module:factory'"
        ) from error
    return f"{named(thing)} {sha256(content)[:16]}"
