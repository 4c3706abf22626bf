"""Somebody who is dragged: where to, how fast, and how far not."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import nobody
from jssa_gym.humans.body import NAMES
from jssa_gym.viewer.person import HANDS, Dragged, SameAs

DT = 0.008
CORE, HAND = NAMES.index("core_body"), NAMES.index("right_arm")


def begun(**arguments):
    person = Dragged(**arguments)
    person.reset(np.random.default_rng(0))
    return person


def walked(person, seconds):
    """The people after every step."""
    return [person.step(DT, nobody()) for _ in range(round(seconds / DT))]


def fastest(people):
    """Largest speed of both ends of every capsule, over some moments (6, 2) [m/s]."""
    ends = np.array([[one.start_velocity, one.end_velocity] for one in people])
    return np.linalg.norm(ends, axis=-1).max(axis=0).T


def test_it_goes_where_it_is_drawn_to_and_stands_there():
    person = begun(start=(1.6, 0.2))
    person.go((0.9, -0.4))
    people = walked(person, 3.0)
    np.testing.assert_allclose(people[-1].start[CORE, :2], (0.9, -0.4), atol=1e-6)
    assert np.all(people[-1].start_velocity == 0.0)


def test_a_hand_goes_where_it_is_drawn_to_as_far_as_the_arm_is_long_and_hangs_again():
    person = begun(start=(1.2, 0.0))
    shoulder = walked(person, 0.01)[-1].start[HAND]
    near = shoulder + np.array([-0.3, 0.05, 0.2])
    person.reach("right_arm", near)
    np.testing.assert_allclose(walked(person, 1.0)[-1].end[HAND], near, atol=1e-6)
    person.reach("right_arm", shoulder + np.array([-3.0, 0.0, 0.0]))
    far = walked(person, 1.0)[-1].end[HAND]
    np.testing.assert_allclose(far - shoulder, [-0.7, 0.0, 0.0], atol=1e-6)
    rest = begun(start=(1.2, 0.0)).step(DT, nobody()).end[HAND]
    person.lower()
    np.testing.assert_allclose(walked(person, 1.5)[-1].end[HAND], rest, atol=1e-6)


@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan])
def test_a_place_that_is_not_finite_is_no_place(bad):
    person = begun(start=(1.2, 0.0))
    person.go((1.0, 0.1))
    person.reach("right_arm", (0.9, -0.2, 1.2))
    for k in range(3):
        place = np.where(np.arange(3) == k, bad, 0.5)
        person.reach("right_arm", place)
        if k < 2:
            person.go(place[:2])
    alike = begun(start=(1.2, 0.0))
    alike.go((1.0, 0.1))
    alike.reach("right_arm", (0.9, -0.2, 1.2))
    for one, other in zip(walked(person, 1.0), walked(alike, 1.0), strict=True):
        np.testing.assert_array_equal(one.end, other.end)


@pytest.mark.long
@given(
    moves=st.lists(
        st.tuples(
            st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(0.0, 2.0), st.sampled_from([*HANDS, "", "low"])
        ),
        min_size=1,
        max_size=8,
    ),
    speed=st.floats(0.2, 3.0),
    more=st.floats(0.0, 2.0),
)
def test_clamped_it_is_never_faster_whatever_the_mouse_does(moves, speed, more):
    person = begun(speed=speed, limb_speed=speed + more)
    people = [person.reset(np.random.default_rng(0))]
    for x, y, z, part in moves:
        if part in HANDS:
            person.reach(part, (x, y, z))
        elif part:
            person.lower()
        else:
            person.go((x, y))
        people += walked(person, 0.15)
    bounds = np.array([person.end_speeds_of(name) for name in NAMES])
    assert np.all(fastest(people) <= bounds * (1.0 + 1e-9))
    for before, after in pairwise(people):
        # what a velocity says is what comes
        np.testing.assert_allclose(after.start, before.start + DT * before.start_velocity, atol=1e-12)
        np.testing.assert_allclose(after.end, before.end + DT * before.end_velocity, atol=1e-12)
        assert np.hypot(*after.start[CORE, :2]) > 0.39


def test_it_goes_around_the_robots_foot():
    person = begun(start=(1.0, 0.0))
    person.go((-1.0, 0.05))
    people = walked(person, 6.0)
    assert min(np.hypot(*one.start[CORE, :2]) for one in people) > 0.39
    np.testing.assert_allclose(people[-1].start[CORE, :2], (-1.0, 0.05), atol=1e-3)


@pytest.mark.parametrize("aside", [0.3999, 0.3997, 0.3995, 0.3993, 0.399])
def test_along_the_foot_it_is_no_faster_either(aside):
    person = begun(start=(-1.2, aside))
    person.go((1.2, aside))  # grazes the circle that is kept free: to be pushed out adds to the way
    assert fastest(walked(person, 2.4))[CORE, 0] <= 1.6 * (1.0 + 1e-9)


def test_not_clamped_it_is_where_the_mouse_is_and_its_velocity_says_how_fast():
    person = begun(start=(2.0, 0.0))
    person.clamped = False
    person.go((1.0, 0.0))
    people = walked(person, 0.4)
    np.testing.assert_allclose(people[-1].start[CORE, 0], 1.0, atol=0.01)
    assert fastest(people)[CORE, 0] > 5.0
    person.clamped = True
    assert fastest(walked(person, 0.2))[CORE, 0] <= 1.6


def test_a_new_episode_begins_where_the_last_one_ended():
    person = begun()
    person.go((0.9, 0.5))
    walked(person, 3.0)
    np.testing.assert_allclose(person.reset(np.random.default_rng(1)).start[CORE, :2], (0.9, 0.5), atol=1e-6)


def test_nobody_is_drawn_out_of_sight():
    person = begun()
    person.go((1e6, 0.0))
    assert np.hypot(*walked(person, 10.0)[-1].start[CORE, :2]) < 6.1


@pytest.mark.parametrize("arguments", [{"speed": 0.0}, {"limb_speed": np.nan}, {"start": (1.0,)}])
def test_what_makes_no_sense_is_refused(arguments):
    with pytest.raises(ParameterError):
        Dragged(**arguments)


def test_people_beside_another_arm_are_the_same():
    person = begun()
    now = [person.step(DT, nobody())]
    beside = SameAs(person, lambda: now[-1])
    assert beside.reset(np.random.default_rng(0)) is now[0]
    now.append(person.step(DT, nobody()))
    assert beside.step(DT, nobody()) is now[1]
    assert beside.end_speeds_of("right_arm") == person.end_speeds_of("right_arm")
