"""Pages in general: one HTML file each that needs nothing else, no script and no network; and how they say numbers."""

from __future__ import annotations

from functools import cache
from typing import Any

import jinja2

from procedures.numbers import RESIDUAL_STD, Group, in_group
from procedures.raw import Exposure
from station.common.uncertainty_text import stated
from station.drawing import colours
from station.drawing.colours import PLANE_COLOURS
from station.results.verdict_words import measurement_words, specification_words

HEADLINE = tuple((one, one.label) for one in in_group(Group.HEADLINE))
"""The numbers that a page tells of every plane, in their order."""
DIAGNOSTICS = (
    ("agreement", "Variance of the noise region that the chart explains", "percent"),
    ("unexplained", "Neither explained nor noise", "percent"),
    (RESIDUAL_STD, "Residual, in units of the noise on the blocks", "plain"),
    ("whiteness", "Correlation of neighbouring residuals", "plain"),
    ("relative_uncertainty", "Uncertainty of the PSF over its norm", "percent"),
    ("support_cut", "Energy outside the support", "percent"),
    ("marks_rms_px", "Scatter of the marks about the map, in pixels", "plain"),
    ("moved_px", "Largest correction of the marks' map, in pixels", "plain"),
    ("outliers", "Samples left out, several side by side", "percent"),
    ("stray_samples", "Single samples left out, hot or dead ones of the sensor", "plain"),
    ("contrast", "White less black, of the sensor's scale", "percent"),
    ("noise", "Noise on white over that", "percent"),
    ("flatness", "Darkest white over the brightest", "percent"),
    ("saturated", "Clipped white", "percent"),
    ("response_curvature", "Curvature of the response", "plain"),
)
"""What the verdict is drawn from: name, words, and how it is written."""


def render(template: str, **context: Any) -> str:
    """A page from a template of this package; what it is given is text and is escaped, unless it is markup."""
    return _environment().get_template(template).render(context)


@cache  # it compiles each template once
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("station.reports"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(stated=stated, percent=percent, signed=signed, sentence=sentence)
    environment.filters.update(measurement=measurement_words, specified=specification_words)
    environment.globals.update(titles=HEADLINE, diagnostics=DIAGNOSTICS, colours=PLANE_COLOURS, palette=colours)
    return environment


def exposure_words(exposure: Exposure) -> str:
    """What the camera noted, for people: f/2.8, 1/50 s, ISO 400, 50 mm."""
    seconds = exposure.exposure_s
    words = [
        f"f/{exposure.f_number:g}" if exposure.f_number else "",
        "" if not seconds else f"{seconds:g} s" if seconds >= 0.3 else f"1/{round(1 / seconds)} s",
        f"ISO {exposure.iso:g}" if exposure.iso else "",
        f"{exposure.focal_length_mm:g} mm" if exposure.focal_length_mm else "",
    ]
    return ", ".join(word for word in words if word)


def percent(share: float) -> str:
    """A share in per cent: 2.14 %, 99.5 %."""
    decimals = 2 if abs(share) < 0.0995 else 1
    return f"{100 * share:z.{decimals}f} %".replace("-", "−")


def signed(value: float) -> str:
    """A difference with its sign: +0.4."""
    return f"{value:+z.1f}".replace("-", "−")


def sentence(words: str) -> str:
    """Words as a sentence: a capital first, a full stop last."""
    return f"{words[:1].upper()}{words[1:]}." if words else ""
