"""Arms one after the other: the only loop over them."""

from jssa_gym.kernels.jit import jit
from jssa_gym.tick import decide as step
from jssa_gym.tick import propose
from jssa_gym.tick.decide import decide
from jssa_gym.tick.joints import forget, replan
from jssa_gym.tick.propose import meet


@jit
def decide_all(arms, nominal):
    """:func:`~jssa_gym.tick.decide.decide` for every arm of :func:`~jssa_gym.tick.structs.arms`.

    Args:
        arms: The arms; their memories and answers change.
        nominal: The policies' jerks, shape (E, n) [rad/s³].
    """
    for e in range(nominal.shape[0]):
        decide(arms.robot, arms.settings, arms.memory, arms.scene, nominal[e], arms.work, arms.answer, e)


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
def begin_rows(arms, first):
    """:func:`~jssa_gym.tick.propose.begin_rows` of a single arm, at ``first`` after ``meet``."""
    memory, told, humans = arms.memory, arms.answer.told[0] if first else arms.work.told[0], arms.memory.tracks.shape[1]
    fault = meet(arms.settings, memory, arms.scene, arms.work, 0) if first else 0
    return fault if fault else propose.begin_rows(arms.robot, arms.settings, memory.state[0], humans, arms.work, told)


@jit
def after_projection(arms, feasible, left, first):
    """:func:`~jssa_gym.tick.propose.after_projection` of a single arm."""
    memory, told, humans = arms.memory, arms.answer.told[0] if first else arms.work.told[0], arms.memory.tracks.shape[1]
    return propose.after_projection(
        arms.robot, arms.settings, memory.state[0], humans, feasible, left, arms.work, told
    )  # fmt: skip


@jit
def name_status(arms, nominal, fault):
    """:func:`~jssa_gym.tick.propose.name_status` of a single arm."""
    propose.name_status(arms.robot, nominal[0], fault, arms.work, arms.answer.told[0])


@jit
def rebase(arms):
    """The single arm rests where it is expected, whatever its readings were."""
    arms.memory.arm[0]["begun"] = True
    forget(arms.memory, 0)
    replan(arms.settings, arms.memory, arms.work, 0)


@jit
def start(arms):
    """Forget the past of every arm that is shown; see :func:`~jssa_gym.tick.decide.start`."""
    for e in range(arms.answer.jerk.shape[0]):
        step.start(arms.settings, arms.memory, arms.scene, arms.work, e)
