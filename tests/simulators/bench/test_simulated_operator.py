"""What the simulated person does who restores: the ring of apertures, the time, and what shakes the rig."""

import numpy as np
import pytest

from simulators.bench.bench import Setup, SimulatedBench
from simulators.camera.sheets import MOTIONS


@pytest.fixture
def bench(tmp_path):
    bench = SimulatedBench(tmp_path, Setup(virtual_time=True))
    bench.motions = MOTIONS
    yield bench
    bench.close()


def test_hands_set_the_aperture_of_every_photograph_and_as_much_more_time(bench):
    found, facts = {}, {"blur_by": "apertures"}
    bench.hands.follow({"exposure_ev": 3.0})
    for which in ("first", "second", "third", "truth"):
        bench.hands.do(which, facts)
        found[which] = (bench.view.camera.lens.f_number, bench.body.settings.exposure_s)
        assert bench.hands.knows(f"{which}_f_number") == found[which][0]
    assert len({f_number for f_number, _ in found.values()}) == 4
    assert found["truth"][0] == max(f_number for f_number, _ in found.values())
    # t / N^2, to half of a third of a stop each
    light = np.log2([t / N**2 for N, t in found.values()])
    np.testing.assert_allclose(light, light[0], atol=1 / 3)
    # who goes on finds the ring and the dial as they were left
    left = bench.view.camera.lens.f_number, bench.body.settings.exposure_s
    done = {**facts, "hand_exposure_ev": 3.0, **dict.fromkeys(found, True)}
    bench.hands.do("first", facts)
    bench.hands.take_up(done)
    assert (bench.view.camera.lens.f_number, bench.body.settings.exposure_s) == left


def test_the_rig_goes_around_in_each_of_its_motions_and_rests_for_the_ground_truth(bench):
    seen = {}
    for which in ("first_moves", "second", "third", "truth"):
        bench.hands.do(which, {"blur_by": "motions"})
        now_s = bench.clock.now_s()
        sway = bench.world.sway(now_s + np.linspace(0, 0.1, 50))
        seen[which] = [float(np.ptp(sway[axis][0])) for axis in ("x_mm", "y_mm")]
        bench.clock.sleep(1.0)
    assert seen["first_moves"][0] > 1.5 * seen["first_moves"][1]
    assert seen["second"][1] > 1.5 * seen["second"][0]
    np.testing.assert_allclose(seen["third"][0], seen["third"][1], rtol=0.05)
    assert seen["third"][0] > 1.0
    assert max(seen["truth"]) < 0.02


def test_a_plan_over_the_frame_has_a_camera_of_its_own_and_others_have_theirs_again(bench):
    usual = bench.view.camera.sensor
    bench.show("frame")
    assert bench.view.camera.sensor.cfa is None
    bench.show("tilt")
    assert bench.view.camera.lens.f_number == 2.8
    bench.show("panel")
    assert bench.view.camera.sensor == usual


def test_a_reset_of_the_stage_s_controller_leaves_the_lamp_that_another_lit(bench):
    bench.world.set_lamp(0.5, 0.0)
    bench.devices["stage"].receive(b"\x18", 1.0)
    assert bench.world.lamp(1e5) == 0.5
