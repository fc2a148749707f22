import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from procedures.outcome import BadInput, Refused
from procedures.restoration.masks.blur_models import mask
from procedures.restoration.unknown_motion import blind

pytestmark = pytest.mark.slow


def likeness(a, b):
    """Normalised correlation of two masks at their best shift."""
    a, b = np.pad(a, 6), np.pad(b, 6)
    return fftconvolve(a, b[::-1, ::-1]).max() / np.linalg.norm(a) / np.linalg.norm(b)


@pytest.fixture(scope="module")
def flat(vibration_shapes):
    """A flat textured wall under two motions of half-width 2, at 40 dB."""
    rng = np.random.default_rng(8)
    u = 0.5 + 0.2 * np.sign(gaussian_filter(rng.standard_normal((84, 84)), 3))
    u += 0.1 * np.sign(gaussian_filter(rng.standard_normal((84, 84)), 1.5)) + 0.01 * rng.standard_normal(u.shape)
    masks = [mask(shape, 2.0, 2) for shape in vibration_shapes]
    z = np.stack([fftconvolve(u, h, mode="valid") for h in masks])
    return z + rng.standard_normal(z.shape) * z.std() / 100, masks


def test_both_motions_their_shift_and_support_are_recovered(flat):
    prototypes = blind.prototype_shapes(flat[0], 4, rounds=16)
    assert [likeness(a, b) > 0.95 for a, b in zip(prototypes.masks, flat[1], strict=True)] == [True, True]

    # centroids may move together, not apart
    def centroid(h):
        r = len(h) // 2
        y, x = np.mgrid[-r : r + 1, -r : r + 1]
        return np.array([(h * y).sum(), (h * x).sum()])

    between = centroid(prototypes.masks[0]) - centroid(prototypes.masks[1])
    np.testing.assert_allclose(between, centroid(flat[1][0]) - centroid(flat[1][1]), atol=0.15)
    assert blind.support(flat[0], 5) == 2
    assert 1.5 <= prototypes.half_width <= 3
    again = mask(prototypes.shapes[0], prototypes.half_width, len(prototypes.masks[0]) // 2 + 1)
    # eleven samples per pixel, offset from the shape's own samples by a few hundredths of a pixel
    assert likeness(again, prototypes.masks[0]) > 0.998


def test_true_masks_satisfy_the_cross_relation_and_unfit_parts_are_refused(flat):
    z, masks = flat
    M = blind.cross_relation(z, 2)
    true = np.concatenate([h.ravel() for h in masks])
    other = np.roll(true, 7)
    assert true @ M @ true < 0.02 * (other @ M @ other)
    with pytest.raises(BadInput, match="flat part of"):
        blind.prototype_shapes(flat[0][:, :24, :24], 4)
    z = flat[0].copy()
    z[1] = np.random.default_rng(1).permutation(z[1].ravel()).reshape(z[1].shape)
    with pytest.raises((Refused, BadInput)):
        blind.prototype_shapes(z, 3, rounds=2)
