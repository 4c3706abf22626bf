"""Stream Motion against the simulated controller of airo-fanuc, on a simulated clock: losses, stops, restarts."""

import sys

import numpy as np
import pytest

import jssa_gym
from jssa_gym import Guard, JointPosition, JointVelocity, MeasuredPeople, Status
from jssa_gym.exceptions import MissingExtraError, ParameterError, StreamError
from jssa_gym.hardware.fanuc import LR_MATE, Axes, FanucStream, Program, Tables, UdpLink
from jssa_gym.humans import nobody
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.types import CapsuleSet

fake_crx = pytest.importorskip("airo_fanuc.testing.fake_crx")
wire = pytest.importorskip("airo_fanuc.testing.wire")

DT = 0.008
HOME = np.degrees(lr_mate_200id_7l().home)
STILL = JointVelocity(np.zeros(6))
LAG = 0.6


def lagging(lag=LAG, **kwargs):
    return Guard(lr_mate_200id_7l("stream"), failsafe={"actuation_lag": lag}, **kwargs)


class Ticking(UdpLink):
    """Lets the controller tick whenever somebody waits for it: no time passes otherwise."""

    def __init__(self, fake):
        super().__init__("127.0.0.1", fake.sm_port)
        self.fake, self.sent = fake, []
        # noise of the datagrams: bytes that are put in before the next
        self.noise = []
        # whether the next packet comes after somebody has given up waiting for it
        self.late, self.held = False, []

    def receive(self, timeout):
        if self.noise:
            return self.noise.pop()
        if self.held:
            return self.held.pop()
        packet = super().receive(0.0)
        if packet is not None or timeout <= 0.0:
            return packet
        self.fake.tick()
        packet = super().receive(0.0)
        if self.late:
            self.late, self.held = False, [packet]
            return None
        return packet

    def send(self, packet):
        if packet[3] == wire.PACKET_TYPE_COMMAND:
            self.sent.append(wire.struct.unpack_from(">6d", packet, wire.COMMAND_POS_OFFSET))
        super().send(packet)


class Cell:
    """A controller, a guard and the stream between them."""

    def __init__(self, start=HOME, version=3, lag=LAG, **kwargs):
        config = fake_crx.FakeCRXConfig(available_version=version)
        self.fake = fake_crx.FakeCRXController(config, initial_q_deg=list(start)).start()
        self.guard = lagging(lag)
        self.link = Ticking(self.fake)
        self.program = Program("127.0.0.1", self.fake.rmi_port)
        self.stream = FanucStream(self.guard, self.link, self.program, clock=self.fake.clock.now, **kwargs)

    def run(self, ticks, command=None, people=None):
        command = JointVelocity([0.5, 0.0, 0.0, 0.5, 0.0, 1.0]) if command is None else command
        people = nobody() if people is None else people
        return [self.stream.exchange(command, people) for _ in range(ticks)]

    def close(self):
        self.program.close()
        self.link.close()
        self.fake.close()


@pytest.fixture
def cell():
    made = []

    def make(**kwargs):
        made.append(Cell(**kwargs))
        return made[-1]

    yield make
    for one in made:
        one.close()


def keeps_the_tables(sent):
    """Whether streamed positions, shape (T, 6) [deg], are within the controller's tables, by differences."""
    q = np.array(sent)
    for order, table in ((1, LR_MATE.velocity), (2, LR_MATE.acceleration), (3, LR_MATE.jerk)):
        # a difference of a jerk that is held for a tick is a mean of neighbouring ones; degrees round to 1e-13
        if np.any(np.abs(np.diff(q, order, axis=0)) / DT**order > np.array(table) * (1.0 + 1e-6) + 1e-13 / DT**order):
            return False
    return True


@pytest.mark.parametrize("version", [3, 4])
def test_it_streams_what_the_guard_answers(cell, version):
    one = cell(version=version)
    one.stream.connect()
    np.testing.assert_allclose(one.stream.measured, one.guard.robot.home, atol=1e-6)
    answers = one.run(200)
    assert {a.status for a in answers} == {Status.NOMINAL}
    np.testing.assert_array_equal(one.link.sent[-1], np.degrees(answers[-1].position))
    assert len(one.link.sent) == 200
    np.testing.assert_allclose(one.fake.q_meas_deg[:6], one.link.sent[-1], atol=12.0)  # it lags by 0.125 s
    one.stream.close()
    assert one.guard.rests
    assert one.stream.halted == "it was closed"
    assert not one.fake.violations
    assert keeps_the_tables(one.link.sent)
    assert not one.fake.state.deviation_fault_latched
    with pytest.raises(StreamError, match="closed"):
        one.run(1)


def test_whatever_is_commanded_keeps_the_tables_and_reaches_them(cell):
    one, rng = cell(), np.random.default_rng(0)
    with one.stream:
        for _ in range(40):
            one.run(25, JointVelocity(10.0 * rng.normal(size=6)))
    assert keeps_the_tables(one.link.sent)
    assert not one.fake.violations
    assert np.abs(np.diff(one.link.sent, 3, axis=0)).max() / DT**3 > 0.5 * min(LR_MATE.jerk)


def test_a_lost_packet_goes_on_with_the_stored_stop(cell):
    one = cell()
    one.fake.tick(200)  # the controller has been on for a while
    one.stream.connect()
    one.fake.drop_status(1)
    assert one.run(1)[0].status == Status.FAULT
    assert not one.stream.halted
    one.stream.lost = 0
    one.run(60)
    one.fake.drop_status(1)
    lost = one.run(1)[0]
    assert lost.status == Status.FAULT
    assert lost.reason.startswith("the status packet of this tick is lost")
    assert one.stream.lost == 1
    assert not one.stream.halted
    assert one.run(20)[-1].status == Status.NOMINAL
    one.fake.drop_status(20)
    speeds = [np.abs(a.velocity).max() for a in one.run(20)]
    assert speeds[-1] < 0.5 * speeds[0]
    assert one.run(40)[-1].status == Status.NOMINAL
    one.stream.close()
    assert not one.fake.violations
    assert keeps_the_tables(one.link.sent)


def test_gaps_duplicates_and_noise_of_packets_are_nothing(cell):
    one = cell()
    one.stream.connect()
    one.run(30)
    one.fake.inject_seq_gap(5)
    assert one.run(1)[0].status == Status.NOMINAL
    one.fake.duplicate_next_status()
    assert {a.status for a in one.run(3)} == {Status.NOMINAL}
    broken = bytearray(
        wire.build_status_v3_packet(
            position_deg=[0.0] * 9, joint_angle_deg=[np.nan] * 9, current=[0.0] * 9, safety_scale=1.0
        )
    )
    one.link.noise = [b"", b"\x00" * 7, b"\xff" * 500, bytes(broken)]
    assert {a.status for a in one.run(3)} == {Status.NOMINAL}
    old = wire.build_status_v3_packet(
        sequence_no=1, position_deg=[0.0] * 9, joint_angle_deg=[90.0] * 9, current=[0.0] * 9, safety_scale=1.0
    )
    one.link.noise = [old]
    assert {a.status for a in one.run(3)} == {Status.NOMINAL}
    one.fake.clock.advance(0.6 * DT)  # late enough for a tick of its own, if it were any
    one.link.noise = [old]
    assert not any("degrees from" in a.reason for a in one.run(3))
    assert not one.stream.halted
    one.stream.close()
    assert not one.fake.violations
    assert keeps_the_tables(one.link.sent)


def test_a_packet_that_comes_late_is_answered_once(cell):
    one = cell()
    one.stream.connect()
    one.run(60)
    begun = one.fake.clock.now()
    for _ in range(5):
        one.link.late = True
        assert "is lost" in one.run(1)[0].reason
        assert one.run(5)[-1].status == Status.NOMINAL
    assert one.fake.clock.now() - begun == pytest.approx(30 * DT)  # a tick for each of thirty
    one.stream.close()
    assert not one.fake.violations
    assert keeps_the_tables(one.link.sent)


FAULTS = {
    "emergency stop": (lambda fake: fake.press_estop(), "emergency stop"),
    "alarm": (lambda fake: fake.inject_alarm("SRVO-050", "Collision detect"), "in error"),
    "teach": (lambda fake: fake.set_teach(True), "teach pendant"),
    "motion not possible": (lambda fake: fake.drop_motion_possible(), "lets nothing move"),
    "silence": (lambda fake: fake.drop_status(10_000), "no status packet for 0.5 s"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_the_controller_ends_at_rest_and_it_begins_anew(cell, name):
    inject, word = FAULTS[name]
    one = cell()
    one.stream.connect()
    one.run(80)
    moving = np.abs(one.guard.state.velocity).max()
    inject(one.fake)
    ticks = 0
    while not one.stream.halted and ticks < 100:
        answer, ticks = one.run(1)[0], ticks + 1
        assert answer.status == Status.FAULT
    assert word in one.stream.halted
    assert moving > 0.3
    one.stream.close()
    assert one.guard.rests
    assert not one.fake.violations
    assert keeps_the_tables(one.link.sent)
    one.fake.release_estop()
    one.fake.set_teach(False)
    one.fake.restore_motion_possible()
    one.fake.sm._drop_status_countdown = 0
    one.fake.tick(200)  # somebody looks after it; the arm is at rest
    sent = len(one.link.sent)
    one.stream.restart()
    np.testing.assert_allclose(one.guard.state.position, np.radians(one.fake.q_meas_deg[:6]), atol=1e-6)
    assert one.run(60)[-1].status == Status.NOMINAL
    one.stream.close()
    assert not one.fake.violations
    assert keeps_the_tables(one.link.sent[sent:])


def test_a_button_that_is_still_pressed_lets_nothing_begin(cell):
    one = cell()
    one.stream.connect()
    one.run(10)
    one.fake.press_estop()
    one.run(1)
    with pytest.raises(StreamError, match="does not let the arm move"):
        one.stream.restart(timeout=0.4)
    assert one.stream.halted


def test_a_drive_that_is_not_where_it_was_commanded_to_be_stops_the_arm(cell):
    one = cell()
    one.stream.connect()
    one.run(60)
    one.fake.plant.q_meas[1] += 3.0
    astray = one.run(1)[0]
    assert astray.status == Status.FAULT
    assert "J2 is 2.8 degrees from where" in astray.reason
    one.stream.close()
    assert not one.fake.violations


def test_a_drive_may_lag_as_far_as_the_guard_assumes(cell):
    """The simulated drives follow after 0.125 s."""
    for lag, word in ((0.6, ""), (0.02, "degrees from where it was commanded")):
        one = cell(lag=lag)
        assert one.guard.failsafe.actuation_lag == lag
        one.stream.connect()
        reasons = {a.reason.split(" is ")[-1].split(" ", 1)[-1] for a in one.run(60)}
        assert all(word in reason for reason in reasons - {""})
        assert (reasons == {""}) == (word == "")


def test_the_arm_has_to_rest_before_anything_begins(cell):
    one = cell()
    one.stream.connect()
    one.run(80, JointVelocity([1.0, 0.0, 0.0, 1.0, 0.0, 2.0]))
    one.fake.press_estop()
    one.run(1)
    one.stream.close()
    one.fake.release_estop()
    coasts = one.fake.q_meas_deg[:6]
    one.stream.restart()
    began = np.degrees(one.guard.state.position)
    assert np.abs(began - coasts).max() > 0.1
    one.fake.tick(50)
    np.testing.assert_allclose(began, one.fake.q_meas_deg[:6], atol=0.01)


def test_an_arm_that_does_not_rest_is_not_begun_with(cell):
    one, shaken = cell(), 0.05
    tick = one.fake.sm.tick

    def shaking(*args):
        nonlocal shaken
        shaken = -shaken
        one.fake.plant.q_meas[0] += shaken
        return tick(*args)

    one.fake.sm.tick = shaking
    with pytest.raises(StreamError, match=r"does not rest: its joints have to stay within 0.01 degrees for 0.6 s"):
        one.stream.connect(timeout=2.0)
    assert one.stream.halted


def test_what_fails_to_begin_is_not_left_waiting(cell):
    one = cell(start=np.array([175.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    packets, send = [], one.link.send
    one.link.send = lambda packet: packets.append(packet[3]) or send(packet)
    with pytest.raises(ParameterError, match="outside"):
        one.stream.connect()
    assert packets[-1] == wire.encode_stop_packet()[3]
    assert wire.encode_start_packet()[3] in packets


def test_in_silence_positions_go_out_on_time(cell):
    one, times = cell(), []
    one.stream.connect()
    one.run(60)
    receive, send = one.link.receive, one.link.send

    def silence(timeout):
        one.fake.clock.advance(timeout)

    one.link.receive = silence
    one.link.send = lambda packet: times.append(one.fake.clock.now()) or send(packet)
    begun = one.fake.clock.now()
    assert {a.status for a in one.run(20)} == {Status.FAULT}
    np.testing.assert_allclose(np.array(times) - begun, DT * (np.arange(20) + 1.25), atol=1e-9)
    one.fake.clock.advance(10.4 * DT)  # the host hung: that is not made up for in a burst
    begun, times[:] = one.fake.clock.now(), []
    one.run(5)
    assert np.all(np.diff(times) > 0.7 * DT)
    one.link.receive = receive


def test_a_restart_needs_an_end(cell):
    one = cell()
    one.stream.connect()
    with pytest.raises(StreamError, match="goes on"):
        one.stream.restart()


def test_what_a_controller_would_refuse_is_refused_before(cell):
    link = UdpLink("127.0.0.1", 9)
    with pytest.raises(ParameterError, match=r"J1: jerk 3798 over 3211, J2: jerk 3408 over 2690"):
        FanucStream(Guard(), link)
    with pytest.raises(ParameterError, match=r"drives lag behind .*'actuation_lag'"):
        FanucStream(Guard(lr_mate_200id_7l("stream")), link)
    with pytest.raises(ParameterError, match="for 5 joints"):
        FanucStream(Guard(lr_mate_200id_7l("stream")), link, tables=Tables((1e9,) * 5, (1e9,) * 5, (1e9,) * 5))
    with pytest.raises(ParameterError, match="axes are for 5"):
        FanucStream(Guard(lr_mate_200id_7l("stream")), link, axes=Axes((1.0,) * 5, (0.0,) * 5))
    link.close()
    one = cell()
    slow = FanucStream(lagging(dt=0.004), one.link, clock=one.fake.clock.now)
    with pytest.raises(StreamError, match=r"ticks every 8 ms, the guard is for 0.004 s"):
        slow.connect()


def test_nobody_answers():
    link, times = UdpLink("127.0.0.1", 9), iter(np.arange(0.0, 100.0, 0.1))
    stream = FanucStream(lagging(), link, clock=lambda: float(next(times)))
    with pytest.raises(StreamError, match="does not answer"):
        stream.connect(timeout=1.0)
    with pytest.raises(StreamError, match="not been connected"):
        stream.exchange(None, nobody())
    link.close()


def test_an_arm_outside_its_limits_is_not_begun_with(cell):
    one = cell(start=np.array([175.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(ParameterError, match="outside"):
        one.stream.connect()


def test_degrees_of_the_controller():
    axes = Axes((1.0, -1.0, 1.0), (10.0, 0.0, -90.0))
    q = np.array([0.1, 0.2, 0.3])
    degrees = axes.to_degrees(q)
    assert degrees == pytest.approx([np.degrees(0.1) + 10.0, -np.degrees(0.2), np.degrees(0.3) - 90.0] + [0.0] * 6)
    np.testing.assert_allclose(axes.to_radians(degrees), q, atol=1e-15)
    for sign, offset in (((2.0,), (0.0,)), ((1.0, 1.0), (0.0,)), ((), ()), ((np.nan,), (0.0,))):
        with pytest.raises(ParameterError):
            Axes(sign, offset)


def test_people_stop_the_streamed_arm_as_any_other(cell):
    one = cell()
    one.stream.connect()
    near = jssa_gym.make_human("none").reset(np.random.default_rng(0))
    at = np.array([[0.75, 0.0, 1.3]])
    near = near._replace(
        start=at,
        end=at,
        start_velocity=0 * at,
        end_velocity=0 * at,
        radius=np.array([0.1]),
        names=("hand",),
        person=np.zeros(1, np.int64),
    )
    answers = one.run(60, JointPosition(one.guard.robot.home + 1.0), near)
    assert any("can reach" in a.reason for a in answers)
    assert all(a.override < 1.0 for a in answers)
    one.stream.close()


@pytest.mark.parametrize("measured", [False, True])
def test_people_grow_older_while_it_waits(cell, measured):
    one, seen = cell(), []
    one.stream.connect()
    ask = one.guard.tick
    one.guard.tick = lambda command, people, *rest: seen.append((people, *rest)) or ask(command, people, *rest)
    for _ in range(15):
        one.fake.clock.advance(0.002)  # what somebody does between two ticks is none of the waiting
        begun = one.fake.clock.now()
        who = runner(4.0 - 2.0 * begun)
        who = MeasuredPeople(who, 0.01) if measured else who
        assert one.stream.exchange(STILL, who).status != Status.FAULT
        told, stamp = seen[-1]
        # whenever it was measured, somebody who runs at the bound is reckoned to be where they may have come to
        assert stamp - told.age == pytest.approx(begun - 0.01 * measured)
        assert stamp > begun + 0.5 * DT
    for odd in ("old", None, [0.0]):
        answer = one.stream.exchange(STILL, MeasuredPeople(runner(1.5), odd))
        assert answer.status == Status.FAULT


def runner(x):
    """Somebody's hand at (x, 0, 1.3), that comes for the arm at 2 m/s."""
    at, velocity = np.array([[x, 0.0, 1.3]]), np.array([[-2.0, 0.0, 0.0]])
    return CapsuleSet(at, at, velocity, velocity, np.array([0.1]), ("hand",), np.zeros(1, np.int64))


def test_without_the_extra_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "airo_fanuc.testing.wire", None)
    link = UdpLink("127.0.0.1", 9)
    with pytest.raises(MissingExtraError, match=r"jssa-gym\[fanuc\]"):
        FanucStream(Guard(lr_mate_200id_7l("stream")), link)
    link.close()
