"""Caption below the chart: its origin, instructions for printing and photographing, and a table of distances."""

from __future__ import annotations

from collections.abc import Iterable

from procedures.pattern import AIM_S_OVER_T, GOOD_S_OVER_T
from procedures.pattern_print import distance
from procedures.pattern_print.distance import rulers
from procedures.pattern_print.panel import Drawing, Panel, PrintedLine, Text, wrapped

# size of the panel on A4; it is enlarged on larger sheets
PANEL_WIDTH_MM = 186.0
PANEL_HEIGHT_MM = 118.0
TYPE, SMALL, HEADING, TITLE_TYPE = 2.9, 2.5, 3.3, 5.4
LEADING = 3.8
TOP = 24.5
LEFT, LEFT_END = 15.0, 88.0
RIGHT, RIGHT_END = 97.0, PANEL_WIDTH_MM
COLUMN = 13.5

TITLE = "Noise chart for subpixel point spread functions"
PRINTING = (
    "Print at 100 %: no scaling, no fitting to the page. Both rulers must measure 100 mm.",
    "No smoothing, no image enhancement, no toner saving; finest resolution, black ink only.",
    "Matt paper: gloss reflects the lamps.",
    "Mount it flat, glued to glass or to an aluminium plate, without waves.",
    "Keep the white border, one block wide, free on all sides.",
)
PHOTOGRAPHING = (
    "RAW at the lowest ISO, on a tripod, in even light.",
    "Expose so that white stays below saturation in every plane.",
    "Keep the whole chart with its white border in the frame.",
)


def caption(panel: Panel, titles: Iterable[str], noise_mm: float) -> Drawing:
    """Caption below the chart; `titles` are two lines that identify the chart."""
    ruler_x, ruler_y = panel.at(9, PANEL_HEIGHT_MM)
    y, printing = numbered(panel, TOP, "Printing", PRINTING, LEFT, LEFT_END)
    _, photographing = numbered(panel, y + 3, "Photographing", PHOTOGRAPHING, LEFT, LEFT_END)
    return (
        _head(panel, titles)
        + printing
        + photographing
        + _distances(panel, noise_mm)
        + _explanation(panel, noise_mm)
        + rulers(ruler_x, ruler_y - 6.2)
    )


def _head(panel: Panel, titles: Iterable[str]) -> Drawing:
    texts = [panel.text(LEFT, 5, TITLE, TITLE_TYPE, bold=True)]
    texts += [panel.text(LEFT, 10.6 + 4.2 * row, words, TYPE, bold=row == 0) for row, words in enumerate(titles)]
    return Drawing((panel.rule(17.2, LEFT, PANEL_WIDTH_MM, 0.2),), tuple(texts))


def numbered(
    panel: Panel, y: float, heading: str, items: Iterable[str], left: float, right: float
) -> tuple[float, Drawing]:
    """End position of a numbered list between two x positions of the panel, and the list."""
    texts = [panel.text(left, y, heading, HEADING, bold=True)]
    y += 5.4
    for number, item in enumerate(items, start=1):
        texts.append(panel.text(left, y, f"{number}", TYPE, bold=True))
        lines = _paragraph(panel, left + 4.5, y, item, right - left - 4.5)
        texts += lines
        y += LEADING * len(lines) + 0.9
    return y, Drawing(texts=tuple(texts))


def _paragraph(panel: Panel, x: float, y: float, words: str, width: float) -> list[Text]:
    lines = wrapped(words, width, TYPE)
    return [panel.text(x, y + LEADING * row, line, TYPE) for row, line in enumerate(lines)]


def _columns() -> list[float]:
    """Right edges of the table's columns of numbers."""
    count = len(distance.SENSORS)
    return [RIGHT_END - COLUMN * (count - 1 - i) for i in range(count)]


def _distances(panel: Panel, noise_mm: float) -> Drawing:
    texts = [panel.text(RIGHT, TOP, "Distance from lens to chart, in metres, for s/t = 1", HEADING, bold=True)]
    texts += [panel.text(RIGHT, TOP + y, words, SMALL) for y, words in ((5.4, "Sensor"), (12, "Photosites"))]
    for x, sensor in zip(_columns(), distance.SENSORS, strict=True):
        cells = ((5.4, sensor.format), (8.6, f"{sensor.megapixels} MP"), (12, f"{sensor.pitch_um} µm"))
        texts += [panel.text(x, TOP + y, words, SMALL, anchor="end") for y, words in cells]
    y = TOP + 13.4
    strokes: list[PrintedLine] = [panel.rule(y, RIGHT, RIGHT_END, 0.1)]
    for focal, row in zip(distance.FOCAL_LENGTHS_MM, distance.table_m(noise_mm), strict=True):
        y += 4.1
        texts.append(panel.text(RIGHT, y, f"{focal} mm lens", TYPE))
        texts += [panel.text(x, y, _metres(d), TYPE, anchor="end") for x, d in zip(_columns(), row, strict=True)]
    strokes.append(panel.rule(y + 1.6, RIGHT, RIGHT_END, 0.1))
    return Drawing(tuple(strokes), tuple(texts))


def _metres(distance_m: float) -> str:
    return f"{distance_m:.1f}" if distance_m >= 1 else f"{distance_m:.2f}"


def _explanation(panel: Panel, noise_mm: float) -> Drawing:
    low, high = GOOD_S_OVER_T
    paragraphs = (
        f"At these distances the noise, {noise_mm:.6g} mm wide, covers {distance.IDEAL_PIXELS:g} pixels of a plane, "
        f"for s={distance.SAMPLES_PER_PIXEL} samples of the PSF per pixel. A plane of a Bayer RAW has a pixel for "
        "every second photosite; with a monochrome sensor double the distance.",
        f"s/t = s × pixels / 256: {AIM_S_OVER_T:g} is best, {low:g} to {high:g} good, that is "
        f"{1 / AIM_S_OVER_T:.2g} times the distances above, or {1 / high:.2g} to {1 / low:.2g} times, as long as the "
        "noise is at least 60 pixels wide.",
        "Distance = focal length × noise width / (pixels × pixel pitch of the plane).",
    )
    y = TOP + 13.4 + 4.1 * len(distance.FOCAL_LENGTHS_MM) + 6.4
    texts: list[Text] = []
    for words in paragraphs:
        lines = _paragraph(panel, RIGHT, y, words, RIGHT_END - RIGHT)
        texts += lines
        y += LEADING * len(lines) + 0.9
    return Drawing(texts=tuple(texts))
