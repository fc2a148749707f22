"""Decorators for loops that Numba compiles when they are first called; it keeps the machine code between runs."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def jitted(**options: Any) -> Callable[[F], F]:
    """Decorate with `numba.njit` and these options; the loop releases Python's lock and starts no threads.

    Numba keeps the code in NUMBA_CACHE_DIR, else next to the source, else in the user's cache folder.
    """
    settings = {"nogil": True, "error_model": "numpy", **options}

    def decorate(function: F) -> F:
        try:
            kernel: F = numba.njit(cache=True, **settings)(function)
        except RuntimeError:  # Numba found no folder that it can write to
            _warn()
            kernel = numba.njit(**settings)(function)
        return kernel

    return decorate


@functools.cache
def _warn() -> None:
    logging.getLogger(__name__).warning(
        "compiled code cannot be kept, so each run compiles it anew; set NUMBA_CACHE_DIR to a writable folder"
    )


compiled = jitted()
"""Strict arithmetic; division by zero gives infinity or NaN as in NumPy."""
vectorised = jitted(fastmath={"reassoc", "contract", "nsz", "arcp", "nnan"})
"""For data without NaN: sums may be reordered, so that loops over them use vector registers."""
