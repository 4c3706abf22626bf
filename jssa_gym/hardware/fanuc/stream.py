"""A FANUC arm that follows a guard, packet by packet."""

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Self

import numpy as np

from jssa_gym.control.commands import Command
from jssa_gym.exceptions import ParameterError, StreamError
from jssa_gym.guard import Guard, GuardAnswer
from jssa_gym.hardware.fanuc.axes import LR_MATE, Axes, Tables
from jssa_gym.hardware.fanuc.link import Channel
from jssa_gym.hardware.fanuc.packets import airo
from jssa_gym.hardware.fanuc.program import Program
from jssa_gym.types import Array, CapsuleSet, MeasuredPeople
from jssa_gym.validation import positive_number

PATIENCE = 1.25
"""Ticks after the last packet in which the next has to come; then the tick goes on without it."""

LATE = 0.5
"""Ticks after the last one before which no other can have begun: a packet that comes earlier is of that one, late."""

SILENT = 0.5
"""For how long no packet may come before the stream is given up [s]."""

SETTLED = 0.6
"""For how long an arm has to stay where it is before it is taken to rest [s]: five times the lag of a slow drive."""

STEADY = float(np.radians(0.01))
"""How far joints may go meanwhile [rad]."""

ASTRAY = float(np.radians(0.5))
"""How far a drive may be from all places where it was commanded to be within the guard's ``actuation_lag`` [rad]."""


class FanucStream:
    """Streams what a guard answers to a controller, one position for each of its status packets.

    ::

        robot = jssa_gym.ROBOTS["lr_mate_200id_7l"]("stream")
        guard = jssa_gym.Guard(robot, failsafe={"actuation_lag": 0.2, "tracking_error": 0.01})
        stream = FanucStream(guard, UdpLink("192.168.1.100"), Program("192.168.1.100"))
        stream.connect()
        while not stream.halted:
            answer = stream.exchange(command, people)
        stream.close()

    A status packet that does not come, a drive that is not where it was commanded to be and a command that is None
    end in the stored stop for that tick. An emergency stop, an error or the loss of ``motion possible`` end the
    stream: :attr:`halted` says why, the stored stop is streamed to its end, then :meth:`restart` begins anew.

    Args:
        guard: For the arm behind the controller, with ``dt=0.008`` and the ``actuation_lag`` of its drives: a drive
            that is elsewhere than it was commanded to be within that time is astray.
        link: To the controller.
        program: Starts the controller's own program; None where somebody else does.
        axes: How its degrees belong to the model's radians.
        tables: What it accepts of a stream; the guard's limits have to be within them.
        clock: Tells the time [s]; never goes back.

    Raises:
        ParameterError: The guard is for more than the tables allow, for another number of joints, or for drives that
            do not lag.
        MissingExtraError: ``airo-fanuc`` is not installed.
    """

    def __init__(
        self,
        guard: Guard,
        link: Channel,
        program: Program | None = None,
        *,
        axes: Axes | None = None,
        tables: Tables = LR_MATE,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._wire = airo("testing.wire")
        self._axes = Axes((1.0,) * guard.robot.n, (0.0,) * guard.robot.n) if axes is None else axes
        if len(self._axes.sign) != guard.robot.n:
            raise ParameterError(f"axes are for {len(self._axes.sign)} joints, the guard for {guard.robot.n}")
        if excess := tables.excess(guard.robot):
            raise ParameterError(f"the controller would not accept that: {excess}; limits have to be within its tables")
        lag = guard.failsafe.actuation_lag
        if lag <= 0.0:
            raise ParameterError(
                "drives lag behind a stream, and the guard assumes that they do not: give it "
                "failsafe={'actuation_lag': ...}, the time [s] from a position to the arm that rests there"
            )
        self.guard, self._link, self._program, self._clock = guard, link, program, clock
        self._recent: deque[Array] = deque(maxlen=math.ceil(lag / guard.dt) + 1)
        self._version = self._sequence = 0
        self._seen: int | None = None
        self._heard = self._last = self._due = 0.0
        self._open = False
        self.halted = "it has not been connected"
        """Why the stream has ended; empty while it goes on."""
        self.lost = 0
        """Status packets that did not come."""
        self.measured: Array | None = None
        """Where the last status packet says that the joints are, shape (n,) [rad]."""

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def connect(self, timeout: float = 10.0) -> None:
        """Shake hands, wait until the arm may move and has not for a while, and begin with it where it is.

        Raises:
            StreamError: The controller does not answer, ticks at another rate or does not let the arm move, or the arm
                does not rest.
            ParameterError: The arm is outside the position limits.
        """
        positive_number("timeout", timeout)
        wire, end = self._wire, self._clock() + timeout
        self._link.send(wire.encode_stop_packet())  # of whatever was before
        self._link.send(wire.encode_get_capability_packet())
        told = self._wait(wire.decode_capability_result_packet, end, "it does not answer")
        if abs(told.sampling_rate_ms / 1000.0 - self.guard.dt) > 1e-9:
            raise StreamError(
                f"the controller ticks every {told.sampling_rate_ms} ms, the guard is for {self.guard.dt} s"
            )
        self._version, self._sequence, self._seen = told.available_version, 0, None
        try:
            self._link.send(wire.encode_start_packet(version_no=self._version))
            if self._program is not None:
                self._program.launch()
            status = self._at_rest(end)
            self.measured = self._axes.to_radians(status.joint_angle_deg)
            self.guard.start(self.measured)
        except BaseException:  # nobody streams: the controller is not left waiting for positions
            self._link.send(wire.encode_stop_packet(version_no=self._version))
            raise
        self._recent.clear()
        self._recent.append(self.measured)
        self._seen, self._heard = status.sequence_no, self._clock()
        self._last, self._due = self._heard, self._heard + PATIENCE * self.guard.dt
        self._open, self.halted = True, ""

    def restart(self, timeout: float = 10.0) -> None:
        """Begin anew after :attr:`halted`: faults are cleared, hands shaken, the arm taken to be where it is.

        Raises:
            StreamError: The stream has not ended, or as :meth:`connect`.
        """
        if not self.halted:
            raise StreamError("the stream goes on: close() it first")
        self.close()
        if self._program is not None:
            self._program.reset()
        self.connect(timeout)

    def exchange(self, command: Command | None, people: MeasuredPeople | CapsuleSet | None) -> GuardAnswer:
        """Wait for this tick's status packet, ask the guard, send the position.

        Args:
            command: See :meth:`Guard.tick`.
            people: See :meth:`Guard.tick`, with ages as of this call: the time that it waits is added to them.

        Raises:
            StreamError: The stream is closed.
        """
        if not self._open:
            raise StreamError(f"the stream is closed: {self.halted}")
        entered = self._clock()
        trouble = self._listen()
        people = _aged(people, max(self._heard - entered, 0.0))
        answer = self.guard.tick(None if trouble or self.halted else command, people, self._heard)
        if why := trouble or self.halted:
            answer = answer._replace(reason=answer.reason.replace("there is no command", why, 1))
        last = bool(self.halted) and self.guard.rests
        self._send(answer.position, last=last)
        if last:
            self._end()
        return answer

    def close(self) -> None:
        """Bring the arm to rest by the stored stop and end the stream."""
        if self._open:
            self.halted = self.halted or "it was closed"
            while self._open:
                self.exchange(None, None)

    # ---- its parts -----------------------------------------------------------------------------------

    def _at_rest(self, end: float) -> Any:
        """The status of an arm that may move and has not for a while, before a time."""
        wire, anchor, since, why = self._wire, np.full(self.guard.robot.n, np.nan), 0.0, ""

        def resting(packet: bytes) -> Any:
            nonlocal anchor, since, why
            status = wire.decode_status_packet(packet)
            if status is None:
                return None
            now, joints, why = self._clock(), self._axes.to_radians(status.joint_angle_deg), self._refused(status)
            if why or not np.abs(joints - anchor).max() <= STEADY:
                anchor, since = joints, now
            return status if not why and now - since >= SETTLED else None

        try:
            return self._wait(resting, end, "it does not let the arm move")
        except StreamError:
            if why or np.isnan(anchor).any():
                raise
            degrees = np.degrees(STEADY)
            raise StreamError(
                f"the arm does not rest: its joints have to stay within {degrees:g} degrees for {SETTLED} s"
            ) from None

    def _wait(self, reads: Callable[[bytes], Any], end: float, what: str) -> Any:
        """The first packet that can be read, before a time."""
        while self._clock() < end:
            packet = self._link.receive(self.guard.dt)
            if packet is not None and (found := reads(packet)) is not None:
                return found
        raise StreamError(f"no connection to the controller: {what}")

    def _listen(self) -> str:
        """Wait for the next status packet; what is wrong in this tick, or nothing."""
        status, now = self._newest(), self._clock()
        if status is None:
            # the tick goes on by the controller's beat, not that of waiting; but what is far too late is not made up
            self._heard = max(self._heard + self.guard.dt, now - LATE * self.guard.dt)
            self._due = max(self._due + self.guard.dt, self._heard + PATIENCE * self.guard.dt)
            self.lost += 1
            if self._heard - self._last > SILENT and not self.halted:
                self.halted = f"no status packet for {SILENT} s"
            return "the status packet of this tick is lost"
        self._last = self._heard = now
        self._due = now + PATIENCE * self.guard.dt
        self.measured = self._axes.to_radians(status.joint_angle_deg)
        if refused := self._refused(status):
            self.halted = self.halted or refused
            return refused
        return self._astray(self.measured)

    def _newest(self) -> Any:
        """The newest status packet, or None if there is none that is newer than the last."""
        found = None
        while True:
            left = 0.0 if found is not None else max(self._due - self._clock(), 0.0)
            packet = self._link.receive(left)
            if packet is None:
                return found
            status = self._wire.decode_status_packet(packet)
            if status is None or not all(np.isfinite(status.joint_angle_deg)):
                continue
            ahead = None if self._seen is None else (status.sequence_no - self._seen) & 0xFFFF_FFFF
            if ahead is not None and not 0 < ahead < 0x8000_0000:  # a duplicate, or overtaken
                continue
            self._seen = status.sequence_no
            now = self._clock()
            if now - self._heard >= LATE * self.guard.dt:
                found = status
            else:  # its tick went on without it; the next one comes a tick after it
                self._due = now + PATIENCE * self.guard.dt

    def _refused(self, status: Any) -> str:
        """Why the controller does not let the arm move, or nothing."""
        if status.e_stopped:
            return "emergency stop"
        if status.in_error:
            return "the controller is in error"
        if status.tp_enabled:
            return "the teach pendant is enabled"
        return "" if status.motion_possible else "the controller lets nothing move"

    def _astray(self, measured: Array) -> str:
        """Which joint is not where it was commanded to be lately, or nothing."""
        places = np.array(self._recent)
        off = np.maximum(places.min(axis=0) - measured, measured - places.max(axis=0))
        j = int(off.argmax())
        if off[j] <= ASTRAY:
            return ""
        return (
            f"{self.guard.robot.joint_names[j]} is {np.degrees(off[j]):.2g} degrees from where it was commanded to be"
        )

    def _send(self, position: Array, last: bool) -> None:
        self._sequence += 1
        self._recent.append(position)
        packet = self._wire.encode_command_packet(
            self._sequence, self._axes.to_degrees(position), is_last_command=last, version_no=self._version
        )
        self._link.send(packet)

    def _end(self) -> None:
        self._link.send(self._wire.encode_stop_packet(version_no=self._version))
        self._open = False


def _aged(people: Any, passed: float) -> Any:
    """People as they were handed over, some time [s] later; what cannot be read is for the guard to refuse."""
    if isinstance(people, CapsuleSet):
        return MeasuredPeople(people, passed)
    if not isinstance(people, MeasuredPeople):
        return people
    try:
        return replace(people, age=people.age + passed)
    except Exception:  # whatever was put in the place of an age
        return people
