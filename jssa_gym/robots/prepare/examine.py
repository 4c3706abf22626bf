"""An arm's file from reading to a model that can be guarded: everything that is wrong with it, at once."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jssa_gym.exceptions import ParameterError, RobotModelError
from jssa_gym.kernels.records import CAPSULE
from jssa_gym.robots import make_robot
from jssa_gym.robots.findings import FileFinding, obstacle, repaired
from jssa_gym.robots.limits import LimitTable, guess_limits, read_limits
from jssa_gym.robots.prepare.anatomy import Anatomy, anatomy_of
from jssa_gym.robots.prepare.chain import Chain, find_chain
from jssa_gym.robots.prepare.covering import Cover, cover_links
from jssa_gym.robots.prepare.enclose import Enclosure
from jssa_gym.robots.prepare.placing import base_column, placed, unit_findings
from jssa_gym.robots.prepare.posture import Looked, all_pairs, find_home, look, rounded, some_postures, useless
from jssa_gym.robots.reading import ArmFile, read_source
from jssa_gym.types import Array


@dataclass(frozen=True, slots=True)
class Preparation:
    """What the user has decided about a file."""

    freeze: tuple[str, ...] = ()
    """Joints that may stand still, by name, with all that refers to them; 'all' for whatever has to."""
    keep: tuple[str, ...] = ()
    """Hinges that look like jaws and are joints of the arm."""
    uncovered: tuple[str, ...] = ()
    """Links, by body or joint, that get no capsules: nothing is measured there, and nothing promised."""
    tip: str | None = None
    """Body that the arm leads to, where several arms branch off."""
    tool: str | None = None
    """Site or body at the tool centre point."""
    home: tuple[float, ...] | None = None
    """Home posture, one number a joint [rad]; None for the file's keyframe, or one that is looked for."""
    limits: Path | None = None
    """Table of velocity, acceleration and jerk limits, TOML; None for the one beside the file, or a guess that says
    so."""
    units_checked: bool = False
    """Whether lengths, ranges and velocities that look like another unit's are right."""
    packages: Mapping[str, Path] = field(default_factory=dict)
    """Folders of packages that a URDF names."""
    group: int | None = None
    """Geom group that holds the file's capsules; None for what its table of limits says, or else 3, of a URDF 0."""


@dataclass(frozen=True, slots=True, eq=False)
class Examination:
    """Everything about a file, and the arm that it makes."""

    source: ArmFile
    preparation: Preparation
    chain: Chain
    anatomy: Anatomy
    covers: tuple[Cover, ...]
    column: Enclosure | None
    """Capsule around what the base draws, in the first link's frame; None where there is none."""
    excluded: tuple[tuple[str, str], ...]
    """Pairs of capsules that are no self-collision."""
    home: Array
    """Shape (n,) [rad]."""
    limits: LimitTable
    findings: tuple[FileFinding, ...]

    @property
    def obstacles(self) -> tuple[FileFinding, ...]:
        """What has to be decided before a model can be written."""
        return tuple(finding for finding in self.findings if finding.stands)

    @property
    def acceptable(self) -> bool:
        """Whether the file can be taken as it is."""
        return all(finding.fits for finding in self.findings)

    def named_capsules(self) -> list[tuple[str, int, Enclosure]]:
        """Name, link and shape of every capsule of the prepared model."""
        # a link may have the name of a capsule that the file gives another one
        taken = {name for cover in self.covers if cover.named_by_file for name in cover.found}
        named = []
        if self.column is not None:
            named.append((_unused("base_column", taken), 0, self.column))
            taken.add(named[0][0])
        for i, cover in enumerate(self.covers):
            for name, capsule in cover.named():
                unique = name if cover.named_by_file else _unused(name, taken)
                taken.add(unique)
                named.append((unique, i, capsule))
        return named


def examine(path: str | Path, preparation: Preparation | None = None) -> Examination:
    """Read an arm's file, find its chain, enclose its links, choose a home posture, and say all that was found.

    Args:
        path: MJCF or URDF.
        preparation: What the user has decided; None for nothing.

    Raises:
        RobotModelError: The file cannot be read, or holds nothing that could be an arm.
        ParameterError: A name is none of the file's, or the home posture lies outside of the ranges.
    """
    wanted = preparation or Preparation()
    source = read_source(path, wanted.packages)
    chain = find_chain(source.model, wanted.freeze, wanted.keep, wanted.tip)
    stated: list[FileFinding] = []
    table = _table(source, wanted)
    group = _group(source, wanted, table, stated)
    anatomy = anatomy_of(source.model, chain, wanted.tool, group)
    limits = _limits(source, anatomy, table, stated)
    findings = [*source.findings, *chain.findings]
    findings += [] if wanted.units_checked else unit_findings(anatomy, limits, source.path)
    anatomy, moved = placed(anatomy)
    findings += moved
    text = f"is that of '{anatomy.tool_name}'"
    if not anatomy.tool_name:
        text = "is the origin of the last link: no site or body of it has the name of a tool"
    findings.append(FileFinding("the tool centre point", text, "give --tool NAME for another"))
    covers = cover_links(source, chain, anatomy, (*wanted.uncovered, *limits.uncovered), findings)
    column, told = base_column(anatomy, covers[0].kept)
    findings += [*told, *_bystanders(anatomy), *stated]
    looked = Examination(source, wanted, chain, anatomy, covers, column, (), np.zeros(0), limits, ())
    home, excluded = _posed(looked, findings)
    unknown = [name for name in wanted.uncovered if name not in _names(anatomy)]
    if unknown:
        raise ParameterError(f"no link {unknown[0]!r}; there are {', '.join(_names(anatomy))}")
    if all(finding.fits for finding in findings):
        findings += _refused(source)
    return replace(looked, excluded=excluded, home=home, findings=tuple(dict.fromkeys(findings)))


def _refused(source: ArmFile) -> list[FileFinding]:
    """What the reader of models says against the file itself."""
    try:
        make_robot(source.path)
    except (RobotModelError, ParameterError) as error:
        return [repaired(source.path.name, f"is not taken as it is: {error}", "--write makes a model that is")]
    return []


def _bystanders(anatomy: Anatomy) -> list[FileFinding]:
    """What stands about and is no part of the arm."""
    if not (names := anatomy.bystanders):
        return []
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    text = "of the file, which no joint of the arm moves and its base does not hold, is neither measured nor avoided"
    return [FileFinding(", ".join(f"'{name}'" for name in names[:3]) + more, text)]


def _unused(name: str, taken: set[str]) -> str:
    """A name that is not taken: itself, or with the first number that makes it another one."""
    others = (f"{name} {k}" for k in range(2, len(taken) + 3))
    return next(one for one in (name, *others) if one not in taken)


def _names(anatomy: Anatomy) -> list[str]:
    return [*(link.body for link in anatomy.links), *anatomy.joints]


# ---- limits, pairs, home -------------------------------------------------------------------------------


def _table(source: ArmFile, wanted: Preparation) -> tuple[Path, LimitTable] | None:
    """The table of limits that the user names, or the one beside the file."""
    beside = _beside(source)
    path = wanted.limits or (beside if beside.is_file() else None)
    return None if path is None else (path, read_limits(path, partial=True))


def _beside(source: ArmFile) -> Path:
    return source.path.with_suffix(".limits.toml")


def _group(
    source: ArmFile, wanted: Preparation, stated: tuple[Path, LimitTable] | None, findings: list[FileFinding]
) -> int:
    """Geom group of the capsules; the reader of models knows what the table beside the file says of it."""
    told = source.group if stated is None or stated[1].group is None else stated[1].group
    group = told if wanted.group is None else wanted.group
    known = stated is not None and stated[0] == _beside(source)
    if group != (told if known else source.group):
        advice = f"write group = {group} into {_beside(source).name}, or --write makes a model with group 3"
        findings.append(repaired("the capsules", f"are looked for in geom group {group}", advice))
    return group


def _limits(
    source: ArmFile, anatomy: Anatomy, stated: tuple[Path, LimitTable] | None, findings: list[FileFinding]
) -> LimitTable:
    if stated is not None:
        path, table = stated
        for name in ("velocity", "acceleration", "jerk"):
            if getattr(table, name).shape != (anatomy.n,):
                got = getattr(table, name).shape
                raise RobotModelError(f"{path.name}: {name} limits have shape {got}, expected ({anatomy.n},)")
        if table.guessed:
            findings.append(
                FileFinding("the limits", f"of {', '.join(table.guessed)} are a guess, as {path.name} says")
            )
        return table
    table = guess_limits(anatomy.joints, source.velocity, source.path.name)
    text = f"of {', '.join(table.guessed)} are a guess"
    findings.append(repaired("the limits", text, "state yours in a table and give --limits FILE.toml"))
    return table


def _posed(arm: Examination, findings: list[FileFinding]) -> tuple[Array, tuple[tuple[str, str], ...]]:
    """Home posture, and the pairs of capsules that are no self-collision."""
    anatomy = arm.anatomy
    named = arm.named_capsules()
    capsules: NDArray = np.array([(c.start, c.end, c.radius, link) for _, link, c in named], CAPSULE)
    if not len(capsules):
        findings.append(obstacle("the arm", "has no capsules", "leave one link covered at least"))
        return np.array(rounded(anatomy.ranges.mean(axis=1))), ()
    pairs = all_pairs(capsules["link"])
    postures = rounded(some_postures(anatomy.ranges))
    looked = look(anatomy.chain, capsules, pairs, anatomy.tool, postures)
    stated = _stated_home(arm)
    dropped = useless(looked.own)
    if stated is not None:
        dropped |= look(anatomy.chain, capsules, pairs, anatomy.tool, stated[None]).own[0] <= 0.0
    excluded = tuple((named[i][0], named[j][0]) for i, j in pairs[dropped])
    often = useless(looked.own)[dropped]
    for (one, other), share, most in zip(excluded, (looked.own < 0.0).mean(axis=0)[dropped], often, strict=True):
        text = f"overlap in {100.0 * share:.0f} % of all postures" if most else "overlap at home"
        findings.append(FileFinding(f"capsules '{one}' and '{other}'", text, "they are no self-collision"))
    home = stated
    if home is None:
        kept = Looked(looked.own[:, ~dropped], looked.table, looked.tip)
        home = find_home(postures, kept, anatomy.ranges, anatomy.reach, anatomy.chain["offset"][0])
        if home is None:
            text = "has no posture clear of table and itself"
            findings.append(
                obstacle("the arm", text, f"give --home; nearest: {_nearest(named, pairs, looked, dropped)}")
            )
            return rounded(anatomy.ranges.mean(axis=1)), excluded
        findings.append(FileFinding("home", f"was looked for: {home.tolist()}", "give --home for another posture"))
    elif (low := _below(anatomy.chain, capsules, named, home)) is not None:
        findings.append(obstacle("home", f"{low}", "give --home for another posture"))
    return home, excluded


def _stated_home(arm: Examination) -> Array | None:
    """What the user says, or the file's keyframe ``home``, or its first one."""
    ranges, model = arm.anatomy.ranges, arm.source.model
    if (home := arm.preparation.home) is not None:
        if len(home) != arm.anatomy.n or not np.all((ranges[:, 0] <= home) & (home <= ranges[:, 1])):
            raise ParameterError(
                f"home has to be {arm.anatomy.n} numbers inside of {ranges.tolist()}, got {list(home)}"
            )
        return np.array(home, float)
    keys = sorted(range(model.nkey), key=lambda k: model.key(k).name != "home")
    for k in keys:
        home = model.key_qpos[k, [model.jnt_qposadr[j] for j in arm.chain.joints]]
        if np.all((ranges[:, 0] <= home) & (home <= ranges[:, 1])):
            return np.array(home)
    return None


def _below(chain: NDArray, capsules: NDArray, named: list[tuple[str, int, Enclosure]], home: Array) -> str | None:
    for (name, _, _), one in zip(named, capsules, strict=True):
        height = look(chain, one[None], np.zeros((0, 2), np.int64), np.zeros(3), home[None]).table[0]
        if height <= 0.0:
            return f"has capsule '{name}' {-1e3 * height:.0f} mm below the base's own height"
    return None


def _nearest(
    named: list[tuple[str, int, Enclosure]], pairs: ArrayLike, looked: Looked, dropped: NDArray[np.bool_]
) -> str:
    """What is in the way in the best of the postures."""
    own = np.where(dropped, np.inf, looked.own)
    best = int(np.argmax(np.minimum(looked.table, own.min(axis=1, initial=np.inf))))
    if looked.table[best] <= own[best].min(initial=np.inf):
        return f"the table, {-1e3 * looked.table[best]:.0f} mm deep"
    i, j = np.asarray(pairs)[int(np.argmin(own[best]))]
    return f"'{named[i][0]}' and '{named[j][0]}', {-1e3 * own[best].min():.0f} mm deep"
