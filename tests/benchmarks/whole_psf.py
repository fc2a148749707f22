"""The chart's numbers against optics whose PSF has no end, and one photograph against itself at every s and k.

python -m tests.benchmarks.whole_psf [cameras | given | published] [folder of shared data]

Cameras are analytic transfer functions multiplied onto the scene's spectrum (tests/procedures/pattern_psf/
analytic_camera.py); nothing of it is shared with the estimator or the simulators. They count as RAW files of a print of
known sharpness, as what a picture does not exclude would hide the rest. Errors are over the stated uncertainties.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from procedures import Chart, PatternParameters, Verdict, estimate_psf, read_frame
from tests.benchmarks import SHARED
from tests.procedures.pattern_psf.analytic_camera import Otf, View, circular, exposed, light, mtf50

CHART = Chart.from_seed(1)
CAMERAS: dict[str, Otf] = {
    "f/2.8, cutoff 3.25": circular(3.25),
    "f/5.6, cutoff 1.62, fill 0.9": circular(1.62, fill=0.9),
    "f/8, cutoff 1.14, blur 0.3": circular(1.14, blur_px=0.3),
    "f/16, cutoff 0.57": circular(0.57),
}
GIVEN = ((None, 9), (None, 13), (None, 25), (2, 9), (3, 13))
NUMBERS = ("mtf50_horizontal", "mtf50_vertical", "mtf_nyquist_horizontal", "mtf_nyquist_vertical")
SEEDS = 2


def truths(otf: Otf) -> list[float]:
    """The true values of NUMBERS."""
    half, none = np.array([0.5]), np.zeros(1)
    return [mtf50(otf, 0), mtf50(otf, 1), float(abs(otf(half, none)[0])), float(abs(otf(none, half)[0]))]


def cameras(asked: tuple[tuple[int | None, int | None], ...] = ((None, None),)) -> None:
    """Every camera at the program's own choice, or at given s and k."""
    errors, shares, passed, n = [], [], 0, 0
    for name, otf in CAMERAS.items():
        picture = light(otf, CHART, View(), fine=10, points=6)
        true = truths(otf)
        for seed in range(SEEDS):
            plane = replace(exposed(picture, np.random.default_rng(seed)), raw=True)
            for s, k in asked:
                start = time.process_time()
                outcome = estimate_psf(plane, CHART, PatternParameters(s, k, print_blur=0.0))
                took, n = time.process_time() - start, n + 1
                if outcome.value is None:
                    print(f"  {name:30s} s {s or 'auto'} k {k or 'auto'}: refused, {outcome.reason}")
                    continue
                numbers, psf = outcome.value.quality.numbers, outcome.value.psf
                sigmas = [
                    (numbers[one].value - t) / numbers[one].uncertainty for one, t in zip(NUMBERS, true, strict=True)
                ]
                if outcome.verdict is Verdict.PASS:
                    passed += 1
                    errors += sigmas
                    shares += [numbers[one].value / t - 1 for one, t in zip(NUMBERS[:2], true[:2], strict=True)]
                first = numbers[NUMBERS[0]]
                print(
                    f"  {name:30s} s {psf.s} k {psf.k:2d} {outcome.verdict:8s} MTF50 {true[0]:.4f}, found "
                    f"{first.value:.4f} ± {first.uncertainty:.4f}; off by {' '.join(f'{x:+.1f}' for x in sigmas)} σ; "
                    f"{took:.2f} s"
                )
    if errors:
        print(
            f"  {passed} of {n} pass; of those errors rms {np.sqrt(np.mean(np.square(errors))):.2f} σ rms, the worst "
            f"{np.abs(errors).max():.1f} σ; MTF50 is off by {100 * np.mean(shares):+.2f} % on average"
        )


def published(folder: Path) -> None:
    """The published photograph at k = 9 to 33 and s = 3 to 5: the largest distance of any two results that pass."""
    photograph = read_frame(folder / "img_example.pgm").planes["Y"]
    chart = Chart.from_image(read_frame(folder / "pattern_noise.pgm").planes["Y"].samples)
    passed = []
    for s, k in _grids():
        outcome = estimate_psf(photograph, chart, PatternParameters(s, k))
        if outcome.value is None:
            print(f"  s {s} k {k}: refused, {outcome.reason}")
            continue
        number = outcome.value.quality.numbers["mtf50_horizontal"]
        print(f"  s {s} k {k:2d} {outcome.verdict:8s} MTF50 along rows {number.value:.4f} ± {number.uncertainty:.4f}")
        if outcome.verdict is Verdict.PASS:
            passed.append(outcome.value.quality.numbers)
    for name in (*NUMBERS, "fwhm_horizontal", "fwhm_vertical", "encircled_energy_80"):
        apart = [
            abs(a[name].value - b[name].value) / np.hypot(a[name].uncertainty, b[name].uncertainty)
            for a, b in combinations(passed, 2)
        ]
        print(f"  {name}: {len(apart)} pairs, at most {max(apart):.1f} combined uncertainties apart")


def _grids() -> Iterator[tuple[int, int]]:
    return ((s, k) for s in (3, 4, 5) for k in (9, 13, 17, 25, 33))


def main() -> None:
    """Print what is asked for; all of it by default."""
    asked = sys.argv[1] if len(sys.argv) > 1 else ""
    data = Path(sys.argv[2]) if len(sys.argv) > 2 else SHARED
    if asked in ("", "cameras"):
        print("cameras, s and k chosen by the program:")
        cameras()
    if asked in ("", "given"):
        print("cameras, s and k given:")
        cameras(GIVEN)
    if asked in ("", "published"):
        print("the published photograph:")
        published(data / "pattern_photo")


if __name__ == "__main__":
    main()
