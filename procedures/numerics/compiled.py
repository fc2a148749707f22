"""Loops as machine code: two decorators, so that every kernel is built and kept in the same way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """The function as machine code that runs outside Python's lock, kept on disk between runs where that is possible.

    Division by zero gives infinity or NaN as in NumPy. Kernels start no threads: those are the caller's.
    """
    return _build(function, fastmath=False)


def vectorised(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for data without NaN: sums may be reordered, so that loops over them fill vector registers."""
    return _build(function, fastmath={"reassoc", "contract", "nsz", "arcp", "nnan"})


def _build(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    options |= {"nogil": True, "error_model": "numpy"}
    try:
        kernel = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # neither the checkout nor the user's cache folder can be written
        kernel = numba.njit(**options)(function)
    return cast(Callable[P, R], kernel)
