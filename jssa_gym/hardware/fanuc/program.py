"""The controller's half of a stream: the program that listens, started over the remote interface (RMI)."""

from typing import Any

from jssa_gym.hardware.fanuc.packets import airo

NAME = "STREAM_MOTN"
"""Name of the program on the controller."""


class Program:
    """Starts the streaming program, and clears what can be cleared after an emergency stop.

    Args:
        host: The controller's address.
        port: Of its remote interface.
        name: Of the program.

    Raises:
        MissingExtraError: ``airo-fanuc`` is not installed.
    """

    def __init__(self, host: str, port: int = 16001, name: str = NAME) -> None:
        self._client: Any = airo("rmi_client").RmiClient(host, port)
        self._name, self._open = name, False

    def launch(self) -> None:
        """Start the program anew."""
        if not self._open:
            self._client.start()
            self._open = True
        self._client.initialize()
        self._client.program_call(self._name)

    def reset(self) -> None:
        """Clear faults; a button that is still pressed stays pressed."""
        self._client.reset()

    def close(self) -> None:
        """End the session."""
        if self._open:
            self._client.stop()
            self._open = False
