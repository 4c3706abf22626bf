"""Rollouts record what happened; summaries say it in numbers that can be checked by hand."""

import dataclasses
import types
import typing

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.cli.demo import paper_scene
from jssa_gym.evaluation import Summary, rollout, summarise
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import HoldPolicy
from jssa_gym.robots import JointLimits
from jssa_gym.shields.reasons import UNRECOVERABLE
from jssa_gym.types import Status, Trace

LIMITS = JointLimits(
    np.array([[-1.0, 1.0], [-2.0, 2.0]]), np.array([2.0, 4.0]), np.array([8.0, 8.0]), np.array([10.0, 20.0])
)


def tiny(**changes) -> Trace:
    """Six steps of an arm of two joints, made up."""
    values = {
        "name": "tiny",
        "dt": 0.5,
        "robot": "two joints",
        "dynamics": "kinematic",
        "task": "reach",
        "holds": False,
        "d_min": 0.15,
        "ended": "running",
        "mount": np.zeros(3),
        "initial_state": np.zeros((3, 2)),
        "initial_human": np.zeros((2, 1, 3)),
        "human_radius": np.array([0.1]),
        "human_person": np.zeros(1, np.int64),
        "human_names": ("head",),
        "plane_normal": np.zeros((0, 3)),
        "plane_offset": np.zeros(0),
        "plane_names": (),
        "time": np.array([0.5, 1.0, 1.5, 2.0, 2.5, 3.0]),
        "position": np.array([[0.0, 0.0], [0.5, 0.5], [1.0, 2.0], [1.1, 0.0], [0.0, -2.1], [0.0, 0.0]]),
        "velocity": np.array([[0.0, 0.0], [1.0, -1.0], [-1.5, 2.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]),
        "acceleration": np.zeros((6, 2)),
        "jerk": np.array([[0.0, 0.0], [5.0, -16.0], [-9.0, 2.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]),
        "nominal": np.zeros((6, 2)),
        "goal": np.zeros((6, 3)),
        "reward": np.array([1.0, -2.0, -3.0, 0.5, 0.25, 10.0]),
        "success": np.array([False, False, False, False, True, False]),
        "limit_violation": np.array([False, False, False, True, True, False]),
        "distance": np.array([0.3, 0.2, -0.01, -0.02, 0.1, 0.2]),
        "speed": np.array([-0.1, -0.4, -0.2, 0.0, 0.5, 0.2]),
        "acceleration_of_distance": np.array([0.0, 1.0, -3.0, 2.0, 0.0, 0.0]),
        "pair": np.zeros((6, 2), np.int64),
        "contact": np.array([False, False, True, True, False, False]),
        "contact_speed": np.array([0.0, 0.0, 5e-4, 2e-3, 0.0, 0.0]),
        "status": np.array([0, 1, 1, 0, 2, 0]),
        "reason": np.array(["", "rows", "outside the jerk bounds", "", "box", ""]),
        "intervened": np.array([False, True, True, False, True, False]),
        "correction": np.array([0.0, 0.5, 0.2, 0.0, 0.8, 0.0]),
        "phi": np.array([-0.1, 0.3, 0.2, -0.2, 0.1, np.nan]),
        "slack": np.array([0.0, 0.0, 0.0, 0.0, 0.4, np.nan]),
        "margin": np.full(6, np.nan),
        "kind": np.full(6, ""),
        "choice": np.full(6, -1, np.int64),
        "override": np.full(6, np.nan),
        "shield_time": np.array([np.nan, 1e-5, 2e-5, 3e-5, 4e-5, 5e-5]),
        "human_start": np.zeros((6, 1, 3)),
        "human_end": np.zeros((6, 1, 3)),
    }
    return Trace(**(values | changes))


def test_a_clip_to_less_than_the_jerk_bounds_is_more_than_a_clip():
    reason = np.array(["", "rows", UNRECOVERABLE, "", "box", ""])
    assert summarise(tiny(reason=reason), LIMITS).trigger_rate == pytest.approx(3.0 / 6.0)


def test_a_summary_by_hand():
    summary = summarise(tiny(), LIMITS)
    assert summary == Summary(
        name="tiny",
        ep_len=6,
        ep_return=6.75,
        collision=True,
        moving_contact=True,
        contact_speed=2e-3,
        n_collision_events=1,
        n_collisions_critical=1,
        n_collisions_noncritical=0,
        collision_steps=2,
        min_distance=-0.02,
        # nearer than 0.15 m in the third to the fifth step
        d_min_violation_rate=0.5,
        violation_depth=pytest.approx(0.17),
        time_in_violation=1.5,
        max_consecutive_violations=3,
        ep_cost=3.0,
        limit_violation_rate=pytest.approx(2.0 / 6.0),
        limits_exceeded=True,
        success=True,
        success_untouched=False,
        success_and_safe=False,
        time_to_goal=2.5,
        timeout=False,
        intervention_rate=0.5,
        # the third step was only clipped
        trigger_rate=pytest.approx(2.0 / 6.0),
        # the interventions led to the states at 1.0 s and 2.5 s; they began a step before
        first_trigger=0.5,
        last_trigger=2.0,
        active_duration=1.5,
        n_activations=2,
        # on, off, on, off in 3 s
        chatter=pytest.approx(4.0 / 3.0),
        correction_mean=0.5,
        correction_max=0.8,
        # of the last step the rows are not known
        infeasible_rate=0.2,
        relaxed_rate=pytest.approx(1.0 / 6.0),
        backup_rate=0.0,
        fault_rate=0.0,
        # 0 to 1, 1 to 0, 0 to 2, 2 to 0 in 3 s
        status_switches=pytest.approx(4.0 / 3.0),
        phi_max=0.3,
        phi_violation_rate=0.6,
        forward_invariance_violations=2,
        slack_mean=0.08,
        slack_max=0.4,
        n_collisions_robot_fault=None,
        n_collisions_human_fault=None,
        n_collisions_shared_fault=None,
        energy_ratio=None,
        n_collisions_self=None,
        n_collisions_static=None,
        n_actions_not_finite=0,
        min_distance_arm=None,
        # 0.3 / 0.1, 0.2 / 0.4, and in the third step they touch and approach
        ttc=0.0,
        ssm_margin=None,
        ssm_violation_rate=None,
        ssm_violation_time=None,
        false_intervention_rate=None,
        true_phi_max=None,
        true_phi_violation_rate=None,
        true_forward_invariance_violations=None,
        path_length=None,
        tracking_error=None,
        tracking_error_end=None,
        deliveries_per_minute=None,
        # (5/10)² + (16/20)² + (9/10)² + (2/20)² over 12
        jerk_rms=pytest.approx(np.sqrt((0.25 + 0.64 + 0.81 + 0.01) / 12.0)),
        # from 5 to -9 where 10 is the bound; nobody had asked for it
        jerk_jumps=0.2,
        jerk_jumps_nominal=0.0,
        jerk_jumps_shield=0.2,
        speed_limit_ratio=0.75,
        acceleration_limit_ratio=0.0,
        jerk_limit_ratio=0.9,
        position_violation_rate=pytest.approx(2.0 / 6.0),
        velocity_violation_rate=0.0,
        acceleration_violation_rate=0.0,
        jerk_violation_rate=0.0,
        mean_critical_velocity=pytest.approx(1.4 / 6.0),
        mean_critical_acceleration=1.0,
        shield_p50=3e-5,
        shield_p95=pytest.approx(4.8e-5),
        shield_p99=pytest.approx(4.96e-5),
        shield_max=5e-5,
        deadline_miss_rate=0.0,
    )


def test_a_contact_at_rest_is_a_collision_that_is_not_moving():
    summary = summarise(tiny(contact_speed=np.array([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0])), LIMITS)
    assert summary.collision
    assert not summary.moving_contact


def test_violations_in_a_row_are_not_their_sum():
    summary = summarise(tiny(distance=np.array([0.1, 0.2, 0.1, 0.1, 0.2, 0.1])), LIMITS)
    assert (summary.max_consecutive_violations, summary.ep_cost) == (2, 4.0)


def test_what_is_no_number_is_not_safe():
    trace = tiny(contact=np.zeros(6, bool), contact_speed=np.zeros(6), limit_violation=np.zeros(6, bool), d_min=0.01)
    assert not summarise(dataclasses.replace(trace, distance=np.ones(6)), LIMITS).collision
    unknown = np.where(np.arange(6) == 2, np.nan, 1.0)
    summary = summarise(dataclasses.replace(trace, distance=unknown), LIMITS)
    assert (summary.collision, summary.collision_steps, summary.n_collision_events) == (True, 1, 1)
    assert summary.success
    assert not summary.success_untouched
    assert not summary.success_and_safe
    untouched = summarise(dataclasses.replace(trace, distance=np.full(6, 0.005)), LIMITS)
    assert untouched.success_untouched
    assert not untouched.limits_exceeded
    assert not untouched.success_and_safe  # nearer than d_min
    touched = dataclasses.replace(trace, distance=np.zeros(6), contact=np.ones(6, bool), contact_speed=0.0 * unknown)
    summary = summarise(touched, LIMITS)
    assert (summary.moving_contact, summary.n_collisions_critical) == (True, 1)


def test_rows_that_nobody_knows_are_not_kept():
    # half of the episode a stored stop goes on, of which no rows are known
    slack = np.array([0.0, 1e-3, 0.0, np.nan, np.nan, np.nan])
    assert summarise(tiny(slack=slack), LIMITS).infeasible_rate == pytest.approx(1.0 / 3.0)
    # a row that is missed by who knows how much is missed
    assert summarise(tiny(slack=np.where(slack > 0.0, np.inf, slack)), LIMITS).infeasible_rate == pytest.approx(
        1.0 / 3.0
    )
    assert summarise(tiny(slack=np.full(6, np.nan)), LIMITS).infeasible_rate is None
    assert summarise(tiny(slack=np.zeros(6)), LIMITS).infeasible_rate == 0.0


def test_a_summary_without_human_shield_or_intervention():
    nothing = np.zeros(6, bool)
    summary = summarise(
        tiny(
            distance=np.full(6, np.inf),
            contact=nothing,
            contact_speed=np.zeros(6),
            intervened=nothing,
            shield_time=np.full(6, np.nan),
        ),
        LIMITS,
    )
    assert summary.min_distance == np.inf
    assert not summary.collision
    assert summary.first_trigger is summary.last_trigger is summary.shield_p50 is summary.shield_p99 is None
    assert (summary.active_duration, summary.intervention_rate, summary.n_activations) == (0.0, 0.0, 0)


def test_an_intervention_in_the_first_step_began_at_zero():
    active = np.array([True, False, True, False, False, True])
    summary = summarise(tiny(intervened=active), LIMITS)
    assert (summary.first_trigger, summary.last_trigger, summary.n_activations) == (0.0, 2.5, 3)


def test_repeated_actions_are_not_summarised():
    env = jssa_gym.ActionRepeat(gym.make("jssa_gym/Home-v0", terminate_on=()), 3)
    trace = rollout(env, lambda _: np.zeros(6), seed=0, steps=4)
    with pytest.raises(ParameterError, match="one control step apart"):
        summarise(trace, env.unwrapped.robot.limits)


def test_fields_of_a_summary_have_plain_types():
    hints = typing.get_type_hints(Summary)
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", terminate_on=()))
    for summary in (
        summarise(tiny(), LIMITS),
        summarise(rollout(env, HoldPolicy(env), seed=0, steps=30), env.unwrapped.robot.limits),
    ):
        for field in dataclasses.fields(Summary):
            allowed = hints[field.name]
            allowed = typing.get_args(allowed) if isinstance(allowed, types.UnionType) else (allowed,)
            assert type(getattr(summary, field.name)) in allowed, field.name


@pytest.fixture
def env():
    return jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human=paper_scene(0.8), terminate_on=()))


def test_a_rollout_records_what_the_environment_said(env):
    trace = rollout(env, HoldPolicy(env), seed=0, steps=400, name="run")
    assert (trace.name, trace.dt) == ("run", 0.008)
    twin = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human=paper_scene(0.8), terminate_on=()))
    policy = HoldPolicy(twin)
    observation, _ = twin.reset(seed=0)
    begun, base = twin.unwrapped.scene, twin.unwrapped
    assert (trace.robot, trace.dynamics, trace.human_names) == (base.robot.name, "kinematic", begun.human.names)
    assert trace.plane_names == ("table",)
    assert (trace.task, trace.holds, trace.d_min, trace.ended) == ("home", True, 0.05, "running")
    for ours, theirs in (
        (trace.mount, [0.0, 0.0, 0.87]),
        (trace.initial_state, [base.robot.home, np.zeros(6), np.zeros(6)]),
        (trace.initial_human, [begun.human.start, begun.human.end]),
        (trace.human_radius, begun.human.radius),
        (trace.human_person, begun.human.person),
        (trace.plane_normal, [[0.0, 0.0, 1.0]]),
        (trace.plane_offset, [0.87]),
    ):
        np.testing.assert_array_equal(ours, theirs)
    for k in range(400):
        observation, reward, _, _, info = twin.step(policy(observation))
        scene, decision, closest = twin.unwrapped.scene, twin.last_decision, twin.unwrapped.closest
        for ours, theirs in (
            (trace.time, scene.time),
            (trace.position, scene.robot.position),
            (trace.velocity, scene.robot.velocity),
            (trace.acceleration, scene.robot.acceleration),
            (trace.jerk, info["jerk"]),
            (trace.nominal, decision.nominal),
            (trace.distance, info["distance"]),
            (trace.speed, closest.rate),
            (trace.acceleration_of_distance, closest.curvature),
            (trace.pair, (closest.robot, closest.human)),
            (trace.contact, info["contact"]),
            (trace.contact_speed, info["contact_speed"]),
            (trace.status, info["shield/status"]),
            (trace.reason, info["shield/reason"]),
            (trace.intervened, info["shield/intervened"]),
            (trace.phi, info["shield/phi"]),
            (trace.slack, info["shield/slack"]),
            (trace.correction, info["shield/correction"]),
            (trace.success, info["success"]),
            (trace.limit_violation, info["limit_violation"]),
            (trace.reward, reward),
            (trace.goal, base.goal),
            (trace.human_start, scene.human.start),
            (trace.human_end, scene.human.end),
        ):
            np.testing.assert_array_equal(ours[k], theirs)
    assert trace.intervened.any()
    assert Status.PROJECTED in trace.status
    assert np.all(trace.shield_time > 0.0)
    # the distance's rate is that of the distance
    gaps = np.abs(np.diff(trace.distance) / 0.008 - trace.speed[:-1])
    assert np.median(gaps) < 1e-3
    # but where the closest pair changes within the step
    assert np.mean(gaps > 0.05) < 0.02


def test_a_rollout_without_a_shield():
    bare = gym.make("jssa_gym/Reach-v0", human="none", terminate_on=())
    trace = rollout(bare, jssa_gym.RandomPolicy(bare, 0), seed=0, steps=20)
    assert trace.position.shape == (20, 6)
    assert trace.human_start.shape == (20, 0, 3)
    assert np.isnan(trace.shield_time).all()
    assert np.isnan(trace.phi).all()
    assert not trace.intervened.any()
    assert np.all(trace.status == Status.NOMINAL)
    np.testing.assert_array_equal(trace.nominal, trace.jerk)
    assert summarise(trace, bare.unwrapped.robot.limits).min_distance == np.inf


def test_a_rollout_stops_at_the_end_of_the_episode():
    bare = gym.make("jssa_gym/Home-v0", human="none", max_episode_steps=15)
    assert len(rollout(bare, HoldPolicy(bare), seed=0, steps=100).time) == 15
    ended = gym.make("jssa_gym/Home-v0", human="none", terminate_on=("limit_violation",))
    assert len(rollout(ended, lambda _: np.ones(6), seed=0, steps=100).time) == 22


def test_options_reach_the_environment(env):
    trace = rollout(env, HoldPolicy(env), seed=0, options={"human_start": (1.5, 0.2)}, steps=1)
    np.testing.assert_allclose(trace.human_start[0, 0, :2], [1.5, 0.2], atol=0.01)


def test_a_seed_fixes_a_rollout(env):
    one, two = (rollout(env, jssa_gym.RandomPolicy(env, 1), seed=5, steps=50) for _ in range(2))
    for field in dataclasses.fields(Trace):
        if field.name != "shield_time":
            np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))


@pytest.mark.parametrize("outside", [False, True])
def test_a_rollout_gives_the_filter_back(env, outside):
    inner = env.filter
    wrapped = jssa_gym.ActionRepeat(env, 2) if outside else env
    rollout(wrapped, HoldPolicy(env), seed=0, steps=3)
    assert env.filter is inner

    def fails(observation):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rollout(wrapped, fails, seed=0, steps=3)
    assert env.filter is inner
