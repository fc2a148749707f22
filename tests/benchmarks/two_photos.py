"""Two photographs: processor time of the published pair, errors on the walls kept beside the project, the noise's bias.

BLAS gets one thread, as the command line gives it: threads that wait in a loop count as processor time.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import platform
import time
from pathlib import Path

import cv2
import numpy as np
import scipy.optimize

from procedures.raw import Plane, read_frame
from procedures.two_photo.estimate import TwoPhotoParameters, TwoPhotoPsf, estimate_psf_of_pair

RUNS = 7
PUBLISHED_S = 2.0
"""Processor time of the published program on the same pair, s = 3, k = 13."""
DATA = Path(os.environ.get("STATION_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data"))


def planes(*names: str) -> list[Plane]:
    """The only planes of grey images."""
    return [read_frame(DATA / name).planes["Y"] for name in names]


def found(pair: list[Plane], solver: str = "nnls") -> TwoPhotoPsf:
    """The answer, which must be there."""
    outcome = estimate_psf_of_pair(*pair, TwoPhotoParameters(s=3, k=13, solver=solver))
    if outcome.value is None:
        raise SystemExit(outcome.reason)
    return outcome.value


def processor_time(pair: list[Plane]) -> float:
    """Least of some runs in a process that has compiled everything, seconds."""
    times = []
    for _ in range(RUNS):
        start = time.process_time()
        found(pair)
        times.append(time.process_time() - start)
    return min(times)


def relative_error(h: np.ndarray, truth: np.ndarray) -> float:
    """L2 error over the truth's norm, after the best subpixel shift."""
    k = len(h)
    f = np.fft.fftfreq(2 * k)
    wide = np.fft.fft2(np.pad(h, (0, k)))

    def error(shift: np.ndarray) -> float:
        turned = wide * np.exp(-2j * np.pi * (f[:, None] * shift[1] + f * shift[0]))
        return float(np.linalg.norm(np.real(np.fft.ifft2(turned))[:k, :k] - truth))

    return scipy.optimize.minimize(error, np.zeros(2), method="Nelder-Mead").fun / float(np.linalg.norm(truth))


def main() -> None:
    """Print environment, times and errors."""
    cv2.setNumThreads(1)
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores, best of {RUNS}")
    pair = planes("two_photos/IMG_0608_v1.pgm", "two_photos/IMG_0602_v1_CUT.pgm")
    spent = processor_time(pair)
    real = found(pair)
    published = np.loadtxt(DATA / "reference/real_two_psf_s3_k13.txt")
    correlation = np.corrcoef(real.psf.h.ravel(), published.ravel())[0, 1]
    print(f"published pair, s = 3, k = 13: {spent:.3f} s, {spent / PUBLISHED_S:.2f} x the published program")
    print(f"  correlation with its PSF {correlation:.4f}, scale {real.scale[0]:.4f} {real.scale[1]:.4f}")
    for wall in ("a", "b"):
        pair = planes(*(f"synthetic/two_photo/wall_{wall}_{which}.pgm" for which in ("near", "far")))
        truth = np.loadtxt(DATA / f"synthetic/two_photo/wall_{wall}_truth_s3_k13.txt")
        errors = ", ".join(f"{s} {relative_error(found(pair, s).psf.h, truth):.2%}" for s in ("ls", "clip", "nnls"))
        bias = found(pair).diagnostics["near_noise_bias"]
        print(f"wall {wall}: error {errors}; the near photograph's noise alone {bias:.2%} of the kernel")


if __name__ == "__main__":
    main()
