"""Keypoints of cameras to people as shields take them: capsules with velocities, ages and errors."""

from jssa_gym.perception.detector import Frame, TrackerParams
from jssa_gym.perception.skeletons import SKELETONS, BodyPart, KeypointTable, make_skeleton
from jssa_gym.perception.tracker import Tracked, Tracker

__all__ = [
    "SKELETONS",
    "BodyPart",
    "Frame",
    "KeypointTable",
    "Tracked",
    "Tracker",
    "TrackerParams",
    "make_skeleton",
]
