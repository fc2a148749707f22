from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import affine_transform, shift

from procedures.outcome import BadInput, Refused, Verdict
from procedures.restoration.first_depth.registration import (
    Displacement,
    displacement,
    registered,
    relative_light,
    taken_up,
)
from procedures.restoration.joint.estimate import RestorationParameters, restore
from procedures.restoration.joint.schedule import Scheme

from ..conftest import scene


def displaced(z, x, y):
    """The pair with its second photograph moved, what came in from outside cut off."""
    rim = int(np.ceil(max(abs(x), abs(y)))) + 2
    moved = np.stack([z[0], shift(z[1], (0, y, x), order=5, mode="nearest")])
    return moved[..., rim:-rim, rim:-rim]


@pytest.mark.parametrize(("x", "y"), [(3.0, 0.0), (-2.0, 5.0), (0.5, -0.3)])
def test_a_shift_is_found_through_unlike_masks_and_a_step_in_depth(vibrating, x, y):
    found = displacement(displaced(vibrating.z, x, y), vibrating.stacks)
    assert found.believed()
    # tiles of 96 pixels see slightly different parts of the scene in both photographs: 3 % of the shift; noise and the
    # step in depth shift the photographs as they are by 0.05 already
    assert np.hypot(found.x - x, found.y - y) < 0.07 + 0.03 * np.hypot(x, y)


def test_photographs_in_their_places_stay_as_they_are(vibrating):
    trust = np.ones((2, 1, *vibrating.z.shape[2:]))
    found = registered(vibrating.z, trust, vibrating.stacks)
    assert np.array_equal(found.z, vibrating.z)
    assert not found.shifts.any()
    assert found.light.tolist() == [1, 1]


@pytest.mark.parametrize("huge", [1e200, -1e200, np.inf])
def test_photographs_of_impossible_numbers_are_refused_before_curves_are_fitted(vibrating, huge):
    z = vibrating.z.copy()
    z[1, 0, 40, 40] = huge
    with pytest.raises(BadInput, match="samples of photograph 2 must be finite"):
        restore([*z], vibrating.stacks)


def test_noise_has_no_shift(vibration_stacks):
    rng = np.random.default_rng(5)
    assert not displacement(0.5 + 0.01 * rng.standard_normal((2, 1, 160, 160)), vibration_stacks).believed()


def test_what_nobody_saw_is_not_trusted():
    ramp = np.add.outer(np.arange(12.0), 2 * np.arange(16.0))[None]
    moved, trust = taken_up(ramp, np.ones((1, 12, 16)), 2.5, -1.0)
    known = trust[0] > 0
    assert known.sum() == 11 * 13
    # a cubic spline keeps a ramp: the photograph shifted by (2.5, -1) was the ramp 5 lower and 1 higher
    inside = moved[0, 4:8, 4:10] - ramp[0, 4:8, 4:10]
    assert inside == pytest.approx(2 * 2.5 - 1.0, abs=0.02)


@pytest.mark.slow
def test_a_shift_within_the_masks_is_taken_up_and_said(vibrating):
    z = displaced(vibrating.z, 4.0, -1.0)
    outcome = restore(list(z), vibrating.stacks, RestorationParameters(scheme=Scheme(2, 4, 4, 1, 6)))
    assert outcome.verdict == Verdict.PASS, outcome.reason
    assert outcome.value.shifts[1] == pytest.approx((4.0, -1.0), abs=0.1)
    assert outcome.value.diagnostics.residual_over_noise < 1.2


def test_a_shift_larger_than_the_masks_is_refused(vibrating):
    z = displaced(vibrating.z, 8.0, 0.0)
    with pytest.raises(Refused, match=r"shifted by \(8, .*more than the masks' 6"):
        registered(z, np.ones((2, 1, *z.shape[2:])), vibrating.stacks)


def test_less_light_is_found_and_taken_up(vibrating):
    z = vibrating.z * np.array([1, 0.93])[:, None, None, None]
    # the depth step, at which no one level fits, leaves some thousandths
    assert relative_light(z, vibrating.stacks).factor == pytest.approx(0.93, abs=5e-3)
    found = registered(z, np.ones((2, 1, *z.shape[2:])), vibrating.stacks)
    assert found.z == pytest.approx(vibrating.z, abs=5e-3)


def together(z, stacks):
    trust = (z < 0.98).all(axis=1, keepdims=True).astype(float)
    return registered(z, trust, stacks)


@pytest.mark.parametrize("light", [0.5, 1.8])
def test_half_and_nearly_twice_the_light_is_taken_up(vibrating, light):
    z = vibrating.z * np.array([0.55, 0.55 * light])[:, None, None, None]
    found = together(z, vibrating.stacks)
    assert found.light[1] == pytest.approx(light, rel=5e-3)
    assert found.z[1] == pytest.approx(0.55 * vibrating.z[1], abs=5e-3)


@pytest.mark.parametrize(
    "spoil",
    [lambda z: np.clip(z, 0, 1) ** (1 / 2.2), lambda z: np.clip(z, 0, 1) ** (1 / 1.2), lambda z: 0.9 * z + 0.06],
)
def test_another_tone_curve_or_black_level_is_refused_by_name(vibrating, spoil):
    z = np.stack([vibrating.z[0], spoil(vibrating.z[1])])
    with pytest.raises(Refused, match="photograph 2 has another tone curve or black level"):
        together(z, vibrating.stacks)


def test_neither_clipped_highlights_nor_another_scene_are_taken_for_a_tone_curve(vibrating):
    clipped = np.minimum(1.25 * vibrating.z, 1.0)
    assert (clipped >= 0.98).mean() > 0.02
    together(clipped, vibrating.stacks)
    other = np.stack([vibrating.z[0], 0.4 * vibrating.z[1][..., ::-1, ::-1]])
    assert together(other, vibrating.stacks).light[1] == 1


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "zoom"), [(0.5, 1.0), (0.0, 1.02), (-0.3, 0.99)])
def test_a_turned_and_a_zoomed_photograph_is_brought_back(vibration_stacks, degrees, zoom):
    seen = scene(vibration_stacks, (200, 240), 40.0)
    t, middle = np.deg2rad(degrees), np.array([199, 239]) / 2
    A = np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]) / zoom  # (y, x) of the photograph in its place
    moved = affine_transform(seen.z[1, 0], A, middle - A @ middle, order=5, mode="nearest")
    found = together(np.stack([seen.z[0], moved[None]]), vibration_stacks)
    assert np.rad2deg(found.turns[1]) == pytest.approx(degrees, abs=0.05)
    assert found.zooms[1] == pytest.approx(zoom, abs=1e-3)
    inside = np.s_[1, 0, 20:-20, 20:-20]
    # a twentieth of a degree is a tenth of a pixel at the rim, where edges are steep
    assert np.std((found.z - seen.z)[inside]) < 0.2 * np.std(moved[20:-20, 20:-20] - seen.z[inside])
    assert found.trust[1, 0, 60:-60, 60:-60].all()


def test_belief_needs_a_gain():
    slight = Displacement(1.0, 0.0, 0.02)
    assert not slight.believed()
    assert replace(slight, gain=0.2).believed()
