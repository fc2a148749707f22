"""Calls of machine code that Numba made, without Numba: its arguments and answers as C sees them.

Numba's native functions are `int32 f(answer *, exception **, arguments...)`, all arguments taken apart into numbers and
pointers (numba.core.callconv, numba.core.datamodel). Importing Numba to call them takes longer than most of the work
that they do in one command.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

Shape = Any
"""What a value is, in JSON: a number's code ("<f8"), "none", ["array", code, dimensions] or ["tuple", shapes...]."""

NUMBERS: dict[str, Any] = {
    "|b1": ctypes.c_int8, "|i1": ctypes.c_int8, "<i2": ctypes.c_int16, "<i4": ctypes.c_int32, "<i8": ctypes.c_int64,
    "|u1": ctypes.c_uint8, "<u2": ctypes.c_uint16, "<u4": ctypes.c_uint32, "<u8": ctypes.c_uint64,
    "<f4": ctypes.c_float, "<f8": ctypes.c_double,
}  # fmt: skip
SCALARS: dict[type, str] = {bool: "|b1", int: "<i8", float: "<f8", complex: "<c16"}
COMPLEX = {"<c8": ctypes.c_float, "<c16": ctypes.c_double}
RETURNED_NONE = -2
"""Status of a function without an answer; 0 is that of one with."""


def described(value: object) -> str:
    """What Numba's compiler would see in an argument, as text; "" where this module cannot hand it over."""
    if (code := SCALARS.get(type(value))) is not None:
        return code
    if isinstance(value, np.ndarray):
        return _array(value.dtype, value.ndim, value.flags.num)
    if isinstance(value, tuple):
        parts = [described(one) for one in value]
        kind = type(value)
        name = "" if kind is tuple else f"{kind.__module__}.{kind.__qualname__}"
        return f"{name}({','.join(parts)})" if all(parts) else ""
    return _scalar(value)


@lru_cache(maxsize=256)
def _array(dtype: np.dtype[Any], dimensions: int, flags: int) -> str:
    """An array in words, by NumPy's flags: 1 contiguous as in C, 2 as in Fortran, 256 aligned, 1024 writeable."""
    order = "C" if flags & 1 else "F" if flags & 2 else "A"
    known = dtype.str in NUMBERS or dtype.str in COMPLEX
    return f"{dtype.str}{dimensions}{order}{'' if flags & 1024 else 'r'}" if known and flags & 256 else ""


def _scalar(value: object) -> str:
    if isinstance(value, np.generic):
        return value.dtype.str if value.dtype.str in NUMBERS or value.dtype.str in COMPLEX else ""
    return SCALARS.get(type(value), "")


def flattened(value: Any, out: list[Any]) -> None:
    """Append an argument's numbers and pointers. Arrays have no memory of Numba's own."""
    if isinstance(value, np.ndarray):
        out += (None, None, value.size, value.itemsize, _address(value), *value.shape, *value.strides)
    elif isinstance(value, tuple):
        for one in value:
            flattened(one, out)
    else:
        number = value.item() if isinstance(value, np.generic) else value
        out += (number.real, number.imag) if type(number) is complex else (number,)


def _address(array: npt.NDArray[Any]) -> int:
    """Of an array's first element."""
    flags = array.flags
    if flags.c_contiguous and flags.writeable and array.size:
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))  # half as long as NumPy's own ways take
    return int(array.ctypes.data)


def types_of(value: Any) -> list[Any]:
    """The C types of what `flattened` appends."""
    if isinstance(value, np.ndarray):
        sizes = [ctypes.c_int64] * (2 * value.ndim)
        return [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p, *sizes]
    if isinstance(value, tuple):
        return [one for part in value for one in types_of(part)]
    code = _scalar(value)
    return [COMPLEX[code]] * 2 if code in COMPLEX else [NUMBERS[code]]


def shape_of(kind: Any) -> Shape:
    """The shape of a Numba type. Raises TypeError for those that this module cannot take back."""
    from numba import types  # whoever has a type of Numba's has imported it

    if isinstance(kind, types.NoneType):
        return "none"
    if isinstance(kind, types.Array):
        return ["array", _code(kind.dtype), kind.ndim]
    if isinstance(kind, types.UniTuple | types.Tuple):
        return ["tuple", *(shape_of(one) for one in kind.types)]
    return _code(kind)


def _code(kind: Any) -> str:
    from numba import types
    from numba.np.numpy_support import as_dtype

    if not isinstance(kind, types.Number | types.Boolean):
        raise TypeError(f"no number: {kind}")
    code: str = as_dtype(kind).str
    if code not in NUMBERS and code not in COMPLEX:
        raise TypeError(f"no number that C has: {kind}")
    return code


def layout(shape: Shape) -> Any:
    """The C type of an answer."""
    if shape == "none":
        return ctypes.c_void_p
    if isinstance(shape, str):
        return COMPLEX[shape] * 2 if shape in COMPLEX else NUMBERS[shape]
    if shape[0] == "array":
        extent = ctypes.c_int64 * shape[2]
        numbers = [("size", ctypes.c_int64), ("itemsize", ctypes.c_int64), ("data", ctypes.c_void_p)]
        fields = [("block", ctypes.c_void_p), ("parent", ctypes.c_void_p), *numbers]
        return _structure([*fields, ("shape", extent), ("strides", extent)])
    return _structure([(f"_{n}", layout(one)) for n, one in enumerate(shape[1:])])


def _structure(fields: Sequence[tuple[str, Any]]) -> Any:
    return type("Answer", (ctypes.Structure,), {"_fields_": list(fields)})


def taken(shape: Shape, answer: Any, free: Callable[[int], object]) -> Any:
    """The answer as Python has it. Arrays keep the memory that the function gave them until they are no more.

    Parameters
    ----------
    answer : of the C type that `layout` gives
    free : callable
        Takes the address of a block back.
    """
    if shape == "none":
        return None
    if isinstance(shape, str):
        if shape in COMPLEX:
            return complex(answer[0], answer[1])
        value = getattr(answer, "value", answer)  # fields of structures are numbers already
        return bool(value) if shape == "|b1" else value
    if shape[0] == "array":
        return np.asarray(_Memory(shape[1], answer, free))
    return tuple(taken(one, getattr(answer, f"_{n}"), free) for n, one in enumerate(shape[1:]))


class _Memory:
    """A block with its counter of owners in its first word, as Numba's run-time has it (NRT, struct MemInfo)."""

    def __init__(self, code: str, answer: Any, free: Callable[[int], object]) -> None:
        self._block: int | None = answer.block
        self._free = free
        self.__array_interface__ = {
            "version": 3,
            "typestr": code,
            "shape": tuple(answer.shape),
            "strides": tuple(answer.strides),
            "data": (answer.data, False),
        }

    def __del__(self) -> None:
        if self._block:
            owners = ctypes.c_size_t.from_address(self._block)
            owners.value -= 1
            if owners.value == 0:
                self._free(self._block)
