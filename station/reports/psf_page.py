"""The page of PSFs: figures of every plane, uncertainty budget, sampling, checks, and a glossary."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from markupsafe import Markup

from procedures.choice import TERMS
from procedures.numbers import RESIDUAL_STD, Group, in_group, label
from procedures.numerics.arrays import Array
from procedures.outcome import Outcome
from procedures.pattern_psf.combine import CombinedPsf
from procedures.pattern_psf.estimate import PatternPsf
from procedures.physics.estimate import Physics
from procedures.quality import Quality
from procedures.raw import Plane
from procedures.transfer_function import radial_profile
from procedures.two_photo.estimate import TwoPhotoPsf
from station.common.sanitise import stated
from station.drawing.plots import Figure
from station.reports import otf_figures, psf_figures
from station.reports.page import (
    Block,
    Figures,
    Heading,
    Note,
    Section,
    Table,
    html,
    percent,
    quantity,
    reason_words,
    render,
    sentence,
    signed,
    small,
    tag,
    unit_of,
)
from station.reports.report import Report
from station.reports.report_page import curves_over, report_page
from station.results.overlay import Overlay
from station.results.plane_result import PlaneResult

NEGLIGIBLE = 0.05
"""Share of the uncertainty below which a term of the budget is not shown."""
DIAGNOSTICS = (
    ("agreement", "Variance of the noise region that the chart explains", percent),
    ("unexplained", "Neither explained nor noise", percent),
    (RESIDUAL_STD, "Residual, in units of the noise on the blocks", None),
    ("whiteness", "Correlation of neighbouring residuals", None),
    ("relative_uncertainty", "Uncertainty of the PSF over its norm", percent),
    ("support_cut", "Energy outside the support", percent),
    ("marks_rms_px", "Scatter of the marks about the map, in pixels", None),
    ("moved_px", "Largest correction of the marks' map, in pixels", None),
    ("outliers", "Excluded samples, several side by side", percent),
    ("stray_samples", "Excluded single samples, hot or dead ones of the sensor", None),
    ("contrast", "White less black, of the sensor's scale", percent),
    ("noise", "Noise on white over that", percent),
    ("flatness", "Darkest white over the brightest", percent),
    ("saturated", "Clipped white", percent),
    ("response_curvature", "Curvature of the response", None),
)
"""Diagnostics on which the verdict is based: name, label, format."""


def psf_page(report: Report) -> str:
    """The page as HTML with embedded figures."""
    budgets = [budget_terms(one.quality) for one in report.planes if one.quality is not None]
    sources = [words for term, words in TERMS.items() if any(term in terms for terms in budgets)]
    words = Markup(render("psf_words.html", sources=sources, pattern=report.procedure == "pattern"))
    names = {one.name: f"p{i}" for i, one in enumerate(report.planes, 1)}
    return report_page(
        report,
        plane_blocks=lambda plane: _plane_blocks(plane, report, names[plane.name]),
        closing=[Section("Terms and their limits", [words], anchor="words")],
    )


def _plane_blocks(plane: PlaneResult, report: Report, name: str) -> list[Block]:
    leading, figures = _psf_figures(plane, report.overlays, name)
    estimate = plane.estimate.shots[0] if isinstance(plane.estimate, CombinedPsf) else plane.estimate
    if isinstance(estimate, TwoPhotoPsf) and len(report.frames) > 1:
        near, far = (report.frames[i].planes[plane.name] for i in ((1, 0) if estimate.swapped else (0, 1)))
        leading.insert(0, psf_figures.pair_figure(near, estimate.warp.forward(_outline(far)), f"{name}-pair"))
    if isinstance(estimate, PatternPsf) and report.frames:
        chart, *fit = chart_figures(report.frames[0].planes[plane.name], estimate, name)
        leading, figures = [chart, *leading], [*figures, *fit]
    blocks: list[Block] = [Figures(leading, summary=True), Figures(figures)] if leading else []
    if plane.quality is not None:
        blocks += _budget(plane.quality)
    if plane.diffraction is not None and plane.diffraction.typed:
        blocks.append(
            Note(
                f"f/{plane.diffraction.f_number:g} was given by the operator: the camera recorded none, or another. "
                "The Strehl ratio, the numbers of the wavefront, the dotted limit, and partly the far tail and the "
                "energy outside the support depend on it; their budget assumes that it is right within a tenth."
            )
        )
    if plane.choice:
        rows = []
        for trial in plane.choice:
            mtf50 = ["—" if one is None else f"{one:.4f}" for one in trial.mtf50]
            sizes = [f"{trial.uncertainty:.4f}", f"{trial.truncation:.4f}", f"{trial.band_edge:.3f}"]
            rows.append([str(trial.s), str(trial.k), *mtf50, *sizes, sentence(trial.reason)])
        head = ["s", "k", "MTF50 along rows", "MTF50 along columns", "uncertainty of the OTF",
                "truncation by the support", "OTF at the band’s edge", "result"]  # fmt: skip
        last = Note("The last line gives all numbers.")
        blocks += [Heading("Choice of s and k"), Table(rows, head, "nnnnnnnr"), last]
    checks = [*_halves(plane), *_edges(plane), *_physics(plane.physics)]
    return [*blocks, Figures(checks)] if checks else blocks


def _psf_figures(plane: PlaneResult, overlays: Sequence[Overlay], name: str) -> tuple[list[Figure], list[Figure]]:
    """PSF and MTF for the summary, and the figures of the plane's section."""
    if plane.psf is None:
        return [], []
    axis = otf_figures.FrequencyAxis(str(plane.unit), plane.factor)
    leading = [psf_figures.psf_figure(plane.psf, None, f"{name}-psf")]
    if plane.quality is not None:
        others = curves_over(overlays, plane)
        mtf = otf_figures.mtf_figure(plane.quality, None, f"{name}-mtf", plane.diffraction, axis, others)
        leading.append(mtf)
    figures = [
        psf_figures.log_psf_figure(plane.psf, f"{name}-log"),
        psf_figures.energy_figure(radial_profile(plane.psf), f"{name}-energy"),
        otf_figures.mtf_map_figure(plane.psf, f"{name}-map", plane.diffraction, axis),
        otf_figures.phase_figure(plane.psf, f"{name}-phase", axis),
    ]
    if plane.inter_image is not None:
        figures.append(psf_figures.kernel_figure(plane.inter_image, f"{name}-kernel"))
    return leading, figures


def chart_figures(photograph: Plane, estimate: PatternPsf, name: str) -> list[Figure]:
    """The chart, the residual, and the diagnostics of an estimate."""
    known = [diagnostic for diagnostic in DIAGNOSTICS if diagnostic[0] in estimate.diagnostics]
    rows = []
    for key, words, form in known:
        value = estimate.diagnostics[key]
        rows.append([words, form(value) if form else f"{value:.3f}".replace("-", "−")])
    return [
        psf_figures.photograph_figure(photograph, estimate, f"{name}-photograph"),
        psf_figures.residual_figure(photograph.name, estimate, f"{name}-residual"),
        Figure(Table(rows, style="plain"), f"Diagnostics on which the verdict in {photograph.name} is based."),
    ]


def _outline(plane: Plane) -> Array:
    """A plane's outline, closed, (n, 2), in its pixels (x, y)."""
    rows, columns = plane.samples.shape
    corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows], [0, 0]]) - 0.5
    t = np.linspace(0, 1, 17)[:, None]
    return np.concatenate([a + t * (b - a) for a, b in pairwise(corners)])


def budget_terms(quality: Quality) -> list[str]:
    """The terms that contribute to a headline number."""
    numbers = in_group(Group.BUDGET, quality.numbers)
    return [
        term
        for term in TERMS
        if any(quality.budgets[one].get(term, 0.0) > NEGLIGIBLE * quality.numbers[one].uncertainty for one in numbers)
    ]


def _budget(quality: Quality) -> list[Block]:
    terms, rows = budget_terms(quality), []
    for name in in_group(Group.BUDGET, quality.numbers):
        number, budget = quality.numbers[name], quality.budgets[name]
        decimals = max(0, 1 - math.floor(math.log10(number.uncertainty))) if number.uncertainty > 0 else 4
        sizes = [budget.get(term, 0.0) for term in terms]
        cells = [f"{size:.{decimals}f}" if float(f"{size:.{decimals}f}") else "–" for size in sizes]
        if sizes and max(sizes) > 0:
            largest = int(np.argmax(sizes))
            cells[largest] = html("<b>{}</b>", cells[largest])
        value = f"{number.value:z.{decimals}f}".replace("-", "−")
        rows.append([small(name.label, unit_of(number)), value, *cells, f"{number.uncertainty:.{decimals}f}"])
    if not rows:
        return []
    note = (
        "Standard uncertainties; “together” is the root of the sum of their squares, the ± of the number. The largest "
        "of each line is bold; – is less than what is reported. All numbers: `budget.csv`."
    )
    head = ["number", "value", *(TERMS[term] for term in terms), "together"]
    return [Heading("Uncertainty budget"), Table(rows, head, style="budget"), Note(note)]


def _halves(plane: PlaneResult) -> list[Figure]:
    rows = [
        [small(label(variation.name), f"{variation.halves[0]} half, {variation.halves[1]} half of the chart"),
         small(f"{variation.values[0]:.4f}, {variation.values[1]:.4f}", f"{signed(variation.sigmas)} σ apart")]
        for variation in plane.variations
    ]  # fmt: skip
    return [Figure(Table(rows, style="plain"), "Variation over the chart.")] if rows else []


def edge_rows(plane: PlaneResult) -> list[list[str]]:
    """The chart's slanted edges beside the PSF."""
    return [
        [small(f"MTF50 across the {edge.edge.orientation} edge", f"{edge.by_edge.unit}; PSF less edge in σ"),
         small(stated(edge.by_edge.value, edge.by_edge.uncertainty),
               f"PSF {stated(edge.by_psf.value, edge.by_psf.uncertainty)}; {signed(edge.sigmas)} σ")]
        for edge in plane.edges
    ]  # fmt: skip


def _edges(plane: PlaneResult) -> list[Figure]:
    caption = (
        "Check by the chart's own edges: measured across the slanted edges of the same frame by ISO 12233, and from "
        "the PSF along their normals, all light counted in both. The edges lie beside the chart, where a lens may blur "
        "differently."
    )
    return [Figure(Table(edge_rows(plane), style="plain"), caption)] if plane.edges else []


def _physics(outcome: Outcome[Physics] | None) -> list[Figure]:
    if outcome is None:
        return []
    rows: list[list[str]] = [["", reason_words(outcome)]] if outcome.reason else []
    if (model := outcome.value) is not None:
        corner = "" if model.missing_corner_deg is None else f", its corner missing at {model.missing_corner_deg}°"
        rows += [["Photosite", f"{model.aperture}{corner}"], ["Low-pass filter", model.low_pass]]
        rows += [[small(name.replace("_", " "), one.method), quantity(one)] for name, one in model.numbers.items()]
        rows += [
            ["Unexplained share of chi-square", percent(model.remaining)],
            ["Chi-square over its degrees of freedom", f"{model.chi_square / model.freedom:.2f}"],
        ]
    caption = html("Physical model of the PSF {}", tag(outcome.verdict))
    return [Figure(Table(rows, columns="wr", style="plain"), caption)]
