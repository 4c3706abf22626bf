"""What can be wrong with a perception system, and named settings of it for campaigns."""

from dataclasses import dataclass

from jssa_gym.exceptions import ParameterError
from jssa_gym.validation import check_fields, known_name, number_within, positive_integer, true_or_false

GLITCHES = ("rest", "acceleration", "position", "huge", "noise")
"""What a joint state can read wrongly; see :attr:`SensorFaults.joint_glitch_kind`."""

_LENGTHS = ("noise", "velocity_noise", "latency", "jitter", "outlier_size", "joint_glitch_size", "joint_drift")
_JOINTS = ("joint_freeze", "joint_glitch", "joint_drift", "lag", "freeze_scene")
_CHANCES = ("dropout", "freeze", "outlier", "swap", "misstamp", "joint_freeze", "joint_glitch", "lag", "freeze_scene")
_TICKS = (
    *("dropout_ticks", "freeze_ticks", "outlier_ticks", "swap_ticks"),
    *("joint_freeze_ticks", "joint_glitch_ticks", "lag_ticks", "lag_age", "freeze_scene_ticks"),
)
_FLAGS = ("reorder", "blank", "freeze_reported")


@dataclass(frozen=True, slots=True)
class SensorFaults:
    """What is wrong with a perception system; by default nothing.

    Probabilities are per tick, of a fault's beginning while it is not on already; it then lasts a number of ticks
    drawn evenly from 1 to ``..._ticks``. Faults of the measurement (noise, dropout, outliers, swaps) travel with the
    sample, so that latency delays them too.

    Faults of the joint state and of the clock begin after the reset: what is delivered then is right.

    Raises:
        ParameterError: A value is out of range.
    """

    noise: float = 0.0
    """Each end is displaced by a vector no longer than this, drawn evenly from the ball [m]: a bound, no deviation."""
    velocity_noise: float = 0.0
    """The same for the ends' velocities [m/s]."""
    latency: float = 0.0
    """Time from measuring to delivery [s]; the age says so."""
    jitter: float = 0.0
    """Further delay of each sample, drawn evenly from [0, jitter] [s]."""
    reorder: bool = False
    """Deliver in order of arrival, an older sample after a newer one; else those that were overtaken are left out."""
    dropout: float = 0.0
    """Probability that a capsule is no longer measured."""
    dropout_ticks: int = 1
    blank: bool = True
    """What is delivered for a capsule that is not measured: NaN, or else its last measurement; never valid."""
    missing: tuple[str, ...] = ()
    """Body parts that are never measured."""
    freeze: float = 0.0
    """Probability that the whole sample is delivered again; with ``freeze_ticks=1`` a duplicate."""
    freeze_ticks: int = 1
    freeze_reported: bool = True
    """Whether the age grows meanwhile; else it stays as it was, as if the sample were new."""
    outlier: float = 0.0
    """Probability that a capsule is measured elsewhere, and said to be valid."""
    outlier_ticks: int = 1
    outlier_size: float = 1.0
    """How far away, in a direction that is drawn once [m]."""
    swap: float = 0.0
    """Probability that two people are taken for each other; with one person, two of the body parts."""
    swap_ticks: int = 1
    misstamp: float = 0.0
    """Probability that a delivery has a wrong age."""
    shift: float = 0.1
    """By how much the age is overstated then [s]; a negative one makes old data look young."""
    joint_freeze: float = 0.0
    """Probability that the last joint state is delivered again; people and clock go on."""
    joint_freeze_ticks: int = 1
    joint_glitch: float = 0.0
    """Probability that the joint state reads something else."""
    joint_glitch_ticks: int = 1
    joint_glitch_kind: str = "any"
    """What: ``rest`` (velocity and acceleration read 0), ``acceleration`` (all read minus ``size`` of their limits),
    ``position`` (all read ``size`` rad more), ``huge`` (velocities read 1e308), ``noise`` (every value is off by up to
    ``size`` of its limit, another in every tick), or ``any``, drawn for each glitch."""
    joint_glitch_size: float = 1.0
    joint_drift: float = 0.0
    """The joint state reads more by this share of every limit (of the range for positions) in every tick: a bias that
    grows."""
    lag: float = 0.0
    """Probability that whole scenes, clock included, are delivered late."""
    lag_ticks: int = 1
    lag_age: int = 1
    """How many ticks late."""
    freeze_scene: float = 0.0
    """Probability that the last scene is delivered again, the same object, its clock stopped."""
    freeze_scene_ticks: int = 1

    def __post_init__(self) -> None:
        for name in _LENGTHS:
            number_within(name, getattr(self, name), 0.0)
        for name in _CHANCES:
            number_within(name, getattr(self, name), 0.0, 1.0)
        check_fields(self, _TICKS, positive_integer)
        check_fields(self, _FLAGS, true_or_false)
        number_within("shift", self.shift, -10.0, 10.0)
        known_name("joint_glitch_kind", self.joint_glitch_kind, ("any", *GLITCHES))
        if isinstance(self.missing, str) or not all(isinstance(name, str) for name in self.missing):
            raise ParameterError(f"missing has to be a tuple of body parts, got {self.missing!r}")

    @property
    def reported(self) -> bool:
        """Whether age and validity, with the bound on the noise, tell all: nothing delivered as good is wrong."""
        return self.seen and not self.joints

    @property
    def joints(self) -> bool:
        """Whether the joint state or the clock is wrong now and then."""
        return any(getattr(self, name) > 0.0 for name in _JOINTS)

    @property
    def seen(self) -> bool:
        """Whether all that is wrong can be seen: what is not reported is contradicted by where the applied jerks must
        have led, or by a clock that does not keep up with the ticks.
        """
        lies = self.outlier > 0.0 or self.swap > 0.0 or (self.misstamp > 0.0 and self.shift < 0.0)
        return not (lies or (self.freeze > 0.0 and not self.freeze_reported))


FAULTS: dict[str, SensorFaults] = {
    "none": SensorFaults(),
    "noise": SensorFaults(noise=0.02, velocity_noise=0.2),
    "short dropouts": SensorFaults(dropout=0.05, dropout_ticks=3),
    "long dropouts": SensorFaults(dropout=0.01, dropout_ticks=50),
    "stale dropouts": SensorFaults(dropout=0.05, dropout_ticks=10, blank=False),
    "partial body": SensorFaults(missing=("right_arm", "left_leg")),
    "latency 100 ms": SensorFaults(latency=0.1),
    "latency 100 to 200 ms": SensorFaults(latency=0.1, jitter=0.1),
    "latency 200 to 250 ms": SensorFaults(latency=0.2, jitter=0.05),
    "reordering": SensorFaults(latency=0.02, jitter=0.06, reorder=True),
    "duplicates": SensorFaults(freeze=0.3),
    "freeze": SensorFaults(freeze=0.01, freeze_ticks=50),
    "backward stamps": SensorFaults(misstamp=0.1, shift=0.1),
    "all that is reported": SensorFaults(
        noise=0.01,
        velocity_noise=0.1,
        latency=0.03,
        jitter=0.04,
        reorder=True,
        dropout=0.02,
        dropout_ticks=5,
        freeze=0.02,
        freeze_ticks=5,
        misstamp=0.02,
    ),
    "silent freeze": SensorFaults(freeze=0.01, freeze_ticks=50, freeze_reported=False),
    "short outliers": SensorFaults(outlier=0.01, outlier_ticks=3),
    "long outliers": SensorFaults(outlier=0.005, outlier_ticks=50),
    "swapped identities": SensorFaults(swap=0.01, swap_ticks=20),
    "future stamps": SensorFaults(misstamp=0.05, shift=-0.05),
    "stale joints": SensorFaults(joint_freeze=0.01, joint_freeze_ticks=50),
    "joint glitch": SensorFaults(joint_glitch=0.02),
    "lasting joint glitch": SensorFaults(joint_glitch=0.005, joint_glitch_ticks=100),
    "noisy joints": SensorFaults(joint_glitch=1.0, joint_glitch_kind="noise", joint_glitch_size=1e-3),
    "drift": SensorFaults(joint_drift=5e-7),
    "lagging scene": SensorFaults(lag=0.01, lag_ticks=100, lag_age=3),
    "late scene": SensorFaults(lag=1.0, lag_ticks=1000),
    "stale scene": SensorFaults(freeze_scene=0.01, freeze_scene_ticks=50),
    "rare joint faults": SensorFaults(
        joint_freeze=0.005,
        joint_freeze_ticks=3,
        joint_glitch=0.005,
        lag=0.005,
        lag_ticks=3,
        freeze_scene=0.005,
        freeze_scene_ticks=3,
    ),
    "people and joints": SensorFaults(
        noise=0.01,
        velocity_noise=0.1,
        latency=0.03,
        dropout=0.02,
        dropout_ticks=5,
        joint_freeze=0.002,
        joint_freeze_ticks=20,
        joint_glitch=0.005,
        joint_glitch_ticks=10,
        freeze_scene=0.002,
        freeze_scene_ticks=20,
    ),
}
"""Settings for campaigns; :attr:`SensorFaults.reported` separates those that age and validity tell about,
:attr:`SensorFaults.seen` those that a shield notices besides."""
