"""Hyper-parameters of each algorithm and their defaults; what a task changes is ``PRESETS`` in ``train/config.py``."""

from dataclasses import asdict, dataclass, fields, replace
from typing import Any, ClassVar, Literal

from jssa_gym.exceptions import ParameterError
from jssa_gym.policies.network import MOST_LAYERS, WIDEST
from jssa_gym.validation import number_within, positive_integer, true_or_false


@dataclass(frozen=True, slots=True)
class Settings:
    """What every algorithm has.

    Raises:
        ParameterError: A number is out of range.
    """

    algorithm: ClassVar[str]
    learning_rate: float = 3e-4
    decay: bool = False
    """Whether the learning rate falls linearly to 0 over the training."""
    batch_size: int = 256
    gamma: float = 0.97
    """Discount of a policy step; at 12.5 Hz a reward counts half after 1.8 s."""
    width: int = 64
    """Units of a hidden layer."""
    layers: int = 2
    """Hidden layers."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.type is bool:
                checked: Any = true_or_false(field.name, value)
            elif field.type is int:
                checked = positive_integer(field.name, value)
                number_within(field.name, checked, *_RANGES.get(field.name, (1,)))
            else:
                checked = number_within(field.name, value, *_RANGES[field.name])
            object.__setattr__(self, field.name, checked)

    def changed(self, changes: dict[str, str]) -> "Settings":
        """The settings with some fields given as text, as on a command line.

        Raises:
            ParameterError: A name is unknown or a text is no such value.
        """
        known: dict[str, Any] = {field.name: field.type for field in fields(self)}
        values: dict[str, Any] = {}
        for name, text in changes.items():
            if name not in known:
                raise ParameterError(f"unknown setting {name!r} of {self.algorithm}; valid: {', '.join(known)}")
            kind = known[name]
            try:
                values[name] = _truth(text) if kind is bool else kind(text)
            except ValueError as error:
                raise ParameterError(f"{name} has to be of type {kind.__name__}, got {text!r}") from error
        return replace(self, **values)

    def as_dict(self) -> dict[str, Any]:
        """The settings as JSON can hold them."""
        return {"algorithm": self.algorithm, **asdict(self)}


_RANGES: dict[str, tuple[float, float]] = {
    "learning_rate": (1e-9, 1.0),
    "batch_size": (2, 1_000_000),
    "gamma": (0.0, 1.0),
    "width": (1, WIDEST),
    "layers": (1, MOST_LAYERS - 1),
    "gae_lambda": (0.0, 1.0),
    "clip_range": (1e-3, 1.0),
    "ent_coef": (0.0, 10.0),
    "log_std": (-10.0, 2.0),
    "tau": (1e-6, 1.0),
    "updates": (1e-3, 100.0),
    "noise": (0.0, 10.0),
    "cost_limit": (1e-6, 1.0),
    "multiplier_rate": (0.0, 100.0),
}
"""Least and largest value; networks not larger than a policy file takes."""


def _truth(text: str) -> bool:
    if text.lower() not in ("true", "false"):
        raise ValueError(text)
    return text.lower() == "true"


@dataclass(frozen=True, slots=True)
class PPO(Settings):
    """Proximal policy optimisation."""

    algorithm: ClassVar[str] = "ppo"
    decay: bool = True
    rollout: int = 4096
    """Policy steps, of all environments together, between two updates."""
    n_epochs: int = 10
    batch_size: int = 512
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    ent_coef: float = 0.0
    log_std: float = -1.0
    """Logarithm of the exploration's standard deviation at the beginning."""


@dataclass(frozen=True, slots=True)
class PPOLagrangian(PPO):
    """PPO with a limit on the cost, which a Lagrange multiplier weighs against the reward."""

    algorithm: ClassVar[str] = "ppo-lagrangian"
    cost_limit: float = 0.001
    """Share of control steps in which somebody may be nearer than d_min: 0.001 is once in 8 s."""
    multiplier_rate: float = 0.02
    """By how much the multiplier rises in 1,000 policy steps with twice that, or falls in as many with none."""


@dataclass(frozen=True, slots=True)
class OffPolicy(Settings):
    """What algorithms with a replay buffer share."""

    buffer_size: int = 300_000
    learning_starts: int = 5_000
    tau: float = 0.005
    updates: float = 0.5
    """Gradient steps for every policy step."""


@dataclass(frozen=True, slots=True)
class SAC(OffPolicy):
    """Soft actor-critic."""

    algorithm: ClassVar[str] = "sac"


@dataclass(frozen=True, slots=True)
class SACLagrangian(SAC):
    """SAC with a limit on the cost, whose multiple is taken from the reward."""

    algorithm: ClassVar[str] = "sac-lagrangian"
    cost_limit: float = 0.001
    """As of :class:`PPOLagrangian`."""
    multiplier_rate: float = 0.02
    """As of :class:`PPOLagrangian`."""


@dataclass(frozen=True, slots=True)
class TQC(OffPolicy):
    """Truncated quantile critics; needs ``sb3-contrib``."""

    algorithm: ClassVar[str] = "tqc"


@dataclass(frozen=True, slots=True)
class TD3(OffPolicy):
    """Twin delayed deep deterministic policy gradient."""

    algorithm: ClassVar[str] = "td3"
    noise: float = 0.1
    """Standard deviation of the exploration noise, in action bounds."""


ALGORITHMS: dict[str, type[Settings]] = {
    kind.algorithm: kind for kind in (PPO, SAC, TD3, TQC, PPOLagrangian, SACLagrangian)
}
"""Algorithms by name."""

Algorithm = Literal["ppo", "sac", "td3", "tqc", "ppo-lagrangian", "sac-lagrangian"]
