"""Advice of the checks corrects the actual deviation, compared with the simulator's truth."""

from dataclasses import replace

import numpy as np
import pytest

from procedures import Chart, read_frame
from procedures.pattern_psf.checks import (
    best_place,
    check_distance,
    check_light,
    check_shot,
    check_square,
    sharpness,
    square_advice,
)
from procedures.pattern_psf.distance.consistency import MIN_CELL_CORRELATION
from procedures.pattern_psf.distance.ranging import fit_offset_mm, range_readings
from procedures.pattern_psf.facts import RATIO
from procedures.pattern_psf.pose import ChartPose, ImagingGeometry, chart_pose
from procedures.plan import Facts
from simulators.camera.camera import Lens, SimulatedCamera, pixels_at
from simulators.camera.sensor import Sensor
from simulators.world.projection import ObjectPose
from simulators.world.scene import Illumination, PlacedChart, Scene

# drawn more coarsely than its optics ask: the error stays far below the noise
CAMERA = SimulatedCamera(Lens(focal_length_mm=24.0), Sensor(rows=360, columns=480), pitch_um=5.94, oversampling=5)
CHART = Chart.from_seed()
CELL_MM = 0.3
FACTS: Facts = {"chart_width_mm": 320 * CELL_MM, "focal_length_mm": 24.0, "pixel_pitch_um": 5.94}
FAR_MM = CAMERA.place(CHART, pixels=pixels_at(RATIO), cell_mm=CELL_MM).pose.centre_mm[2]


@pytest.fixture
def shoot(rng, tmp_path):
    """A frame of a chart that hangs so and so."""

    def photograph(pose=None, *, exposure_s=0.024, slope=(0.0, 0.0), camera=CAMERA, charts=1):
        placed = PlacedChart(CHART, pose or ObjectPose((0.0, 0.0, FAR_MM)), CELL_MM)
        light = camera.light_on(placed, slope) if charts else Illumination()
        path = tmp_path / "frame.dng"
        scene = Scene((placed,) * charts, light=light)
        camera.photograph(scene, rng, path, exposure_s=exposure_s)
        return read_frame(path)

    return photograph


def turned(**angles):
    return ObjectPose((0.0, 0.0, FAR_MM), **{f"{name}_deg": angle for name, angle in angles.items()})


def test_the_wanted_outline_is_the_present_one_of_a_chart_in_its_place(shoot):
    # seen from 1.2 times the distance and to the right; in its place it lies where the outline wanted it, to the pixel
    before = check_distance(shoot(ObjectPose((8.0, -5.0, 1.2 * FAR_MM))), FACTS).outline
    after = check_distance(shoot(), FACTS).outline
    assert before.off_px > 20 > 2 > np.abs(np.array(after.present) - np.array(before.wanted)).max()
    assert before.growth == pytest.approx(1.2, abs=0.03)
    assert before.arrow[0] < 0 < before.arrow[1]


WORDS = {
    ("yaw", 6.0): "its right edge away",
    ("pitch", -4.0): "its lower edge away",
    ("roll", 8.0): "counter-clockwise",
}
OTHER_WORDS = {("yaw", -6.0): "its left edge", ("pitch", 4.0): "its upper edge", ("roll", -8.0): "the chart clockwise"}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "angle"), WORDS)
def test_a_turned_chart_is_reported_with_how_much_and_which_way_and_following_it_makes_it_square(shoot, name, angle):
    advice = check_square(shoot(turned(**{name: angle})), FACTS)
    assert not advice.good
    assert WORDS[name, angle] in advice.say
    # the angles by the noise cells are accurate to 0.1 degree at this size (four times the measured error)
    assert advice.by_hand == {f"chart_{name}_deg": pytest.approx(-angle, abs=0.4)}
    mended = check_square(shoot(turned(**{name: angle + advice.by_hand[f"chart_{name}_deg"]})), FACTS)
    assert mended.good, mended.say


@pytest.mark.parametrize(("name", "angle"), [*WORDS, *OTHER_WORDS])
def test_the_pose_is_that_of_the_homography(name, angle):
    # no photograph: the exact map, at the default principal point
    placed = PlacedChart(CHART, replace(turned(**{name: angle}), centre_mm=(30.0, -20.0, FAR_MM)), CELL_MM)
    projection = CAMERA.projection(FAR_MM)
    to_plane = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])  # the middle of 240 columns is 119.5
    H = to_plane @ projection.pinhole() @ placed.to_space()
    pose = chart_pose(H, (180, 240), ImagingGeometry(24.0, 2 * 5.94, CELL_MM))
    assert getattr(pose, f"{name}_deg") == pytest.approx(angle, abs=0.05)
    assert pose.centre_mm == pytest.approx((30.0, -20.0, FAR_MM), rel=2e-3)


@pytest.mark.parametrize(("name", "angle"), OTHER_WORDS)
def test_words_tell_which_way(name, angle):
    pose = ChartPose((0.0, 0.0, FAR_MM), **{"yaw_deg": 0.0, "pitch_deg": 0.0, "roll_deg": 0.0, f"{name}_deg": angle})
    assert OTHER_WORDS[name, angle] in square_advice(pose, (), (), 1.5, 62.4).say


@pytest.mark.slow
def test_going_around_a_turned_chart_does_what_turning_it_does(shoot):
    yaw, pitch = 5.0, -3.0
    moves = check_square(shoot(turned(yaw=yaw, pitch=pitch)), FACTS).moves
    assert moves["pan_deg"] == pytest.approx(yaw, abs=0.4)
    assert moves["tilt_deg"] == pytest.approx(pitch, abs=0.4)
    # the camera stays on the chart's normal, which leaves the axis by the angle
    assert moves["x_mm"] == pytest.approx(-FAR_MM * np.tan(np.radians(yaw)), abs=20)
    assert moves["y_mm"] == pytest.approx(-FAR_MM * np.tan(np.radians(pitch)), abs=20)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.96, 2.1])
def test_the_way_to_the_right_distance_is_told_in_metres_and_leads_there(shoot, ratio):
    z = FAR_MM * RATIO / ratio
    advice = check_distance(shoot(ObjectPose((0.0, 0.0, z))), FACTS)
    assert not advice.good
    assert ("back" in advice.say) == (ratio > RATIO)
    assert f"{abs(advice.moves['z_mm']) / 1000:.2f} m" in advice.say
    there = z + advice.moves["z_mm"]
    placed = check_distance(shoot(ObjectPose((0.0, 0.0, there))), FACTS)
    assert placed.good
    # the focus is found anew there, which changes the image's distance by f/z: one per cent
    assert placed.readings[0].value == pytest.approx(RATIO, rel=0.015)


@pytest.mark.slow
def test_the_distance_is_that_of_the_simulator(shoot):
    readings = {reading.name: reading.value for reading in check_distance(shoot(), FACTS).readings}
    # marks to a hundredth of a pixel of 70
    assert readings["distance"] == pytest.approx(FAR_MM / 1000, rel=2e-3)


OFF = [(48.0, -24.0, "Shift the camera"), (60.0, -40.0, "cuts the chart")]


@pytest.mark.slow
@pytest.mark.parametrize(("right", "down", "words"), OFF)
def test_a_chart_off_the_middle_is_brought_there(shoot, right, down, words):
    advice = check_distance(shoot(ObjectPose((right, down, FAR_MM))), FACTS)
    assert not advice.good
    assert words in advice.say
    assert advice.moves["x_mm"] == pytest.approx(right, abs=1)
    assert advice.moves["y_mm"] == pytest.approx(-down, abs=1)  # y is up on the stage, down in the picture


def test_a_laser_is_within_reach_of_the_lens_and_needs_no_focal_length():
    # px = K / z and laser = z + offset, whatever K is
    z = np.array([1500.0, 1800.0, 2200.0])
    pairs = [(123.0 / one, one + 87.0) for one in z]
    assert fit_offset_mm(pairs) == pytest.approx(87.0, abs=1e-6)
    assert fit_offset_mm(pairs[:1]) is None
    (near,), (far,) = (range_readings({"laser_offset_mm": offset}) for offset in (-87.0, 1087.0))
    assert (near.value, near.good, far.good) == (-87.0, True, False)
    assert range_readings({}) == ()


@pytest.mark.slow
def test_a_dark_chart_is_exposed_longer_until_white_is_at_80_percent(shoot):
    exposure_s = 1 / 400
    advice = check_light(shoot(exposure_s=exposure_s), FACTS)
    assert not advice.good
    assert "set the exposure time from 1/" in advice.say
    mended = check_light(shoot(exposure_s=exposure_s * 2 ** advice.by_hand["exposure_ev"]), FACTS)
    assert mended.good, mended.say
    # 80 percent to half of a third of a stop
    assert mended.readings[0].value == pytest.approx(80.0, rel=0.14)


def test_clipped_uneven_and_missing_light_is_corrected_by_name(shoot):
    advice = check_light(shoot(exposure_s=1 / 15), FACTS)
    assert "White is clipped" in advice.say
    assert advice.by_hand["exposure_ev"] == pytest.approx(-1.0, abs=0.2)
    advice = check_light(shoot(slope=(0.2, 0.0), exposure_s=0.02), FACTS)
    assert "left side has" in advice.say
    assert "even_light" in advice.by_hand
    dark = check_light(shoot(charts=0, exposure_s=1 / 500), FACTS)
    assert "too dark" in dark.say
    # the wall reflects 0.35 where paper reflects 0.9
    bright = check_light(shoot(charts=0, exposure_s=0.024 * 0.9 / 0.35), FACTS)
    assert "No chart is found" in bright.say


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [2, 7])
def test_a_chart_of_another_number_is_named_by_its_cells(shoot, wrong):
    taken = shoot(ObjectPose((0.0, 0.0, FAR_MM)))
    right = check_light(taken, FACTS)
    assert right.good
    # 62 500 cells seen by 5600 pixels: others agree by chance to 1/75, the best of 49 shifts to some hundredths
    assert right.facts["seed_agreement"] > 3 * MIN_CELL_CORRELATION
    advice = check_light(taken, {**FACTS, "chart_seed": float(wrong)})
    assert advice.contradictory == ("chart_seed",)
    assert f"number {wrong}, but those of number 1" in advice.say
    assert check_light(taken, {**FACTS, "chart_seed": float(wrong), "insisted_chart_seed": True}).good


@pytest.mark.slow
def test_a_blurred_chart_is_the_same_chart_with_a_lower_score(shoot):
    blurred = check_light(shoot(camera=replace(CAMERA, focus_mm=FAR_MM / 1.7)), FACTS)
    assert blurred.contradictory == ()
    sharp = sharpness(shoot(), FACTS)
    soft = sharpness(shoot(camera=replace(CAMERA, focus_mm=FAR_MM / 1.12)), FACTS)
    assert sharp > 1.1 * soft


def test_the_best_place_of_a_parabola_is_its_vertex():
    x = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    assert best_place(x, 5 - (x - 0.3) ** 2) == pytest.approx(0.3)
    assert best_place(x, [np.nan] * 5) is None
    assert best_place(x, 5 - (x - 9) ** 2) == 2.0


@pytest.mark.slow
def test_a_shot_with_other_settings_does_not_count(shoot):
    frame = shoot()
    facts = {**FACTS, **check_light(frame, FACTS).facts}
    assert check_shot(frame, facts).good
    refused = check_shot(shoot(exposure_s=0.03), facts)
    assert not refused.good
    assert "exposure time is 0.03 s instead of 0.024 s" in refused.say
