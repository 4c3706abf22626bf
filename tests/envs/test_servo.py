"""The servoed arm: how well it follows, how it is judged, and what the shield has to be told of it."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from places import DOCS

import jssa_gym
from jssa_gym.control import plan_brake, plan_move
from jssa_gym.envs import ArmEnv
from jssa_gym.envs.surroundings import OVER_POSITION, OVER_VELOCITY, Surroundings
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import Hand, Pursuit, nobody
from jssa_gym.policies import POLICIES
from jssa_gym.safety.tracking import measure_tracking, tracking_error_metres
from jssa_gym.types import JointState

DT = 0.008
MEASURED = {"actuation_lag": 0.06, "tracking_error": 0.0142}
"""Of the shipped gains, with a reserve of one half: benchmarks/servo_residual.py."""


AT_ONCE = {"hand": lambda: Hand(acceleration=None), "pursuit": lambda: Pursuit(acceleration=None)}
"""People whose velocity changes at once."""


def play(human, policy, seed, steps=400, **failsafe):
    """Errors [rad] and contact speeds [m/s] of an episode under the shield, beside people who turn at once."""
    people = "none" if human == "none" else AT_ONCE[human]()
    env = jssa_gym.JSSAShield(
        gym.make("jssa_gym/Home-v0", human=people, dynamics="servo", terminate_on=()),
        failsafe=jssa_gym.FailsafeParams(**failsafe),
    )
    act = POLICIES[policy](env, seed)
    observation, _ = env.reset(seed=seed)
    errors, contact = [], []
    for _ in range(steps):
        observation, _, _, _, info = env.step(act(observation))
        errors.append(info["tracking_error"])
        contact.append(info["contact_speed"])
        assert not info["limit_violation"]
    return np.array(errors), np.array(contact)


def test_the_arm_does_not_run_ahead_of_its_command():
    """References of the end of a millisecond at its beginning put it ahead: by 17 mrad at 17 rad/s."""
    env = ArmEnv("home", dynamics="servo", human="none", terminate_on=())
    limits, turn = env.robot.limits, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 6.0])
    env.reset(seed=0, options={"joint_position": env.robot.home - turn})
    move = plan_move(env.robot.home - turn, env.robot.home + turn, limits, DT)
    assert np.abs(move.states[:, 1, 5]).max() > 16.0
    errors = np.array([env.step(jerk / limits.jerk)[4]["tracking_error"] for jerk in move.jerk])
    assert np.abs(errors[:, 5]).max() < 2e-3


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("human", "policy", "seed"), [("none", "bang_bang", 0), ("none", "random", 3), ("hand", "jpc", 1)]
)
def test_the_residual_is_what_the_guarantees_state(robot, human, policy, seed):
    """Measured over ten seeds of every pair: 4.4 mrad, 9.6 mm."""
    errors, _ = play(human, policy, seed)
    assert 1e-5 < np.abs(errors).max() < 6e-3
    assert tracking_error_metres(robot, errors) < 12e-3


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("human", "policy", "seed"), [("hand", "bang_bang", 1), ("pursuit", "jpc", 0), ("pursuit", "bang_bang", 0)]
)
def test_nobody_is_touched_in_motion_under_what_was_measured(human, policy, seed):
    """By default somebody is, at some millimetres a second: the simulated arm swings when the commanded one rests."""
    _, contact = play(human, policy, seed)
    assert 1e-3 < contact.max() < 8e-3
    _, contact = play(human, policy, seed, **MEASURED)
    assert contact.max() < 1e-3


def test_what_was_measured_is_what_the_guarantees_state():
    lag, error = MEASURED["actuation_lag"], 1e3 * MEASURED["tracking_error"]
    guarantees = (DOCS / "guarantees.md").read_text(encoding="utf-8")
    assert f"`actuation_lag` {lag:g} s, `tracking_error` {error:g} mm |" in guarantees


# ---- what moves is judged ------------------------------------------------------------------------------


def weak(toy_mjcf):
    """The toy arm with servos that are too weak: it goes on swinging when the command has stopped."""
    servos = "".join(f'<position joint="{joint}" kp="30" kv="0.5"/>' for joint in "ABC")
    toy_mjcf.write_text(toy_mjcf.read_text().replace("</mujoco>", f"<actuator>{servos}</actuator></mujoco>"))
    return toy_mjcf


def violations(toy_mjcf, dynamics, goal):
    env = ArmEnv("home", dynamics=dynamics, human="none", robot=toy_mjcf, terminate_on=())
    env.reset(seed=0)
    limits = env.robot.limits
    move = plan_move(env.robot.home, env.robot.home + goal, limits, DT)
    return np.array([env.step(jerk / limits.jerk)[4]["limit_violation"] for jerk in move.jerk])


def test_limits_are_those_of_what_moves(toy_mjcf):
    """The command keeps them all; the arm that follows it does not, and the environment says so."""
    weak(toy_mjcf)
    for goal in ([2.0, 0.0, 0.0], [0.0, 0.0, 2.9]):
        assert not violations(toy_mjcf, "kinematic", np.array(goal)).any()
        assert violations(toy_mjcf, "servo", np.array(goal)).any()
    assert not violations(toy_mjcf, "servo", np.array([0.1, 0.1, 0.0])).any()


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_servos_may_swing_over_by_what_is_stated(robot, share):
    around, limits = Surroundings(robot, 0), robot.limits
    around.take(nobody())
    over = np.zeros((2, 3, robot.n))
    over[:, 0] = robot.home
    over[0, 0, 2] = limits.position[2, 1] + share * OVER_POSITION
    over[1, 1, 3] = -(1.0 + share * OVER_VELOCITY) * limits.velocity[3]
    for state in over:
        state[2] = 10.0 * limits.acceleration  # what rings is not judged by it
        assert around.look(state)[2] == (share > 1.0)
    assert around.look(np.full((3, robot.n), np.nan))[2]


# ---- from radians to metres, from a log to assumptions -------------------------------------------------


def ends(model, data, position):
    """Both ends of every capsule's axis, MuJoCo's, shape (2 m, 3) [m]."""
    data.qpos[:] = position
    mujoco.mj_kinematics(model, data)
    ids = np.flatnonzero(model.geom_group == 3)
    along = data.geom_xmat[ids].reshape(-1, 3, 3)[:, :, 2] * model.geom_size[ids, 1:2]
    return np.concatenate([data.geom_xpos[ids] + along, data.geom_xpos[ids] - along])


def test_metres_bound_what_mujoco_finds(robot):
    """In no posture is a capsule's end farther off; and the worst is a good part of the bound."""
    rng = np.random.default_rng(0)
    model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    data, low_high = mujoco.MjData(model), robot.limits.position.T
    share = 0.0
    for _ in range(400):
        error = rng.normal(size=robot.n) * 10.0 ** rng.uniform(-4.0, 0.0) * (rng.random(robot.n) < 0.5)
        position = rng.uniform(*low_high)
        off = np.linalg.norm(ends(model, data, position + error) - ends(model, data, position), axis=1).max()
        bound = tracking_error_metres(robot, error)
        assert off <= bound + 1e-12
        share = max(share, off / max(bound, 1e-12))
    assert share > 0.8
    both = np.array([0.001 * np.ones(6), np.zeros(6)])
    assert tracking_error_metres(robot, both) == tracking_error_metres(robot, -both[0]) > 0.0
    assert tracking_error_metres(robot, np.zeros((0, 6))) == 0.0


def a_log(robot):
    """Commanded joint positions of a move that is stopped halfway, rests and goes on."""
    limits = robot.limits
    move = plan_move(robot.home, robot.home + 0.4, limits, DT)
    stop = plan_brake(JointState(*move.states[len(move) // 2]), limits, DT)
    rest = np.repeat(stop.states[-1:, 0], 40, axis=0)
    on = plan_move(rest[-1], robot.home, limits, DT)
    parts = (move.states[: len(move) // 2, 0], stop.states[:, 0], rest, on.states[:, 0])
    return np.concatenate([*parts, np.repeat(on.states[-1:, 0], 40, axis=0)])


@pytest.mark.parametrize("ticks", [0.0, 1.0, 2.5, 7.125])
def test_a_lag_is_found(robot, ticks):
    """Also between ticks; and after it nothing is left to explain."""
    command = a_log(robot)
    time = np.arange(len(command))
    late = np.maximum(time - ticks, 0.0)
    actual = (
        np.array([np.interp(late, time, joint) for joint in command.T]).T if ticks % 1 else command[late.astype(int)]
    )
    found = measure_tracking(robot, command, actual, DT)
    assert found.lag == pytest.approx(ticks * DT, abs=1e-9)
    assert found.tracking_error < (1e-3 if ticks % 1 else 1e-9)  # a straight line between ticks is none of Eq. (1)
    assert ticks * DT - 2.5 * DT <= found.settling <= (ticks + 1.0) * DT
    assert found.actuation_lag == max(found.lag, found.settling)


def test_an_offset_is_an_error_and_an_echo_takes_time_to_settle(robot):
    command = a_log(robot)
    offset = np.array([0.0, 2e-3, 0.0, -1e-3, 0.0, 0.0])
    found = measure_tracking(robot, command, command + offset, DT)
    assert found.lag == 0.0
    assert found.tracking_error == pytest.approx(tracking_error_metres(robot, offset), rel=1e-9)
    assert found.settling == 0.0
    # thirteen ticks after the command has come to rest, the arm twitches
    rests = np.flatnonzero(np.abs(np.diff(command, axis=0)).max(axis=1) < 1e-9)[0]
    actual = command.copy()
    actual[rests + 13, 4] += 1e-3
    assert measure_tracking(robot, command, actual, DT).settling == pytest.approx(14 * DT)
    assert measure_tracking(robot, command, actual, DT, still=1.0).settling == 0.0


def test_assumptions_from_a_log(robot):
    found = measure_tracking(robot, a_log(robot), a_log(robot) + 1e-3, DT)
    assumed = jssa_gym.FailsafeParams(actuation_lag=found.actuation_lag, tracking_error=found.tracking_error)
    assert assumed.tracking_error == found.tracking_error > 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: (c[:, :5], c), "commanded has to be angles of the joints"),
        (lambda c: (c, c[1:]), "actual has to be joint positions"),
        (lambda c: (c, np.where(c == c[3, 2], np.nan, c)), "actual has to be joint positions"),
        (lambda c: (c[:3], c[:3]), "at least four ticks"),
        (lambda c: (c[:10], c[:10]), "never comes to rest"),
        (lambda c: (np.repeat(c[:1], 50, axis=0),) * 2, "never comes to rest"),
    ],
)
def test_logs_that_say_nothing_are_refused(robot, change, message):
    with pytest.raises(ParameterError, match=message):
        measure_tracking(robot, *change(a_log(robot)), DT)


@pytest.mark.parametrize("error", [np.zeros(5), np.full(6, np.nan), np.zeros((2, 2, 6)), "none"])
def test_errors_that_are_none_are_refused(robot, error):
    with pytest.raises(ParameterError, match="error has to be angles"):
        tracking_error_metres(robot, error)
