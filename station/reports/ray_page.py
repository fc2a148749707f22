"""The page of filtered renders: as rendered, filtered, and converged if known, side by side and close up."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from station.drawing.pictures import display_png
from station.drawing.plots import Figure
from station.reports.page import Figures, Section, image, page

Linear = npt.NDArray[np.floating]

CLOSE_UP_PX = 48


@dataclass(frozen=True, eq=False)
class RenderRow:
    """One render on the page.

    title : heading
    pictures : (rows, columns, 3), linear pictures of one size
    similar : (rows, columns), similar patches found per pixel
    facts : sentences below
    """

    title: str
    pictures: tuple[tuple[str, Linear], ...]
    similar: Linear
    facts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class StripRow:
    """Pictures on the page, whole: strips of (caption, linear picture, (rows, columns) or with colours), sentences."""

    title: str
    strips: tuple[tuple[tuple[str, Linear], ...], ...]
    facts: tuple[str, ...] = ()


def ray_page(title: str, rows: tuple[RenderRow | StripRow, ...]) -> bytes:
    """The page, UTF-8, with embedded pictures."""
    sections = [Section(row.title, [*map(_strip, _strips(row)), *row.facts, *_similar(row)]) for row in rows]
    return page(title, [Section(title, [], verdict="pass", kicker="ray histogram fusion"), *sections]).encode()


def _strip(pictures: Sequence[tuple[str, Linear]]) -> Figures:
    return Figures([Figure(image(display_png(one), caption, enlarged=True), caption) for caption, one in pictures])


def _strips(row: RenderRow | StripRow) -> Iterator[Sequence[tuple[str, Linear]]]:
    """The strips of a row; of a render the whole picture, then the same pictures close up."""
    if isinstance(row, StripRow):
        yield from row.strips
        return
    yield row.pictures
    for words, top, left in close_ups(row.pictures[0][1], row.pictures[1][1], row.similar):
        window = np.s_[top : top + CLOSE_UP_PX, left : left + CLOSE_UP_PX]
        yield [(f"{caption}, {words}", picture[window]) for caption, picture in row.pictures]


def _similar(row: RenderRow | StripRow) -> list[Figures]:
    if isinstance(row, StripRow):
        return []
    caption = "Similar patches found for each pixel; where it is dark, more samples are needed."
    shown = row.similar / max(float(row.similar.max()), 1.0)
    return [Figures([Figure(image(display_png(shown), "similar patches per pixel", enlarged=True), caption)])]


def close_ups(noisy: Linear, filtered: Linear, similar: Linear) -> list[tuple[str, int, int]]:
    """Caption, first row and first column of each detail."""
    change = np.abs(np.clip(noisy, 0, 1) - np.clip(filtered, 0, 1)).mean(-1)
    return [
        ("where most was removed", *_peak(change)),
        ("where fewest were similar", *_peak(-similar.astype(np.float64))),
    ]


def _peak(values: npt.NDArray[np.floating]) -> tuple[int, int]:
    """First row and column of the window with the greatest mean."""
    side = [min(CLOSE_UP_PX, n) for n in values.shape]
    sums = np.pad(values, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    windows = sums[side[0] :, side[1] :] - sums[: -side[0], side[1] :] - sums[side[0] :, : -side[1]]
    row, column = np.unravel_index(np.argmax(windows + sums[: -side[0], : -side[1]]), windows.shape)
    return int(row), int(column)
