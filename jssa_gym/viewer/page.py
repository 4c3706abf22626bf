"""The page: a session, shown to whoever comes in."""

import logging
import math
import socket
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.envs.arm import DT, MOVING
from jssa_gym.exceptions import JSSAGymError
from jssa_gym.robots import RobotModel
from jssa_gym.types import Trace
from jssa_gym.viewer.charts import Charts, ribbon
from jssa_gym.viewer.gate import Door, Speech, number, one_of, switch
from jssa_gym.viewer.panel import ControlPanel
from jssa_gym.viewer.playback import Playback
from jssa_gym.viewer.runner import Runner
from jssa_gym.viewer.scene import Picture
from jssa_gym.viewer.server import Server
from jssa_gym.viewer.session import Session
from jssa_gym.viewer.shelf import Shelf
from jssa_gym.viewer.side import LONGEST
from jssa_gym.viewer.snapshot import ArmView, Snapshot
from jssa_gym.viewer.words import COLOURS, WORDS

_logger = logging.getLogger("jssa_gym")

SENT = 1.0 / 31.0
"""The scene is sent this often [s]."""

_TOLD = 0.2
"""Numbers are [s]."""

_DRAWN = 0.25
"""Curves are [s]."""

_CAMERAS = {
    1: ((-2.5, -2.9, 2.8), (0.65, 0.0, 0.95)),
    2: ((-4.6, 0.0, 3.2), (0.6, 0.0, 0.95)),
}
"""Place and what is looked at [m], by the number of arms: of two from behind, so that both are as large."""

_LIVE = "live"
"""What is shown unless a saved episode is opened."""


class Page:
    """A session on a page.

    Args:
        session: What is played.
        door: Who may come in.
        listening: Its socket, of :func:`~jssa_gym.viewer.server.listen`.
        shelf: Where films and episodes are kept.

    Raises:
        InterfaceError: This version of viser cannot be guarded.
    """

    def __init__(self, session: Session, door: Door, listening: socket.socket, shelf: Shelf) -> None:
        self.shelf = shelf
        self.runner = Runner(session)
        self.speech = Speech()
        """What visitors may say."""
        self.server = Server(door, self.speech, listening)
        self._viser = self.server.viser
        self.sent = 0
        """Times that the scene was sent."""
        self.playback: Playback | None = None
        """The saved episode that is shown; None for what is played."""
        self._scrub, self._rolled = 0.0, 0
        self._over = threading.Event()
        self._keeping = threading.Lock()  # held while something is written
        self.news = ""
        """What became of what was to be kept."""
        self._set_up()
        self.server.on_refusal = self._remind
        self.server.on_change = self._greet
        self._thread = threading.Thread(target=self._run, name="jssa-gym page", daemon=True)

    def start(self) -> None:
        """Play and show."""
        self.runner.start()
        self._thread.start()

    def close(self) -> None:
        """Close all pages and stop."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join(timeout=10.0)
        self.runner.close()
        self.server.close()

    # ---- making ----------------------------------------------------------------------------------------

    def _set_up(self) -> None:
        server, gui = self._viser, self._viser.gui
        self._framed = 0
        server.initial_camera.fov = math.radians(40.0)
        self._look_at(len(self.runner.snapshot.arms))
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.set_panel_label("jssa-gym view")
        self._status = gui.add_markdown("")
        self.told = gui.add_markdown("")
        self._ribbon = gui.add_image(np.full((24, 256, 3), 235, np.uint8), format="png")
        self.panel = ControlPanel(gui, self.speech, self.runner.submit, self.runner.snapshot.choices)
        with gui.add_folder("Keep"):
            enter = self.panel.enter
            self._record = enter(gui.add_button("record a film"), switch, lambda value: self.toggle_film())
            enter(gui.add_button("save the episode", hint="the last minute"), switch, lambda value: self.save())
            names = (_LIVE, *self.shelf.episodes())
            self.episode = gui.add_dropdown("episode", names, initial_value=_LIVE, hint="a saved one can be scrubbed")
            enter(self.episode, one_of(lambda: self.episode.options), self._open)
            self._line = gui.add_slider("time [s]", 0.0, 1.0, DT, 0.0, disabled=True)
            enter(self._line, lambda value: number(0.0, self._line.max)(value), self._set_scrub)
        with gui.add_folder("Curves"):
            enter(gui.add_checkbox("draw them", True), switch, self._set_curves)
            self._charts = Charts(gui)
        self._visitors = gui.add_markdown("")
        self.picture = Picture(server, self.speech, self._drag)

    def _look_at(self, arms: int) -> None:
        """Put everybody's camera where all arms are in sight, when there are more or fewer of them."""
        if arms != self._framed:
            self._framed = arms
            place, towards = _CAMERAS[arms]
            for camera in (self._viser.initial_camera, *(one.camera for one in self._viser.get_clients().values())):
                camera.position, camera.look_at = place, towards

    def _drag(self, part: str, place: tuple[float, ...]) -> None:
        self.runner.submit(lambda session: session.drag(part, place))

    def _set_curves(self, wanted: bool) -> None:
        self.panel.curves = wanted
        self._charts.set_visible(wanted)

    # ---- visitors --------------------------------------------------------------------------------------

    def _greet(self) -> None:
        wheel = self.server.wheel
        count = len(wheel.visitors)
        others = "" if count < 2 else f" {count} pages are open; the one that came first drives, the others watch."
        self._visitors.content = f"*{others.strip()}*" if others else ""

    def _remind(self, visitor: int, message: dict[str, Any]) -> None:
        """Somebody who does not drive has moved a switch: it goes back."""
        if (uuid := message.get("uuid")) is not None:
            self.panel.say_again(uuid)
        client = self._viser.get_clients().get(visitor)
        if client is not None:
            client.add_notification("You are watching", "Somebody else drives; when their page is closed, or nothing "
                                    "was done there for 30 s, you can.", auto_close_seconds=5.0)  # fmt: skip

    # ---- showing ---------------------------------------------------------------------------------------

    def _run(self) -> None:
        due = told = drawn = 0.0
        failed = ""
        while not self._over.is_set():
            now = time.perf_counter()
            try:
                live = self.runner.snapshot
                playback = self.playback
                snapshot = live if playback is None else playback.at(self._scrub)
                self._look_at(len(snapshot.arms))
                self.sent += self.picture.show(snapshot, self.panel.layers)
                if now - told >= _TOLD:
                    told = now
                    self._tell(snapshot)
                    self.panel.show(live)
                if now - drawn >= _DRAWN and self.panel.curves:
                    drawn = now
                    self._charts.show(snapshot)
                    self._ribbon.image = ribbon(snapshot, COLOURS)
                if live.recording is not None and live.recording >= LONGEST - DT:
                    self._end_film()
            except Exception as error:  # whatever goes wrong with showing, the page goes on
                if (said := f"{type(error).__name__}: {error}") != failed:
                    failed = said  # once: it may go wrong thirty times a second
                    _logger.exception("a moment was not shown")
            due = max(due + SENT, now)
            self._over.wait(max(due - time.perf_counter(), 0.001))

    def _tell(self, snapshot: Snapshot) -> None:
        lines = [_says(view) for view in snapshot.arms]
        state = "saved episode" if snapshot.scrubbed else "paused" if snapshot.paused else f"{snapshot.factor:g} x"
        late = self.runner.punctuality()
        slow = f", slower than asked: {late.rate:.0%}" if late.rate < 0.97 and not snapshot.paused else ""
        clock = f"**{snapshot.time:.1f} s** ({state}{slow})"
        label = "record a film" if snapshot.recording is None else "end the film"
        if self._record.label != label:
            self._record.label = label
        if snapshot.recording is not None:
            clock += f" **recording {snapshot.recording:.1f} s**"
        self._status.content = "\n\n".join([clock, *lines])
        news = snapshot.message or self.news
        self.told.content = f"⚠ {_plain(news)}" if snapshot.message else f"*{_plain(news)}*" if news else ""

    # ---- films and episodes ----------------------------------------------------------------------------

    def toggle_film(self) -> None:
        """Begin a film, or end it."""
        if self.runner.snapshot.recording is not None:
            self._end_film()
        elif self.runner.snapshot.answered >= self._rolled:  # else what was asked for last is still to be done
            self._rolled = self.runner.submit(lambda session: session.roll())

    def _end_film(self) -> None:
        def end(session: Session) -> None:
            # what is recorded stays so while something else is written
            if not self._busy() and (traces := session.cut()):
                self._keep(self.shelf.keep_film, traces, session.robot)

        if self.runner.snapshot.answered >= self._rolled:
            self._rolled = self.runner.submit(end)

    def save(self) -> None:
        """Keep the episode until now."""
        self.runner.submit(lambda session: self._keep(self.shelf.keep_episodes, session.traces(), session.robot))

    def _keep(self, how: Callable[[Sequence[Trace], RobotModel], list[Path]], traces: list[Trace], robot: Any) -> None:
        """Write files in a thread of its own, so that nothing waits; then hand them to who drives.

        Only the session's thread asks; not while something else is written.
        """
        if self._busy():
            return
        self._keeping.acquire()

        def work() -> None:
            try:
                self.news = "writing ..."
                written = how(traces, robot) if traces else []
                self.news = f"wrote {', '.join(path.name for path in written)}" if written else "nothing to keep yet"
                client = self._viser.get_clients().get(
                    -1 if self.server.wheel.driver is None else self.server.wheel.driver
                )
                for path in written:
                    if client is not None:
                        client.send_file_download(path.name, path.read_bytes(), save_immediately=True)
                self.episode.options = (_LIVE, *self.shelf.episodes())
            except (JSSAGymError, OSError) as error:
                self.news = str(error)
            except Exception as error:
                _logger.exception("nothing was kept")
                self.news = f"nothing was kept: {error}"
            finally:
                self._keeping.release()

        threading.Thread(target=work, name="jssa-gym keep", daemon=True).start()

    def _busy(self) -> bool:
        """Whether something is written at present; that is said."""
        busy = self._keeping.locked()
        if busy:
            self.news = "still writing: ask again when that is done"
        return busy

    def _open(self, name: str) -> None:
        if name == _LIVE:
            self.playback, self._line.disabled = None, True
            self.runner.submit(lambda session: setattr(session, "paused", False))
            return
        live = self.runner.snapshot
        try:
            self.playback = Playback(self.shelf.folder / name, live.choices, live.robot)
        except JSSAGymError as error:
            self.news = str(error)
            self.episode.value = _LIVE
            return
        self._scrub = 0.0
        self._line.max, self._line.value, self._line.disabled = self.playback.length, 0.0, False
        self.runner.submit(lambda session: setattr(session, "paused", True))

    def _set_scrub(self, value: float) -> None:
        self._scrub = float(value)


def _says(view: ArmView) -> str:
    """An arm in words."""
    colour = "#{:02x}{:02x}{:02x}".format(*COLOURS[view.status])
    distance = "nobody is there" if math.isinf(view.distance) else f"distance **{view.distance:+.3f} m**"
    least = "" if math.isinf(view.closest) else f", least {view.closest:+.3f} m"
    touched = ""
    if view.contact:
        touched = (
            f" **contact**, arm at {view.contact_speed:.3f} m/s"
            if view.contact_speed > MOVING
            else " contact, arm at rest"
        )
    if view.moving_contacts:
        touched += f" **{view.moving_contacts * DT:.2f} s in contact while it moved**"
    promise = f"promise holds: {view.promise}" if view.promised else f"**promise off**: {view.promise}"
    reason = _plain(view.reason) or "–"
    return (
        f'**{_plain(view.name)}** <span style="color:{colour}">⬤</span> {WORDS[view.status]}  \n{reason}  \n'
        f"{distance}{least}{touched}  \n{promise}"
    )


def _plain(text: str) -> str:
    """Text that Markdown leaves as it is."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>#|~" else c for c in text if c.isprintable())
