"""A trained policy: a network, and what its answers mean."""

import json
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.control.commands import MODES, Commands, JPCAction
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies.network import Network
from jssa_gym.robots import ROBOTS, JointLimits, RobotModel, make_robot
from jssa_gym.shields.wrappers import layer_of
from jssa_gym.types import Array, JointState
from jssa_gym.validation import known_name, positive_integer, positive_share, true_or_false

CONTROLS = ("jerk", *MODES)
"""What a network's answer can be."""


@dataclass(frozen=True, slots=True, eq=False)
class LearnedPolicy:
    """Maps an observation to a jerk, memoryless: the same observation, the same action.

    It is asked in every control tick. What the network answers is either the jerk itself, as a share of its bounds, or
    a position or velocity command, which the loops of :class:`~jssa_gym.control.JPCAction` turn into jerk. These need
    the joint state, which every observation of :class:`~jssa_gym.envs.arm.ArmEnv` begins with: positions, velocities
    and accelerations of the n joints as shares of the limits, clipped to 1.5 and 2; states beyond are taken as these.

    A policy knows nothing of shields: whatever is around the environment stays as it is.

    Args:
        network: From the observation to the commands.
        control: ``"jerk"``, or what JPCAction calls its ``mode``: ``"position"``, ``"velocity"``, ``"tip"``.
        share: Share of the velocity and acceleration limits that a command may use, in (0, 1].
        ticks: For how many control ticks an action was held in training; says where a policy comes from, no more.
        limits: Joint limits of the robot that it was trained with.
        task: Name of the task that it was trained for.
        robot: Name of that robot; for ``"tip"`` one of :data:`~jssa_gym.robots.ROBOTS`.
        observes_intervention: Whether the observation's last number is not the environment's but tells of the shield.
        provenance: Where it comes from, as JSON can hold it; copied.

    Raises:
        ParameterError: An argument is unknown or out of range, or the network's sizes do not fit the limits.
    """

    network: Network
    _: KW_ONLY
    control: str
    share: float
    ticks: int
    limits: JointLimits
    task: str
    robot: str
    observes_intervention: bool = False
    provenance: Mapping[str, Any] = field(default_factory=dict)
    _commands: Commands | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.network, Network) or not isinstance(self.limits, JointLimits):
            raise ParameterError("a policy needs a Network and JointLimits")
        known_name("control", self.control, CONTROLS)
        share = positive_share("share", self.share)
        for name in ("task", "robot"):
            if not isinstance(getattr(self, name), str):
                raise ParameterError(f"{name} has to be a name, got {getattr(self, name)!r}")
        observes = true_or_false("observes_intervention", self.observes_intervention)
        n = len(self.limits.jerk)
        commands = None if self.control == "jerk" else Commands(self.limits, self.control, share, self._model())
        wanted = n if commands is None else commands.size
        if self.network.outputs != wanted:
            raise ParameterError(
                f"the network answers with {self.network.outputs} numbers, control {self.control!r} of {n} joints has "
                f"{wanted}"
            )
        if self.network.inputs < 3 * n + observes:
            raise ParameterError(
                f"the network takes {self.network.inputs} numbers, too few for the state of {n} joints"
            )
        for name, value in (
            ("share", share),
            ("ticks", positive_integer("ticks", self.ticks)),
            ("observes_intervention", observes),
            ("provenance", _plain(self.provenance)),
            ("_commands", commands),
        ):
            object.__setattr__(self, name, value)

    def _model(self) -> RobotModel | None:
        """The arm whose tool is commanded: one of the package's, since a file must not have others read."""
        if self.control != "tip":
            return None
        robot = make_robot(known_name("robot", self.robot, ROBOTS))
        if robot.n != len(self.limits.jerk):
            raise ParameterError(f"{self.robot} has {robot.n} joints, the limits have {len(self.limits.jerk)}")
        return robot

    def __repr__(self) -> str:
        sizes = " → ".join(str(len(x)) for x in (self.network.mean, *(bias for _, bias in self.network.layers)))
        return f"LearnedPolicy(task={self.task!r}, control={self.control!r}, robot={self.robot!r}, network={sizes})"

    def __call__(self, observation: Any) -> Array:
        """The jerk as a share of its bounds, in [-1, 1], shape (n,).

        NaN in every entry for an observation that is not finite: a shield then brakes, and an environment without one
        refuses the action. No jerk would be right, and a policy does not decide how an arm stops.

        Args:
            observation: Shape (n_obs,).

        Raises:
            ParameterError: It is no array of real numbers of that shape.
        """
        x = self._checked(observation)
        return self._followed(x, self.network(x))

    def command(self, observation: Any) -> Array:
        """What the network answers, in [-1, 1]; :meth:`jerk` makes a jerk of it, in this tick or later."""
        return self.network(self._checked(observation))

    def jerk(self, observation: Any, command: Array) -> Array:
        """The jerk that follows a command, as :meth:`__call__` returns it.

        Args:
            observation: Of this tick, shape (n_obs,).
            command: Of :meth:`command`, of this tick or an earlier one.
        """
        return self._followed(self._checked(observation), command)

    def _followed(self, observation: Array, command: Array) -> Array:
        if not np.all(np.isfinite(observation)):
            return np.full(len(self.limits.jerk), np.nan)
        if self._commands is None:
            return command
        return self._commands.jerk(self.joint_state(observation), command)

    @property
    def commands(self) -> Commands | None:
        """What turns the network's answer into jerk; None where that is what it says."""
        return self._commands

    def with_provenance(self, provenance: Mapping[str, Any]) -> "LearnedPolicy":
        """The same policy that says something else about where it comes from."""
        return replace(self, provenance=provenance)

    def joint_state(self, observation: Array) -> JointState:
        """The joint state that an observation begins with, or those that many begin with, of fields (..., n).

        Args:
            observation: Shape (..., n_obs).
        """
        limits, n = self.limits, len(self.limits.jerk)
        position, velocity, acceleration = np.split(observation[..., : 3 * n], 3, axis=-1)
        low, high = limits.position.T
        return JointState(
            (low + high) / 2.0 + position * ((high - low) / 2.0),
            velocity * limits.velocity,
            acceleration * limits.acceleration,
        )

    def check(self, env: gym.Env) -> None:
        """Whether this policy was trained for such an environment.

        Args:
            env: With all wrappers that change the observation.

        Raises:
            ParameterError: The task is another, or the robot's limits, the observation's size or the action's are; of
                ``"tip"``, its geometry; or the environment turns commands into jerk itself.
        """
        task = getattr(getattr(env.unwrapped, "task", None), "name", self.task)
        if self.task and task != self.task:
            raise ParameterError(f"the policy was trained for task {self.task!r}, this is {task!r}")
        robot: RobotModel = env.get_wrapper_attr("robot")
        limits = robot.limits
        self._check_commands(env, robot)
        for name, wanted, found in (
            ("action", self.limits.jerk.shape, env.action_space.shape),
            ("observation", (self.network.inputs,), env.observation_space.shape),
        ):
            if wanted != found:
                task = f": it is a policy of task {self.task!r}" if self.task else ""
                told = "; its last entry tells of the shield" if self.observes_intervention else ""
                raise ParameterError(
                    f"the policy was trained with an {name} of shape {wanted}{told}, the environment has {found}{task}"
                )
        for name in ("position", "velocity", "acceleration", "jerk"):
            wanted, found = getattr(self.limits, name), getattr(limits, name)
            if not np.array_equal(wanted, found):
                raise ParameterError(
                    f"the policy was trained with {name} limits {wanted.tolist()}, the robot {robot.name} has "
                    f"{found.tolist()}"
                )

    def _check_commands(self, env: gym.Env, robot: RobotModel) -> None:
        """Whether the jerk that is made of commands is one for this arm, and nothing is made of it again."""
        if self._commands is None:
            return
        if layer_of(env, JPCAction) is not None:
            raise ParameterError(
                f"the policy turns its {self.control} commands into jerk itself: take JPCAction off the environment"
            )
        own = self._commands.robot
        if own is not None and not (
            np.array_equal(own.mounted(robot.mount).links, robot.links)
            and own.tool_link == robot.tool_link
            and np.array_equal(own.tool_offset, robot.tool_offset)
        ):
            raise ParameterError(
                f"the policy commands the tool of the package's {self.robot}, the environment's {robot.name} has "
                "another geometry"
            )

    def _checked(self, observation: Any) -> Array:
        try:
            array = np.asarray(observation)
        except ValueError:
            array = np.asarray(None)
        if array.shape != self.network.mean.shape or array.dtype.kind not in "fiu":
            raise ParameterError(
                f"an observation of this policy has {self.network.inputs} real numbers, got {array.dtype} of shape "
                f"{array.shape}"
            )
        return array.astype(np.float64)


def _plain(provenance: Any) -> dict[str, Any]:
    """A copy of what JSON can hold."""
    try:
        copied = json.loads(json.dumps(provenance, allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise ParameterError(f"provenance has to be what JSON can hold: {error}") from error
    if not isinstance(copied, dict):
        raise ParameterError(f"provenance has to be a mapping, got {provenance!r}")
    return copied
