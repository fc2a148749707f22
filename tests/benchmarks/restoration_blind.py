"""Unknown motion: shapes from a flat part of 150 x 150, and the restoration with them against that with the true ones.

`python tests/benchmarks/restoration_blind.py`
"""

from __future__ import annotations

import platform

import numpy as np
from numpy.typing import NDArray
from restoration_scenes import MAX_W, RIM, Scene, scene
from scipy.ndimage import shift
from scipy.optimize import minimize
from scipy.signal import fftconvolve

from procedures.restoration.blind import prototype_shapes
from procedures.restoration.blur_models import mask_stack
from procedures.restoration.estimate import restore

Array = NDArray[np.floating]
FLAT = slice(5, 155)


def likeness(a: Array, b: Array) -> float:
    """Normalised correlation of two masks at their best shift."""
    product = fftconvolve(np.pad(a, 8), np.pad(b, 8)[::-1, ::-1])
    return float(product.max() / np.linalg.norm(a) / np.linalg.norm(b))


def error(case: Scene, u: Array) -> float:
    """RMSE of a picture at its best shift: that of both shapes together is no part of the blur."""

    def at(move: Array) -> float:
        return case.error(shift(u, move, order=3, mode="nearest"))

    whole = min(np.ndindex(7, 7), key=lambda move: at(np.array(move) - 3))
    simplex = np.array(whole) - 3 + np.array([[0, 0], [0.5, 0], [0, 0.5]])
    found = minimize(at, simplex[0], method="Nelder-Mead", options={"initial_simplex": simplex, "xatol": 0.01})
    return float(found.fun)


def main() -> None:
    """Print likeness of the shapes and both errors."""
    case = scene("vibration", "wall", 40.0)
    print(f"Python {platform.python_version()}, {platform.machine()}, {case.name}, rim of {RIM} left out")
    found = prototype_shapes(case.z[:, 0, FLAT, FLAT], 5)
    print(f"half-width {found.half_width:.1f} for w {case.w[80, 80]:.1f}")
    true = [s.at(float(case.w[80, 80])) for s in case.stacks]
    print("likeness", *(f"{likeness(a, b):.3f}" for a, b in zip(found.masks, true, strict=True)), "  bound 0.95")
    stacks = [mask_stack(s, MAX_W, R=8) for s in found.shapes]
    known, blind = (restore(list(case.z), s).value for s in (case.stacks, stacks))
    assert known is not None
    assert blind is not None
    one, other = error(case, known.sharp[0]), error(case, blind.sharp[0])
    print(f"known shapes {one:.2f}, found shapes {other:.2f} = {other / one:.2f} x   bound 1.15")


if __name__ == "__main__":
    main()
