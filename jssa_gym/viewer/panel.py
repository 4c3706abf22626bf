"""The page's switches: each is entered in the gate with the values that it can have, and asks for one thing."""

from collections.abc import Callable, Sequence
from typing import Any

import viser
from viser._messages import GuiUpdateMessage

from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.people import PEOPLE
from jssa_gym.policies import shipped_policies
from jssa_gym.robots import ROBOTS
from jssa_gym.shields import FILTERS, PROFILES, STOP, TASK_SHIELD
from jssa_gym.shields.registry import UNSHIELDED
from jssa_gym.viewer.choices import DRAGGED, Choices, ShieldChoice
from jssa_gym.viewer.gate import Check, Speech, number, one_of, switch
from jssa_gym.viewer.scene import LAYERS, SHOWN
from jssa_gym.viewer.session import FACTORS, Command
from jssa_gym.viewer.snapshot import Snapshot

SHIELDS = (
    *(TASK_SHIELD, *PROFILES),
    *(f"{name}{STOP}" for name in FILTERS if name != "stop"),
    "stop",
    *(name for name in FILTERS if name != "stop"),
    UNSHIELDED,
)
"""Shields of the page: whole ones first."""

_POLICIES = ("jpc", "jpc_paper", "straight", "hold", "random", "wander")
"""Policies of the page by name, besides the trained ones."""

_PEOPLE = (DRAGGED, *(name for name in PEOPLE if not name.endswith("abrupt")))

_RANGES: dict[str, tuple[str, float, float, float]] = {
    "lambda1": ("λ₁ [m·s]", 0.1, 6.0, 0.05),
    "lambda2": ("λ₂ [m·s²]", 0.01, 2.0, 0.01),
    "d_min": ("d_min [m]", 0.01, 0.3, 0.01),
    "horizon": ("horizon [s]", 0.1, 2.0, 0.05),
    "human_speed": ("assumed speed of a body [m/s]", 0.2, 4.0, 0.1),
    "limb_speed": ("assumed speed of hands [m/s]", 0.2, 6.0, 0.1),
}
"""Words, least, most and step of what can be changed."""


class ControlPanel:
    """The switches.

    Args:
        gui: viser's.
        speech: Where they are entered.
        submit: Hands a command to the session; how many there were until then.
        choices: What is played at first; names of it that the page does not offer are added to what it offers.
    """

    def __init__(self, gui: viser.GuiApi, speech: Speech, submit: Callable[[Command], int], choices: Choices) -> None:
        self._gui, self._speech, self._submit = gui, speech, submit
        self._choices, self._asked = choices, 0
        self.layers = set(SHOWN)
        self.curves = True
        self.handles: dict[str, Any] = {}
        """Those of what is played and of numbers, by name."""
        self.entered: dict[str, Any] = {}
        """All of them, by viser's identifier."""
        self._what(choices)
        self._shields(choices)
        self._time()
        self._person()
        self._shown()

    # ---- making ----------------------------------------------------------------------------------------

    def enter(self, handle: Any, check: Check, act: Callable[[Any], None]) -> Any:
        """Let a widget count: with values that pass the check, its value goes to ``act``."""
        self._speech.widgets[handle._impl.uuid] = check
        self.entered[handle._impl.uuid] = handle

        # as a coroutine, so that one comes after the other; none of them takes long
        async def changed(event: Any) -> None:
            if event.client_id is not None:  # it was not we who moved it
                act(event.target.value)

        (handle.on_click if hasattr(handle, "on_click") else handle.on_update)(changed)
        return handle

    def _dropdown(self, name: str, label: str, options: Sequence[str], value: str, hint: str) -> None:
        options = tuple(dict.fromkeys((*options, value)))
        handle = self._gui.add_dropdown(label, options, initial_value=value, hint=hint)
        self.handles[name] = self.enter(handle, one_of(lambda: handle.options), lambda value: self._choose())

    def _button(self, label: str, act: Callable[[], None], hint: str) -> Any:
        return self.enter(self._gui.add_button(label, hint=hint), switch, lambda value: act())

    def _checkbox(self, label: str, value: bool, act: Callable[[bool], None], hint: str) -> Any:
        return self.enter(self._gui.add_checkbox(label, value, hint=hint), switch, act)

    def _what(self, choices: Choices) -> None:
        with self._gui.add_folder("What is played"):
            self._dropdown("task", "task", tuple(TASKS), choices.task, "what the arm is to do")
            self._dropdown("robot", "robot", tuple(ROBOTS), choices.robot, "others by the command's --robot")
            self._dropdown("human", "person", _PEOPLE, choices.human, "dragged by the mouse, or walking by itself")
            policies = (*_POLICIES, *shipped_policies())
            self._dropdown("policy", "policy", policies, choices.policy, "trained ones are always shielded")

    def _shields(self, choices: Choices) -> None:
        one, *others = choices.shields
        other = others[0] if others else ShieldChoice("jssa_published")
        with self._gui.add_folder("Shields"):
            self._dropdown("shield", "shield", SHIELDS, one.name, f"'{STOP}': with viability box and verified stop")
            self._both = self._checkbox(
                "two side by side", bool(others), lambda value: self._choose(both=value), "the same person beside each"
            )
            self._dropdown("second", "second shield", SHIELDS, other.name, "of the second arm")
            for name, (label, low, high, step) in _RANGES.items():
                handle = self._gui.add_slider(label, low, high, step, low, disabled=True)
                self.handles[name] = self.enter(
                    handle, number(low, high), lambda value, name=name: self._changed(name, value)
                )
            self._button("their own numbers", self._unchanged, "as the shields have them by themselves")
            self._changes = dict(one.changes)

    def _time(self) -> None:
        with self._gui.add_folder("Time"):
            self.pause = self._checkbox("pause", False, lambda value: self._do(_set("paused", value)), "")
            self._button("one step", lambda: self._do(_step), "of 8 ms, while paused")
            self._button("new episode", lambda: self._do(lambda session: session.reset(session.seed + 1)), "")
            self._button("the same again", lambda: self._do(lambda session: session.reset()), "")
            paces = {f"{factor:g} x": factor for factor in FACTORS}
            handle = self._gui.add_dropdown("speed of time", tuple(paces), initial_value="1 x")
            self.enter(handle, one_of(lambda: tuple(paces)), lambda value: self._do(_set("factor", paces[value])))
            again = "begin the next one a second after all arms are at their goals"
            self._checkbox("go on after success", True, lambda value: self._do(_set("again", value)), again)

    def _person(self) -> None:
        with self._gui.add_folder("Dragged person"):
            hint = "no faster than the shields assume; without it the promise is off"
            self._clamp = self._checkbox("speed clamped", True, lambda value: self._do(lambda s: s.clamp(value)), hint)
            self._button("hands down", lambda: self._do(lambda session: session.dragged.lower()), "")
            self._button("stand still", lambda: self._do(lambda session: session.dragged.stay()), "")

    def _shown(self) -> None:
        with self._gui.add_folder("Layers", expand_by_default=False):
            for name, words in LAYERS.items():
                self._checkbox(words, name in SHOWN, lambda value, name=name: self.set_layer(name, value), "")

    # ---- doing -----------------------------------------------------------------------------------------

    def _do(self, command: Command) -> None:
        self._asked = self._submit(command)

    def _choose(self, both: bool | None = None) -> None:
        names = [self.handles["shield"].value]
        if self._both.value if both is None else both:
            names.append(self.handles["second"].value)
        picked = {name: self.handles[name].value for name in ("task", "robot", "human", "policy")}
        changes, seed = dict(self._changes), self._choices.seed

        def choose(session: Any) -> None:
            # whether that can be is known only here, and said on the page
            shields = tuple(ShieldChoice(name, changes) for name in names)
            session.choose(Choices(**picked, shields=shields, seed=seed))

        self._do(choose)

    def _changed(self, name: str, value: float) -> None:
        self._changes[name] = float(value)
        self._choose()

    def _unchanged(self) -> None:
        self._changes.clear()
        self._choose()

    def set_layer(self, name: str, value: bool) -> None:
        """Show a layer of the scene, or not."""
        (self.layers.add if value else self.layers.discard)(name)
        overlays = ("stop" in self.layers, "reach" in self.layers)
        self._do(_set("overlays", overlays))

    # ---- showing ---------------------------------------------------------------------------------------

    def show(self, snapshot: Snapshot) -> None:
        """Bring the switches to what is, where a command was refused or something else changed it."""
        if snapshot.answered < self._asked:
            return
        choices = self._choices = snapshot.choices
        shields = [one.name for one in choices.shields]
        wanted = {name: getattr(choices, name) for name in ("task", "robot", "human", "policy")}
        wanted |= dict(zip(("shield", "second"), shields, strict=False))
        self._changes = dict(choices.shields[0].changes)
        numbers = {**snapshot.arms[-1].numbers, **snapshot.arms[0].numbers}
        for name in _RANGES:
            if self.handles[name].disabled != (name not in numbers):
                self.handles[name].disabled = name not in numbers
        for name, value in (wanted | numbers).items():
            _bring(self.handles[name], value)
        _bring(self._both, len(shields) > 1)
        _bring(self.pause, snapshot.paused)
        _bring(self._clamp, snapshot.clamped)

    def say_again(self, uuid: str) -> None:
        """Send a switch's value once more: somebody moved it whose moves do not count."""
        handle = self.entered[uuid]
        if isinstance(handle, viser.GuiInputHandle):
            update = GuiUpdateMessage(uuid, {"value": handle.value})
            handle._impl.gui_api._websock_interface.queue_message(update)


def _bring(handle: Any, value: Any) -> None:
    if handle.value != value:
        handle.value = value


def _set(name: str, value: Any) -> Command:
    def act(session: Any) -> None:
        setattr(session, name, value)

    return act


def _step(session: Any) -> None:
    if session.paused:
        session.step()
