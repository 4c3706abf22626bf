"""The tuples of :mod:`~jssa_gym.tick.layout` as compiled functions take them: by one pointer each.

A tuple of arrays would be taken apart and put together again at every call, which costs more than most calls do. What
is pointed to belongs to Python, so that compiled code counts no references: those of numba's own ``structref``, which
are atomic, and of the arrays in it took a fifth of a control step and a third of the time to compile one.
"""

import hashlib
import struct
from typing import Any, NamedTuple

import numpy as np
from numba import config, typeof, types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, lower_getattr_generic, models, register_model, unbox

from jssa_gym.tick.layout import Answer, ArmRecord, Memory, SceneRecord, StepSettings, Work

_WORD = 8
"""Bytes of a word: every number, address and length is one."""


class _PointerType(types.Type):
    """The type of the address of a named tuple's values, word for word."""

    def __init__(self, layout: types.NamedTuple) -> None:
        self.layout = layout
        # the whole type would be a part of every compiled function's name
        digest = hashlib.sha256(str(layout).encode()).hexdigest()[:16]
        super().__init__(f"{layout.instance_class.__name__}*{digest}")


register_model(_PointerType)(models.OpaqueModel)


class Pointer:
    """A named tuple in words, which it keeps alive with all their arrays."""

    def __init__(self, values: Any) -> None:
        likeness = _likeness(values)
        if likeness not in _KNOWN:
            _KNOWN[likeness] = _PointerType(typeof(values))
        self._numba_type_ = _KNOWN[likeness]
        self._lent = values
        self._words = np.array(_words(self._numba_type_.layout, values), np.int64)
        self.address = self._words.ctypes.data


_KNOWN: dict[Any, _PointerType] = {}
"""Types of pointers by the likeness of what they point to: to make one takes numba a millisecond."""


def _likeness(value: Any) -> Any:
    """What of a value its type depends on."""
    if isinstance(value, tuple):
        return type(value), *map(_likeness, value)
    if isinstance(value, np.ndarray):
        flags = value.flags
        return value.dtype, value.ndim, flags.c_contiguous, flags.f_contiguous, flags.aligned, flags.writeable
    return getattr(value, "_numba_type_", type(value))


def _words(kind: types.Type, value: Any) -> list[int]:
    """A value as :func:`_load` reads it."""
    if isinstance(kind, types.Array):
        # numba's own order: nobody's memory, nobody's object, then what there is
        return [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]
    if isinstance(kind, _PointerType):
        return [value.address]
    if isinstance(kind, types.BaseTuple):
        return [word for one, part in zip(kind, value, strict=True) for word in _words(one, part)]
    if isinstance(kind, types.Float):
        return list(struct.unpack("q", struct.pack("d", value)))
    return [int(value)]


def _length(kind: types.Type) -> int:
    """Number of words."""
    if isinstance(kind, types.Array):
        return 5 + 2 * kind.ndim
    return sum(map(_length, kind)) if isinstance(kind, types.BaseTuple) else 1


def _load(context: Any, builder: Any, kind: types.Type, address: Any) -> Any:
    """A value of that type from words that begin at an address."""
    if isinstance(kind, types.BaseTuple):
        values = []
        for one in kind:
            values.append(_load(context, builder, one, address))
            address = cgutils.pointer_add(builder, address, _WORD * _length(one))
        return context.make_tuple(builder, kind, values)
    stored = types.int64 if isinstance(kind, types.Boolean) else kind
    of_kind = context.get_value_type(stored).as_pointer()
    value = builder.load(builder.bitcast(address, of_kind))
    return context.cast(builder, value, stored, kind)


@infer_getattr
class _Fields(AttributeTemplate):
    key = _PointerType

    def generic_resolve(self, pointer: _PointerType, name: str) -> types.Type | None:
        layout = pointer.layout
        return layout[layout.fields.index(name)] if name in layout.fields else None


@lower_getattr_generic(_PointerType)
def _load_field(context: Any, builder: Any, kind: _PointerType, pointer: Any, name: str) -> Any:
    which = kind.layout.fields.index(name)
    before = sum(map(_length, kind.layout.types[:which]))
    return _load(context, builder, kind.layout[which], cgutils.pointer_add(builder, pointer, _WORD * before))


@unbox(_PointerType)
def _unbox(kind: _PointerType, pointer: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(pointer, "address")
    value = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(value)


class Arms(NamedTuple):
    """All of them at once; what :func:`~jssa_gym.tick.loop.decide_all` takes.

    The parameters of whoever proposes have a type that says who that is: it is the only one that is not the same for
    all filters, so that what they share is compiled once.
    """

    robot: Any
    settings: Any
    proposal: Any
    memory: Any
    scene: Any
    work: Any
    answer: Any


def pointer_to(values: Any) -> Any:
    """A pointer to the very arrays of a named tuple; itself where Python runs what else is compiled."""
    return values if config.DISABLE_JIT else Pointer(values)


def arms(
    robot: ArmRecord,
    settings: StepSettings,
    proposal: Any,
    memory: Memory,
    scene: SceneRecord,
    work: Work,
    answer: Answer,
) -> Any:
    """A pointer to the very arrays of these tuples, which it keeps alive; ``proposal`` as of :class:`Arms`."""
    shared = (pointer_to(values) for values in (memory, scene, work, answer))
    return pointer_to(Arms(pointer_to(robot), pointer_to(settings), proposal, *shared))
