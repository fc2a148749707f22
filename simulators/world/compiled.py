"""Compiled loops. Kept separate from those of the procedures: simulator and estimator share only the chart."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile the function to run without Python's lock, cached on disk if possible."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        kernel = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # neither the checkout nor the user's cache folder is writable
        kernel = numba.njit(**options)(function)
    return cast(Callable[P, R], kernel)
