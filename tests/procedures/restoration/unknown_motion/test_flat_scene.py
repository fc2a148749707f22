import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from procedures.outcome import BadInput, Refused, Verdict
from procedures.outcome import Outcome as Made
from procedures.restoration.photograph_blur import BlurSpec, UnknownMotion, blur_of, judge_with_alternative
from procedures.restoration.unknown_motion import free_kernels
from procedures.restoration.unknown_motion.flat_scene import (
    EdgePicture,
    FreeKernels,
    KernelEffort,
    KernelStart,
    kernels_of_flat_scene,
    periodic,
)
from procedures.restoration.unknown_motion.kernel_error import picture_change
from procedures.restoration.unknown_motion.sparse_gradients import SparseGradients

SLOW_FIXTURES = {"outcome"}

R = 7
QUICK = KernelEffort(
    starts=(KernelStart(last_edges=2e-3),), rounds=5, kernel_iterations=40,
    compared=5, settled=3, picture_iterations=6,
)  # fmt: skip


def leaves(rng, side):
    """Overlapping discs, with edges like a scene's."""
    y, x = np.mgrid[:side, :side]
    u = np.full((side, side), 0.5)
    for _ in range(160):
        cy, cx, r = *rng.uniform(0, side, 2), rng.uniform(2, 12)
        u[(y - cy) ** 2 + (x - cx) ** 2 < r**2] = rng.uniform(0.1, 0.9)
    return gaussian_filter(u, 0.4)


def shake(rng):
    """A thick random path of a hand with stops, a hook and noise: no smooth path."""
    kernel = np.zeros((9, 9))
    at = np.array([4.0, 4.0])
    for _ in range(14):
        kernel[tuple(np.round(at).astype(int))] += rng.exponential()
        at = np.clip(at + rng.normal(0, 1.3, 2), 0, 8)
    kernel = gaussian_filter(kernel, 0.5) * (1 + 0.2 * rng.standard_normal(kernel.shape))
    kernel[kernel < 0.05 * kernel.max()] = 0
    return kernel / kernel.sum()


@pytest.fixture(scope="module")
def shaken():
    """Photographs of a flat scene through two such kernels, at 40 dB and more, the second with less light."""
    rng = np.random.default_rng(9)
    u, kernels = leaves(rng, 120), [shake(rng), shake(rng)]
    z = np.stack([fftconvolve(u, k, mode="valid") for k in kernels]) * np.array([1, 0.7])[:, None, None]
    z += 0.002 * rng.standard_normal(z.shape)
    return z, np.stack([np.pad(k, R - 4) for k in kernels]), u[4:-4, 4:-4]


@pytest.fixture(scope="module")
def findings():
    return []


@pytest.fixture(scope="module")
def blur(shaken, findings):
    source = UnknownMotion("whole", effort=QUICK)
    return blur_of(BlurSpec(source, R), [one[None] for one in shaken[0]], findings.append)


@pytest.fixture(scope="module")
def kernels(blur, findings):
    *rounds, found = findings
    assert isinstance(found, FreeKernels)
    assert [one.n for one in rounds] == [*range(1, rounds[0].most + 1)]
    return found


def test_kernels_of_irregular_paths_are_estimated_without_caveat(shaken, kernels):
    # wrong ones, even of the right size, have correlations of 0.5 to 0.8
    assert free_kernels.likeness(kernels.kernels, shaken[1]) > 0.9
    assert kernels.kernels.min() >= 0
    np.testing.assert_allclose(kernels.kernels.sum(axis=(1, 2)), 1, rtol=1e-6)
    # each photograph through the other's kernel is the same picture; noise and rims remain
    z = shaken[0] / shaken[0].mean(axis=(1, 2), keepdims=True)

    def residual(one, other):
        d = fftconvolve(z[0], other, mode="valid") - fftconvolve(z[1], one, mode="valid")
        return float(np.std(d))

    none = np.zeros_like(kernels.kernels[0])
    none[len(none) // 2, len(none) // 2] = 1
    assert residual(*kernels.kernels) < 0.1 * residual(none, none)
    assert kernels.caveat is None
    assert kernels.shapes.judged(Made(kernels, Verdict.PASS)).verdict is Verdict.PASS


def test_motions_and_scenes_that_determine_no_kernels_are_refused_or_doubtful(shaken):
    kernels = kernels_of_flat_scene(shaken[0], 3, QUICK)
    assert "reaches the end of the search range of 3 pixels" in str(kernels.caveat)
    judged = kernels.shapes.judged(Made(kernels, Verdict.PASS))
    assert judged.verdict is Verdict.DOUBTFUL
    assert "raise --max-w" in judged.remedy
    # a refusal may have the same cause
    refused = kernels.shapes.judged(Made(None, Verdict.REFUSED, "nothing explains them", "look again"))
    assert refused.remedy == "look again"
    assert "raise --max-w" in refused.other_causes[0].remedy
    other = fftconvolve(leaves(np.random.default_rng(51), 120), shaken[1][1], mode="valid")
    z = np.stack([shaken[0][0][: len(other), : len(other)], other])
    with pytest.raises(Refused, match="no kernels of up to 7 pixels"):
        kernels_of_flat_scene(z, R, QUICK)
    with pytest.raises(BadInput, match="overlap by 113 pixels; got 112 x 112"):
        kernels_of_flat_scene(shaken[0], 28, QUICK)


def test_flat_scenes_need_contrast_and_two_photographs_without_stray_pieces(shaken):
    z = np.zeros((2, 9, 9))
    z[0, 0, :5] = z[1, 8, :5] = np.array([32, 54, 48, 32, 52]) / 255
    z[1] += 0.01
    with pytest.raises(Refused, match="no kernels explain the photographs"):
        kernels_of_flat_scene(z)
    with pytest.raises(Refused, match="no contrast"):
        kernels_of_flat_scene(np.full((2, 40, 40), 0.5), 3, QUICK)
    with pytest.raises(BadInput, match="two photographs or more"):
        kernels_of_flat_scene(shaken[0][:1], R, QUICK)
    shifted = np.roll(np.pad(shaken[1], ((0, 0), (3, 3), (3, 3))), (2, -3), (1, 2)).astype(np.float32)
    cropped = free_kernels.cropped(shifted)
    np.testing.assert_allclose(cropped.sum(axis=(1, 2)), 1, rtol=1e-6)
    assert free_kernels.likeness(cropped, shaken[1]) == pytest.approx(1, abs=1e-6)
    kernel = np.zeros((1, 9, 9), np.float32)
    kernel[0, 2:5, 2:5], kernel[0, 7, 7] = 1, 0.4
    assert free_kernels.thin(kernel, 0.02)[0, 7, 7] == 0
    # a piece with enough light is, as motions may have gaps
    kernel[0, 7:, 7] = 1
    assert free_kernels.thin(kernel, 0.02)[0, 7, 7] > 0


def test_true_kernels_are_a_fixed_point_and_more_probable_than_others(shaken):
    # with the true picture's edges the true kernels are the least-squares solution, except for noise and rims
    z = (shaken[0] / shaken[0].mean(axis=(1, 2), keepdims=True)).astype(np.float32)
    edges, true = EdgePicture(z, R), shaken[1].astype(np.float32)
    u = edges.picture(true, 1e-4)
    assert free_kernels.likeness(edges.kernels(u, true, 0.0, 40), true) > 0.97
    right = shaken[1].astype(np.float32)
    cost = [SparseGradients(z, R).fit(one, 3, 8, 0.02).cost for one in (right, right[:, ::-1].copy())]
    assert cost[0] < cost[1]
    z = shaken[0].astype(np.float32)
    wide = periodic(z, R)
    np.testing.assert_array_equal(wide[:, :112, :112], z)
    share = 1 / (wide.shape[1] - 112 + 1)
    step = (z[:, 0] - z[:, -1]) * share
    np.testing.assert_allclose(wide[:, 0, :112] - wide[:, -1, :112], step, atol=1e-6)


def test_the_blur_of_a_flat_scene_has_these_kernels(kernels, blur):
    # at their own half-width kernels are reproduced
    for masks, kernel in zip(blur.masks, kernels.kernels, strict=True):
        blur_mask = masks.at(kernels.half_width)
        assert free_kernels.likeness(blur_mask[None], kernel[None]) == pytest.approx(1, abs=1e-3)


@pytest.fixture(scope="module")
def outcome(shaken, blur):
    alike = replace(blur, motion=replace(blur.motion, others=blur.motion.shapes))
    return alike.restored([one[None] for one in shaken[0]])


def test_a_flat_scene_is_restored_at_its_w(shaken, outcome):
    assert outcome.verdict is Verdict.PASS, outcome.reason
    restored = outcome.value
    assert np.ptp(restored.w) == 0
    assert restored.w_std.max() == 0
    # centred kernels shift the picture by some whole pixels
    inner = (slice(20, -20), slice(20, -20))
    shifted = (np.roll(shaken[2], (y - 4, x - 4), (0, 1))[inner] for y, x in np.ndindex(9, 9))
    error = min(np.std(restored.sharp[0][inner] - one) for one in shifted)
    assert error < 0.2 * np.std(shaken[0][0][inner] - shaken[2][inner])


def test_the_difference_of_two_searches_is_in_the_estimated_error(blur, outcome):
    kernels = blur.motion.shapes
    wider = np.stack([fftconvolve(one, np.ones((3, 3)) / 9) for one in kernels])
    before = outcome.value
    after = judge_with_alternative(before, kernels, wider).value
    more = picture_change(before.sharp, kernels, wider, before.history[-1].weights.picture)
    np.testing.assert_allclose(after.sharp_std**2, before.sharp_std**2 + more**2, rtol=1e-6)
    first, second = before.diagnostics, after.diagnostics
    assert second.picture_std**2 == pytest.approx(first.picture_std**2 + np.mean(more**2))
    assert second.gained * second.picture_std == pytest.approx(first.gained * first.picture_std)
    assert math.hypot(*after.budget.values()) == pytest.approx(second.picture_std)
