"""Which capsules each link of an arm gets: those of its file if they hold what it draws, else new ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jssa_gym.robots.coverage import TOLERATED, coverage, fault_of_cover
from jssa_gym.robots.findings import FileFinding
from jssa_gym.robots.mjcf import carrier_links
from jssa_gym.robots.prepare.anatomy import Anatomy, Link
from jssa_gym.robots.prepare.chain import Chain
from jssa_gym.robots.prepare.enclose import Enclosure, Solid, enclose, farthest_out, fit
from jssa_gym.robots.reading import ArmFile
from jssa_gym.types import Array


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """How one link's drawn surface lies in capsules."""

    joint: str
    body: str
    found: tuple[str, ...]
    """Names of the capsules that the file gives it."""
    own: float
    """Farthest drawn point outside of those [m]; inf without any, 0 if all lie inside or nothing is drawn."""
    arm: float
    """The same outside of all capsules of the file, in the posture with all joints at 0 [m]."""
    kept: tuple[Enclosure, ...]
    """Those capsules if they hold all that is drawn, else none; in the link's frame."""
    capsules: tuple[Enclosure, ...]
    """Those of the prepared model."""
    left: float
    """Farthest drawn point outside of these [m]; negative where all lie inside; inf for uncovered links."""
    ratios: tuple[float, ...] = ()
    """Volume of each new capsule over that of the convex hull of what it holds; empty where none is new."""
    alone: float = np.nan
    """The same of one capsule around all of it, where there are several."""

    @property
    def named_by_file(self) -> bool:
        """Whether its capsules are those of the file, and have names there."""
        return self.capsules is self.kept and not any(name.startswith("geom ") for name in self.found)

    def named(self) -> list[tuple[str, Enclosure]]:
        """The capsules of the prepared model with names: those of the file where it gives them, else the link's."""
        if self.named_by_file:
            return list(zip(self.found, self.capsules, strict=True))
        several = len(self.capsules) > 1
        return [(self.body + (f"_{k + 1}" if several else ""), one) for k, one in enumerate(self.capsules)]


def cover_links(
    source: ArmFile, chain: Chain, anatomy: Anatomy, uncovered: Sequence[str], findings: list[FileFinding]
) -> tuple[Cover, ...]:
    """How every link lies in the file's capsules, and capsules for those that do not.

    Args:
        source: The file.
        chain: What moves.
        anatomy: The arm.
        uncovered: Links, by body or joint, that get no capsules.
        findings: What is found is added.
    """
    model, joints = source.model, list(chain.joints)
    looked = coverage(model, joints, carrier_links(model, joints), model.qpos0, anatomy.group)
    accepted = {one.link for one in looked if not fault_of_cover(one)}
    offsets = anatomy.chain["offset"].cumsum(axis=0)
    everywhere = [
        Enclosure(start + offset, end + offset, radius)
        for link, offset in zip(anatomy.links, offsets, strict=True)
        for start, end, radius in link.found
    ]
    covers = []
    for i, (joint, link, offset) in enumerate(zip(anatomy.joints, anatomy.links, offsets, strict=True)):
        cover = _cover(joint, link, offset, everywhere, joint in uncovered or link.body in uncovered)
        covers.append(cover)
        if link.solid is not None and (told := _told(cover, i in accepted)):
            findings.append(told)
    return tuple(covers)


def _cover(joint: str, link: Link, offset: Array, everywhere: list[Enclosure], uncovered: bool) -> Cover:
    if link.solid is None:
        return Cover(joint, link.body, link.names, 0.0, 0.0, link.found, link.found, -np.inf)
    own = farthest_out(link.solid, list(link.found))
    arm = farthest_out(Solid(link.solid.triangles + offset, link.solid.radius), everywhere)
    kept = link.found if own <= TOLERATED else ()
    whole = None if uncovered or kept else fit(link.solid)
    fits = enclose(link.solid, whole=whole) if whole else []
    capsules = () if uncovered else kept or tuple(one.capsule for one in fits)
    left = farthest_out(link.solid, list(capsules))
    ratios = tuple(one.ratio for one in fits)
    alone = whole.ratio if whole and len(fits) > 1 else np.nan
    return Cover(joint, link.body, link.names, max(own, 0.0), max(arm, 0.0), kept, capsules, left, ratios, alone)


def _told(cover: Cover, accepted: bool) -> FileFinding | None:
    """What there is to say about a link; ``accepted`` if the reader of models takes it as the file has it."""
    subject = f"link '{cover.body}'"
    if not cover.capsules:
        text = "is uncovered: nothing is measured there, and nothing is promised about it"
        return FileFinding(subject, text)
    if cover.own <= TOLERATED and cover.found:
        return None
    more = f"--write makes {len(cover.capsules)} capsule{'s' if len(cover.capsules) > 1 else ''} of radius "
    more += ", ".join(f"{1e3 * capsule.radius:.0f}" for capsule in cover.capsules) + " mm around it"
    more += f", {' and '.join(f'{ratio:.1f}' for ratio in cover.ratios)} times the hull of what each holds"
    more += f" (one would be {cover.alone:.1f} times)" if len(cover.ratios) > 1 else ""
    remedy = f"{more}, or give --uncovered {cover.body}"
    if cover.found:
        text = f"reaches {1e3 * cover.own:.0f} mm out of its own capsules and {1e3 * cover.arm:.0f} mm out of all"
    else:
        text = "draws something and has no capsule"
        text += ", but turns inside those of the link before it" if accepted else ""
    return FileFinding(subject, text, remedy, fits=accepted)
