"""Calibration of the probability that MTF50 lies within two stated uncertainties, on the adversarial photographs.

`collect` estimates photographs of `adversarial.py`, clean and with each of its corruptions, and appends the checks'
statistics to a file, a line each. `fit` fits a logistic model for each kind of scene to whether the true MTF50 lies
within two stated uncertainties: the even seeds are fitted, the odd ones show the reliability, in each class of stated
probability the share that lies within; before that the coverage of the accepted photographs. With --write the models
of all seeds are written with their provenance, which `procedures.corruption.probability` reads. A photograph of a
chart counts twice: with the print's blur unknown, and stated as none.

`python -m tests.benchmarks.verdict_probability collect FILE --scene edge [--count 8] [--seed 11]`
`python -m tests.benchmarks.verdict_probability fit FILE [--write]`
"""

import argparse
import json
import platform
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from procedures.corruption import probability
from procedures.outcome import Check, Verdict
from tests.benchmarks.adversarial import CORRUPTIONS, CURVE, FAR, answered

Array = np.ndarray
Row = dict[str, Any]

SCENES = ("chart", "edge", "wall")
CLEAN_SHARE = 6
"""Clean photographs for each one of every corruption."""
PENALTY = 0.02
"""Weight of the squared coefficients, against fitting the features that few photographs show."""
CLASSES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.0)


def collect(target: Path, scene: str, count: int, first: int) -> None:
    """Append the cases of a scene: every corruption of a seed before the next seed."""
    seen: dict[float, Row] = {}

    def keep(_: str, checks: list[Check], relative: float, *, raw: bool, printed: float = 0.0) -> float:
        kept = [(c.name, float(c.statistic), float(c.threshold), c.least, bool(c.given), c.fails) for c in checks]
        number = len(seen) / 1e6
        seen[number] = {"checks": kept, "relative": relative, "printed": printed, "raw": raw}
        return number

    probability.within_two = keep
    for i in range(count):
        for name, corruption in CORRUPTIONS.items():
            if not corruption.shows(scene):
                continue
            for source in ("grey", "raw") if corruption.raw else ("grey",):
                for j in range(CLEAN_SHARE if name == "clean" else 1):
                    row = _case(scene, 10000 * first + i + 1000 * j, name, source, seen)
                    with target.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(row) + "\n")


def _case(scene: str, seed: int, name: str, source: str, seen: dict[float, Row]) -> Row:
    """One photograph, or pair of a wall: what was found, and the truth."""
    seen.clear()
    start = time.process_time()
    shot, answer = answered(scene, seed, CORRUPTIONS[name], source)
    row = {"scene": scene, "seed": seed, "name": name, "source": source, "verdict": answer.verdict,
           "reason": answer.reason, "truth": shot.mtf50, "seconds": round(time.process_time() - start, 2)}  # fmt: skip
    if np.isfinite(answer.mtf50):
        curve = [] if answer.curve is None else ((answer.curve - shot.curve) / answer.curve_uncertainty).tolist()
        row |= {"value": answer.mtf50, "u": answer.uncertainty, "curve": dict(zip(CURVE.tolist(), curve, strict=True))}
        row |= seen.get(answer.probability, {})
    return row


def rows_of(file: Path) -> list[Row]:
    """Cases with a number; a chart's twice, the second with a print of known sharpness."""
    read = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    known = [one for one in read if "checks" in one]
    return known + [
        one | {"relative": (one["relative"] ** 2 - one["printed"] ** 2) ** 0.5, "printed": 0.0}
        for one in known
        if one["scene"] == "chart" and not CORRUPTIONS[one["name"]].print_cells
    ]


def features(row: Row) -> dict[str, float]:
    """The features of a case."""
    checks = [
        Check(name, statistic, threshold, Verdict.DOUBTFUL, "", "", least=least, given=given)
        for name, statistic, threshold, least, given, _ in row["checks"]
    ]
    return probability.features(checks, row["relative"], row["printed"], raw=row["raw"])


def within(row: Row) -> bool:
    """Whether the truth lies within two stated uncertainties."""
    return bool(abs(row["value"] / row["truth"] - 1) < 2 * row["relative"] * row["value"] / row["truth"])


def fitted(some: list[Row]) -> tuple[float, dict[str, float]]:
    """Intercept and coefficients of the features."""
    given = [features(row) for row in some]
    names = sorted({name for one in given for name in one})
    X = np.array([[one.get(name, 0.0) for name in names] for one in given])
    y = np.array([1.0 if within(row) else -1.0 for row in some])

    def loss(w: Array) -> tuple[float, Array]:
        score = y * (X @ w[1:] + w[0])
        slope = -y / (1 + np.exp(score)) / len(y)
        return (
            float(np.mean(np.logaddexp(0, -score)) + PENALTY * w[1:] @ w[1:] / 2),
            np.append(slope.sum(), X.T @ slope + PENALTY * w[1:]),
        )

    w = minimize(loss, np.zeros(len(names) + 1), jac=True, method="L-BFGS-B").x
    return float(w[0]), dict(zip(names, w[1:].tolist(), strict=True))


def stated(model: tuple[float, dict[str, float]], some: list[Row]) -> Array:
    """Probabilities by a model."""
    given = [features(row) for row in some]
    scores = [model[0] + sum(w * one.get(name, 0.0) for name, w in model[1].items()) for one in given]
    return 1 / (1 + np.exp(-np.array(scores)))


def show_coverage(scene: str, found: list[Row]) -> None:
    """Print how many accepted photographs lie beyond three uncertainties, and within two, of MTF50 and of the curve."""
    accepted = {(row["name"], row["source"], row["seed"]): row for row in reversed(found) if row["verdict"] == "pass"}
    for kind, corrupted in (("all", (False, True)), ("corrupted", (True,))):
        rows = [row for (name, _, _), row in accepted.items() if (name != "clean") in corrupted]
        z = np.abs([(row["value"] - row["truth"]) / row["u"] for row in rows])
        curves = np.abs([list(row["curve"].values()) for row in rows])
        print(
            f"{scene}, {kind}: {len(rows)} accepted, {np.sum(z > FAR)} beyond {FAR:g} u, at most {z.max():.1f}, "
            f"within two {np.mean(z < 2):.1%}, curves {np.mean(curves < 2):.1%}"
        )


def show(scene: str, found: list[Row]) -> None:
    """Print the reliability of a scene."""
    even, odd = ([row for row in found if row["seed"] % 2 == part] for part in (0, 1))
    p, y = stated(fitted(even), odd), np.array([within(row) for row in odd])
    print(f"{scene}: {len(found)} cases with a number, {np.mean([within(row) for row in found]):.0%} within")
    print("stated probability   photographs   mean stated   within two uncertainties")
    groups = [(f"{low:.2f} to {high:.2f}", (p >= low) & (p < high)) for low, high in pairwise(CLASSES)]
    groups += [(f"{verdict}", np.array([row["verdict"] == verdict for row in odd])) for verdict in list(Verdict)[:2]]
    groups += [
        (kind, np.array([row["raw"] == raw for row in odd])) for kind, raw in (("RAW", True), ("picture", False))
    ]
    for name, these in groups:
        if these.any():
            print(f"{name:12s} {these.sum():18d} {p[these].mean():13.2f} {y[these].mean():13.2f}")
    print(f"Brier score {np.mean((p - y) ** 2):.3f}, of the mean alone {np.var(y):.3f}\n")


def write(found: dict[str, list[Row]]) -> None:
    """Store the models of all seeds; other scenes keep theirs."""
    target = Path(probability.__file__).with_name(probability.FILE)
    models = json.loads(target.read_text(encoding="utf-8"))
    for scene, rows in found.items():
        intercept, coefficients = fitted(rows)
        models[scene] = {
            "made_by": f"tests/benchmarks/verdict_probability.py, {len({row['seed'] for row in rows})} seeds",
            "photographs": len(rows),
            "versions": {"python": platform.python_version(), "numpy": np.__version__},
            "intercept": round(intercept, 4),
            "coefficients": {name: round(weight, 4) for name, weight in coefficients.items() if abs(weight) > 5e-4},
        }
    target.write_text(json.dumps(models, indent=1) + "\n", encoding="utf-8")
    print(f"wrote {target.name}")


def main() -> None:
    """Collect cases, or print the reliability and write the models."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", choices=("collect", "fit"))
    parser.add_argument("file", type=Path)
    parser.add_argument("--scene", choices=SCENES, default="edge")
    parser.add_argument("--count", type=int, default=8)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    if given.task == "collect":
        collect(given.file, given.scene, given.count, given.seed)
        return
    rows = rows_of(given.file)
    found = {scene: some for scene in SCENES if (some := [row for row in rows if row["scene"] == scene])}
    for scene, some in found.items():
        show_coverage(scene, some)
        show(scene, some)
    if given.write:
        write(found)


if __name__ == "__main__":
    main()
