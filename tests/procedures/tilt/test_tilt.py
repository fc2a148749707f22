"""Simulated sensors with known tilt, backfocus and screws, and brackets of a simulated lens."""

from dataclasses import replace

import numpy as np
import pytest

from procedures.outcome import BadParameter, Refused, Verdict
from procedures.tilt.estimate import Tilt, TiltParameters, estimate_tilt, nominal_um, shim_words
from procedures.tilt.plane import Positions, Screws, behind_lens_um, fit_plane, turns_for
from tests.procedures.field.lens import LENS, SHAPE, FieldCamera, grid, nodes

FRAME = (36.0, 24.0)
NINE = np.array([(x, y) for y in (-10.0, 0.0, 10.0) for x in (-15.0, 0.0, 15.0)])
PLACE_UM, POSITION_UM = 1.0, 0.5
NOISE = PLACE_UM**2 * np.eye(9) + POSITION_UM**2  # of each place, and of the rail, common to all places
SCREWS = Screws(count=3, radius_mm=25.0, pitch_mm=0.35, first_deg=30.0, turn_uncertainty=0.003)  # a degree


def corners(plane):
    x, y = np.array(FRAME) / 2
    return plane[0] + np.array([(sx * x, sy * y) for sx in (-1, 1) for sy in (-1, 1)]) @ plane[1:]


def random_sensor(rng):
    """Offset and slopes of a sensor with corners up to 100 um out, and the field curvature."""
    slopes = rng.standard_normal(2)
    slopes *= rng.uniform(0, 100) / np.abs(corners(np.array([0.0, *slopes]))).max()
    return np.array([rng.uniform(-50, 50), *slopes]), rng.uniform(-0.1, 0.1, 3)


def heights(plane, bend, rng):
    """Measured heights at nine places; the offset is that of the plane nearest to the curved surface."""
    x, y = NINE.T
    middle = bend[0] * FRAME[0] ** 2 / 12 + bend[2] * FRAME[1] ** 2 / 12
    true = plane[0] - middle + NINE @ plane[1:] + bend @ np.stack([x * x, x * y, y * y])
    return true + rng.multivariate_normal(np.zeros(9), NOISE)


def test_intervals_cover_95_percent_and_two_corrections_align_every_sensor():
    # three numbers of each of 100 sensors: 95 % of 300 is 285 +- 3.8; the scaling by residuals adds some
    rng, inside, uncertainties = np.random.default_rng(3), [], []
    for _ in range(100):
        plane, bend = random_sensor(rng)
        found = fit_plane(NINE, heights(plane, bend, rng), NOISE, FRAME)
        spread = np.sqrt(np.diag(found.covariance))
        inside += list(np.abs(found.plane - plane) < 1.96 * spread)
        uncertainties.append(np.max(spread[1:] * FRAME))
    assert 0.92 <= np.mean(inside) <= 0.99
    assert np.median(uncertainties) < 2.0  # um over the frame
    rng, remaining = np.random.default_rng(4), []
    for _ in range(60):
        plane, bend = random_sensor(rng)
        for _ in range(2):
            correction = turns_for(fit_plane(NINE, heights(plane, bend, rng), NOISE, FRAME), SCREWS, with_focus=True)
            turned = np.array([one.value for one in correction.turns])
            slips = SCREWS.turn_uncertainty * rng.standard_normal(SCREWS.count)
            plane = plane + np.linalg.solve(SCREWS.heights, 1000 * SCREWS.pitch_mm * (turned + slips))
        remaining.append(np.abs(corners(plane)).max())
    # the last measurement and turns to a degree give about 1.4 um (rms) in a corner
    assert np.quantile(remaining, 0.95) < 5.0
    assert max(remaining) < 7.0


def test_the_probability_of_improvement_is_realistic():
    # slopes uniform over a range that is wide compared with their uncertainty, as the probability assumes
    rng, stated, improved = np.random.default_rng(5), [], []
    for _ in range(150):
        plane = np.array([0.0, *rng.uniform(-0.12, 0.12, 2)])
        found = fit_plane(NINE, heights(plane, np.zeros(3), rng), NOISE, FRAME)
        correction = turns_for(found, SCREWS, with_focus=False)
        slips = SCREWS.turn_uncertainty * rng.standard_normal(3)
        moved = 1000 * SCREWS.pitch_mm * (np.array([one.value for one in correction.turns]) + slips)
        after = plane + np.linalg.solve(SCREWS.heights, moved) * [0, 1, 1]
        stated.append(correction.helps)
        improved.append(found.rms(after[None])[0] < found.rms(plane[None])[0])
    stated, improved = np.array(stated), np.array(improved)
    uncertain = stated < 0.97
    assert np.count_nonzero(uncertain) > 30
    error = np.sqrt(np.sum(stated * (1 - stated) * uncertain)) / np.count_nonzero(uncertain)
    assert stated[uncertain].mean() == pytest.approx(improved[uncertain].mean(), abs=3 * error)


def test_turns_of_the_screws_follow_from_places_in_the_inverted_image():
    top, right, bottom, left = Screws(count=4, radius_mm=10.0).places_mm
    # from behind the camera the photograph's lower edge is the sensor's upper one, its left the right one
    np.testing.assert_allclose([top, right, bottom, left], [(0, 10), (-10, 0), (0, -10), (10, 0)], atol=1e-9)
    # 2 um/mm from left to right of the photograph: the right screw, at -20 mm, stands 40 um too near to the lens
    exact = fit_plane(NINE, NINE @ [2.0, 0.0], 1e-6 * np.eye(9), FRAME)
    screws = Screws(count=4, radius_mm=20.0, pitch_mm=0.5, turn_uncertainty=0.0)
    correction = turns_for(exact, screws, with_focus=False)
    assert [one.value for one in correction.turns] == pytest.approx([0.0, 0.08, 0.0, -0.08], abs=1e-6)
    assert correction.helps == 1.0
    bumps = np.array([9.0, -9, 9, -9, 9, -9, 9, -9, 9])
    smooth, rough = (fit_plane(NINE, one, NOISE, FRAME) for one in (np.zeros(9), bumps))
    assert rough.chance < 0.001 < smooth.chance
    assert rough.covariance[1, 1] > 10 * smooth.covariance[1, 1]
    for places in (NINE[:6], np.column_stack([np.linspace(-15, 15, 9), np.zeros(9)])):
        with pytest.raises(Refused, match="do not separate a tilt"):
            fit_plane(places, np.zeros(len(places)), np.eye(len(places)), FRAME)
    # Newton: x x' = f^2; 1000 mm before the focal point of 50 mm the image is 2.5 mm behind the other
    assert behind_lens_um(1050.0, Positions.SET, 50.0) == pytest.approx(52500)
    assert behind_lens_um(1050.0, Positions.CHART, 50.0) == pytest.approx(-52500)
    assert behind_lens_um(1.5, Positions.LENS, None) == 1500
    with pytest.raises(BadParameter, match="--focal-length-mm"):
        behind_lens_um(1050.0, Positions.SET, None)


PARAMETERS = TiltParameters(pixel_pitch_um=5.94, chart_tilt_deg=0.0, nominal_mm=0.0)
TILT_UM = (0.12, -0.08)
BEHIND_UM, PER_PATH = -10.0, 16 * 3**0.5 * 2.8**2


def bracket(covariance, step_mm=0.025):
    """Nine places of a lens at f/2.8 with a tilted sensor, at seven positions; rms path a is 16 sqrt(3) N^2 a um.

    The middle of the sensor is BEHIND_UM behind its nominal position.
    """
    camera = FieldCamera(replace(LENS, tilt_um=TILT_UM, axis=(0.0, 0.0)), period_px=36)
    rng = np.random.default_rng(8)
    places = grid(3, 3)
    return {
        position: nodes(camera, places, covariance, rng, defocus_um=(1000 * position + BEHIND_UM) / PER_PATH)
        for position in step_mm * np.arange(-3, 4)
    }


def flat(offset_um, parameters=None):
    """Result for a flat sensor with exact heights."""
    exact = fit_plane(NINE, np.full(9, offset_um), 1e-6 * np.eye(9), FRAME)
    if parameters is not None:
        exact = exact.widened(0.0, nominal_um(parameters) ** 2)
    return Tilt(exact, np.zeros(9), SCREWS, turns_for(exact, SCREWS, with_focus=True), with_focus=True)


def test_backfocus_has_the_uncertainty_of_the_distance_and_gives_the_shim():
    # at 1050 mm, magnification 1/20, an error of 2 mm is one of 2 / 400 mm behind the lens, to 0.2 %
    known = TiltParameters(5.0, Positions.SET, 50.0, nominal_mm=1050.0, nominal_uncertainty_mm=2.0)
    numbers = flat(7.0, known).numbers()
    for name in ("backfocus", "backfocus_centre", "shim"):
        assert numbers[name].uncertainty == pytest.approx(5.0, rel=0.01)
    assert numbers["tilt_horizontal"].uncertainty < 0.01
    # light comes to a focus before it: the lens has to come nearer by as much; 70 um are a fifth of a turn of 0.35 mm
    assert "70.0 ± 0.0 um behind best focus" in shim_words(flat(70.0))
    assert "thinner by that, or turn every screw by 0.200 towards the lens" in shim_words(flat(70.0))
    assert "thicker by that, or turn every screw by 0.200 away from the lens" in shim_words(flat(-70.0))
    loose = TiltParameters(5.0, nominal_mm=0.0, nominal_uncertainty_mm=0.05)
    assert "does not differ from zero" in shim_words(flat(70.0, loose))
    assert not shim_words(replace(flat(70.0), with_focus=False))


@pytest.mark.slow
def test_the_tilt_of_a_sensor_is_recovered_from_its_bracket(covariance):
    outcome = estimate_tilt(bracket(covariance), SHAPE, 2, PARAMETERS)
    assert outcome.verdict is Verdict.PASS, outcome.reason
    numbers = outcome.value.numbers()
    half = np.hypot(*SHAPE) / 2
    for name, tilt, side in zip(("tilt_horizontal", "tilt_vertical"), TILT_UM, (SHAPE[1], SHAPE[0]), strict=True):
        true = PER_PATH * tilt * side / half
        assert numbers[name].uncertainty < 2.0
        assert numbers[name].value == pytest.approx(true, abs=3 * numbers[name].uncertainty + 1.0)
    centre, mean = numbers["backfocus_centre"], numbers["backfocus"]
    assert centre.value == pytest.approx(BEHIND_UM, abs=3 * centre.uncertainty + 1.0)
    # r^2 is a third of the half diagonal's, on average over the frame
    bent = PER_PATH * LENS.field_curvature_um / 3
    assert mean.value == pytest.approx(BEHIND_UM + bent, abs=3 * mean.uncertainty + 1.0)
    assert (numbers["shim"].value, numbers["shim"].uncertainty) == (-mean.value, mean.uncertainty)
    assert outcome.value.turns.helps > 0.99
