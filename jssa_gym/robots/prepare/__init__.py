"""From anybody's arm file, MJCF or URDF, to a model that can be guarded."""

from jssa_gym.robots.findings import FileFinding
from jssa_gym.robots.prepare.covering import Cover
from jssa_gym.robots.prepare.examine import Examination, Preparation, examine
from jssa_gym.robots.prepare.writing import write_prepared

__all__ = ["Cover", "Examination", "FileFinding", "Preparation", "examine", "write_prepared"]
