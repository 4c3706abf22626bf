"""Models of Stable-Baselines3: their weights without their pickles."""

import io
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym import robots
from jssa_gym.exceptions import MissingExtraError, PolicyFileError, how_to_install
from jssa_gym.policies.files import LARGEST
from jssa_gym.policies.learned import LearnedPolicy
from jssa_gym.policies.model import ModelPolicy
from jssa_gym.policies.network import MOST_LAYERS, WIDEST, Network
from jssa_gym.policies.scripted import Policy
from jssa_gym.robots import RobotModel, make_robot
from jssa_gym.storage import open_archive, read_member, read_whole
from jssa_gym.types import Array

INSTALL = how_to_install("train")

_TRUST = "pass trust_pickle=True, only for files whose origin you know, to have Stable-Baselines3 load it"


class _Family(NamedTuple):
    """Where algorithms keep the network that acts."""

    algorithm: str
    mark: str
    """How a key begins that only they have."""
    activation: str
    """What they use unless told otherwise."""
    output: str
    hidden: str
    """Where the hidden layers are, as numbers 0, 2, 4, ...; the last one too if ``last`` is empty."""
    last: str
    unused: tuple[str, ...]
    """How the keys begin that say nothing about the action."""


_FAMILIES = (
    _Family(
        "PPO",
        "action_net.",
        "tanh",
        "clip",
        "mlp_extractor.policy_net",
        "action_net",
        ("log_std", "mlp_extractor.value_net.", "value_net."),
    ),
    _Family(
        "SAC",
        "actor.log_std",
        "relu",
        "tanh",
        "actor.latent_pi",
        "actor.mu",
        ("actor.log_std.", "critic.", "critic_target."),
    ),
    _Family("TD3", "actor.mu.0.", "relu", "tanh", "actor.mu", "", ("actor_target.", "critic.", "critic_target.")),
)
"""PPO's is A2C's too, SAC's TQC's, TD3's DDPG's."""


def convert_sb3(
    path: str | Path,
    *,
    activation: str | None = None,
    control: str = "jerk",
    share: float = 0.5,
    ticks: int = 1,
    mean: ArrayLike | None = None,
    std: ArrayLike | None = None,
    clip: float = np.inf,
    robot: str | Path | RobotModel = robots.DEFAULT,
    task: str = "",
    observes_intervention: bool = False,
) -> LearnedPolicy:
    """The deterministic policy of a model of Stable-Baselines3, from its weights alone: no pickle is ever read.

    It knows the fully connected policies (``MlpPolicy``) of PPO, A2C, SAC, TQC, TD3 and DDPG. What the weights do not
    say has to be told; told wrongly, the policy is another one.

    Args:
        path: Of the ``.zip`` that the model's ``save`` wrote.
        activation: ``"tanh"`` or ``"relu"``; by default what the file mentions, else the algorithm's own: ``tanh`` of
            PPO and A2C, ``relu`` of the others.
        control: See :class:`~jssa_gym.policies.LearnedPolicy`; so the next two.
        share: Share of the limits that a command may use.
        ticks: For how many control ticks an action was held in training.
        mean: Of a ``VecNormalize``, its ``obs_rms.mean``; by default observations are not normalised.
        std: ``sqrt(obs_rms.var + epsilon)`` of it.
        clip: Its ``clip_obs``.
        robot: That it was trained with, as :func:`~jssa_gym.robots.make_robot` takes it.
        task: Name of its task.
        observes_intervention: See :class:`~jssa_gym.policies.LearnedPolicy`.

    Raises:
        PolicyFileError: The file is no model, is damaged, or has a policy that cannot be rebuilt from its weights.
        ParameterError: Another argument is out of range, or the network does not fit the robot.
        MissingExtraError: PyTorch is not installed.
    """
    state, mentioned = _weights(path)
    family = _family(path, state)
    try:
        layers = _layers(family, state)
    except (KeyError, ValueError) as error:
        what = f"there is no {error}" if isinstance(error, KeyError) else str(error)
        raise PolicyFileError(
            f"{path} holds no policy that can be rebuilt from its weights: {what}; {_TRUST}"
        ) from error
    if activation is None:
        others = mentioned - {"ReLU", "Tanh"}
        if others or len(mentioned) > 1:
            raise PolicyFileError(
                f"{path} mentions the activations {', '.join(sorted(mentioned))}; say which one is the policy's, tanh "
                f"or relu, or {_TRUST}"
            )
        activation = mentioned.pop().lower() if mentioned else family.activation
    n, arm = layers[0][0].shape[1], make_robot(robot)
    network = Network(
        layers=layers,
        activation=activation,
        output=family.output,
        mean=np.zeros(n) if mean is None else np.asarray(mean),
        std=np.ones(n) if std is None else np.asarray(std),
        clip=clip,
    )
    return LearnedPolicy(
        network,
        control=control,
        share=share,
        ticks=ticks,
        limits=arm.limits,
        task=task,
        robot=arm.name,
        observes_intervention=observes_intervention,
        provenance={"converted": f"the Stable-Baselines3 model {Path(path).name}, as {family.algorithm}"},
    )


def unpickle_sb3(path: str | Path) -> Policy:
    """What asks a model for its deterministic action. Loading it runs whatever its author put into the file.

    Args:
        path: Of the ``.zip`` that the model's ``save`` wrote.

    Raises:
        PolicyFileError: It is no model of PPO, SAC or TD3, or cannot be loaded.
        MissingExtraError: PyTorch or Stable-Baselines3 is not installed.
    """
    family = _family(path, _weights(path)[0])
    try:
        import stable_baselines3
    except ImportError as error:
        raise MissingExtraError(f"models of Stable-Baselines3 need the extra 'train': {INSTALL}") from error
    try:
        model = getattr(stable_baselines3, family.algorithm).load(path, device="cpu")
    except Exception as error:  # what unpickling raises is up to the file
        raise PolicyFileError(f"{path} cannot be loaded as {family.algorithm}: {error}") from error
    return ModelPolicy(model)


def _weights(path: str | Path) -> tuple[dict[str, Any], set[str]]:
    """State of the policy's modules, and the activations that the file mentions in plain text."""
    content = read_whole(Path(path), PolicyFileError, LARGEST)
    try:
        import torch
    except ImportError as error:
        raise MissingExtraError(f"models of Stable-Baselines3 need the extra 'train': {INSTALL}") from error
    try:
        with open_archive(content, LARGEST) as archive:
            weights, data = (read_member(archive, name) for name in ("policy.pth", "data"))
        with open_archive(weights, LARGEST):
            state = torch.load(io.BytesIO(weights), map_location="cpu", weights_only=True)
    except Exception as error:  # damaged archives raise all kinds of things
        raise PolicyFileError(f"{path} is no model of Stable-Baselines3, or damaged: {_line(error)}") from error
    if not isinstance(state, dict) or not all(
        isinstance(name, str) and isinstance(value, torch.Tensor) for name, value in state.items()
    ):
        raise PolicyFileError(f"{path} is no model of Stable-Baselines3: its policy.pth holds no state of modules")
    mentioned = re.findall(rb"torch\.nn\.modules\.activation\.(\w+)", data)
    return state, {name.decode() for name in mentioned}


def _line(error: Exception) -> str:
    """The first line of what may be a page."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _family(path: str | Path, state: dict[str, Any]) -> _Family:
    if any(name.startswith("lstm_") for name in state):
        raise PolicyFileError(
            f"{path} holds a recurrent policy, whose state is not in the weights: load the model with sb3_contrib and "
            "give it to evaluate() itself"
        )
    for family in _FAMILIES:
        if any(name.startswith(family.mark) for name in state):
            return family
    raise PolicyFileError(f"{path} holds no policy of PPO, A2C, SAC, TQC, TD3 or DDPG: it has {', '.join(state)[:200]}")


def _layers(family: _Family, state: dict[str, Any]) -> tuple[tuple[Array, Array], ...]:
    """Weights and biases in order; every other key has to be one that says nothing about the action."""
    pattern = re.compile(re.escape(family.hidden) + r"\.(\d+)\.weight")
    numbers = sorted(int(found[1]) for name in state if (found := pattern.fullmatch(name)))
    if numbers != list(range(0, 2 * len(numbers), 2)) or len(numbers) > MOST_LAYERS:
        raise ValueError(f"{family.hidden} is no plain sequence of layers and activations")
    places = [f"{family.hidden}.{k}" for k in numbers] + ([family.last] if family.last else [])
    used = {f"{place}.{kind}" for place in places for kind in ("weight", "bias")}
    unknown = [name for name in state if name not in used and not name.startswith(family.unused)]
    if unknown:
        raise ValueError(f"{', '.join(unknown)[:200]} are no part of a fully connected policy")
    if family.algorithm == "PPO" and ("log_std" not in state or state["log_std"].ndim != 1):
        raise ValueError("its actions are not drawn from a Gaussian with a deviation of its own")
    return tuple((_tensor(state, f"{place}.weight", 2), _tensor(state, f"{place}.bias", 1)) for place in places)


def _tensor(state: dict[str, Any], name: str, dimensions: int) -> Array:
    tensor = state[name]
    # a few bytes can stand for any size
    if tensor.ndim != dimensions or not tensor.is_floating_point() or max(tensor.shape, default=0) > WIDEST:
        raise ValueError(f"{name} is of type {tensor.dtype} and shape {tuple(tensor.shape)}")
    try:
        array = tensor.float().numpy().astype(np.float64)
    except (RuntimeError, TypeError) as error:
        raise ValueError(f"{name} holds no numbers: {_line(error)}") from error
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} is not finite")
    return array
