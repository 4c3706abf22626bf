"""Alternatives offered to the shields of many arms: for each what a shield of its own does with them, bit for bit."""

import gymnasium as gym
import numpy as np
import pytest

from jssa_gym.envs import ArmEnv
from jssa_gym.shields import Shield
from jssa_gym.types import Status

NAMES = ["none", "stop", "ssm", "jssa", "jssa+stop", "work", "yield"]

SAID = ("choice", "override", "status", "margin", "correction", "phi", "slack", "reason_code", "intervened")


class Some:
    """Paths of three arms of which the second has none; one that fails if it is told to."""

    def __init__(self, jerks, fails=""):
        self.jerks, self.fails, self.told, self.margins = jerks, fails, [], []
        self.override = np.array([0.5, 1.0, 0.7])

    def alternatives(self, state, margin, asked):
        assert state.shape == (3, 3, 6)
        self.margins.append(margin)
        if self.fails == "alternatives":
            raise RuntimeError("no idea")
        return self.jerks, np.array([self.jerks.shape[1], 0, self.jerks.shape[1] - 1])

    def took(self, choice, asked):
        self.told.append(choice)
        if self.fails == "took":
            raise RuntimeError("no idea")


class One:
    """The path of one of them."""

    def __init__(self, jerks, override):
        self.jerks, self.override, self.told, self.margins = jerks, override, [], []

    def alternatives(self, state, margin):
        self.margins.append(margin)
        return self.jerks

    def took(self, choice):
        self.told.append(choice)


class Pair:
    """Three arms at the task Home in one vector, and by themselves."""

    def __init__(self, name, human="pursuit"):
        self.vector = gym.make_vec(
            "jssa_gym/Home-v0", 3, shield=name, human=human, terminate_on=(), autoreset_mode="SameStep"
        )
        self.alone = [Shield(ArmEnv("home", human=human, terminate_on=()), name) for _ in range(3)]
        self.vector.reset(seed=1)
        for e, env in enumerate(self.alone):
            env.reset(seed=1 + e)
        self.bound = np.array(self.alone[0].unwrapped.robot.limits.jerk)

    def step(self, actions):
        """The infos of the single ones, after they were compared."""
        *_, infos = self.vector.step(actions)
        kinds, told = self.vector.kinds(), []
        for e, env in enumerate(self.alone):
            *_, info = env.step(actions[e])
            for key in SAID:
                np.testing.assert_array_equal(infos[f"shield/{key}"][e], info[f"shield/{key}"], err_msg=key)
            np.testing.assert_array_equal(infos["jerk"][e], info["jerk"])
            assert (kinds[e], self.vector.reasons()[e]) == (info["shield/kind"], info["shield/reason"])
            told.append(info)
        return told


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", NAMES)
def test_what_is_offered_is_taken_as_by_one(name) -> None:
    pair, rng, seen = Pair(name), np.random.default_rng(0), set()
    for k in range(120):
        actions = rng.uniform(-0.3, 0.3, (3, 6)) if k % 3 else np.zeros((3, 6))
        jerks = rng.uniform(-0.4, 0.4, (3, 4, 6)) * pair.bound
        jerks[:, 3] = actions * pair.bound  # which may be applied though it was passed over
        if k % 5 == 0:
            jerks[:, 0] = np.nan
        if k % 7 == 0:
            jerks[1, 1] = 2.0 * pair.bound
        if k % 4:
            pair.vector.offer(jerks)
            for e, env in enumerate(pair.alone):
                env.offer(jerks[e])
        seen |= {(info["shield/choice"], info["shield/kind"]) for info in pair.step(actions)}
    assert {(0, "alternative"), (1, "alternative"), (-1, "nominal")} <= seen
    assert name == "none" or len(seen) > 3


@pytest.mark.parametrize("name", ["none", "stop", "work"])
def test_paths_are_asked_and_told(name) -> None:
    pair = Pair(name, human="none")
    jerks = np.array([1.5, 0.3, -0.2])[None, :, None] * np.ones((3, 1, 6)) * pair.bound
    many, singles = Some(jerks), {0: One(jerks[0], 0.5), 2: One(jerks[2, :2], 0.7)}
    for _ in range(3):
        pair.vector.offer(many)
        for e, path in singles.items():
            pair.alone[e].offer(path)
        infos = pair.step(np.zeros((3, 6)))
    assert [info["shield/choice"] for info in infos] == [1, -1, 1]
    assert [info["shield/override"] for info in infos] == [0.5, 1.0, 0.7]
    for e, path in singles.items():
        assert [choice[e] for choice in many.told] == path.told
        np.testing.assert_array_equal([margin[e] for margin in many.margins], path.margins)
    infos = pair.step(np.zeros((3, 6)))  # an offer is for one step
    assert [info["shield/choice"] for info in infos] == [-1, -1, -1]


@pytest.mark.parametrize("fails", ["alternatives", "took", "shape", "type"])
def test_paths_that_fail_are_none(fails, caplog) -> None:
    pair = Pair("stop", human="none")
    jerks = 0.3 * np.ones((3, 2, 6)) * pair.bound
    wrong = {"shape": jerks[:, :, :5], "type": jerks.astype(np.float32)}.get(fails, jerks)
    pair.vector.offer(Some(wrong, fails))
    *_, infos = pair.vector.step(np.zeros((3, 6)))
    # who could say that nothing was taken says what it had asked for
    assert infos["shield/override"].tolist() == ([1.0, 1.0, 1.0] if fails == "took" else [0.5, 1.0, 0.7])
    assert infos["shield/choice"].tolist() == ([0, -1, 0] if fails == "took" else [-1, -1, -1])
    assert (infos["shield/status"] == Status.NOMINAL).all()
    assert "path" in caplog.text


def test_an_offer_ends_with_a_reset_and_the_room_before_it_is_forgotten() -> None:
    pair = Pair("stop", human="walk_by")
    for _ in range(5):
        pair.step(np.full((3, 6), 0.2))
    pair.vector.offer(0.2 * np.ones((3, 1, 6)) * pair.bound)
    pair.vector.reset(seed=4)
    for e, env in enumerate(pair.alone):
        env.reset(seed=4 + e)
    assert [info["shield/choice"] for info in pair.step(np.zeros((3, 6)))] == [-1, -1, -1]
    pair.vector.reset(seed=4)
    many = Some(np.zeros((3, 1, 6)))
    pair.vector.offer(many)
    pair.vector.step(np.zeros((3, 6)))
    assert many.margins[0].tolist() == [np.inf, np.inf, np.inf]
