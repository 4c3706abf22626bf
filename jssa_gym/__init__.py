"""A robot arm beside people: Gymnasium environments and safety shields that act on joint jerk.

Importing the package registers its environments and loads nothing heavy; the public names below are loaded when they
are first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from jssa_gym.exceptions import JSSAGymError
from jssa_gym.registration import HORIZON, register_ids

if TYPE_CHECKING:
    from jssa_gym.certificate.boundary import Domain
    from jssa_gym.certificate.certify import certify
    from jssa_gym.control import (
        JointJerk,
        JointPosition,
        JointVelocity,
        JPCAction,
        TipVelocity,
        ToolPose,
        Twist,
    )
    from jssa_gym.control.vector import VectorJPCAction
    from jssa_gym.envs.arm import ArmEnv
    from jssa_gym.envs.check import EnvReport, check_env
    from jssa_gym.envs.faults import FAULTS, SensorFaults
    from jssa_gym.envs.repeat import ActionRepeat
    from jssa_gym.envs.sensor import SensorModel
    from jssa_gym.envs.tasks import TASKS, Task
    from jssa_gym.envs.vector import VectorActionRepeat, VectorArmEnv
    from jssa_gym.envs.vector.sensors import VectorSensorModel
    from jssa_gym.evaluation import RecordSafety, Report, SeparationParams, evaluate
    from jssa_gym.evaluation.record_vector import VectorRecordSafety
    from jssa_gym.guard import Guard, GuardAnswer
    from jssa_gym.humans import HUMANS, HumanMotion, Walk, make_human
    from jssa_gym.policies import (
        POLICIES,
        HoldPolicy,
        JPCPolicy,
        LearnedPolicy,
        RandomPolicy,
        StraightPolicy,
        VectorJPCPolicy,
        load_policy,
    )
    from jssa_gym.policies.vector import make_vector_policy
    from jssa_gym.robots import ROBOTS, JointLimits, RobotModel
    from jssa_gym.safety.failsafe import FailsafeParams
    from jssa_gym.safety.index import IndexParams
    from jssa_gym.safety.region import WatchedRegion
    from jssa_gym.safety.tracking import measure_tracking
    from jssa_gym.shields import FILTERS, JSSAOptions, JSSAShield, SafetyFilter, Shield, make_filter
    from jssa_gym.shields.vector import VectorShield
    from jssa_gym.types import CapsuleSet, Decision, JointState, MeasuredPeople, Planes, Scene, Status

__version__ = "0.2.0"

_HOMES = {
    "ActionRepeat": "jssa_gym.envs.repeat",
    "ArmEnv": "jssa_gym.envs.arm",
    "CapsuleSet": "jssa_gym.types",
    "Decision": "jssa_gym.types",
    "Domain": "jssa_gym.certificate.boundary",
    "EnvReport": "jssa_gym.envs.check",
    "FAULTS": "jssa_gym.envs.faults",
    "FILTERS": "jssa_gym.shields",
    "FailsafeParams": "jssa_gym.safety.failsafe",
    "Guard": "jssa_gym.guard",
    "GuardAnswer": "jssa_gym.guard",
    "HUMANS": "jssa_gym.humans",
    "HoldPolicy": "jssa_gym.policies",
    "HumanMotion": "jssa_gym.humans",
    "IndexParams": "jssa_gym.safety.index",
    "JPCAction": "jssa_gym.control",
    "JPCPolicy": "jssa_gym.policies",
    "JSSAOptions": "jssa_gym.shields",
    "JSSAShield": "jssa_gym.shields",
    "JointJerk": "jssa_gym.control",
    "JointLimits": "jssa_gym.robots",
    "JointPosition": "jssa_gym.control",
    "JointState": "jssa_gym.types",
    "JointVelocity": "jssa_gym.control",
    "LearnedPolicy": "jssa_gym.policies",
    "MeasuredPeople": "jssa_gym.types",
    "POLICIES": "jssa_gym.policies",
    "Planes": "jssa_gym.types",
    "ROBOTS": "jssa_gym.robots",
    "RandomPolicy": "jssa_gym.policies",
    "RecordSafety": "jssa_gym.evaluation",
    "Report": "jssa_gym.evaluation",
    "RobotModel": "jssa_gym.robots",
    "SafetyFilter": "jssa_gym.shields",
    "Scene": "jssa_gym.types",
    "SensorFaults": "jssa_gym.envs.faults",
    "SensorModel": "jssa_gym.envs.sensor",
    "SeparationParams": "jssa_gym.evaluation",
    "Shield": "jssa_gym.shields",
    "Status": "jssa_gym.types",
    "StraightPolicy": "jssa_gym.policies",
    "TASKS": "jssa_gym.envs.tasks",
    "Task": "jssa_gym.envs.tasks",
    "TipVelocity": "jssa_gym.control",
    "ToolPose": "jssa_gym.control",
    "Twist": "jssa_gym.control",
    "VectorActionRepeat": "jssa_gym.envs.vector",
    "VectorArmEnv": "jssa_gym.envs.vector",
    "VectorJPCAction": "jssa_gym.control.vector",
    "VectorJPCPolicy": "jssa_gym.policies",
    "VectorRecordSafety": "jssa_gym.evaluation.record_vector",
    "VectorSensorModel": "jssa_gym.envs.vector.sensors",
    "VectorShield": "jssa_gym.shields.vector",
    "Walk": "jssa_gym.humans",
    "WatchedRegion": "jssa_gym.safety.region",
    "certify": "jssa_gym.certificate.certify",
    "check_env": "jssa_gym.envs.check",
    "evaluate": "jssa_gym.evaluation",
    "load_policy": "jssa_gym.policies",
    "make_filter": "jssa_gym.shields",
    "make_human": "jssa_gym.humans",
    "make_vector_policy": "jssa_gym.policies.vector",
    "measure_tracking": "jssa_gym.safety.tracking",
}

__all__ = [
    "FAULTS",
    "FILTERS",
    "HORIZON",
    "HUMANS",
    "POLICIES",
    "ROBOTS",
    "TASKS",
    "ActionRepeat",
    "ArmEnv",
    "CapsuleSet",
    "Decision",
    "Domain",
    "EnvReport",
    "FailsafeParams",
    "Guard",
    "GuardAnswer",
    "HoldPolicy",
    "HumanMotion",
    "IndexParams",
    "JPCAction",
    "JPCPolicy",
    "JSSAGymError",
    "JSSAOptions",
    "JSSAShield",
    "JointJerk",
    "JointLimits",
    "JointPosition",
    "JointState",
    "JointVelocity",
    "LearnedPolicy",
    "MeasuredPeople",
    "Planes",
    "RandomPolicy",
    "RecordSafety",
    "Report",
    "RobotModel",
    "SafetyFilter",
    "Scene",
    "SensorFaults",
    "SensorModel",
    "SeparationParams",
    "Shield",
    "Status",
    "StraightPolicy",
    "Task",
    "TipVelocity",
    "ToolPose",
    "Twist",
    "VectorActionRepeat",
    "VectorArmEnv",
    "VectorJPCAction",
    "VectorJPCPolicy",
    "VectorRecordSafety",
    "VectorSensorModel",
    "VectorShield",
    "Walk",
    "WatchedRegion",
    "__version__",
    "certify",
    "check_env",
    "evaluate",
    "load_policy",
    "make_filter",
    "make_human",
    "make_vector_policy",
    "measure_tracking",
]


_PACKAGES = (
    *("board", "certificate", "control", "datasets", "engine", "envs", "evaluation", "guard", "hardware", "humans"),
    *("paper", "perception", "plots", "policies", "robots", "safety", "shields", "train", "types", "viewer"),
)


def __getattr__(name: str) -> Any:
    if name in _PACKAGES:
        return importlib.import_module(f"jssa_gym.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


register_ids()
