import cv2
import numpy as np
import pytest

from procedures.numerics.warps import apply_homography
from procedures.pattern import CELLS, X_CORNERS
from procedures.pattern_psf.chart_finding import chart_frame

SQUARE = np.array([[0.0, 0.0], [1, 0], [1, 1], [0, 1]]) * CELLS


def test_frame_and_marks_have_the_symmetries_of_the_square_alone():
    scores = chart_frame.agreements(chart_frame.expected(), chart_frame.oriented_frames(), chart_frame.ring())
    assert scores[0] == pytest.approx(1, abs=1e-6)
    # the nearest is the transposed chart: its blocks are the same, its x-corners inverted
    assert max(scores[1:]) < 0.8
    for g, _ in chart_frame.symmetries():
        for points in (SQUARE, X_CORNERS):
            distances = np.linalg.norm(apply_homography(g, points)[:, None] - points, axis=2)
            assert distances.min(axis=1).max() < 1e-9


@pytest.mark.parametrize("n", range(8))
def test_symmetry_is_that_of_its_picture(n: int) -> None:
    g, seen = chart_frame.symmetries()[n]
    # the template transformed by g and rectified by its inverse is the template
    back = chart_frame.rectify(seen, np.linalg.inv(chart_frame.H_CELLS_RECTIFIED) @ np.linalg.inv(g))
    assert np.nanmax(np.abs(back - chart_frame.expected())) < 1e-3


def test_linear_light_does_not_matter_and_a_negative_is_no_agreement():
    y, x = np.mgrid[0 : chart_frame.SIDE, 0 : chart_frame.SIDE] / chart_frame.SIDE
    lit = (0.1 + 0.05 * x + (1 + 0.3 * x - 0.4 * y) * chart_frame.expected()).astype(np.float32)
    assert chart_frame.agreements(lit, chart_frame.oriented_frames()[:1], chart_frame.ring())[0] == pytest.approx(
        1, abs=1e-5
    )
    assert (
        chart_frame.agreements(1 - chart_frame.expected(), chart_frame.oriented_frames()[:1], chart_frame.ring())[0]
        == 0
    )


@pytest.mark.parametrize("shift", [(0.0, 0.0), (1.3, -0.6), (-3.4, 2.5)])
def test_marks_are_placed_to_a_tenth_of_a_rectified_pixel(shift: tuple[float, float]) -> None:
    A = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
    size = (chart_frame.SIDE, chart_frame.SIDE)
    moved = cv2.warpAffine(chart_frame.expected(), A, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    cells, likeness = chart_frame.locate_marks(moved)
    # parabolas through a correlation sampled in whole pixels
    assert np.abs((cells - X_CORNERS) * chart_frame.PIXELS_PER_CELL - shift).max() < 0.1
    # at most half a pixel from the nearest sample of the correlation
    assert likeness.min() > 0.94


def test_a_third_of_the_frame_must_be_seen_and_marks_outside_are_unlike():
    rectified = chart_frame.expected().copy()
    rectified[: 2 * chart_frame.PIXELS] = np.nan
    assert np.flatnonzero(chart_frame.locate_marks(rectified)[1] == 0).tolist() == [0, 1, 2, 3]
    rows, columns = np.nonzero(chart_frame.ring())
    for missing, score in ((0, pytest.approx(1, abs=1e-5)), (1, 0.0)):
        third = np.zeros_like(chart_frame.ring())
        third[rows[missing : len(rows) // 3], columns[missing : len(rows) // 3]] = True
        assert chart_frame.agreements(chart_frame.expected(), chart_frame.oriented_frames()[:1], third)[0] == score
