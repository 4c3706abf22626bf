"""A stream to airo-fanuc's simulated controller on the real clock: rate, jitter, and every fault that it can inject.

    python benchmarks/fanuc_stream.py --seconds 600

The simulated controller ticks every 8 ms in a process of its own; here a guard is asked once for each of its packets,
beside somebody who wanders. Every ten seconds a fault is injected in turn: a lost packet, ten lost packets, a gap in
the numbers, a duplicate, an emergency stop and a restart. Exit status 1 if the controller found a packet
that breaks its contract, or the stream did not come back.
"""

import argparse
import multiprocessing
import re
import sys
import time
from collections import Counter
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

import jssa_gym
from jssa_gym.evaluation.identity import made_with
from jssa_gym.hardware.fanuc import FanucStream, Program, UdpLink
from jssa_gym.humans import make_human, nobody

FAULTS = ("lost", "ten lost", "gap", "duplicate", "emergency stop")


def controller(pipe: Connection, start: list[float]) -> None:
    """The other process: the simulated controller."""
    from airo_fanuc.testing.fake_crx import FakeCRXController

    fake = FakeCRXController(initial_q_deg=start).start()
    pipe.send((fake.sm_port, fake.rmi_port))
    does: dict[str, Any] = {
        "lost": lambda: fake.drop_status(1),
        "ten lost": lambda: fake.drop_status(10),
        "gap": lambda: fake.inject_seq_gap(3),
        "duplicate": fake.duplicate_next_status,
        "emergency stop": fake.press_estop,
        "release": fake.release_estop,
    }
    due = time.monotonic()
    while True:
        while pipe.poll():
            word = pipe.recv()
            if word == "end":
                pipe.send((fake.violations, fake.state.deviation_fault_latched))
                fake.close()
                return
            does[word]()
        fake.clock.advance(0.008)
        fake.sm.tick(0.008, raise_on_violation=False)
        due = max(due + 0.008, time.monotonic())  # a tick that was slept through is not made up for
        time.sleep(max(due - time.monotonic(), 0.0))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--every", type=float, default=10.0, help="seconds between faults")
    given = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    robot = jssa_gym.ROBOTS["lr_mate_200id_7l"]("stream")
    guard = jssa_gym.Guard(robot, failsafe={"actuation_lag": 0.2, "tracking_error": 0.01})
    guard.start(robot.home)
    guard.tick(jssa_gym.JointPosition(robot.home), nobody(), 0.0)  # compiled before anything is streamed

    spawn = multiprocessing.get_context("spawn")
    mine, theirs = spawn.Pipe()
    other = spawn.Process(target=controller, args=(theirs, np.degrees(robot.home).tolist()), daemon=True)
    other.start()
    stream_port, program_port = mine.recv()
    link = UdpLink("127.0.0.1", stream_port)
    program = Program("127.0.0.1", program_port)
    stream = FanucStream(guard, link, program)
    stream.connect()

    motion = make_human("random")
    people = motion.reset(np.random.default_rng(0))
    begun = before = time.monotonic()
    next_fault, turn, restarts = begun + given.every, 0, 0
    gaps, ends, statuses, reasons = [], [], [0] * 5, Counter()
    while time.monotonic() - begun < given.seconds:
        t = time.monotonic() - begun
        command = jssa_gym.JointPosition(guard.robot.home + 0.4 * np.sin(0.7 * t) * np.ones(6))
        answer = stream.exchange(command, people)
        now = time.monotonic()
        gaps.append(now - before)
        statuses[answer.status] += 1
        if answer.status == jssa_gym.Status.FAULT:
            reasons[re.sub(r"[0-9.]+", "#", answer.reason)] += 1
        people = motion.step(max(now - before, 1e-6), nobody())
        before = now
        if stream.halted:
            why = stream.halted
            stream.close()
            ends.append((why, guard.rests))
            mine.send("release")
            time.sleep(1.0)
            stream.restart()
            restarts += 1
            before = time.monotonic()
        if now > next_fault:
            mine.send(FAULTS[turn % len(FAULTS)])
            next_fault, turn = now + given.every, turn + 1
    stream.close()
    mine.send("end")
    violations, deviation = mine.recv()
    program.close()
    link.close()
    gaps_ms = 1e3 * np.array(gaps)
    names = {status.name: count for status, count in zip(jssa_gym.Status, statuses, strict=True) if count}
    print(f"{len(gaps):,} packets in {given.seconds:g} s, {1e3 / gaps_ms.mean():.2f} a second; between two of them")
    print(f"median {np.median(gaps_ms):.3f} ms, 99 % within {np.percentile(np.abs(gaps_ms - 8.0), 99):.3f} ms of 8 ms,")
    print(f"longest {gaps_ms.max():.1f} ms; {stream.lost} status packets lost")
    rested = sum(rests for _, rests in ends)
    print(f"faults injected: {turn}; ends of the stream: {len(ends)}, at rest: {rested}; restarts: {restarts}")
    for why, count in Counter(why for why, _ in ends).items():
        print(f"    {count:6,} {why}")
    print(f"decisions: {names}")
    for reason, count in reasons.most_common(8):
        print(f"    {count:6,} {reason}")
    print(f"violations of the controller's contract: {len(violations)}; deviation fault: {deviation}")
    for violation in violations[:5]:
        print("   ", violation)
    return int(bool(violations) or deviation or restarts < len(ends) or rested < len(ends))


if __name__ == "__main__":
    sys.exit(main())
