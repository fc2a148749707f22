import json
from dataclasses import replace

import exifread
import numpy as np
import pytest
import rawpy

from procedures.pattern import X_CORNERS, Chart
from procedures.raw import read_frame
from simulators.camera.camera import Lens, SimulatedCamera, pixels_at, render_plane
from simulators.camera.optics import WAVELENGTHS_UM, Optics, PixelAperture
from simulators.camera.pupil import Wavefront
from simulators.camera.render import IdealImage, Region, render_region
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene, Shape, Wall
from tests.simulators.clutter import cover, random_clutter
from tests.simulators.random_scenes import Trials, random_camera, random_scene

CHART = Chart.from_seed()
GREY = SimulatedCamera(sensor=Sensor(200, 240, None), pitch_um=7.5)
BAYER = SimulatedCamera(sensor=Sensor(320, 400, black=(500, 510, 520, 530)))


def test_a_photograph_is_on_disk_as_it_was_taken(tmp_path, rng):
    scene = Scene((BAYER.place(CHART, pixels=80),))
    photo = BAYER.photograph(scene, rng, tmp_path / "a.dng", exposure_s=0.01, iso=200)
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        np.testing.assert_array_equal(raw.raw_image, photo.mosaic)
        assert raw.other.shutter_speed == pytest.approx(0.01)
        assert raw.other.iso_speed == 200
    with open(tmp_path / "a.dng", "rb") as file:
        tags = exifread.process_file(file, details=True)
    distance = scene.charts[0].pose.centre_mm[2]
    assert float(tags["EXIF SubjectDistance"].values[0]) == pytest.approx(distance / 1000, rel=1e-5)
    collected = json.loads(bytes(tags["EXIF UserComment"].values)[8:])
    np.testing.assert_allclose(collected["H_sensor_pattern"][0], photo.truths[0].H_sensor_pattern)


@pytest.mark.parametrize("cfa", ["RGGB", "GBRG"])
def test_the_station_reads_the_planes_as_they_were_counted(tmp_path, rng, cfa):
    camera = replace(BAYER, sensor=replace(BAYER.sensor, cfa=cfa))
    photo = camera.photograph(Scene((camera.place(CHART, pixels=60),)), rng, tmp_path / "a.dng")
    frame = read_frame(tmp_path / "a.dng")
    assert set(frame.planes) == {"R", "G1", "G2", "B"}
    for name, plane in frame.planes.items():
        np.testing.assert_allclose(plane.samples, photo.plane(name), atol=1e-6)  # float32 of numbers up to 1
        assert plane.origin == photo.sensor.planes[name]


@pytest.mark.parametrize("camera", [GREY, BAYER], ids=["grey", "bayer"])
@pytest.mark.parametrize("s_over_t", [0.7, 1.0])
def test_a_chart_is_as_large_as_asked(rng, camera, s_over_t):
    photo = camera.photograph_chart(CHART, rng, s_over_t=s_over_t)
    plane = next(iter(photo.sensor.planes))
    # s samples per pixel, t = 256 / pixels cells per pixel
    assert 4 * photo.pixels_per_pattern(plane) / 256 == pytest.approx(s_over_t)
    assert pixels_at(1.0, 4) == 64


def test_planes_differ_by_place_and_width_and_paper_is_as_bright_as_exposure_says(rng):
    photo = BAYER.photograph(Scene((BAYER.place(CHART, pixels=80),)), rng)
    apart = photo.true_points("G1", X_CORNERS) - photo.true_points("R", X_CORNERS)
    np.testing.assert_allclose(apart, np.tile([-0.5, 0.0], (12, 1)), atol=1e-12)
    photo = BAYER.photograph(Scene((BAYER.place(CHART, pixels=60),)), rng)
    peaks = {plane: photo.true_psf(plane, 4, 17).samples.max() for plane in ("R", "G1", "G2", "B")}
    assert peaks["R"] < peaks["G1"] == peaks["G2"] < peaks["B"]
    wide = replace(GREY, lens=Lens(f_number=4.0))
    scene = Scene(wall=Wall(reflectance=0.5))
    e = [c.photograph(scene, rng, exposure_s=0.005).plane("Y").mean() for c in (GREY, wide)]
    full = (GREY.sensor.white - 512) * GREY.sensor.gain_e_per_dn
    # 48 000 pixels of some 3 750 electrons: the mean's sd is 2e-4 of it
    assert e[0] * full == pytest.approx(0.5 * 1.5e6 * 0.005, rel=1e-3)
    assert e[1] / e[0] == pytest.approx((5.6 / 4) ** 2, rel=1e-3)
    photo = GREY.photograph(Scene((GREY.place(CHART, pixels=100),)), rng, exposure_s=0.1)
    plane = photo.plane("Y")
    assert np.mean(plane >= 1) > 0.2
    assert plane.min() < 0.5


@pytest.mark.slow
def test_defocus_and_coma_are_in_the_truth_too(rng):
    placed = GREY.place(CHART, pixels=100)
    near = replace(GREY, focus_mm=placed.pose.centre_mm[2] / 2)
    sharp, soft = (c.photograph(Scene((placed,)), rng) for c in (GREY, near))
    assert soft.true_psf("Y", 4, 33).h.max() < 0.5 * sharp.true_psf("Y", 4, 33).h.max()
    assert np.std(np.diff(soft.plane("Y"))) < 0.7 * np.std(np.diff(sharp.plane("Y")))
    camera = replace(GREY, lens=Lens(coma_um=0.15), sensor=Sensor(400, 600, None))
    offsets = (np.arange(33) - 16) / 4
    found = []
    for x in (0.2, 0.8):
        h = camera.photograph(Scene((camera.place(CHART, pixels=60, at=(x, 0.5)),)), rng).true_psf("Y", 4, 33).h
        found.append(float(np.sum(h * offsets[None, :])))
        assert np.sum(h * offsets[:, None]) == pytest.approx(0, abs=1e-6)
    assert found[0] == pytest.approx(-found[1])
    assert found[1] > 0.05


def test_light_covers_and_clutter_are_seen_where_they_are(rng):
    placed = GREY.place(CHART, pixels=120)
    light = GREY.light_on(placed, (0.2, 0.0))
    quiet = replace(GREY, white_e_per_s=1.5e8, sensor=replace(GREY.sensor, full_well_e=1e9, gain_e_per_dn=1e3, bits=16))
    photo = quiet.photograph(Scene((placed,), light=light), rng)
    left, right = (photo.true_points("Y", np.array([[x, -40.0]]))[0] for x in (0.0, 256.0))
    values = [photo.plane("Y")[round(float(y)), round(float(x))] for x, y in (left, right)]
    # white paper above the frame of blocks, at the ends of the noise region, to half a pixel of 60
    assert values[1] / values[0] == pytest.approx(1.2 / 0.8, rel=0.01)
    camera = replace(GREY, sensor=Sensor(240, 480, None))
    left = replace(camera.place(CHART, pixels=80, at=(0.3, 0.5)), mirrored=True, covers=cover(2, 3))
    cut = camera.place(Chart.from_seed(2), pixels=80, at=(0.97, 0.5))
    away = camera.place(CHART, pixels=80, at=(3.0, 0.5))
    photo = camera.photograph(Scene((left, cut, away)), rng)
    assert photo.mosaic.shape == (240, 480)
    x = photo.true_points("Y", X_CORNERS[[0, 3]])[:, 0]
    assert x[0] > x[1]
    assert photo.true_points("Y", X_CORNERS, chart=1)[:, 0].max() > 480
    camera = replace(GREY, sensor=Sensor(400, 600, None))
    placed = camera.place(CHART, pixels=60, at=(0.8, 0.7))
    scale = camera.projection(placed.pose.centre_mm[2]).principal_px / 4000
    corners = ((50, 50), (90, 50), (90, 90), (50, 90))
    square = Shape(tuple(((x - 299.5) / scale, (y - 199.5) / scale) for x, y in corners), 0.8)
    plain, drawn = (camera.photograph(Scene((placed,), Wall(shapes=s)), rng).plane("Y") for s in ((), (square,)))
    assert drawn[70, 70] / plain[70, 70] == pytest.approx(0.8 / 0.35, rel=0.1)
    assert drawn[70, 120] / plain[70, 120] == pytest.approx(1, rel=0.1)


def test_one_seed_gives_one_photograph_and_a_grey_plane_is_linear(rng):
    plane = render_plane(Scene((GREY.place(CHART, pixels=100),)), GREY, rng)
    assert plane.shape == (200, 240)
    assert 0.0 < np.quantile(plane, 0.01) < 0.1 < 0.5 < np.quantile(plane, 0.99) < 1.0
    scene = Scene((GREY.place(CHART, pixels=100),))
    one, two = (GREY.photograph(scene, np.random.default_rng(5)).mosaic for _ in range(2))
    np.testing.assert_array_equal(one, two)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_random_charts_lie_whole_in_the_frame(seed):
    rng = np.random.default_rng(seed)
    trials = Trials(240, 320, pixels=(60, 120))
    camera = random_camera(rng, trials)
    photo = camera.photograph(random_scene(rng, camera, CHART, trials), rng)
    points = photo.true_points("Y", X_CORNERS)
    assert (points > 0).all()
    assert (points < [320, 240]).all()
    assert np.mean(photo.plane("Y") >= 1) < 0.05


@pytest.mark.parametrize("seed", range(5))
def test_clutter_is_never_darker_than_its_darkest_thing(seed):
    rng = np.random.default_rng(seed)
    wall = Wall(4000.0, 0.4, random_clutter(rng, 120.0, 90.0, words=2))
    picture = IdealImage.of(Scene(wall=wall), GREY.projection(4000.0))
    region = Region(0, 0, 240, 200)
    light = render_region(picture, GREY.sharp_optics(), region, {(0, 0): "Y"}, oversampling=8)
    assert light.min() > 0.03 - 1e-3
    assert light.max() < 0.9 + 1e-3


def test_a_lens_is_bright_and_sharp_about_its_own_axis_and_a_tilted_sensor_along_its_slope(rng):
    trials = Trials(120, 160)
    camera = random_camera(rng, trials)
    scene = random_scene(rng, camera, None, trials)
    assert camera.photograph(scene, rng).truths == ()
    with pytest.raises(ValueError, match=r"pitch of 4\.0 um"):
        SimulatedCamera(optics=Optics((PixelAperture(),), 4.0), pitch_um=3.76)
    with pytest.raises(ValueError, match="must focus beyond its focal length"):
        GREY.projection(40.0)
    lens = Lens(coma_um=0.1, astigmatism_um=0.2, field_curvature_um=0.1, axis=(0.1, -0.2))
    assert lens.wavefront(0.1, -0.2).flat
    assert not lens.wavefront(0.0, 0.0).flat
    light = Lens(vignetting=(-0.3, 0.1, -0.05), axis=(0.6, 0.0)).falloff((301, 401))  # 250 to a corner but for the rim
    assert light[150, 350] == pytest.approx(1.0, abs=1e-4)
    assert light[0, 350] == pytest.approx(1 - 0.3 * 0.36 + 0.1 * 0.36**2 - 0.05 * 0.36**3, abs=1e-3)
    lens = Lens(tilt_um=(0.1, -0.3))
    assert lens.wavefront(0.5, 0.2) == Wavefront(defocus_um=0.5 * 0.1 - 0.2 * 0.3)


@pytest.mark.slow
def test_lateral_colour_moves_the_chart_as_the_truth_says():
    # magnification such that green and yellow (Y) are exactly one pixel apart in x at the chart: its picture is moved
    placed = GREY.place(CHART, pixels=70, at=(0.7, 0.5))
    focus = placed.pose.centre_mm[2]
    per_um = replace(GREY, lens=Lens(lateral_colour=1.0)).colour_shift_at(placed, focus).px_per_um
    growth = 1 / per_um[0] / (WAVELENGTHS_UM["Y"] - WAVELENGTHS_UM["G"])
    camera = replace(GREY, lens=Lens(lateral_colour=growth))
    plain, moved = (c.photograph(Scene((placed,)), np.random.default_rng(1)) for c in (GREY, camera))
    step = moved.true_points("Y", X_CORNERS) - plain.true_points("Y", X_CORNERS)
    np.testing.assert_allclose(step, np.tile([1.0, 0.0], (12, 1)), atol=1e-9)
    at = plain.true_points("Y", X_CORNERS)
    (x0, y0), (x1, y1) = at.min(axis=0).astype(int), at.max(axis=0).astype(int)
    here, there = plain.plane("Y")[y0:y1, x0:x1], moved.plane("Y")[y0:y1, x0 + 1 : x1 + 1]
    # the photons differ; half the variance of the difference is that of one exposure
    noise = GREY.photograph(Scene((placed,)), np.random.default_rng(2)).plane("Y")[y0:y1, x0:x1] - here
    assert np.std(there - here) < 1.1 * np.std(noise) + 1e-3
