"""Nominal controllers: what a joint should do when nobody is near."""

from jssa_gym.control.cascade import Cascade
from jssa_gym.control.commands import (
    Command,
    Commands,
    JointJerk,
    JointPosition,
    JointVelocity,
    JPCAction,
    TipVelocity,
    ToolPose,
    Twist,
)
from jssa_gym.control.follower import Follower
from jssa_gym.control.jpc import JPC, Event, Phase
from jssa_gym.control.moves import plan_approach, plan_brake, plan_move
from jssa_gym.control.path import PacedPath
from jssa_gym.control.plan import Plan, plan_waypoints
from jssa_gym.control.resolved import ResolvedRates
from jssa_gym.control.yielding import YieldingJPC

__all__ = [
    "JPC",
    "Cascade",
    "Command",
    "Commands",
    "Event",
    "Follower",
    "JPCAction",
    "JointJerk",
    "JointPosition",
    "JointVelocity",
    "PacedPath",
    "Phase",
    "Plan",
    "ResolvedRates",
    "TipVelocity",
    "ToolPose",
    "Twist",
    "YieldingJPC",
    "plan_approach",
    "plan_brake",
    "plan_move",
    "plan_waypoints",
]
