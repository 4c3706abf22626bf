"""Arms of MuJoCo Menagerie by name: downloaded by the package ``mujoco-menagerie``, prepared, kept."""

import hashlib
import importlib
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from jssa_gym.exceptions import MissingExtraError, RobotModelError, how_to_install
from jssa_gym.robots.limits import LimitTable, read_limits

PUBLISHED = Path(__file__).parent / "published"
"""Tables of limits from public data, by name of the arm."""


class Origin(NamedTuple):
    """Where an arm is in Menagerie."""

    robot: str
    """Name of its folder."""
    entry: str
    """Name of the model in it."""
    keep: tuple[str, ...] = ()
    """Joints that look like jaws and are none."""


MENAGERIE: dict[str, Origin] = {
    "flexiv_rizon4": Origin("flexiv_rizon4", "flexiv_rizon4"),
    "fr3v2": Origin("franka_fr3_v2", "fr3v2"),
    "gen3": Origin("kinova_gen3", "gen3"),
    "iiwa14": Origin("kuka_iiwa_14", "iiwa14"),
    "lite6": Origin("ufactory_lite6", "lite6"),
    "menagerie_fr3": Origin("franka_fr3", "fr3"),
    "menagerie_ur5e": Origin("universal_robots_ur5e", "ur5e"),
    "omy_3m": Origin("robotis_omy_3m", "omy_3m"),
    "panda": Origin("franka_emika_panda", "panda"),
    "piper": Origin("agilex_piper", "piper"),
    "sawyer": Origin("rethink_robotics_sawyer", "sawyer"),
    "so101": Origin("robotstudio_so101", "so101"),
    "so_arm100": Origin("trs_so_arm100", "so_arm100"),
    "ur10e": Origin("universal_robots_ur10e", "ur10e"),
    "vx300s": Origin("trossen_vx300s", "vx300s"),
    "wx250s": Origin("trossen_wx250s", "wx250s"),
    "xarm7": Origin("ufactory_xarm7", "xarm7"),
    "z1": Origin("unitree_z1", "z1"),
}
"""Arms by name; the first use of one needs the network. Those that the package ships have their own names."""


def prepared_folder(name: str) -> Path:
    """Folder of an arm of :data:`MENAGERIE`, prepared: made at the first use, then kept with the user's caches.

    Raises:
        MissingExtraError: ``mujoco-menagerie`` is not installed.
        RobotModelError: It cannot be downloaded or prepared.
    """
    try:
        mujoco_menagerie = importlib.import_module("mujoco_menagerie")
    except ImportError as error:
        raise MissingExtraError(f"the robot {name!r} needs the extra 'robots': {how_to_install('robots')}") from error
    origin = MENAGERIE[name]
    try:
        robot = mujoco_menagerie.get(origin.robot)
        file = robot.xml(origin.entry)
    except mujoco_menagerie.MenagerieError as error:
        raise RobotModelError(f"the robot {name!r} of MuJoCo Menagerie is not to be had: {error}") from error
    folder = _cache() / f"{name}-{digest_of(file, name)}"
    if not folder.is_dir():
        _prepare(file, origin, name, folder)
    return folder


def published_limits(name: str) -> LimitTable | None:
    """Limits of an arm of :data:`MENAGERIE` from public data, the rest guessed; None if there are none."""
    table = table_of(name)
    return None if table is None else read_limits(table, partial=True)


def _prepare(file: Path, origin: Origin, name: str, folder: Path) -> None:
    """Whole or not there: two processes may begin at once."""
    from jssa_gym.robots.prepare import Preparation, examine, write_prepared

    wanted = Preparation(("all",), origin.keep, limits=table_of(name))
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent) as unfinished:
        made = write_prepared(examine(file, wanted), Path(unfinished) / name)
        try:
            made.replace(folder)
        except OSError:
            if not folder.is_dir():  # nor has somebody else finished it meanwhile
                raise
            shutil.rmtree(made)


def table_of(name: str) -> Path | None:
    """Limits of an arm from public data; None if there are none."""
    name = name.removeprefix("menagerie_")
    places = (PUBLISHED / f"{name}.toml", Path(__file__).parent / "assets" / f"{name}.limits.toml")
    return next((place for place in places if place.is_file()), None)


def digest_of(file: Path, name: str) -> str:
    """What changes with the arm's files and with what prepares them."""
    here = Path(__file__).parent
    readers = ("coverage.py", "findings.py", "limits.py", "mjcf.py", "reading.py")
    sources = [*sorted((here / "prepare").glob("*.py")), *(here / name for name in readers)]
    sources += [table] if (table := table_of(name)) is not None else []
    digest = hashlib.sha256()
    for path in (*sources, *sorted(path for path in file.parent.rglob("*") if path.is_file())):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _cache() -> Path:
    kept: Any = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(kept) / "jssa_gym" / "robots"
