"""Speed and accuracy of the PSF from the chart: the real photograph, and the photographs with known PSFs.

python tests/benchmarks/pattern_psf.py [folder of shared data]
"""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "procedures" / "pattern_psf")]

import cv2  # noqa: E402
import numpy as np  # noqa: E402  (one thread must be asked for before numpy loads)
from alignment import aligned_error  # noqa: E402

from procedures.pattern import Chart  # noqa: E402
from procedures.pattern_psf.estimate import PatternParameters, estimate_psf  # noqa: E402
from procedures.raw import Plane, read_frame  # noqa: E402

PUBLISHED_S = {"ls": 0.40, "nnls": 1.27}
"""The published C program on the same photograph, in seconds of one core of the machine it was measured on."""
REPEATS = 15


def plane(path: Path) -> Plane:
    """The grey plane of a picture."""
    return read_frame(path).planes["Y"]


def speed(folder: Path) -> None:
    """Processor time of warm estimates of the real photograph, MTF and derived numbers included."""
    photograph = plane(folder / "img_example.pgm")
    chart = Chart.from_image(plane(folder / "pattern_noise.pgm").samples)
    for solver, published in PUBLISHED_S.items():
        times = []
        for _ in range(REPEATS + 1):
            start = time.process_time()
            found = estimate_psf(photograph, chart, PatternParameters(4, 17, solver)).value
            assert found is not None
            assert found.quality.numbers
            times.append(time.process_time() - start)
        best, median = min(times[1:]), sorted(times[1:])[REPEATS // 2]
        print(
            f"  {solver:5s} best {1e3 * best:5.0f} ms, median {1e3 * median:5.0f} ms of {REPEATS}; "
            f"{best / published:.2f} of the published program's {published} s"
        )


def accuracy(folder: Path) -> None:
    """Relative L2 errors after the best shift, over the bound of each case."""
    chart = Chart.from_image(plane(folder / "bits.pgm").samples)
    for name, known in json.loads((folder / "cases.json").read_text()).items():
        k = known["support"]
        truth = np.loadtxt(folder / f"{name}_truth_s4_k{k}.txt")
        bound = np.hypot(known["bound_relative_l2"], known["truncation_floor"])
        for solver in ("ls", "nnls"):
            outcome = estimate_psf(plane(folder / f"{name}.pgm"), chart, PatternParameters(4, k, solver))
            if outcome.value is None:
                print(f"  {name:14s} {solver:5s} refused: {outcome.reason}")
                continue
            error, shift = aligned_error(outcome.value.psf.h, truth)
            print(
                f"  {name:14s} {solver:5s} error {100 * error:5.2f} %, {error / bound:.2f} of the bound; "
                f"centre off by {np.abs(shift).max() / 4:.4f} pixel; {outcome.verdict}"
            )


def main() -> None:
    """Print the environment and both tables."""
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT.parent / "shared" / "data"
    print(f"Python {platform.python_version()}, numpy {np.__version__}, {os.cpu_count()} cores, one thread used")
    cv2.setNumThreads(1)
    print("one warm estimate, 328 x 292 pixels, s = 4, k = 17:")
    speed(data / "pattern_photo")
    print("known PSFs:")
    accuracy(data / "synthetic" / "pattern")


if __name__ == "__main__":
    main()
