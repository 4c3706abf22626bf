"""What follows from a recorded episode, against other ways to find out."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from reference import segment_distance

from jssa_gym.envs import ArmEnv
from jssa_gym.evaluation import SeparationParams, geometry, judge, rollout, summarise
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.records import STOP, records
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.policies import POLICIES
from jssa_gym.safety.index import IndexParams
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
        np.testing.assert_array_equal(seen.distance[k], near.distance)
        assert seen.arm_distance[k] == near.distance[1:].min()  # all but the base column
        # the distance shrinks as fast as both come towards each other, unless the axes cross
        if near.smallest > 0.0:
            closing = seen.approach[k] + seen.human_approach[k]
            assert closing[near.pair] == pytest.approx(-near.rate, abs=1e-9)


def test_every_pair_of_points_moves_as_differences_have_it(wandering, robot):
    seen, (start_velocity, end_velocity) = geometry(wandering, robot), velocities(wandering)
    h, radii = 1e-4, wandering.human_radius
    index, checked = IndexParams(d_min=wandering.d_min), 0
    for k in range(5, 350, 23):
        q, v, a = wandering.position[k], wandering.velocity[k], wandering.acceleration[k]
        worst = -np.inf
        for i in range(len(robot.capsules)):
            arm = [np.array(capsule(robot, q + t * v + t**2 / 2.0 * a, i)) for t in (-h, 0.0, h)]
            for j in range(len(radii)):
                person = [
                    np.array([wandering.human_start[k, j], wandering.human_end[k, j]])
                    + t * np.array([start_velocity[k, j], end_velocity[k, j]])
                    for t in (-h, 0.0, h)
                ]
                _, s, r = segment_distance(*arm[1], *person[1])
                one, other = ([x[0] + share * (x[1] - x[0]) for x in ends] for ends, share in ((arm, s), (person, r)))
                before, now, after = (np.linalg.norm(x - y) for x, y in zip(one, other, strict=True))
                distance = now - robot.capsules[i]["radius"] - radii[j]
                assert seen.distance[k, i, j] == pytest.approx(distance, abs=1e-9)
                rate, curvature = (after - before) / (2.0 * h), (after - 2.0 * now + before) / h**2
                phi = index.d_min**2 - distance * abs(distance) - index.lambda1 * rate - index.lambda2 * curvature
                worst = max(worst, phi)
                if now > 1e-3:
                    n = (other[1] - one[1]) / now
                    assert seen.approach[k, i, j] == pytest.approx((one[2] - one[0]) / (2.0 * h) @ n, abs=1e-6)
                    assert seen.human_approach[k, i, j] == pytest.approx(
                        (other[0] - other[2]) / (2.0 * h) @ n, abs=1e-6
                    )
                    checked += 1
        assert seen.phi[k] == pytest.approx(worst, abs=1e-5)
    assert checked > 300


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
    bounds = limits.bounds()
    plan, jerk, advanced = records(robot.n, STOP), np.zeros(robot.n), 0
    held = 0
    for k in range(0, 350, 10):
        q, v, a = (np.array(x[k]) for x in (wandering.position, wandering.velocity, wandering.acceleration))
        near = measure(robot, JointState(q, v, a), people(wandering, k, *moves), planes)
        count = plan_stop(np.array([q, v, a]), bounds, DT, plan)
        rows = range(len(robot.capsules))
        begin = [capsule(robot, q, i) for i in rows]
        held += int(plan["hold"].max() > 0)
        assert seen.stop_time[k] == pytest.approx(count * DT)
        for tick in range(count):
            stop_jerk(plan, tick, jerk)
            q, v, a = (
                q + DT * v + DT**2 / 2 * a + DT**3 / 6 * jerk,
                v + DT * a + DT**2 / 2 * jerk,
                a + DT * jerk,
            )
        assert np.abs(v).max() < 1e-9
        end = [capsule(robot, q, i) for i in rows]
        for i, j in np.ndindex(near.distance.shape):
            _, s, r = segment_distance(*begin[i], wandering.human_start[k, j], wandering.human_end[k, j])
            on_robot = begin[i][0] + s * (begin[i][1] - begin[i][0])
            on_human = wandering.human_start[k, j] + r * (wandering.human_end[k, j] - wandering.human_start[k, j])
            if (gap := np.linalg.norm(on_human - on_robot)) < 1e-6:
                continue
            moved = end[i][0] + s * (end[i][1] - end[i][0]) - on_robot
            assert seen.stop_advance[k, i, j] == pytest.approx(max(moved @ (on_human - on_robot) / gap, 0.0), abs=1e-7)
            advanced += seen.stop_advance[k, i, j] > 0.01
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


def margins(seen, human_speed):
    """Distance minus S_p of every pair, one after the other; else the default parameters."""
    margin = np.empty(seen.distance.shape)
    for k, i, j in np.ndindex(margin.shape):
        needed = human_speed * (0.1 + seen.stop_time[k]) + 0.1 * max(seen.approach[k, i, j], 0.0)
        margin[k, i, j] = seen.distance[k, i, j] - needed - seen.stop_advance[k, i, j]
    return margin


def test_a_farther_link_that_moves_in_needs_more_separation_than_the_closest(swinging, robot):
    # one ball close to the first link, which only turns, one farther from the tool, which comes
    tip = geometry(swinging, robot).tip[-1]
    near = with_ball(swinging, robot, np.tile([-0.4, 0.0, 1.0], (19, 1)))
    far = with_ball(swinging, robot, np.tile(tip + np.array([0.0, 0.4, 0.0]), (19, 1)))
    parts = ("initial_human", "human_start", "human_end")
    trace = replace(
        near,
        **{part: np.concatenate([getattr(near, part), getattr(far, part)], axis=-2) for part in parts},
        human_radius=np.full(2, 0.1),
        human_person=np.arange(2),
        human_names=("near", "far"),
        distance=np.minimum(near.distance, far.distance),
    )
    seen = geometry(trace, robot)
    assert (seen.distance.min(axis=1).argmin(axis=1) == 0).all()
    margin = margins(seen, 0.0)
    of_closest = margin[..., 0].min()
    assert 0.0 < margin.min() < of_closest - 0.05
    # the closest pair alone would have 1 cm left
    params = SeparationParams(human_speed=0.0, uncertainty=of_closest - 0.01)
    summary = summarise(trace, robot.limits, seen, separation=params)
    assert summary.ssm_margin == pytest.approx(margin.min() - params.uncertainty)
    broken = int((margin < params.uncertainty).any(axis=(1, 2)).sum())
    assert 0 < broken < 18
    assert summary.ssm_violation_rate == broken / 18
    assert summary.ssm_violation_time == pytest.approx(broken * DT)


def test_a_moving_arm_needs_more_separation(swinging, robot):
    trace = with_ball(swinging, robot, np.tile(geometry(swinging, robot).tip[0] + [0.0, 1.0, 0.0], (19, 1)))
    seen = geometry(trace, robot)
    last = int(seen.distance[-1, :, 0].argmin())
    assert np.all(np.diff(seen.approach[:, last, 0]) > 0.0)
    assert np.all(np.diff(seen.stop_advance[:, last, 0]) > 0.0)
    summary = summarise(trace, robot.limits, seen)
    assert summary.ssm_margin == pytest.approx(margins(seen, 1.6).min())
    path = np.linalg.norm(np.diff(seen.tip, axis=0), axis=1).sum()
    assert summary.path_length == pytest.approx(path)
    radius = np.hypot(*seen.tip[0, :2])
    assert path == pytest.approx(radius * trace.position[-1, 0], rel=1e-3)


@pytest.mark.parametrize("task", ["reach", "handover"])
def test_the_tracking_error_is_the_distance_that_the_reward_is_made_of(task):
    env = ArmEnv(task, terminate_on=())
    trace = rollout(env, POLICIES["wander"](env, 3), seed=3, steps=60)
    summary = summarise(trace, env.robot.limits, geometry(trace, env.robot))
    policy, away = POLICIES["wander"](env, 3), []
    observation, _ = env.reset(seed=3)
    for _ in range(60):
        observation, *_, info = env.step(policy(observation))
        away.append(-info[f"reward/{task}"])
    assert summary.tracking_error == pytest.approx(np.mean(away))
    assert summary.tracking_error_end == pytest.approx(away[-1])
    assert summary.tracking_error_end != pytest.approx(summary.tracking_error, rel=1e-3)
    assert summarise(trace, env.robot.limits).tracking_error is None


def test_joints_have_no_tracking_error():
    env = ArmEnv("home", terminate_on=())
    trace = rollout(env, POLICIES["wander"](env, 3), seed=3, steps=10)
    summary = summarise(trace, env.robot.limits, geometry(trace, env.robot))
    assert summary.tracking_error is summary.tracking_error_end is None


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
        assert values.shape == (18, len(robot.capsules), 0)
    summary = summarise(standing, robot.limits, seen)
    assert (summary.ttc, summary.ssm_margin, summary.ssm_violation_rate) == (None, None, 0.0)
    assert (summary.mean_critical_velocity, summary.min_distance) == (None, np.inf)
    assert summary.true_phi_max is summary.true_phi_violation_rate is summary.true_forward_invariance_violations is None
    assert summary.false_intervention_rate is None


# ---- the index, measured -----------------------------------------------------------------------------


def test_the_measured_index_is_of_all_filters_the_same(wandering, robot):
    seen = geometry(wandering, robot)
    summary = summarise(wandering, robot.limits, seen)
    above = [bool(phi > 0.0) for phi in seen.phi]
    rises = sum(after and not before for before, after in itertools.pairwise(above))
    assert 0 < sum(above) < 350
    assert rises > 0
    assert summary.true_phi_max == seen.phi.max()
    assert summary.true_phi_violation_rate == sum(above) / 350
    assert summary.true_forward_invariance_violations == rises
    # nobody filtered, so that no filter told an index
    assert summary.phi_max is None
    # what is no number is not safe
    unknown = summarise(wandering, robot.limits, seen._replace(phi=np.full(350, np.nan)))
    assert unknown.true_phi_violation_rate == 1.0
    # the commanded arm's index is not the servoed one's
    servoed = summarise(replace(wandering, dynamics="servo"), robot.limits, seen)
    assert servoed.true_phi_max is servoed.true_phi_violation_rate is None
    assert servoed.true_forward_invariance_violations is servoed.false_intervention_rate is None
    # a larger d_min, a larger index
    wider = geometry(replace(wandering, d_min=0.2), robot)
    np.testing.assert_allclose(wider.phi - seen.phi, 0.2**2 - wandering.d_min**2, atol=1e-12)
