"""One episode, step by step: what the policy saw and did, what the shield made of it, and where everybody was."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import Policy
from jssa_gym.types import CapsuleSet, Scene

_LEFT_OUT = ("is_success", "uncovered")
"""Keys of ``info`` that say what another one says, or the same in every step."""


class EpisodeData(NamedTuple):
    """An episode of T steps."""

    seed: int
    arrays: dict[str, NDArray[Any]]
    """By name, in Minari's words: ``observations`` (T + 1, ...), ``actions`` (T, n), ``rewards``, ``terminations`` and
    ``truncations`` (T,), and ``infos/...`` (T + 1, ...), of which the first row is of the reset."""
    people: CapsuleSet
    """Everybody at the beginning; names, radii and persons are those of the whole episode."""


def collect(env: gym.Env, policy: Policy, seed: int) -> EpisodeData:
    """Play an episode to its end and take everything down.

    What the environment's ``info`` says is there under ``infos/``, keys with a slash as groups. Besides:
    ``infos/executed``, what moved the arm, as shares of the jerk bounds; ``infos/joints/position``, ``velocity`` and
    ``acceleration`` (T + 1, n); and of everybody's m capsules ``infos/people/start``, ``end``, ``start_velocity`` and
    ``end_velocity`` (T + 1, m, 3) [m, m/s], in single precision.

    Args:
        env: Made by ``gymnasium.make``, of this package, with a shield or without.
        policy: Maps an observation to an action; what is stored, and acts, is rounded as the action space says.
        seed: Of the episode.

    Raises:
        ParameterError: People come or go during the episode.
    """
    base: Any = env.unwrapped
    observation, info = env.reset(seed=seed)
    people = base.scene.human
    observations, rows = [observation], [_row(base, info, people)]
    actions: list[NDArray[Any]] = []
    rewards: list[float] = []
    terminations: list[bool] = []
    truncations: list[bool] = []
    while not (terminations and (terminations[-1] or truncations[-1])):
        action = np.asarray(policy(observation), env.action_space.dtype)
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        actions.append(action)
        rewards.append(float(reward))
        terminations.append(bool(terminated))
        truncations.append(bool(truncated))
        rows.append(_row(base, info, people))
    infos = {f"infos/{name}": _column([row[name] for row in rows]) for name in rows[0]}
    arrays = {
        "observations": np.stack(observations),
        "actions": np.stack(actions),
        "rewards": np.array(rewards),
        "terminations": np.array(terminations),
        "truncations": np.array(truncations),
        **infos,
    }
    return EpisodeData(seed, arrays, people)


def _row(base: Any, info: Mapping[str, Any], people: CapsuleSet) -> dict[str, Any]:
    scene: Scene = base.scene
    if scene.human.names != people.names:
        raise ParameterError("a data set holds the same people throughout an episode; these come and go")
    tracks = {
        name: getattr(scene.human, name).astype(np.float32)
        for name in ("start", "end", "start_velocity", "end_velocity")
        if len(people.names)
    }
    return {
        **{name: value for name, value in info.items() if name not in _LEFT_OUT},
        "executed": info["jerk"] / base.robot.limits.jerk,
        **{f"joints/{name}": value for name, value in scene.robot._asdict().items()},
        **{f"people/{name}": value for name, value in tracks.items()},
    }


def _column(values: list[Any]) -> NDArray[Any]:
    """A value of every step; text as UTF-8 of one length."""
    if isinstance(values[0], str):
        return np.array([value.encode() for value in values])
    return np.array(values)
