"""Who moves beside many arms, and how: nobody is left standing because nothing is known of them."""

import numpy as np
import pytest

from jssa_gym.envs.vector.people import Beside, OneByOne, beside
from jssa_gym.humans import HUMANS, Body, Crowd, HumanMotion, Nobody, Paced, RandomWalk, Steered


class Drifter(HumanMotion):
    """Of one's own: whoever stands there goes along x, faster with every step."""

    reacts = False
    speed_bound = 5.0

    def reset(self, rng, start=None, person=0):
        self._x, self._speed, self._body = 1.0, float(rng.uniform(0.1, 0.5)), Body.facing(0.3)
        return self._body.at((self._x, 0.0), (self._speed, 0.0))

    def step(self, dt, robot):
        self._x += self._speed * dt
        self._speed += dt
        return self._body.at((self._x, 0.0), (self._speed, 0.0))


def begun(motion, count=2):
    """People beside so many arms, and the very same alone."""
    parts = len(motion.reset(np.random.default_rng(0)).radius)
    people, alone = beside(motion, count, parts), []
    for e in range(count):
        first = people.motion_of(e).reset(np.random.default_rng(e))
        people.begin(e, first, np.random.default_rng(e))
        alone.append(first)
    return people, alone


@pytest.mark.parametrize("wrapped", [lambda one: one, lambda one: Crowd([Nobody(), one, RandomWalk()]), Paced])
def test_a_motion_of_ones_own_is_moved_by_itself(wrapped):
    """Alone, in a crowd with people that kernels move, and in slow motion."""
    people, first = begun(wrapped(Drifter()))
    assert type(people) is OneByOne
    for _ in range(3):
        people.step(np.ones(2, bool), np.full(2, 0.1), np.zeros((2, 0)), ())
    for e in range(2):
        alone = wrapped(Drifter())
        alone.reset(np.random.default_rng(e))
        for _ in range(3):
            capsules = alone.step(0.1, None)
        np.testing.assert_array_equal(people.ends[e], np.array(capsules[:4]))
        assert np.abs(people.ends[e, 0] - first[e].start).max() > 0.0


@pytest.mark.parametrize("name", HUMANS)
def test_people_of_the_package_are_not_moved_one_by_one(name):
    people, _ = begun(HUMANS[name]())
    assert not isinstance(people, OneByOne)
    assert (type(people) is Beside) == (name == "none")


def test_whoever_is_steered_is():
    assert type(begun(Steered(np.zeros((2, 2))))[0]) is OneByOne
