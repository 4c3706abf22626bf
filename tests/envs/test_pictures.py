"""What pictures show: all in the frame, people who let the arm be seen, goals, contacts."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jssa_gym.envs import ArmEnv, figures
from jssa_gym.envs.camera import Camera, balls_of, chosen, framing, hides
from jssa_gym.envs.drawing import Marks, goal_points, member, solids
from jssa_gym.envs.surroundings import posed
from jssa_gym.envs.view import around, episode_camera, live_camera
from jssa_gym.envs.world import World
from jssa_gym.evaluation import rollout
from jssa_gym.humans import ApproachRetreat, Body, make_human, nobody, together
from jssa_gym.policies import HoldPolicy

places = st.lists(st.tuples(*[st.floats(-3.0, 3.0)] * 3), min_size=1, max_size=12)


def person(x, y=0.0, who=0):
    return Body.facing(np.arctan2(-y, -x), who).at((x, y), (0.0, 0.0))


@pytest.mark.long
@given(
    points=places,
    radius=st.floats(0.0, 0.5),
    azimuth=st.floats(0, 360),
    elevation=st.floats(-60, 10),
    wide=st.floats(0.5, 2),
)
def test_all_balls_are_in_the_frame_and_no_more_room_than_needed(points, radius, azimuth, elevation, wide):
    points = np.array(points)
    camera = framing(points, np.full(len(points), radius), azimuth, elevation, wide)
    # any point of the balls' surfaces
    way = np.random.default_rng(0).normal(size=(200, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    spread = (points[:, None] + radius * way).reshape(-1, 3)
    seen = camera.project(spread, wide)
    assert np.all(np.abs(seen) <= 1.0)
    if np.abs(seen).max() > 0.9:  # else somebody would be behind the eye
        nearer = Camera(azimuth, elevation, 0.8 * camera.distance, camera.lookat)
        assert np.nanmax(np.abs(nearer.project(spread, wide))) > np.abs(seen).max()


@pytest.mark.gl
def test_mujoco_draws_where_the_camera_says(robot):
    """A red ball that is projected to a pixel is drawn there."""
    world = World(robot, "table", width=200, height=160)
    camera = framing(np.array([[0.3, 0.2, 1.2], [0.3, -0.9, 1.9]]), np.full(2, 0.1), 70.0, -20.0, 200 / 160)
    world.look_from(camera)
    point = np.array([0.3, -0.9, 1.9])
    marked = world.picture(robot.home, nobody(), Marks(contact=point)).astype(int)
    changed = np.abs(marked - world.picture(robot.home, nobody())).max(axis=2) > 5
    y, x = (float(np.mean(found)) for found in np.nonzero(changed))
    (across, up) = camera.project(point[None], 200 / 160)[0]
    assert (x + 0.5, y + 0.5) == pytest.approx(((across + 1.0) * 100.0, (1.0 - up) * 80.0), abs=2.0)
    world.close()


def test_who_stands_in_the_way_hides_the_arm_and_who_stands_behind_does_not():
    arm = np.array([[0.0, 0.0, 1.2], [0.3, 0.0, 1.0]])
    eye = np.array([3.0, 0.0, 1.3])
    assert hides(eye, arm, person(1.0)).sum() > 0.5
    assert hides(eye, arm, person(-1.0)).sum() == 0.0
    assert hides(eye, arm, person(1.0, 1.5)).sum() == 0.0
    assert hides(eye, arm, nobody()).shape == (0,)


def test_whoever_hides_the_arm_can_be_seen_through():
    arm = np.array([[0.0, 0.0, 1.2], [0.3, 0.0, 1.0]])
    camera = Camera(180.0, 0.0, 3.0, np.array([0.0, 0.0, 1.2]))  # looks along -x
    people = together([person(1.0, 0.0, 0), person(0.5, 1.6, 1)])
    drawn = solids(camera, arm, people, Marks(), 0.87)
    before, aside = (member(people, who) for who in (0, 1))
    assert [solid.opacity for solid in drawn] == pytest.approx(
        [0.22] * len(figures.person(before)) + [1.0] * len(figures.person(aside))
    )


def test_a_camera_is_chosen_from_where_people_do_not_hide_the_arm(robot):
    arm = posed(robot, robot.home, person(0.9))
    points, radius = balls_of([arm.robot_capsules, person(0.9)])
    camera = chosen(points, radius, [(balls_of([arm.robot_capsules])[0], person(0.9), arm.line)])
    assert hides(camera.eye, balls_of([arm.robot_capsules])[0], person(0.9)).sum() == 0.0
    # and the line between them, along x, is seen from the side
    assert abs(camera.axes[2][0]) < 0.5


def test_people_are_drawn_inside_of_their_capsules_and_have_hands():
    who = person(1.0, 0.3)
    drawn = figures.person(who)
    assert len(drawn) > 20
    assert {solid.colour for solid in drawn} >= {figures.SKIN, figures.HAIR, figures.SHOES}
    way = np.random.default_rng(0).normal(size=(200, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    for solid in drawn:
        for end in (solid.start, solid.end):
            surface = end + solid.radius * way
            bone = who.end - who.start
            share = ((surface[:, None] - who.start) * bone).sum(-1) / np.maximum((bone**2).sum(-1), 1e-12)
            near = who.start + np.clip(share, 0.0, 1.0)[..., None] * bone
            outside = (np.linalg.norm(surface[:, None] - near, axis=-1) - who.radius).min(axis=1)
            assert outside.max() < 0.07, solid  # a shoe's tip, a shoulder


def test_others_have_every_capsule_drawn_as_a_limb():
    who = person(1.0)._replace(names=("head", "chest", "right_forearm", "left_hand", "right_foot", "thing"))
    drawn = figures.person(who)
    assert len(drawn) == 6
    assert all(solid.radius < radius for solid, radius in zip(drawn, who.radius, strict=True))
    assert figures.person(nobody()) == []
    assert [solid.radius for solid in figures.shells(who)] == who.radius.tolist()


@pytest.mark.parametrize("human", ["approach_retreat", "walk_by", "pursuit", "none"])
def test_the_live_camera_has_the_arms_reach_in_its_frame(robot, human):
    camera = live_camera(robot, make_human(human), 4 / 3)
    home = balls_of([posed(robot, robot.home).robot_capsules])[0]
    assert np.all(np.abs(camera.project(home, 4 / 3)) < 1.0)
    assert np.all(
        np.abs(camera.project(robot.mount + np.array([[0.7, 0, 0.3], [-0.7, 0, 0.3], [0, 0, 1.0]]), 4 / 3)) < 1.0
    )


@pytest.fixture(scope="module")
def episode():
    """Somebody walks up to the arm until they touch; Reach has a goal."""
    env = ArmEnv("reach", human="approach_retreat", terminate_on=())
    options = {"goal": [0.5, -0.3, 1.5], "human_start": (1.5, 0.0)}
    return rollout(env, HoldPolicy(env), seed=0, steps=700, options=options, name="x")


def test_an_episodes_camera_has_arm_goal_and_people_in_the_frame(robot, episode):
    camera = episode_camera([episode], robot, 1.2)
    for k in range(0, 700, 20):
        people = around(robot, person(3.0))  # nobody is there who is far
        assert len(people.radius) == 0
        arm = posed(robot, episode.position[k]).robot_capsules
        for capsules, radius in ((arm, arm.radius),):
            for end in (capsules.start, capsules.end):
                for axis in np.vstack([np.eye(3), -np.eye(3)]):
                    assert np.all(np.abs(camera.project(end + radius[:, None] * axis, 1.2)) < 1.0)
        near = np.hypot(*episode.human_start[k, :, :2].T) < 1.5
        if near.all():
            for end in (episode.human_start[k], episode.human_end[k]):
                assert np.all(np.abs(camera.project(end, 1.2)) < 1.0)
        assert np.all(np.abs(camera.project(episode.goal[k][None], 1.2)) < 1.0)


def test_where_a_goal_is(robot):
    np.testing.assert_array_equal(goal_points(robot, np.array([0.5, 0.1, 1.2]), False), [[0.5, 0.1, 1.2]])
    assert goal_points(robot, np.array(robot.home), True) is None
    home = goal_points(robot, np.tile(robot.home, 2), False)
    tip = posed(robot, robot.home).tip[0]
    np.testing.assert_allclose(home, [tip, tip])
    assert tip[2] > robot.mount[2]


@pytest.mark.gl
@pytest.mark.parametrize(("task", "goal"), [("reach", [0.6, -0.4, 1.5]), ("track", None)])
def test_a_goal_is_seen(task, goal):
    env = gym.make("jssa_gym/Home-v0", task=task, human="none", render_mode="rgb_array", width=320, height=240)
    env.reset(seed=0, options=None if goal is None else {"goal": goal})
    base = env.unwrapped
    shown = env.render().astype(int)
    bare = base.world.picture(base.scene.robot.position, nobody()).astype(int)
    changed = np.abs(shown - bare).max(axis=2) > 40
    assert changed.sum() > 40
    green = shown[changed]
    assert np.mean(green[:, 1] > green[:, 0] + 25) > 0.5
    env.close()


@pytest.mark.gl
def test_a_contact_is_marked_in_a_picture():
    human = ApproachRetreat(nearest=(0.68, 0.68), side=(0.0, 0.0))  # up to where the arm is
    env = ArmEnv("home", human=human, render_mode="rgb_array", width=320, height=240, terminate_on=())
    env.reset(seed=0, options={"human_start": (0.9, 0.0)})
    reds = {}
    for _ in range(400):
        _, _, _, _, info = env.step(np.zeros(6))
        if info["contact"] not in reds:
            picture = env.render().astype(int)
            red = (picture[..., 0] > 140) & (picture[..., 1] < 110) & (picture[..., 2] < 110)
            reds[info["contact"]] = int(red.sum())
    assert reds[True] > 4 * max(reds[False], 10)
    env.close()


@pytest.mark.gl
def test_capsules_are_shown_on_request(robot):
    world = World(robot, "table", width=160, height=120)
    world.look_from(live_camera(robot, make_human("none"), 4 / 3))
    plain = world.picture(robot.home, person(0.8))
    truth = world.picture(robot.home, person(0.8), Marks(capsules=True))
    assert np.abs(plain.astype(int) - truth).max() > 40
    world.close()
