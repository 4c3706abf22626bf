"""What is played behind the page: one or two shielded arms beside the same person, one control step after the other.

A session knows of no page and no clock. It is stepped by one thread, which also hands it commands.
"""

from collections.abc import Callable
from typing import Any

from jssa_gym.envs.arm import DT
from jssa_gym.evaluation.people import make_person
from jssa_gym.exceptions import JSSAGymError
from jssa_gym.humans import HumanMotion
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.types import Trace
from jssa_gym.viewer.choices import DRAGGED, Choices
from jssa_gym.viewer.person import Dragged, SameAs
from jssa_gym.viewer.side import Side
from jssa_gym.viewer.snapshot import Snapshot

PAUSE = 1.0
"""For so long the arm is shown at its goal before the next episode begins [s]."""

FACTORS = (0.1, 0.25, 0.5, 1.0, 2.0)
"""Simulated time over the clock's."""


class Session:
    """Shielded arms beside a person.

    Args:
        choices: What is played at first.

    Raises:
        JSSAGymError: Something that was chosen does not exist, or does not fit.
    """

    def __init__(self, choices: Choices) -> None:
        self.paused, self.factor, self.again = False, 1.0, True
        self.overlays = (False, False)
        self.number, self.epoch = 0, 0
        self.dragged = Dragged()
        self.sides: tuple[Side, ...] = ()
        """The arms, each beside the same person; replaced as a whole."""
        self.choose(choices)

    # ---- commands --------------------------------------------------------------------------------------

    def choose(self, choices: Choices) -> None:
        """Play something else; if that cannot be, what was played goes on.

        Raises:
            JSSAGymError: See :class:`Session`.
        """
        human: HumanMotion = self.dragged if choices.human == DRAGGED else make_person(choices.human)
        first = Side(choices, choices.shields[0], human)
        # people look at the first arm only, and the second one's are the same
        beside = SameAs(human, lambda: first.base.scene.human)
        sides = (first, *(Side(choices, shield, beside) for shield in choices.shields[1:]))
        try:
            self._begin(sides, choices.seed)
        except JSSAGymError:  # a task may find no goal
            for side in sides:
                side.close()
            self._keep_to_what_is_assumed(self.sides)
            raise
        for side in self.sides:
            side.close()
        self.choices, self.sides, self.human = choices, sides, human
        self.seed = choices.seed
        self.epoch += 1

    def reset(self, seed: int | None = None) -> None:
        """Begin an episode; by default the same again."""
        self.seed = self.choices.seed if seed is None else seed
        self._begin(self.sides, self.seed)

    def _begin(self, sides: tuple[Side, ...], seed: int) -> None:
        self._keep_to_what_is_assumed(sides)
        for side in sides:
            side.reset(seed)

    def _keep_to_what_is_assumed(self, sides: tuple[Side, ...]) -> None:
        """Bound the dragged person's speeds by the smallest that a shield assumes."""
        assumed = [side.assumed for side in sides if side.assumed is not None]
        if assumed:
            self.dragged.keep_to(
                *(min(getattr(one, name) for one in assumed) for name in ("human_speed", "limb_speed"))
            )

    def clamp(self, clamped: bool) -> None:
        """Whether the dragged person keeps to the speeds that the shields assume."""
        self.dragged.clamped = clamped

    def drag(self, part: str, place: tuple[float, ...]) -> None:
        """Move the dragged person: a hand to a place (3,), or the body to one on the floor (2,) [m].

        Args:
            part: Of :data:`~jssa_gym.viewer.person.HANDS`; anything else is the body.
            place: Where the mouse is.
        """
        if len(place) == 3:
            self.dragged.reach(part, place)
        else:
            self.dragged.go(place)

    def roll(self) -> None:
        """Begin to record for a film."""
        for side in self.sides:
            side.roll()

    def cut(self) -> list[Trace]:
        """End the recording: an episode of every arm, all of the same length; none if nothing was recorded."""
        return [trace for side in self.sides if (trace := side.cut()) is not None]

    def traces(self) -> list[Trace]:
        """The episode until now, or its last minute, of every arm."""
        return [side.recorder.trace() for side in self.sides if len(side.recorder)]

    @property
    def robot(self) -> Any:
        """The arm, where it stands."""
        return self.sides[0].robot

    @property
    def world(self) -> Any:
        """MuJoCo's model of arm and table, for what they look like."""
        return self.sides[0].base.world

    # ---- time ------------------------------------------------------------------------------------------

    def step(self) -> None:
        """One control step of every arm; some time after success, the next episode begins."""
        for side in self.sides:
            side.step()
        self.number += 1
        if self.again and all(side.succeeded * DT >= PAUSE for side in self.sides) and self.choices.task != "home":
            self.reset(self.seed + 1)

    def snapshot(self, answered: int = 0, message: str = "") -> Snapshot:
        """The present, for whoever shows it.

        Args:
            answered: How many commands were done until now.
            message: What went wrong with the last one.
        """
        first = self.sides[0]
        take = first.take
        return Snapshot(
            answered=answered,
            number=self.number,
            epoch=self.epoch,
            time=first.base.scene.time,
            choices=self.choices,
            robot=self.robot,
            people=first.base.scene.human,
            arms=tuple(side.view(self._doubt(side), self.overlays) for side in self.sides),
            paused=self.paused,
            factor=self.factor,
            clamped=self.dragged.clamped,
            recording=None if take is None else len(take) * DT,
            message=message,
        )

    def _doubt(self, side: Side) -> str:
        """Why a side promises nothing; empty if it does."""
        assumed = side.assumed
        if assumed is None:
            return "no verified stop"
        if side.too_fast:
            return side.too_fast
        return self._doubt_of_people(assumed) or side.robot.unpromised

    def _doubt_of_people(self, assumed: FailsafeParams) -> str:
        if self.choices.human == DRAGGED:
            return "" if self.dragged.clamped else "the person may be faster than assumed"
        names = self.sides[0].base.scene.human.names  # every side has the same people
        for name in dict.fromkeys(names):
            for speed, bound in zip(self.human.end_speeds_of(name), assumed.end_speeds_of(name), strict=True):
                if speed > bound * (1.0 + 1e-6):
                    return f"people may be {speed:.2g} m/s fast, {bound:g} is assumed"
        return ""

    def close(self) -> None:
        """Free what the environments hold."""
        for side in self.sides:
            side.close()


Command = Callable[[Session], None]
"""What a page asks of a session."""
