"""Measured PSFs as shapes: the mask of the measured half-width is the PSF, and a lens with vignetting is restored."""

import numpy as np
import pytest

from procedures import BadInput, RestorationParameters, Scheme, restore
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.masks.psf_shapes import measured_field, measured_shape, without_noise

from ..lens import SHAPE, WIDE, lens_field, photographs, spot


def binned(h, s, R):
    """A PSF sampled an odd s times per pixel, summed over pixels; the centre sample is in the middle of one."""
    size = (2 * R + 1) * s
    wide = np.pad(h, (size - len(h)) // 2)
    return wide.reshape(2 * R + 1, s, 2 * R + 1, s).sum(axis=(1, 3))


def test_the_measured_psf_is_the_mask_without_values_below_the_noise():
    h = spot(4.0, (0.1, 0.0), samples=3, k=31)
    shape = measured_shape(h, 3)
    assert shape.cut == 0
    # the disc of 4 pixels and half a pixel of photosite each way, less a hundredth of the light
    assert 4.0 <= shape.half_width_px <= 5.2
    mask = shape.masks(8.0, 9).middle.at(shape.half_width_px)
    # at most a hundredth of the light is cut, and cells are drawn with 257 samples
    assert np.abs(mask - binned(h, 3, 9)).sum() < 0.05
    h = np.array([[0.0, -0.1, 0.05], [0.08, 1.0, 0.2], [0.0, 0.1, -0.02]])
    np.testing.assert_allclose(without_noise(h), [[0, 0, 0], [0, 1.0, 0.2], [0, 0, 0]])
    assert measured_shape(h, 2).cut == pytest.approx(0.12 / h.sum())


@pytest.mark.parametrize(
    ("h", "samples", "complaint"),
    [
        (np.ones((4, 4)), 4, "odd number of rows"),
        (np.ones(()), 4, r"array \(k, k\); got one number"),
        (np.ones((5, 5, 5)), 4, r"array \(k, k\); got an array \(5, 5, 5\)"),
        (np.full((5, 5), np.nan), 4, "must be finite"),
        (np.full((5, 5), 1e308), 4, "must be finite, from"),
        (-np.ones((5, 5)), 4, "positive sum"),
        (np.ones((5, 5)), 0, "samples per pixel"),
    ],
)
def test_invalid_psfs_are_refused(h, samples, complaint):
    with pytest.raises(BadInput, match=complaint):
        measured_shape(h, samples)


@pytest.mark.slow
def test_a_field_restores_better_than_its_centre_or_a_blur_circle():
    scene = photographs()
    shapes = measured_field(lens_field(), SHAPE, (3, 4))
    # the measurement includes half a photosite and whole samples
    assert WIDE < shapes.half_width_px < WIDE + 0.6
    field = [shapes.masks(4.2, 7, ratio) for ratio in (1.0, 1.25)]
    circle = [mask_stack(pillbox(), 4.2, ratio=ratio, R=7) for ratio in (1.0, 1.25)]
    quick = RestorationParameters(scheme=Scheme(1, 5, 5, 1, 8))
    over, middle, round_ = (
        scene.picture_error(restore(list(scene.z), masks, quick).value.sharp)
        for masks in (field, [one.middle for one in field], circle)
    )
    assert over < 0.9 * min(middle, round_)
    assert over < 0.75 * scene.picture_error(scene.z[0])


def test_a_field_of_another_frame_is_refused():
    with pytest.raises(BadInput, match="they are 30 x 20"):
        measured_field(lens_field(), (20, 30))
