from __future__ import annotations

import numpy as np
import pytest

from procedures.outcome import BadParameter
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.masks.thin_lens import CameraSetting
from procedures.restoration.metres import BEHIND, FRONT, MASKS_PX, Knowledge, ambiguity, distances_of, unexplained

from .conftest import scene

SETTING = CameraSetting(12.0, 2.8, 1200.0, 6.0)
EXACT = Knowledge(0.0, 0.0)


@pytest.mark.parametrize(("side", "metres"), [(FRONT, (0.5, 0.8, 1.1)), (BEHIND, (1.3, 2.0, 3.0))])
def test_distances_are_those_that_blur_so_much(side, metres):
    w = np.abs(SETTING.blur_radius_px(1000 * np.array([metres])))
    np.testing.assert_allclose(distances_of(w, np.full(w.shape, 0.01), SETTING, side).metres, [metres])


def test_the_uncertainty_is_that_of_drawn_blurs_and_drawn_cameras(rng):
    w = np.abs(SETTING.blur_radius_px(np.array([[700.0, 900.0]])))
    known = Knowledge(focus=0.01, scale=0.02)
    told = distances_of(w, np.full(w.shape, 0.04), SETTING, FRONT, known)
    drawn = []
    for _ in range(4000):
        noisy = w + np.hypot(0.04, MASKS_PX) * rng.standard_normal(w.shape)
        number, focus = 2.8 / (1 + 0.02 * rng.standard_normal()), 1200 * (1 + 0.01 * rng.standard_normal())
        drawn.append(CameraSetting(12.0, number, focus, 6.0).distance_mm(noisy) / 1000)
    # 4000 draws: 1.1 % by chance; the rest is what is not linear
    np.testing.assert_allclose(told.std[0], np.std(drawn, axis=0)[0], rtol=0.05)
    assert (told.common < told.std).all()


def test_what_may_be_any_distance_is_not_told():
    far = distances_of(np.array([[1.0, SETTING.scale_px_mm / 1200 - 0.01]]), np.full((1, 2), 0.1), SETTING, BEHIND)
    unsure = distances_of(np.array([[1.0, 1.0]]), np.array([[0.1, 0.6]]), SETTING, FRONT, EXACT)
    for one in (far, unsure):
        assert np.isfinite(one.metres).tolist() == [[True, False]]
        assert np.isnan(one.std[0, 1])
        assert one.told == 0.5


@pytest.mark.parametrize(("side", "focus_mm"), [("left", 1200.0), (BEHIND, np.inf)])
def test_a_side_that_there_is_not_is_refused(side, focus_mm):
    with pytest.raises(BadParameter):
        distances_of(np.ones((1, 1)), np.ones((1, 1)), CameraSetting(12.0, 2.8, focus_mm, 6.0), side)


def test_depth_is_ambiguous_where_there_is_no_texture():
    stacks = [mask_stack(pillbox(), 5.2, ratio=ratio, R=7) for ratio in (1.0, 1.25)]
    seen = scene(stacks, (64, 88), 40.0)
    noise = float(seen.z.std() * 0.01)
    w = seen.w[7:-7, 7:-7]
    flat = seen.z.copy()
    flat[..., 40:] = 0.5 + noise * np.random.default_rng(1).standard_normal(flat[..., 40:].shape)
    spread = ambiguity(list(flat), stacks, w, noise)
    assert np.median(spread[8:24, 8:28]) < 0.25
    assert np.median(spread[8:-8, 56:-8]) > 0.7
    # another depth than the photographs' is no nearer for being told
    assert np.median(ambiguity(list(seen.z), stacks, w + 1, noise)[8:24, 8:28]) > 0.8


def test_where_something_is_left_over_nothing_is_explained(rng):
    residual = 0.01 * rng.standard_normal((2, 1, 60, 80))
    residual[:, :, 20:40, 50:70] *= 3
    found = unexplained(residual, 0.01)
    assert found[24:36, 54:66].all()
    assert not found[:, :40].any()
    told = distances_of(np.ones((60, 80)), np.where(found, np.inf, 0.1), SETTING, FRONT)
    assert (np.isnan(told.metres) == found).all()
