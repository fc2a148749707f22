"""Vectors of fixed length as values in compiled functions, kept in registers by a loop.

Short rows do not benefit from a compiler's automatic vectorisation, which guards each against overlap and odd lengths.
Here a row is loaded, multiplied and stored as one value, which the compiler maps to the processor's registers.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, register_model

LANES, FEWER_LANES = 16, 8
"""Numbers in a vector: two registers of AVX, one of AVX-512; vectors of 8 take half of the time for masks up to 7 wide,
but 14 to 40 % longer for those 9 to 13 wide."""

_INDEX = ir.IntType(32)


class Lanes(types.Type):
    """The type of a vector of `count` numbers of one kind."""

    def __init__(self, dtype: Any, count: int) -> None:
        self.dtype, self.count = dtype, count
        super().__init__(name=f"Lanes({dtype}, {count})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes) -> None:
        super().__init__(manager, kind, ir.VectorType(manager.lookup(kind.dtype).get_value_type(), kind.count))  # type: ignore[no-untyped-call]  # numba's own


def _emitted(function: Callable[..., Any]) -> Any:
    """An operation for compiled functions that omits the typing context, the first argument of `function`; a number of
    lanes is a constant."""
    return intrinsic(prefer_literal=True)(function)


def _place(context: Any, builder: Any, kind: Any, count: int, array: Any, at: Any) -> Any:
    """Address of `count` entries of a flat array from index `at` on."""
    data = context.make_array(kind)(context, builder, array).data
    vector = ir.VectorType(context.get_value_type(kind.dtype), count)
    return builder.bitcast(builder.gep(data, [at]), vector.as_pointer())


@_emitted
def load(_: Any, array: Any, at: Any, count: Any) -> Any:
    """array[at : at + count] of a flat array, without bounds check."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind = signature.args[0]
        place = _place(context, builder, kind, count.literal_value, *values[:2])
        return builder.load(place, align=kind.dtype.bitwidth // 8)

    return Lanes(array.dtype, count.literal_value)(array, types.intp, count), generate


@_emitted
def store(_: Any, lanes: Any, array: Any, at: Any) -> Any:
    """Write lanes to array[at : at + their number]."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        vector, kind = signature.args[:2]
        place = _place(context, builder, kind, vector.count, *values[1:])
        builder.store(values[0], place, align=kind.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(lanes, array, types.intp), generate


@_emitted
def filled(_: Any, x: Any, count: Any) -> Any:
    """`count` times x."""

    def generate(_: Any, builder: Any, signature: Any, values: Any) -> Any:
        n = count.literal_value
        nothing = ir.Constant(ir.VectorType(values[0].type, n), ir.Undefined)
        first = builder.insert_element(nothing, values[0], _INDEX(0))
        return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_INDEX, n), [0] * n))

    return Lanes(x, count.literal_value)(x, count), generate


@_emitted
def multiply_add(_: Any, x: Any, y: Any, z: Any) -> Any:
    """x y + z, with one rounding where the processor supports it."""

    def generate(_: Any, builder: Any, signature: Any, values: Any) -> Any:
        product = builder.fmul(values[0], values[1], flags=["contract"])
        return builder.fadd(product, values[2], flags=["contract"])

    return z(x, y, z), generate


@_emitted
def total(_: Any, lanes: Any) -> Any:
    """Sum of the lanes, by halving."""

    def generate(_: Any, builder: Any, signature: Any, values: Any) -> Any:
        x, n = values[0], lanes.count
        while n > 1:
            n //= 2
            halves = (ir.Constant(ir.VectorType(_INDEX, n), list(range(k, k + n))) for k in (0, n))
            x = builder.fadd(*(builder.shuffle_vector(x, ir.Constant(x.type, ir.Undefined), half) for half in halves))
        return builder.extract_element(x, _INDEX(0))

    return lanes.dtype(lanes), generate


@_emitted
def entry(_: Any, array: Any, at: Any) -> Any:
    """array[at] of a flat array, without negative indices, which alone cost a tenth of a convolution."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind = signature.args[0]
        data = context.make_array(kind)(context, builder, values[0]).data
        return builder.load(builder.gep(data, [values[1]]))

    return array.dtype(array, types.intp), generate
