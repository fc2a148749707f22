"""What a page tells where the pointer rests on a figure: strips of an axes with words, which need no script.

`style.svg` turns each into an element with a title, which browsers show and those who hear a page are read.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from markupsafe import escape
from matplotlib.axes import Axes

MOST = 40
"""Strips of an axes: more are not told apart by a pointer."""
MARK = "told-"


def tell_along(axes: Axes, x: npt.NDArray[np.float64], words: Sequence[str]) -> None:
    """Have an axes tell words about places along x, each as far as half way to the next; at most `MOST` of them."""
    chosen = np.unique(np.linspace(0, len(x) - 1, min(MOST, len(x))).round().astype(int))
    middles = (x[chosen][1:] + x[chosen][:-1]) / 2
    ends = np.concatenate([[x[chosen[0]]], middles, [x[chosen[-1]]]])
    for number, at in enumerate(chosen):
        strip = axes.axvspan(ends[number], ends[number + 1], fc="none", ec="none", lw=0, zorder=9)
        strip.set_gid(f"{MARK}{words[at]}")


def with_titles(drawn: str) -> str:
    """An SVG in which every strip has its words as its title."""
    return re.sub(rf'<g id="{MARK}([^"]*)">', lambda found: _titled(found[1]), drawn)


def _titled(words: str) -> str:
    return f'<g class="told"><title>{escape(_unescaped(words))}</title>'


def _unescaped(words: str) -> str:
    for entity, letter in (("&quot;", '"'), ("&lt;", "<"), ("&gt;", ">"), ("&amp;", "&")):
        words = words.replace(entity, letter)
    return words
