r"""States on the boundary of the safe set, :math:`\phi = 0`, and what the best jerk makes of them, Eq. (7)."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.feasibility import probe
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, PLANE, SEGMENT, records
from jssa_gym.robots import RobotModel
from jssa_gym.safety.index import IndexParams
from jssa_gym.types import Array
from jssa_gym.validation import check_fields, known_name, low_high, number_within, positive_number, true_or_false

KEPT = 1e-6
"""Index [m²] up to which a state counts as kept, as in the filter."""

_DRAWS = 1 << 13
"""States drawn at a time, fewer where few are asked for."""

_RAREST = 1e-3
"""Share of the draws that have to lie in the domain."""


@dataclass(frozen=True, slots=True)
class Domain:
    """States that a certificate is about; its answer holds for these, and its shares for this measure.

    Joint positions are uniform between their limits, velocities and accelerations uniform within a share of theirs,
    and the velocities are scaled down where the tool centre point would be too fast, to a speed uniform below
    ``tip_speed``. The person is a sphere whose closest point lies uniformly on the capsule's axis (a quarter of them
    at either end), in any direction, at a distance uniform in ``distance``, moving across that direction at a speed
    uniform below ``human_speed`` and along it so that the index is 0. Draws whose person were too fast for that, or
    whose arm cannot keep its joint limits, are drawn again.

    Raises:
        ParameterError: A number is out of range.
    """

    tip_speed: float = 1.0
    """The tool centre point is no faster [m/s]."""
    human_speed: float = 1.0
    """The person, who keeps the velocity, is no faster [m/s]."""
    distance: tuple[float, float] = (0.05, 1.2)
    """Range of the surface distance [m]."""
    speed_share: float = 0.3
    """Joint speeds, as a share of their limits."""
    acceleration_share: float = 0.5
    """Joint accelerations, as a share of their limits."""
    authority: float = 0.0
    """The joints' jerk bounds can give the distance at least so much jerk, either way [m/s³]; a shield's rows ask for
    5."""
    radius: float = 0.1
    """Radius of the person [m]."""
    band: float = 0.0
    """How far below 0 the index may lie [m²]."""
    viable: bool = True
    """Whether the jerk has to keep the joint limits recoverable, or only its own bounds."""

    def __post_init__(self) -> None:
        check_fields(self, ("tip_speed", "human_speed", "radius"), positive_number)
        check_fields(self, ("distance",), low_high)
        check_fields(self, ("speed_share", "acceleration_share"), number_within, 0.0, 1.0)
        check_fields(self, ("authority", "band"), number_within, 0.0)
        check_fields(self, ("viable",), true_or_false)


@dataclass(frozen=True, slots=True, eq=False)
class BoundaryState:
    r"""An arm and a person with :math:`\phi = 0`, and the best that can be done about it."""

    capsule: str
    """Capsule of the robot; the index is that of it and the person."""
    joints: Array
    """Joint state, shape (3, n) [rad, rad/s, rad/s²]."""
    centre: Array
    """Centre of the person, shape (3,) [m]."""
    velocity: Array
    """Shape (3,) [m/s]."""
    radius: float
    """[m]."""
    ahead: float
    r"""Smallest :math:`\phi_{k+1}` that a jerk was found to reach [m²]; above 0, Eq. (7) fails."""
    distance: float
    """[m]."""
    rate: float
    """Rate of change of the distance [m/s]."""
    authority: float
    """How much jerk the joints' jerk bounds can give the distance [m/s³]."""
    tip_speed: float
    """[m/s]."""


class Looks(NamedTuple):
    """Boundary states of one capsule, N of them, with what the best jerk makes of each."""

    ahead: Array
    r""":math:`\phi_{k+1}` under the best jerk, shape (N,) [m²]."""
    jerk: Array
    r""":math:`\dddot D` in that step, shape (N,) [m/s³]."""
    distance: Array
    """Surface distances, shape (N,) [m]."""
    rate: Array
    """Their rates of change, shape (N,) [m/s]."""
    authority: Array
    """Jerk that the joints can give them, shape (N,) [m/s³]."""
    tip_speed: Array
    """Speeds of the tool centre point, shape (N,) [m/s]."""
    genes: Array
    """The draws that they came from, shape (N, 3n + 11): what a search changes."""
    joints: Array
    """Joint states, shape (N, 3, n) [rad, rad/s, rad/s²]."""
    people: NDArray
    """Shape (N,) of ``AGENT``."""

    def pick(self, which: NDArray) -> "Looks":
        """Some of them, by number or by mask."""
        return Looks(*(field[which] for field in self))

    @property
    def infeasible(self) -> NDArray[np.bool_]:
        """Where no jerk keeps the index; a NaN is one of them."""
        return ~(self.ahead <= KEPT)


class Boundary:
    r"""Draws states of one capsule with :math:`\phi = 0` from a domain and looks one step ahead.

    Args:
        robot: The arm.
        index: Parameters of the index.
        capsule: Name of one of the robot's capsules.
        domain: Where the states are drawn from.
        dt: Control step [s].

    Raises:
        ParameterError: An unknown capsule, or a step that is not positive.
    """

    def __init__(self, robot: RobotModel, index: IndexParams, capsule: str, domain: Domain, dt: float) -> None:
        self.row = robot.capsule_names.index(known_name("capsule", capsule, robot.capsule_names))
        self.robot, self.index, self.capsule, self.domain = robot, index, capsule, domain
        self.dt = positive_number("dt", dt)
        limits, n = robot.limits, robot.n
        low, high = limits.position.T
        self._bounds = limits.bounds()
        self._middle = np.stack([(low + high) / 2.0, np.zeros(n), np.zeros(n)])
        self._half = np.stack(
            [
                (high - low) / 2.0,
                domain.speed_share * limits.velocity,
                domain.acceleration_share * limits.acceleration,
            ]
        )
        self._region = np.array(
            [domain.tip_speed, domain.human_speed, *domain.distance, domain.radius, domain.band], dtype=np.float64
        )

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """Genes, shape (count, 3n + 11): joint states in [-1, 1], five numbers in [0, 1], six normal ones."""
        joints = rng.uniform(-1.0, 1.0, (count, 3 * self.robot.n))
        return np.hstack([joints, rng.random((count, 5)), rng.normal(size=(count, 6))])

    def look(self, genes: Array) -> Looks:
        """One step ahead from every draw that lies in the domain, in their order."""
        n, count = self.robot.n, len(genes)
        joints = np.ascontiguousarray(self._middle + self._half * genes[:, : 3 * n].reshape(count, 3, n))
        np.clip(joints[:, 0], self._bounds[0], self._bounds[1], out=joints[:, 0])  # rounding
        uniform, normal = genes[:, 3 * n : 3 * n + 5], genes[:, 3 * n + 5 :]
        draws = np.hstack([uniform[:, :4], normal, uniform[:, 4:]])
        people, out = records(count, AGENT), np.zeros((count, 6))
        scratch: Any = (
            records(0, PLANE),
            records((1, 1), PAIR),
            records((1, 1), PAIR),
            records(n, FRAME),
            records(1, SEGMENT),
            np.zeros((3, n)),
        )
        probe(
            self.robot.links,
            self.robot.capsules[self.row : self.row + 1],
            self.robot.tool_link,
            self.robot.tool_offset,
            self._bounds,
            self.dt,
            self.index.array(),
            self._region,
            self.domain.viable,
            joints,
            draws,
            people,
            *scratch,
            out,
        )
        # a state of the domain whose index is NaN must not pass for one outside of it
        inside = ~np.isnan(out[:, 2]) & ~(out[:, 4] < self.domain.authority)
        return Looks(*out.T, genes, joints, people).pick(inside)

    def sample(self, states: int, rng: np.random.Generator) -> tuple[Looks, int]:
        """So many states in the domain, the first that are drawn, and how many draws that took.

        Raises:
            ParameterError: Hardly any state of the domain has an index of 0.
        """
        found: list[Looks] = []
        count, tries = 0, 0
        batch = min(_DRAWS, 8 * states)
        while count < states:
            looks = self.look(self.draw(rng, batch))
            found.append(looks)
            count, tries = count + len(looks.ahead), tries + batch
            if tries >= _DRAWS and count < min(_RAREST * tries, states):
                raise ParameterError(
                    f"hardly any state of {self.domain} has an index of 0 at {self.capsule}: {count} of {tries} draws"
                )
        everything = Looks(*(np.concatenate(field) for field in zip(*found, strict=True)))
        return everything.pick(np.arange(states)), tries

    def state(self, looks: Looks, which: int) -> BoundaryState:
        """One of many, in words."""
        person = looks.people[which]
        return BoundaryState(
            self.capsule,
            looks.joints[which].copy(),
            person["start"].copy(),
            person["start_velocity"].copy(),
            float(person["radius"]),
            float(looks.ahead[which]),
            float(looks.distance[which]),
            float(looks.rate[which]),
            float(looks.authority[which]),
            float(looks.tip_speed[which]),
        )
