"""MTF50 across edges whose truth has no end, beside a plain chain of ISO 12233:2017, e-SFR.

Edges are drawn from analytic transfer functions (tests/procedures/slanted_edge/analytic.py): diffraction at four
cutoffs, what a sharp camera reads, sharpened pictures. The plain chain has four bins to a pixel, the correction of its
derivative, a Hamming window over the whole region, and nothing else.

python -m tests.benchmarks.slanted_edge_truth [frames of each diffraction, default 100] [of each other, default 20]
"""

import sys
from collections.abc import Sequence

import numpy as np

from procedures import Diffraction, Roi, estimate_edge
from procedures.outcome import Quantity
from tests.procedures.slanted_edge.analytic import Array, Camera, edge, photograph

DIFFRACTION = {
    "f_c 3.25 (f/2.8)": Camera(3.25),
    "f_c 1.62 (f/5.6), fill 0.9": Camera(1.62, fill=0.9),
    "f_c 1.14 (f/8), blur 0.3": Camera(1.14, blur_px=0.3),
    "f_c 0.57 (f/16)": Camera(0.57),
}
SHARP = {
    **{f"blur, MTF50 {m}": Camera.of_mtf50(m) for m in (0.1, 0.3, 0.5)},
    "pixel alone": Camera(),
    "f_c 2.5, fill 0.6": Camera(2.5, fill=0.6),
    "f_c 4, fill 0.6": Camera(4.0, fill=0.6),
    "sharpened, radius 1": Camera.of_mtf50(0.55, sharpening=1.0, halo_px=1.0),
    "sharpened, radius 3": Camera.of_mtf50(0.55, sharpening=0.5, halo_px=3.0),
}
BINS = 4


def plain_mtf50(samples: Array) -> float:
    """MTF50 by the steps of ISO 12233:2017, annex D, of an edge that is bright on the right."""
    rows, columns = samples.shape
    x, y = np.arange(columns), np.arange(rows)
    steps = np.zeros_like(samples)
    steps[:, 1:-1] = (samples[:, 2:] - samples[:, :-2]) / 2
    line = np.array([0.0, (columns - 1) / 2])
    for _ in range(3):
        weight = steps * _hamming(x - np.polyval(line, y)[:, None], columns)
        line = np.polyfit(y, (weight @ x) / weight.sum(axis=1), 1)
    bins = np.floor((x - np.polyval(line, y)[:, None]) * BINS).astype(int)
    middle = -bins.min()
    bins -= bins.min()
    count = np.bincount(bins.ravel())
    known = count > 0
    means = np.bincount(bins.ravel(), samples.ravel())[known] / count[known]
    esf = np.interp(np.arange(len(count)), np.flatnonzero(known), means)
    half = BINS * columns // 2
    esf = esf[max(middle - half, 0) : middle + half]
    lsf = np.zeros_like(esf)
    lsf[1:-1] = (esf[2:] - esf[:-2]) / 2
    lsf *= _hamming(np.arange(len(lsf)) - np.sum(np.arange(len(lsf)) * lsf) / lsf.sum(), len(lsf))
    f = np.linspace(0, 1.5, 1501)
    mtf = np.abs(np.exp(-2j * np.pi * f[:, None] * np.arange(len(lsf)) / BINS) @ lsf)
    mtf = mtf / mtf[0] / np.sinc(2 * f / BINS)
    i = int(np.flatnonzero(mtf < 0.5)[0])
    across = f[i - 1] + (mtf[i - 1] - 0.5) / (mtf[i - 1] - mtf[i]) * (f[1] - f[0])
    return float(across / np.cos(np.arctan(line[0])))


def _hamming(x: Array, width: float) -> Array:
    return np.asarray(np.where(np.abs(x) < width / 2, 0.54 + 0.46 * np.cos(2 * np.pi * x / width), 0.0))


def series(name: str, camera: Camera, count: int, *, known: bool = False, noise: float = 0.004) -> None:
    """One line about `count` edges of one camera at random angles and places; `known`: its aperture is known."""
    rng, found, truths, plain, passed = np.random.default_rng(17), [], [], [], 0
    diffraction = Diffraction(1.0, camera.cutoff, 1000.0) if known else None
    for _ in range(count):
        angle, shift = rng.uniform(2.5, 12), rng.uniform(-0.5, 0.5)
        columns = 100 if camera.mtf50(5.0) < 0.15 else 60
        light = edge(camera, rows=100, columns=columns, angle_deg=angle, shift_px=shift)
        plane = photograph(light, rng, noise)
        outcome = estimate_edge(plane, Roi.whole(plane.samples), diffraction)
        passed += outcome.verdict == "pass"
        if outcome.value is not None:
            found.append(outcome.value.numbers["mtf50"])
            truths.append(camera.mtf50(angle))
            plain.append(plain_mtf50(plane.samples.astype(np.float64)))
    report(name, found, np.array(truths), np.array(plain), passed)


def report(name: str, found: Sequence[Quantity], truths: Array, plain: Array, passed: int) -> None:
    """Mean error, errors in units of their uncertainty, and the plain chain's mean error."""
    values, uncertainties = np.array([q.value for q in found]), np.array([q.uncertainty for q in found])
    z = (values - truths) / uncertainties
    print(
        f"  {name:36s} {truths.mean():.4f} {np.mean(values / truths) - 1:+7.2%} {np.mean(uncertainties / truths):6.2%} "
        f"{np.sqrt(np.mean(z**2)):5.2f} {np.mean(np.abs(z) < 2):5.0%} {passed:4d} of {len(found):3d} "
        f"{np.mean(plain / truths) - 1:+7.2%}",
        flush=True,
    )


def main() -> None:
    """Run the series."""
    counts = [int(n) for n in sys.argv[1:]]
    many, few = (counts + [100, 20][len(counts) :])[:2]
    print(f"  {'camera':36s}  MTF50    mean stated   rms  <2 s    pass     plain chain")
    for name, camera in DIFFRACTION.items():
        series(name, camera, many)
        series(f"{name}, aperture known", camera, many, known=True)
    for name, camera in SHARP.items():
        series(name, camera, few)


if __name__ == "__main__":
    main()
