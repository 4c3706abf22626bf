"""What follows from a recorded episode, against other ways to find out."""

from dataclasses import replace

import numpy as np
import pytest

from jssa_gym.envs import ArmEnv
from jssa_gym.evaluation import SeparationParams, geometry, judge, rollout, summarise
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.records import STOP, records
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.policies import POLICIES
from jssa_gym.safety.proximity import measure
from jssa_gym.types import CapsuleSet, JointState, Planes

DT = 0.008


@pytest.fixture(scope="module")
def wandering():
    """A moving arm beside somebody who walks into it."""
    env = ArmEnv("reach", human="pursuit", terminate_on=())
    return rollout(env, POLICIES["wander"](env, 3), seed=3, steps=350)


def velocities(trace):
    """People's ends, from step to step."""
    start = np.diff(np.concatenate([trace.initial_human[None, 0], trace.human_start]), axis=0) / trace.dt
    end = np.diff(np.concatenate([trace.initial_human[None, 1], trace.human_end]), axis=0) / trace.dt
    return start, end


def people(trace, k, start_velocity, end_velocity):
    return CapsuleSet(
        trace.human_start[k],
        trace.human_end[k],
        start_velocity[k],
        end_velocity[k],
        trace.human_radius,
        trace.human_names,
        trace.human_person,
    )


def test_distances_and_closing_speeds_are_those_of_measure(wandering, robot):
    seen, moves = geometry(wandering, robot), velocities(wandering)
    planes = Planes(wandering.plane_normal, wandering.plane_offset, wandering.plane_names)
    assert wandering.contact.any()
    for k in range(0, 350, 7):
        state = JointState(wandering.position[k], wandering.velocity[k], wandering.acceleration[k])
        near = measure(robot, state, people(wandering, k, *moves), planes)
        assert seen.own[k] == near.own.min()
        assert seen.planes[k] == near.planes.min()
        assert near.smallest == wandering.distance[k]
        # the distance shrinks as fast as both come towards each other, unless the axes cross
        if near.smallest > 0.0:
            assert seen.approach[k] + seen.human_approach[k] == pytest.approx(-near.rate, abs=1e-9)


def test_the_tool_is_where_mujoco_has_it(wandering, robot):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    data = mujoco.MjData(model)
    tip = geometry(wandering, robot).tip
    assert tip.shape == (351, 3)
    for k, q in ((0, wandering.initial_state[0]), (1, wandering.position[0]), (350, wandering.position[349])):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(tip[k], data.site("tcp").xpos + robot.mount, atol=1e-12)


@pytest.mark.parametrize("fast", [False, True])
def test_stops_are_those_that_are_driven_tick_by_tick(wandering, robot, fast):
    if fast:
        # so fast that the braking acceleration has to be held
        rng, limits = np.random.default_rng(0), robot.limits
        velocity, acceleration = (
            rng.uniform(-1.0, 1.0, (350, 6)) * limit for limit in (limits.velocity, 0.5 * limits.acceleration)
        )
        wandering = replace(wandering, velocity=velocity, acceleration=acceleration)
    seen, moves = geometry(wandering, robot), velocities(wandering)
    limits, planes = robot.limits, Planes(np.zeros((0, 3)), np.zeros(0), ())
    bounds = np.array([*limits.position.T, limits.velocity, limits.acceleration, limits.jerk])
    plan, jerk, advanced = records(robot.n, STOP), np.zeros(robot.n), 0
    held = 0
    for k in range(0, 350, 10):
        q, v, a = (np.array(x[k]) for x in (wandering.position, wandering.velocity, wandering.acceleration))
        near = measure(robot, JointState(q, v, a), people(wandering, k, *moves), planes)
        count = plan_stop(np.array([q, v, a]), bounds, DT, plan)
        held += int(plan["hold"].max() > 0)
        assert seen.stop_time[k] == pytest.approx(count * DT)
        row = near.pair[0]
        here = capsule(robot, q, row)
        on_robot, on_human = near.points
        share = np.linalg.norm(on_robot - here[0]) / max(np.linalg.norm(here[1] - here[0]), 1e-12)
        for tick in range(count):
            stop_jerk(plan, tick, jerk)
            q, v, a = (
                q + DT * v + DT**2 / 2 * a + DT**3 / 6 * jerk,
                v + DT * a + DT**2 / 2 * jerk,
                a + DT * jerk,
            )
        assert np.abs(v).max() < 1e-9
        there = capsule(robot, q, row)
        if (gap := np.linalg.norm(on_human - on_robot)) < 1e-6:
            continue
        moved = there[0] + share * (there[1] - there[0]) - on_robot
        assert seen.stop_advance[k] == pytest.approx(max(moved @ (on_human - on_robot) / gap, 0.0), abs=1e-9)
        advanced += seen.stop_advance[k] > 0.01
    assert advanced > 3
    assert held > 20 or not fast


def capsule(robot, q, row):
    """Ends of a capsule's axis, from chained rotation matrices."""
    position, turn = np.zeros(3), np.eye(3)
    for j in range(robot.capsules[row]["link"] + 1):
        link = robot.links[j]
        position, turn = position + turn @ link["offset"], turn @ link["rotation"]
        x, y, z = link["axis"]
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = turn @ (np.eye(3) + np.sin(q[j]) * cross + (1.0 - np.cos(q[j])) * cross @ cross)
    return [position + turn @ robot.capsules[row][end] for end in ("start", "end")]


# ---- who moved into whom -----------------------------------------------------------------------------


def with_ball(trace, robot, path, radius=0.1):
    """The same arm beside a ball at ``path`` (T + 1, 3) [m]."""
    path = np.asarray(path)[:, None]
    trace = replace(
        trace,
        initial_human=np.array([path[0], path[0]]),
        human_start=path[1:],
        human_end=path[1:],
        human_radius=np.array([radius]),
        human_person=np.zeros(1, np.int64),
        human_names=("ball",),
    )
    planes = Planes(trace.plane_normal, trace.plane_offset, trace.plane_names)
    near = [
        measure(
            robot,
            JointState(trace.position[k], trace.velocity[k], trace.acceleration[k]),
            people(trace, k, *velocities(trace)),
            planes,
        )
        for k in range(len(trace.time))
    ]
    distance = np.array([one.smallest for one in near])
    speeds = np.array([one.contact_speed for one in near])
    return replace(trace, distance=distance, contact=distance <= 0.0, contact_speed=speeds)


@pytest.fixture(scope="module")
def swinging():
    """The first joint turns the arm to its left."""
    env = ArmEnv(human="none", terminate_on=())
    return rollout(env, lambda _: np.array([1.0, 0, 0, 0, 0, 0]), seed=0, steps=18)


@pytest.fixture(scope="module")
def standing():
    env = ArmEnv(human="none", terminate_on=())
    return rollout(env, lambda _: np.zeros(6), seed=0, steps=18)


@pytest.mark.parametrize(
    ("which", "speed", "fault"),
    [("swinging", 0.0, "robot"), ("standing", -0.5, "human"), ("swinging", -0.3, "shared")],
)
def test_faults_are_those_that_mujoco_finds(request, robot, which, speed, fault):
    trace = request.getfixturevalue(which)
    # beside the tool, to its left; the arm turns towards it, or it comes
    tip = geometry(trace, robot).tip[0]
    begin = tip + np.array([-0.02, 0.15 if fault != "human" else 0.2, 0.06])
    path = begin + np.arange(19)[:, None] * DT * np.array([0.0, speed, 0.0])
    trace = with_ball(trace, robot, path)
    verdict = judge(trace, robot)
    assert verdict.contacts, trace.distance
    assert {contact.fault for contact in verdict.contacts} == {fault}
    summary = summarise(trace, robot.limits, geometry(trace, robot))
    counted = {who: getattr(summary, f"n_collisions_{who}_fault") for who in ("robot", "human", "shared")}
    assert counted == {who: int(who == fault) for who in counted}
    assert summary.n_collision_events == 1
    assert summary.n_collisions_critical == int(fault != "human")
    # the commanded arm's touching points say nothing of a servoed one's contacts
    servoed = summarise(replace(trace, dynamics="servo"), robot.limits, geometry(trace, robot))
    assert {getattr(servoed, f"n_collisions_{who}_fault") for who in counted} == {None}
    # whoever calls more speed safe finds the arm less at fault
    lenient = summarise(trace, robot.limits, geometry(trace, robot), v_safe=5.0)
    assert (lenient.n_collisions_human_fault, lenient.n_collisions_noncritical) == (1, 1)


# ---- separation, path, self-collision ----------------------------------------------------------------


def test_separation_by_hand(standing, robot):
    trace = with_ball(standing, robot, np.tile([1.5, 0.0, 1.3], (19, 1)))
    seen, limits = geometry(trace, robot), robot.limits
    distance = trace.distance[0]
    # the arm rests: it needs no time to stop, and the person walks for the reaction time alone
    for params, needed in (
        (SeparationParams(), 0.16),
        (SeparationParams(human_speed=2.0, reaction_time=0.2, intrusion=0.1, uncertainty=0.05), 0.55),
        (SeparationParams(human_speed=None), 0.0),
        (SeparationParams(human_speed=1e3), 100.0),
    ):
        summary = summarise(trace, limits, seen, separation=params)
        assert summary.ssm_margin == pytest.approx(distance - needed)
        assert summary.ssm_violation_rate == float(distance < needed)
        assert summary.ssm_violation_time == pytest.approx(18 * DT * (distance < needed))
    coming = with_ball(standing, robot, [[1.5 - 0.5 * DT * k, 0.0, 1.3] for k in range(19)])
    measured = summarise(coming, limits, geometry(coming, robot), separation=SeparationParams(human_speed=None))
    towards = -np.diff(coming.distance)[-1] / DT
    assert measured.ssm_margin == pytest.approx(coming.distance[-1] - 0.1 * towards, abs=1e-4)
    assert measured.ttc is None  # made by hand: no rate was recorded
    for wrong in ({"reaction_time": -0.1}, {"human_speed": np.nan}, {"uncertainty": np.inf}):
        with pytest.raises(ParameterError, match=next(iter(wrong))):
            SeparationParams(**wrong)


def test_a_moving_arm_needs_more_separation(swinging, robot):
    trace = with_ball(swinging, robot, np.tile(geometry(swinging, robot).tip[0] + [0.0, 1.0, 0.0], (19, 1)))
    seen = geometry(trace, robot)
    assert np.all(np.diff(seen.approach) > 0.0)
    assert np.all(np.diff(seen.stop_advance) > 0.0)
    k = int(np.argmin(trace.distance))
    summary = summarise(trace, robot.limits, seen)
    needed = 1.6 * (0.1 + seen.stop_time[k]) + 0.1 * seen.approach[k] + seen.stop_advance[k]
    assert summary.ssm_margin == pytest.approx(trace.distance[k] - needed)
    path = np.linalg.norm(np.diff(seen.tip, axis=0), axis=1).sum()
    assert summary.path_length == pytest.approx(path)
    radius = np.hypot(*seen.tip[0, :2])
    assert path == pytest.approx(radius * trace.position[-1, 0], rel=1e-3)


def test_what_the_arm_does_to_itself_and_to_the_table_is_counted(standing, robot):
    limits = robot.limits
    low, high = limits.position.T
    rng, found = np.random.default_rng(0), set()
    for _ in range(300):
        posture = rng.uniform(low, high)
        near = measure(
            robot, JointState(posture, *np.zeros((2, 6))), people(standing, 0, *velocities(standing)),
            Planes(standing.plane_normal, standing.plane_offset, standing.plane_names),
        )  # fmt: skip
        kind = (bool(near.own.min() <= 0.0), bool(near.planes.min() <= 0.0))
        if kind in found:
            continue
        found.add(kind)
        position = np.array(standing.position)
        position[3:6] = posture
        trace = replace(standing, position=position)
        summary = summarise(trace, limits, geometry(trace, robot))
        assert (summary.n_collisions_self, summary.n_collisions_static) == (int(kind[0]), int(kind[1]))
    assert len(found) == 4


def test_other_robots_are_refused(standing, robot, toy_robot):
    with pytest.raises(ParameterError, match="is of the robot"):
        geometry(standing, toy_robot)
    with pytest.raises(ParameterError, match="stands at"):
        geometry(standing, robot.mounted([0.0, 0.0, 0.0]))


def test_nobody_leaves_nothing_to_close_in_on(standing, robot):
    seen = geometry(standing, robot)
    for values in (seen.approach, seen.human_approach, seen.stop_advance):
        np.testing.assert_array_equal(values, np.zeros(18))
    summary = summarise(standing, robot.limits, seen)
    assert (summary.ttc, summary.ssm_margin, summary.ssm_violation_rate) == (None, None, 0.0)
    assert (summary.mean_critical_velocity, summary.min_distance) == (None, np.inf)
