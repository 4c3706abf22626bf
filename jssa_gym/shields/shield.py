"""Wrappers that put a filter between a policy and an environment."""

import copy
import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Literal, Self

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.kernels.motion import scale_nominal, to_shares
from jssa_gym.robots import RobotModel
from jssa_gym.safety.action import checked_action, taken_action
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.jssa import JSSAFilter
from jssa_gym.shields.reasons import reason_code
from jssa_gym.shields.wrappers import refuse_other_actions
from jssa_gym.types import Decision, Scene, Status

_logger = logging.getLogger("jssa_gym")

_CORRECTION = 1e-6
"""Correction, in jerk bounds, from which a step counts as an intervention."""


def _provider(env: gym.Env, name: str) -> Any:
    """The outermost environment of a wrapper chain that has an attribute: found once, read every step."""
    layer: Any = env
    # a property counts even if it cannot answer yet: some environments know their scene only after reset
    while not (any(name in vars(kind) for kind in type(layer).__mro__) or hasattr(layer, name)):
        if not isinstance(layer, gym.Wrapper):
            raise InterfaceError(
                f"{env} has no attribute '{name}'; a shield needs robot (RobotModel), dt [s] and scene (Scene)"
            )
        layer = layer.env
    return layer


class Shield(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Runs every action through a safety filter.

    The environment, ours or not, has to offer ``robot``, ``dt`` and ``scene``, anywhere in its wrapper chain, and
    take actions in [-1, 1]: fractions of the robot's jerk bounds, one a control step. Wrappers inside that change,
    repeat or drop actions are refused, see :func:`~jssa_gym.shields.wrappers.refuse_other_actions`. An action is read
    once; one that the filter leaves alone is forwarded as a copy, equal in values and type; others as float64, since
    rounding to float32 can break a row. Shares times bounds are the jerks that were decided, to the bit.

    Keys added to ``info``, after ``reset`` too: ``shield/status`` (int, see :class:`~jssa_gym.types.Status`),
    ``shield/reason`` (str), ``shield/reason_code`` (int, see :data:`~jssa_gym.shields.reasons.REASONS`),
    ``shield/intervened`` (bool), ``shield/phi`` [m²], ``shield/correction`` (largest change
    of a joint's action), ``shield/robot_pair`` and ``shield/human_pair`` (capsule numbers, -1 for none),
    ``shield/slack`` [m²].

    Args:
        env: The environment.
        filter: A filter built for the same robot and time step. It is copied: it has a state, which no two
            environments must share; the shield's own is its attribute ``filter``.

    Raises:
        InterfaceError: The environment lacks an attribute, has a wrapper that belongs outside, filter and environment
            differ, or the filter cannot be copied.
    """

    def __init__(self, env: gym.Env, filter: SafetyFilter) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, filter=filter)
        gym.Wrapper.__init__(self, env)
        self._source: Any = None
        refuse_other_actions(env)
        robot = _provider(env, "robot").robot
        dt = float(_provider(env, "dt").dt)
        if not isinstance(robot, RobotModel):
            raise InterfaceError(f"robot has to be a RobotModel, got {type(robot).__name__}")
        if filter.dt != dt:
            raise InterfaceError(f"the filter's time step is {filter.dt} s, the environment's {dt} s")
        if not _same_robot(filter.robot, robot):
            raise InterfaceError(
                f"the filter is for {filter.robot.name} at {filter.robot.mount}, the environment has {robot.name} "
                f"at {robot.mount}, or their capsules or limits differ"
            )
        shape = env.action_space.shape
        if shape != (robot.n,):
            raise InterfaceError(f"the action space has shape {shape}, the robot {robot.n} joints")
        if not (np.all(env.action_space.low == -1.0) and np.all(env.action_space.high == 1.0)):  # ty: ignore[missing-attribute]
            raise InterfaceError("the action space has to be [-1, 1]: fractions of the jerk bounds")
        self.filter = copy.deepcopy(filter)
        self.last_decision: Decision | None = None
        self._jerk_bound = np.array(robot.limits.jerk)
        self._n = robot.n

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, then the filter with the scene that it starts in."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._source = _provider(self.env, "scene")
        scene = self._source.scene
        self.filter.reset(scene)
        self.last_decision = None
        self._report(info, self.filter.decide(scene, np.zeros(self._n)), 0.0)
        self.filter.reset(scene)
        return observation, info

    def rebase(self) -> None:
        """Take an arm that rests, but was moved by something else, to be where the scene says.

        Where the arm is not where the applied jerks have led, the shield keeps it at rest until ``reset``, or this.

        Raises:
            ParameterError: The arm moves, by what the shield or the scene knows, or is outside its limits, or the scene
                is no newer than the last one.
            InterfaceError: There is no scene.
        """
        scene = self._scene()
        if scene is None:
            raise InterfaceError("there is no scene to take the arm's place from")
        self.filter.rebase(scene)

    def _scene(self) -> Scene | None:
        """The present, or None if it cannot be had: the filter answers that."""
        try:
            if self._source is None:
                self._source = _provider(self.env, "scene")
            return self._source.scene
        except Exception:  # whatever a perception system throws, the arm must go on safely
            _logger.exception("no scene; the arm brakes")
            return None

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Filter the action and step the environment.

        Raises:
            InvalidActionError: Wrong shape or type, before anything moved.
        """
        # read once: what is checked, copied, is what is applied
        action = taken_action(action, self._n)
        fraction = checked_action(action, self._n)
        nominal = np.empty(self._n)
        scale_nominal(fraction, self._jerk_bound, nominal)
        decision = self.filter.decide(self._scene(), nominal)
        self.last_decision = decision
        correction = 0.0
        if decision.status != Status.NOMINAL:
            action = np.empty(self._n)
            to_shares(decision.jerk, self._jerk_bound, action)
            with np.errstate(invalid="ignore"):  # a signalling NaN in the action warns
                correction = float(np.abs(action - fraction).max())
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._report(info, decision, correction)
        return observation, reward, terminated, truncated, info

    @staticmethod
    def _report(info: dict[str, Any], decision: Decision, correction: float) -> None:
        info["shield/status"] = int(decision.status)
        info["shield/reason"] = decision.reason
        info["shield/reason_code"] = reason_code(decision)
        info["shield/intervened"] = not correction <= _CORRECTION
        info["shield/phi"] = float(decision.phi)
        info["shield/correction"] = correction
        info["shield/robot_pair"], info["shield/human_pair"] = decision.pair
        info["shield/slack"] = float(decision.slack)


def _same_robot(one: RobotModel, other: RobotModel) -> bool:
    return one is other or (
        one.n == other.n
        and one.links.tobytes() == other.links.tobytes()
        and one.capsules.tobytes() == other.capsules.tobytes()
        and np.array_equal(one.limits.bounds(), other.limits.bounds())
    )


class JSSAShield(Shield):
    r"""The jerk-based safe set algorithm around any environment of an arm.

    Projects the policy's jerk into the safe set (exact rows of all robot-human pairs, exact projection) inside bounds
    that keep the joint limits, and applies it only if a verified stop follows it. The paper's own form is
    :meth:`as_published`.

    Args:
        env: The environment; see :class:`Shield` for what it has to offer.
        lambda1: :math:`\lambda_1` [m·s].
        lambda2: :math:`\lambda_2` [m·s²].
        d_min: Safety margin :math:`d_{min}` [m].
        rows, gradient, projector, weight, static_rows: See :class:`~jssa_gym.shields.jssa.JSSAFilter`.
        sliding: See :class:`~jssa_gym.safety.index.IndexParams`.
        recovery: Share of what a step can change by which an index above 0 has to fall; 0 asks for 0 at once.
        viability: Whether the jerk is kept in bounds that keep the position, velocity and acceleration limits.
        failsafe: Whether a jerk is applied only if a verified stop follows it; or under which assumptions, as
            :class:`~jssa_gym.safety.failsafe.FailsafeParams` or a mapping of its fields (which JSON can hold).

    Raises:
        InterfaceError: The environment lacks an attribute.
        ParameterError: A parameter is out of range or unknown.
    """

    def __init__(
        self,
        env: gym.Env,
        *,
        lambda1: float = 2.0,
        lambda2: float = 0.25,
        d_min: float = 0.05,
        rows: Literal["all", "closest"] = "all",
        gradient: Literal["exact", "printed"] = "exact",
        projector: Literal["exact", "osqp"] = "exact",
        weight: ArrayLike | Sequence[float] | None = None,
        static_rows: bool = False,
        sliding: bool = False,
        recovery: float = 0.5,
        viability: bool = True,
        failsafe: bool | FailsafeParams | Mapping[str, Any] = True,
    ) -> None:
        if isinstance(failsafe, Mapping):
            failsafe = FailsafeParams.of(failsafe)
        gym.utils.RecordConstructorArgs.__init__(
            self,
            lambda1=lambda1,
            lambda2=lambda2,
            d_min=d_min,
            rows=rows,
            gradient=gradient,
            projector=projector,
            weight=None if weight is None else np.asarray(weight, object).tolist(),  # JSON can hold it
            static_rows=static_rows,
            sliding=sliding,
            recovery=recovery,
            viability=viability,
            failsafe=asdict(failsafe) if isinstance(failsafe, FailsafeParams) else failsafe,
        )
        if not isinstance(failsafe, bool | FailsafeParams):
            raise ParameterError(
                f"failsafe has to be True, False, FailsafeParams or a mapping of its fields, got {failsafe!r}"
            )
        assumed = failsafe if isinstance(failsafe, FailsafeParams) else FailsafeParams() if failsafe else None
        index = IndexParams(d_min=d_min, lambda1=lambda1, lambda2=lambda2, sliding=sliding)
        robot, dt = _provider(env, "robot").robot, _provider(env, "dt").dt
        if not isinstance(robot, RobotModel):
            raise InterfaceError(f"robot has to be a RobotModel, got {type(robot).__name__}")
        super().__init__(
            env,
            JSSAFilter(
                robot,
                dt,
                index,
                rows=rows,
                gradient=gradient,
                projector=projector,
                weight=weight,
                static_rows=static_rows,
                recovery=recovery,
                viability=viability,
                failsafe=assumed,
            ),
        )

    @classmethod
    def as_published(cls, env: gym.Env, *, lambda1: float = 3.0, lambda2: float = 1.0, d_min: float = 0.05) -> Self:
        """The paper to the letter: closest pair, Eq. (11)-(13) as printed, jerk bounds only.

        It is here to be compared with. Its printed row lets half of every violation pass, and it knows no joint
        limits but the jerk's.
        """
        return cls(
            env,
            lambda1=lambda1,
            lambda2=lambda2,
            d_min=d_min,
            rows="closest",
            gradient="printed",
            recovery=0.0,
            viability=False,
            failsafe=False,
        )
