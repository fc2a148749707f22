from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import affine_transform, shift

from procedures import BadInput, Refused, RestorationParameters, Scheme, Verdict, restore
from procedures.restoration.first_depth.registration import (
    Displacement,
    displacement,
    register,
    relative_light,
    shift_back,
)

from ..conftest import scene


def displaced(z, x, y):
    """The pair with its second photograph shifted, cropped to the common part."""
    rim = int(np.ceil(max(abs(x), abs(y)))) + 2
    shifted = np.stack([z[0], shift(z[1], (0, y, x), order=5, mode="nearest")])
    return shifted[..., rim:-rim, rim:-rim]


@pytest.mark.parametrize(("x", "y"), [(3.0, 0.0), (-2.0, 5.0), (0.5, -0.3)])
def test_a_shift_is_estimated_through_different_masks_and_a_depth_edge(vibrating, x, y):
    registration = displacement(displaced(vibrating.z, x, y), vibrating.stacks)
    assert registration.significant()
    # tiles of 96 pixels contain slightly different parts of the scene in both photographs: 3 % of the shift; noise and
    # the depth edge alone shift the photographs by 0.05
    assert np.hypot(registration.x - x, registration.y - y) < 0.07 + 0.03 * np.hypot(x, y)


def test_registered_photographs_are_unchanged(vibrating):
    trust = np.ones((2, 1, *vibrating.z.shape[2:]))
    registration = register(vibrating.z, trust, vibrating.stacks)
    assert np.array_equal(registration.z, vibrating.z)
    assert not registration.shifts.any()
    assert registration.light.tolist() == [1, 1]


@pytest.mark.parametrize("huge", [1e200, -1e200, np.inf])
def test_photographs_of_impossible_numbers_are_refused_before_curves_are_fitted(vibrating, huge):
    z = vibrating.z.copy()
    z[1, 0, 40, 40] = huge
    with pytest.raises(BadInput, match="samples of photograph 2 must be finite"):
        restore([*z], vibrating.stacks)


def test_noise_has_no_shift_and_pixels_from_outside_no_trust(vibration_stacks):
    rng = np.random.default_rng(5)
    assert not displacement(0.5 + 0.01 * rng.standard_normal((2, 1, 160, 160)), vibration_stacks).significant()
    ramp = np.add.outer(np.arange(12.0), 2 * np.arange(16.0))[None]
    shifted, trust = shift_back(ramp, np.ones((1, 12, 16)), 2.5, -1.0)
    valid = trust[0] > 0
    assert valid.sum() == 11 * 13
    # a cubic spline preserves a ramp: the photograph shifted by (2.5, -1) was the ramp 5 lower and 1 higher
    inside = shifted[0, 4:8, 4:10] - ramp[0, 4:8, 4:10]
    assert inside == pytest.approx(2 * 2.5 - 1.0, abs=0.02)


@pytest.mark.slow
def test_a_shift_within_the_masks_is_corrected_and_reported(vibrating):
    z = displaced(vibrating.z, 4.0, -1.0)
    outcome = restore(list(z), vibrating.stacks, RestorationParameters(scheme=Scheme(2, 4, 4, 1, 6)))
    assert outcome.verdict == Verdict.PASS, outcome.reason
    assert outcome.value.shifts[1] == pytest.approx((4.0, -1.0), abs=0.1)
    assert outcome.value.diagnostics.residual_over_noise < 1.2


def test_light_is_corrected_and_a_shift_larger_than_the_masks_refused(vibrating):
    z = displaced(vibrating.z, 8.0, 0.0)
    with pytest.raises(Refused, match=r"shifted by \(8, .*more than the masks' 6"):
        register(z, np.ones((2, 1, *z.shape[2:])), vibrating.stacks)
    z = vibrating.z * np.array([1, 0.93])[:, None, None, None]
    # the depth edge, at which no single level fits, contributes some thousandths
    assert relative_light(z, vibrating.stacks).factor == pytest.approx(0.93, abs=5e-3)
    registration = register(z, np.ones((2, 1, *z.shape[2:])), vibrating.stacks)
    assert registration.z == pytest.approx(vibrating.z, abs=5e-3)


def together(z, stacks):
    trust = (z < 0.98).all(axis=1, keepdims=True).astype(float)
    return register(z, trust, stacks)


@pytest.mark.parametrize("light", [0.5, 1.8])
def test_half_and_nearly_twice_the_light_is_corrected(vibrating, light):
    z = vibrating.z * np.array([0.55, 0.55 * light])[:, None, None, None]
    registration = together(z, vibrating.stacks)
    assert registration.light[1] == pytest.approx(light, rel=5e-3)
    assert registration.z[1] == pytest.approx(0.55 * vibrating.z[1], abs=5e-3)


@pytest.mark.parametrize(
    "spoil",
    [lambda z: np.clip(z, 0, 1) ** (1 / 2.2), lambda z: np.clip(z, 0, 1) ** (1 / 1.2), lambda z: 0.9 * z + 0.06],
)
def test_another_tone_curve_or_black_level_is_refused_by_name(vibrating, spoil):
    z = np.stack([vibrating.z[0], spoil(vibrating.z[1])])
    with pytest.raises(Refused, match="photograph 2 has another tone curve or black level"):
        together(z, vibrating.stacks)


def test_clipped_highlights_and_another_scene_are_no_tone_curve(vibrating):
    clipped = np.minimum(1.25 * vibrating.z, 1.0)
    assert (clipped >= 0.98).mean() > 0.02
    together(clipped, vibrating.stacks)
    other = np.stack([vibrating.z[0], 0.4 * vibrating.z[1][..., ::-1, ::-1]])
    assert together(other, vibrating.stacks).light[1] == 1


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "zoom"), [(0.5, 1.0), (0.0, 1.02), (-0.3, 0.99)])
def test_rotation_and_zoom_are_corrected(vibration_stacks, degrees, zoom):
    photographed = scene(vibration_stacks, (200, 240), 40.0)
    t, middle = np.deg2rad(degrees), np.array([199, 239]) / 2
    A = np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]) / zoom  # (y, x) of the registered photograph
    shifted = affine_transform(photographed.z[1, 0], A, middle - A @ middle, order=5, mode="nearest")
    registration = together(np.stack([photographed.z[0], shifted[None]]), vibration_stacks)
    assert np.rad2deg(registration.turns[1]) == pytest.approx(degrees, abs=0.05)
    assert registration.zooms[1] == pytest.approx(zoom, abs=1e-3)
    inside = np.s_[1, 0, 20:-20, 20:-20]
    # a twentieth of a degree is a tenth of a pixel at the rim, where edges are steep
    assert np.std((registration.z - photographed.z)[inside]) < 0.2 * np.std(
        shifted[20:-20, 20:-20] - photographed.z[inside]
    )
    assert registration.trust[1, 0, 60:-60, 60:-60].all()


def test_significance_needs_a_gain():
    slight = Displacement(1.0, 0.0, 0.02)
    assert not slight.significant()
    assert replace(slight, gain=0.2).significant()
