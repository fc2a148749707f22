"""Reports as pages: one HTML file each that needs nothing else, no script and no network."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import jinja2

from procedures.pattern_print.sheet import Size
from procedures.raw import Exposure
from station import figures
from station.results import software
from station.stated import stated

if TYPE_CHECKING:
    from station.compare import Comparison
    from station.demo import Demonstration, Shot, Summary

SHOWN_PLANE = "G1"
"""Of which plane photograph and residual are drawn."""
NUMBERS = (
    ("mtf50_horizontal", "MTF50 along rows"),
    ("mtf50_vertical", "MTF50 along columns"),
    ("mtf_nyquist_radial", "MTF at Nyquist"),
    ("energy_above_nyquist", "Energy above Nyquist"),
    ("fwhm_horizontal", "Half maximum along rows"),
    ("fwhm_vertical", "Half maximum along columns"),
    ("encircled_energy_80", "Radius of 80 % energy"),
    ("ellipticity", "Ellipticity"),
    ("centroid_x", "Centroid x"),
    ("centroid_y", "Centroid y"),
    ("strehl", "Strehl ratio with photosite"),
)
"""The numbers that a page tells of every plane, in their order."""
DIAGNOSTICS = (
    ("agreement", "Variance of the noise region that the chart explains", "percent"),
    ("unexplained", "Neither explained nor noise", "percent"),
    ("residual_std", "Residual, in units of the noise on the blocks", "plain"),
    ("whiteness", "Correlation of neighbouring residuals", "plain"),
    ("relative_uncertainty", "Uncertainty of the PSF over its norm", "percent"),
    ("support_cut", "Energy outside the support", "percent"),
    ("marks_rms_px", "Scatter of the marks about the map, in pixels", "plain"),
    ("moved_px", "Largest correction of the marks' map, in pixels", "plain"),
    ("outliers", "Samples left out", "percent"),
    ("contrast", "White less black, of the sensor's scale", "percent"),
    ("noise", "Noise on white over that", "percent"),
    ("flatness", "Darkest white over the brightest", "percent"),
    ("saturated", "Clipped white", "percent"),
    ("response_curvature", "Curvature of the response", "plain"),
)
"""What the verdict is drawn from: name, words, and how it is written."""


def demonstration_page(found: Demonstration, summary: Summary) -> str:
    """The demonstration's report."""
    return render(
        "demo.html",
        found=found,
        summary=summary,
        size=Size(300.0),
        ratios=figures.ratios_figure(_compared(found, lambda one: [one.ratio]), "ratios"),
        sigmas=figures.sigmas_figure(
            _compared(found, lambda one: [against.sigmas for against in one.mtf50.values()]), "sigmas"
        ),
        places=figures.places_figure(_places(found), "places"),
        pictures={shot.setup.name: _pictures(shot, f"p{i}") for i, shot in enumerate(found.shots, 1)},
        numbers=NUMBERS,
        shown_plane=SHOWN_PLANE,
        diagnostics=DIAGNOSTICS,
        colours=figures.PLANE_COLOURS,
        exposure=exposure_words,
        software=software(),
    )


def _compared(found: Demonstration, numbers: Callable[[Comparison], Sequence[float]]) -> figures.Rows:
    """Numbers of every plane that was compared, by photograph."""
    return [
        (shot.setup.title, {one.name: numbers(one.comparison) for one in shot.planes if one.comparison is not None})
        for shot in found.shots
    ]


def _places(found: Demonstration) -> list[Any]:
    """The charts' outlines in fractions of the frame."""
    outlines = []
    for shot in found.shots:
        for plane in shot.planes[:1]:
            if plane.calibrated.found is not None:
                rows, columns = shot.frame.planes[plane.name].samples.shape
                outlines.append(figures.chart_outline(plane.calibrated.found) / (columns, rows))
    return outlines


def _pictures(shot: Shot, name: str) -> Mapping[str, Any]:
    """The figures of one photograph: of its shown plane, and of every plane."""
    pictures: dict[str, Any] = {"planes": {}}
    for plane in shot.planes:
        estimate, against = plane.calibrated.found, plane.comparison
        if estimate is None or against is None:
            continue
        here = f"{name}-{plane.name}"
        pictures["planes"][plane.name] = {
            "psf": figures.psf_figure(estimate.psf, against.aligned, f"{here}-psf"),
            "mtf": figures.mtf_figure(estimate.quality, against.truth, f"{here}-mtf"),
        }
        if plane.name == SHOWN_PLANE:
            samples = shot.frame.planes[plane.name]
            pictures["diagnostics"] = estimate.diagnostics
            pictures["photograph"] = figures.photograph_figure(samples, estimate, f"{here}-photograph")
            pictures["residual"] = figures.residual_figure(plane.name, estimate, f"{here}-residual")
    return pictures


# --- pages in general --------------------------------------------------------------------------------------------


def render(template: str, **context: Any) -> str:
    """A page from a template of this package; what it is given is text and is escaped, unless it is markup."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("station"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(stated=stated, percent=percent, signed=signed, sentence=sentence)
    return environment.get_template(template).render(context)


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
