"""Text on hover for figures of a page: strips of an axes with titles, without scripts.

`style.svg` gives each strip a <title> element, which browsers show and screen readers read.
"""

import re
from collections.abc import Sequence
from html import unescape

import numpy as np
import numpy.typing as npt
from markupsafe import escape
from matplotlib.axes import Axes

MAX_STRIPS = 40
"""Strips of an axes: a pointer does not resolve more."""
MARK = "hover-"


def title_along(axes: Axes, x: npt.NDArray[np.float64], words: Sequence[str]) -> None:
    """Give an axes titles at places along x, each as far as halfway to the next; at most `MAX_STRIPS` of them."""
    chosen = np.unique(np.linspace(0, len(x) - 1, min(MAX_STRIPS, len(x))).round().astype(int))
    middles = (x[chosen][1:] + x[chosen][:-1]) / 2
    ends = np.concatenate([[x[chosen[0]]], middles, [x[chosen[-1]]]])
    for number, at in enumerate(chosen):
        strip = axes.axvspan(ends[number], ends[number + 1], fc="none", ec="none", lw=0, zorder=9)
        strip.set_gid(f"{MARK}{words[at]}")


def with_titles(svg: str) -> str:
    """An SVG in which every strip has its text as <title>."""
    return re.sub(
        rf'<g id="{MARK}([^"]*)">', lambda m: f'<g class="hover"><title>{escape(unescape(m[1]))}</title>', svg
    )
