"""How right a sensor's numbers are: every truth against its 95 % interval, coverage over many sets, the peer, speed.

python -m tests.benchmarks.sensor [truth] [coverage [SETS]] [low] [published FOLDER]

truth     one simulated sensor of 1024 x 1280 pixels: K = 0.1, dark noise 30 e-, DSNU 1.5 DN, PRNU 0.5 %, two sinusoids,
          200 outliers, a response that bends by 1 %
coverage  small sets of the same kind, 64 x 64 pixels: how often intervals hold the truth
low       8 bits, dark noise of 0.1 to 0.6 DN: the same
published a clone of the public repository EMVA1288/datasets: every number against the published program, and the shares
          of the difference by the level of saturation and by the correction of rounding
Agreement with the published program on its own simulated data is tested in tests/procedures/sensor/test_peer.py.
"""

import contextlib
import platform
import sys
from itertools import pairwise
from pathlib import Path
from unittest.mock import patch

import numpy as np

from procedures.sensor import curves, stacks, uniformity
from procedures.sensor.estimate import characterise
from procedures.sensor.uniformity import spatial_variances
from station.calibration.sensor import measure_sensor
from station.calibration.sensor_folder import find_shots
from tests.procedures.sensor.known_sensor import SHARES, KnownSensor
from tests.procedures.sensor.peer import peer_numbers

WAVES = {"row_wave": (0.8, 0.0731), "column_wave": (0.6, 0.2113)}


def truths(sensor: KnownSensor) -> dict[str, float]:
    """What the sensor is, by the numbers' names; spatial truths are of its own patterns."""
    offset, response, places = sensor.patterns
    good = np.ones(offset.shape, bool)
    good[tuple(places.T)] = False
    of_offset = spatial_variances(offset, (0, 0, 0), 1000).value
    dark = np.hypot(sensor.dark_noise_e, 12**-0.5 / sensor.gain)
    return {
        "system_gain": sensor.gain,
        "system_gain_at_dark": sensor.gain,
        "temporal_dark_noise": sensor.dark_noise_e,
        "quantum_efficiency": sensor.efficiency * float(response.mean()),
        "sensitivity_threshold": (dark**2 + 0.25) ** 0.5 + 0.5,
        "dark_current": sensor.dark_current_e_s,
        "linearity_error": sensor.linearity_error(SHARES, 1.0),
        "dsnu_dn": float(np.std(offset)),
        "dsnu_row_dn": of_offset["row"] ** 0.5,
        "dsnu_column_dn": of_offset["column"] ** 0.5,
        "dsnu_pixel_without_defects_dn": sensor.dsnu_dn,
        "prnu": 100 * float(np.std(response) / response.mean()),
        "prnu_without_defects": 100 * float(np.std(response[good]) / response[good].mean()),
        "defect_pixels_dark": sensor.outliers // 2,
        "defect_pixels_light": sensor.outliers - sensor.outliers // 2,
    }


def truth() -> None:
    """One sensor."""
    sensor = KnownSensor(rows=1024, columns=1280, outliers=200, bend=0.01, dark_current_e_s=200.0, **WAVES)
    found = characterise(sensor.record(1, exposures_s=(0.01, 1.0, 2.0)), np.random.default_rng(0)).value
    assert found is not None
    print(f"{'number':32s} {'truth':>11s} {'found':>11s} {'95 % interval':>25s}")
    for name, value in truths(sensor).items():
        one = found.numbers[name]
        inside = "inside" if one.low <= value <= one.high else "OUTSIDE"
        print(f"{name:32s} {value:11.5g} {one.value:11.5g} {one.low:12.6g} {one.high:12.6g} {inside}")
    for period in found.dark.periods:
        print(
            f"period in {period.pattern}s: {period.frequency.value:.5f} cycles/pixel, {period.amplitude.value:.4f} DN"
        )
    named = {tuple(p) for one in (found.dark, found.light) for p in one.defects.places.tolist()}
    real = set(map(tuple, sensor.patterns[2].tolist()))
    print(f"outliers: {len(named & real)} of {len(real)} named, {len(named - real)} others named; light: "
          f"{len(found.light.periods)} periods")  # fmt: skip


def coverage(sets: int) -> None:
    """How often the intervals of many small sets hold the truth."""
    sensor = KnownSensor(rows=64, columns=64, dark_current_e_s=200.0, **WAVES)
    wanted = {n: v for n, v in truths(sensor).items() if not n.startswith(("defect", "linearity"))}
    hits = dict.fromkeys(wanted, 0)
    z: dict[str, list[float]] = {name: [] for name in wanted}
    for seed in range(sets):
        recording = sensor.record(seed, np.linspace(0.03, 1.2, 24), 20, (0.01, 0.5, 1.0))
        found = characterise(recording, np.random.default_rng(seed)).value
        assert found is not None
        for name, value in wanted.items():
            one = found.numbers[name]
            hits[name] += one.low <= value <= one.high
            z[name].append((one.value - value) / one.uncertainty)
    print(f"{sets} sets; the standard deviation of a share of 95 % is {100 * (0.95 * 0.05 / sets) ** 0.5:.1f} %")
    for name, count in hits.items():
        print(f"{name:32s} {100 * count / sets:5.1f} %  errors over uncertainties: mean {np.mean(z[name]):+.2f}, "
              f"deviation {np.std(z[name]):.2f}")  # fmt: skip


def low_noise(sets: int) -> None:
    """How often the intervals hold the truth where the dark noise is 0.1 to 0.6 DN and the numbers have 8 bits."""
    hits: dict[str, list[bool]] = {}
    for sigma in (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6):
        for i in range(sets):
            rng = np.random.default_rng([0, i, int(sigma * 100)])
            gain = float(np.exp(rng.uniform(np.log(0.012), np.log(0.05))))
            sensor = KnownSensor(
                rows=128, columns=128, gain=gain, dark_noise_e=sigma / gain, offset=float(rng.uniform(6, 10)), top=255,
                dsnu_dn=float(rng.uniform(0.05, 0.5)), prnu=0.008, seed=int(rng.integers(1e6)),
            )  # fmt: skip
            found = characterise(sensor.record(i, np.linspace(0.04, 1.2, 24), 16), rng).value
            assert found is not None
            wanted = truths(sensor)
            for name in ("system_gain", "quantum_efficiency", "temporal_dark_noise", "dsnu_dn", "prnu"):
                one = found.numbers[name]
                hits.setdefault(name, []).append(one.low <= wanted[name] <= one.high)
    for name, inside in hits.items():
        print(f"{name:32s} {np.mean(inside):5.1%} of {len(inside)}")


def published(folder: Path) -> None:
    """Numbers of the public data sets, and their relative difference from the published program in per cent.

    It is divided into that by the level of saturation (the program at our level against itself), that by our correction
    of rounding (with it against without it), and what is left.
    """
    for one in sorted(path.parent for path in folder.glob("*/EMVA1288_Data.txt")):
        (plane,) = measure_sensor(find_shots(one), None).planes
        result = plane.outcome.result()
        with contextlib.ExitStack() as stack:
            for module in (curves, stacks, uniformity):
                stack.enter_context(patch.object(module, "NEGLIGIBLE", 0.0))
            as_rounded = measure_sensor(find_shots(one), None).planes[0].outcome.result().numbers
        theirs, at_our_level = (
            peer_numbers(one / "EMVA1288_Data.txt", at) for at in (None, result.transfer.saturation)
        )
        print(f"{one.name}: {plane.outcome.verdict} {plane.outcome.reason}")
        print(f"{'':44s}{'all':>9s}{'level':>9s}{'rounding':>9s}{'left':>9s}")
        for name, number in result.numbers.items():
            if name in theirs:
                steps = theirs[name], at_our_level[name], as_rounded[name].value, number.value
                whole, level, left, rounding = (
                    100 * float(np.divide(b, a) - 1) for a, b in [(steps[0], steps[-1]), *pairwise(steps)]
                )
                shares = "".join(f" {share:+8.2f}" for share in (whole, level, rounding, left))
                print(f"{name:24s} {number.value:11.5g} +- {number.uncertainty:9.3g}{shares}", flush=True)


if __name__ == "__main__":
    words = sys.argv[1:] or ["truth", "coverage", "500"]
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, {platform.machine()}")
    if "truth" in words:
        truth()
    if "coverage" in words:
        at = words.index("coverage") + 1
        coverage(int(words[at]) if at < len(words) and words[at].isdigit() else 500)
    if "low" in words:
        low_noise(25)
    if "published" in words:
        published(Path(words[words.index("published") + 1]))
