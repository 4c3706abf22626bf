"""A trained network in plain numpy."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.types import Array
from jssa_gym.validation import known_name, real_array


def _relu(x: Array) -> Array:
    return np.maximum(x, 0.0)


def _clip(x: Array) -> Array:
    return np.clip(x, -1.0, 1.0)


ACTIVATIONS: dict[str, Callable[[Array], Array]] = {"tanh": np.tanh, "relu": _relu}
"""Between two layers."""

OUTPUTS: dict[str, Callable[[Array], Array]] = {"clip": _clip, "tanh": np.tanh}
"""After the last one: ``clip`` of the mean of a Gaussian (PPO, A2C), ``tanh`` of a squashed one (SAC, TD3)."""

MOST_LAYERS, WIDEST = 16, 4096
"""Bounds of a network's size; far above what drives an arm."""


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    r"""A perceptron from an observation to numbers in [-1, 1].

    .. math:: x_0 = \mathrm{clip}\Bigl(\frac{o - \mu}{\sigma}, -c, c\Bigr),\quad
              x_{i+1} = g(W_i x_i + b_i),\quad y = h(W_L x_L + b_L)

    The first step is the one of Stable-Baselines3's ``VecNormalize``, with :math:`\sigma = \sqrt{\mathrm{var} +
    \epsilon}`; :math:`g` is the activation, :math:`h` the output. Weights are numbers of float32, as networks are
    trained, and rounded to them; everything is calculated in float64.

    Args:
        layers: Weight, shape (out, in), and bias, shape (out,), of every layer, in order.
        activation: A name of :data:`ACTIVATIONS`.
        output: A name of :data:`OUTPUTS`.
        mean: Mean of the observation, shape (n_obs,).
        std: What the observation is divided by, positive, shape (n_obs,).
        clip: Bound of the normalised observation, positive; infinite for none.

    Raises:
        ParameterError: A name is unknown, a number not finite or out of range, layers do not follow one another, or
            there are too many or too wide ones.
    """

    layers: tuple[tuple[Array, Array], ...]
    activation: str
    output: str
    mean: Array
    std: Array
    clip: float = inf

    def __post_init__(self) -> None:
        known_name("activation", self.activation, ACTIVATIONS)
        known_name("output", self.output, OUTPUTS)
        layers = _checked_layers(self.layers)
        n = layers[0][0].shape[1]
        mean = _read_only(real_array("mean", self.mean, (n,), "the observation's mean"))
        std = _read_only(real_array("std", self.std, (n,), "the observation's deviation"))
        if not np.all(std > 0.0):
            raise ParameterError(f"std has to be positive, got {std.min()!r}")
        if isinstance(self.clip, bool) or not isinstance(self.clip, Real) or not self.clip > 0.0:
            raise ParameterError(f"clip has to be a positive number, got {self.clip!r}")
        for name, value in (("layers", layers), ("mean", mean), ("std", std), ("clip", float(self.clip))):
            object.__setattr__(self, name, value)

    @property
    def inputs(self) -> int:
        """Length of an observation."""
        return len(self.mean)

    @property
    def outputs(self) -> int:
        """Length of an action."""
        return len(self.layers[-1][1])

    def __call__(self, observation: Array) -> Array:
        """What the network answers, float64, shape (..., n_act); at the end of its range, or NaN, where it overflows.

        Args:
            observation: Shape (..., n_obs); what is answered to one does not depend on the others.
        """
        *hidden, (weight, bias) = self.layers
        act = ACTIVATIONS[self.activation]
        with np.errstate(over="ignore", invalid="ignore"):
            x = np.clip((observation - self.mean) / self.std, -self.clip, self.clip)
            # row by row: the bits of a matrix product may depend on the number of threads, and of observations
            for inner, offset in hidden:
                x = act(np.vecdot(inner, x[..., None, :]) + offset)
            return OUTPUTS[self.output](np.vecdot(weight, x[..., None, :]) + bias)


def _read_only(array: NDArray) -> Array:
    array.flags.writeable = False
    return array


def _single(name: str, value: ArrayLike, dimensions: int) -> Array:
    """Numbers of float32 as a new, read-only float64 array."""
    try:
        with np.errstate(over="ignore"):
            array = np.array(value, np.float32).astype(np.float64)
    except (ValueError, TypeError) as error:
        raise ParameterError(f"{name} is no array of numbers: {error}") from error
    if array.ndim != dimensions or not all(1 <= length <= WIDEST for length in array.shape):
        raise ParameterError(f"{name} has to have {dimensions} dimensions of 1 to {WIDEST}, got {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ParameterError(f"{name} has to be finite, in float32 too")
    return _read_only(array)


def _checked_layers(layers: object) -> tuple[tuple[Array, Array], ...]:
    if not isinstance(layers, list | tuple) or not 1 <= len(layers) <= MOST_LAYERS:
        raise ParameterError(f"layers has to be a sequence of 1 to {MOST_LAYERS} pairs of weight and bias")
    checked: list[tuple[Array, Array]] = []
    for k, layer in enumerate(layers):
        if not isinstance(layer, list | tuple) or len(layer) != 2:
            raise ParameterError(f"layer {k} has to be a pair of weight and bias")
        weight, bias = _single(f"weight {k}", layer[0], 2), _single(f"bias {k}", layer[1], 1)
        if len(bias) != len(weight):
            raise ParameterError(f"bias {k} has to have the {len(weight)} rows of its weight, got {len(bias)}")
        if checked and weight.shape[1] != len(checked[-1][1]):
            raise ParameterError(
                f"weight {k} takes {weight.shape[1]} numbers, but the layer before it gives {len(checked[-1][1])}"
            )
        checked.append((weight, bias))
    return tuple(checked)
