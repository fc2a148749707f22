"""Sheets as the camera sees them: contrast, place and overlap as optics and geometry have them."""

import numpy as np
import pytest

from simulators.camera.optics import Optics, Path
from simulators.camera.sheets import FlatSheet, PlacedSheet, draw, draw_moving, leaves
from simulators.world.projection import ObjectPose, Projection

SHAPE = (48, 80)
GREY = {(0, 0): "Y"}
PROJECTION = Projection(4000.0, ((SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2))
OPTICS = Optics.typical(pitch_um=6.0)


def at(distance_mm: float, sheet: FlatSheet, optics: Optics = OPTICS) -> PlacedSheet:
    return PlacedSheet(sheet, ObjectPose((0.0, 0.0, distance_mm)), optics)


@pytest.mark.parametrize("period", [3.0, 5.0, 9.0])
def test_a_grating_keeps_the_contrast_that_the_optics_leave_it(period):
    # a texel of 0.25 mm at 4 m is a quarter of a pixel
    texels = np.arange(640) - 639 / 2
    wave = np.cos(2 * np.pi * texels / (4 * period)).astype(np.float32)
    sheet = FlatSheet(np.tile(0.5 + 0.3 * wave, (400, 1)), 0.25)
    seen = draw([at(4000.0, sheet)], PROJECTION, SHAPE, GREY)
    phase = 2 * np.pi * (np.arange(SHAPE[1]) - (SHAPE[1] - 1) / 2) / period
    waves = np.column_stack([np.ones_like(phase), np.cos(phase), np.sin(phase)])
    mean, even, odd = np.linalg.lstsq(waves, seen[SHAPE[0] // 2], rcond=None)[0]
    # cubic convolution of twelve texels a period and more is 2 % off at most
    expected = 0.3 * float(OPTICS.otf(np.array(1 / period), np.array(0.0)))
    assert (mean, even, odd) == pytest.approx((0.5, expected, 0.0), abs=0.02 * expected + 1e-4)


def test_sheets_hide_each_other_and_move_through_their_own_optics(rng):
    behind = FlatSheet(np.full((400, 640), 0.2, np.float32), 0.5)
    cover = np.zeros((400, 640), np.float32)
    cover[:, :320] = 1.0
    front = FlatSheet(np.full((400, 640), 0.8, np.float32), 0.25, cover=cover)
    row = draw([at(8000.0, behind), at(4000.0, front)], PROJECTION, SHAPE, GREY)[SHAPE[0] // 2]
    np.testing.assert_allclose(row[:20], 0.8, atol=0.01)
    np.testing.assert_allclose(row[-20:], 0.2, atol=0.01)
    # the middle of the frame is where the front sheet ends: as much light as if it were cut there, sharp
    assert row.mean() == pytest.approx(0.5, abs=2e-3)
    picture = leaves((400, 640), rng, largest=80.0)
    still = draw([at(4000.0, FlatSheet(picture, 0.25))], PROJECTION, SHAPE, GREY)
    moved = OPTICS.also(Path(((-3.0, 0.0), (3.0, 0.0))))
    twice = draw([at(4000.0, FlatSheet(picture, 0.25), moved)], PROJECTION, SHAPE, GREY)
    np.testing.assert_allclose(twice[:, 3:-3], (still[:, 6:] + still[:, :-6]) / 2, atol=2e-5)
    sheet = FlatSheet(leaves((400, 640), rng, largest=80.0), 0.25)
    tile = {(0, 0): "R", (1, 0): "G", (0, 1): "G", (1, 1): "B"}
    mosaic = draw([at(4000.0, sheet)], PROJECTION, SHAPE, tile)
    for (x, y), colour in tile.items():
        alone = draw([at(4000.0, sheet)], PROJECTION, SHAPE, {(0, 0): colour})
        np.testing.assert_array_equal(mosaic[y::2, x::2], alone[y::2, x::2])
    picture = leaves((512, 512), rng, largest=200.0)
    coarse = picture.reshape(128, 4, 128, 4).mean(axis=(1, 3))
    fine, far = (np.mean(np.abs(np.diff(one, axis=1))) for one in (picture, coarse))
    # dead leaves are scale invariant but for the finest, which the picture's own smoothing takes
    assert 0.3 < fine / far < 1.0


def test_a_sheet_that_moves_is_blurred_by_its_path():
    rng = np.random.default_rng(2)
    cover = np.zeros((400, 640), np.float32)
    cover[:, :320] = 1.0
    back, front = (
        at(4000.0, FlatSheet(leaves((400, 640), rng, largest=30.0), 0.5)),
        at(3500.0, FlatSheet(leaves((400, 640), rng, largest=30.0), 0.5, cover=cover)),
    )
    moving = draw_moving([back, front], [[back.pose, front.pose]] * 2, PROJECTION, SHAPE, GREY)
    # cubic reading at whole samples gives them back
    np.testing.assert_allclose(moving, draw([back, front], PROJECTION, SHAPE, GREY), atol=1e-4)
    rng = np.random.default_rng(3)
    sheet = FlatSheet(leaves((400, 640), rng, largest=30.0), 0.5)
    t = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    way = [ObjectPose((2.0 * np.cos(a), 1.0 * np.sin(a), 4000.0)) for a in t]
    moving = draw_moving([at(4000.0, sheet)], [[pose] for pose in way], PROJECTION, SHAPE, GREY)
    # the sheet's image moves by principal / distance = 1 pixel per mm
    path = Path(tuple((2.0 * float(np.cos(a)), float(np.sin(a))) for a in t))
    blurred = draw([at(4000.0, sheet, OPTICS.also(path))], PROJECTION, SHAPE, GREY)
    np.testing.assert_allclose(moving, blurred, atol=2e-3)
