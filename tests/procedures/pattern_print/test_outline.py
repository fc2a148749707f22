import numpy as np
import pytest

from procedures.pattern import BLACK_BLOCKS, BLOCK, X_CORNER_BLOCKS
from procedures.pattern_print.formats import bitmap
from procedures.pattern_print.sheet import outline

from .filling import winding

pytestmark = pytest.mark.slow


def test_outlines_have_the_area_of_the_black_parts_without_seams_by_either_rule(source):
    area = 0.0
    for loop in outline(source.chart):
        x, y = np.array(loop).T
        area += (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    black_cells = np.count_nonzero(source.chart.cells == 0)
    # a block has 32^2 cells, the two triangles of an x-corner half of that; sums of whole numbers are exact
    assert area == black_cells + len(BLACK_BLOCKS) * BLOCK**2 + len(X_CORNER_BLOCKS) * BLOCK**2 / 2
    seen = set()
    for loop in outline(source.chart):
        for (x0, y0), (x1, y1) in zip(loop, [*loop[1:], loop[0]], strict=True):
            steps = max(abs(x1 - x0), abs(y1 - y0))
            dx, dy = (x1 - x0) // steps, (y1 - y0) // steps
            for i in range(steps):
                here = (x0 + i * dx, y0 + i * dy)
                edge = frozenset([here, (here[0] + dx, here[1] + dy)])
                assert edge not in seen
                seen.add(edge)
    per_cell = 2
    image = bitmap(source.chart, per_cell)
    inside = winding(outline(source.chart), -64 + 0.5 / per_cell, 1 / per_cell, len(image))
    # pixels whose centre lies on a triangle's side belong to neither
    y, x = np.indices(image.shape) % (per_cell * BLOCK) - (per_cell * BLOCK - 1) / 2
    decided = np.abs(x) != np.abs(y)
    assert set(np.unique(inside)) == {0, 1}
    np.testing.assert_array_equal(inside[decided] == 0, image[decided] == 255)
