import numpy as np
import pytest

from procedures.pattern import CELLS, X_CORNERS, Chart
from procedures.ray_histogram.film import Film
from simulators.rays.path_tracer import blur_diameter_px, cast
from simulators.rays.ray_scenes import SCENES, chart_texture, dead_leaves, text_texture
from simulators.world.scene import INK, PAPER


def test_charts_and_leaves_are_drawn_as_they_are(rng):
    chart = Chart.from_seed()
    texture = chart_texture(chart, texels_per_cell=2, margin_cells=5)
    noise = texture[2 * (5 + 32) : 2 * (5 + 32 + CELLS) : 2, 2 * (5 + 32) : 2 * (5 + 32 + CELLS) : 2]
    np.testing.assert_allclose(noise, np.where(chart.cells, PAPER, INK), atol=1e-9)
    np.testing.assert_allclose(texture[:10], PAPER, atol=1e-9)
    x, y = (2 * (X_CORNERS + 37)).astype(int).T  # two black and two white quarters meet there
    np.testing.assert_allclose(texture[y - 8, x], INK, atol=1e-9)
    np.testing.assert_allclose(texture[y, x + 8], PAPER, atol=1e-9)
    page = text_texture(("AB", "12"))
    assert page.min() == pytest.approx(INK)
    assert page[0, 0] == pytest.approx(PAPER)
    assert 0.01 < (page < 0.5).mean() < 0.3
    # between the smallest and the largest leaf, averages over 2 x 2 texels keep nearly all contrast: a white texture's
    # would halve
    picture = dead_leaves(rng, 256, smallest=4.0, largest=60.0).mean(-1)
    small = picture.reshape(128, 2, 128, 2).mean((1, 3))
    contrasts = [np.abs(np.diff(p, axis=1)).mean() for p in (picture, small)]
    assert contrasts[1] == pytest.approx(2 * contrasts[0], rel=0.15)  # as many edges per leaf, half the pixels between
    assert picture.min() > 0


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_can_be_photographed(name):
    scene, camera = SCENES[name](24, 32)
    film = Film.blank(24, 32)
    cast(scene, camera, 8, film.add, seed=1)
    film.checked()
    assert film.dropped.sum() == 0
    assert 0.1 < film.mean.mean() < 1.0


def test_scenes_have_a_depth_of_field_and_a_film_may_be_resumed():
    # at the paper's size of picture, 512 pixels wide, what is twice as far as the focus is a disc of many pixels
    cameras = [make(384, 512)[1] for make in SCENES.values()]
    assert sorted(blur_diameter_px(camera, 2 * camera.focus_mm) > 5 for camera in cameras) == [False, True, True]
    scene, camera = SCENES["steps-from-a-slider"](16, 24)
    whole, parts = Film.blank(16, 24), Film.blank(16, 24)
    cast(scene, camera, 9, whole.add, seed=3)
    for wanted in (4, 9):
        cast(scene, camera, wanted, parts.add, seed=3, taken=parts.count.astype(int) + parts.dropped)
    for name, array in vars(whole).items():
        np.testing.assert_array_equal(array, getattr(parts, name))
