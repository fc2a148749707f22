import numpy as np
import pytest

from procedures import Chart, Plane, Refused
from procedures.geometry.chart_bins.photographs import locate_chart, view_of
from procedures.geometry.chart_bins.turned_view import TurnedView
from tests.benchmarks.fisheye_views import photograph, polynomial, poses, true_points

LENS = polynomial((750, 500), 304.0, (377.0, 248.0), (-0.012, 0.004, -0.0015, 0.0002))
"""170 degrees from corner to corner."""


@pytest.fixture(scope="module")
def corner():
    """A chart near a corner, tilted by 26 degrees from the line of sight, and its pose."""
    pose = poses(LENS, 5, 190.0, 26.0)[4]
    return photograph(LENS, pose, Chart.from_seed(), 0.004, 1), pose


@pytest.mark.nightly
def test_a_chart_near_the_corner_of_a_fisheye_is_measured(corner):
    picture, pose = corner
    view = view_of(Plane("Y", picture, 1 / 65535), Chart.from_seed(), "corner").value
    assert view is not None
    assert len(view) > 500
    error = view.points - true_points(LENS, pose)[view.index]
    # a bin is 8 x 8 pixels of cells smaller than a pixel; bending that is not followed would be whole pixels
    assert np.sqrt(np.mean(error**2)) < 0.05


@pytest.mark.nightly
def test_the_turned_camera_shows_all_marks(corner):
    location = locate_chart(corner[0])
    assert location.turned is not None
    assert location.sighting.visible.all()


def test_the_turned_camera_looks_at_its_place_and_refuses_a_picture_without_a_chart():
    with pytest.raises(Refused, match="no chart in the photograph"):
        locate_chart(np.full((240, 320), 0.4, np.float32))
    view = TurnedView(np.array([400.0, 300.0]), 250.0, np.zeros(2), 1.0, 50).towards(
        np.array([600.0, 420.0]), 90.0, 200.0
    )
    middle = np.full((1, 2), float(view.half_px))
    np.testing.assert_allclose(view.to_plane(middle), [[600.0, 420.0]], atol=1e-9)
