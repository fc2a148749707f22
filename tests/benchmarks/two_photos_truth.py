"""Two photographs against the camera's whole OTF: errors over stated uncertainties, and damaged pairs.

Photographs are rendered through analytic OTFs that have no end (tests/procedures/two_photo/endless.py): diffraction at
three cutoffs, square photosites, walls of 1/f detail and of leaves, zooms of 3.2 to 5.2, noise of 0.5 and 1 % of white.
Then copies of good pairs are damaged (tests/procedures/two_photo/damage.py): a pass farther than three stated
uncertainties from the truth is stated. The published pair, where it is at hand, is held against itself undamaged.

python -m tests.benchmarks.two_photos_truth [pairs of each camera, default 4] [pairs to damage, default 2; 0: none]
"""

import sys
from collections import Counter

import numpy as np

from procedures.outcome import Outcome, Verdict
from procedures.raw import Plane, read_frame
from procedures.two_photo.estimate import TwoPhotoPsf, estimate_psf_of_pair
from tests.benchmarks import SHARED
from tests.procedures.two_photo.damage import damaged, names, relief
from tests.procedures.two_photo.endless import CAMERAS, mtf50, mtf_nyquist, photographs
from tests.procedures.two_photo.wall import Otf, Pair

DATA = SHARED / "two_photos"
AXES = ("horizontal", "vertical")
FAR = 3.0
"""Standard uncertainties from the truth beyond which nothing may pass."""


def estimated(near: np.ndarray, far: np.ndarray) -> Outcome[TwoPhotoPsf]:
    """With default settings."""
    return estimate_psf_of_pair(*(Plane("Y", np.asarray(samples, np.float32), 1 / 65535) for samples in (near, far)))


def errors(found: TwoPhotoPsf, otf: Otf) -> dict[str, tuple[float, float]]:
    """Of each number its relative error, and the error over the stated uncertainty."""
    stated = {}
    for number, truth in (("mtf50", mtf50(otf)), ("mtf_nyquist", mtf_nyquist(otf))):
        for axis in AXES:
            one = found.quality.numbers[f"{number}_{axis}"]
            stated[f"{number}_{axis}"] = (one.value / truth - 1, (one.value - truth) / one.uncertainty)
    return stated


def truths(count: int) -> None:
    """The cameras: verdicts, errors over uncertainties, mean bias."""
    verdicts, off, bias, noise_only = Counter[str](), [], [], []
    for camera, (name, otf) in enumerate(CAMERAS.items()):
        for i in range(count):
            wall, zoom = ("pink", "leaves")[i % 2], 3.2 + 2.0 * i / max(count - 1, 1)
            noise, seed = (0.005, 0.01)[i // 2 % 2], 100 * camera + i
            pair = photographs(otf, wall=wall, zoom=zoom, noise=noise, seed=seed, size=160, tilt=0.02)
            outcome = estimated(pair.near, pair.far)
            verdicts[outcome.verdict] += 1
            if outcome.value is None:
                print(f"{name} {wall} zoom {zoom:.1f}: {outcome.reason}")
                continue
            stated = errors(outcome.value, otf)
            budget = outcome.value.quality.budgets["mtf50_horizontal"]
            last = outcome.value.choice[-1]
            print(
                f"{name} {wall} zoom {zoom:.1f} s = {last.s} k = {last.k} {outcome.verdict}: "
                + ", ".join(f"{100 * a:+.2f} % ({z:+.1f})" for a, z in stated.values())
                + "; of MTF50: "
                + ", ".join(f"{term} {part:.4f}" for term, part in budget.items() if part > 0),
                flush=True,
            )
            if outcome.verdict is Verdict.PASS:
                off += [z for _, z in stated.values()]
                bias += [stated[f"mtf50_{axis}"][0] for axis in AXES]
                for axis in AXES:
                    one = outcome.value.quality
                    part = one.budgets[f"mtf50_{axis}"]["noise"]
                    noise_only.append((one.numbers[f"mtf50_{axis}"].value - mtf50(otf)) / part)
    over, over_noise = (float(np.sqrt(np.mean(np.square(z)))) for z in (off, noise_only))
    print(f"verdicts {dict(verdicts)}; error over uncertainty: rms {over:.2f}, worst {np.abs(off).max():.2f}")
    print(f"  over the noise's part alone: rms {over_noise:.2f}; mean bias of MTF50 {np.mean(bias):+.2%}")


def damages(count: int) -> None:
    """Damaged copies of good pairs, and light that turned."""
    bases: list[tuple[str, Pair, Otf | None]] = [
        ("1/f wall, f/5.6", photographs(CAMERAS["f/5.6"], seed=1), CAMERAS["f/5.6"]),
        ("leaves, f/8", photographs(CAMERAS["f/8"], wall="leaves", zoom=4.1, size=170, seed=2), CAMERAS["f/8"]),
    ]
    if DATA.is_dir():
        near, far = (read_frame(DATA / name).planes["Y"].samples for name in ("IMG_0608_v1.pgm", "IMG_0602_v1_CUT.pgm"))
        bases.insert(1, ("published pair", Pair(near, far, np.eye(3)), None))
    for title, pair, otf in bases[:count]:
        clean = estimated(pair.near, pair.far)
        if clean.value is None:
            raise SystemExit(f"{title}: {clean.reason}")
        numbers = clean.value.quality.numbers
        true = [mtf50(otf) if otf else numbers[f"mtf50_{axis}"].value for axis in AXES]
        print(f"{title}: {clean.verdict}, MTF50 {[round(numbers[f'mtf50_{a}'].value, 4) for a in AXES]}, true {true}")
        report(title, [(name, estimated(*damaged(pair, name))) for name in names()], true)
    otf = CAMERAS["f/5.6"]
    turned = [(seed, angle) for seed in (1, 2) for angle in (0, 2, 5, 10, 20)]
    pairs = [(f"turned by {angle}", relief(otf, angle, seed=seed)) for seed, angle in turned]
    report("light on relief", [(name, estimated(one.near, one.far)) for name, one in pairs], [mtf50(otf)] * 2)


def report(title: str, outcomes: list[tuple[str, Outcome[TwoPhotoPsf]]], true: list[float]) -> None:
    """How many pass, and those that pass far from the truth."""
    print(f"{title}: {dict(Counter(str(outcome.verdict) for _, outcome in outcomes))}")
    for name, outcome in outcomes:
        if outcome.value is None:
            print(f"  {name}: refused: {outcome.reason}")
            continue
        found = [outcome.value.quality.numbers.get(f"mtf50_{axis}") for axis in AXES]
        off = [
            (one.value / t - 1, (one.value - t) / one.uncertainty) for one, t in zip(found, true, strict=True) if one
        ]
        far = outcome.verdict is Verdict.PASS and any(abs(z) > FAR for _, z in off)
        said = ", ".join(f"{100 * a:+.1f} % ({z:+.1f})" for a, z in off)
        print(f"  {'FAR ' if far else ''}{name}: {outcome.verdict}, {said} {outcome.reason[:110]}", flush=True)


def main() -> None:
    """Print what was found."""
    count, to_damage = (int(one) for one in [*sys.argv[1:3], *("4", "2")[len(sys.argv) - 1 :]])
    truths(count)
    if to_damage:
        damages(to_damage)


if __name__ == "__main__":
    main()
