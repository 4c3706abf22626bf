"""viser behind a door: only pages of this machine, or those that know a token, come in, and only the driver's count."""

import asyncio
import contextlib
import http.client
import io
import logging
import socket
import threading
from collections.abc import Awaitable, Callable, Generator
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import msgspec
import viser
import websockets.asyncio.server as serving
from websockets.datastructures import Headers, MultipleValuesError
from websockets.http11 import Response

from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.viewer.gate import LARGEST, Door, Speech, Wheel

MOST_VISITORS = 16
"""So many pages may be open."""

_FORGED = "forged.example"
"""A name that no server of ours has."""

_HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""Headers of every answer: no other page can show this one in a frame, and have its visitor click there."""

_building = threading.Lock()


class Server:
    """A page's server: viser, on a socket of ours, with a door before it.

    Args:
        door: Who may come in.
        speech: What their messages may be.
        listening: Its socket, of :func:`listen`; closed with the server.

    Raises:
        InterfaceError: This version of viser cannot be guarded.
    """

    def __init__(self, door: Door, speech: Speech, listening: socket.socket) -> None:
        self.door, self.speech, self.wheel = door, speech, Wheel()
        self.refused = 0
        """Messages that changed nothing."""
        self.on_refusal: Callable[[int, dict[str, Any]], None] = lambda visitor, message: None
        """Called, in the server's thread, with what somebody did who does not drive."""
        self.on_change: Callable[[], None] = lambda: None
        """Called, in the server's thread, when somebody comes or goes."""
        self._visits = 0
        self.port: int = listening.getsockname()[1]
        self._cookie = f"jssa_gym_{self.port}"
        self.viser = self._guarded(listening)
        self._try_door()

    @property
    def address(self) -> str:
        """What to open in a browser."""
        host = f"[{self.door.host}]" if ":" in self.door.host else self.door.host
        return f"http://{host}:{self.port}/" + ("" if self.door.token is None else f"?token={self.door.token}")

    def close(self) -> None:
        """Close all pages and stop."""
        with contextlib.redirect_stdout(io.StringIO()):  # viser says aloud that it stops
            self.viser.stop()

    # ---- viser behind the door -------------------------------------------------------------------------

    def _guarded(self, listening: socket.socket) -> viser.ViserServer:
        """viser, whose every connection comes through our socket and our checks."""
        with _building, self._in_place_of_serve(listening) as used:
            with contextlib.redirect_stdout(io.StringIO()):
                made = viser.ViserServer(self.door.host, self.port, verbose=False)
            if not used:
                listening.close()
                made.stop()
                raise InterfaceError(f"viser {viser.__version__} opens its server otherwise: it cannot be guarded")
        return made

    @contextlib.contextmanager
    def _in_place_of_serve(self, listening: socket.socket) -> Generator[list[None]]:
        """While viser is made: it has no argument for checks of one's own, websockets, which it serves with, has."""
        serve, used = serving.serve, []

        def guarded(handler: Any, host: Any, port: Any, *, process_request: Any, **others: Any) -> Any:
            used.append(None)
            quiet = logging.Logger("jssa_gym.viewer.connections", logging.CRITICAL + 1)
            changed: dict[str, Any] = {**others, "max_size": LARGEST, "logger": quiet}
            return serve(
                self._hearing(handler), sock=listening, process_request=self._asking(process_request),
                **changed,
            )  # fmt: skip

        serving.serve = guarded  # ty: ignore[invalid-assignment]
        try:
            yield used
        finally:
            serving.serve = serve

    def _asking(self, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """Answers of viser to requests that may be answered."""

        def process(connection: Any, request: Any) -> Any:
            try:
                headers = {name: request.headers.get(name) for name in ("Host", "Origin", "Cookie", "Upgrade")}
            except MultipleValuesError:
                return _told(HTTPStatus.BAD_REQUEST, "a header is there twice")
            given = {name: value for name, value in headers.items() if value is not None}
            websocket = "Upgrade" in given
            if refusal := self.door.refusal(given, websocket):
                return _told(HTTPStatus.FORBIDDEN, refusal)
            if not self.door.known(given.get("Cookie", ""), self._cookie):
                if websocket or not self.door.told(request.path):
                    return _told(HTTPStatus.UNAUTHORIZED, "open the address that jssa-gym view has printed, ?token=...")
                # from here on it is a cookie, which no other page's scripts can read
                response = _told(HTTPStatus.SEE_OTHER, "")
                response.headers["Location"] = urlsplit(request.path).path or "/"
                response.headers["Set-Cookie"] = f"{self._cookie}={self.door.token}; HttpOnly; SameSite=Strict; Path=/"
                return response
            response = answer(connection, request)
            if response is not None:
                for name, value in _HEADERS.items():
                    response.headers[name] = value
            return response

        return process

    def _hearing(self, handler: Callable[[Any], Awaitable[None]]) -> Callable[[Any], Awaitable[None]]:
        """Viser's work on a connection, of which it hears what counts."""

        async def handle(connection: Any) -> None:
            if len(self.wheel.visitors) >= MOST_VISITORS:
                await connection.close(1013, "too many pages are open")
                return
            # viser counts its clients in the same order
            visitor, self._visits = self._visits, self._visits + 1
            self.wheel.enter(visitor)
            self.on_change()
            try:
                await handler(_Heard(self, connection, visitor))
            finally:
                self.wheel.leave(visitor)
                self.on_change()

        return handle

    def counts(self, visitor: int, raw: Any) -> bool:
        """Whether what a visitor sent does something."""
        message: Any = None
        with contextlib.suppress(msgspec.DecodeError, ValueError, RecursionError):  # None is not understood either
            message = msgspec.msgpack.decode(raw) if isinstance(raw, bytes) else None
        if not self.speech.understands(message):
            self.refused += 1
            return False
        driver = self.wheel.driver
        if self.speech.drives(message) and not self.wheel.may_drive(visitor):
            self.refused += 1
            self.on_refusal(visitor, message)
            return False
        if self.wheel.driver != driver:
            self.on_change()
        return True

    def _try_door(self) -> None:
        """Knock as a forged page would: a door that lets it in is none."""
        host = "127.0.0.1" if self.door.host == "localhost" else self.door.host
        knock = http.client.HTTPConnection(host, self.port, timeout=10.0)
        try:
            knock.request("GET", "/", headers={"Host": _FORGED})
            status = knock.getresponse().status
        except (OSError, http.client.HTTPException) as error:
            self.close()
            raise InterfaceError(f"the page's server does not answer: {error}") from error
        finally:
            knock.close()
        if status != HTTPStatus.FORBIDDEN:
            self.close()
            raise InterfaceError(f"viser {viser.__version__} lets in whom it should not: it cannot be guarded")


class _Heard:
    """A connection, of which only what counts is heard."""

    def __init__(self, server: Server, connection: Any, visitor: int) -> None:
        self._server, self._connection, self._visitor = server, connection, visitor

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)

    async def recv(self) -> Any:
        while True:
            raw = await self._connection.recv()
            if self._server.counts(self._visitor, raw):
                return raw
            await asyncio.sleep(0)  # a flood must not keep the others waiting


def _told(status: HTTPStatus, text: str) -> Response:
    body = (text + "\n").encode()
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body)), **_HEADERS})
    return Response(status.value, status.phrase, headers, body)


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens there, and nowhere else.

    Args:
        host: Address or name of this machine.
        port: 0 for any that is free.

    Raises:
        ParameterError: Nothing can.
    """
    if not 0 <= port <= 65535:
        raise ParameterError(f"port has to be between 0 and 65535, got {port}")
    try:
        (family, *_, place), *_ = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        made = socket.create_server(place[:2], family=family)
    except OSError as error:
        raise ParameterError(f"cannot listen at {host}, port {port}: {error.strerror or error}") from error
    made.setblocking(False)
    return made
