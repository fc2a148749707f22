"""Speed and accuracy of the PSF from the chart: the real photograph, and the photographs with known PSFs.

python -m tests.benchmarks.pattern_psf [folder of shared data]
"""

import json
import os
import platform
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from procedures import Chart, PatternParameters, Plane, estimate_psf, read_frame
from tests.benchmarks import SHARED, options
from tests.procedures.pattern_psf.alignment import aligned_error

PUBLISHED_S = {"ls": 0.40, "nnls": 1.27}
"""The published C program on the same photograph, in seconds of one core of the machine it was measured on."""
REPEATS = 15
ADDED = (0.0, 0.02, 0.033)
"""Standard deviations of the noise added to the photographs with known PSFs, in units of full scale: nothing, 3 % and
5 % of the contrast."""
PUBLISHED_NON_NEGATIVE = {
    ("front_gauss", 0.0): 0.0218,
    ("front_gauss", 0.02): 0.0687,
    ("tilted_gauss", 0.0): 0.0604,
    ("tilted_gauss", 0.02): 0.0917,
    ("tilted_gauss", 0.033): 0.1250,
}
"""Relative L2 errors, after the best shift, of the published C program's non-negative answers on the same photographs,
by name and noise added; where one is missing it did not find the chart, or its answer is far from any (error over
0.5). Write the photographs by

    python -m tests.benchmarks.pattern_psf [folder of shared data] --write FOLDER

and give each to `psf_estim -p bits.pgm -s 4 -k K -t 2 PHOTOGRAPH ANSWER`, K as in its name."""


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


@dataclass(frozen=True)
class Known:
    """A photograph whose PSF is known."""

    name: str
    added: float
    samples: npt.NDArray[np.float32]
    truth: npt.NDArray[np.float64]
    bound: float

    @property
    def k(self) -> int:
        """Samples along the PSF's side."""
        return len(self.truth)

    def error(self, chart: Chart, solver: str) -> tuple[float, str]:
        """Relative L2 error after the best shift, NaN where it is refused, and what is said of it."""
        photograph = Plane("Y", self.samples, 1 / 65535)
        outcome = estimate_psf(photograph, chart, PatternParameters(4, self.k, solver))
        if outcome.value is None:
            return float("nan"), f"refused: {outcome.reason}"
        error, shift = aligned_error(outcome.value.psf.h, self.truth)
        return error, f"centre off by {np.abs(shift).max() / 4:.4f} pixel; {outcome.verdict}"


def known_cases(folder: Path) -> Iterator[Known]:
    """The photographs with known PSFs, as they are and noisier."""
    for name, known in json.loads((folder / "cases.json").read_text()).items():
        truth = np.loadtxt(folder / f"{name}_truth_s4_k{known['support']}.txt")
        samples = plane(folder / f"{name}.pgm").samples
        for added in ADDED:
            noise = added * np.random.default_rng(3).standard_normal(samples.shape)
            noisy = np.round(np.clip(samples + noise, 0, 1) * 65535) / 65535
            bound = np.hypot(known["bound_relative_l2"], known["truncation_floor"])
            yield Known(name, added, noisy.astype(np.float32), truth, bound)


def accuracy(folder: Path) -> None:
    """Relative L2 errors after the best shift, over the bound of each case and over the published answers."""
    chart = Chart.from_image(plane(folder / "bits.pgm").samples)
    shares = []
    for known in known_cases(folder):
        for solver in ("ls", "nnls"):
            error, said = known.error(chart, solver)
            line = f"  {known.name:12s} + noise {known.added:.3f} {solver:5s} error {100 * error:5.2f} %"
            if known.added == 0:
                line += f", {error / known.bound:.2f} of the bound"
            published = PUBLISHED_NON_NEGATIVE.get((known.name, known.added)) if solver == "nnls" else None
            if published is not None:
                shares.append(error / published)
                line += f", {shares[-1]:.2f} of the published program's {100 * published:.2f} %"
            print(f"{line}; {said}")
    if shares:
        print(f"  non-negative over published: mean {np.mean(shares):.2f}, worst {max(shares):.2f}")


def write(folder: Path, out: Path) -> None:
    """The photographs with known PSFs as pictures of 16 bits, for another program."""
    out.mkdir(parents=True, exist_ok=True)
    for known in known_cases(folder):
        picture = np.round(known.samples * 65535).astype(np.uint16)
        cv2.imwrite(str(out / f"{known.name}_{known.added:.3f}_k{known.k}.pgm"), picture)


def main() -> None:
    """Print the environment and both tables, or write the photographs of the second."""
    asked = options(__doc__, "data", data=SHARED, write=None)
    data, synthetic = asked.data, asked.data / "synthetic" / "pattern"
    if asked.write is not None:
        write(synthetic, asked.write)
        return
    print(f"Python {platform.python_version()}, numpy {np.__version__}, {os.cpu_count()} cores, one thread used")
    cv2.setNumThreads(1)
    print("one warm estimate, 328 x 292 pixels, s = 4, k = 17:")
    speed(data / "pattern_photo")
    print("known PSFs:")
    accuracy(synthetic)


if __name__ == "__main__":
    main()
