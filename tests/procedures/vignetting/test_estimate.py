"""Flats of a lens with decentred vignetting, under uneven light."""

import numpy as np
import pytest

from procedures import BadInput, Plane, Refused, Verdict
from procedures.vignetting.estimate import NAMES, estimate_vignetting, frame_places, joint_formula

ROWS, COLUMNS = 320, 480
UNIT = np.hypot(ROWS, COLUMNS) / 2
CENTRE = np.array([(COLUMNS - 1) / 2 + 18.0, (ROWS - 1) / 2 - 11.0])  # 6 and 4 % of half a diagonal
K = {"G1": (-0.45, 0.1, -0.02), "R": (-0.50, 0.12, -0.02)}
WHITE_E = 40_000.0


def lens(points: np.ndarray, plane: str) -> np.ndarray:
    r2 = np.sum((points - CENTRE) ** 2, axis=-1) / UNIT**2
    k1, k2, k3 = K[plane]
    return 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3


def flat(rng, plane="G1", slope=(0.0, 0.0)) -> Plane:
    y, x = np.mgrid[:ROWS, :COLUMNS].astype(float)
    u = np.stack([x - (COLUMNS - 1) / 2, y - (ROWS - 1) / 2], axis=-1) / UNIT
    light = 0.6 * lens(np.stack([x, y], axis=-1), plane) * (1 + u @ slope)
    return Plane(plane, (rng.poisson(light * WHITE_E) / WHITE_E).astype(np.float32), 1 / 16000, pitch=2)


def rotated(rng, planes=("G1",), slope=0.012, count=4):
    """Flats with light of constant slope, rotated by a quarter between them."""
    angles = 2 * np.pi * np.arange(count) / count
    return [
        (f"flat{i}", {name: flat(rng, name, slope * np.array([np.cos(a), np.sin(a)])) for name in planes})
        for i, a in enumerate(angles)
    ]


@pytest.fixture(scope="module")
def outcomes():
    return estimate_vignetting(rotated(np.random.default_rng(5), ("R", "G1")))


def middle() -> np.ndarray:
    return np.array([[(COLUMNS - 1) / 2, (ROWS - 1) / 2]])


@pytest.mark.parametrize("plane", ["G1", "R"])
def test_the_light_of_a_decentred_lens_is_estimated_to_half_a_percent(outcomes, plane):
    outcome = outcomes[plane]
    assert outcome.verdict is Verdict.PASS, outcome.reason
    true = lens(outcome.value.places, plane) / lens(middle(), plane)
    assert np.abs(outcome.value.value / true - 1).max() < 0.005


def test_the_uncertainty_is_consistent_with_the_error(outcomes):
    one = outcomes["G1"].value
    true = lens(one.places, "G1") / lens(middle(), "G1")
    known = one.uncertainty > 0  # the middle is 1 by definition
    pull = (one.value - true)[known] / one.uncertainty[known]
    # the map has few degrees of freedom: its rms pull scatters, but not by a factor of three
    assert np.sqrt(np.mean(pull**2)) < 3


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0)])
def test_a_slope_that_turned_with_the_flats_is_no_uncertainty(order):
    flats = rotated(np.random.default_rng(8), slope=0.03)
    one = estimate_vignetting([flats[i] for i in order])["G1"].value
    corner = one.numbers["corner_light"]
    corners = np.array([[x, y] for x in (0.0, COLUMNS - 1) for y in (0.0, ROWS - 1)])
    true = float(np.mean(lens(corners, "G1") / lens(middle(), "G1")))
    assert corner.value == pytest.approx(true, abs=4 * corner.uncertainty)
    assert corner.uncertainty < 0.002  # the slopes alone would state 0.01


def test_centre_and_colour_of_the_falloff_are_the_lens_s_with_their_scatter(outcomes):
    rng = np.random.default_rng(9)
    alone = [(f"flat{i}", {"G1": flat(rng, slope=0.015 * rng.standard_normal(2))}) for i in range(4)]
    surface = estimate_vignetting(alone)["G1"].value.surface
    np.testing.assert_array_equal(surface.slope_errors, surface.slopes)
    numbers = outcomes["G1"].value.numbers
    # pixels of the plane, whose centre lies a quarter of a pixel beyond the array's: the planes of a mosaic are apart
    for name, true in zip("xy", (17.75, -11.25), strict=True):
        number = numbers[f"vignetting_centre_{name}"]
        assert number.value == pytest.approx(true, abs=4 * number.uncertainty)
        assert number.uncertainty < 6
    places = frame_places((ROWS, COLUMNS))
    ratio = lens(places, "R") / lens(middle(), "R") / (lens(places, "G1") / lens(middle(), "G1"))
    shading = outcomes["R"].value.numbers["colour_shading"]
    assert shading.value == pytest.approx(np.sqrt(np.mean((ratio - 1) ** 2)), abs=4 * shading.uncertainty)
    assert "colour_shading" not in outcomes["G1"].value.numbers


def test_planes_of_a_mosaic_have_one_centre_and_no_colour_shading():
    rng = np.random.default_rng(7)
    y, x = np.mgrid[: 2 * ROWS, : 2 * COLUMNS].astype(float)
    light = 0.6 * lens(np.stack([x / 2, y / 2], axis=-1), "G1")
    sensor = (rng.poisson(light * WHITE_E) / WHITE_E).astype(np.float32)
    corners = {"R": (0, 0), "G1": (1, 0), "G2": (0, 1), "B": (1, 1)}
    planes = {name: Plane(name, sensor[j::2, i::2], 1 / 16000, 2, (i, j)) for name, (i, j) in corners.items()}
    numbers = {name: one.value.numbers for name, one in estimate_vignetting([("flat", planes)]).items()}
    true = CENTRE - [(2 * COLUMNS - 1) / 4, (2 * ROWS - 1) / 4]
    for name in corners:
        for axis, expected in zip("xy", true, strict=True):
            # 150 000 samples of 0.6 % noise, and a slope of 0.9 of the light over half a diagonal of 290 pixels
            assert numbers[name][f"vignetting_centre_{axis}"].value == pytest.approx(expected, abs=0.1)
        if name != "G1":
            shading = numbers[name]["colour_shading"]
            assert shading.value < 3 * shading.uncertainty


def test_a_radial_falloff_fits_the_formula(outcomes):
    assert outcomes["G1"].value.radial.lost < 0.001  # the truth is radial


def test_no_flat_one_flat_and_structure_are_refused_or_doubtful():
    with pytest.raises(Refused, match="needs photographs of even light"):
        estimate_vignetting([])
    with pytest.raises(BadInput, match="same planes and sizes; flat 1 and flat 2 differ"):
        estimate_vignetting([np.full((96, 128), 0.5), np.full((96, 130), 0.5)])
    outcome = estimate_vignetting([("one", {"G1": flat(np.random.default_rng(1))})])["G1"]
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "slope of the light" in outcome.reason
    flats = rotated(np.random.default_rng(2), count=2)
    for _, planes in flats:
        planes["G1"].samples[:, ::40] *= 0.7
    outcome = estimate_vignetting(flats)["G1"]
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "structure" in outcome.reason


@pytest.mark.parametrize(("factor", "words"), [(2.0, "clipped"), (0.01, "too dark")])
def test_a_flat_without_usable_light_is_refused(factor, words):
    plane = flat(np.random.default_rng(3))
    bad = Plane("G1", np.minimum(plane.samples * factor, 1).astype(np.float32), plane.quantisation)
    outcome = estimate_vignetting([("bad", {"G1": bad})])["G1"]
    assert outcome.verdict is Verdict.REFUSED
    assert words in outcome.reason


def test_planes_are_correlated_by_the_slope_of_the_light():
    rng = np.random.default_rng(5)
    slopes = 0.01 * rng.standard_normal((4, 2))
    flats = [(f"flat{i}", {name: flat(rng, name, one) for name in ("R", "G1")}) for i, one in enumerate(slopes)]
    values = {name: outcome.value for name, outcome in estimate_vignetting(flats).items()}
    joint = joint_formula(values)
    assert joint.planes == ("R", "G1")
    for i, one in enumerate(values.values()):
        np.testing.assert_array_equal(joint.covariance[5 * i : 5 * i + 5, 5 * i : 5 * i + 5], one.radial.covariance)
        stated = [one.numbers[f"vignetting_{name}"].value for name in NAMES]
        np.testing.assert_allclose(joint.values[5 * i : 5 * i + 5], stated)
    spread = np.sqrt(np.diag(joint.covariance))
    between = (joint.covariance / np.outer(spread, spread))[:5, 5:]
    # the slope dominates the uncertainty of the centres: 1.2 % of light, and much less noise
    assert np.diag(between)[:2].min() > 0.5
    assert np.linalg.eigvalsh(joint.covariance / np.outer(spread, spread)).min() > -1e-9


def test_one_flat_gives_no_correlation():
    (one,) = rotated(np.random.default_rng(1), ("R", "G1"), count=1)
    values = {name: outcome.value for name, outcome in estimate_vignetting([one]).items()}
    assert not joint_formula(values).covariance[:5, 5:].any()
