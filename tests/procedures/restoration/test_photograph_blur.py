"""Masks from the specification of the blur."""

import numpy as np
import pytest

from procedures import BadParameter, Refused, pillbox
from procedures.restoration.masks.camera_motion import Poses
from procedures.restoration.masks.psf_shapes import measured_shape
from procedures.restoration.photograph_blur import (
    AdditionalDefocus,
    BlurSpec,
    KnownShapes,
    RecordedMotion,
    UnknownMotion,
    blur_of,
)

SIZE = (72, 90)
PHOTOGRAPHS = [np.random.default_rng(n).random((1, *SIZE)) for n in (1, 2)]


def disc(radius, size=25):
    x, y = np.meshgrid(*[(np.arange(size) - size // 2) / 2] * 2)
    h = (np.hypot(x, y) <= radius).astype(float)
    return measured_shape(h / h.sum(), 2)


def variance(mask):
    """Variance of a mask's light along x, pixels squared."""
    x = np.arange(len(mask)) - len(mask) // 2
    return float((mask * x**2).sum())


def swing(axis, reach_m):
    """A rig that swings along one axis once, without rotation."""
    position = np.zeros((256, 3))
    position[:, axis] = reach_m * np.sin(np.linspace(0, 2 * np.pi, 256))
    return Poses(position, np.zeros((256, 3)))


def test_the_default_ratio_is_that_of_measured_shapes():
    blur = blur_of(BlurSpec(KnownShapes((disc(2.0), disc(3.0))), 3.0), PHOTOGRAPHS)
    # a sample is half a pixel wide
    assert blur.ratios[1] == pytest.approx(1.5, abs=0.2)


@pytest.mark.slow
def test_on_finer_pixels_the_blur_is_proportionally_wider():
    blur = blur_of(BlurSpec(KnownShapes((pillbox(), pillbox()), (1.0, 1.2), (0.0, 0.5)), 3.0), PHOTOGRAPHS)
    finer = blur.finer(2)
    for coarse, fine, half in zip(blur.masks, finer, (2.5, 1.2 * 2.5 + 0.5), strict=True):
        for mask, radius in ((coarse.at(2.5), half), (fine.at(5.0), 2 * half)):
            # a disc's variance along an axis is a quarter of its squared radius, and a pixel's 1/12; its rim is known
            # to a sample, eleven per pixel
            assert variance(mask) == pytest.approx(radius**2 / 4 + 1 / 12, abs=radius / 2 / 11)


def test_blur_of_a_rig_and_of_defocus_has_its_width_and_parts_must_lie_inside():
    exposures = (swing(0, 1e-3), swing(1, 1e-3))
    by_path = blur_of(BlurSpec(RecordedMotion(exposures), 4.0), PHOTOGRAPHS)
    by_depth = blur_of(BlurSpec(RecordedMotion(exposures, focal_px=500.0), 4.0), PHOTOGRAPHS)
    assert (by_path.unit.name, by_depth.unit.name) == ("pixel", "1/m")
    # 1 mm at 1 m and a focal length of 500 pixels is half a pixel
    assert by_depth.unit.per_pixel == pytest.approx(2.0, rel=1e-3)
    for one, other in zip(by_path.masks, by_depth.masks, strict=True):
        np.testing.assert_allclose(variance(one.at(4.0)), variance(other.middle.at(4.0)), rtol=0.02, atol=0.02)
    motion = BlurSpec(RecordedMotion((swing(0, 1e-3), swing(1, 1e-3))), 3.0)
    defocus = AdditionalDefocus((pillbox(), pillbox()), (0.5, 0.5), (0.0, 0.0))
    alone = blur_of(motion, PHOTOGRAPHS)
    combined = blur_of(BlurSpec(motion.source, 3.0, defocus), PHOTOGRAPHS)
    for n, w in ((1, 3.0), (2, 6.0)):
        one, other = alone.finer(n)[0], combined.finer(n)[0].middle
        # of a disc of half-width w / 2, and a squared pixel; drawn as above
        assert variance(other.at(w)) - variance(one.at(w)) == pytest.approx(w**2 / 16 + 1 / 12, abs=w / 4 / 11)
    with pytest.raises(BadParameter, match="80,0,20,20 must lie within photographs of 90 x 72"):
        blur_of(BlurSpec(UnknownMotion((80, 0, 20, 20)), 2.0), PHOTOGRAPHS)
    with pytest.raises(Refused, match="no part of the photographs has one motion each"):
        blur_of(BlurSpec(UnknownMotion(), 2.0), [one[:, :28, :28] for one in PHOTOGRAPHS])
