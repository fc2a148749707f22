import numpy as np
import pytest
from scipy.special import erf

from procedures.pattern import X_CORNERS, Chart
from simulators.camera.camera import ChartTruth, true_psf
from simulators.camera.optics import GaussianBlur, Optics, PixelAperture
from simulators.camera.pupil import Wavefront
from simulators.camera.render import IdealImage, Region, render_region
from simulators.world.projection import ObjectPose, Projection
from simulators.world.scene import Illumination, PlacedChart, Scene, Shape, Wall
from tests.simulators.clutter import cover
from tests.simulators.world.test_raster import area_and_centroid

GREY = {(0, 0): "Y"}
BAYER = {(0, 0): "R", (1, 0): "G", (0, 1): "G", (1, 1): "B"}
COMATIC = Optics.typical(f_number=5.6, pitch_um=3.76, wavefront=Wavefront(coma_x_um=0.05, astigmatism_um=0.02))
COMPACT = Optics((GaussianBlur(0.6), PixelAperture()), 4.0)
TILTED = PlacedChart(Chart.from_seed(), ObjectPose((0, 0, 1000.0), 15, 8, 21), 0.045)
ALIGNED = PlacedChart(Chart.from_seed(), ObjectPose((0.0, 0.0, 1000.0)), 0.05)
FULL = Region(0, 0, 200, 200)
VIEW = Projection(5000.0, (99.5, 99.5))


def frontal(pixels: float, **more) -> PlacedChart:
    return PlacedChart(Chart.from_seed(), ObjectPose((0.0, 0.0, 1000.0)), pixels / 256 / 5.0, **more)


def render(scene: Scene, optics: Optics = COMPACT, region: Region = FULL, colours=GREY, projection=VIEW, **more):
    return render_region(IdealImage.of(scene, projection), optics, region, colours, **{"oversampling": 8, **more})


def corners_by_hand(points_mm: np.ndarray, pose: ObjectPose) -> np.ndarray:
    """Pinhole projection, written out: roll after yaw after pitch."""
    p, y, r = np.radians([pose.pitch_deg, pose.yaw_deg, pose.roll_deg])
    found = []
    for u, v in points_mm:
        a = np.array([u, v * np.cos(p), v * np.sin(p)])
        b = np.array([a[0] * np.cos(y) + a[2] * np.sin(y), a[1], a[2] * np.cos(y) - a[0] * np.sin(y)])
        c = np.array([b[0] * np.cos(r) - b[1] * np.sin(r), b[0] * np.sin(r) + b[1] * np.cos(r), b[2]])
        x, y_, z = c + pose.centre_mm
        found.append([VIEW.centre[0] + 5000 * x / z, VIEW.centre[1] + 5000 * y_ / z])
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("colours", [GREY, BAYER], ids=["grey", "bayer"])
def test_a_constant_scene_gives_a_constant_picture(colours):
    light = render(Scene(wall=Wall(reflectance=0.4)), COMATIC, Region(0, 0, 60, 50), colours, oversampling=4)
    np.testing.assert_allclose(light, 0.4, rtol=1e-12)


@pytest.mark.slow
def test_blur_and_tilt_keep_light_and_places():
    # photosites without gaps count every ray once: the samples sum to the integral, whatever blurs between
    scene = Scene((frontal(80),), Wall(reflectance=0.0))
    sums = [render(scene, Optics((GaussianBlur(sigma), PixelAperture()), 4.0)).sum() for sigma in (0.6, 1.2)]
    # what the Gaussian of 0.6 px leaves at one cycle per pixel, exp(-7.1), the photosites cancel to rounding
    assert sums[0] == pytest.approx(sums[1], rel=1e-9)
    # with photosites without gaps the samples of a band-limited picture sum to its integral (Poisson): a sheet's area
    # and centroid are those of its projected corners. 0.001 px on every edge would be 0.45 px^2 and 0.001 px.
    pose = ObjectPose((1.0, -1.5, 1000.0), 20.0, -12.0, 33.0)
    sheet = PlacedChart(Chart.from_seed(), pose, 0.06, paper=1.0, ink=1.0, margin_cells=16)
    light = render(Scene((sheet,), Wall(reflectance=0.0)), region=Region(-20, -20, 240, 240))
    corners = corners_by_hand((sheet.sheet() - 128) * 0.06, pose)
    area, centroid = area_and_centroid(corners)
    y, x = np.mgrid[-20:220, -20:220]
    assert light.sum() == pytest.approx(area, abs=0.01)
    assert np.sum(light * x) / light.sum() == pytest.approx(centroid[0], abs=1e-4)
    assert np.sum(light * y) / light.sum() == pytest.approx(centroid[1], abs=1e-4)


def test_marks_and_a_small_square_are_where_the_truth_and_distortion_say():
    # about its centre a mark turns into itself by half a turn, and so does a symmetric blur of it: put on a pixel's
    # centre it leaves no difference. 0.001 px off, the difference would be 0.002 px x slope, 0.5 per px: 1e-3.
    placed = frontal(150, mirrored=True)
    corner = X_CORNERS[5][None]
    [where] = ChartTruth(VIEW.pinhole() @ placed.to_space(), VIEW, COMPACT).sensor_points(corner)
    shift = np.round(where) - where
    view = Projection(5000.0, (99.5 + shift[0], 99.5 + shift[1]))
    x, y = (int(v) for v in np.round(where))
    window = render(Scene((placed,)), projection=view)[y - 3 : y + 4, x - 3 : x + 4]
    assert np.ptp(window) > 0.5
    np.testing.assert_allclose(window, window[::-1, ::-1], atol=1e-4)
    view = Projection(5000.0, (99.5, 99.5), k1=-0.1, k2=0.02, radius_px=100.0)
    moved = view.distort(np.array([[99.5 + 50.0, 99.5], [99.5, 99.5 - 100.0]]))
    np.testing.assert_allclose(moved, [[99.5 + 50 * (1 - 0.025 + 0.00125), 99.5], [99.5, 99.5 - 92.0]])
    # the image of a white square is the PSF of the optics and one more square aperture, at whole pixels
    dot = Shape(((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)), 1.0)
    view = Projection(5000.0, (100.0, 100.0))
    light = render(Scene(wall=Wall(5000.0, 0.0, (dot,))), COMATIC, Region(60, 60, 81, 81), projection=view)
    psf = true_psf(COMATIC.also(PixelAperture()), 8, 8 * 24 + 1)
    found, truth = light[40 - 12 : 40 + 13, 40 - 12 : 40 + 13], psf.samples[::8, ::8] * 64
    # the peak is 0.26; what is left is the fine grid's aliasing of a lone aligned square, and the periodic tail
    np.testing.assert_allclose(found, truth, atol=2e-4)
    assert np.abs(truth - truth[:, ::-1]).max() > 0.01  # the tail lies on one side, and on the same


@pytest.mark.slow
def test_each_plane_of_a_mosaic_samples_at_its_own_pixels():
    scene = Scene((frontal(100),))
    mosaic = render(scene, COMATIC, colours=BAYER, oversampling=4)
    alone = render(scene, COMATIC, colours={(0, 0): "G"}, oversampling=4)
    np.testing.assert_allclose(mosaic[0::2, 1::2], alone[0::2, 1::2], atol=2e-5)
    np.testing.assert_allclose(mosaic[1::2, 0::2], alone[1::2, 0::2], atol=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("optics", [COMPACT, COMATIC], ids=["gaussian", "diffraction"])
@pytest.mark.parametrize("placed", [TILTED, ALIGNED], ids=["tilted", "aligned"])
def test_a_finer_grid_changes_the_picture_by_less_than_a_ten_thousandth(placed, optics):
    # measured at the worst pixel, of a contrast of 0.86: 5.2e-5 tilted, 1.3e-5 aligned with the grid
    scene = Scene((placed,))
    eight, sixteen = (render(scene, optics, Region(60, 60, 60, 60), oversampling=n) for n in (8, 16))
    assert np.abs(eight - sixteen).max() < 1e-4


def test_light_is_a_polynomial_and_a_wider_margin_changes_little():
    scene = Scene((TILTED,))
    near, wide = (render(scene, COMATIC, Region(30, 30, 140, 140), oversampling=4, margin_px=m) for m in (None, 80))
    assert np.abs(near - wide).max() < 1e-3
    light = Illumination(2.0, (0.1, -0.2), (0.03, 0.04, -0.05), (10.0, 20.0), 50.0)
    assert light.at(np.array(60.0), np.array(120.0)) == pytest.approx(2 * (1 + 0.1 - 0.4 + 0.03 + 0.08 - 0.2))
    assert light.at(np.array(10.0), np.array(20.0)) == 2


@pytest.mark.slow
def test_a_cover_hides_the_mark_and_a_nearer_sheet_the_farther():
    hidden = render(Scene((frontal(120, covers=cover(1, 0, reflectance=0.5)),)))
    x, y = (int(v) for v in 99.5 + (X_CORNERS[0] - 128) * 120 / 256)
    np.testing.assert_allclose(hidden[y - 3 : y + 3, x - 3 : x + 3], 0.5, atol=1e-6)
    near = PlacedChart(Chart.from_seed(), ObjectPose((0.0, 0.0, 500.0)), 0.01, paper=0.7, ink=0.7)
    both = render(Scene((near, frontal(120))))
    assert both[100, 100] == pytest.approx(0.7, abs=1e-9)


def test_the_scene_is_in_front_of_the_camera():
    with pytest.raises(ValueError, match="in front of the camera"):
        ObjectPose((0, 0, -1.0))


@pytest.mark.slow
def test_pixels_are_what_brute_force_makes_of_them():
    # every 1/200 pixel: back through the lens to a cell, weighted by Gaussian * photosite written as error functions
    view = Projection(5000.0, (99.5, 99.5), k1=-0.05, radius_px=140.0)
    light = render(Scene((TILTED,)), projection=view)
    H = np.linalg.inv(view.pinhole() @ TILTED.to_space())
    n, reach = 200, 4.5
    t = (np.arange(int(2 * reach * n)) + 0.5) / n - reach
    weight = erf((t + 0.5) / (0.6 * 2**0.5)) - erf((t - 0.5) / (0.6 * 2**0.5))
    weight /= weight.sum()
    for x, y in ((100, 100), (88, 108)):
        seen = np.stack(np.meshgrid(x + t, y + t), axis=-1) - 99.5
        ideal = seen
        for _ in range(6):
            ideal = seen / (1 - 0.05 * np.sum(ideal**2, axis=-1, keepdims=True) / 140.0**2)
        u, v, w = np.moveaxis((ideal + 99.5) @ H[:, :2].T + H[:, 2], -1, 0)
        white = TILTED.chart.cells[(v / w).astype(int), (u / w).astype(int)]
        expected = weight @ np.where(white, 0.9, 0.04) @ weight
        assert light[y, x] == pytest.approx(expected, abs=5e-5)


@pytest.mark.slow
def test_tiles_of_a_large_region_fit_together():
    # what differs is the light from beyond each tile's margin: 1 / 150 of it all, and there as here half of it black
    whole = render(Scene((TILTED,)), COMATIC, oversampling=4)
    for tile in FULL.tiles(110):
        part = whole[tile.y : tile.y + tile.height, tile.x : tile.x + tile.width]
        np.testing.assert_allclose(render(Scene((TILTED,)), COMATIC, tile, oversampling=4), part, atol=5e-4)
