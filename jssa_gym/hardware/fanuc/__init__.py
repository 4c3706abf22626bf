"""FANUC arms by Stream Motion (option J519): one joint position every 8 ms, behind a guard.

The packets are those of ``airo-fanuc``, which the extra ``fanuc`` installs. Nothing here has moved a real arm: it was
tried against that package's own simulated controller. See docs/controller.md. ``stream`` is the adapter, of which
``link``, ``packets``, ``program`` and ``axes`` are parts.
"""

from jssa_gym.hardware.fanuc.axes import LR_MATE, Axes, Tables
from jssa_gym.hardware.fanuc.link import UdpLink
from jssa_gym.hardware.fanuc.program import Program
from jssa_gym.hardware.fanuc.stream import FanucStream

__all__ = ["LR_MATE", "Axes", "FanucStream", "Program", "Tables", "UdpLink"]
