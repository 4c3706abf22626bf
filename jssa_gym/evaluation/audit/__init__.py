"""Logs of a robot and of people, judged: what was, and what a shield would have made of it."""

from jssa_gym.evaluation.audit.log import RobotLog, read_log
from jssa_gym.evaluation.audit.result import Audit, AuditedStretch, ClosestApproach, Intervention
from jssa_gym.evaluation.audit.run import PersonTrack, audit, read_person

__all__ = [
    "Audit",
    "AuditedStretch",
    "ClosestApproach",
    "Intervention",
    "PersonTrack",
    "RobotLog",
    "audit",
    "read_log",
    "read_person",
]
