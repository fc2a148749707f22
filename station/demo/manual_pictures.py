"""Pictures of the manual, drawn from one photograph by the simulated camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from procedures.pattern_print.formats import encode
from procedures.pattern_print.sheet import Size
from procedures.pattern_print.source import Source
from procedures.pattern_psf.estimate import PatternParameters
from procedures.radial_profile import radial_profile
from procedures.raw import read_frame
from simulators.bench.demonstration import WIDTH_MM, Staging, photograph
from station.common.progress import Progress, silent
from station.demo.demo import PRINT_BLUR, SHOWN_PLANE, compared_planes
from station.reports import otf_figures, psf_figures

NAMESPACE = 'xmlns="http://www.w3.org/2000/svg"'
"""Namespace of an SVG file; an element of a page has none."""
SETUP = Staging("manual", "Manual", (0.5, 0.5), 1.0, rows=340, columns=340)
"""The smallest frame that holds the whole chart."""


def manual_pictures(progress: Progress = silent) -> Mapping[str, bytes]:
    """The pictures by the name of their files."""
    chart = Source.from_seed().with_edges()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "photograph.dng"
        taken = photograph(SETUP, chart.chart, np.random.default_rng(1), path)
        frame = read_frame(path)
    frame = replace(frame, planes={SHOWN_PLANE: frame.planes[SHOWN_PLANE]})
    (plane,) = compared_planes(frame, taken, chart, PatternParameters(print_blur=PRINT_BLUR), SETUP, progress)
    estimate, truth = plane.result.estimate, plane.comparison
    assert estimate is not None  # the simulated photograph is a good one
    assert truth is not None
    psf, limit = estimate.psf, estimate.diffraction
    figures = {
        "photograph": psf_figures.photograph_figure(frame.planes[SHOWN_PLANE], estimate, "photograph"),
        "residual": psf_figures.residual_figure(SHOWN_PLANE, estimate, "residual"),
        "psf": psf_figures.psf_figure(psf, None, "psf"),
        "psf-and-truth": psf_figures.psf_figure(psf, truth.aligned, "psf-and-truth"),
        "psf-logarithmic": psf_figures.log_psf_figure(psf, "psf-logarithmic"),
        "mtf": otf_figures.mtf_figure(estimate.quality, None, "mtf", limit),
        "mtf-and-truth": otf_figures.mtf_figure(estimate.quality, truth.otf, "mtf-and-truth", limit),
        "mtf-map": otf_figures.mtf_map_figure(psf, "mtf-map", limit),
        "phase": otf_figures.phase_figure(psf, "phase"),
        "energy": psf_figures.energy_figure(radial_profile(psf), "energy"),
    }
    sheet = encode(Path("sheet.png"), chart, Size(WIDTH_MM)).data
    drawn = {f"{name}.svg": str(one.drawing).replace("<svg", f"<svg {NAMESPACE}", 1) for name, one in figures.items()}
    return {"sheet.png": sheet, **{name: text.encode() for name, text in drawn.items()}}
