"""Random photographs of the chart, and photographs without one: what is right, refused, and wrongly passed.

python -m tests.benchmarks.robustness [photographs, default 200] [chartless, default 100]
"""

import sys
from collections import Counter
from multiprocessing import get_context

import numpy as np

from procedures import Chart, Plane, estimate_psf
from tests.procedures.pattern_psf.alignment import aligned_error
from tests.simulators.random_scenes import Trials, random_camera, random_scene

WRONG = 3.0
"""Errors from this many times the expected on are wrong answers, not unlucky ones."""


def photograph(seed: int) -> tuple[str, float]:
    """What came of one random photograph: right, refused, or wrong with its verdict; and error over expected."""
    rng, trials, chart = np.random.default_rng(seed), Trials(), Chart.from_seed()
    camera = random_camera(rng, trials)
    shot = camera.photograph(random_scene(rng, camera, chart, trials), rng)
    outcome = estimate_psf(Plane("Y", shot.plane("Y").astype(np.float32), 1 / 65535), chart)
    if outcome.value is None:
        return f"refused: {outcome.reason[:70]}", float("nan")
    psf = outcome.value.psf
    truth = shot.true_psf("Y", psf.s, psf.k)
    error, _ = aligned_error(psf.h, truth.h)
    ratio = error / float(np.hypot(outcome.value.diagnostics["relative_uncertainty"], truth.floor))
    return ("right" if ratio < WRONG else f"WRONG with verdict {outcome.verdict}", ratio)


def clutter(seed: int) -> str:
    """What came of one photograph without a chart."""
    rng, trials = np.random.default_rng(10_000 + seed), Trials()
    camera = random_camera(rng, trials)
    shot = camera.photograph(random_scene(rng, camera, None, trials), rng)
    outcome = estimate_psf(Plane("Y", shot.plane("Y").astype(np.float32), 1 / 65535), Chart.from_seed())
    return f"refused: {outcome.reason[:40]}" if outcome.value is None else f"WRONG with verdict {outcome.verdict}"


def main() -> None:
    """Run both series on all cores and print the counts."""
    shots, empty = (int(n) for n in (sys.argv[1:] + ["200", "100"][len(sys.argv) - 1 :]))
    with get_context("spawn").Pool() as pool:
        found = pool.map(photograph, range(shots), chunksize=4)
        none = pool.map(clutter, range(empty), chunksize=4)
    ratios = np.array([ratio for _, ratio in found])
    print(f"{shots} random photographs, 60 to 300 pixels, any roll, tilt to 25 degrees, noise to 5 %, clutter:")
    for what, count in Counter(what for what, _ in found).most_common():
        print(f"  {count:4d} {what}")
    known = ratios[np.isfinite(ratios)]
    print(f"  error over expected: median {np.median(known):.2f}, 95 % under {np.quantile(known, 0.95):.2f}")
    print(f"{empty} photographs without a chart:")
    for what, count in Counter(none).most_common():
        print(f"  {count:4d} {what}")


if __name__ == "__main__":
    main()
