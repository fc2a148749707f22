"""Restoration against its rivals on the same photographs: RMSE in grey levels of 255, rim of 16 left out.

`python tests/benchmarks/restoration_rivals.py FOLDER [CASE ...]`, FOLDER as shared data's synthetic/restoration.
Wiener and Richardson-Lucy need scikit-image, which nothing else here does.
"""

from __future__ import annotations

import json
import platform
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from restoration_baseline import descent

from procedures.raw import read_frame
from procedures.restoration import alternate, depth
from procedures.restoration.blur_models import gaussian, mask_stack, pillbox, read_shape
from procedures.restoration.cost import restore_picture
from procedures.restoration.estimate import SHARPNESS, RestorationParameters, noise_of, restore
from procedures.restoration.forward import MaskStack
from procedures.restoration.scheme import Schedule, Scheme

Array = NDArray[np.float64]
WHITE = 65535 / 60000  # the photographs' white in units of the truth


class Case:
    """Photographs, masks and truth."""

    def __init__(self, folder: Path, name: str) -> None:
        self.name, self.folder = name, folder
        read = [read_frame(folder / f"{name}_{n}.pgm").planes["Y"].samples * WHITE for n in (1, 2)]
        self.z = np.stack(read)[:, None].astype(float)
        self.sharp, self.w = np.load(folder / "sharp.npy"), np.load(folder / "w.npy")
        self.stacks = self.masks(self.shapes())

    def shapes(self) -> list[Array]:
        """The true shapes of both blurs."""
        if self.name.startswith("defocus"):
            return [pillbox(), pillbox()]
        return [read_shape(self.folder / f"vibration_shape{n}.txt") for n in (1, 2)]

    def masks(self, shapes: list[Array]) -> list[MaskStack]:
        """Masks of both photographs."""
        ratio = 1.25 if self.name.startswith("defocus") else 1.0
        return [mask_stack(shape, 5.6, ratio=r, R=8) for shape, r in zip(shapes, (1.0, ratio), strict=True)]

    def error(self, u: Array) -> float:
        """RMSE of a picture (H, W)."""
        return float(255 * np.sqrt(np.mean((u - self.sharp)[16:-16, 16:-16] ** 2)))

    def w_error(self, w: Array) -> float:
        """RMSE of a depth map, pixels."""
        return float(np.sqrt(np.mean((w - self.w)[16:-16, 16:-16] ** 2)))


def at_depth(case: Case, w: Array, stacks: list[MaskStack] | None = None) -> Array:
    """The picture at a given depth map, weights from the noise."""
    stacks = stacks or case.stacks
    data, other = alternate.problem_of(case.z, stacks, np.ones((2, 1, *w.shape)), np.float32)
    sigma = noise_of(case.z, case.stacks)
    problem = alternate.Problem(data, other, Scheme(), Schedule(20, SHARPNESS), sigma, 12)
    state = alternate.begin(problem, w)
    data.focus(state.w)
    u = restore_picture(data, state.u, max(sigma**2 / SHARPNESS, 1e-6), 100)
    return np.asarray(u[0, data.R : -data.R, data.R : -data.R], dtype=float)


def single_photograph(case: Case) -> dict[str, Array]:
    """Wiener and Richardson-Lucy of the first photograph with the mask of the median depth."""
    try:
        from skimage.restoration import richardson_lucy, wiener
    except ImportError:
        print("  scikit-image is not installed: Wiener and Richardson-Lucy are left out")
        return {}
    z, mask = case.z[0, 0], case.stacks[0].at(float(np.median(case.w)))
    return {
        "Wiener (scikit-image), one PSF": wiener(z, mask, 3e-3),
        "Richardson-Lucy (scikit-image), one PSF": richardson_lucy(z, mask, 30),
    }


def compare(case: Case, known: float | None) -> None:
    """Print one table."""
    sigmas = np.full(2, max(noise_of(case.z, case.stacks), 1.4e-3))
    start = time.perf_counter()
    ours = restore(list(case.z), case.stacks, RestorationParameters()).value
    seconds = time.perf_counter() - start
    assert ours is not None
    second = depth.algorithm_2(case.z, case.stacks, float(sigmas[0])).w
    third = depth.algorithm_3(case.z, case.stacks, sigmas).w
    broad = case.masks([gaussian(), gaussian()])
    published = descent(case.z, case.stacks, third, Scheme(), 1e-4)
    rows: dict[str, tuple[Array, Array | None]] = {
        "blurred photograph": (case.z[0, 0], None),
        **{name: (u, None) for name, u in single_photograph(case).items()},
        "one PSF for the whole picture": (at_depth(case, np.full_like(case.w, np.median(case.w))), None),
        "Algorithm II directly": (at_depth(case, second), second),
        "Algorithm III directly": (at_depth(case, third), third),
        "whitened, matched start directly": (at_depth(case, ours.start.w), ours.start.w),
        "Algorithm I as published, from III": (published[0][0], published[1]),
        "true depth, Gaussian masks": (at_depth(case, case.w, broad), None),
        "true depth, true masks": (at_depth(case, case.w), case.w),
        f"this station ({seconds:.0f} s)": (np.asarray(ours.sharp[0]), ours.w),
    }
    print(f"\n{case.name}" + ("" if known is None else f"   oracle {known:.2f}"))
    for name, (u, w) in rows.items():
        print(f"  {name:42s} {case.error(u):7.2f}" + ("" if w is None else f"   w {case.w_error(w):.3f} px"))


def main() -> None:
    """Print environment and one table for each case."""
    folder = Path(sys.argv[1])
    cases = json.loads((folder / "cases.json").read_text())
    print(f"Python {platform.python_version()}, {platform.machine()}")
    for name in sys.argv[2:] or cases:
        compare(Case(folder, name), cases.get(name, {}).get("known_depth_tikhonov_rmse"))


if __name__ == "__main__":
    main()
