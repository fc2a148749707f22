"""Loops as machine code. The procedures have their own: simulator and estimator share nothing but the chart."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """The function as machine code that runs outside Python's lock, kept on disk between runs where possible."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        kernel = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # neither the checkout nor the user's cache folder can be written
        kernel = numba.njit(**options)(function)
    return cast(Callable[P, R], kernel)
