"""What is shown of a prepared arm before it is used: motion, cover, episodes beside a person, reach and authority."""

from dataclasses import dataclass

import numpy as np

from jssa_gym.envs.arm import MOVING, ArmEnv
from jssa_gym.evaluation.judge import judge
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.kernels.chain import forward, jacobian, place
from jssa_gym.kernels.records import FRAME, SEGMENT, records
from jssa_gym.policies import POLICIES
from jssa_gym.robots import RobotModel
from jssa_gym.robots.coverage import TOLERATED
from jssa_gym.robots.prepare import Examination
from jssa_gym.robots.prepare.agreement import cover_of, kinematic_error
from jssa_gym.robots.prepare.posture import some_postures
from jssa_gym.shields import JSSAShield
from jssa_gym.types import Array

STEPS = 500
"""Control steps of an episode that is played as a proof."""

OPPONENTS = ("random", "bang_bang", "wander")
"""Policies of these episodes: jerks drawn in every step, jerks at their bounds, and one that goes about."""


@dataclass(frozen=True, slots=True)
class Episode:
    """One shielded episode beside a person who goes for the arm."""

    policy: str
    moving_contacts: int
    """As MuJoCo counts them at 1 kHz."""
    limit_violations: int
    """Control steps in which a limit was exceeded."""
    collisions: int
    """Overlaps of the arm with itself or the table, as MuJoCo sees them."""
    agrees: bool
    """Whether MuJoCo finds the distances, contacts and states that were recorded."""
    travelled: float
    """How far the joints went together [rad]."""


@dataclass(frozen=True, slots=True)
class Ability:
    """What one capsule can do."""

    name: str
    joint: str
    """Joint that moves it last."""
    reach: float
    """Farthest that a point of it was from the first joint's axis in the postures looked at [m]."""
    authority: float
    """Median over these postures of the largest jerk that the joints can give its farther end [m/s³]."""


@dataclass(frozen=True, slots=True)
class Proof:
    """All that was shown."""

    kinematic_error: float
    """Largest distance of joints and axes from MuJoCo's on the file itself [m]."""
    uncovered: float
    """Farthest point of what the file draws of a link outside of its capsules in the model as it is read [m]."""
    parts: tuple[Ability, ...]
    episodes: tuple[Episode, ...]

    @property
    def holds(self) -> bool:
        """Whether the arm moves as its file says and kept the promise in every episode."""
        kept = all(
            one.agrees and not (one.moving_contacts or one.limit_violations or one.collisions) for one in self.episodes
        )
        return self.kinematic_error <= 1e-12 and self.uncovered <= TOLERATED and kept


def prove(arm: Examination, robot: RobotModel, steps: int = STEPS, opponents: tuple[str, ...] = OPPONENTS) -> Proof:
    """Compare a prepared arm with its file, and play shielded episodes beside ``pursuit``.

    Args:
        arm: The examined file.
        robot: The model that was written and read again, where its file puts it.
        steps: Of every episode.
        opponents: Names of policies, one episode each.
    """
    return Proof(
        kinematic_error(arm, robot),
        cover_of(arm, robot),
        _parts(robot),
        tuple(_play(robot, name, seed, steps) for seed, name in enumerate(opponents)),
    )


def _play(robot: RobotModel, policy: str, seed: int, steps: int) -> Episode:
    base = ArmEnv("home", human="pursuit", robot=robot, terminate_on=())
    env = JSSAShield(base)
    trace = rollout(env, POLICIES[policy](env, seed), seed=seed, steps=steps)
    seen = judge(trace, base.robot)
    env.close()
    return Episode(
        policy,
        sum(contact.speed > MOVING for contact in seen.contacts),
        int(trace.limit_violation.sum()),
        len(seen.self_collisions) + len(seen.plane_collisions),
        seen.same_course,
        float(np.abs(np.diff(trace.position, axis=0)).sum()),
    )


def _parts(robot: RobotModel) -> tuple[Ability, ...]:
    n, m = robot.n, len(robot.capsules)
    frames, segments, J = records(n, FRAME), records(m, SEGMENT), np.zeros((3, n))
    postures = some_postures(robot.limits.position)[:200]
    axis, along = robot.links["offset"][0], robot.links["rotation"][0] @ robot.links["axis"][0]
    reach, authority = np.zeros((len(postures), m)), np.zeros((len(postures), m))
    for k, posture in enumerate(postures):
        forward(robot.links, np.array([posture, np.zeros(n), np.zeros(n)]), frames)
        place(frames, robot.capsules, segments)
        for i, segment in enumerate(segments):
            ends = np.array([segment["start"], segment["end"]])
            away = [_aside(end - axis, along) for end in ends]
            far = int(np.argmax(away))
            reach[k, i] = away[far] + segment["radius"]
            J[:] = 0.0
            jacobian(frames, int(segment["link"]), ends[far].copy(), J)
            authority[k, i] = _most(J, robot.limits.jerk)
    return tuple(
        Ability(name, robot.joint_names[int(link)], float(far), float(most))
        for name, link, far, most in zip(
            robot.capsule_names, robot.capsules["link"], reach.max(axis=0), np.median(authority, axis=0), strict=True
        )
    )


def _aside(point: Array, axis: Array) -> float:
    return float(np.linalg.norm(point - (point @ axis) * axis))


def _most(J: Array, jerk: Array) -> float:
    """Largest length of J u over the box of jerks, looked for along the directions of the joints' own effects."""
    directions = [column / size for column in J.T if (size := np.linalg.norm(column)) > 1e-9]
    return max((float(np.abs(way @ J) @ jerk) for way in directions), default=0.0)
