"""The control step of a shield, read from top to bottom.

:func:`decide` is the whole of it. A filter that is not compiled is asked between its parts: after :func:`prepare`, and
once more if :func:`settle` says so. Whether a step is FAILSAFE is decided in ``tick/admit.py``, and named by
:func:`_conclude`.
"""

import numpy as np

from jssa_gym.kernels import verification
from jssa_gym.kernels.capsules import load_agents
from jssa_gym.kernels.chain import forget_present
from jssa_gym.kernels.contact import unsound
from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.motion import brake, integrate, make_representable
from jssa_gym.kernels.vector import copy, copy_rows, fill, fill_rows
from jssa_gym.kernels.viability import jerk_box
from jssa_gym.tick import codes
from jssa_gym.tick.admit import (
    GRADED,
    WANTED,
    admits,
    confirm,
    confirm_held,
    grow_people,
    room_behind,
    store_stop,
    take_fixtures,
    unfit_answer,
)
from jssa_gym.tick.joints import begin, check_joints, forget, go_on, measured, persistent, replan
from jssa_gym.tick.people import check_people, forget_people, people_now
from jssa_gym.tick.propose import clip_to_box, foresee, leaves_alone, meet_people, propose, propose_held

ANSWERED, ASK, CORNERED = range(3)
"""After :func:`prepare`: it is decided; a jerk has to be proposed; the box leaves no choice."""


@part
def decide(arms, nominal, e):
    """The jerk to apply in this step of one arm, and why.

    Take in and check, believe (or not) the people, the viability box, the filter's rows and projection, the verified
    stop.

    Args:
        arms: The arms (:func:`~jssa_gym.tick.structs.arms`): how they are looked after, what their shields remember,
            the present as it is shown, and the result.
        nominal: The policy's jerk, shape (n,) [rad/s³].
        e: Which arm: an entry of memory, scene and answer.
    """
    robot, settings, memory, scene = arms.robot, arms.settings, arms.memory, arms.scene
    work, answer = arms.work, arms.answer
    stage = prepare(robot, settings, memory, scene, nominal, work, answer, e)
    if stage == ANSWERED:
        return
    if stage == ASK:
        fault = meet_people(arms, e)
        if fault == 0 and take_alternative(arms, nominal, e):
            return
        propose(arms, nominal, fault, e)
    held = settle(robot, settings, memory, scene, nominal, work, answer, e)
    if held > 0:  # so many joints, from the base, have to go on with the stored stop; the others may do something else
        propose_held(arms, nominal, held, e)
        settle_held(robot, settings, memory, work, answer, e)
    if answer.told[e]["chosen"] > WANTED and not np.isnan(answer.told[e]["phi"]):
        foresee(arms, e)


@part
def prepare(robot, settings, memory, scene, nominal, work, answer, e):
    """Look at the present, decide what is to be believed of it, and make the box.

    Returns:
        ``ANSWERED``, something failed and the arm stops; ``ASK`` or ``CORNERED``, and then ``work`` has the people
        for rows, the box, and the nominal in it.
    """
    _clear(answer.told[e])
    _begin(work)
    if settings.guarded:
        fault = _believed_present(settings, memory, scene, nominal, work, answer, e)
    else:
        fault = _shown_present(settings, memory, scene, nominal, work, e)
    if fault:
        stop(robot, settings, memory, work, answer, fault, e)
        return ANSWERED
    room = True
    if settings.viability:
        room = jerk_box(memory.state[e], robot.limits, settings.dt, work.lower, work.upper)
    else:
        _jerk_bounds(robot, work)
    answer.told[e]["inside"] = clip_to_box(nominal, work)
    if settings.guarded:
        grow_people(settings, memory, work, e)
        answer.told[e]["margin"] = room_behind(robot, settings, memory, work.clipped, work, e)
    if room:
        return ASK
    copy(work.clipped, work.wanted)
    told = answer.told[e]
    told["status"], told["code"], told["slack"] = codes.RELAXED, codes.CORNERED, 0.0
    return CORNERED


@jit
def take_alternative(arms, nominal, e):
    """Apply the first of a planner's alternatives that the filter would leave alone and that a verified stop follows.

    Returns:
        Whether there is one; if not, nothing is decided and ``work.clipped`` is the nominal again.
    """
    robot, settings, memory, work, answer = arms.robot, arms.settings, arms.memory, arms.work, arms.answer
    told, offered = answer.told[e], arms.scene.alternatives[e]
    count = min(arms.scene.now[e]["alternatives"], offered.shape[0])
    if count <= 0:
        return False
    if settings.guarded and take_fixtures(memory, arms.scene, e)[0]:
        return False
    for choice in range(count):
        jerk = offered[choice]
        copy(jerk, work.clipped)
        if unfit_answer(work.clipped, jerk, False, robot.limits[4], work) or not leaves_alone(arms, jerk, told, e):
            continue
        if settings.guarded and not admits(robot, settings, memory, work.clipped, work, answer, e):
            continue
        copy(work.clipped, answer.jerk[e])
        copy(work.clipped, memory.applied[e])
        memory.arm[e]["resume"] = np.nan  # the filter lets it go on
        told["status"], told["code"], told["choice"], told["inside"] = codes.NOMINAL, 0, choice, True
        return True
    told["inside"] = clip_to_box(nominal, work)
    return False


@part
def settle(robot, settings, memory, scene, nominal, work, answer, e):
    """Apply the proposed jerk, ``work.wanted``, if it is sound and, where there is one, the verified stop admits it.

    Returns:
        0, it is decided; else the number of joints, counted from the base, that have to go on with the stored stop's
        jerk, ``work.halt``: another jerk has to be proposed to :func:`settle_held`.
    """
    told = answer.told[e]
    fault = told["code"] if told["status"] == codes.FAULT else 0
    if fault == 0:
        wrong = unfit_answer(work.wanted, nominal, told["status"] == codes.NOMINAL, robot.limits[4], work)
        if wrong:
            fault, told["detail"] = codes.ANSWER, wrong
    if fault == 0 and settings.guarded:
        fault, told["detail"] = take_fixtures(memory, scene, e)
    if fault:
        stop(robot, settings, memory, work, answer, fault, e)
        return 0
    copy(work.wanted, answer.jerk[e])
    if settings.guarded:
        held = confirm(robot, settings, memory, work, answer, e)
        if held > 0:
            return held
        _conclude(robot, settings, memory, work, answer, e)
    copy(answer.jerk[e], memory.applied[e])
    return 0


@part
def settle_held(robot, settings, memory, work, answer, e):
    """Apply the other jerk, ``work.wanted``, that was proposed, if the verified stop admits it."""
    confirm_held(robot, settings, memory, work, answer, e)
    _conclude(robot, settings, memory, work, answer, e)
    copy(answer.jerk[e], memory.applied[e])


@jit
def stop(robot, settings, memory, work, answer, fault, e):
    """Go on with the stored stop or, without one, brake: something failed, which the code ``fault`` names."""
    told, jerk = answer.told[e], answer.jerk[e]
    told["status"], told["code"], told["chosen"], told["margin"] = codes.FAULT, fault, -1, np.nan
    told["phi"], told["distance"], told["slack"] = np.nan, np.nan, np.nan
    told["row"], told["column"], told["rows"] = -1, -1, 0
    if settings.guarded:
        told["unverified"] = not memory.arm[e]["verified"]
        copy_rows(memory.expected[e], memory.state[e])
        go_on(settings, memory, memory.arm[e]["step"], memory.expected[e], jerk, e)
        memory.arm[e]["step"] += 1
    else:
        _jerk_bounds(robot, work)
        brake(memory.state[e], work.lower, work.upper, settings.dt, jerk)
        make_representable(jerk, robot.limits[4])
    for j in range(jerk.shape[0]):
        # a state beyond all bounds can overflow; then at least nothing is added
        if not np.isfinite(jerk[j]):
            jerk[j] = 0.0
        memory.applied[e, j] = jerk[j]


# ---- their parts -----------------------------------------------------------------------------------


@jit
def _clear(told):
    """Nothing is decided yet: who says nothing has failed."""
    told["status"], told["code"], told["detail"], told["ticks"] = codes.FAULT, codes.FAILED, 0, 0
    told["capsule"], told["other"], told["moment"], told["chosen"] = -1, -1, 0.0, -1
    told["unverified"], told["persistent"], told["inside"], told["fresh"] = False, False, False, False
    told["phi"], told["distance"], told["slack"] = np.nan, np.nan, np.nan
    told["row"], told["column"], told["rows"] = -1, -1, 0
    told["margin"], told["choice"] = np.inf, -1


@part
def _begin(work):
    """Nothing of the tick before is known any more."""
    forget_present(work)
    work.met[0], work.met[1], work.hardest_after[0, 0] = -1, -1, np.nan


@part
def _jerk_bounds(robot, work):
    for j in range(work.upper.shape[0]):
        work.lower[j], work.upper[j] = -robot.limits[4, j], robot.limits[4, j]


@part
def _believed_present(settings, memory, scene, nominal, work, answer, e):
    """The arm is where the applied jerks led, if its readings agree; people are where they were last trusted.

    Returns a fault's code, or 0 and then ``memory.state`` and ``work.agents`` are the present.
    """
    told = answer.told[e]
    fault, told["ticks"] = check_joints(settings, memory, scene, work, e)
    told["persistent"] = fault not in (0, codes.LEAPT) and persistent(memory, e)
    # people are looked at whatever the joints do: their clock goes on
    missing = check_people(settings, memory, scene, work, answer, e)
    if fault == 0:
        fault = missing
    if fault == 0:
        copy_rows(memory.expected[e], memory.state[e])
        people_now(memory, work, answer, e)
        fault = _not_finite(memory.state[e], nominal, work.agents[: memory.tracks.shape[1]])
    return fault


@jit
def _shown_present(settings, memory, scene, nominal, work, e):
    """What is shown is the present. Returns a fault's code, or 0; ``memory.state`` and ``work.agents`` are it."""
    agents, fault = work.agents[: memory.tracks.shape[1]], codes.JOINTS
    if scene.now[e]["joints"]:
        fault = _not_finite(scene.joints[e], nominal, agents[:0])
        if fault == 0 and not scene.now[e]["people"]:
            fault = codes.SCENE
        elif fault == 0:
            load_agents(scene.ends[e][0], scene.ends[e][1], scene.ends[e][2], scene.ends[e][3], scene.radius[e], agents)
            fault = _not_finite(scene.joints[e], nominal, agents)
            for k in range(scene.valid.shape[1]):
                if fault == 0 and not scene.valid[e, k]:
                    fault = codes.UNMEASURED
    if fault in (codes.JOINTS, codes.NOT_FINITE_JOINTS):
        # nobody knows where the arm is: where the last jerk must have led
        integrate(memory.state[e], memory.applied[e], settings.dt, memory.state[e])
    else:
        copy_rows(scene.joints[e], memory.state[e])
    return fault


@jit
def _not_finite(state, nominal, agents):
    """Which input is not finite, as a code, or 0."""
    wrong = unsound(state, nominal, agents)
    return codes.NOT_FINITE_NOMINAL + wrong - 1 if wrong else 0


@part
def _conclude(robot, settings, memory, work, answer, e):
    """Store the stop, and say what has decided.

    The proposal itself keeps its status. Another jerk, or the stored stop's, is FAILSAFE; where even that is a stop
    that nobody has verified, FAULT.
    """
    told = answer.told[e]
    store_stop(memory, work, answer, e)
    if told["chosen"] == WANTED:
        return
    what = told["detail"]
    told["slack"] = np.nan
    if told["chosen"] == GRADED and what == verification.SAFE:
        return  # nothing is in the way: what the filter wants, slowed down where there is little room
    told["status"], told["code"] = codes.FAILSAFE, codes.MEETS
    if what == verification.LIMITS:
        told["code"] = codes.LIMITS
    elif what == verification.UNDECIDED:
        told["code"] = codes.UNDECIDED
    elif what == verification.REACH:
        told["code"] = codes.REACH
    elif what == verification.ENTRY:
        told["code"] = codes.ENTRY
    elif what == verification.SAFE:
        told["code"] = codes.CROWDED
    if not memory.arm[e]["verified"]:
        told["status"], told["unverified"] = codes.FAULT, True


@jit
def start(settings, memory, scene, work, e):
    """Forget the past: a new episode begins with what is shown. People are whoever will be shown first."""
    arm, state = memory.arm[e], memory.state[e]
    fill(memory.applied[e], 0.0)
    for row in range(3):
        for j in range(state.shape[1]):
            x = scene.joints[e, row, j]
            # the first decision says what is wrong with it
            state[row, j] = x if scene.now[e]["joints"] and np.isfinite(x) else 0.0
    arm["begun"], arm["time"], arm["ticks"], arm["clock"] = False, np.nan, 0, 0
    forget(memory, e)
    fill_rows(memory.expected[e], 0.0)
    if scene.now[e]["joints"] and measured(settings, scene.joints[e]):
        begin(settings, memory, scene.joints[e], e)
    forget_people(memory, e)
    arm["fixed"], arm["resume"] = False, np.nan
    replan(settings, memory, work, e)
