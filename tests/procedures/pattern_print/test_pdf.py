"""The PDF as a printer sees it: rendered by pdftoppm at 600 dpi and measured."""

import shutil
import subprocess
from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from procedures.pattern import CELLS, X_CORNERS, Chart
from procedures.pattern_print.formats import pdf
from procedures.pattern_print.sheet import Sheet, Size, lay_out
from procedures.pattern_print.source import Source

Image = npt.NDArray[np.uint8]
Render = Callable[[Sheet, int], Image]
DPI = 600
MM = DPI / 25.4
WIDTHS_MM = (145.0, 300.0)


@pytest.fixture(scope="module")
def render(tmp_path_factory: pytest.TempPathFactory) -> Render:
    program = shutil.which("pdftoppm")
    if program is None:
        pytest.skip("no pdftoppm here (poppler-utils): the PDF cannot be rendered")
    folder = tmp_path_factory.mktemp("pdf")

    def page(sheet: Sheet, dpi: int) -> Image:
        (folder / "page.pdf").write_bytes(pdf(sheet))
        command = [program, "-r", f"{dpi}", "-gray", "-singlefile", "page.pdf", "page"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        image = cv2.imread(str(folder / "page.pgm"), cv2.IMREAD_UNCHANGED)
        (folder / "page.pgm").unlink()
        assert image is not None
        return image

    return page


@pytest.fixture(scope="module")
def printed(render: Render, source: Source) -> Callable[[float], tuple[Sheet, Image]]:
    @cache
    def at_width(width_mm: float) -> tuple[Sheet, Image]:
        sheet = lay_out(source, Size(width_mm))
        return sheet, render(sheet, DPI)

    return at_width


@pytest.fixture(params=WIDTHS_MM, ids="{:g}mm".format)
def page(request: pytest.FixtureRequest, printed: Callable[[float], tuple[Sheet, Image]]) -> tuple[Sheet, Image]:
    return printed(request.param)


def test_cells_corners_and_margin_are_on_the_page_where_the_geometry_says(page, source):
    sheet, image = page
    # pdftoppm rounds up to whole pixels
    assert image.shape == pytest.approx((sheet.height_mm * MM, sheet.width_mm * MM), abs=1)
    x, y = sheet.noise_corner_mm
    centres = (np.arange(CELLS) + 0.5) * sheet.size.cell_mm
    rows, columns = ((y + centres) * MM).astype(int), ((x + centres) * MM).astype(int)
    np.testing.assert_array_equal(image[np.ix_(rows, columns)] > 127, source.chart.cells == 1)
    # pixel i covers i to i + 1: its centre, which cv2 calls i, is at i + 1/2
    places = (np.array(sheet.noise_corner_mm) + X_CORNERS * sheet.size.cell_mm) * MM - 0.5
    started = (places + 0.2 * MM).astype(np.float32)  # well off, so that the answer is the image's
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-3)
    found = cv2.cornerSubPix(image, started.reshape(-1, 1, 2), (20, 20), (-1, -1), criteria).reshape(-1, 2)
    assert np.abs(found - places).max() / MM < 0.05
    (x, y), whole, quiet = sheet.corner_mm, sheet.size.whole_mm, sheet.size.quiet_mm
    assert y >= quiet
    assert x >= quiet
    outer = _crop(image, x - quiet, y - quiet, whole + 2 * quiet).copy()
    _crop(outer, quiet - 0.1, quiet - 0.1, whole + 0.2)[:] = 255
    assert outer.min() == 255


def _crop(image: Image, x_mm: float, y_mm: float, width_mm: float) -> Image:
    left, top = round(max(0.0, x_mm) * MM), round(max(0.0, y_mm) * MM)
    width = round(width_mm * MM)
    return image[top : top + width, left : left + width]


@pytest.mark.parametrize("direction", ["across", "along"])
def test_ruler_is_100_mm_long(page: tuple[Sheet, Image], direction: str) -> None:
    sheet, image = page
    (x0, y0), (x1, y1) = _ruler_line(sheet, direction)
    if direction == "across":
        profile = image[round((y0 + 1) * MM), round((x0 - 1) * MM) : round((x1 + 1) * MM)]
    else:
        profile = image[round((y1 - 1) * MM) : round((y0 + 1) * MM), round((x0 - 1) * MM)]
    ticks = _centres(255.0 - profile) / MM
    assert len(ticks) == 101
    assert ticks[-1] - ticks[0] == pytest.approx(100, abs=0.1)
    # to the pixel, which is 0.042 mm
    np.testing.assert_allclose(ticks - ticks[0], np.arange(101), atol=0.05)


def _ruler_line(sheet: Sheet, direction: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ends of the ruler's line, near which its ticks are searched."""
    for stroke in sheet.caption.strokes:
        (x0, y0), (x1, y1) = stroke.start, stroke.end
        lengths = {"across": (x1 - x0, y1 - y0), "along": (y0 - y1, x1 - x0)}[direction]
        if lengths == pytest.approx((100, 0)):
            return stroke.start, stroke.end
    raise AssertionError(f"no ruler {direction} the sheet")


def _centres(ink: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Centres of gravity of the separate marks along a profile, in pixels."""
    inside = np.concatenate([[False], ink > 25, [False]])
    starts, ends = np.flatnonzero(np.diff(inside.astype(int)) == 1), np.flatnonzero(np.diff(inside.astype(int)) == -1)
    return np.array([np.average(np.arange(a, b), weights=ink[a:b]) for a, b in zip(starts, ends, strict=True)])


@pytest.mark.parametrize("dpi", [61, 97])
def test_black_beside_black_shows_no_seam(render: Render, dpi: int) -> None:
    # odd resolutions put nearly every cell's edge inside a pixel, where smoothing would leave grey
    sheet = lay_out(Source(Chart(np.zeros((CELLS, CELLS), np.uint8)), "no cells"), Size(300))
    image = render(sheet, dpi)
    per_mm = dpi / 25.4
    x, y = (value * per_mm for value in sheet.noise_corner_mm)
    block, noise = 30 * per_mm, 240 * per_mm
    assert image[round(y) + 1 : round(y + noise) - 1, round(x) + 1 : round(x + noise) - 1].max() == 0
    # on into the black block above, the third from the left
    assert image[round(y - block) + 1 : round(y) + 5, round(x + block) + 1 : round(x + 2 * block) - 1].max() == 0


def test_equal_charts_are_equal_files(plain: Source) -> None:
    assert pdf(lay_out(plain, Size(300))) == pdf(lay_out(plain, Size(300)))


@pytest.mark.slow
def test_file_stays_small(source: Source) -> None:
    assert len(pdf(lay_out(source, Size(300)))) < 2e6
