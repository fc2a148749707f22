"""Damaged copies of the published photograph of the chart: how many are refused, doubtful, passed, and wrongly passed.

A pass is wrong where MTF50, along rows or columns, lies farther than three of its stated standard uncertainties from
the undamaged photograph's. An unsharp mask of a tenth leaves a PSF that a lens could have, too: such copies are
reported apart, and are not counted.

python -m tests.benchmarks.damaged_charts [words that the copies' names must hold]
"""

import sys
from collections import Counter

import numpy as np

from procedures import Chart, Plane, Verdict, read_frame
from procedures.pattern_psf.estimate import PatternPsf, estimate_psf
from tests.benchmarks import SHARED
from tests.procedures.pattern_psf.damage import CHANGES, SLIGHT, damaged

DATA = SHARED / "pattern_photo"
NUMBERS = ("mtf50_horizontal", "mtf50_vertical")
FAR = 3.0
"""Stated standard uncertainties from the undamaged value beyond which nothing may pass."""
STEPS = 255


def sigmas(found: PatternPsf, undamaged: PatternPsf) -> float:
    """How far MTF50 is off, in stated uncertainties: the larger of both directions'."""
    a, b = found.quality.numbers, undamaged.quality.numbers
    if any(name not in a for name in NUMBERS):
        return float("inf")
    return max(abs(a[name].value - b[name].value) / a[name].uncertainty for name in NUMBERS)


def main() -> None:
    """Print every copy, and the counts."""
    photograph = read_frame(DATA / "img_example.pgm").planes["Y"]
    chart = Chart.from_image(read_frame(DATA / "pattern_noise.pgm").planes["Y"].samples)
    base = estimate_psf(photograph, chart).value
    assert base is not None
    verdicts, wrong = Counter[str](), []
    for name in CHANGES | SLIGHT:
        if not all(word in name for word in sys.argv[1:]):
            continue
        samples = np.round(STEPS * damaged(photograph.samples, name)) / STEPS
        outcome = estimate_psf(Plane("Y", samples.astype(np.float32), 1 / STEPS), chart)
        verdicts[outcome.verdict] += name in CHANGES
        if outcome.value is None:
            print(f"{name:30s} refused   {outcome.reason}", flush=True)
            continue
        off = sigmas(outcome.value, base)
        one, true = (found.quality.numbers.get(NUMBERS[0]) for found in (outcome.value, base))
        stated = "no MTF50" if one is None or true is None else (
            f"{one.value / true.value - 1:+7.2%} ± {one.uncertainty / one.value:.2%}"
        )  # fmt: skip
        far = off > FAR and outcome.verdict is Verdict.PASS
        wrong += [name] if far and name in CHANGES else []
        mark = "WRONG" if far else ""
        print(f"{name:30s} {outcome.verdict:9s} {stated}, {off:5.1f} σ {mark:5s} {outcome.reason}", flush=True)
    count = verdicts.total()
    print(f"{count} copies: {dict(verdicts)}; refused {verdicts[Verdict.REFUSED] / count:.0%}")
    print(f"passes farther than {FAR:g} stated uncertainties from the undamaged value: {', '.join(wrong) or 'none'}")


if __name__ == "__main__":
    main()
