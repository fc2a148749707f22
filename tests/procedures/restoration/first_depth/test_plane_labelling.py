from __future__ import annotations

import numpy as np
import pytest

from procedures.restoration.first_depth import initial_depth
from procedures.restoration.first_depth.plane_labelling import Choice, chosen, offers
from procedures.restoration.first_depth.planes import fitted
from procedures.restoration.first_depth.slanted_matching import local_planes, sheared


def plane(shape=(60, 70), first=2.0, down=0.01, across=0.02):
    y, x = np.indices(shape)
    return first + down * y + across * x


def test_planes_of_a_plane_are_itself_but_for_damping():
    # slopes are damped by sigma / 4 against a variance of sigma^2, less at the frame, where windows are cut
    w = plane()
    found = fitted(w, np.ones_like(w), 6.0)
    inside = np.s_[20:-20, 20:-20]
    np.testing.assert_allclose(found.value[inside], w[inside], atol=1e-9)
    np.testing.assert_allclose(found.across[inside], 0.02 / (1 + 1 / 24), rtol=1e-3)
    np.testing.assert_allclose(found.down[inside], 0.01 / (1 + 1 / 24), rtol=1e-3)


def test_local_planes_follow_a_slope_and_stop_at_a_step():
    w = plane()
    w[:, 35:] += 1.5
    found = local_planes(w, 9.0, 0.35)
    inside = np.s_[12:-12, 12:-12]
    # beside the step half of the window counts: its plane is damped the more; a window that saw both sides errs by 0.7
    assert np.abs(found - w)[inside].max() < 0.1
    assert np.abs(found - w)[:, 15:20].max() < 0.05


def test_a_sheared_volume_is_the_volume_along_the_surface():
    # costs linear in the level are interpolated exactly
    levels = np.arange(8.0)
    volume = np.tile(3 * levels, (20, 30, 1)).astype(np.float32)
    surface = 1.3 + 0.1 * np.indices((20, 30))[1]
    found = sheared(volume, surface, 3, 99.0)
    np.testing.assert_allclose(found[:, :20, 1], 3 * (surface + 1)[:, :20], rtol=1e-5)
    assert (sheared(volume, np.full((20, 30), 9.0), 1, 99.0) == 99).all()


def test_planes_are_offered_where_they_lead():
    # every offered plane of one plane is that plane; inside, where no window is cut
    w = plane((90, 90))
    found = offers(w, 4.0, (8.0,))
    inside = np.s_[30:-30, 30:-30]
    # slopes are damped by a sixteenth, 8 pixels away that is 0.02 * 8 / 16
    assert np.abs(found.value - w[..., None])[inside].max() < 0.02
    assert found.left[inside].max() < 1e-6


@pytest.mark.slow
def test_choosing_turns_a_slope_between_two_levels_into_a_step():
    # costs tell both sides but nothing in between, where the first depth goes from one to the other
    truth = np.where(np.arange(80) < 40, 2.0, 3.0) * np.ones((60, 1))
    levels = np.arange(1.0, 4.2, 0.15)
    known = np.abs(np.arange(80) - 39.5) > 8
    volume = np.where(known[:, None], np.minimum(4, 3 * (truth[..., None] - levels) ** 2), 1.0).astype(np.float32)
    ramp = np.clip(2 + (np.arange(80) - 31) / 17, 2, 3) * np.ones((60, 1))
    found = chosen(volume, 1.0, 0.15, ramp, 4.0, Choice())

    def between(w):
        return ((w > 2.25) & (w < 2.75)).mean()

    assert between(found) < 0.3 * between(ramp)
    assert np.abs(found - truth)[:, known].max() < 0.1


def test_noise_alone_has_no_contrast(vibration_stacks):
    rng = np.random.default_rng(3)
    z = 0.5 + 0.02 * rng.standard_normal((2, 1, 120, 120))
    found = initial_depth.contrast_of(z, vibration_stacks, np.full(2, 0.02), 2.5)
    passed = sum(np.sum(s.at(2.5) ** 2) for s in vibration_stacks)
    # 57600 differences squared, neighbours sharing a sample: known to a per cent
    assert found < 0.05 * 8 * 0.02**2 / passed
