"""Kernels that Numba keeps itself, and what is said, once, where nothing can be kept: then they are compiled anew."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from procedures.numerics.kernel_lock import only_one

F = TypeVar("F", bound=Callable[..., Any])

SAID = "STATION_KERNELS_NOT_KEPT"
"""Environment variable: set where it was said, so that processes started from here do not say it again."""


def jitted(**options: Any) -> Callable[[F], F]:
    """A decorator: machine code by Numba with these options, kept on disk between runs where that is possible."""
    import numba  # not with this module: the kernels of `compiled` do without

    def decorate(function: F) -> F:
        try:
            kernel: F = _one_compiler(numba.njit(cache=True, **options)(function))
        except RuntimeError as error:  # neither beside the source nor in the user's cache can be written
            tell_not_kept(str(error))
            kernel = numba.njit(**options)(function)
        return kernel

    return decorate


def _one_compiler(kernel: Any) -> Any:
    """The kernel, which waits for what another process compiles of it."""
    compile_or_load = kernel._compile_for_args
    path = Path(kernel._cache.cache_path) / f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}"

    def alone(*arguments: Any, **named: Any) -> Any:
        with only_one(path):
            return compile_or_load(*arguments, **named)

    kernel._compile_for_args = alone
    return kernel


def tell_not_kept(reason: object) -> None:
    """Say that machine code is made anew in each run, and how that is helped; once in a program and its processes."""
    if SAID not in os.environ:
        os.environ[SAID] = "1"
        logging.getLogger(__name__).warning(
            "compiled code cannot be kept (%s), so that each run compiles it anew; set NUMBA_CACHE_DIR to a folder "
            "that can be written",
            reason,
        )
