"""The loops of the estimation of a PSF from a chart, compiled.

The modules here define them in Python, for Numba. Where a compiler was present at installation, the extension `_native`
has the same loops in C++ (the headers of the same names), so that a command starts without Numba. To add a loop, write
both and its name below; `tests/procedures/numerics/test_loops.py` compares them.
"""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

__all__ = [
    "add_band", "all_nearest", "apply_edges", "apply_edges_transposed", "best_of_tiles", "collinear_triples",
    "convolve_at", "edge_gram", "edge_lines", "fill_convolution", "folded_product", "inverted",
    "non_maximum_suppression", "read_spline", "ring_purity", "saddle_points", "square_sides", "substituted",
    "sums_of_groups",
]  # fmt: skip

_native: ModuleType | None
try:
    _native = import_module(f"{__name__}._native")
except ImportError:
    _native = None

COMPILER = "C++" if _native is not None else "Numba"
"""Compiler of the loops, on which the last bits of their sums depend."""

if TYPE_CHECKING:
    from procedures.numerics.loops.edges import apply_edges, apply_edges_transposed, edge_gram, edge_lines
    from procedures.numerics.loops.layouts import all_nearest, collinear_triples, non_maximum_suppression, square_sides
    from procedures.numerics.loops.matrices import convolve_at, fill_convolution, inverted, substituted, sums_of_groups
    from procedures.numerics.loops.saddles import best_of_tiles, ring_purity, saddle_points
    from procedures.numerics.loops.splines import add_band, folded_product, read_spline

_MODULES = ("edges", "layouts", "matrices", "saddles", "splines")


def __getattr__(name: str) -> object:
    """Load a loop on first use: without the extension that imports Numba, which takes half a second."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    modules = [_native] if _native is not None else [import_module(f"{__name__}.{module}") for module in _MODULES]
    globals()[name] = value = next(getattr(module, name) for module in modules if hasattr(module, name))
    return value
