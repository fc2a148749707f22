"""Restoration against its rivals on the same photographs: RMSE in grey levels of 255, rim of 16 left out.

`python -m tests.benchmarks.restoration_rivals FOLDER [CASE ...]`, FOLDER as shared data's
synthetic/restoration. Rivals get the parameters, and where they take one depth the depth, that bring them nearest to
the truth; the station finds its own. Wiener and Richardson-Lucy need scikit-image.
"""

import json
import platform
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procedures.raw import read_frame
from procedures.restoration.first_depth import initial_depth
from procedures.restoration.joint import joint_descent
from procedures.restoration.joint.data_term import restore_picture
from procedures.restoration.joint.estimate import RestorationParameters, noise_of, restore
from procedures.restoration.masks.blur_models import gaussian, mask_stack, pillbox, read_shape
from procedures.restoration.masks.blur_operator import MaskStack
from tests.benchmarks import options

Array = NDArray[np.float64]
# grids on which rivals are tuned: depths as percentiles of the true w, Wiener's balance, iterations
PERCENTILES = (30, 50, 70)
BALANCES = (3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1)
LUCY = (5, 10, 20, 40, 80)
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

    def least_error(self, *pictures: Array) -> Array:
        """The picture nearest to the truth: a rival's parameters are tuned in its favour."""
        return min(pictures, key=self.error)


def at_depth(case: Case, *depths: Array, stacks: list[MaskStack] | None = None) -> Array:
    """The picture (H, W) at a given depth map; the best of several maps and weights, as the truth has it."""
    stacks = stacks or case.stacks
    sigma = noise_of(case.z, case.stacks)
    data, _ = joint_descent.problem_of(case.z, stacks, np.ones((2, 1, *case.w.shape)), np.float32)
    R, found = data.R, []
    for w in depths:
        least = max(sigma**2 / joint_descent.CONTRAST, 1e-6)
        data.focus(np.pad(w, R, mode="edge").astype(np.float32))
        u = np.pad(case.z.mean(axis=0), ((0, 0), (R, R), (R, R)), mode="edge").astype(np.float32)
        for weight in (100 * least, 10 * least, least):
            u = restore_picture(data, u, weight, 50)
            found.append(np.asarray(u[0, R:-R, R:-R], dtype=float))
    return case.least_error(*found)


def single_photograph(case: Case) -> dict[str, Array]:
    """Wiener and Richardson-Lucy of either photograph with the mask of one depth, each with the best parameters."""
    try:
        from skimage.restoration import richardson_lucy, wiener
    except ImportError:
        print("  scikit-image is not installed: Wiener and Richardson-Lucy are left out")
        return {}
    seen = [
        (np.clip(z[0], 0, 1), stack.at(float(np.percentile(case.w, p))))
        for z, stack in zip(case.z, case.stacks, strict=True)
        for p in PERCENTILES
    ]
    return {
        "Wiener (scikit-image), one PSF": case.least_error(*(wiener(z, h, b) for z, h in seen for b in BALANCES)),
        "Richardson-Lucy (scikit-image), one PSF": case.least_error(
            *(richardson_lucy(z, h, n) for z, h in seen for n in LUCY)
        ),
    }


def rivals(case: Case, start: Array) -> dict[str, tuple[Array, Array | None]]:
    """Pictures, and depths where they have one. start : our first depth."""
    sigmas = np.full(2, max(noise_of(case.z, case.stacks), 1.4e-3))
    second = initial_depth.algorithm_2(case.z, case.stacks, float(sigmas[0])).w
    third = initial_depth.algorithm_3(case.z, case.stacks, sigmas).w
    broad = case.masks([gaussian(), gaussian()])
    flat = [np.full_like(case.w, np.percentile(case.w, p)) for p in PERCENTILES]
    return {
        "blurred photograph": (case.least_error(*case.z[:, 0]), None),
        **{name: (u, None) for name, u in single_photograph(case).items()},
        "one PSF for the whole picture": (at_depth(case, *flat), None),
        "Algorithm II directly": (at_depth(case, second), second),
        "Algorithm III directly": (at_depth(case, third), third),
        "whitened, matched start directly": (at_depth(case, start), start),
        "true depth, Gaussian masks": (at_depth(case, case.w, stacks=broad), None),
        "true depth, true masks": (at_depth(case, case.w), case.w),
    }


def compare(case: Case, known: float | None) -> None:
    """Print one table."""
    start = time.process_time()
    ours = restore(list(case.z), case.stacks, RestorationParameters()).value
    seconds = time.process_time() - start
    assert ours is not None
    rows = rivals(case, ours.start.w)
    rows["this station"] = (np.asarray(ours.sharp[0]), ours.w)
    oracle = "" if known is None else f", oracle {known:.2f}"
    print(f"\n{case.name}: restored in {seconds:.0f} s of processor{oracle}\n  {'RMSE':>47s}   of ours   w, px")
    least = case.error(rows["this station"][0])
    for name, (u, w) in rows.items():
        depth_error = "" if w is None else f"{case.w_error(w):8.3f}"
        print(f"  {name:40s} {case.error(u):6.2f} {case.error(u) / least:8.2f} x {depth_error}", flush=True)


def main() -> None:
    """Print environment and one table for each case."""
    asked = options(__doc__, "folder", "cases", folder=Path, cases=[])
    cases = json.loads((asked.folder / "cases.json").read_text())
    print(f"Python {platform.python_version()}, {platform.machine()}")
    for name in asked.cases or cases:
        compare(Case(asked.folder, name), cases.get(name, {}).get("known_depth_tikhonov_rmse"))


if __name__ == "__main__":
    main()
