"""Witnessed captures by the independent renderer of `adversarial.py`: which corruptions four photographs reveal.

`python -m tests.benchmarks.witnessed [--count 6] [--seed 21]` prints, for each corruption, how often a single
photograph passes, how often the witnessed one does, and the mean error of MTF50.
"""

from dataclasses import replace

import numpy as np

from procedures import Chart, Outcome, Plane, Verdict, estimate_psf
from procedures.pattern_psf.witness import Photographs, WitnessedPsf, witnessed_psf
from tests.benchmarks import options
from tests.benchmarks.adversarial import Corruption, Lens, Pose, chart_light, curve, shoulder, srgb, unsharp, veil

RATIO, WHITE_E, READ_E, STEPS = 2.0, 2e4, 4.0, 65535
FAR, NEAR = 84.0, 128.0
"""Widths of the noise region in the two distances, pixels."""
CORRUPTIONS = {
    "clean": Corruption(raw=True),
    "gamma 1.1": curve(lambda x: x ** (1 / 1.1)),
    "sRGB": curve(srgb),
    "soft shoulder to 0.95": shoulder(0.5, 0.95),
    "veil 20 % of 15 px": veil(0.2, 15),
    "print blurred by 0.5 cell": Corruption(print_cells=0.5, raw=True),
    "unsharp mask 5 % of 1 px": unsharp(0.05, 1.0),
    "unsharp mask 10 % of 3 px": unsharp(0.1, 3.0),
}  # fmt: skip


def photographs(seed: int, corruption: Corruption) -> tuple[Photographs, float]:
    """The four photographs of a lens, and its true MTF50 along rows."""
    rng = np.random.default_rng(seed)
    lens = Lens(float(rng.uniform(1.2, 2.5)), float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.7, 1.0)))
    lens = replace(lens, **corruption.lens)
    angle, shift = float(rng.uniform(2, 6)), float(rng.uniform(-0.4, 0.4))
    dark, bright = 0.06, 0.8

    def plane(width: float, exposure: float, optics: Lens) -> Plane:
        pose = Pose(angle, shift, (width - 100) / 0.25, 0, 0, dark, bright)
        light = exposure * chart_light(optics, pose, corruption, 1, rng)[0]
        signal = rng.poisson(np.maximum(light, 0) * WHITE_E) + READ_E * rng.standard_normal(light.shape)
        picture = signal / WHITE_E
        if corruption.process is not None:
            picture = corruption.process(picture, WHITE_E**-0.5, rng)
        return Plane("Y", (np.rint(picture * STEPS) / STEPS).astype(np.float32), 1 / STEPS, raw=False)

    far = plane(FAR, 1.0, lens)
    near, out = plane(NEAR, 1.0, lens), plane(FAR, 1.0, replace(lens, defocus=0.4))
    return Photographs(plane(FAR, 1 / RATIO, lens), far, near, out, RATIO), lens.mtf50(0.0)


def outcomes(seed: int, corruption: Corruption) -> tuple[Outcome, Outcome[WitnessedPsf], float]:
    """The long exposure alone, all four, and the true MTF50."""
    four, truth = photographs(seed, corruption)
    return estimate_psf(four.long, Chart.from_seed()), witnessed_psf(four, Chart.from_seed()), truth


def main() -> None:
    """A line for each corruption."""
    given = options(__doc__, count=6, seed=21)
    print(f"{'corruption':28s} error of MTF50   single passes   witnessed passes   why not")
    for name, corruption in CORRUPTIONS.items():
        runs = [outcomes(1000 * given.seed + i, corruption) for i in range(given.count)]
        errors = [
            one.value.quality.numbers["mtf50_horizontal"].value / truth - 1 for one, _, truth in runs if one.value
        ]
        single, witnessed = (
            [one.verdict is Verdict.PASS for one in ones] for ones in list(zip(*runs, strict=True))[:2]
        )
        reason = next((one.reason for _, one, _ in runs if one.reason), "")
        print(f"{name:28s} {np.mean(errors):+14.1%} {np.mean(single):15.0%} {np.mean(witnessed):18.0%}   {reason[:90]}",
              flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
