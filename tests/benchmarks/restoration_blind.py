"""Unknown motion: shapes from a flat part of 150 x 150, and the restoration with them against that with the true ones.

`python -m tests.benchmarks.restoration_blind [--recorded] [--pairs N] [--noise DB] [--large]`

`--recorded` begins the search from both paths as a unit with errors of 3 % records them; `--pairs` takes the first N;
`--noise` is stated below the photographs' standard deviation; `--large` takes frames of 365 x 325 instead of 240 x 200.
"""

import platform
import time

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift
from scipy.optimize import minimize
from scipy.signal import fftconvolve

from procedures.restoration.joint.estimate import restore
from procedures.restoration.masks.blur_models import mask_stack
from procedures.restoration.unknown_motion import motion_splines
from procedures.restoration.unknown_motion.blind import prototype_shapes
from procedures.restoration.unknown_motion.path_refinement import motion_of_scene
from procedures.restoration.unknown_motion.recorded_paths import recorded_masks
from tests.benchmarks import options
from tests.benchmarks.restoration_scenes import MAX_W, RIM, Scene, scene, wandering, with_errors

Array = NDArray[np.floating]
FLAT = slice(5, 155)
PAIRS = ((21, 22), (1, 2), (3, 4), (41, 42), (51, 52), (61, 62), (71, 72), (81, 82))


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


def trial(motions: tuple[int, int], recorded: bool, noise: float, shape: tuple[int, int]) -> None:
    """Print likeness of the masks and errors of the restorations for one pair of vibrations."""
    case = scene("vibration", "wall", noise, shape=shape, motions=motions)
    print(f"{case.name}, motions {motions}, rim of {RIM} left out")
    start = time.process_time()
    parts, rng = case.z[:, 0, FLAT, FLAT], np.random.default_rng(9)
    paths = [with_errors(wandering(seed), rng) for seed in motions] if recorded else []
    found = prototype_shapes(parts, 5, first=recorded_masks(parts, paths, 6) if paths else None)
    begun = [motion_splines.fit_recorded(p, m, found.half_width) for p, m in zip(paths, found.masks, strict=False)]
    true = [s.at(float(case.w[80, 80])) for s in case.stacks]
    print("  likeness", *(f"{likeness(a, b):.3f}" for a, b in zip(found.masks, true, strict=True)), "  bound 0.95")
    box = (FLAT.start, FLAT.start, FLAT.stop - FLAT.start, FLAT.stop - FLAT.start)
    motion = motion_of_scene(
        list(case.z), box, found, MAX_W, np.random.default_rng(0), np.stack(begun) if begun else None
    )
    seconds = time.process_time() - start
    print(
        f"  half-width {motion.half_width:.2f} for w {case.w[80, 80]:.1f}, {seconds:.0f} s, {motion.caveat or 'sure'}"
    )
    known, *others = (
        restore(list(case.z), stacks).value
        for stacks in (
            case.stacks,
            *([mask_stack(s, 1.1 * MAX_W, R=8) for s in shapes] for shapes in (motion.shapes, found.shapes)),
        )
    )
    assert known is not None
    one = error(case, known.sharp[0])
    for name, restored in zip(("paths", "shapes of whole pixels"), others, strict=True):
        assert restored is not None
        other = error(case, restored.sharp[0])
        unmoved = case.error(restored.sharp[0])
        print(f"  known {one:.2f}, {name} {other:.2f} = {other / one:.2f} x, unmoved {unmoved:.2f}   bound 1.15")


def main() -> None:
    """Pairs of vibrations, all of which the search was made with."""
    asked = options(__doc__, recorded=False, pairs=len(PAIRS), noise=40.0, large=False)
    print(f"Python {platform.python_version()}, {platform.machine()}")
    for motions in PAIRS[: asked.pairs]:
        trial(motions, asked.recorded, asked.noise, (325, 365) if asked.large else (200, 240))


if __name__ == "__main__":
    main()
