r"""The only place that says yes: a jerk is applied if a verified stop follows it, else the stored stop goes on.

Verified means: the step and the stop keep all joint limits, and until the arm is at rest it is off table, static
agents and itself, and off everything that a person can have reached by then. So a verified stop always exists: the
rest of the last one.
"""

import numpy as np

from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.motion import integrate, make_representable, representable
from jssa_gym.kernels.occupancy import confine_people
from jssa_gym.kernels.stopping import make_plan_representable, plan_stop, stop_jerk
from jssa_gym.kernels.vector import copy, copy_rows
from jssa_gym.kernels.verification import (
    LIMITS,
    SAFE,
    Around,
    StepAndStop,
    keeps_clear,
    keeps_limits,
    load_fixtures,
    load_people,
)
from jssa_gym.tick import codes

WANTED, HALFWAY, STORED = range(3)
"""Which jerk was chosen: what was proposed, one half way to the stored stop's, or the stored stop's."""


@jit
def unfit_answer(jerk, nominal, forwarded, limit, work):
    """What is wrong with a proposed jerk: 0 nothing, 1 not finite, 2 outside the box, 3 not the nominal it claims.

    It becomes what an environment integrates, a share of the bound times the bound, unless it is the nominal.
    """
    for j in range(jerk.shape[0]):
        u = jerk[j]
        if not np.isfinite(u):
            return 1
        if not work.lower[j] <= u <= work.upper[j]:
            return 2
        if forwarded and u != nominal[j]:
            return 3
        if not forwarded:
            jerk[j] = representable(u, limit[j])
    return 0


@jit
def take_fixtures(memory, scene, e):
    """Take down what stands still, or compare it with what stood there at first; what is wrong with it, or 0."""
    if not scene.now[e]["fixtures"]:
        return codes.SCENE, 0
    wrong = load_fixtures(
        scene.static_ends[e][0], scene.static_ends[e][1], scene.static_radius[e], scene.normal[e], scene.offset[e],
        memory.statics[e], memory.planes[e], not memory.arm[e]["fixed"],
    )  # fmt: skip
    if wrong:
        return codes.SCENE, wrong
    memory.arm[e]["fixed"] = True
    return 0, 0


@jit
def keeps_safe(robot, settings, memory, jerk, work, e):
    """Whether the stop after one step at ``jerk`` (n,) is verified, into ``work.next``.

    Returns:
        ``SAFE``, or what is in the way: its code, the robot's capsule, the other's number, the time of contact [s].
    """
    state = memory.state[e]
    integrate(state, jerk, settings.dt, work.after)
    ticks = plan_stop(work.after, settings.stop_limits, settings.dt, work.next)
    make_plan_representable(work.next, settings.stop_limits)
    if not keeps_limits(state, jerk, work.after, work.next, settings.stop_limits, settings.dt):
        return LIMITS, -1, -1, 0.0
    motion = StepAndStop(state, jerk, work.after, work.next, settings.dt)
    around = Around(
        work.grown, work.reach, memory.growth[e], memory.touch[e], work.confined, memory.statics[e], memory.planes[e],
        settings.astray,
    )  # fmt: skip
    return keeps_clear(robot, motion, ticks, around, work)


@jit
def choose(robot, settings, memory, wanted, jerk, work, e):
    """The first verified one of: the wanted jerk, the jerk half way to the stored stop's, the stored stop's.

    Into ``jerk`` (n,), the state after it into ``work.after``, the stop from there into ``work.next``: for the stored
    stop's that holds nothing of use.

    Returns:
        Which one (0, 1, 2); then code, robot capsule, other's number and time of what stood in the first one's way.
    """
    step = memory.arm[e]["step"]
    copy(wanted, jerk)
    why, row, column, moment = keeps_safe(robot, settings, memory, jerk, work, e)
    if why == SAFE:
        return WANTED, why, row, column, moment
    stop_jerk(memory.stored[e], step, jerk)
    for j in range(jerk.shape[0]):
        jerk[j] = representable((jerk[j] + wanted[j]) / 2.0, settings.stop_limits[4, j])
    code, _, _, _ = keeps_safe(robot, settings, memory, jerk, work, e)
    if code == SAFE:
        return HALFWAY, why, row, column, moment
    stop_jerk(memory.stored[e], step, jerk)
    integrate(memory.state[e], jerk, settings.dt, work.after)
    return STORED, why, row, column, moment


@part
def confirm(robot, settings, memory, work, answer, e):
    """Look at the proposed jerk, ``answer.jerk``, which becomes the one to apply.

    What stands in the way concerns one capsule, and only the joints that carry it. Before all joints are slowed
    down, another jerk is asked for, once, with which only these go on with the stored stop: a hand near the base
    shall not keep the arm from folding away.

    Returns:
        0, or the number of joints, counted from the base, that have to go on with the stored stop's jerk, which is
        ``work.halt``: then another jerk has to be proposed and :func:`confirm_held`; until then ``answer.jerk`` is
        still the first.
    """
    told, n = answer.told[e], answer.jerk.shape[1]
    error = settings.position_error + settings.astray
    load_people(
        work.people[0], work.people[1], work.radius, memory.growth[e], work.age, settings.lag, error,
        work.grown, work.reach,
    )  # fmt: skip
    confine_people(work.people, work.age, settings.lag, error, memory.tracks[e], work.confined)
    which, code, row, column, moment = choose(robot, settings, memory, answer.jerk[e], work.jerk, work, e)
    told["detail"], told["capsule"], told["other"], told["moment"] = code, row, column, moment
    told["chosen"] = which
    if which == WANTED:
        return 0
    stop_jerk(memory.stored[e], memory.arm[e]["step"], work.halt)
    carried = robot.capsules[row]["link"] + 1 if row >= 0 else n
    if carried < n:
        return carried
    confirm_last(robot, settings, memory, work, answer, e)
    return 0


@part
def confirm_held(robot, settings, memory, work, answer, e):
    """Look at another jerk, ``work.wanted``, with which the joints in the way go on with the stored stop."""
    make_representable(work.wanted, robot.limits[4])
    which, _, _, _, _ = choose(robot, settings, memory, work.wanted, work.jerk, work, e)
    # whatever it is, it is not what was proposed
    answer.told[e]["chosen"] = max(which, HALFWAY)
    if which == STORED:
        confirm_last(robot, settings, memory, work, answer, e)


@part
def confirm_last(robot, settings, memory, work, answer, e):
    """The stop of an arm that was found in motion: perhaps it can be verified by now."""
    if answer.told[e]["chosen"] == STORED and not memory.arm[e]["verified"]:
        which, _, _, _, _ = choose(robot, settings, memory, work.halt, work.jerk, work, e)
        answer.told[e]["chosen"] = STORED if which == STORED else HALFWAY


@jit
def store_stop(memory, work, answer, e):
    """Go on with what was confirmed: its stop is the stored one from now on, or the stored one goes on."""
    arm = memory.arm[e]
    if answer.told[e]["chosen"] == STORED:
        arm["step"] += 1
    else:
        for j in range(work.next.shape[0]):
            memory.stored[e, j] = work.next[j]
        arm["step"], arm["verified"], arm["rests"] = 0, True, False
    copy_rows(work.after, memory.expected[e])
    copy(work.jerk, answer.jerk[e])
