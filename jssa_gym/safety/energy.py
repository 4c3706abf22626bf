r"""How much energy a body part may be given in a contact, and which speed keeps below it; indicative, not certified.

The model of ISO/TS 15066:2016, Annex A, for transient contacts: two masses and a spring. A contact at the speed v
transfers at most :math:`E = \tfrac12 \mu v^2` with the reduced mass :math:`1/\mu = 1/m_h + 1/m_r` of the body region
and the robot. The mass :math:`m_r` that an arm presents along a normal has no bound over all postures and points: near
a joint's axis, and where the arm is stretched, it grows without end. But :math:`\mu < m_h` whatever it is, so

.. math:: v = \sqrt{2 E / m_h}

is sound in every posture, at every point and for every arm.
"""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass

from jssa_gym.safety.parts import FOOT_PARTS, LIMB_PARTS, is_called


@dataclass(frozen=True, slots=True)
class BodyRegion:
    """A region of the body model."""

    force: float
    """Largest permissible force of a transient contact [N]: twice the quasi-static one, for the head just that."""
    stiffness: float
    """Stiffness of the spring [N/m]."""
    mass: float
    """Effective mass [kg]."""

    @property
    def energy(self) -> float:
        """Largest energy of the spring, :math:`F^2 / 2k` [J]."""
        return self.force**2 / (2.0 * self.stiffness)


HEAD = (BodyRegion(130.0, 150e3, 4.4), BodyRegion(65.0, 75e3, 4.4))
"""Skull and face: quasi-static forces, since contacts with the head are not meant at all."""
NECK = (BodyRegion(300.0, 50e3, 1.2),)
TRUNK = (
    BodyRegion(420.0, 35e3, 40.0),
    BodyRegion(280.0, 25e3, 40.0),
    BodyRegion(220.0, 10e3, 40.0),
    BodyRegion(360.0, 25e3, 40.0),
)
"""Back and shoulders, chest, abdomen, pelvis."""
UPPER_ARM = (BodyRegion(300.0, 30e3, 3.0),)
FOREARM = (BodyRegion(320.0, 40e3, 2.0),)
HAND = (BodyRegion(280.0, 75e3, 0.6),)
THIGH = (BodyRegion(440.0, 50e3, 75.0),)
SHIN = (BodyRegion(260.0, 60e3, 75.0),)

_ALL = (*HEAD, *NECK, *TRUNK, *UPPER_ARM, *FOREARM, *HAND, *THIGH, *SHIN)

_CALLED = (
    (
        (("forearm", "lower arm", "wrist"), FOREARM),
        (("upper arm", "elbow"), UPPER_ARM),
        (("hand", "palm", "fist", "finger", "thumb"), HAND),
        (LIMB_PARTS, UPPER_ARM + FOREARM + HAND),
    ),
    (
        (FOOT_PARTS, SHIN),
        (("thigh", "upper leg", "knee"), THIGH),
        (("leg",), THIGH + SHIN),
    ),
    ((("head", "skull", "face"), HEAD),),
    ((("neck",), NECK),),
    (
        (
            ("torso", "trunk", "body", "chest", "spine", "hip", "pelvis", "back", "abdomen", "belly", "shoulder"),
            TRUNK,
        ),
    ),
)
"""Words in a body part's name, and the regions that it may be: of each group the first that fits, of all groups."""


@functools.lru_cache(maxsize=256)  # asked again of every touch
def regions_of(part: str) -> tuple[BodyRegion, ...]:
    """The regions that a body part of this name may be; all of them for a name that says nothing that is known."""
    found = (next((regions for words, regions in group if is_called(part, words)), ()) for group in _CALLED)
    return tuple(region for regions in found for region in regions) or _ALL


def mass_of(part: str) -> float:
    """Largest effective mass of the regions of a body part [kg]."""
    return max(region.mass for region in regions_of(part))


def energy_limit(part: str) -> float:
    """Least energy limit of the regions of a body part [J]; indicative."""
    return min(region.energy for region in regions_of(part))


def speed_for(energy: float, part: str) -> float:
    """Speed of the arm's touching point at which a body part is given no more than an energy [J], [m/s]."""
    return math.sqrt(2.0 * energy / mass_of(part))


CONTACT_ENERGY: Mapping[str, float] = {
    part: energy_limit(part) for part in ("head", "core_body", "right_arm", "left_arm", "right_leg", "left_leg")
}
"""For ``FailsafeParams(contact_energy=...)``: limits of this package's own people [J]. Indicative: before anything is
built ISO 10218-2:2025, which took the place of ISO/TS 15066, has to be asked."""
