"""A typed f-number against the photograph's own far tail and what diffraction lets pass."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from procedures import Chart, Plane, read_frame
from procedures.pattern_psf.facts import PatternFacts
from procedures.pattern_psf.focus.aperture import KEY, check_aperture, f_number_of_tails
from procedures.psf import Psf, PsfTail
from procedures.quality import CAMERA, OPERATOR, Diffraction
from simulators.bench.view import bench_camera
from simulators.world.projection import ObjectPose
from simulators.world.scene import PlacedChart, Scene

SLOW_FIXTURES = {"photographed"}

FOCAL_MM, PITCH_UM, CELL_MM, Z_MM = 24.0, 5.94, 0.3, 1865.0
"""At that distance s/t is 1.3 with 4 samples a pixel: a noise region 83 pixels of a plane wide."""


@pytest.fixture(scope="module", params=[pytest.param(5.6, marks=pytest.mark.nightly), 11.0])
def photographed(request, tmp_path_factory):
    """A photograph by a lens at that f-number, which the file does not note."""
    path = tmp_path_factory.mktemp("taken") / "shot.dng"
    camera = bench_camera()
    lens = replace(camera.lens, f_number=request.param, noted=False)
    camera = replace(camera, lens=lens, focus_mm=Z_MM, oversampling=4)
    placed = PlacedChart(Chart.from_seed(), ObjectPose((0.0, 0.0, Z_MM), 0.0, 0.0, 0.0), CELL_MM)
    exposure_s = 0.022 * (request.param / 5.6) ** 2  # green at four fifths of the scale
    camera.photograph(Scene((placed,)), np.random.default_rng(1), path, exposure_s=exposure_s)
    return request.param, read_frame(path)


def look(frame, typed, **more):
    facts = {"focal_length_mm": FOCAL_MM, "pixel_pitch_um": PITCH_UM, "chart_width_mm": 96.0, **more}
    return check_aperture(frame, {**facts, KEY: typed})


def test_the_right_f_number_is_taken_and_the_tail_s_is_told(photographed):
    true, frame = photographed
    advice = look(frame, true)
    assert advice.good
    off = advice.facts["tail_f_number"] - true
    assert abs(off) < 3 * np.hypot(advice.facts["tail_f_number_uncertainty"], 0.1 * true)
    assert advice.facts["tail_f_number_uncertainty"] < 0.2 * true


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_half_and_twice_are_named(photographed, factor):
    true, frame = photographed
    if true * factor < 4:  # one photograph does not distinguish the small tails of f/2.8 and f/5.6
        assert look(frame, true * factor).good
        return
    advice = look(frame, factor * true)
    assert not advice.good
    assert advice.contradictory == (KEY,)
    assert f"f/{factor * true:g} was given" in advice.say
    if factor == 0.5:
        assert look(frame, factor * true, insisted_typed_f_number=True).good


def test_noted_f_numbers_are_not_flagged_and_their_source_is_stated(photographed):
    plane = Plane("G1", np.zeros((4, 4), np.float32), 1e-4, pitch=2)
    true, frame = photographed
    recorded = replace(frame, exposure=replace(frame.exposure, f_number=true))
    assert look(recorded, 2 * true).good
    known = PatternFacts(pixel_pitch_um=4.0, typed_f_number=4.0)
    assert (known.diffraction(plane).f_number, known.diffraction(plane).stated_by) == (4.0, OPERATOR)
    recorded = replace(known, f_number=5.6)
    assert (recorded.diffraction(plane).f_number, recorded.diffraction(plane).stated_by) == (5.6, CAMERA)
    assert PatternFacts(pixel_pitch_um=4.0).diffraction(plane) is None


def test_the_uncertainty_of_the_tail_is_that_of_its_first_amplitude():
    # its energy is proportional to the f-number; two photographs of equal noise have 1 / sqrt(2) of its uncertainty
    covariance = np.diag([0.003, 0.02]) ** 2
    covariance[0, 1] = covariance[1, 0] = 2e-5
    tail = PsfTail(np.array([0.04, 0.0]), covariance, np.zeros((289, 2)))
    psf = Psf(np.ones((17, 17)) / 289, 4, np.zeros((289, 289)), tail)
    one, noisy = (SimpleNamespace(psf=psf, residual_std=std, n=1) for std in (0.8, 2.0))
    limit = Diffraction(5.6, 5.94, 530.0)
    single, two, worse = (f_number_of_tails([(p, limit) for p in psfs]) for psfs in ([one], [one, one], [noisy]))
    assert f_number_of_tails([(one, replace(limit, f_number=8.0))]) == single
    assert single.uncertainty == pytest.approx(0.003 / 0.04 * single.value)
    assert two.uncertainty == pytest.approx(single.uncertainty / 2**0.5)
    assert worse.uncertainty == pytest.approx(2 * single.uncertainty)
