"""Wrappers that put a filter between a policy and an environment."""

import copy
import inspect
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from typing import Any, Literal, Self

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import ArrayLike

from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.kernels.motion import scale_nominal, to_shares
from jssa_gym.registration import ENTRIES
from jssa_gym.safety.action import checked_action, taken_action
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import DEFAULT, PUBLISHED
from jssa_gym.safety.region import WatchedRegion
from jssa_gym.shields.environment import provider, refuse_misfit, region_of, robot_and_dt
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.offers import Offered
from jssa_gym.shields.options import JSSAOptions
from jssa_gym.shields.people import tell_of_fast_people
from jssa_gym.shields.profiles import assumptions, profiled_filter, watching
from jssa_gym.shields.reasons import reason_code
from jssa_gym.shields.registry import PUBLISHED_FORM, TASK_SHIELD, WHOLE, changed_params, make_filter, read_name
from jssa_gym.shields.wrappers import refuse_other_actions
from jssa_gym.types import Decision, Scene, Status
from jssa_gym.vectors import refuse_vector

_logger = logging.getLogger("jssa_gym")

INTERVENES = 1e-6
"""Correction, in jerk bounds, from which a step counts as an intervention."""


@cache
def _takes_path(decide: Callable[..., Decision]) -> bool:
    """Whether a filter's ``decide`` can be given a path."""
    return len(inspect.signature(decide).parameters) > 3


def _named(env: gym.Env, name: str, stop: FailsafeParams | None, changes: dict[str, Any]) -> SafetyFilter:
    """The filter that a name stands for, with some of its parameters changed."""
    if read_name(name).filter == TASK_SHIELD:
        if stop is not None or changes:
            raise ParameterError(f"{name!r} is complete, nothing can be changed: give 'jssa' and what it should have")
        task = getattr(getattr(env.unwrapped, "task", None), "name", "")
        if task not in ENTRIES:
            raise ParameterError(f"{env} is of no task with a shielded id; give another filter than {name!r}")
        return JSSAShield(env, **ENTRIES[task].shield).filter
    robot, dt = robot_and_dt(env)
    region = region_of(env, True)
    if stop is None and region is not None and (read_name(name).stop or name in WHOLE):
        stop = FailsafeParams(watched=region)
    params = changed_params(name, robot, dt, changes) if changes else None
    return make_filter(name, robot, dt, params=params, viability=stop is not None, failsafe=stop)


class Shield(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Runs every action through a safety filter.

    ``Shield(env, "ssa")`` takes a filter by name and builds it for the environment;
    ``Shield(env, "cbf", stop=True, k1=2.0)`` puts the viability box and the verified stop around it, and changes one of
    its parameters; ``Shield(env, filter)`` takes one that was built.

    The environment, ours or not, has to offer ``robot``, ``dt`` and ``scene``, anywhere in its wrapper chain, and
    take actions in [-1, 1]: fractions of the robot's jerk bounds, one a control step. Wrappers inside that change,
    repeat or drop actions are refused, see :func:`~jssa_gym.shields.wrappers.refuse_other_actions`. An action is read
    once; one that the filter leaves alone is forwarded as a copy, equal in values and type; others as float64, since
    rounding to float32 can break a row. Shares times bounds are the jerks that were decided, to the bit.

    Keys added to ``info``, after ``reset`` too: ``shield/status`` (int, see :class:`~jssa_gym.types.Status`),
    ``shield/reason`` (str), ``shield/reason_code`` (int, see :data:`~jssa_gym.shields.reasons.REASONS`),
    ``shield/intervened`` (bool), ``shield/phi`` [m²], ``shield/correction`` (largest change
    of a joint's action), ``shield/robot_pair`` and ``shield/human_pair`` (capsule numbers, -1 for none),
    ``shield/slack`` [m²], ``shield/margin`` (room that the stop behind the nominal leaves to people [m], inf where
    nothing would move), ``shield/kind`` (str, see :data:`~jssa_gym.types.Kind`), ``shield/choice`` (which of the
    alternatives of :meth:`offer` is applied, -1 for none) and ``shield/override`` (pace that the path asked for).

    Args:
        env: The environment.
        filter: A name as :func:`~jssa_gym.shields.read_name` reads it; or a filter built for the same robot and time
            step. It is copied: it has a state, which no two environments must share; the shield's own is its
            attribute ``filter``.
        stop: Whether viability box and verified stop are around the filter, as ``+stop`` behind its name says too; or
            under which assumptions, as :class:`~jssa_gym.safety.failsafe.FailsafeParams` or a mapping of its fields.
        params: Of a filter by name: fields of its ``params_type``, such as
            :class:`~jssa_gym.shields.CBFParams`, that are to differ from the defaults.

    Raises:
        InterfaceError: The environment lacks an attribute, has a wrapper that belongs outside, filter and environment
            differ, or the filter cannot be copied.
        ParameterError: The name, an assumption or a parameter is unknown or out of range, or there are some beside a
            filter that was built.
    """

    def __init__(
        self,
        env: gym.Env,
        filter: SafetyFilter | str,
        *,
        stop: bool | FailsafeParams | Mapping[str, Any] = False,
        **params: Any,
    ) -> None:
        refuse_vector(env, "VectorShield(envs, filter)")
        if not isinstance(filter, str):
            gym.utils.RecordConstructorArgs.__init__(self, filter=filter)
        gym.Wrapper.__init__(self, env)
        self._source: Any = None
        refuse_other_actions(env)
        if isinstance(filter, str):
            name, assumed = filter, assumptions("stop", watching(stop, region_of(env, stop)))
            filter = _named(env, name, assumed, params)
            checked = {given: getattr(filter.params, given) for given in params}  # JSON can hold them
            recorded = stop if assumed is None or stop is True else asdict(assumed)
            gym.utils.RecordConstructorArgs.__init__(self, filter=name, stop=recorded, **checked)
        elif stop is not False or params:
            given = ", ".join((*params, *(("stop",) if stop is not False else ())))
            raise ParameterError(f"{given}: only for a filter by name; one that was built has its own already")
        if not isinstance(filter, SafetyFilter):
            raise ParameterError(f"a filter is a name or a SafetyFilter built for the robot and dt, got {filter!r}")
        robot = refuse_misfit(env, filter)
        if filter.failsafe is not None:
            tell_of_fast_people(env, filter.failsafe)
        self.filter = copy.deepcopy(filter)
        self.filter.compile_ahead()
        self.last_decision: Decision | None = None
        self._offered: Offered | None = None
        self._jerk_bound = np.array(robot.limits.jerk)
        self._n = robot.n

    of_id: bool = False
    """Whether it comes with the environment's id, so that a spec does not name it again."""

    @property
    def spec(self) -> EnvSpec | None:
        """What makes this environment anew."""
        return self.env.spec if self.of_id else super().spec

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, then the filter with the scene that it starts in."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._source = provider(self.env, "scene")
        scene = self._source.scene
        self.filter.reset(scene)
        self.last_decision, self._offered = None, None
        self._report(info, self.filter.decide(scene, np.zeros(self._n)), 0.0)
        self.filter.reset(scene)
        return observation, info

    def offer(self, path: Offered) -> None:
        """Offer a path, or jerks in order of preference, for the next step, to be applied rather than its action.

        One is applied where it lies in the box, the filter would leave it alone and the stop behind it is verified;
        the first such. Where there is none, the action is filtered as ever.

        Args:
            path: A :class:`~jssa_gym.shields.offers.Path`, which the shield asks; or an array of shape (a, n) [rad/s³].

        Raises:
            InterfaceError: The filter has a ``decide`` of its own that knows of no path.
        """
        if not _takes_path(type(self.filter).decide):
            name = type(self.filter).__name__
            raise InterfaceError(f"{name}.decide takes no path: it has to be decide(self, scene, nominal, path=None)")
        self._offered = path

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
                self._source = provider(self.env, "scene")
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
        offer = () if self._offered is None else (self._offered,)
        self._offered = None
        scene = self._scene()
        decision = self.filter.decide(scene, nominal, *offer)
        self.last_decision = decision
        correction = 0.0
        if decision.status != Status.NOMINAL or decision.choice >= 0:
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
        info["shield/intervened"] = not correction <= INTERVENES
        info["shield/phi"] = float(decision.phi)
        info["shield/correction"] = correction
        info["shield/robot_pair"], info["shield/human_pair"] = decision.pair
        info["shield/slack"] = float(decision.slack)
        info["shield/margin"] = float(decision.margin)
        info["shield/kind"] = decision.kind
        info["shield/choice"], info["shield/override"] = decision.choice, decision.override


class JSSAShield(Shield):
    r"""The jerk-based safe set algorithm around any environment of an arm.

    Projects the policy's jerk into the safe set (exact rows of all robot-human pairs, exact projection) inside bounds
    that keep the joint limits, and applies it only if a verified stop follows it. The paper's own form is
    :meth:`as_published`.

    Args:
        env: The environment; see :class:`Shield` for what it has to offer.
        profile: ``"paper"`` for JSSA; ``"work"`` and ``"yield"`` for look-ahead filters with a short and a
            long horizon, whose stops give way gradually; see :data:`~jssa_gym.shields.registry.PROFILES`.
        horizon: How far those two look ahead [s], None for their own.
        lambda1: :math:`\lambda_1` [m·s].
        lambda2: :math:`\lambda_2` [m·s²].
        d_min: Safety margin :math:`d_{min}` [m].
        rows: ``"all"`` robot-human pairs, or the ``"closest"`` one as in the paper.
        recovery: Share of what a step can change by which an index above 0 has to fall; 0 asks for 0 at once.
        viability: Whether the jerk is kept in bounds that keep the position, velocity and acceleration limits.
        failsafe: Whether a jerk is applied only if a verified stop follows it; or under which assumptions, as
            :class:`~jssa_gym.safety.failsafe.FailsafeParams` or a mapping of its fields (which JSON can hold).
        options: What is hardly ever changed, as :class:`~jssa_gym.shields.JSSAOptions` or a mapping of its fields.
        watched: Where everybody is measured, so that people may come and go, as a
            :class:`~jssa_gym.safety.region.WatchedRegion` or a mapping of its fields; None: nobody may, unless the
            environment's people say where they do.
        gradient, projector, weight, static_rows, sliding: Options given one by one, as before there were ``options``;
            None for the default.

    Raises:
        InterfaceError: The environment lacks an attribute.
        ParameterError: A parameter is out of range or unknown, or one is given beside ``options``.
    """

    def __init__(
        self,
        env: gym.Env,
        *,
        profile: Literal["paper", "work", "yield"] = "paper",
        horizon: float | None = None,
        lambda1: float = DEFAULT.lambda1,
        lambda2: float = DEFAULT.lambda2,
        d_min: float = DEFAULT.d_min,
        rows: Literal["all", "closest"] = "all",
        recovery: float = 0.5,
        viability: bool = True,
        failsafe: bool | FailsafeParams | Mapping[str, Any] = True,
        options: JSSAOptions | Mapping[str, Any] | None = None,
        watched: WatchedRegion | Mapping[str, Any] | None = None,
        gradient: Literal["exact", "printed"] | None = None,
        projector: Literal["exact", "osqp"] | None = None,
        weight: ArrayLike | Sequence[float] | None = None,
        static_rows: bool | None = None,
        sliding: bool | None = None,
    ) -> None:
        options = JSSAOptions.of(
            options, gradient=gradient, projector=projector, weight=weight, static_rows=static_rows, sliding=sliding
        )
        region = None if watched is None else WatchedRegion.of(watched)
        given = watching(failsafe, region_of(env, failsafe) if region is None else region)
        if isinstance(failsafe, Mapping):
            failsafe = FailsafeParams.of(failsafe)
        form: dict[str, Any] = {
            "profile": profile,
            "horizon": horizon,
            "lambda1": lambda1,
            "lambda2": lambda2,
            "d_min": d_min,
            "rows": rows,
            "recovery": recovery,
            "viability": viability,
        }
        gym.utils.RecordConstructorArgs.__init__(
            self,
            **form,
            failsafe=asdict(failsafe) if isinstance(failsafe, FailsafeParams) else failsafe,
            options=asdict(options),
            **({} if region is None else {"watched": asdict(region)}),
        )
        filter = profiled_filter(*robot_and_dt(env), **form, failsafe=given, options=options)
        super().__init__(env, filter)

    @classmethod
    def as_published(
        cls,
        env: gym.Env,
        *,
        lambda1: float = PUBLISHED.lambda1,
        lambda2: float = PUBLISHED.lambda2,
        d_min: float = PUBLISHED.d_min,
    ) -> Self:
        """The paper to the letter: closest pair, Eq. (11)-(13) as printed, jerk bounds only.

        It is here to be compared with. Its printed row lets half of every violation pass, and it knows no joint
        limits but the jerk's.
        """
        return cls(
            env, lambda1=lambda1, lambda2=lambda2, d_min=d_min, viability=False, failsafe=False, **PUBLISHED_FORM
        )
