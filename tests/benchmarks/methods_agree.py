"""One simulated camera by the chart, by two photographs and by slanted edges: do they give the same numbers?

Cameras are analytic transfer functions that have no end, each drawn by three renderers that share nothing with each
other (tests/procedures/pattern_psf/analytic_camera.py, two_photo/endless.py, slanted_edge/analytic.py), nor with the
estimators. The chart is photographed once for every s: auto, 2, 3, 4 and 5. Of every pair of results that pass, every
number that both have is compared: MTF50, MTF at Nyquist and FWHM, along rows and along columns. An edge's numbers are
along its normal, and so are the chart's and the wall's that it is held against.

python -m tests.benchmarks.methods_agree [cameras of each kind, default 1]
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from procedures import Chart, Outcome, Plane, Psf, Roi, Verdict
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf
from procedures.pattern_psf.estimate import estimate_psf as by_chart
from procedures.quality import Quality, mtf50_along, mtf_along
from procedures.slanted_edge.estimate import EdgeMtf, estimate_edge
from procedures.two_photo.estimate import TwoPhotoPsf
from procedures.two_photo.estimate import estimate_psf_of_pair as by_wall
from tests.procedures.pattern_psf import analytic_camera as of_chart
from tests.procedures.slanted_edge import analytic as of_edge
from tests.procedures.two_photo import endless as of_wall

CHART = Chart.from_seed(1)
CAMERAS = {
    "f/2.8, cutoff 3.25": {"cutoff": 3.25},
    "f/5.6, cutoff 1.62, fill 0.9": {"cutoff": 1.62, "fill": 0.9},
    "f/8, cutoff 1.14, blur 0.3": {"cutoff": 1.14, "blur_px": 0.3},
}
SAMPLINGS = (None, 2, 3, 4, 5)
VIEW = of_chart.View(width_px=91, size_px=154)
"""s/t is 0.71 at s = 2 and 1.78 at s = 5: good for all."""
APART = 2.5
"""Combined standard uncertainties within which results agree."""
AXES = {"horizontal": 0.0, "vertical": 90.0}
NUMBERS = ("mtf50", "mtf_nyquist", "fwhm")


@dataclass(frozen=True)
class Answer:
    """One result: where it comes from, its numbers with their uncertainties, and its PSF or its edge's normal."""

    method: str
    numbers: dict[str, tuple[float, float]]
    psf: Psf | None = None
    normal_deg: float = 0.0


def answers(camera: dict[str, float], seed: int) -> Iterator[Answer]:
    """All results of one camera that pass; the others are reported."""
    picture = of_chart.light(of_chart.circular(**camera), CHART, VIEW, fine=10, points=6)
    for number, s in enumerate(SAMPLINGS):
        plane = of_chart.exposed(picture, np.random.default_rng([seed, number]))
        name = f"chart, s = {s or 'auto'}"
        yield from _of_psf(name, by_chart(plane, CHART, PatternParameters(s)))
    zoom, wall = (3.8, 4.6)[seed % 2], ("leaves", "pink")[seed % 2]
    pair = of_wall.photographs(of_chart.circular(**camera), wall=wall, zoom=zoom, noise=0.005, seed=seed, size=160)
    planes = (Plane("Y", np.asarray(one, np.float32), 1 / 65535) for one in (pair.near, pair.far))
    yield from _of_psf("two photographs", by_wall(*planes))
    rng = np.random.default_rng([seed, 100])
    for axis in AXES:
        light = of_edge.edge(of_edge.Camera(**camera), angle_deg=rng.uniform(3, 8), shift_px=rng.uniform(-0.5, 0.5))
        plane = of_edge.photograph(light if axis == "horizontal" else light.T, rng)
        outcome = estimate_edge(plane, Roi.whole(plane.samples))
        if passed(f"edge, {axis}", outcome):
            yield _of_edge(axis, outcome.value)


def passed(name: str, outcome: Outcome[object]) -> bool:
    """Whether it is compared; why not is reported."""
    if outcome.verdict is not Verdict.PASS:
        print(f"  {name}: {outcome.verdict}, {outcome.reason}")
    return outcome.verdict is Verdict.PASS


def _of_psf(name: str, outcome: Outcome[PatternPsf] | Outcome[TwoPhotoPsf]) -> Iterator[Answer]:
    if passed(name, outcome):
        quality: Quality = outcome.value.quality
        stated = {
            key: (one.value, one.uncertainty)
            for key, one in quality.numbers.items()
            if key.rpartition("_")[0] in NUMBERS and key.rpartition("_")[2] in AXES
        }
        yield Answer(name, stated, outcome.value.psf)


def _of_edge(axis: str, found: EdgeMtf) -> Answer:
    stated = {f"{key}_{axis}": (found.numbers[key].value, found.numbers[key].uncertainty) for key in NUMBERS[:2]}
    return Answer(f"edge, {axis}", stated, None, found.normal_deg)


def along(one: Answer, other: Answer, name: str) -> tuple[float, float]:
    """A number of `one` as `other` shows it: along the edge's normal where that is one."""
    value, uncertainty = one.numbers[name]
    if one.psf is None or other.psf is not None:
        return value, uncertainty
    angle = float(np.radians(other.normal_deg))
    if name.startswith("mtf50"):
        found = mtf50_along(one.psf, angle)
        assert found is not None
        return found[0], uncertainty
    return float(mtf_along(one.psf, np.array([0.5]), angle)[0][0]), uncertainty


def main() -> None:
    """Print every comparison that is far, and the shares."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    apart: dict[tuple[str, str], list[float]] = {}
    for name, camera in CAMERAS.items():
        for seed in range(count):
            print(f"{name}, {seed + 1} of {count}", flush=True)
            for a, b in combinations(answers(camera, seed), 2):
                for number in sorted(a.numbers.keys() & b.numbers.keys()):
                    (x, u), (y, v) = along(a, b, number), along(b, a, number)
                    sigmas = (x - y) / np.hypot(u, v)
                    pair = " and ".join(sorted({one.method.split(",")[0] for one in (a, b)}))
                    apart.setdefault((pair, number.rpartition("_")[0]), []).append(sigmas)
                    if abs(sigmas) > APART:
                        print(
                            f"  {number}: {a.method} {x:.4f} ± {u:.4f}, {b.method} {y:.4f} ± {v:.4f}: {sigmas:+.1f} σ"
                        )
    for (pair, number), some in sorted(apart.items()):
        report(f"{pair}, {number}", some)
    report("between methods", [z for (pair, _), some in apart.items() if " and " in pair for z in some])
    report("all", [z for some in apart.values() for z in some])


def report(name: str, sigmas: list[float]) -> None:
    """How many agree."""
    z = np.abs(sigmas)
    print(
        f"{name:40s} {np.mean(z <= APART):6.1%} of {len(z):3d} within {APART} combined uncertainties; "
        f"rms {np.sqrt(np.mean(z**2)):.2f}, mean {np.mean(sigmas):+.2f}, worst {z.max():.1f}"
    )


if __name__ == "__main__":
    main()
