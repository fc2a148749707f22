"""A page that shows a render as it was, filtered, and converged where that is known, side by side and close up."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from station.drawing import colours
from station.drawing.pictures import display_png

Linear = npt.NDArray[np.floating]

CLOSE_UP_PX = 48
"""Side of a detail, pixels of the render."""


@dataclass(frozen=True, eq=False)
class RenderRow:
    """One render on the page.

    Attributes
    ----------
    title : str
        What is seen.
    pictures : tuple of (caption, (rows, columns, 3))
        Linear pictures of one size, in the order in which they are shown.
    similar : (rows, columns)
        Similar patches found per pixel.
    facts : tuple of str
        Sentences below.
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
    """The page, UTF-8, with its pictures inside."""
    from jinja2 import Environment

    template = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(_PAGE)
    shown = [_shown(row) for row in rows]
    return template.render(title=title, rows=shown, palette=colours).encode()


def _shown(row: RenderRow | StripRow) -> dict[str, Any]:
    """A row as the template takes it."""
    if isinstance(row, StripRow):
        strips = [_strip(strip) for strip in row.strips]
        return {"title": row.title, "facts": row.facts, "strips": strips}
    similar = _uri(row.similar / max(float(row.similar.max()), 1.0))
    strips = [_strip(row.pictures), *_details(row)]
    return {"title": row.title, "facts": row.facts, "strips": strips, "similar": similar}


def _strip(pictures: tuple[tuple[str, Linear], ...]) -> list[tuple[str, str]]:
    return [(caption, _uri(picture)) for caption, picture in pictures]


def _details(row: RenderRow) -> list[list[tuple[str, str]]]:
    """The same pictures close up."""
    strips = []
    for what, top, left in close_ups(row.pictures[0][1], row.pictures[1][1], row.similar):
        window = np.s_[top : top + CLOSE_UP_PX, left : left + CLOSE_UP_PX]
        strips.append([(f"{caption}, {what}", _uri(picture[window])) for caption, picture in row.pictures])
    return strips


def close_ups(noisy: Linear, filtered: Linear, similar: Linear) -> list[tuple[str, int, int]]:
    """What each detail shows, and its first row and column."""
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


def _uri(picture: Linear) -> str:
    return "data:image/png;base64," + base64.b64encode(display_png(picture)).decode()


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{{ title }}</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem; color: {{ palette.TEXT }}; background: {{ palette.GROUND }} }
.strip { display: flex; gap: 1rem; margin: 1rem 0 }
figure { margin: 0; flex: 1; min-width: 0 }
img { width: 100%; image-rendering: pixelated }
figcaption { color: {{ palette.SOFT }} }
details img { max-width: 33% }
</style></head><body>
<h1>{{ title }}</h1>
{% for row in rows %}
<h2>{{ row.title }}</h2>
{% for strip in row.strips %}
<div class="strip">
{% for caption, uri in strip %}
<figure><img src="{{ uri }}" alt="{{ caption }}"><figcaption>{{ caption }}</figcaption></figure>
{% endfor %}
</div>
{% endfor %}
{% for fact in row.facts %}
<p>{{ fact }}</p>
{% endfor %}
{% if row.similar %}
<details><summary>Similar patches found for each pixel; where it is dark, more samples are needed</summary>
<img src="{{ row.similar }}" alt="similar patches per pixel"></details>
{% endif %}
{% endfor %}
</body></html>
"""
