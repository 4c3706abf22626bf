"""Arms one after the other: the only loop in which they decide; how they move is in ``moves``."""

from jssa_gym.kernels.jit import jit
from jssa_gym.tick import decide as step
from jssa_gym.tick import propose as proposing
from jssa_gym.tick.decide import decide
from jssa_gym.tick.joints import forget, replan


@jit
def decide_all(arms, nominal, asked):
    """:func:`~jssa_gym.tick.decide.decide` for every arm of :func:`~jssa_gym.tick.structs.arms` that is asked.

    Args:
        arms: The arms; their memories and answers change.
        nominal: The policies' jerks, shape (E, n) [rad/s³].
        asked: Which arms have to decide, shape (E,) of bool.
    """
    for e in range(nominal.shape[0]):
        if asked[e]:
            decide(arms, nominal[e], e)


@jit
def prepare(arms, nominal):
    """:func:`~jssa_gym.tick.decide.prepare` of a single arm, whose filter is not compiled."""
    return step.prepare(arms.robot, arms.settings, arms.memory, arms.scene, nominal[0], arms.work, arms.answer, 0)


@jit
def settle(arms, nominal):
    """:func:`~jssa_gym.tick.decide.settle` of a single arm."""
    return step.settle(arms.robot, arms.settings, arms.memory, arms.scene, nominal[0], arms.work, arms.answer, 0)


@jit
def settle_held(arms):
    """:func:`~jssa_gym.tick.decide.settle_held` of a single arm."""
    step.settle_held(arms.robot, arms.settings, arms.memory, arms.work, arms.answer, 0)


@jit
def stop(arms, fault):
    """:func:`~jssa_gym.tick.decide.stop` of a single arm."""
    step.stop(arms.robot, arms.settings, arms.memory, arms.work, arms.answer, fault, 0)


@jit
def propose(arms, nominal):
    """:func:`~jssa_gym.tick.propose.propose` of a single arm."""
    proposing.propose(arms, nominal[0], proposing.meet_people(arms, 0), 0)


@jit
def ask_again(arms, nominal, held):
    """:func:`~jssa_gym.tick.propose.ask_again` of a single arm, if it can be: a jerk into ``arms.work.wanted``."""
    return proposing.ask_again(arms, nominal[0], held, 0)


@jit
def foresee(arms):
    """:func:`~jssa_gym.tick.propose.foresee` of a single arm."""
    proposing.foresee(arms, 0)


@jit
def begin_rows(arms, nominal, first):
    """What a filter says of a single arm before a projection that is not compiled: its first question, or another."""
    told = arms.answer.told[0] if first else arms.work.told[0]
    code = proposing.meet(arms.proposal)(arms.settings, arms.memory, arms.scene, arms.work, 0) if first else 0
    if code == 0:
        proposing.begin(arms.work, told)
        code = proposing.proposed(arms.proposal)(
            arms.robot, arms.settings, arms.proposal, arms.memory, nominal[0], arms.work, told, 0
        )
    return code


@jit
def after_projection(arms, nominal, feasible, left, first):
    """What it says after it: a jerk in rows and box is in ``arms.work.wanted``, which leaves that much of the rows."""
    told = arms.answer.told[0] if first else arms.work.told[0]
    told["kept"], told["slack"] = feasible, left
    return proposing.projected(arms.proposal)(
        arms.robot, arms.settings, arms.proposal, arms.memory, nominal[0], arms.work, told, 0
    )  # fmt: skip


@jit
def name_status(arms, nominal, code):
    """:func:`~jssa_gym.tick.propose.name_status` of a single arm."""
    proposing.name_status(arms.robot, nominal[0], code, arms.work, arms.answer.told[0])


@jit
def rebase(arms):
    """The single arm rests where it is expected, whatever its readings were."""
    arms.memory.arm[0]["begun"] = True
    forget(arms.memory, 0)
    replan(arms.settings, arms.memory, arms.work, 0)


@jit
def start(arms, asked):
    """Forget the past of every arm that is ``asked``, shape (E,); see :func:`~jssa_gym.tick.decide.start`."""
    for e in range(asked.shape[0]):
        if asked[e]:
            step.start(arms.settings, arms.memory, arms.scene, arms.work, e)
