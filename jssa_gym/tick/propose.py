"""What the compiled filters propose: a jerk, and what is known of it.

Who proposes is known when numba compiles: the parameters of a filter are a tuple of a type of its own, and
:data:`KINDS` has the functions for each type. So a control step holds the code of the one filter that it is for.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from numba.extending import overload

from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.vector import copy
from jssa_gym.tick import codes
from jssa_gym.tick.proposals.ahead import PredictedRows, ahead
from jssa_gym.tick.proposals.energy import (
    BarrierRows,
    SafeAcceleration,
    SublevelRows,
    barrier_rows,
    safe_acceleration,
    sublevel_rows,
)  # fmt: skip
from jssa_gym.tick.proposals.exact import ExactRows, after_exact, exact, look_ahead, people_ahead
from jssa_gym.tick.proposals.nothing import Nothing, keep_nominal
from jssa_gym.tick.proposals.printed import PrintedRows, after_printed, printed, unforeseen
from jssa_gym.tick.proposals.repulsion import Repulsion, SlidingMode, repulsion, sliding_mode
from jssa_gym.tick.proposals.rows import PROJECT, after_rows, project
from jssa_gym.tick.proposals.separation import ProtectiveDistance, separation


@jit
def people_now(settings, memory, scene, work, e):
    """The people are where they are already."""
    return 0


@jit
def as_measured(robot, settings, proposal, memory, jerk, work, told, e):
    """What was measured of the present stays as it is, whatever jerk is applied."""


class Kind(NamedTuple):
    """The functions of a compiled filter; arguments as of :mod:`jssa_gym.tick.proposals`."""

    propose: Callable
    """Looks at the clipped nominal and proposes a jerk, or makes rows and says ``PROJECT``."""
    projected: Callable | None = None
    """Looks at the jerk that was projected onto the rows, and says what became of them or, once more, ``PROJECT``; for
    a filter without rows None."""
    meet: Callable = people_now
    """Makes of the present what the filter looks at; 0, or the code of what is wrong with it."""
    foresee: Callable = as_measured
    """Takes down index, distance and pair under another jerk than was proposed."""
    again: bool = False
    """Whether it is asked once more where some joints have to go on with the stored stop; else the others do what was
    proposed."""


KINDS: dict[type, Kind] = {
    Nothing: Kind(keep_nominal),
    ExactRows: Kind(exact, after_exact, meet=people_ahead, foresee=look_ahead, again=True),
    PredictedRows: Kind(ahead, after_rows, again=True),
    PrintedRows: Kind(printed, after_printed, foresee=unforeseen),
    SafeAcceleration: Kind(safe_acceleration, again=True),
    SublevelRows: Kind(sublevel_rows, after_rows, again=True),
    BarrierRows: Kind(barrier_rows, after_rows, again=True),
    Repulsion: Kind(repulsion, again=True),
    SlidingMode: Kind(sliding_mode, again=True),
    ProtectiveDistance: Kind(separation),
}
"""The compiled filters, by the type of their parameters."""


def _of_kind(choose: Callable[[Kind], Callable]) -> Any:
    """A function of a filter's parameters that numba replaces by what is chosen for their type."""

    def chosen(proposal):
        return choose(KINDS[type(proposal)])

    @overload(chosen)
    def compiled(proposal):
        function = choose(KINDS[proposal.instance_class])

        def constant(proposal):
            return function

        return constant

    return chosen


@jit
def no_rows(settings, nominal, count, lower, upper, work):
    """What stands in place of a projection where there are never any rows."""
    return True, 0.0


@jit
def yes():
    """It is asked again."""
    return True


@jit
def no():
    """It is not."""
    return False


meet = _of_kind(lambda kind: kind.meet)
proposed = _of_kind(lambda kind: kind.propose)
projected = _of_kind(lambda kind: kind.projected or kind.propose)
onto_rows = _of_kind(lambda kind: project if kind.projected else no_rows)
foreseen = _of_kind(lambda kind: kind.foresee)
asks_again = _of_kind(lambda kind: yes if kind.again else no)


@jit
def begin(work, told):
    """The clipped nominal is what is wanted, and nothing is known of rows."""
    copy(work.clipped, work.wanted)
    told["rows"], told["attempt"], told["recovering"], told["kept"], told["slack"] = 0, 0, False, True, 0.0


@part
def solve(arms, nominal, told, e):
    """A jerk into ``work.wanted``; why it is not the clipped nominal, or what failed, as a code."""
    robot, settings, proposal, memory, work = arms.robot, arms.settings, arms.proposal, arms.memory, arms.work
    begin(work, told)
    stage = proposed(proposal)(robot, settings, proposal, memory, nominal, work, told, e)
    while stage == PROJECT:
        told["kept"], told["slack"] = onto_rows(proposal)(
            settings, nominal, told["rows"], work.lower, work.upper, work
        )  # fmt: skip
        stage = projected(proposal)(robot, settings, proposal, memory, nominal, work, told, e)
    return stage


@part
def meet_people(arms, e):
    """Make of the present what the filter looks at; 0, or the code of what is wrong with it."""
    return meet(arms.proposal)(arms.settings, arms.memory, arms.scene, arms.work, e)


@part
def leaves_alone(arms, jerk, told, e):
    """Whether the filter would apply ``jerk`` (n,), which ``work.clipped`` is, as it is."""
    begin(arms.work, told)
    arm = arms.memory.arm[e]
    resume = arm["resume"]
    code = proposed(arms.proposal)(
        arms.robot, arms.settings, arms.proposal, arms.memory, jerk, arms.work, told, e
    )  # fmt: skip
    # what is not applied, or not yet, has neither stopped anybody nor let anybody go on
    arm["resume"] = resume
    return code == 0 and told["rows"] == 0


@part
def propose(arms, nominal, code, e):
    """A jerk into ``work.wanted``; what is known of it into ``answer``: status FAULT and a code if there is none.

    ``code`` is what :func:`meet_people` says.
    """
    told = arms.answer.told[e]
    if code == 0:
        code = solve(arms, nominal, told, e)
    name_status(arms.robot, nominal, code, arms.work, told)


@jit
def name_status(robot, nominal, code, work, told):
    """Say what became of the nominal: hundreds of the code are the status."""
    if code == 0 and not told["inside"]:
        code = of_clipping(robot, nominal, work)
    told["status"], told["code"] = code // 100, code


@jit
def of_clipping(robot, nominal, work):
    """Why the nominal was clipped: by the jerk bounds alone, or by the viability box in some joint."""
    for j in range(nominal.shape[0]):
        bound = robot.limits[4, j]
        if work.clipped[j] != max(min(nominal[j], bound), -bound):
            return codes.UNRECOVERABLE
    return codes.CLIPPED


@part
def ask_again(arms, nominal, held, e):
    """Ask once more, in a box that leaves the first ``held`` joints no choice; whether that gave another jerk."""
    work, box, halt = arms.work, arms.work.spare, arms.work.halt
    if not asks_again(arms.proposal)():
        return False
    copy(work.lower, box[0])
    copy(work.upper, box[1])
    for j in range(held):
        work.lower[j] = work.upper[j] = halt[j]
    clip_to_box(nominal, work)
    code = solve(arms, nominal, work.told[0], e)
    copy(box[0], work.lower)
    copy(box[1], work.upper)
    return code // 100 != codes.FAULT


@part
def propose_held(arms, nominal, held, e):
    """Another jerk, into ``work.wanted``, if the first ``held`` joints have to go on with the stored stop's."""
    if not ask_again(arms, nominal, held, e):
        copy(arms.answer.jerk[e], arms.work.wanted)
        for j in range(held):
            arms.work.wanted[j] = arms.work.halt[j]


@jit
def clip_to_box(nominal, work):
    """The nominal in the box, into ``work.clipped``; whether it lay inside."""
    inside = True
    for j in range(nominal.shape[0]):
        work.clipped[j] = min(max(nominal[j], work.lower[j]), work.upper[j])
        inside = inside and work.clipped[j] == nominal[j]
    return inside


@part
def foresee(arms, e):
    """Index, distance and pair at the end of the step under another jerk than was proposed: ``answer.jerk``."""
    foreseen(arms.proposal)(
        arms.robot, arms.settings, arms.proposal, arms.memory, arms.answer.jerk[e], arms.work,
        arms.answer.told[e], e,
    )  # fmt: skip
