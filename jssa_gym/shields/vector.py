"""A filter between a policy and many environments at once: each is shielded as it would be alone, bit for bit."""

import inspect
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.shields.alarm import Alarm
from jssa_gym.shields.batch import Batch
from jssa_gym.shields.environment import refuse_misfit
from jssa_gym.shields.filter import SafetyFilter, alike
from jssa_gym.shields.offers import VectorOffered, alternatives_of_all, tell_all
from jssa_gym.shields.people import tell_of_fast_people
from jssa_gym.shields.shield import INTERVENES, JSSAShield, Shield
from jssa_gym.shields.words import KINDS, Told, in_words, kind_codes, reason_codes
from jssa_gym.tick import codes, layout
from jssa_gym.tick.moves import replace_actions, take_nominals
from jssa_gym.types import Array, Kind
from jssa_gym.validation import known_name
from jssa_gym.vectors import Infos, Mask, as_infos

_NEEDED = (
    *("prototype", "robot", "dt", "planes", "part_names", "person", "state", "time", "people", "began"),
    *("ready", "checked"),
)
"""What is read of a vector environment."""

_OPTIONS = tuple(inspect.signature(JSSAShield).parameters)[1:]
"""Options of the shield around a single environment, which comes before them."""


class VectorShield(VectorWrapper):
    """Runs the actions of many environments through safety filters, one for each, in one compiled call.

    What environment ``e`` gives is what ``Shield(env, filter)`` around a single one gives, bit for bit. ``infos`` has
    the same keys but for the words, ``shield/reason`` and ``shield/kind``: :meth:`reasons` and :meth:`kinds` say them
    of the last step; ``shield/reason_code`` is there. Where an episode begins anew in the very step that ends another,
    ``infos["final_info"]`` has the words of the end.

    Args:
        env: A :class:`~jssa_gym.envs.vector.VectorArmEnv`.
        filter: A name as :func:`~jssa_gym.shields.read_name` reads it; options of
            :class:`~jssa_gym.shields.JSSAShield`; or a filter built for the same robot and time step.

    Raises:
        ParameterError: A name or an option is unknown, or the filter proposes in Python, one arm at a time.
        InterfaceError: The environment is no such vector, or filter and environment differ.
    """

    def __init__(self, env: VectorEnv, filter: SafetyFilter | str | Mapping[str, Any]) -> None:
        super().__init__(env)
        if missing := [name for name in _NEEDED if not hasattr(env, name)]:
            raise InterfaceError(
                f"{env} has no {', '.join(missing)}: a vector shield goes around a VectorArmEnv itself, and wrappers "
                "around the shield"
            )
        self._arms: Any = env
        one = self._arms.prototype
        if isinstance(filter, str):
            filter = Shield(one, filter).filter
        elif isinstance(filter, Mapping):
            for name in filter:
                known_name("option of the shield", name, _OPTIONS)
            filter = JSSAShield(one, **filter).filter
        if not isinstance(filter, SafetyFilter):
            raise ParameterError(f"a filter is a name, options of JSSAShield or a SafetyFilter, got {filter!r}")
        robot = refuse_misfit(one, filter)
        if not filter.compiled:
            raise ParameterError(
                f"{type(filter).__name__} proposes in Python, one arm at a time: take a filter by its name, with the "
                "exact projector, or vectorization_mode='sync' and a Shield around each environment"
            )
        if filter.failsafe is not None:
            tell_of_fast_people(one, filter.failsafe)
        self.filter = filter
        """How every arm is looked after; it decides nothing itself."""
        settings, planes = filter.settings(), self._arms.planes
        fixed = settings.guarded or settings.static_rows
        self._settings, self._guarded = settings, settings.guarded
        count, names = env.num_envs, self._arms.part_names
        self._batch = Batch(filter, count, names, planes=len(planes.offset) if fixed else 0)
        scene = self._batch.scene
        scene.valid[:], scene.person[:] = True, self._arms.person
        if fixed:
            scene.normal[:], scene.offset[:] = planes.normal, planes.offset
        self._jerk_bound = np.array(robot.limits.jerk)
        self._nominal = np.zeros((count, robot.n))
        self._words = Names(names, planes.names if fixed else ())
        self._offered: VectorOffered | None = None
        self._alarm = Alarm(filter.dt)
        self._override = np.ones(count)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, Infos]:
        """Reset environments, then the filters of those with the scene that they start in."""
        observations, infos = self.env.reset(seed=seed, options=options)  # ty: ignore[invalid-argument-type]  # or a list
        began, self._offered = self._arms.began, None
        return observations, infos | as_infos(self._begin(began), began)

    def offer(self, paths: VectorOffered) -> None:
        """Offer paths, or jerks in order of preference, for the next step, to be applied rather than its actions.

        For each arm what :meth:`~jssa_gym.shields.Shield.offer` does for one; an arm without any is filtered as ever.

        Args:
            paths: A :class:`~jssa_gym.shields.offers.VectorPath`, which the shield asks; or an array of shape
                (E, a, n) [rad/s³]. Who has fewer alternatives has NaN in the place of others.
        """
        self._offered = paths

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Infos]:
        """Filter actions, shape (E, n), and step the environments.

        Raises:
            InvalidActionError: Wrong shape or type, before anything moved.
            gymnasium.error.ResetNeeded: There was no ``reset`` yet, or of one that is over.
        """
        live, fraction = self._arms.ready(), self._arms.checked(actions)
        take_nominals(fraction, self._jerk_bound, self._nominal)
        answer = self._decide(live)
        correction = np.zeros(self.num_envs)
        replaced = live & ((answer.told["status"] != codes.NOMINAL) | (answer.told["choice"] >= 0))
        replace_actions(answer.jerk, self._jerk_bound, replaced, fraction, correction)
        values = self._told(correction)
        observations, rewards, terminated, truncated, infos = self.env.step(fraction)
        began = self._arms.began
        if began.any():
            if "final_info" in infos:
                last = {key: value.copy() for key, value in values.items()} | self._said(began)
                infos["final_info"] |= as_infos(last, began)
            for key, value in self._begin(began).items():
                values[key][began] = value[began]
        return observations, rewards, terminated, truncated, infos | as_infos(values, np.ones_like(began))

    def _said(self, which: Mask) -> dict[str, NDArray[Any]]:
        """What is said in words of the last step to some arms; nobody can ask once they have begun anew."""
        reasons, kinds = np.full((2, self.num_envs), "", object)
        for e in np.flatnonzero(which).tolist():
            reasons[e] = self.reason(e)
        kinds[which] = np.array(KINDS, object)[self.kind_codes()[which]]
        return {"shield/reason": reasons, "shield/kind": kinds}

    @property
    def nominal(self) -> Array:
        """What was asked for in the last step, shape (E, n) [rad/s³]; 0 at the beginning of an episode. A view."""
        return self._nominal

    def reasons(self, which: NDArray[np.intp] | None = None) -> list[str]:
        """Why each jerk of the last step, or at the beginning of an episode, is not the nominal: ``shield/reason``.

        Args:
            which: Numbers of the arms that are asked about, shape (k,); None: all.
        """
        which = np.arange(self.num_envs) if which is None else which
        batch, robot = self._batch, self.filter.robot
        return [
            in_words(Told(*told), self._nominal[e], robot, _Records(batch, self._settings, e), self._named(e))  # ty: ignore[invalid-argument-type]
            for e, told in zip(which.tolist(), batch.answer.told[which].tolist(), strict=True)
        ]

    def reason(self, e: int) -> str:
        """The reason of arm ``e`` alone."""
        return self.reasons(np.array([e]))[0]

    def kinds(self) -> list[Kind]:
        """What kind of jerk is applied to each: ``shield/kind``."""
        return [KINDS[code] for code in self.kind_codes().tolist()]

    def kind_codes(self) -> NDArray[np.int64]:
        """Each arm's kind by its place in :data:`~jssa_gym.shields.words.KINDS`, shape (E,)."""
        return kind_codes(self._batch.answer.told)

    def _named(self, e: int) -> "Names":
        """What is known by name where arm ``e`` is, and what of its last scene could not be read."""
        return self._words

    def _show(self, which: Mask) -> None:
        """Let filters of those arms see the present."""
        arms, scene = self._arms, self._batch.scene
        scene.now["time"], scene.joints[:] = arms.time, arms.state
        scene.ends[:], scene.radius[:] = arms.people

    def _decide(self, live: Mask) -> layout.Answer:
        """Let filters see the present and what paths offer, decide, and tell paths what was chosen."""
        self._show(live)
        batch, scene = self._batch, self._batch.scene
        offered, self._offered = self._offered, None
        self._override[live], scene.now["alternatives"] = 1.0, 0
        if offered is not None:
            scene.now["alternatives"] = alternatives_of_all(
                offered, batch.present.copy(), batch.margin, live, scene.alternatives, self._alarm
            )
        answer = batch.decide(self._nominal, live)
        if offered is not None:
            self._choose(offered, live)
        return answer

    def _choose(self, offered: VectorOffered, live: Mask) -> None:
        """Tell paths what became of what they offered."""
        scene, answer = self._batch.scene, self._batch.answer
        told, counts = answer.told, scene.now["alternatives"]
        forwarded = live & (told["status"] == codes.NOMINAL)
        # what is applied may be an alternative though none was chosen
        for e in np.flatnonzero(forwarded & (told["choice"] < 0) & (counts > 0)):
            told["choice"][e] = alike(scene.alternatives[e, : counts[e]], answer.jerk[e], self._jerk_bound)
        chosen = forwarded & (told["choice"] >= 0)
        self._nominal[chosen] = answer.jerk[chosen]
        self._override[live] = tell_all(offered, np.where(chosen, told["choice"], -1), live, self._alarm)[live]

    def _begin(self, which: Mask) -> dict[str, NDArray[Any]]:
        """Begin episodes of those arms; what is said of them."""
        self._show(which)
        self._override[which], self._batch.scene.now["alternatives"] = 1.0, 0
        self._batch.start(which)
        self._nominal[which] = 0.0
        self._batch.decide(self._nominal, which)
        values = self._told(np.zeros(self.num_envs))
        self._batch.start(which)
        return values

    def _told(self, correction: Array) -> dict[str, NDArray[Any]]:
        """What ``info`` says of decisions; ``correction``, shape (E,), is what they changed of actions."""
        told = self._batch.answer.told
        finite: Mask = np.all(np.isfinite(self._nominal), axis=1)
        return {
            "shield/status": told["status"].copy(),
            "shield/reason_code": reason_codes(told, finite, self._guarded),
            "shield/intervened": ~(correction <= INTERVENES),
            "shield/phi": told["phi"].copy(),
            "shield/correction": correction,
            "shield/robot_pair": told["row"].copy(),
            "shield/human_pair": told["column"].copy(),
            "shield/slack": told["slack"].copy(),
            "shield/margin": told["margin"].copy(),
            "shield/choice": told["choice"].copy(),
            "shield/override": self._override.copy(),
        }


class Names(NamedTuple):
    """What a :class:`~jssa_gym.shields.reading.Reading` knows by name."""

    names: tuple[str, ...]
    planes: tuple[str, ...]
    statics: tuple[str, ...] = ()
    wrong: Mapping[str, str] = {"joints": "", "clock": "", "people": "", "fixtures": ""}  # never changed


class _Records:
    """One arm's part of a batch, as :class:`~jssa_gym.shields.records.Records` has it."""

    def __init__(self, batch: Batch, settings: layout.StepSettings, e: int) -> None:
        self._batch, self.settings, self._e = batch, settings, e

    # most words need neither
    @property
    def memory(self) -> layout.Memory:
        return layout.Memory(*self._own(self._batch.memory))

    @property
    def scene(self) -> layout.SceneRecord:
        return layout.SceneRecord(*self._own(self._batch.scene))

    def _own(self, parts: Any) -> Any:
        return [part[self._e : self._e + 1] for part in parts]
