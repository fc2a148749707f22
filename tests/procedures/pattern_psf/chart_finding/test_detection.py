from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from procedures.outcome import BadInput, Refused
from procedures.pattern import X_CORNERS, Chart
from procedures.pattern_psf.chart_finding.detection import find_chart, find_charts
from simulators.camera.camera import Lens, SimulatedCamera
from simulators.camera.sensor import Sensor
from simulators.world.scene import PlacedChart, Scene, Wall
from tests.simulators.clutter import cover
from tests.simulators.random_scenes import Trials, random_camera, random_scene

CHART = Chart.from_seed()
Place = Callable[..., PlacedChart]
RANDOM = Trials(rows=300, columns=400, pixels=(60.0, 150.0))


def camera_of(rows: int, columns: int) -> SimulatedCamera:
    """A grey camera of whole-frame distortion 2 %."""
    return SimulatedCamera(Lens(k1=0.02), Sensor(rows, columns, None), 7.52, oversampling=5)


def photographed(
    camera: SimulatedCamera, charts: tuple[PlacedChart, ...], wall: Wall | None = None
) -> tuple[np.ndarray, list[np.ndarray]]:
    """The plane, and where the x-corners of each chart really are in it."""
    shot = camera.photograph(Scene(charts, wall or Wall()), np.random.default_rng(5))
    return shot.plane("Y").astype(np.float32), [shot.true_points("Y", X_CORNERS, n) for n in range(len(charts))]


@cache
def plain() -> tuple[np.ndarray, np.ndarray]:
    """One chart, 80 pixels wide, turned by 20 degrees and tilted by 15."""
    camera = camera_of(180, 200)
    image, (truth,) = photographed(camera, (camera.place(CHART, pixels=80, yaw_deg=15, roll_deg=20),))
    return image, truth


def turned(points: np.ndarray, shape: tuple[int, ...], quarters: int, mirror: bool) -> np.ndarray:
    """Points of a picture rotated counterclockwise, as by numpy.rot90, then mirrored."""
    rows, columns = shape
    for _ in range(quarters):
        points, (rows, columns) = np.column_stack([points[:, 1], columns - 1 - points[:, 0]]), (columns, rows)
    return np.column_stack([columns - 1 - points[:, 0], points[:, 1]]) if mirror else points


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.nightly) for seed in (3, 4, 5))])
def test_random_photographs_show_their_chart(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = random_camera(rng, RANDOM)
    shot = camera.photograph(random_scene(rng, camera, CHART, RANDOM), rng)
    found = find_chart(shot.plane("Y").astype(np.float32))
    # each corner is placed on its own; noise to 5 % and blocks of 7.5 pixels: a third of a pixel
    assert np.linalg.norm(found.corners - shot.true_points("Y", X_CORNERS), axis=1).max() < 0.33
    assert found.score > 0.9
    assert not found.mirrored


@pytest.mark.parametrize("seed", range(4))
def test_clutter_is_no_chart(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    camera = random_camera(rng, RANDOM)
    shot = camera.photograph(random_scene(rng, camera, None, RANDOM), rng)
    assert find_charts(shot.plane("Y")) == []


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("quarters", range(4))
def test_turns_and_mirror_images_are_told_apart(quarters: int, mirror: bool) -> None:
    image, truth = plain()
    seen = np.rot90(image, quarters)
    (found,) = find_charts(seen[:, ::-1] if mirror else seen)
    assert found.mirrored == mirror
    # the quarter turns keep the pixels: no more error than in the photograph itself
    assert np.abs(found.corners - turned(truth, image.shape, quarters, mirror)).max() < 0.2


def test_homography_maps_cells_to_the_corners() -> None:
    found = find_chart(plain()[0])
    q = np.column_stack([X_CORNERS, np.ones(12)]) @ found.H_sensor_pattern.T
    # what the distortion of 2 % leaves, and the corners' own errors
    assert np.abs(q[:, :2] / q[:, 2:] - found.corners).max() < 0.3


@pytest.mark.parametrize("scale", [0.02, 40.0])
def test_exposure_does_not_matter(scale: float) -> None:
    image, _ = plain()
    assert np.abs(find_chart(image * np.float32(scale)).corners - find_chart(image).corners).max() < 1e-3


def test_hidden_marks_dark_surroundings_and_a_large_frame_do_not_matter():
    camera = camera_of(180, 200)
    placed = replace(camera.place(CHART, pixels=90, roll_deg=200), covers=cover(2, first=4))
    image, (truth,) = photographed(camera, (placed,))
    found = find_chart(image)
    assert np.flatnonzero(~found.visible).tolist() == [4, 5]
    assert np.isnan(found.corners[4:6]).all()
    assert np.abs(found.corners - truth)[found.visible].max() < 0.2
    placed = replace(camera.place(CHART, pixels=90, roll_deg=-30), margin_cells=0.0)
    image, (truth,) = photographed(camera, (placed,), Wall(reflectance=0.02))
    assert np.abs(find_chart(image).corners - truth).max() < 0.2
    image, truth = plain()
    whole = np.full((2100, 3100), image[0, 0], dtype=np.float32)
    whole[1700:1880, 2600:2800] = image
    assert np.abs(find_chart(whole).corners - truth - [2600, 1700]).max() < 0.2


def refusal(image: np.ndarray) -> str:
    """Reason and remedy of the refusal of a photograph."""
    with pytest.raises(Refused) as refused:
        find_chart(image)
    return str(refused.value)


def test_hidden_cut_and_mirrored_charts_are_refused():
    camera = camera_of(180, 200)
    placed = replace(camera.place(CHART, pixels=90), covers=cover(3, first=1))
    assert "marks may be hidden; 3 are" in refusal(photographed(camera, (placed,))[0])
    image, truth = plain()
    second_from_right = np.sort(truth[:, 0])[-2]
    assert "cut off by the frame: 2 of its 12 marks" in refusal(image[:, : int(second_from_right) - 2])
    assert "mirrored; flip" in refusal(plain()[0][::-1])
    # the frame as in a mirror has white where it had black, but for its rim
    assert "is a negative" in refusal(1 - plain()[0])


@pytest.mark.slow
def test_several_charts_are_refused_with_their_places() -> None:
    camera = camera_of(180, 360)
    charts = tuple(camera.place(CHART, pixels=80, at=(x, 0.5), roll_deg=10 + 500 * x) for x in (0.25, 0.75))
    image, truths = photographed(camera, charts)
    found = find_charts(image)
    assert sorted(round(s.centre()[0], -1) for s in found) == [90, 270]
    assert len(truths) == len(found)
    assert "got 2, centred at" in refusal(image)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pixels", "says"), [(36, "its noise region 45 to 300 pixels wide"), (330, "move back 1.1x or more")]
)
def test_wrong_distances_are_refused(pixels: float, says: str) -> None:
    camera = camera_of(*(int(1.6 * pixels),) * 2)
    assert says in refusal(photographed(camera, (camera.place(CHART, pixels=pixels),))[0])


def checkers(side: float) -> np.ndarray:
    y, x = np.mgrid[0:300, 0:320] / side
    return ((np.floor(0.9 * x + 0.3 * y) + np.floor(0.9 * y - 0.3 * x)) % 2).astype(np.float32)


def bow_ties(step: int) -> np.ndarray:
    """The chart's own marks, at its own spacing, over the whole frame."""
    y, x = np.mgrid[0:300, 0:320] % step - step // 2
    dark = (np.abs(y) > np.abs(x)) & (np.maximum(np.abs(x), np.abs(y)) <= step // 6)
    return np.asarray(1.0 - 0.9 * dark, dtype=np.float32)


@pytest.mark.parametrize("step", [4.0, 9.0, 25.0])
def test_checkerboards_are_no_charts(step: float) -> None:
    assert find_charts(cv2.GaussianBlur(checkers(step), (0, 0), 0.8)) == []


@pytest.mark.parametrize("step", [24, 40])
def test_lattice_of_marks_is_no_chart(step: int) -> None:
    assert find_charts(cv2.GaussianBlur(bow_ties(step), (0, 0), 0.8)) == []


def test_noise_is_no_chart(rng: np.random.Generator) -> None:
    assert find_charts(rng.random((400, 500), dtype=np.float32)) == []
    assert find_charts(rng.integers(0, 2, (400, 500)).astype(np.float32)) == []


@pytest.mark.parametrize("shape", [(0, 0), (1, 700), (40, 40), (300, 300)])
def test_empty_pictures_show_no_chart(shape: tuple[int, int]) -> None:
    assert "no chart in the photograph" in refusal(np.full(shape, 0.3, dtype=np.float32))


def test_colour_picture_is_bad_input() -> None:
    with pytest.raises(BadInput, match="one grey plane"):
        find_charts(np.zeros((60, 60, 3), dtype=np.float32))


@pytest.mark.parametrize(
    "name", ["pattern_photo/img_example", "synthetic/pattern/tilted_gauss", "synthetic/pattern/airy_f8"]
)
def test_published_photographs_show_their_chart(name: str, shared_data) -> None:
    image = cv2.imread(str(shared_data / f"{name}.pgm"), cv2.IMREAD_UNCHANGED)
    found = find_chart(image.astype(np.float32))
    assert found.visible.all()
    assert found.score > 0.95
    assert np.linalg.det(found.H_sensor_pattern) > 0
