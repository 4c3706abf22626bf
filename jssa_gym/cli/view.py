"""``jssa-gym view``: a page on which a person is dragged beside a shielded arm."""

import contextlib
import socket
import time
import webbrowser
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from jssa_gym.cli.evaluate import find_policies_here
from jssa_gym.cli.files import writable_folder
from jssa_gym.cli.film import film, rate_of
from jssa_gym.cli.names import POLICY, ROBOT, TASK
from jssa_gym.cli.terminal import Terminal
from jssa_gym.exceptions import MissingExtraError, how_to_install
from jssa_gym.robots import DEFAULT, RobotModel
from jssa_gym.shields import TASK_SHIELD
from jssa_gym.types import Trace
from jssa_gym.viewer import Choices, Session, ShieldChoice
from jssa_gym.viewer.choices import DRAGGED
from jssa_gym.viewer.gate import LOOPBACK, Door
from jssa_gym.viewer.shelf import Shelf

if TYPE_CHECKING:
    from jssa_gym.viewer.page import Page

PORT = 8765
"""Where the page is unless told otherwise."""


@dataclass(frozen=True)
class ViewCommand:
    """Open a page on which a person is dragged by the mouse beside a shielded arm; Ctrl-C ends it.

    Only this machine can open it, unless --host and --token say otherwise. It takes some seconds to begin.
    """

    task: Annotated[str, TASK] = "reach"
    robot: Annotated[str, ROBOT] = DEFAULT
    human: str = DRAGGED
    """Who is there at first: dragged, by the mouse; or people by name or file as of jssa-gym evaluate."""
    policy: Annotated[str, POLICY] = "jpc"
    shields: tuple[str, ...] = (TASK_SHIELD,)
    """One or two shields, by name as --filter of jssa-gym evaluate; unshielded for no shield. Two are side by side."""
    seed: int = 0
    """Seed of goals, people and policy."""
    out: Path = Path("view")
    """Folder for films and episodes that are kept; those in it can be opened on the page."""
    port: int = PORT
    """Where the page is; 0 for any port that is free."""
    host: str = LOOPBACK
    """Address of this machine at which others may open the page; needs --token."""
    token: str | None = None
    """What visitors have to know: 16 or more letters, digits, '-' and '_'. The address that is printed bears it."""
    open: bool = False
    """Open the page in this machine's browser."""

    def run(self) -> None:
        """Build, open, stay."""
        door = Door(self.host, self.token)
        find_policies_here([self.policy])
        choices = Choices(
            task=self.task,
            robot=self.robot,
            human=self.human,
            policy=self.policy,
            shields=tuple(ShieldChoice(name) for name in self.shields),
            seed=self.seed,
        )
        page_class, listen = require_page()
        with contextlib.closing(listen(self.host, self.port)) as listening:
            session = Session(choices)
            writable_folder(self.out)
            session.step()  # compiles, before anybody waits for it
            session.snapshot()
            session.reset()
            page = page_class(session, door, listening, Shelf(self.out, pictures))
            self._stay(page)

    def _stay(self, page: "Page") -> None:
        """Until Ctrl-C."""
        console = Terminal(stderr=True)
        page.start()
        console.say(f"open {page.server.address}")
        if self.open:
            webbrowser.open(page.server.address)
        try:
            while page.runner.failure is None:
                time.sleep(0.2)
        except KeyboardInterrupt:
            console.say("closed")
        finally:
            page.close()


def require_page() -> tuple[type["Page"], Callable[[str, int], socket.socket]]:
    """The page's class and what makes its socket, before long work for it.

    Raises:
        MissingExtraError: viser is not installed.
    """
    try:
        from jssa_gym.viewer.page import Page
        from jssa_gym.viewer.server import listen
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"the page needs the extra 'viewer' ({error.name} is missing): {how_to_install('viewer')}"
        ) from error
    return Page, listen


def pictures(traces: Sequence[Trace], robot: RobotModel) -> tuple[Iterable[NDArray[np.uint8]], int]:
    """A film's pictures, and how many a second."""
    return film(traces, robot), rate_of(traces[0])
