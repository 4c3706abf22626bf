"""What an arm is believed to do: where the applied jerks have led, which readings of the joints only confirm."""

import numpy as np

from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.joints import AGREES, LAGS, MISSING, deviates, judge_joints
from jssa_gym.kernels.joints import FROZEN as READS_FROZEN
from jssa_gym.kernels.motion import integrate, violates
from jssa_gym.kernels.rest import at_rest
from jssa_gym.kernels.stopping import make_plan_representable, plan_stop, stop_jerk, stop_length
from jssa_gym.kernels.vector import copy_rows, fill
from jssa_gym.tick import codes

AGREEMENTS = 5
"""Readings in a row that have to be right after one that was wrong before they are believed again: twice as many each
time that happens anew ..."""

DOUBLINGS = 7
"""... but no more often than this: after five seconds."""

FORGIVEN = 125
"""Readings in a row that were believed, from which on what was wrong before does not count any more."""

PERSISTENT = 10
"""Readings in a row that were wrong, from which on something is wrong for good."""

RELAPSES = 5
"""Times that readings were believed again and were wrong again, likewise."""

ROUNDING = 1e-9
"""Share of the joint limits by which an arm at rest may be beyond them."""


@jit
def forget(memory, e):
    """What was wrong with readings, and what they were."""
    arm = memory.arm[e]
    for row in range(3):
        for j in range(memory.last[e].shape[1]):
            memory.last[e][row, j] = memory.anchor[e][row, j] = np.nan
            for k in range(memory.past[e].shape[0]):
                memory.past[e][k, row, j] = np.nan
    for k in range(memory.offsets[e].shape[0]):
        memory.offsets[e][k] = -np.inf
    arm["newest"] = 0
    arm["owed"] = arm["wrong"] = arm["believed"] = arm["lapses"] = arm["why"] = arm["lag"] = arm["late"] = 0
    arm["offset"], arm["settled"], arm["due"] = 0.0, 0.0, -np.inf


@part
def begin(settings, memory, reading, e):
    """Take the arm to be where a reading (3, n) says: at rest, unless that is exact and says otherwise."""
    expected, exact = memory.expected[e], True
    for j in range(expected.shape[1]):
        # noise in a velocity must not be reckoned with for good
        expected[0, j], expected[1, j], expected[2, j] = reading[0, j], 0.0, 0.0
        for row in range(3):
            exact = exact and settings.tolerance[row, j] == 0.0
    memory.arm[e]["begun"] = not deviates(reading, expected, settings.stop_limits, settings.tolerance)
    if exact and not memory.arm[e]["begun"]:
        copy_rows(reading, expected)
        memory.arm[e]["begun"] = True


@part
def measured(settings, reading):
    """Whether all of a reading (3, n) is finite that has to be measured."""
    for row in range(3):
        for j in range(reading.shape[1]):
            if not (np.isfinite(reading[row, j]) or settings.tolerance[row, j] == np.inf):
                return False
    return True


@jit
def replan(settings, memory, work, e):
    """Store a stop from the expected state; nobody has verified it, unless there is nothing to stop."""
    arm, state, still = memory.arm[e], memory.expected[e], work.halt
    fill(still, 0.0)
    plan_stop(state, settings.stop_limits, settings.dt, memory.stored[e])
    make_plan_representable(memory.stored[e], settings.stop_limits)
    arm["step"], arm["rests"] = 0, False
    arm["verified"] = arm["begun"] and at_rest(state) and not violates(state, still, settings.stop_limits, ROUNDING)


@jit
def go_on(settings, memory, step, state, jerk, e):
    """The stored stop's jerk (n,) at one of its ticks, applied to ``state`` (3, n)."""
    stop_jerk(memory.stored[e], step, jerk)
    integrate(state, jerk, settings.dt, state)


@part
def date(settings, memory, now, readable, e):
    """Compare the clock with the ticks; what is wrong with it goes into ``arm["clock"]``."""
    arm = memory.arm[e]
    arm["ticks"] += 1
    last = arm["time"]
    if not readable:
        arm["clock"] = codes.CLOCK_UNREADABLE
    # the very first reading has none before it
    elif last < now < np.inf or (np.isnan(last) and np.isfinite(now)):
        arm["clock"] = 0
        # no more than a day of ticks at once
        passed = min((now - last) / settings.dt, 1e7) if last < now else 1.0
        arm["offset"] += passed - arm["ticks"]
        arm["time"], arm["ticks"] = now, 0
        ahead = arm["offset"] - arm["settled"]
        arm["late"] = int(np.rint(ahead)) if ahead > 0.5 else 0
    elif not np.isfinite(now):
        arm["clock"] = codes.CLOCK_NOT_FINITE
    else:
        if not settings.paced:
            # what is of an earlier tick is so until the clock has caught up: an arm at rest looks the same all along
            arm["due"] = max(arm["due"], _most(memory.offsets[e]) - 0.5)
        arm["clock"] = codes.CLOCK_BACK if now < last else codes.CLOCK_STILL


@jit
def _most(offsets):
    most = -np.inf
    for k in range(offsets.shape[0]):
        most = max(most, offsets[k])
    return most


@part
def _lagging(settings, memory, ticks, e):
    arm = memory.arm[e]
    # where the clock shows the same lag, it has to catch up too: an arm at rest looks the same at all times
    if not settings.paced and arm["offset"] <= _most(memory.offsets[e]) - ticks + 0.5:
        arm["due"] = max(arm["due"], arm["offset"] + ticks - 0.5)


@part
def read(settings, memory, scene, e):
    """Take down what is delivered in this tick; why it cannot be used as a code, or 0."""
    date(settings, memory, scene.now[e]["time"], scene.now[e]["timed"], e)
    if not scene.now[e]["joints"]:
        return codes.JOINTS
    if not memory.arm[e]["begun"]:
        if not measured(settings, scene.joints[e]):
            return codes.NOT_FINITE_JOINTS
        begin(settings, memory, scene.joints[e], e)
        if not memory.arm[e]["begun"]:
            return codes.MOVING
    return 0


@part
def judge(settings, memory, scene, form, e):
    """Compare what was read with the expected state; why it is not believed as a code, or 0, and a number of ticks.

    Args:
        form: What :func:`read` answered.
    """
    arm = memory.arm[e]
    code = judge_joints(
        scene.joints[e],
        form == 0,
        memory.expected[e],
        memory.last[e],
        memory.anchor[e],
        memory.past[e],
        arm["newest"],
        settings.stop_limits,
        settings.tolerance,
    )
    arm["newest"] = (arm["newest"] + 1) % memory.past[e].shape[0]
    memory.offsets[e][arm["newest"]] = arm["offset"]
    if code == MISSING:  # nothing false was said, and nothing right
        return (form if form else codes.NOT_FINITE_JOINTS), 0
    if code != AGREES:
        if arm["owed"] == 0:
            arm["lapses"] += 1
        arm["wrong"] += 1
        arm["believed"] = 0
        arm["owed"] = AGREEMENTS << min(arm["lapses"] - 1, DOUBLINGS)
        arm["why"], arm["lag"] = codes.ASTRAY, 0
        if code == READS_FROZEN:
            arm["why"] = codes.FROZEN
        elif code >= LAGS:
            arm["why"], arm["lag"] = codes.LAGS, code - LAGS + 1
            _lagging(settings, memory, arm["lag"], e)
        return arm["why"], arm["lag"]
    arm["wrong"] = 0
    if arm["clock"]:
        return arm["clock"], 0
    if arm["offset"] < arm["due"]:
        ticks = int(np.ceil(arm["due"] - arm["offset"]))
        _lagging(settings, memory, ticks, e)
        return codes.LAGS, ticks
    arm["due"], arm["settled"], arm["late"] = -np.inf, arm["offset"], 0
    if arm["owed"]:
        arm["owed"] -= 1
        if arm["owed"]:
            # right again, but not for long enough: said of why it was wrong
            return -arm["why"], arm["lag"]
    arm["believed"] += 1
    if arm["believed"] >= FORGIVEN:
        arm["lapses"] = 0
    return 0, 0


@part
def timely(memory, e):
    """Whether this tick's scene is of this tick, as far as its clock tells."""
    return memory.arm[e]["clock"] == 0 and memory.arm[e]["offset"] >= memory.arm[e]["due"]


@part
def persistent(memory, e):
    """Whether readings are wrong for so long, or so often, that it is no accident."""
    return memory.arm[e]["wrong"] >= PERSISTENT or memory.arm[e]["lapses"] >= RELAPSES


@part
def catch_up(settings, memory, seen, work, e):
    """Whether an arm went on with the stored stop in the ticks without a decision; the reading ``seen`` (3, n) tells.

    Within a tolerance several numbers of ticks can agree: then the clock decides.
    """
    arm, state, jerk = memory.arm[e], work.spare, work.halt
    late, left = arm["late"], max(stop_length(memory.stored[e]) - arm["step"], 0)
    most = min(late, left + 1)
    copy_rows(memory.expected[e], state)
    for k in range(most):
        go_on(settings, memory, arm["step"] + k, state, jerk, e)
    if _agreed(settings, memory, seen, most, state, e):
        return most == late or at_rest(state)
    copy_rows(memory.expected[e], state)
    for passed in range(most):
        if _agreed(settings, memory, seen, passed, state, e):
            return passed == late or at_rest(state)
        go_on(settings, memory, arm["step"] + passed, state, jerk, e)
    return True


@part
def _agreed(settings, memory, seen, passed, state, e):
    """Whether a reading agrees with a state after some ticks of the stored stop; then that is what is expected."""
    if deviates(seen, state, settings.stop_limits, settings.tolerance):
        return False
    memory.arm[e]["step"] += passed
    copy_rows(state, memory.expected[e])
    return True


@jit
def check_joints(settings, memory, scene, work, e):
    """Compare a reading of the joints with where the applied jerks must have led; what is wrong as a code, and ticks.

    Ticks in which no decision was made, as the clock has it, must have gone on with the stored stop: a reading that
    agrees with that moves the expected state there, no other does.
    """
    arm = memory.arm[e]
    begun = arm["begun"]
    form = read(settings, memory, scene, e)
    if not begun or (arm["step"] != 0 and not arm["rests"] and arm["step"] >= stop_length(memory.stored[e])):
        # there is a first reading, or a stop is over: that of a state that nobody verified may not end in rest
        arm["rests"] = begun and at_rest(memory.expected[e])
        if not arm["rests"]:
            replan(settings, memory, work, e)
    leapt = arm["late"] > 0 and form == 0
    if leapt and not settings.paced:  # who is asked once a tick commands nothing in between
        leapt = not catch_up(settings, memory, scene.joints[e], work, e)
    code, ticks = judge(settings, memory, scene, form, e)
    if leapt and code == 0:
        return codes.LEAPT, 0
    return code, ticks
