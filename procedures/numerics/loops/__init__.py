"""The loops of the estimation of a PSF from a chart.

Where a compiler was present at installation, they are those of the extension `_native`, in C++; elsewhere array
operations compute the same. To add a loop, write both and its name below; `tests/procedures/numerics/test_loops.py`
compares them.
"""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

_native: ModuleType | None
try:
    _native = import_module(f"{__name__}._native")
except ImportError:
    _native = None

COMPILER = "C++" if _native is not None else "NumPy"
"""Compiler or library of the loops, on which the last bits of their sums depend."""

if TYPE_CHECKING:
    from procedures.numerics.loops.array_operations import *  # noqa: F403


def __getattr__(name: str) -> object:
    """Load a loop on first use: without the extension that imports SciPy, which takes a quarter of a second."""
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = _native if _native is not None else import_module(f"{__name__}.array_operations")
    globals()[name] = value = getattr(module, name)
    return value
