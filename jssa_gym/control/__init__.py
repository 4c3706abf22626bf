"""Nominal controllers: what a joint should do when nobody is near."""

from jssa_gym.control.cascade import Cascade
from jssa_gym.control.commands import Commands, JPCAction
from jssa_gym.control.jpc import JPC, Event, Phase
from jssa_gym.control.moves import plan_approach, plan_brake, plan_move
from jssa_gym.control.plan import Plan, plan_waypoints
from jssa_gym.control.resolved import ResolvedRates

__all__ = [
    "JPC",
    "Cascade",
    "Commands",
    "Event",
    "JPCAction",
    "Phase",
    "Plan",
    "ResolvedRates",
    "plan_approach",
    "plan_brake",
    "plan_move",
    "plan_waypoints",
]
