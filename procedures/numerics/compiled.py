"""Decorators for loops that Numba compiles when they are first called; the machine code is kept between runs.

Numba compiles a kept loop anew when the loop's own file changes, but not when a type or constant that it takes from
another file does. The code is therefore kept in a folder for the content of the sources.
"""

import contextlib
import functools
import hashlib
import logging
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numba

config: Any = numba.config
F = TypeVar("F", bound=Callable[..., Any])

FOLDER = "calibration-station"
USES_THIS = b"numerics.compiled import"
KEPT_S = 30 * 24 * 3600.0  # age at which the code of other sources is removed


def jitted(**options: Any) -> Callable[[F], F]:
    """Decorate with `numba.njit`, without Python's lock and threads; the code is kept below NUMBA_CACHE_DIR, the user's
    cache folder, or next to the source."""
    settings = {"nogil": True, "error_model": "numpy", **options}

    def decorate(function: F) -> F:
        try:
            with _cache_of((function.__module__ or "").partition(".")[0]):
                kernel: F = numba.njit(cache=True, **settings)(function)
        except RuntimeError:  # Numba found no folder that it can write to
            _warn()
            kernel = numba.njit(**settings)(function)
        return kernel

    return decorate


@contextlib.contextmanager
def _cache_of(package: str) -> Iterator[None]:
    """Context in which Numba keeps code in the folder for the present sources of a package."""
    before = config.CACHE_DIR
    config.CACHE_DIR = _cache_folder(before, package)
    try:
        yield
    finally:
        config.CACHE_DIR = before


@functools.cache
def _cache_folder(base: str, package: str) -> str:
    own = Path(base or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", FOLDER)
    roots = getattr(sys.modules.get(package), "__path__", None)
    folder = own / f"{package}-{_digest(Path(roots[0]))}" if roots else own
    with contextlib.suppress(OSError):
        for other in own.iterdir():
            if other != folder and time.time() - other.stat().st_mtime > KEPT_S:
                shutil.rmtree(other)
    return str(folder)


def _digest(root: Path) -> str:
    """Digest of the modules in all folders of a package that have compiled loops."""
    sources = {path: path.read_bytes() for path in sorted(root.rglob("*.py"))}
    folders = {path.parent for path, source in sources.items() if USES_THIS in source}
    digest = hashlib.sha256(b"".join(source for path, source in sources.items() if path.parent in folders))
    return digest.hexdigest()[:16]


@functools.cache
def _warn() -> None:
    logging.getLogger(__name__).warning(
        "compiled code cannot be kept, so each run compiles it anew; set NUMBA_CACHE_DIR to a writable folder"
    )


compiled = jitted()  # strict arithmetic; division by zero gives infinity or NaN as in NumPy
vectorised = jitted(fastmath={"reassoc", "contract", "nsz", "arcp", "nnan"})
"""For data without NaN: sums may be reordered, so that loops over them use vector registers."""
