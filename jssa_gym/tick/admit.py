r"""The only place that says yes: a jerk is applied if a verified stop follows it; else the stored stop: FAILSAFE.

Verified means: the step and the stop keep all joint limits, and until the arm is at rest it is off table, static
agents and itself, and off everything that a person can have reached by then. So a verified stop always exists: the
rest of the last one.
"""

import numpy as np

from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.margin import clears_people, margin
from jssa_gym.kernels.motion import integrate, make_representable, representable
from jssa_gym.kernels.occupancy import confine_people
from jssa_gym.kernels.stopping import make_plan_representable, plan_stop, stop_jerk, stop_length
from jssa_gym.kernels.vector import copy, copy_rows, same_rows
from jssa_gym.kernels.verification import (
    LIMITS,
    REACH,
    SAFE,
    Around,
    StepAndStop,
    beside_people,
    keeps_clear,
    keeps_limits,
    load_fixtures,
    load_people,
    surely_meets,
)
from jssa_gym.tick import codes
from jssa_gym.tick.region import entered

WANTED, HALFWAY, STORED, GRADED = range(4)
"""Which jerk was chosen: what was proposed, one half way to the stored stop's, the stored stop's, or what was proposed
blended with braking."""

SOFT = 2
"""As many of the softest stops may stand behind an alternative; where there is but one hardness, that one."""

FIRST, SECOND = np.int64(0), np.int64(1)
"""Numbers of the stops, by hardness; not written as 0 and 1, which would be types of their own to a compiled
function."""

EASY = 0.05
"""Room to people from which on what a filter wants is not slowed down for their sake [m], see
:func:`~jssa_gym.kernels.margin.margin`."""


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
def plan_behind(settings, memory, jerk, hardness, work, e):
    """One step at ``jerk`` (n,) into ``work.after``, the stop of a hardness after it into ``work.next``; its ticks."""
    hardest = hardness == settings.hardness.shape[0] - 1
    integrate(memory.state[e], jerk, settings.dt, work.after)
    if hardest and same_rows(work.after, work.hardest_after):  # from there it is the same stop
        for j in range(work.next.shape[0]):
            work.next[j] = work.hardest_next[j]
        return stop_length(work.next)
    ticks = plan_stop(work.after, settings.soft_limits[hardness], settings.dt, work.next)
    make_plan_representable(work.next, settings.stop_limits)
    if hardest:
        copy_rows(work.after, work.hardest_after)
        for j in range(work.next.shape[0]):
            work.hardest_next[j] = work.next[j]
    return ticks


@part
def _seen_by_stop(settings, memory, work, e):
    return Around(
        work.grown, work.reach, memory.growth[e], memory.touch[e], work.confined, memory.statics[e], memory.planes[e],
        settings.astray, settings.faces, settings.pieces, _entered(settings, memory, e), settings.entry_speed,
    )  # fmt: skip


@jit
def _entered(settings, memory, e):
    """How far into the watched region whoever is unseen can have come [m]."""
    since = memory.arm[e]["people_time"] - memory.arm[e]["frame"]
    return entered(settings, since + settings.lag, settings.position_error + settings.astray)


@part
def keeps_safe(robot, settings, memory, jerk, hardness, work, e):
    """:func:`verify`, where nothing is known of the room that the stop leaves to people."""
    return verify(robot, settings, memory, jerk, hardness, np.nan, work, e)


@part
def verify(robot, settings, memory, jerk, hardness, room, work, e):
    """Whether the stop of a hardness after one step at ``jerk`` (n,) is verified, into ``work.next``.

    ``room`` is its margin to people [m], NaN if that is not known: where it is wide they are not looked at again.

    Returns:
        ``SAFE``, or what is in the way: its code, the robot's capsule, the other's number, the time of contact [s].
    """
    ticks = plan_behind(settings, memory, jerk, hardness, work, e)
    return verify_planned(robot, settings, memory, jerk, ticks, room, work, e)


@jit
def verify_planned(robot, settings, memory, jerk, ticks, room, work, e):
    """:func:`verify` of the stop, so many ticks long, that has been planned already (:func:`plan_behind`)."""
    state = memory.state[e]
    # however soft a stop is, the limits that it has to keep are the true ones
    if not keeps_limits(state, jerk, work.after, work.next, settings.stop_limits, settings.dt):
        return LIMITS, -1, -1, 0.0
    motion = StepAndStop(state, jerk, work.after, work.next, settings.dt)
    around = _seen_by_stop(settings, memory, work, e)
    if clears_people(motion, ticks, room, work.quickest[0]):
        around = beside_people(around)
    code, row, column, moment = keeps_clear(robot, motion, ticks, around, work)
    if code == REACH:
        work.met[0], work.met[1] = row, column
    return code, row, column, moment


@part
def _meets_the_same(robot, settings, memory, jerk, work, e):
    """Whether who was in the way of the stop before is surely in that of the one that has been planned."""
    if work.met[0] < 0:
        return False
    motion = StepAndStop(memory.state[e], jerk, work.after, work.next, settings.dt)
    return surely_meets(robot, motion, _seen_by_stop(settings, memory, work, e), work.met[0], work.met[1], work)


@jit
def room_behind(robot, settings, memory, jerk, work, e):
    """Margin of the hardest stop after one step at ``jerk`` (n,) [m], see :func:`~jssa_gym.kernels.margin.margin`."""
    ticks = plan_behind(settings, memory, jerk, settings.hardness.shape[0] - 1, work, e)
    motion = StepAndStop(memory.state[e], jerk, work.after, work.next, settings.dt)
    return margin(robot, motion, ticks, _seen_by_stop(settings, memory, work, e), work)


@jit
def softest(robot, settings, memory, jerk, first, end, work, e):
    """The softest verified stop behind ``jerk`` (n,), of those with hardness numbers from ``first`` up to ``end``.

    Returns:
        Its number, or how many there are in all if none is verified; then what was in the way of the one tried last, as
        of :func:`keeps_safe`.
    """
    code, row, column, moment = LIMITS, -1, -1, 0.0
    for hardness in range(first, end):
        ticks = plan_behind(settings, memory, jerk, hardness, work, e)
        # what is in the way is told of the last one alone
        if hardness + 1 < end and _meets_the_same(robot, settings, memory, jerk, work, e):
            continue
        code, row, column, moment = verify_planned(robot, settings, memory, jerk, ticks, np.nan, work, e)
        if code == SAFE:
            return hardness, code, row, column, moment
    return settings.hardness.shape[0], code, row, column, moment


@jit
def share_of(room):
    """How much of what is wanted counts where the hardest stop leaves so much room to people [m]; at NaN nothing."""
    return min(max(room / EASY, 0.0), 1.0) if room > 0.0 else 0.0


@part
def blend(memory, wanted, share, limits, jerk, e):
    r"""What is wanted, turned towards the stored stop, into ``jerk`` (n,): :math:`u = b + w (u_w - b)`.

    With b the stored stop's jerk and w the share: beside people an arm is slowed down by and by, not all at once, and
    what is left at share 0 is the stop that goes on.
    """
    stop_jerk(memory.stored[e], memory.arm[e]["step"], jerk)
    for j in range(jerk.shape[0]):
        jerk[j] = representable(jerk[j] + share * (wanted[j] - jerk[j]), limits[4, j])


@jit
def _differ(one, other):
    most = 0.0
    for j in range(one.shape[0]):
        most = max(most, abs(one[j] - other[j]))
    return most > 0.0


@jit
def choose(robot, settings, memory, wanted, jerk, room, work, e):
    """The first verified one of: the wanted jerk, one between it and the stored stop's, the stored stop's.

    If there are stops of several hardness, the nominal is applied as it is only before the softest, and what a filter
    wants only where there is room besides; else they are blended with braking (:func:`blend`) by the room that the
    hardest stop leaves, and by how hard a stop has to be. If there is but one, the one between is half way.

    Into ``jerk`` (n,), the state after it into ``work.after``, the stop from there into ``work.next``: for the stored
    stop's that holds nothing of use.

    ``room`` is the margin of ``work.clipped``, NaN if that is not known.

    Returns:
        Which one (see ``WANTED``); then code, robot capsule, other's number and time of what stood in the first one's
        way.
    """
    step, count, share = memory.arm[e]["step"], settings.hardness.shape[0], 1.0
    if count > 1 and _differ(wanted, work.clipped):
        room = room_behind(robot, settings, memory, wanted, work, e)
        share = share_of(room)
    copy(wanted, jerk)
    # with one hardness the stop behind the nominal is the one that the margin is of
    known = room if count == 1 and not _differ(wanted, work.clipped) else np.nan
    why, row, column, moment = verify(robot, settings, memory, jerk, FIRST, known, work, e)
    if why == SAFE and share == 1.0:
        return WANTED, why, row, column, moment
    if count > 1 and why != SAFE:
        hardness, code, other_row, other_column, other_moment = softest(
            robot, settings, memory, jerk, SECOND, count, work, e
        )
        if hardness == count:
            why, row, column, moment, share = code, other_row, other_column, other_moment, 0.0
        else:
            if np.isnan(room):
                room = room_behind(robot, settings, memory, wanted, work, e)
            share = min(share_of(room), (1.0 - settings.hardness[hardness]) / (1.0 - settings.hardness[0]))
    if count > 1 and share > 0.0:
        blend(memory, wanted, share, settings.stop_limits, jerk, e)
        hardness, _, _, _, _ = softest(robot, settings, memory, jerk, FIRST, count, work, e)
        if hardness < count:
            return GRADED, why, row, column, moment
    stop_jerk(memory.stored[e], step, jerk)
    if count == 1:
        for j in range(jerk.shape[0]):
            jerk[j] = representable((jerk[j] + wanted[j]) / 2.0, settings.stop_limits[4, j])
        half, _, _, _ = keeps_safe(robot, settings, memory, jerk, FIRST, work, e)
        if half == SAFE:
            return HALFWAY, why, row, column, moment
    stop_jerk(memory.stored[e], step, jerk)
    integrate(memory.state[e], jerk, settings.dt, work.after)
    return STORED, why, row, column, moment


@jit
def grow_people(settings, memory, work, e):
    """What the stop sees of the people: as they were measured, how far they can have come since, what confines them."""
    error = settings.position_error + settings.astray
    load_people(
        work.people[0], work.people[1], work.radius, memory.growth[e], work.age, settings.lag, error,
        work.grown, work.reach,
    )  # fmt: skip
    confine_people(work.people, work.age, settings.lag, error, memory.tracks[e], work.confined)


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
    which, code, row, column, moment = choose(
        robot, settings, memory, answer.jerk[e], work.jerk, told["margin"], work, e
    )
    told["detail"], told["capsule"], told["other"], told["moment"] = code, row, column, moment
    told["chosen"] = which
    if which in (WANTED, GRADED):
        return 0
    stop_jerk(memory.stored[e], memory.arm[e]["step"], work.halt)
    carried = robot.capsules[row]["link"] + 1 if row >= 0 else n
    if carried < n:
        return carried
    confirm_last(robot, settings, memory, work, answer, e)
    return 0


@part
def admits(robot, settings, memory, jerk, work, answer, e):
    """Whether a soft stop behind ``jerk`` (n,) is verified, which then is the stored one.

    Before a harder one, an arm is better slowed down by and by (:func:`choose`) than let go on until braking jumps.
    """
    soft = min(SOFT, settings.hardness.shape[0])
    _, code, row, column, moment = softest(robot, settings, memory, jerk, FIRST, soft, work, e)
    if code != SAFE:
        return False
    told = answer.told[e]
    told["chosen"], told["detail"] = WANTED, code
    told["capsule"], told["other"], told["moment"] = row, column, moment
    copy(jerk, work.jerk)
    store_stop(memory, work, answer, e)
    return True


@part
def confirm_held(robot, settings, memory, work, answer, e):
    """Look at another jerk, ``work.wanted``, with which the joints in the way go on with the stored stop."""
    make_representable(work.wanted, robot.limits[4])
    which, _, _, _, _ = choose(robot, settings, memory, work.wanted, work.jerk, np.nan, work, e)
    # whatever it is, it is not what was proposed
    answer.told[e]["chosen"] = max(which, HALFWAY)
    if which == STORED:
        confirm_last(robot, settings, memory, work, answer, e)


@part
def confirm_last(robot, settings, memory, work, answer, e):
    """The stop of an arm that was found in motion: perhaps it can be verified by now."""
    if answer.told[e]["chosen"] == STORED and not memory.arm[e]["verified"]:
        # any stop that is verified is better than one that is not, however hard and however little room it leaves
        hardness, _, _, _, _ = softest(robot, settings, memory, work.halt, FIRST, settings.hardness.shape[0], work, e)
        copy(work.halt, work.jerk)
        if hardness < settings.hardness.shape[0]:
            answer.told[e]["chosen"] = HALFWAY
        else:
            integrate(memory.state[e], work.jerk, settings.dt, work.after)


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
