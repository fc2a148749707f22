"""Values shown where the pointer rests on a figure: strips of the axes with titles, without a script.

`style.svg` turns each into an element with a title, which browsers show and screen readers read.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import unescape

import numpy as np
import numpy.typing as npt
from markupsafe import escape
from matplotlib.axes import Axes

MOST = 40
"""Strips of one axes; more are too narrow for a pointer."""
MARK = "strip-"


def title_strips(axes: Axes, x: npt.NDArray[np.float64], words: Sequence[str]) -> None:
    """Add a strip with a title around each x, halfway to its neighbours; at most `MOST` of them."""
    chosen = np.unique(np.linspace(0, len(x) - 1, min(MOST, len(x))).round().astype(int))
    middles = (x[chosen][1:] + x[chosen][:-1]) / 2
    ends = np.concatenate([[x[chosen[0]]], middles, [x[chosen[-1]]]])
    for number, at in enumerate(chosen):
        strip = axes.axvspan(ends[number], ends[number + 1], fc="none", ec="none", lw=0, zorder=9)
        strip.set_gid(f"{MARK}{words[at]}")


def with_titles(drawn: str) -> str:
    """Turn the strips of an SVG into elements with titles."""
    return re.sub(rf'<g id="{MARK}([^"]*)">', lambda found: _titled(found[1]), drawn)


def _titled(words: str) -> str:
    return f'<g class="strip"><title>{escape(unescape(words))}</title>'
