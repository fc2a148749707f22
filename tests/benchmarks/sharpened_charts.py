"""Unsharp masks on photographs of the chart: which are told, by the noise and by the PSF's ring, and which pass wrong.

Cameras are analytic (tests/procedures/pattern_psf/analytic_camera.py), noise is that of photons, 0.8 % of the contrast
at white. Told are the share of photographs that is doubted as sharpened, how much of that the noise alone tells, and
the amount that the noise tells; of photographs as they are, false alarms.

python -m tests.benchmarks.sharpened_charts [photographs of each kind, 4] [unsharpened ones of each camera, 40]
"""

import sys

import numpy as np

from procedures.outcome import Verdict, causes_of
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.raw import Plane
from tests.procedures.pattern_psf.analytic_camera import View, circular, exposed, light, mtf50
from tests.procedures.pattern_psf.damage import sharpened

CHART = Chart.from_seed(1)
CAMERAS = {"f/2.8": circular(3.25), "f/5.6": circular(1.62, fill=0.9), "f/8": circular(1.14, blur_px=0.3)}
AMOUNTS, RADII = (0.05, 0.1, 0.2, 0.5), (0.7, 1.0, 2.0)
SETTINGS = PatternParameters(4, 17, chosen=True)


def masked(plane: Plane, amount: float, radius: float) -> Plane:
    """The photograph as a camera would sharpen it, in as many steps."""
    most = round(1 / plane.quantisation)
    samples = np.clip(sharpened(amount, radius)(plane.samples.astype(np.float64)), 0, 1)
    return Plane("Y", (np.round(samples * most) / most).astype(np.float32), plane.quantisation)


def found(plane: Plane) -> tuple[PatternPsf, Verdict, str]:
    """The estimate, its verdict and the reasons of all its causes."""
    outcome = estimate_psf(plane, CHART, SETTINGS)
    assert outcome.value is not None, outcome.reason
    return outcome.value, outcome.verdict, "; ".join(one.reason for one in causes_of(outcome))


def main() -> None:
    """Print the table of masks, then the false alarms."""
    asked = [int(one) for one in sys.argv[1:]]
    count, unsharpened = (*asked, *(4, 40)[len(asked) :])
    pictures = {name: light(otf, CHART, View()) for name, otf in CAMERAS.items()}
    print("mask          doubted as sharpened, by noise alone; the noise tells amount; passes, MTF50 too high there by")
    for amount in AMOUNTS:
        for radius in RADII:
            told, by_noise, amounts, passes = 0, 0, [], []
            for name, picture in pictures.items():
                for seed in range(count):
                    plane = masked(exposed(picture, np.random.default_rng(seed)), amount, radius)
                    value, verdict, reason = found(plane)
                    sure = "anticorrelated" in reason
                    told, by_noise = told + ("sharpened" in reason), by_noise + sure
                    amounts += [value.diagnostics["sharpened_by"]] if sure else []
                    if verdict is Verdict.PASS:
                        number = value.quality.numbers["mtf50_horizontal"]
                        passes.append(number.value / mtf50(CAMERAS[name]) - 1)
            n = count * len(pictures)
            tells = f"{np.median(amounts):.2f}" if amounts else "-"
            high = f"{min(passes):+.1%} to {max(passes):+.1%}" if passes else "-"
            told_so = f"{told:2d}, {by_noise:2d} of {n}; {tells}"
            print(f"{amount:4g}, {radius:g} px   {told_so}; {len(passes)}, {high}", flush=True)
    sigmas, alarms = [], 0
    for picture in pictures.values():
        for seed in range(unsharpened):
            bits, noise = (14, 0.008) if seed % 2 else (8, 0.015)
            plane = exposed(picture, np.random.default_rng([7, seed]), bits=bits, noise=noise)
            value, _, reason = found(plane)
            sigmas.append(value.diagnostics["sharpened_by"] / value.diagnostics["sharpening_uncertainty"])
            alarms += "sharpened" in reason
    print(
        f"as they are: {alarms} of {len(sigmas)} doubted as sharpened; by noise {max(sigmas):.2f} standard "
        f"uncertainties at most, 95 % under {np.quantile(sigmas, 0.95):.2f}"
    )


if __name__ == "__main__":
    main()
