"""From commands to jerk: what is followed how closely, against textbook numpy."""

import numpy as np
import pytest

from jssa_gym.control import (
    Follower,
    JointJerk,
    JointPosition,
    JointVelocity,
    ResolvedRates,
    TipVelocity,
    ToolPose,
    Twist,
)
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels import cascade
from jssa_gym.kernels.chain import pose
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.types import JointState

DT = 0.008


def rotation(axis, angle):
    """Rodrigues' formula."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def tool(robot, position):
    """Where the tool centre point is and how the last link is turned."""
    frames = records(robot.n, FRAME)
    pose(np.array(robot.links), np.array(position, float), frames)
    frame = frames[robot.tool_link]
    return frame["origin"] + frame["rotation"] @ robot.tool_offset, frames[-1]["rotation"].copy()


def play(robot, command, seconds, dt=DT, state=None, share=1.0):
    """The states that an arm gets into that follows a command without a shield, shape (T, 3, n)."""
    follower = Follower(robot, dt, share)
    state = np.array([robot.home, np.zeros(6), np.zeros(6)]) if state is None else state
    jerk, states = np.empty(6), []
    for k in range(round(seconds / dt)):
        now = command(k, state) if callable(command) else command
        assert follower.jerk(now, state, jerk) == ""
        integrate(state, jerk.copy(), dt, state)
        states.append(state.copy())
    return np.array(states)


@pytest.mark.parametrize("dt", [0.001, 0.008, 0.02])
@pytest.mark.parametrize("way", [0.002, 0.1, 1.0])
def test_a_lasting_position_is_reached_without_swinging_over(robot, way, dt):
    goal = robot.home + way * np.array([1.0, -0.3, 0.3, 1.0, 1.0, 1.0])
    states = play(robot, JointPosition(goal), 4.0, dt)
    over = (states[:, 0] - goal) * np.sign(goal - robot.home)
    assert over.max() < 0.03 * way + 1e-6
    np.testing.assert_allclose(states[-1, 0], goal, atol=1e-6)
    assert np.all(np.abs(states[:, 1]) <= 1.001 * robot.limits.velocity)


def test_a_stream_is_followed_as_closely_as_is_said(robot):
    w, size = 2.0, 0.4
    t = (np.arange(400) + 1) * DT

    def at(k, full):
        q = robot.home + size * (1.0 - np.cos(w * t[k])) * np.ones(6)
        if not full:
            return JointPosition(q)
        v, a = size * w * np.sin(w * t[k]), size * w**2 * np.cos(w * t[k])
        return JointPosition(q, np.full(6, v), np.full(6, a))

    wanted = robot.home + size * (1.0 - np.cos(w * t))[:, None]
    off = {full: np.abs(play(robot, lambda k, _, f=full: at(k, f), 3.2)[:, 0] - wanted)[60:].max() for full in (0, 1)}
    assert off[0] < size * w**2 / 300.0 + 1e-3  # acceleration over kv kp
    assert off[1] < 3e-4


def test_without_the_velocity_of_a_stream_it_lags(robot):
    speed = 0.5

    def ramp(k, _):
        return JointPosition(robot.home + speed * DT * (k + 1), velocity=np.zeros(6))

    lag = robot.home + speed * 2.4 - play(robot, ramp, 2.4)[-1, 0]
    assert np.all((0.9 * speed / 10.0 < lag) & (lag < 1.5 * speed / 10.0))  # over kp, and more where jerk is short
    following = play(robot, lambda k, _: JointPosition(robot.home + speed * DT * (k + 1)), 2.4)[-1, 0]
    np.testing.assert_allclose(following, robot.home + speed * 2.4, atol=1e-6)


def test_a_jump_is_no_stream(robot):
    follower, jerk = Follower(robot, DT), np.empty(6)
    still = np.array([robot.home, np.zeros(6), np.zeros(6)])
    assert not follower.jerk(JointPosition(robot.home), still, jerk)
    np.testing.assert_array_equal(jerk, 0.0)
    far = JointPosition(robot.home + 0.5)
    follower.jerk(far, still, jerk)
    one = jerk.copy()
    follower.forget()
    follower.jerk(far, still, jerk)
    np.testing.assert_array_equal(jerk, one)
    near = JointPosition(robot.home + 1e-4)
    follower.forget()
    follower.jerk(near, still, jerk)
    one = jerk.copy()
    follower.forget()
    follower.jerk(JointPosition(robot.home), still, jerk)
    follower.jerk(near, still, jerk)  # the second of a stream: on the move already
    assert np.all(jerk > one)


def test_velocities_are_reached_and_kept_to_the_share(robot):
    wanted = np.array([0.5, -0.4, 0.2, 1.0, -1.0, 2.0])
    states = play(robot, JointVelocity(wanted), 1.0)
    np.testing.assert_allclose(states[-1, 1], wanted, atol=1e-6)
    fast = play(robot, JointVelocity(1e9 * np.ones(6)), 2.0, share=0.25)
    np.testing.assert_allclose(fast[-1, 1], 0.25 * robot.limits.velocity, rtol=1e-6)
    assert np.all(np.abs(fast[:, 2]) <= 0.2501 * robot.limits.acceleration)


def test_a_jerk_is_taken_as_it_is(robot):
    follower, jerk = Follower(robot, DT), np.empty(6)
    wanted = np.array([1.0, -2.0, 3e9, 4.0, 5.0, 6.0])
    follower.jerk(JointJerk(wanted.tolist()), np.zeros((3, 6)), jerk)
    np.testing.assert_array_equal(jerk, wanted)


def test_the_tip_moves_as_commanded(robot):
    wanted = np.array([0.05, 0.1, -0.1])
    states = play(robot, TipVelocity(wanted), 0.8)
    rates = ResolvedRates(robot)
    rates.look(JointState(*states[-1]))
    moved = rates.look(JointState(*states[-1]))[1]
    np.testing.assert_allclose(moved, wanted, atol=0.01)


def test_a_twist_moves_and_turns_the_tool(robot):
    linear, angular = np.array([0.05, 0.02, 0.05]), np.array([0.1, -0.2, 0.3])
    states = play(robot, Twist(linear, angular), 0.8)
    (before, turned), (after, now) = tool(robot, states[-11, 0]), tool(robot, states[-1, 0])
    np.testing.assert_allclose((after - before) / (10 * DT), linear, atol=0.01)
    out = np.empty(3)
    cascade.turn_between(turned, now, out)
    np.testing.assert_allclose(out / (10 * DT), angular, atol=0.03)


def test_too_fast_a_twist_is_slowed_down_as_a_whole(robot):
    J, out = np.empty((6, 6)), np.empty(6)
    frames, at = records(6, FRAME), np.zeros((2, 3))
    state = np.array([robot.home, np.zeros(6), np.zeros(6)])
    cascade.look(np.array(robot.links), robot.tool_link, np.array(robot.tool_offset), state, frames, at, J)
    twist = np.array([3.0, -2.0, 1.0, 0.5, 1.0, -4.0])
    wanted = J.T @ np.linalg.solve(J @ J.T + 0.05**2 * np.eye(6), twist)
    cascade.resolve(J, twist.copy(), 0.05, np.full(6, 1e9), np.empty((6, 6)), out)
    np.testing.assert_allclose(out, wanted, rtol=1e-9)
    fastest = np.array(robot.limits.velocity) / 10.0
    cascade.resolve(J, twist.copy(), 0.05, fastest, np.empty((6, 6)), out)
    np.testing.assert_allclose(out, wanted / np.abs(wanted / fastest).max(), rtol=1e-9)


def test_the_jacobian_of_the_turn_is_that_of_finite_differences(robot):
    rng, J, frames, at = np.random.default_rng(0), np.empty((6, 6)), records(6, FRAME), np.zeros((2, 3))
    out = np.empty(3)
    for _ in range(5):
        q, dq = robot.home + rng.uniform(-0.5, 0.5, 6), 1e-6 * rng.normal(size=6)
        cascade.look(
            np.array(robot.links), robot.tool_link, np.array(robot.tool_offset), np.array([q, q, q]), frames, at, J
        )
        cascade.turn_between(tool(robot, q - dq)[1], tool(robot, q + dq)[1], out)
        np.testing.assert_allclose(J[3:] @ (2.0 * dq), out, atol=1e-11)
        np.testing.assert_allclose(J[:3] @ (2.0 * dq), tool(robot, q + dq)[0] - tool(robot, q - dq)[0], atol=1e-11)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-5, 0.5, 2.0, np.pi - 1e-4, np.pi - 1e-10, np.pi])
def test_the_turn_between_orientations(angle):
    rng, out = np.random.default_rng(3), np.empty(3)
    for axis in ([1.0, 0.0, 0.0], [0.0, 0.0, -1.0], *rng.normal(size=(5, 3))):
        first = rotation(rng.normal(size=3), 1.0)
        then = rotation(axis, angle) @ first
        cascade.turn_between(first, then, out)
        assert np.linalg.norm(out) == pytest.approx(angle, abs=1e-7)
        size = np.linalg.norm(out)
        np.testing.assert_allclose(rotation(out, size) @ first if size else first, then, atol=1e-6)


def test_a_pose_is_reached_and_kept(robot):
    place, turned = tool(robot, robot.home + np.array([0.4, 0.2, -0.2, 0.3, 0.4, -0.5]))
    states = play(robot, ToolPose(place, turned), 5.0)
    there, now = tool(robot, states[-1, 0])
    out = np.empty(3)
    cascade.turn_between(now, turned, out)
    assert np.linalg.norm(there - place) < 1e-4
    assert np.linalg.norm(out) < 1e-3
    tips = np.array([tool(robot, q)[0] for q in states[:, 0]])
    assert np.linalg.norm(np.diff(tips, axis=0), axis=1).max() <= 1.1 * 0.5 * DT


@pytest.mark.parametrize(("dt", "share"), [(0.0, 1.0), (np.nan, 1.0), (DT, 0.0), (DT, 1.1), (DT, "half")])
def test_what_it_cannot_be_made_with(robot, dt, share):
    with pytest.raises(ParameterError):
        Follower(robot, dt, share)
