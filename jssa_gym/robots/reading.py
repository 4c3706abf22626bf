"""Arms' files, MJCF and URDF, as MuJoCo's compiler reads them."""

import io
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlparse

import numpy as np

from jssa_gym.exceptions import RobotModelError
from jssa_gym.headless import choose_gl_backend
from jssa_gym.robots.findings import FileFinding, obstacle, repaired
from jssa_gym.robots.mjcf import COLLISION_GROUP, URDF_GROUP
from jssa_gym.storage import read_text

if TYPE_CHECKING:
    import mujoco

_LIGHTEST = 1e-6
"""Mass and inertia given to what has none [kg, kg m²]: no motion that is planned here depends on them."""

_TURN = 2.0 * np.pi
"""Range given to a joint that turns without end, in both directions [rad]."""

_FOLDERS = ("meshdir", "assetdir")
"""Attributes of MuJoCo's own section of a URDF that say where meshes are."""

_LARGEST = 2**28
"""Size from which no mesh is read [bytes]."""


@dataclass(frozen=True, slots=True, eq=False)
class ArmFile:
    """An arm's file, compiled."""

    path: Path
    model: "mujoco.MjModel"
    velocity: dict[str, float]
    """Velocity limits that the file states, by the joint's name [rad/s]."""
    group: int
    """Geom group in which its capsules are, if nothing else is said."""
    findings: tuple[FileFinding, ...] = ()


def read_source(path: str | Path, packages: Mapping[str, Path] | None = None) -> ArmFile:
    """Read an MJCF or URDF file.

    Args:
        path: Of the file.
        packages: Folders of the packages that a URDF names (``package://NAME/…``). A package that is not named is
            looked for in and beside the folders that hold the file.

    Raises:
        RobotModelError: It cannot be read, or does not compile; the message has the compiler's words.
    """
    path, root = _parsed(path)
    return _read_urdf(path, root, packages or {}) if root.tag == "robot" else _read_mjcf(path)


def read_spec(path: str | Path) -> "mujoco.MjSpec":
    """Read the same as what a scene can take in.

    Raises:
        RobotModelError: As of :func:`read_source`.
    """
    import mujoco

    path, root = _parsed(path)
    return _urdf(path, root, {}, [])[0] if root.tag == "robot" else mujoco.MjSpec.from_file(str(path))


def _parsed(path: str | Path) -> tuple[Path, ET.Element]:
    choose_gl_backend()
    path = Path(path).resolve()
    if not path.is_file():
        raise RobotModelError(f"no {'URDF' if path.suffix == '.urdf' else 'MJCF'} file at {path}")
    text = read_text(path, RobotModelError)  # MuJoCo takes any bytes, and ends at the first NUL
    try:
        root = ET.fromstring(text)  # what expat does with entities is bounded since 2.4
    except ET.ParseError as error:
        raise RobotModelError(f"{path.name} is no XML: {error}") from error
    if path.suffix == ".xacro" or any(child.tag.startswith("{http://www.ros.org/wiki/xacro}") for child in root):
        raise RobotModelError(f"{path.name} is a xacro, which makes a URDF: run `xacro {path.name} > arm.urdf` first")
    if root.tag not in ("robot", "mujoco"):
        raise RobotModelError(
            f"{path.name} is neither MJCF nor URDF: its root is <{root.tag}>, not <mujoco> or <robot>"
        )
    return path, root


# ---- MJCF ----------------------------------------------------------------------------------------------


def _read_mjcf(path: Path) -> ArmFile:
    import mujoco

    findings: list[FileFinding] = []
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        if "mass and inertia" not in str(error):
            raise RobotModelError(f"{path.name} does not compile: {_words(error)}") from error
        try:
            spec = mujoco.MjSpec.from_file(str(path))
            _give_mass(spec)
            model = spec.compile()
        except ValueError as again:
            raise RobotModelError(f"{path.name} does not compile: {_words(again)}") from again
        findings.append(_weightless(path.name))
    return ArmFile(path, model, {}, COLLISION_GROUP, tuple(findings))


def _give_mass(spec: "mujoco.MjSpec") -> None:
    spec.compiler.boundmass = spec.compiler.boundinertia = _LIGHTEST


def _weightless(name: str) -> FileFinding:
    return repaired(name, "has bodies without mass or inertia", f"they get {_LIGHTEST:g} kg and kg m², for servo only")


def _words(error: Exception) -> str:
    return " ".join(str(error).split())


# ---- URDF ----------------------------------------------------------------------------------------------


def _read_urdf(path: Path, root: ET.Element, packages: Mapping[str, Path]) -> ArmFile:
    findings: list[FileFinding] = []
    moving = {
        child.get("link") for one in root.iter("joint") if one.get("type") != "fixed" for child in one.iter("child")
    }
    light = [one for one in root.iter("link") if one.get("name") in moving and one.find("inertial") is None]
    try:
        spec, velocity = _urdf(path, root, packages, findings)
        model = spec.compile()
    except ValueError as error:
        stands = [str(finding) for finding in findings if finding.stands]
        raise RobotModelError("; ".join([*stands, f"{path.name} does not compile: {_words(error)}"])) from error
    if light:
        findings.append(_weightless(path.name))
    return ArmFile(path, model, velocity, URDF_GROUP, tuple(findings))


def _urdf(
    path: Path, root: ET.Element, packages: Mapping[str, Path], findings: list[FileFinding]
) -> tuple["mujoco.MjSpec", dict[str, float]]:
    """A URDF as MuJoCo's specification, and its velocity limits by joint; ValueError if it cannot be one."""
    import mujoco

    assets = _gather_meshes(path, root, packages, findings)
    velocity = _limits(root, findings)
    settings = root.find("mujoco/compiler")
    if settings is None:
        settings = ET.SubElement(ET.SubElement(root, "mujoco"), "compiler")
    for folder in _FOLDERS:  # where meshes were looked for already
        settings.attrib.pop(folder, None)
    # the meshes are at hand under new names; what is drawn stays, and so do the links' names
    settings.attrib |= {"strippath": "true", "discardvisual": "false", "fusestatic": "false", "balanceinertia": "true"}
    settings.attrib |= {"boundmass": str(_LIGHTEST), "boundinertia": str(_LIGHTEST), "autolimits": "true"}
    return mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"), assets=assets), velocity


def _limits(root: ET.Element, findings: list[FileFinding]) -> dict[str, float]:
    """Velocity limits by joint; joints without end get one."""
    velocity = {}
    for joint in root.iter("joint"):
        name, kind, limit = joint.get("name", ""), joint.get("type"), joint.find("limit")
        if kind not in ("revolute", "continuous"):
            continue
        if limit is not None and (value := _number(limit.get("velocity"))) > 0.0:
            velocity[name] = value
        if kind == "continuous":
            joint.set("type", "revolute")
            limit = ET.SubElement(joint, "limit") if limit is None else limit
            limit.attrib |= {"lower": str(-_TURN), "upper": str(_TURN)}
            findings.append(endless(name))
    return velocity


def endless(name: str) -> FileFinding:
    """About a joint that turns without end."""
    return repaired(
        f"joint '{name}'", "turns without end", "it gets the range of one turn in each direction, ±6.283 rad"
    )


def _number(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")


def _gather_meshes(
    path: Path, root: ET.Element, packages: Mapping[str, Path], findings: list[FileFinding]
) -> dict[str, bytes]:
    """Content of the meshes by the new names that they get; shapes that cannot be read are taken out, and said."""
    assets: dict[str, bytes] = {}
    replaced: list[str] = []
    own = next(({**one.attrib} for one in root.iterfind("mujoco/compiler")), {})
    folders = [path.parent / own[name] for name in _FOLDERS if name in own]
    for link in root.iter("link"):
        lost: list[str] = []
        whole = set()
        for kind in ("visual", "collision"):
            shapes, before = link.findall(kind), len(lost)
            for shape in shapes:
                mesh = shape.find("geometry/mesh")
                if mesh is None:
                    continue
                uri = mesh.get("filename", "")
                found = _resolve(uri, path, packages, folders)
                if found is None or found.suffix.lower() not in (".stl", ".obj"):
                    lost.append(_lost(uri, found, packages))
                    link.remove(shape)
                    continue
                name = f"{len(assets)}{found.suffix.lower()}"
                assets[name] = _content(found)
                mesh.set("filename", name)
            if shapes and len(lost) == before:
                whole.add(kind)
        if whole:
            replaced += lost
        elif lost:
            advice = "nothing else says where all of it is; convert it to STL or OBJ, or say where it is"
            findings.append(obstacle(f"link '{link.get('name')}'", f"draws {'; '.join(dict.fromkeys(lost))}", advice))
    if replaced:
        more = f" and {len(replaced) - 1} more like it" if len(replaced) > 1 else ""
        advice = "the links' other shapes, all those of <collision> or of <visual>, stand for them"
        findings.append(repaired(path.name, f"draws {replaced[0]}{more}", advice))
    return assets


def _lost(uri: str, found: Path | None, packages: Mapping[str, Path]) -> str:
    if found is not None:
        return f"{uri}, of a kind that MuJoCo does not read (STL and OBJ are)"
    package = urlparse(uri).netloc
    if uri.startswith("package://") and package not in packages:
        return f"{uri}, which is not there (give --package {package}=DIR)"
    return f"{uri}, which is not there"


def _resolve(uri: str, path: Path, packages: Mapping[str, Path], folders: Sequence[Path] = ()) -> Path | None:
    """The file that a mesh's address means; None where there is none.

    Args:
        uri: Its address.
        path: Of the URDF.
        packages: Folders by the packages' names.
        folders: Where the URDF says to MuJoCo that meshes are.
    """
    parts = urlparse(uri)
    named, rest = parts.netloc, unquote(parts.path).lstrip("/")
    if parts.scheme == "package":
        if named in packages:
            places = [Path(packages[named]) / rest]
        else:
            places = [folder / named / rest for folder in path.parents]
            places += [folder / rest for folder in path.parents]
    elif parts.scheme == "file":
        # the address of a file has no host: what stands in its place is a folder, as in file://meshes/arm.stl
        places = [Path("/", rest)] if not named else []
        places.append(path.parent / named / rest)
    elif not parts.scheme:
        places = [path.parent / uri, *(folder / uri for folder in folders)]
    else:
        places = []
    # MuJoCo itself takes but the name of a file, and looks for it there
    places += [folder / Path(rest).name for folder in folders]
    return next((place for place in places if place.is_file()), None)


def _content(path: Path) -> bytes:
    """A mesh as MuJoCo reads it: STL in text becomes binary."""
    content = path.read_bytes() if path.stat().st_size <= _LARGEST else b""
    if path.suffix.lower() != ".stl" or not content.lstrip().startswith(b"solid"):
        return content
    if len(content) >= 84 and len(content) == 84 + 50 * int.from_bytes(content[80:84], "little"):
        return content  # binary that begins like text
    rows = [line.split()[1:4] for line in content.splitlines() if line.split()[:1] == [b"vertex"]]
    try:
        triangles = np.array(rows, np.float32).reshape(-1, 3, 3)
    except ValueError:
        return content
    return stl(triangles)


def stl(triangles: np.ndarray) -> bytes:
    """Triangles, shape (t, 3, 3) [m], as a binary STL file."""
    records = np.zeros(len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    records["corners"] = triangles
    out = io.BytesIO()
    out.write(b"triangles".ljust(80, b" ") + len(triangles).to_bytes(4, "little") + records.tobytes())
    return out.getvalue()
