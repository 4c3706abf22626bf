"""Data sets: what is in the files, that it can be played again, and that Minari's own loader reads it."""

import json
import os
import platform
from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest
from commands import cli
from gymnasium.envs.registration import EnvSpec
from places import DOCS

from jssa_gym.datasets import DESCRIBED, Recipe, collect, read_digest, write_dataset
from jssa_gym.exceptions import ParameterError
from jssa_gym.shields.reasons import REASONS
from jssa_gym.types import Status

h5py = pytest.importorskip("h5py")

STEPS = 60
SHIELDED = Recipe("home", "random", "jssa+stop", "pursuit", episodes=2, seed=5, steps=STEPS)
UNSHIELDED = Recipe("home", "random", "none", "pursuit", episodes=2, seed=5, steps=STEPS)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """A folder with a shielded data set and its twin without a shield."""
    folder = tmp_path_factory.mktemp("minari sets")
    for recipe, name in ((SHIELDED, "mine/with-v0"), (UNSHIELDED, "mine/without-v1")):
        write_dataset(folder, recipe, name)
    return folder


def read(root, name):
    data = root / name / "data"
    return h5py.File(data / "main_data.hdf5", "r"), json.loads((data / "metadata.json").read_text())


# ---- what is in it -----------------------------------------------------------------------------------


def test_shapes_are_minaris(root):
    archive, told = read(root, "mine/with-v0")
    assert list(archive) == ["episode_0", "episode_1"]
    assert (told["dataset_id"], told["data_format"]) == ("mine/with-v0", "hdf5")
    assert (told["total_episodes"], told["total_steps"]) == (2, 2 * STEPS)
    for k, episode in enumerate(archive.values()):
        assert (episode.attrs["id"], episode.attrs["seed"], episode.attrs["total_steps"]) == (k, 5 + k, STEPS)
        assert episode["observations"].shape[0] == STEPS + 1
        assert episode["actions"].shape == (STEPS, 6)
        for name, kind in (("rewards", float), ("terminations", bool), ("truncations", bool)):
            assert episode[name].shape == (STEPS,)
            assert episode[name].dtype == kind
        assert not episode["terminations"][()].any()
        assert episode["truncations"][()].nonzero()[0].tolist() == [STEPS - 1]
        infos = []
        episode["infos"].visititems(
            lambda name, item, infos=infos: infos.append(item) if isinstance(item, h5py.Dataset) else None
        )
        assert len(infos) > 25
        assert {item.shape[0] for item in infos} == {STEPS + 1}
        # Minari appends to what can grow
        assert all(item.maxshape[0] is None for item in infos)
    space = json.loads(told["observation_space"])
    assert (space["type"], space["dtype"], space["shape"]) == ("Box", "float32", [episode["observations"].shape[1]])


def test_tracks_and_decisions_are_those_of_the_episode(root):
    archive, _ = read(root, "mine/with-v0")
    infos, actions = archive["episode_1/infos"], archive["episode_1/actions"]
    attributes = archive["episode_1"].attrs
    with closing(SHIELDED.make_env()) as env:
        env.reset(seed=6)
        bound, intervened = env.unwrapped.robot.limits.jerk, 0
        for k in range(STEPS + 1):
            scene = env.unwrapped.scene
            for name in ("start", "end", "start_velocity", "end_velocity"):
                np.testing.assert_array_equal(infos[f"people/{name}"][k], getattr(scene.human, name).astype("f4"))
            np.testing.assert_array_equal(infos["joints/position"][k], scene.robot.position)
            if k == STEPS:
                break
            _, _, _, _, info = env.step(actions[k])
            assert infos["shield/status"][k + 1] == info["shield/status"]
            assert infos["shield/reason"][k + 1].decode() == info["shield/reason"]
            np.testing.assert_array_equal(infos["executed"][k + 1], info["jerk"] / bound)
            intervened += info["shield/intervened"]
        assert intervened > 0
        assert tuple(attributes["people/names"]) == scene.human.names
        np.testing.assert_array_equal(attributes["people/radius"], scene.human.radius)
    assert set(infos["shield/status"][()]) <= set(Status)
    assert set(infos["shield/reason_code"][()]) <= {0, *REASONS}


def test_without_a_shield_every_jerk_is_the_policys(root):
    shielded, unshielded = (read(root, name)[0]["episode_0"] for name in ("mine/with-v0", "mine/without-v1"))
    np.testing.assert_array_equal(shielded["actions"], unshielded["actions"])  # the same seeds
    wanted = unshielded["actions"][()].astype(float)
    np.testing.assert_allclose(unshielded["infos/executed"][1:], wanted, rtol=1e-15)
    assert np.abs(shielded["infos/executed"][1:] - wanted).max() > 0.1
    assert not unshielded["infos/shield/intervened"][()].any()


@pytest.mark.parametrize("name", ["mine/with-v0", "mine/without-v1"])
def test_the_actions_played_again_in_the_recovered_environment_give_the_same(root, name):
    archive, told = read(root, name)
    env = gym.make(EnvSpec.from_json(told["env_spec"]))
    episode = archive["episode_0"]
    observation, _ = env.reset(seed=int(episode.attrs["seed"]))
    np.testing.assert_array_equal(observation, episode["observations"][0])
    for k, action in enumerate(episode["actions"][()]):
        observation, reward, *_ = env.step(action)
        np.testing.assert_array_equal(observation, episode["observations"][k + 1])
        assert reward == episode["rewards"][k]
    env.close()


def test_nobody_has_no_tracks(tmp_path):
    made = write_dataset(tmp_path, Recipe("home", "hold", human="none", episodes=1, steps=3))
    assert made.name == "jssa_gym/home-hold-shielded-none-v0"
    archive, _ = read(tmp_path, made.name)
    assert "people" not in archive["episode_0/infos"]
    assert np.isposinf(archive["episode_0/infos/distance"][()]).all()


def test_people_who_cannot_be_written_down_leave_the_spaces(tmp_path):
    recipe = Recipe("home", "hold", human="feint", episodes=np.int64(1), steps=np.int32(3))
    _, told = read(tmp_path, write_dataset(tmp_path, recipe).name)
    assert "env_spec" not in told
    assert json.loads(told["action_space"])["shape"] == [6]


class Coming(gym.Env):
    """Somebody is there from the first step on, who was not before."""

    def __init__(self, env):
        self.env, self.observation_space, self.action_space = env, env.observation_space, env.action_space
        self.robot, self.scene = env.robot, None

    def reset(self, *, seed=None, options=None):
        observation, info = self.env.reset(seed=seed)
        self.scene = self.env.scene._replace(human=self.env.scene.human._replace(names=()))
        return observation, info

    def step(self, action):
        observation, reward, *_, info = self.env.step(action)
        self.scene = self.env.scene
        return observation, reward, False, True, info


def test_people_who_come_are_refused():
    env = Coming(SHIELDED.make_env().unwrapped)
    with pytest.raises(ParameterError, match="come and go"):
        collect(env, lambda observation: np.zeros(6), 0)


# ---- that it can be told again -----------------------------------------------------------------------


def test_the_same_recipe_gives_the_same_data(root, tmp_path):
    again = write_dataset(tmp_path, SHIELDED, "mine/with-v0")
    assert read_digest(root / "mine/with-v0") == (again.digest, again.digest)
    first, second = ((r / "mine/with-v0/data/main_data.hdf5").read_bytes() for r in (root, tmp_path))
    assert first == second
    assert read_digest(root / "mine/without-v1")[0] != again.digest


def test_an_interrupt_leaves_nothing(tmp_path):
    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_dataset(tmp_path, SHIELDED, "mine/with-v0", stop)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    assert write_dataset(tmp_path, SHIELDED, "mine/with-v0").episodes == 2


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="described for x86-64")
@pytest.mark.parametrize("name", DESCRIBED)
def test_the_described_ones_come_out_as_described(name, tmp_path, monkeypatch):
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Haswell")  # as its card says; of effect in a new process
    done = cli("dataset", "--described", name, "--out", tmp_path, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["as_described"]


def test_every_one_has_a_card_with_its_digest():
    text = (DOCS / "datasets.md").read_text(encoding="utf-8")
    for name, one in DESCRIBED.items():
        card = text.partition(f"## `{name}`")[2].partition("\n## ")[0]
        assert one.digest in card
        assert f"{one.recipe.episodes} episodes" in card
        assert f"seeds {one.recipe.seed:,}" in card


# ---- Minari itself -----------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_minaris_own_loader_reads_it(root, monkeypatch):
    minari = pytest.importorskip("minari")
    monkeypatch.setitem(os.environ, "MINARI_DATASETS_PATH", str(root))
    assert set(minari.list_local_datasets(compatible_minari_version=True)) == {"mine/with-v0", "mine/without-v1"}
    for name, shielded in (("mine/with-v0", True), ("mine/without-v1", False)):
        data = minari.load_dataset(name)
        assert (data.total_episodes, data.total_steps) == (2, 2 * STEPS)
        (episode,) = data.filter_episodes(lambda one: one.id == 1)
        assert len(episode) == STEPS
        assert all(map(data.observation_space.contains, episode.observations))
        assert all(map(data.action_space.contains, episode.actions))
        assert episode.infos["shield"]["intervened"].any() == shielded
        assert episode.infos["people"]["start"].shape == (STEPS + 1, 6, 3)
        env = data.recover_environment()
        observation, _ = env.reset(seed=6)
        np.testing.assert_array_equal(observation, episode.observations[0])
        env.close()
