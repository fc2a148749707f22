"""Calibration of the probability that MTF50 lies within two stated uncertainties, on the adversarial photographs.

Photographs of `adversarial.py`, clean and with each of its corruptions, are estimated; a logistic model of the checks'
statistics is fitted to whether the true MTF50 lies within two stated uncertainties. The even seeds are fitted, the odd
ones show the reliability: in each class of stated probability, the share that lies within. With --write the model of
all seeds is written with its provenance, which `procedures.pattern_psf.probability` reads.

`python -m tests.benchmarks.verdict_probability [--count 8] [--seed 11] [--write]`
"""

import argparse
import json
import platform
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from procedures.outcome import Check, Outcome, Verdict, verdict_of
from procedures.pattern import Chart
from procedures.pattern_psf import estimate, probability
from tests.benchmarks.adversarial import CORRUPTIONS, photograph

Array = np.ndarray
Case = tuple[int, str, Verdict, dict[str, float], bool]
"""Seed, corruption, verdict, features, whether the truth lies within two stated uncertainties."""

HEADLINE = "mtf50_horizontal"
PENALTY = 0.02
"""Weight of the squared coefficients, against fitting the features that few photographs show."""
CLASSES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.0)


def cases(count: int, first: int) -> list[Case]:
    """All photographs with a number."""
    seen: list[list[Check]] = []

    def keep(checks: list[Check], value: object = None) -> Outcome:
        seen.append(list(checks))
        return verdict_of(checks, value)

    estimate.verdict_of = keep
    chart, sharp, found = Chart.from_seed(), estimate.PatternParameters(print_blur=0.0), []
    for name, corruption in CORRUPTIONS.items():
        if corruption.distort is not None:
            continue
        for seed in range(1000 * first, 1000 * first + (4 * count if name == "clean" else count)):
            shot = photograph(seed, corruption, source="grey", scene="chart")
            seen.clear()
            outcome = estimate.estimate_psf(shot.plane, chart, sharp)
            number = None if outcome.value is None else outcome.value.quality.numbers.get(HEADLINE)
            if number is None:
                continue
            given = probability.features(seen[-1], number.uncertainty / number.value)
            within = abs(number.value - shot.mtf50) < 2 * number.uncertainty
            found.append((seed, name, outcome.verdict, given, bool(within)))
    return found


def fitted(some: list[Case]) -> tuple[float, dict[str, float]]:
    """Intercept and coefficients of the features."""
    names = sorted({name for case in some for name in case[3]})
    X = np.array([[case[3].get(name, 0.0) for name in names] for case in some])
    y = np.array([1.0 if case[4] else -1.0 for case in some])

    def loss(w: Array) -> tuple[float, Array]:
        score = y * (X @ w[1:] + w[0])
        slope = -y / (1 + np.exp(score)) / len(y)
        return (
            float(np.mean(np.logaddexp(0, -score)) + PENALTY * w[1:] @ w[1:] / 2),
            np.append(slope.sum(), X.T @ slope + PENALTY * w[1:]),
        )

    w = minimize(loss, np.zeros(len(names) + 1), jac=True, method="L-BFGS-B").x
    return float(w[0]), dict(zip(names, w[1:].tolist(), strict=True))


def stated(model: tuple[float, dict[str, float]], some: list[Case]) -> Array:
    """Probabilities by a model."""
    scores = [model[0] + sum(w * case[3].get(name, 0.0) for name, w in model[1].items()) for case in some]
    return 1 / (1 + np.exp(-np.array(scores)))


def main() -> None:
    """Print the reliability, and write the model if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=8)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    found = cases(given.count, given.seed)
    even, odd = ([case for case in found if case[0] % 2 == part] for part in (0, 1))
    p, within = stated(fitted(even), odd), np.array([case[4] for case in odd])
    print(f"{len(found)} photographs with a number, {np.mean([case[4] for case in found]):.0%} within")
    print("stated probability   photographs   mean stated   within two uncertainties")
    for low, high in pairwise(CLASSES):
        these = (p >= low) & (p < high)
        if these.any():
            print(f"{low:.2f} to {high:.2f} {these.sum():18d} {p[these].mean():13.2f} {within[these].mean():13.2f}")
    for verdict in (Verdict.PASS, Verdict.DOUBTFUL):
        these = np.array([case[2] is verdict for case in odd])
        print(f"{verdict}: {these.sum()}, mean stated {p[these].mean():.2f}, within {within[these].mean():.2f}")
    print(f"Brier score {np.mean((p - within) ** 2):.3f}, of the mean alone {np.var(within):.3f}")
    if given.write:
        intercept, coefficients = fitted(found)
        model = {
            "headline": HEADLINE,
            "made_by": f"tests/benchmarks/verdict_probability.py --count {given.count} --seed {given.seed}",
            "photographs": len(found),
            "versions": {"python": platform.python_version(), "numpy": np.__version__},
            "intercept": round(intercept, 4),
            "coefficients": {name: round(weight, 4) for name, weight in coefficients.items()},
        }
        target = Path(probability.__file__).with_name(probability.FILE)
        target.write_text(json.dumps(model, indent=1) + "\n", encoding="utf-8")
        print(f"wrote {target.name}")


if __name__ == "__main__":
    main()
