"""What asks a trained model for its deterministic actions, as Stable-Baselines3's own evaluation does."""

import inspect
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.exceptions import ParameterError


class ModelPolicy:
    """Deterministic actions of a model for one episode.

    The state of a recurrent model is carried from step to step, beginning anew with this object. Observations are
    normalised as in training where the model has a ``VecNormalize`` around its environments, whose statistics stay as
    they are. A model that was loaded without its environments does not know of one: load it with
    ``env=VecNormalize.load(...)``.

    Args:
        model: With a method ``predict`` that returns the action first, as the models of Stable-Baselines3.
        env: That it acts in; None not to look whether its observations fit.

    Raises:
        ParameterError: The model was trained with observations of another shape than the environment's.
    """

    def __init__(self, model: Any, env: gym.Env | None = None) -> None:
        known, here = getattr(model, "observation_space", None), None if env is None else env.observation_space
        if known is not None and here is not None and known.shape != here.shape:
            raise ParameterError(
                f"the model takes observations of shape {known.shape}, the environment's have shape {here.shape}; give "
                "an environment with the wrappers of its training (FrameStackObservation for a VecFrameStack)"
            )
        self._model = model
        normalised = getattr(model, "get_vec_normalize_env", lambda: None)()
        self._normalise = None if normalised is None else normalised.normalize_obs
        try:
            takes = inspect.signature(model.predict).parameters
        except (TypeError, ValueError):  # something built in, which does not say what it takes
            takes = {}
        self._recurrent = {"state", "episode_start"} <= set(takes)
        self._state: Any = None
        self._start = np.ones(1, np.bool_)

    def __call__(self, observation: Any) -> Any:
        """The action for an observation."""
        if self._normalise is not None:
            observation = self._normalise(observation)
        if not self._recurrent:
            return self._model.predict(observation, deterministic=True)[0]
        action, self._state = self._model.predict(
            observation, state=self._state, episode_start=self._start, deterministic=True
        )
        self._start = np.zeros(1, np.bool_)
        return action
