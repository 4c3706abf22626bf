"""The tuples of :mod:`~jssa_gym.tick.layout` as compiled functions take them: by one pointer each.

A tuple of arrays would be taken apart and put together again at every call, which costs more than most calls do.
"""

from typing import Any, NamedTuple

from numba import config, types
from numba.core import cgutils
from numba.experimental import structref
from numba.extending import intrinsic

from jssa_gym.kernels.jit import jit
from jssa_gym.tick.layout import Answer, ArmRecord, Memory, SceneRecord, StepSettings, Work
from jssa_gym.tick.move import MeasuredArm, Seen


class _Struct(types.StructRef):
    def preprocess_fields(self, fields: Any) -> Any:
        return tuple((name, types.unliteral(kind)) for name, kind in fields)


@structref.register
class _ArmRecordType(_Struct): ...


@structref.register
class _SettingsType(_Struct): ...


@structref.register
class _MemoryType(_Struct): ...


@structref.register
class _SceneRecordType(_Struct): ...


@structref.register
class _WorkType(_Struct): ...


@structref.register
class _AnswerType(_Struct): ...


@structref.register
class _ArmsType(_Struct): ...


@structref.register
class _BodyType(_Struct): ...


@structref.register
class _SeenType(_Struct): ...


class _ArmRecordStruct(structref.StructRefProxy): ...


class _SettingsStruct(structref.StructRefProxy): ...


class _MemoryStruct(structref.StructRefProxy): ...


class _SceneRecordStruct(structref.StructRefProxy): ...


class _WorkStruct(structref.StructRefProxy): ...


class _AnswerStruct(structref.StructRefProxy): ...


class _BodyStruct(structref.StructRefProxy): ...


class _SeenStruct(structref.StructRefProxy): ...


for layout, proxy, kind in (
    (ArmRecord, _ArmRecordStruct, _ArmRecordType),
    (StepSettings, _SettingsStruct, _SettingsType),
    (Memory, _MemoryStruct, _MemoryType),
    (SceneRecord, _SceneRecordStruct, _SceneRecordType),
    (Work, _WorkStruct, _WorkType),
    (Answer, _AnswerStruct, _AnswerType),
    (MeasuredArm, _BodyStruct, _BodyType),
    (Seen, _SeenStruct, _SeenType),
):
    structref.define_boxing(kind, proxy)
    structref.define_constructor(proxy, kind, layout._fields)


class _ArmsStruct(structref.StructRefProxy):
    """All of them at once; what :func:`~jssa_gym.tick.loop.decide_all` takes."""


structref.define_boxing(_ArmsType, _ArmsStruct)
structref.define_constructor(_ArmsStruct, _ArmsType, [
    "robot", "settings", "proposal", "memory", "scene", "work", "answer",
])  # fmt: skip


class Arms(NamedTuple):
    """The same where Python runs what else is compiled (NUMBA_DISABLE_JIT=1): its tuples are pointers already."""

    robot: ArmRecord
    settings: StepSettings
    proposal: Any
    memory: Memory
    scene: SceneRecord
    work: Work
    answer: Answer


@intrinsic
def _borrowed(context, arrays):
    """A tuple's arrays as memory that compiled code owns no share of, so that it counts no references to it.

    To count them, atomically at every look at an array, took four tenths of a control step.
    """

    def generate(context, builder, signature, given):
        kinds, values = signature.return_type, []
        for kind, value in zip(kinds, cgutils.unpack_tuple(builder, given[0]), strict=True):
            if isinstance(kind, types.Array):
                array = context.make_array(kind)(context, builder, value=value)
                array.meminfo = cgutils.get_null_value(array.meminfo.type)
                array.parent = cgutils.get_null_value(array.parent.type)
                value = array._getvalue()
            values.append(value)
        return context.make_tuple(builder, kinds, values)

    return arrays(arrays), generate


@jit
def _pointers(robot, settings, memory, scene, work, answer):
    return (
        _ArmRecordStruct(*_borrowed(robot)),
        _SettingsStruct(*_borrowed(settings)),
        _MemoryStruct(*_borrowed(memory)),
        _SceneRecordStruct(*_borrowed(scene)),
        _WorkStruct(*_borrowed(work)),
        _AnswerStruct(*_borrowed(answer)),
    )


@jit
def _pointer(parts, proposal):
    robot, settings, memory, scene, work, answer = parts
    return _ArmsStruct(robot, settings, proposal, memory, scene, work, answer)


def arms(
    robot: ArmRecord,
    settings: StepSettings,
    proposal: Any,
    memory: Memory,
    scene: SceneRecord,
    work: Work,
    answer: Answer,
) -> Any:
    """A pointer to the very arrays of these tuples, which it keeps alive.

    ``proposal`` are the parameters of whoever proposes, and their type says who that is: of what is below it is the
    only one that is not of the same type for all filters, so that what they share is compiled once.
    """
    if config.DISABLE_JIT:
        return Arms(robot, settings, proposal, memory, scene, work, answer)
    lent = robot, settings, memory, scene, work, answer
    return _kept(_pointer(_pointers(*lent), proposal), lent)


def _kept(pointer: Any, lent: Any) -> Any:
    """The pointer, which keeps alive what it has borrowed."""
    pointer.lent = lent
    return pointer


@jit
def _body(body):
    return _BodyStruct(*_borrowed(body))


def body_pointer(body: MeasuredArm) -> Any:
    """A pointer to the very arrays of a :class:`~jssa_gym.tick.move.MeasuredArm`."""
    return body if config.DISABLE_JIT else _kept(_body(body), body)


@jit
def _seen(seen):
    return _SeenStruct(*_borrowed(seen))


def seen_pointer(seen: Seen) -> Any:
    """A pointer to the very arrays of a :class:`~jssa_gym.tick.move.Seen`."""
    return seen if config.DISABLE_JIT else _kept(_seen(seen), seen)
