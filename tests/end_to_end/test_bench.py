"""From a cold bench to a calibrated PSF, through wires, protocols and a file: the estimate agrees with the truth."""

from functools import partial

import pytest

from procedures import Verdict, estimate_psf, read_frame
from station.bench.opening import simulated_bench
from station.demo.truth_comparison import compare

pytestmark = pytest.mark.slow


@pytest.fixture
def bench(tmp_path):
    bench = simulated_bench(tmp_path, seed=5, virtual_time=True)
    bench.connect()
    bench.stage.home()
    bench.head.home()
    bench.light.set_level(1.0)
    yield bench
    bench.close()


def photographed(bench):
    """The estimate from the next photograph, and its comparison with the truth."""
    exposure = bench.camera.expose()
    taken = bench.simulated.view.taken[-1]
    outcome = estimate_psf(read_frame(exposure.path, ["G1"]).planes["G1"], bench.simulated.view.chart)
    assert outcome.verdict is not Verdict.REFUSED, outcome.reason
    psf = outcome.value.psf
    true = taken.true_psf("G1", psf.s, psf.k)
    return outcome.value, compare(outcome.value, true.h, true.floor, partial(taken.true_otf, "G1"))


def test_a_bench_is_calibrated_as_well_as_its_error_bars_say_at_rest_and_with_motion_blur(bench):
    bench.head.move_to(pan_deg=0.0, tilt_deg=0.0)
    bench.stage.move_to(z_mm=750.0, x_mm=130.0, y_mm=100.0)
    bench.clock.sleep(5.0)
    still, against = photographed(bench)
    assert still.pixels_per_pattern == pytest.approx(bench.simulated.view.taken[-1].pixels_per_pattern("G1"), rel=1e-3)
    # error over expected error: 1 where the error bars are true; the norm of 289 correlated values scatters by a third
    assert against.ratio < 1.6
    moving, _ = bench.clock.together(lambda: photographed(bench), lambda: bench.stage.move_to(x_mm=170.0))
    blurred, against = moving
    assert against.ratio < 1.6
    numbers = [one.quality.numbers for one in (still, blurred)]
    across, along = ([n[f"mtf50_{way}"].value for n in numbers] for way in ("vertical", "horizontal"))
    # 25 mm/s for 20 ms at 1550 mm is a box of 0.67 pixels of G1: at 0.9 cycles/pixel it passes 0.5
    assert along[1] < 0.9 * along[0]
    assert across[1] == pytest.approx(across[0], rel=0.02)
