"""Real shake through unknown kernels where the second photograph lies otherwise, or is of other light or scene.

`python -m tests.benchmarks.restoration_odd_pairs FOLDER [--group 1] [CASE ...]`. FOLDER as `restoration_measured_shake`
takes it, of whose eight pairs one is chosen. PSNR after registration, the verdict, and what was taken up.
"""

import platform
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from procedures import BlurSpec, ProcedureError, UnknownMotion, blur_of
from tests.benchmarks import options
from tests.benchmarks.restoration_measured_shake import Array, group, groups, score
from tests.benchmarks.restoration_shaken import Shaken


def turned(z: Array, degrees: float, zoom: float) -> Array:
    """About the frame's middle."""
    rows, columns = z.shape
    to = cv2.getRotationMatrix2D(((columns - 1) / 2, (rows - 1) / 2), degrees, zoom)
    size = (columns, rows)
    return np.asarray(cv2.warpAffine(z, to, size, flags=cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT))


def moved(z: Array, radius: int = 25) -> Array:
    """A disc in the middle shows another part of the scene."""
    y, x = (n - n.mean() for n in np.mgrid[: len(z), : len(z[0])])
    return np.asarray(np.where(y**2 + x**2 < radius**2, np.roll(z, (30, 40), (0, 1)), z))


CASES: dict[str, Callable[[Array], Array]] = {
    "as it is": lambda z: z,
    "turned by 0.5 degrees": lambda z: turned(z, 0.5, 1),
    "turned by 2 degrees": lambda z: turned(z, 2, 1),
    "zoomed by 2 %": lambda z: turned(z, 0, 1.02),
    "half as bright": lambda z: z / 2,
    "gamma 1.4": lambda z: z ** (1 / 1.4),
    "disc moved": moved,
}


def report(name: str, case: Shaken) -> None:
    """Print one line."""
    z, start = [one[None] for one in case.z], time.process_time()
    try:
        outcome = blur_of(BlurSpec(UnknownMotion("whole")), z).restored(z)
        found, said = outcome.value, f"{outcome.verdict} {outcome.reason}"
    except ProcedureError as error:
        found, said = None, f"refused {error.reason}"
    psnr = up = ""
    if found is not None:
        psnr = f"{score(case, found.sharp[0]):.1f}"
        up = f"{np.rad2deg(found.turns[1]):+.2f}° x {found.zooms[1]:.4f}, light {found.light[1]:.2f}"
    print(f"{name:24s} {psnr:>6s}  {up:32s} {time.process_time() - start:3.0f} s  {said}", flush=True)


def main() -> None:
    """Print the environment and a line for each case."""
    asked = options(__doc__, "folder", "cases", folder=Path, cases=[], group=1)
    scene, kernels = groups(2)[asked.group]
    case = group(asked.folder, scene, kernels)
    print(f"Python {platform.python_version()}, {platform.machine()}, scene {scene}, kernels {kernels}; PSNR, dB")
    for name in asked.cases or CASES:
        report(name, replace(case, z=[case.z[0], CASES[name](case.z[1])]))


if __name__ == "__main__":
    main()
