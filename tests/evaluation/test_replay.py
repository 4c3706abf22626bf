"""The second judge agrees with the environment where it is right, and finds what was planted where it is not."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.evaluation import judge, load_trace, rollout, save_trace
from jssa_gym.exceptions import ParameterError, RobotModelError
from jssa_gym.humans import ApproachRetreat
from jssa_gym.robots import JointLimits, RobotModel
from jssa_gym.safety.proximity import measure
from jssa_gym.types import CapsuleSet, JointState, Planes, Trace

DT = 0.008


def episode(robot: RobotModel, state, jerk, start, end, radius, *, planes: Planes | None = None) -> Trace:
    """An episode by hand: Eq. (1) step by step, distances from the package's kernels.

    ``state`` (3, n), ``jerk`` (T, n), ``start`` and ``end`` (T + 1, m, 3) from before the first step on.
    """
    state, jerk, start, end = (np.array(x, float) for x in (state, jerk, start, end))
    radius = np.array(radius, float)
    planes = Planes(np.zeros((0, 3)), np.zeros(0), ()) if planes is None else planes
    count, bodies = len(jerk), len(radius)
    names, person = tuple(f"part {j}" for j in range(bodies)), np.arange(bodies)
    initial, states, near = state, [], []
    for k in range(count):
        (q, v, a), u = state, jerk[k]
        state = np.array(
            [q + DT * v + DT**2 / 2 * a + DT**3 / 6 * u, v + DT * a + DT**2 / 2 * u, a + DT * u],
        )
        states.append(state)
        still = np.zeros_like(start[0])
        people = CapsuleSet(start[k + 1], end[k + 1], still, still, radius, names, person)
        near.append(measure(robot, JointState(*state), people, planes))
    distance = np.array([n.smallest for n in near])
    rows = np.array(states)
    return Trace(
        name="by hand",
        dt=DT,
        robot=robot.name,
        dynamics="kinematic",
        task="",
        holds=False,
        d_min=0.05,
        ended="running",
        mount=np.array(robot.mount),
        initial_state=initial,
        initial_human=np.array([start[0], end[0]]),
        human_radius=radius,
        human_person=person,
        human_names=names,
        plane_normal=planes.normal,
        plane_offset=planes.offset,
        plane_names=planes.names,
        time=DT * np.arange(1, count + 1),
        position=rows[:, 0],
        velocity=rows[:, 1],
        acceleration=rows[:, 2],
        jerk=jerk,
        nominal=jerk,
        goal=np.zeros((count, 0)),
        reward=np.zeros(count),
        success=np.zeros(count, bool),
        limit_violation=np.zeros(count, bool),
        distance=distance,
        speed=np.zeros(count),
        acceleration_of_distance=np.zeros(count),
        pair=np.array([n.pair for n in near]),
        contact=distance <= 0.0,
        contact_speed=np.array([n.contact_speed for n in near]),
        status=np.zeros(count, np.int64),
        reason=np.full(count, ""),
        intervened=np.zeros(count, bool),
        correction=np.full(count, np.nan),
        phi=np.full(count, np.nan),
        slack=np.full(count, np.nan),
        margin=np.full(count, np.nan),
        kind=np.full(count, ""),
        choice=np.full(count, -1, np.int64),
        override=np.full(count, np.nan),
        shield_time=np.full(count, np.nan),
        human_start=start[1:],
        human_end=end[1:],
    )


def beside(robot: RobotModel, state, ball, moves=(0.0, 0.0, 0.0), *, steps: int = 10, radius: float = 0.1) -> Trace:
    """A coasting arm beside a ball at ``ball`` [m] that moves at ``moves`` [m/s]."""
    path = np.array(ball) + np.array(moves) * DT * np.arange(steps + 1)[:, None]
    return episode(robot, state, np.zeros((steps, robot.n)), path[:, None], path[:, None], [radius])


def at_rest(robot: RobotModel, position=None) -> np.ndarray:
    return np.array([robot.home if position is None else position, np.zeros(robot.n), np.zeros(robot.n)])


def flange(robot: RobotModel) -> np.ndarray:
    """End of the last capsule's axis with the arm at home [m]."""
    return np.array([0.05 + 0.42, 0.0, 0.87 + 0.33 + 0.44 + 0.035 - 0.16])


@pytest.fixture(scope="module")
def recorded(robot) -> Trace:
    """An arm that flails about beside somebody: it collides."""
    env = gym.make("jssa_gym/Home-v0", human=ApproachRetreat(acceleration=None), terminate_on=())
    trace = rollout(env, jssa_gym.RandomPolicy(env, 0), seed=0, steps=360)
    assert trace.contact.any()
    return trace


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("human", "holds", "seed"),
    [
        ("approach_retreat", False, 1),
        ("approach_retreat", True, 0),
        ("random", False, 8),
        ("random", True, 2),
        ("constant_velocity", False, 3),
        (["random", "approach_retreat"], False, 8),
    ],
)
def test_the_judge_agrees_with_episodes_that_collide(human, holds, seed):
    env = gym.make("jssa_gym/Home-v0", human=human, terminate_on=())
    robot = env.unwrapped.robot
    reach = robot.home + np.array([0.0, 0.6, -0.3, 0.0, 0.0, 0.0])
    policy = jssa_gym.HoldPolicy(env, reach) if holds else jssa_gym.RandomPolicy(env, seed)
    trace = rollout(env, policy, seed=seed, steps=700)
    verdict = judge(trace, robot)
    assert verdict.agrees
    assert verdict.distance_error < 1e-12
    assert verdict.speed_error < 1e-9
    assert verdict.state_error < 1e-12
    assert verdict.samples == 5601
    # what the record saw at the ticks, the judge saw; in between it may have seen more
    assert trace.contact.any()
    for moment in trace.time[trace.contact]:
        assert any(c.start - 1e-9 <= moment <= c.end + 1e-9 for c in verdict.contacts)
    for contact in verdict.contacts:
        assert contact.one in robot.capsule_names
        assert contact.other in trace.human_names
    assert verdict.distance <= trace.distance.min() + 1e-12
    assert verdict.contact_speed >= trace.contact_speed.max() - 1e-9
    coarse = judge(trace, robot, substeps=1)
    assert coarse.agrees
    assert coarse.distance == pytest.approx(trace.distance.min(), abs=1e-12)
    assert coarse.contact_speed == pytest.approx(trace.contact_speed.max(), abs=1e-9)


def test_people_who_walk_into_an_arm_at_rest_are_at_fault():
    env = gym.make("jssa_gym/Home-v0", human=["random", "random"], terminate_on=())
    trace = rollout(env, jssa_gym.HoldPolicy(env), seed=0, steps=700)
    verdict = judge(trace, env.unwrapped.robot)
    assert verdict.agrees
    assert len(verdict.contacts) == 1
    (contact,) = verdict.contacts
    assert (contact.one, contact.other, contact.fault, contact.moving) == ("wrist_tool", "head", "human", False)
    assert (verdict.contact_speed, verdict.moving_contact) == (0.0, False)
    assert contact.human_approach > 0.05
    # the record's ticks lie inside of the judge's sub-steps
    first, last = trace.time[trace.contact][[0, -1]]
    assert first - DT < contact.start <= first + 1e-9
    assert last - 1e-9 <= contact.end < last + DT
    assert contact.depth >= -trace.distance.min() - 1e-12


def test_a_shielded_episode_saved_and_loaded_is_judged_alike(tmp_path):
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human="approach_retreat", scene="floor", terminate_on=()))
    trace = rollout(env, jssa_gym.HoldPolicy(env), seed=0, options={"human_start": [1.3, 0.0]}, steps=500)
    robot = env.unwrapped.robot
    verdict = judge(trace, robot)
    assert verdict.agrees
    assert trace.intervened.any()
    assert trace.mount.tolist() == [0.0, 0.0, 0.0]
    assert verdict.excess.jerk <= 1e-9
    save_trace(trace, tmp_path / "episode.npz")
    assert judge(load_trace(tmp_path / "episode.npz"), robot) == verdict


def test_a_robot_of_another_file_is_judged_too(toy_robot):
    rng = np.random.default_rng(0)
    steps = 80
    jerk = rng.uniform(-80.0, 80.0, (steps, 3))
    # capsules that turn, stretch, stand upright or upside down, or shrink to a point
    start = np.repeat(rng.uniform([-0.6, -0.6, 0.0], [0.6, 0.6, 0.3], (1, 5, 3)), steps + 1, axis=0)
    end = start + rng.uniform(-0.3, 0.3, (1, 5, 3))
    end[:, 0] = start[:, 0] + [0.0, 0.0, 0.2]
    end[:, 1] = start[:, 1] - [0.0, 0.0, 0.2]
    end[:, 2] = start[:, 2]
    end[:, 3] += 0.5 * np.sin(np.arange(steps + 1) / 10.0)[:, None]
    end[40:, 4] = start[40:, 4]
    trace = episode(toy_robot, at_rest(toy_robot, [0.3, -0.5, 0.4]), jerk, start, end, rng.uniform(0.02, 0.1, 5))
    verdict = judge(trace, toy_robot)
    assert trace.contact.any()
    assert verdict.agrees
    assert verdict.distance_error < 1e-12


def test_without_anybody_there_is_nothing_to_touch(robot):
    env = gym.make("jssa_gym/Home-v0", human="none", terminate_on=())
    trace = rollout(env, jssa_gym.RandomPolicy(env, 0), seed=0, steps=20)
    verdict = judge(trace, robot)
    assert verdict.agrees
    assert (verdict.distance, verdict.contacts, verdict.contact_speed) == (np.inf, (), 0.0)
    assert not judge(dataclasses.replace(trace, distance=np.full(20, 3.0)), robot).agrees


def test_people_far_away_are_ten_metres_away(robot):
    trace = beside(robot, at_rest(robot), [30.0, 0.0, 1.0])
    assert trace.distance.min() > 29.0
    verdict = judge(trace, robot)
    assert verdict.agrees
    assert verdict.distance == 10.0
    assert not judge(dataclasses.replace(trace, distance=np.full(10, 9.0)), robot).agrees


def changed(trace: Trace, field: str, k: int, by) -> Trace:
    values = getattr(trace, field).copy()
    values[k] = by(values[k])
    return dataclasses.replace(trace, **{field: values})


def test_a_wrong_distance_is_found(recorded, robot):
    lie = judge(changed(recorded, "distance", 300, lambda d: d + 1e-5), robot, substeps=2)
    assert not lie.agrees
    assert lie.distance_error == pytest.approx(1e-5, abs=1e-10)
    assert lie.state_error < 1e-12
    assert judge(changed(recorded, "distance", 300, lambda d: d + 1e-7), robot, substeps=2).agrees
    assert not judge(changed(recorded, "distance", 300, lambda d: d + 1e-7), robot, substeps=2, tolerance=1e-8).agrees
    assert not judge(changed(recorded, "distance", 300, lambda d: np.nan), robot, substeps=2).agrees


def test_a_teleport_is_found(recorded, robot):
    jump = np.array([0.0, 1e-3, 0.0, 0.0, 0.0, 0.0])
    lie = judge(changed(recorded, "position", 100, lambda q: q + jump), robot, substeps=2)
    assert not lie.agrees
    assert lie.state_error >= 1e-3 / (robot.limits.position[1, 1] - robot.limits.position[1, 0]) * 0.999
    assert lie.distance_error > 1e-5
    # one that the record keeps up with afterwards, so that nothing but the jump tells
    env = gym.make("jssa_gym/Home-v0", human="none", terminate_on=())
    honest = rollout(env, jssa_gym.RandomPolicy(env, 0), seed=0, steps=50)
    lie = judge(changed(honest, "position", slice(25, None), lambda q: q + jump), robot, substeps=2)
    assert not lie.agrees
    assert lie.distance_error == 0.0


@pytest.mark.parametrize("field", ["velocity", "acceleration"])
def test_a_changed_motion_is_found(recorded, robot, field):
    lie = judge(changed(recorded, field, 100, lambda x: x + 1e-4), robot, substeps=2)
    assert not lie.agrees
    assert 1e-6 < lie.state_error < 1e-4


def test_a_dropped_jerk_is_found(recorded, robot):
    lie = judge(changed(recorded, "jerk", 100, lambda u: 0.0 * u), robot, substeps=2)
    assert not lie.agrees
    assert lie.state_error > 1e-3
    assert lie.distance_error < 1e-12


def test_a_wrong_contact_is_found(recorded, robot):
    k = int(np.flatnonzero(recorded.contact)[1])
    lie = judge(changed(recorded, "contact", k, lambda _: False), robot, substeps=2)
    assert (lie.agrees, lie.contact_error) == (False, 1)
    lie = judge(changed(recorded, "contact", 0, lambda _: True), robot, substeps=2)
    assert (lie.agrees, lie.contact_error) == (False, 1)
    lie = judge(changed(recorded, "contact_speed", k, lambda v: v - 1e-4), robot, substeps=2)
    assert not lie.agrees
    assert lie.speed_error == pytest.approx(1e-4, rel=1e-6)
    assert not judge(changed(recorded, "contact_speed", 0, lambda v: 0.5), robot, substeps=2).agrees


def test_a_moved_person_is_found(recorded, robot):
    k = int(np.flatnonzero(recorded.contact)[0])
    lie = changed(changed(recorded, "human_start", k, lambda x: x + 1e-4), "human_end", k, lambda x: x + 1e-4)
    assert not judge(lie, robot, substeps=2).agrees


TABLE = Planes(np.array([[0.0, 0.0, 1.0]]), np.array([0.87]), ("table",))


def alone(robot: RobotModel, state, steps: int = 3) -> tuple[Trace, object]:
    """An arm at rest above the table, nobody near, and what the kernels measure there."""
    nobody = np.zeros((steps + 1, 0, 3))
    trace = episode(robot, state, np.zeros((steps, robot.n)), nobody, nobody, [], planes=TABLE)
    people = CapsuleSet(*[nobody[0]] * 4, np.zeros(0), (), np.zeros(0, np.int64))
    return trace, measure(robot, JointState(*state), people, TABLE)


def test_an_arm_in_the_table_is_found(robot):
    trace, near = alone(robot, at_rest(robot, [0.0, 2.0, 0.5, 0.0, 0.0, 0.0]))
    verdict = judge(trace, robot)
    inside = [robot.capsule_names[i] for i in np.flatnonzero(near.planes[:, 0] <= 0.0)]
    assert inside
    assert sorted(c.one for c in verdict.plane_collisions) == sorted(inside)
    assert {c.other for c in verdict.plane_collisions} == {"table"}
    assert max(c.depth for c in verdict.plane_collisions) == pytest.approx(-near.planes.min(), abs=1e-9)
    assert {c.start for c in verdict.plane_collisions} == {0.0}
    assert [c.end for c in verdict.plane_collisions] == pytest.approx([3 * DT] * len(inside))
    # the base's capsule reaches below the table's top, where it is bolted on
    assert alone(robot, at_rest(robot))[0].plane_names == ("table",)
    assert judge(alone(robot, at_rest(robot))[0], robot).plane_collisions == ()
    # a half-space that looks down is another one
    trace, _ = alone(robot, at_rest(robot))
    ceiling = dataclasses.replace(trace, plane_normal=-TABLE.normal, plane_offset=np.array([-1.7]))
    above = {c.one: c.depth for c in judge(ceiling, robot).plane_collisions}
    assert "wrist_tool" in above
    assert "base_column" not in above
    # the upper arm ends 1.64 m high and is 0.125 m thick
    assert above["upper_arm"] == pytest.approx(0.87 + 0.33 + 0.44 + 0.125 - 1.7)


def test_a_self_collision_is_found(robot):
    low, high = robot.limits.position.T
    poses = np.random.default_rng(0).uniform(low, high, (60, robot.n))
    trace = dataclasses.replace(alone(robot, at_rest(robot), len(poses))[0], position=poses)
    collisions, seen = judge(trace, robot, substeps=1).self_collisions, set()
    for pose, moment in zip(poses, trace.time, strict=True):
        own = alone(robot, at_rest(robot, pose), 1)[1].own
        now = [c for c in collisions if c.start - 1e-9 <= moment <= c.end + 1e-9]
        touching = {tuple(robot.capsule_names[i] for i in pair) for pair in robot.self_pairs[own <= 0.0]}
        assert {(c.one, c.other) for c in now} == touching
        assert max((c.depth for c in now), default=np.inf) >= -own.min() - 1e-12
        seen |= touching
    assert len(seen) >= 3
    assert judge(alone(robot, at_rest(robot))[0], robot).self_collisions == ()


def test_a_spinning_base_column_is_a_moving_contact(robot):
    spin = at_rest(robot)
    spin[1, 0] = 1.0
    trace = beside(robot, spin, [-0.24, 0.0, 1.0])
    verdict = judge(trace, robot)
    assert verdict.agrees
    (contact,) = verdict.contacts
    assert contact.one == "base_column"
    # its surface runs past the ball, as fast as it is far from J1's axis; it does not push
    assert contact.speed == pytest.approx(0.15, abs=0.02)
    assert contact.speed == pytest.approx(trace.contact_speed.max(), rel=1e-3)
    assert contact.moving
    assert verdict.moving_contact
    lie = dataclasses.replace(trace, contact_speed=np.zeros(10))
    assert not judge(lie, robot).agrees


def test_an_upright_column_that_spins_does_not_push(toy_robot, tmp_path):
    file = tmp_path / "column.xml"
    file.write_text(
        '<mujoco model="column"><worldbody><body><joint name="A" axis="0 0 1" range="-3 3"/>'
        '<geom type="capsule" group="3" size="0.1" fromto="0 0 0.1  0 0 0.5"/></body></worldbody></mujoco>'
    )
    column = RobotModel.from_mjcf(file, velocity=[5.0], acceleration=[5.0], jerk=[50.0])
    verdict = judge(beside(column, [[0.0], [2.0], [0.0]], [0.18, 0.0, 0.3]), column)
    assert verdict.agrees
    (contact,) = verdict.contacts
    assert contact.speed == pytest.approx(0.2, abs=1e-9)
    assert contact.depth == pytest.approx(0.02, abs=1e-9)
    assert contact.approach == pytest.approx(0.0, abs=1e-9)
    assert (contact.moving, contact.fault) == (True, "human")


@pytest.mark.parametrize(
    ("turn", "walk", "fault", "moving"),
    [
        (0.0, -1.0, "human", False),
        (0.0, 0.0, "human", False),
        (9e-4, -1.0, "human", False),
        (1.1e-3, -1.0, "shared", True),
        (1.0, 0.0, "robot", True),
        (1.0, 0.5, "robot", True),
        (1.0, -0.5, "shared", True),
        (-1.0, -2.0, "human", True),
    ],
)
def test_who_moved_into_whom(toy_robot, turn, walk, fault, moving):
    """The toy arm stretched along x turns about z against a ball at its side, 1 m/s at a lever of 1 m."""
    lever = 0.5
    state = np.array([np.zeros(3), [turn / lever, 0.0, 0.0], np.zeros(3)])
    # in the first step already inside by 1 mm
    trace = beside(toy_robot, state, [lever, 0.129, 0.1], [0.0, walk, 0.0], steps=2)
    verdict = judge(trace, toy_robot)
    assert verdict.agrees
    contact = min(verdict.contacts, key=lambda c: -c.depth)
    assert contact.one == "second"
    assert contact.fault == fault
    assert contact.moving == moving
    assert contact.approach == pytest.approx(turn, abs=0.02 * abs(turn) + 1e-9)
    assert contact.human_approach == pytest.approx(-walk, abs=0.02 * abs(walk) + 1e-9)
    assert contact.person == 0


def test_a_contact_between_two_ticks_is_seen(robot):
    tip = flange(robot)
    trace = beside(robot, at_rest(robot), tip + np.array([0.0, 0.1, 0.0]), [0.0, -25.0, 0.0], steps=1, radius=0.02)
    assert not trace.contact.any()
    verdict = judge(trace, robot)
    assert verdict.agrees
    assert len(verdict.contacts) == 1
    assert 0.0 < verdict.contacts[0].start < verdict.contacts[0].end < DT
    assert verdict.distance == pytest.approx(-0.08, abs=5e-3)
    assert judge(trace, robot, substeps=1).contacts == ()


def test_limits_are_looked_at_between_two_ticks(robot):
    fastest, steps = robot.limits.velocity, 2
    jerk = np.zeros((steps, 6))
    state = at_rest(robot)
    # joint 2 reaches its fastest in the middle of the first step
    state[1, 1], state[2, 1], jerk[0, 1] = fastest[1] * 0.999, 10.0, -10.0 / (DT / 2.0)
    nobody = np.zeros((steps + 1, 0, 3))
    trace = episode(robot, state, jerk, nobody, nobody, [])
    peak = state[1, 1] + 10.0 * DT / 4.0
    assert np.all(np.abs(trace.velocity) <= fastest)
    excess = judge(trace, robot).excess
    assert excess.velocity == pytest.approx(peak / fastest[1] - 1.0, rel=1e-9)
    assert excess.velocity > 0.0
    assert excess.jerk == pytest.approx(10.0 / (DT / 2.0) / robot.limits.jerk[1] - 1.0)
    assert excess.acceleration == pytest.approx(10.0 / robot.limits.acceleration[1] - 1.0)
    assert excess.position < 0.0


def test_a_joint_beyond_its_range_is_measured_in_ranges(robot):
    low, high = robot.limits.position.T
    for end, sign in ((high, 1.0), (low, -1.0)):
        position = robot.home.copy()
        position[3] = end[3] + sign * 0.1 * (high[3] - low[3])
        assert judge(alone(robot, at_rest(robot, position))[0], robot).excess.position == pytest.approx(0.1)


@pytest.mark.parametrize(
    "changes",
    [
        {"robot": "another"},
        {"mount": np.zeros(3)},
        {"dynamics": "servo"},
        {"initial_state": np.zeros((3, 5))},
        {"dt": 0.004},
        {"time": 2.0 * DT * np.arange(1, 361)},
        {"time": np.zeros(0)},
    ],
)
def test_what_cannot_be_judged_is_refused(recorded, robot, changes):
    with pytest.raises(ParameterError):
        judge(dataclasses.replace(recorded, **changes), robot)


@pytest.mark.parametrize("arguments", [{"substeps": 0}, {"substeps": 2.0}, {"tolerance": 0.0}, {"tolerance": np.nan}])
def test_arguments_are_checked(recorded, robot, arguments):
    with pytest.raises(ParameterError):
        judge(recorded, robot, **arguments)


def test_a_file_that_has_changed_since_is_refused(toy_robot, toy_mjcf):
    trace = beside(toy_robot, at_rest(toy_robot), [2.0, 0.0, 0.0], steps=2)
    toy_mjcf.write_text(toy_mjcf.read_text().replace('name="third" type="capsule" group="3"', 'type="capsule"'))
    with pytest.raises(RobotModelError, match="capsules"):
        judge(trace, toy_robot)


def test_tighter_limits_count(recorded, robot):
    slow = JointLimits(*(getattr(robot.limits, x) for x in ("position", "velocity", "acceleration")), np.full(6, 1.0))
    assert judge(recorded, robot.with_limits(slow), substeps=1).excess.jerk > 100.0
