"""Which joints of a file make an arm, and which have to stand still for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jssa_gym.exceptions import ParameterError, RobotModelError
from jssa_gym.robots.findings import FileFinding, obstacle, repaired
from jssa_gym.robots.reading import endless
from jssa_gym.robots.serial import called
from jssa_gym.types import Array

if TYPE_CHECKING:
    import mujoco

_JAWS = ("gripper", "jaw", "finger", "claw", "thumb", "grasp")
"""Words in the names of joints that open and close something."""

_LONG = 3
"""Joints from which a branch can be the arm that others branch off from."""

ALL = "all"
"""Name that stands for every joint that has to be frozen."""


@dataclass(frozen=True, slots=True)
class Chain:
    """Joints of a file by what becomes of them."""

    joints: tuple[int, ...]
    """Ids of the arm's hinges, base to tip."""
    frozen: tuple[int, ...]
    """Ids of all others: they stay where they are."""
    findings: tuple[FileFinding, ...]


def find_chain(
    model: "mujoco.MjModel", freeze: Sequence[str] = (), keep: Sequence[str] = (), tip: str | None = None
) -> Chain:
    """Find the chain of hinges from the base up to the first branch.

    What is no hinge, and what lies beyond the branch, has to be frozen; so has, unless it is kept, a last hinge that
    looks like a jaw. A branch with at least three hinges and more than twice as many as any other carries the arm on:
    springs and rods beside it do not end it. Where none is, and more hinges follow than there were before, it has to be
    said which is the arm; the longest is looked at meanwhile.

    Args:
        model: The compiled file.
        freeze: Names of joints that may be frozen; ``all`` for whatever has to be.
        keep: Names of hinges that are no jaws.
        tip: Name of a body: the chain is the one that leads to it.

    Raises:
        ParameterError: A name is none of the file.
        RobotModelError: No hinge is left, or none carries the tip.
    """
    import mujoco

    hinge = mujoco.mjtJoint.mjJNT_HINGE
    named = {name_of(model, j): j for j in range(model.njnt)}
    for name in (*freeze, *keep):
        if name not in named and name != ALL:
            raise ParameterError(f"no joint '{name}'; there are {', '.join(named) or 'none'}")
    asked = {named[name] for name in freeze if name != ALL}
    free = ALL in freeze
    hinges = [j for j in range(model.njnt) if model.jnt_type[j] == hinge and j not in asked]
    if not hinges:
        raise RobotModelError("the file has no hinge joint that may move; expected a serial arm of hinges")
    joints, findings = _to_tip(model, hinges, tip) if tip else _to_branch(model, hinges)
    if not joints:
        raise RobotModelError(f"no hinge carries body '{tip}'; arms end at {_ends(model, hinges)}")
    jaw = None if tip else _jaw(model, joints, keep)
    if jaw is not None and free:
        findings.append(repaired(_joint(model, jaw), "looks like a jaw" + _referring(model, jaw), "it is frozen"))
        joints = joints[:-1]
    elif jaw is not None:
        name = name_of(model, jaw)
        text = "is the last hinge and looks like a jaw, which would be one more joint of the arm"
        findings.append(obstacle(_joint(model, jaw), text, f"give --freeze {name}, or --keep {name}"))
    frozen = [j for j in range(model.njnt) if j not in joints]
    for j in frozen:
        if j == jaw:
            continue  # of which has been said all
        text = f"is a {mujoco.mjtJoint(model.jnt_type[j]).name[6:].lower()}"
        text += " beyond the arm's last joint or beside the arm" if model.jnt_type[j] == hinge else ""
        text += _referring(model, j)
        if free or j in asked:
            findings.append(repaired(_joint(model, j), text, f"frozen at {_rest(model, j)}"))
        else:
            findings.append(obstacle(_joint(model, j), text, f"give --freeze {name_of(model, j)}, or --freeze all"))
    findings += _couplings(model, joints)
    findings += [endless(name_of(model, j)) for j in joints if not model.jnt_limited[j]]
    return Chain(tuple(joints), tuple(frozen), tuple(findings))


def name_of(model: "mujoco.MjModel", joint: int) -> str:
    """A joint's name, or what stands for it."""
    return model.joint(joint).name or f"joint {joint}"


def ranges(model: "mujoco.MjModel", joints: Sequence[int]) -> Array:
    """Position ranges, one turn in each direction where there is none, shape (n, 2) [rad]."""
    turn = 2.0 * np.pi
    return np.array([model.jnt_range[j] if model.jnt_limited[j] else (-turn, turn) for j in joints], float)


def _joint(model: "mujoco.MjModel", j: int) -> str:
    import mujoco

    return called(model, mujoco.mjtObj.mjOBJ_JOINT, j)


def _rest(model: "mujoco.MjModel", j: int) -> str:
    first = model.jnt_qposadr[j]
    count = (7, 4, 1, 1)[model.jnt_type[j]]
    return ", ".join(f"{value:.4g}" for value in model.qpos0[first : first + count])


def _above(model: "mujoco.MjModel", body: int) -> list[int]:
    """A body and all that carry it, the outermost first."""
    way = []
    while body:
        way.append(int(body))
        body = model.body_parentid[body]
    return way[::-1]


def _to_tip(model: "mujoco.MjModel", hinges: list[int], tip: str) -> tuple[list[int], list[FileFinding]]:
    bodies = {model.body(b).name: b for b in range(1, model.nbody)}
    if tip not in bodies:
        raise ParameterError(f"no body '{tip}'; there are {', '.join(filter(None, bodies))}")
    way = set(_above(model, bodies[tip]))
    return [j for j in hinges if int(model.jnt_bodyid[j]) in way], []


def _to_branch(model: "mujoco.MjModel", hinges: list[int]) -> tuple[list[int], list[FileFinding]]:
    """Follow hinges from body to body until several ways lead on and none of them is the arm."""
    below: dict[int, list[int]] = {}
    for body in range(1, model.nbody):
        below.setdefault(int(model.body_parentid[body]), []).append(body)
    own: dict[int, list[int]] = {}
    for j in hinges:
        own.setdefault(int(model.jnt_bodyid[j]), []).append(j)
    depth = dict.fromkeys(range(model.nbody), 0)
    for body in range(model.nbody - 1, 0, -1):  # a body comes after the one that carries it
        parent = int(model.body_parentid[body])
        depth[parent] = max(depth[parent], depth[body] + len(own.get(body, [])))
    joints: list[int] = []
    body, findings = 0, []
    while True:
        reach = sorted(((depth[b] + len(own.get(b, [])), b) for b in below.get(body, [])), reverse=True)
        reach = [one for one in reach if one[0]]
        if not reach:
            return joints, findings
        (longest, onward), *others = reach
        if others:
            best, left = others[0][0], ", ".join(f"'{model.body(b).name}'" for _, b in others)
            by_far = longest >= max(_LONG, 2 * best + 1) and not _looks(model, own.get(onward, []))
            if not by_far and longest <= len(joints):
                return joints, findings
            subject = f"body '{model.body(onward).name}'"
            text = f"is taken for the arm: {longest} hinges follow it, at most {best} each follow {left}"
            if by_far:
                findings.append(FileFinding(subject, text, "give --tip BODY for another one"))
            else:
                text = f"is one of several arms that branch off: {longest} hinges follow it, at most {best} {left}"
                advice = f"give --tip BODY, the last body of one: {_ends(model, hinges)}"
                findings.append(obstacle(subject, text, advice))
        body = onward
        joints += own.get(body, [])


def _ends(model: "mujoco.MjModel", hinges: list[int]) -> str:
    last = [int(model.jnt_bodyid[j]) for j in hinges]
    carried = {body for b in last for body in _above(model, b)[:-1]}
    return ", ".join(f"'{model.body(b).name}'" for b in dict.fromkeys(last) if b not in carried)


def _jaw(model: "mujoco.MjModel", joints: list[int], keep: Sequence[str]) -> int | None:
    """The last hinge if its name, or that of its body, is one of a jaw's."""
    last = joints[-1]
    return last if len(joints) > 1 and _looks(model, [last]) and name_of(model, last) not in keep else None


def _looks(model: "mujoco.MjModel", joints: Sequence[int]) -> bool:
    """Whether one of some joints, or its body, has a jaw's name."""
    names = [f"{model.joint(j).name} {model.body(model.jnt_bodyid[j]).name}".casefold() for j in joints]
    return any(word in name for name in names for word in _JAWS)


def _referring(model: "mujoco.MjModel", joint: int) -> str:
    """What refers to a joint and goes with it."""
    import mujoco

    kinds, body = mujoco.mjtObj, int(model.jnt_bodyid[joint])
    found = []
    for t in range(model.ntendon):
        path = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
        if any(model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT and model.wrap_objid[w] == joint for w in path):
            found.append(called(model, kinds.mjOBJ_TENDON, t))
    for e in range(model.neq):
        ends = (model.eq_obj1id[e], model.eq_obj2id[e])
        about = joint if model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT else body
        if model.eq_type[e] != mujoco.mjtEq.mjEQ_TENDON and about in ends:
            found.append(called(model, kinds.mjOBJ_EQUALITY, e))
    for a in range(model.nu):
        if model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT and model.actuator_trnid[a, 0] == joint:
            found.append(called(model, kinds.mjOBJ_ACTUATOR, a))
    for s in range(model.nsensor):
        if model.sensor_objtype[s] == kinds.mjOBJ_JOINT and model.sensor_objid[s] == joint:
            found.append(called(model, kinds.mjOBJ_SENSOR, s))
    return f", with {', '.join(found)} that refer to it" if found else ""


def _couplings(model: "mujoco.MjModel", joints: Sequence[int]) -> list[FileFinding]:
    """What ties the arm's joints to each other or to the world: then they do not move independently."""
    import mujoco

    kinds, found = mujoco.mjtObj, []
    carried = {body for j in joints for body in [int(model.jnt_bodyid[j])]}
    moved = {b for b in range(1, model.nbody) if carried & set(_above(model, b))}
    advice = "an arm whose joints are tied cannot be modelled; freeze one of them"
    for e in range(model.neq):
        kind, ends = mujoco.mjtEq(model.eq_type[e]), [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]
        name = called(model, kinds.mjOBJ_EQUALITY, e)
        if kind == mujoco.mjtEq.mjEQ_JOINT and (tied := [j for j in ends if j in joints]):
            found.append(obstacle(name, f"ties {' and '.join(_joint(model, j) for j in tied)}", advice))
        elif kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            bodies = _tied_bodies(model, e)
            names = " and ".join(called(model, kinds.mjOBJ_BODY, b) for b in bodies)
            if not moved & set(bodies) or _alike(model, bodies, joints):
                continue
            if any(model.body_mocapid[b] >= 0 or _floats(model, b) for b in bodies):
                found.append(repaired(name, f"ties {names}, which no arm carries", "it is left out"))
            else:
                found.append(obstacle(name, f"ties {names}", advice))
    for t in range(model.ntendon):
        path = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
        wraps = [int(model.wrap_objid[w]) for w in path if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT]
        if model.tendon_limited[t] and (tied := [j for j in wraps if j in joints]):
            text = f"has a range, which ties {' and '.join(_joint(model, j) for j in tied)}"
            found.append(obstacle(called(model, kinds.mjOBJ_TENDON, t), text, advice))
    return found


def _tied_bodies(model: "mujoco.MjModel", equality: int) -> list[int]:
    import mujoco

    ends = [int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])]
    if model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE:
        return [int(model.site_bodyid[s]) for s in ends]
    return [max(body, 0) for body in ends]


def _alike(model: "mujoco.MjModel", bodies: Sequence[int], joints: Sequence[int]) -> bool:
    """Whether the same of the arm's joints move all of these bodies."""
    own = {int(model.jnt_bodyid[j]) for j in joints}
    return len({frozenset(own & set(_above(model, body))) for body in bodies}) == 1


def _floats(model: "mujoco.MjModel", body: int) -> bool:
    import mujoco

    carriers = set(_above(model, body))
    return any(
        model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE and int(model.jnt_bodyid[j]) in carriers
        for j in range(model.njnt)
    )
