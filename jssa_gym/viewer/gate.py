"""Who may come in, and what a page may say: everything else changes nothing.

The page speaks to the server in messages of viser's. Only those that a widget of this page can have sent are let
through, with values that the widget can have, and from the visitor who drives. viser itself would set any attribute
that a message names, and open the server to the internet if one asks for that.
"""

import hmac
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from ipaddress import ip_address
from typing import Any, TypeGuard
from urllib.parse import parse_qs, urlsplit

from jssa_gym.exceptions import ParameterError

LOOPBACK = "127.0.0.1"
"""Where the server listens unless told otherwise."""

_HERE = (LOOPBACK, "localhost")
"""Names of this machine that a browser on it may use, also behind a forwarded port."""

TOKEN_LENGTH = 16
"""Fewest characters of a token."""

LARGEST = 64 * 2**10
"""Most that a message of a page may have [bytes]."""

RELIEVED = 30.0
"""Whoever drives and does nothing for so long may be relieved by somebody who does [s]."""


# ---- coming in -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Door:
    """Which requests are answered.

    Args:
        host: Where the server listens.
        token: What visitors have to know; None for nothing, which is for the loopback address alone.

    Raises:
        ParameterError: Another host without a token, a token that is too short, or a host that is no single one.
    """

    host: str = LOOPBACK
    token: str | None = None

    def __post_init__(self) -> None:
        if self.host in ("", "0.0.0.0", "::"):
            raise ParameterError("the host has to be one address or name of this machine, by which visitors call it")
        if not self.local and self.token is None:
            raise ParameterError(
                f"at {self.host} everybody in the network could come in: give --token too, of {TOKEN_LENGTH} "
                "characters or more; or forward the port by ssh and leave the host as it is"
            )
        plain = self.token is None or all(c.isascii() and (c.isalnum() or c in "-_") for c in self.token)
        if self.token is not None and (len(self.token) < TOKEN_LENGTH or not plain):
            raise ParameterError(
                f"a token has {TOKEN_LENGTH} or more letters, digits, '-' and '_', such as of "
                "python -c 'import secrets; print(secrets.token_urlsafe())'"
            )

    @property
    def local(self) -> bool:
        """Whether only this machine can reach the server."""
        if self.host == "localhost":
            return True
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return False

    def refusal(self, headers: Mapping[str, str], websocket: bool) -> str:
        """Why a request is not answered; empty if it is, as far as headers go.

        Args:
            headers: Of the request.
            websocket: Whether it asks for a websocket: those have to come from a page of this very server.
        """
        name = _host_of(headers.get("Host", ""))
        if name not in (*_HERE, self.host.casefold()):
            return "the Host header names another machine"
        origin = headers.get("Origin")
        if origin is None:
            return "a websocket needs an Origin header" if websocket else ""
        if urlsplit(origin).scheme not in ("http", "https") or urlsplit(origin).netloc != headers.get("Host"):
            return "the Origin header names another page"
        return ""

    def told(self, path: str) -> bool:
        """Whether a request's path bears the token."""
        given = parse_qs(urlsplit(path).query).get("token", [])
        return self.token is None or (len(given) == 1 and self._is_token(given[0]))

    def known(self, cookies: str, name: str) -> bool:
        """Whether a request's cookie does."""
        if self.token is None:
            return True
        try:
            found = SimpleCookie(cookies).get(name)
        except CookieError:
            return False
        return found is not None and self._is_token(found.value)

    def _is_token(self, given: str) -> bool:
        return self.token is not None and hmac.compare_digest(given.encode(), self.token.encode())


def _host_of(header: str) -> str:
    """The name in a Host header, without its port; empty if it makes no sense."""
    try:
        parts = urlsplit(f"//{header}")
        _ = parts.port
        plain = parts.hostname is not None and parts.path == parts.query == parts.fragment == "" and "@" not in header
    except ValueError:
        return ""
    return parts.hostname or "" if plain else ""


# ---- speaking ------------------------------------------------------------------------------------------

Check = Callable[[Any], bool]
"""Whether a value is one that a widget can have."""


def switch(value: Any) -> bool:
    """Whether a value is one of a checkbox, or of a button that is pressed."""
    return isinstance(value, bool)


def number(low: float, high: float) -> Check:
    """The check of a slider or a number's field."""
    return lambda value: _real(value) and low - 1e-9 <= value <= high + 1e-9


def one_of(options: Callable[[], Sequence[str]]) -> Check:
    """The check of a dropdown, whose options may change."""
    return lambda value: isinstance(value, str) and value in options()


def _real(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _reals(count: int, most: float = 1e4) -> Check:
    def check(value: Any) -> bool:
        return (
            isinstance(value, list | tuple) and len(value) == count and all(_real(x) and abs(x) <= most for x in value)
        )

    return check


def _is(*values: Any) -> Check:
    return lambda value: any(value is one or (type(value) is type(one) and value == one) for one in values)


_LENGTH: Check = lambda value: _real(value) and 0.0 < value <= 1e5  # noqa: E731

_CAMERA: dict[str, Check] = {
    "wxyz": _reals(4),
    "position": _reals(3),
    "fov": _LENGTH,
    "near": _LENGTH,
    "far": _LENGTH,
    "image_height": _LENGTH,
    "image_width": _LENGTH,
    "look_at": _reals(3),
    "up_direction": _reals(3),
}

_DRAG: dict[str, Check] = {
    "phase": _is("start", "update", "end"),
    "start_position": _reals(3),
    "start_screen_pos": _reals(2, 1e6),
    "end_position": _reals(3),
    "end_screen_pos": _reals(2, 1e6),
    "button": _is("left"),
    "modifier": _is(None),
    "owner": _is(""),
}


@dataclass
class Speech:
    """Which messages do something.

    Widgets and scene nodes that may be moved are entered as they are made.
    """

    widgets: dict[str, Check] = field(default_factory=dict)
    """What each widget's value can be, by the widget's identifier."""
    nodes: dict[str, int] = field(default_factory=dict)
    """Scene nodes that can be dragged, and of how many instances."""

    def understands(self, message: Any) -> TypeGuard[dict[str, Any]]:
        """Whether a decoded message is one that this page's widgets can have sent."""
        if not isinstance(message, dict) or not all(isinstance(key, str) for key in message):
            return False
        fields = {key: value for key, value in message.items() if key != "type"}
        match message.get("type"):
            case "ViewerCameraMessage":
                return _fits(fields, _CAMERA)
            case "GuiUpdateMessage":
                updates = fields.get("updates")
                check = self.widgets.get(fields["uuid"]) if isinstance(fields.get("uuid"), str) else None
                return (
                    check is not None
                    and fields.keys() == {"uuid", "updates"}
                    and isinstance(updates, dict)
                    and updates.keys() == {"value"}
                    and check(updates["value"])
                )
            case "SceneNodeDragMessage":
                name, instance = fields.pop("name", None), fields.pop("instance_index", None)
                count = self.nodes.get(name, 0) if isinstance(name, str) else 0
                return type(instance) is int and 0 <= instance < count and _fits(fields, _DRAG)
        return False

    @staticmethod
    def drives(message: Mapping[str, Any]) -> bool:
        """Whether a message does more than to look around."""
        return message["type"] != "ViewerCameraMessage"


def _fits(fields: Mapping[str, Any], wanted: Mapping[str, Check]) -> bool:
    return fields.keys() == wanted.keys() and all(check(fields[key]) for key, check in wanted.items())


@dataclass
class Wheel:
    """Who drives: who came first; when they leave, or do nothing while another one does something, the next."""

    clock: Callable[[], float] = time.monotonic
    visitors: list[int] = field(default_factory=list)
    driver: int | None = None
    _used: float = 0.0

    def enter(self, visitor: int) -> None:
        """Somebody opened the page."""
        self.visitors.append(visitor)
        if self.driver is None:
            self._take(visitor)

    def leave(self, visitor: int) -> None:
        """Somebody closed it, or was lost."""
        if visitor in self.visitors:
            self.visitors.remove(visitor)
        if self.driver == visitor:
            self.driver = None
            if self.visitors:
                self._take(self.visitors[0])

    def may_drive(self, visitor: int) -> bool:
        """Whether what a visitor does counts."""
        if visitor != self.driver and visitor in self.visitors and self.clock() - self._used > RELIEVED:
            self._take(visitor)
        if visitor != self.driver:
            return False
        self._used = self.clock()
        return True

    def _take(self, visitor: int) -> None:
        self.driver, self._used = visitor, self.clock()
