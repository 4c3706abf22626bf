"""Datagrams to and from a controller."""

import select
import socket
from typing import Protocol

PORT = 60015
"""Port of Stream Motion."""

LARGEST = 2048
"""Bytes of a datagram that are read."""


class Channel(Protocol):
    """What :class:`~jssa_gym.hardware.fanuc.FanucStream` talks through."""

    def send(self, packet: bytes) -> None:
        """Send one packet."""
        ...

    def receive(self, timeout: float) -> bytes | None:
        """The next packet, or None if none comes in time; with 0 only what is there already."""
        ...

    def close(self) -> None:
        """Free what is held; once is enough."""
        ...


class UdpLink:
    """UDP.

    Args:
        host: The controller's address.
        port: Its port.
    """

    def __init__(self, host: str, port: int = PORT) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect((host, port))

    def send(self, packet: bytes) -> None:
        """Send one packet; what the network refuses is as good as lost, which the next status shows."""
        try:
            self._socket.send(packet)
        except OSError:
            return

    def receive(self, timeout: float) -> bytes | None:
        """The next packet, or None if none comes within ``timeout`` [s]."""
        try:
            if timeout > 0.0 and not select.select([self._socket], [], [], timeout)[0]:
                return None
            return self._socket.recv(LARGEST)
        except OSError:  # nothing there, or nobody listens
            return None

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
