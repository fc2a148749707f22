"""A calibration's report: one page with the verdict first, then every plane, and all that is needed to believe it.

Whoever calibrates fills a `Report`: a command with the files it read, a session with its bench and its journal too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.budget import TERMS
from procedures.numbers import NUMBERS, Group, frequency_of, label
from procedures.outcome import Quantity
from procedures.pattern_psf.combine import CombinedPsf
from procedures.pattern_psf.error_parts import Variation
from procedures.pattern_psf.estimate import PatternPsf
from procedures.radial_profile import radial_profile
from procedures.raw import Exposure, Plane, RawFrame
from procedures.two_photo.estimate import TwoPhotoPsf
from station.common.sanitise import printable
from station.common.versions import software
from station.reports import otf_figures, psf_figures
from station.reports.page import HEADLINE, exposure_words, render
from station.results.budget_table import BudgetTable, budget_table
from station.results.comparison import Comparison, Judged
from station.results.limits import Specification
from station.results.overlay import Overlay
from station.results.plane_result import PlaneResult
from station.results.result_files import file_names
from station.results.terms import specification_verdict
from station.results.units import Pixels
from station.results.verdict_words import MEASUREMENT, SPECIFICATION

Array = npt.NDArray[np.float64]

PAGE = "report.html"
ORDER = ("pass", "doubtful", "refused")
"""Verdicts of measurements, the best first."""
METHODS = {
    "pattern": "M. Delbracio, P. Musé, A. Almansa: Non-parametric Sub-pixel Local Point Spread Function Estimation. "
    "Image Processing On Line 2, 2012. doi:10.5201/ipol.2012.admm-nppsf",
    "field": "the PSF of every chart by M. Delbracio, P. Musé, A. Almansa, Image Processing On Line 2, 2012, "
    "doi:10.5201/ipol.2012.admm-nppsf; between them interpolated by the model that predicts charts left out best",
    "edge": "ISO 12233:2023, Photography: Electronic still picture imaging, edge-based spatial frequency response",
    "two-photo": "M. Delbracio, A. Almansa, P. Musé: Recovering the Subpixel PSF from Two Photographs at Different "
    "Distances. Image Processing On Line 3, 2013. doi:10.5201/ipol.2013.77",
}
"""The publication that each procedure is built on."""
MORE_NUMBERS = tuple((one, one.label) for one in NUMBERS.values() if Group.HEADLINE not in one.groups)
"""What a report tells beside the numbers of every page."""


@dataclass(frozen=True)
class ReportLine:
    """One line of what is told: a condition, a device."""

    name: str
    words: str


@dataclass(frozen=True)
class ReportShot:
    """One photograph that the result comes from.

    Attributes
    ----------
    file, sha256 : str
    exposure : str
        What the camera noted, for people.
    taken : str
        When, as the camera or the journal has it.
    note : str
        What became of it: accepted, retaken and why.
    """

    file: str
    sha256: str
    exposure: str = ""
    taken: str = ""
    note: str = ""


@dataclass(frozen=True, eq=False)
class PlaneSheet:
    """One plane's section of the page: its result, with what is drawn beside it and the limits it is held to.

    Attributes
    ----------
    record : PlaneResult
        The result: every number of the section is read from it.
    photograph : Plane, optional
        The samples it was found in; of two photographs the near one.
    outline : (n, 2) float64, optional
        Of the far photograph in the near one, in its pixels (x, y).
    """

    record: PlaneResult
    photograph: Plane | None = None
    outline: Array | None = None

    @property
    def chart(self) -> PatternPsf | None:
        """An estimate from a chart, with its marks and its residual: of several shots, the first."""
        found = self.record.found
        if isinstance(found, CombinedPsf):
            return found.shots[0]
        return found if isinstance(found, PatternPsf) else None

    @property
    def verdict(self) -> str:
        """Of the measurement."""
        return str(self.record.verdict)

    @property
    def specification(self) -> Comparison:
        """How the numbers stand to their limits."""
        return self.record.specification or Comparison()

    @property
    def numbers(self) -> list[tuple[str, Quantity]]:
        """The numbers with their words, in the order of pages; after them the MTF at what was asked for."""
        known, unit = self.record.numbers, self.record.unit
        asked = [(name, label(name, unit)) for name in known if frequency_of(name)]
        return [(words, known[name]) for name, words in (*HEADLINE, *MORE_NUMBERS, *asked) if name in known]

    @property
    def pixel_words(self) -> str:
        """Which pixel frequencies are counted in."""
        return Pixels(self.record.pitch).words

    @property
    def budget(self) -> BudgetTable | None:
        """The headline numbers' uncertainties taken apart."""
        quality = self.record.quality
        return budget_table(quality) if quality is not None else None

    @property
    def halves(self) -> list[tuple[str, Variation]]:
        """The numbers in the halves of the chart, with their words."""
        return [(label(one.name), one) for one in self.record.variations]

    @property
    def plain(self) -> list[tuple[str, float]]:
        """The numbers that have no uncertainty."""
        known = self.record.values
        return [(one.label, value) for one in NUMBERS.values() if isinstance(value := known.get(one), float)]


@dataclass(frozen=True, eq=False)
class Report:
    """What a report tells.

    Attributes
    ----------
    subject : str
        What was calibrated: camera and lens, or the photograph.
    procedure : str
        "pattern" or "two-photo".
    conditions, devices : sequence of ReportLine
        Light, temperature, distance, operator, ...; the bench, one line for each device.
    made : str
        When, where that is known.
    overlays : sequence of Overlay
        Results whose MTF is drawn over this one's.
    beside : str or None
        Where the result's files lie, from the page's folder: "", "derived/1/"; None where they may lie anywhere.
    """

    subject: str
    procedure: str
    planes: Sequence[PlaneSheet]
    shots: Sequence[ReportShot]
    parameters: Mapping[str, object]
    conditions: Sequence[ReportLine] = ()
    devices: Sequence[ReportLine] = ()
    made: str = ""
    specification: Specification = field(default_factory=Specification)
    software: Mapping[str, Any] = field(default_factory=software)
    overlays: Sequence[Overlay] = ()
    beside: str | None = None

    @property
    def verdict(self) -> str:
        """The worst of the planes'."""
        return max((plane.verdict for plane in self.planes), key=ORDER.index, default="refused")

    @property
    def files(self) -> list[str]:
        """The result's files beside the page, from its folder; none where it is not known where they lie."""
        if self.beside is None:
            return []
        return [f"{self.beside}{name}" for name in file_names([plane.record for plane in self.planes])]

    @property
    def headline(self) -> str:
        """Both verdicts in words."""
        return "; ".join(words for words in (f"measurement {self.measurement}", self.against_specification) if words)

    @property
    def measurement(self) -> str:
        """How many planes' measurements have which verdict; of a single one its verdict."""
        verdicts = [plane.verdict for plane in self.planes]
        if len(verdicts) == 1:
            return f"{MEASUREMENT[verdicts[0]]}, in {self.planes[0].record.name}"
        counts = [f"{verdicts.count(one)} {MEASUREMENT[one]}" for one in ORDER[1:] if one in verdicts]
        return ", ".join([f"trusted in {verdicts.count('pass')} of {len(verdicts)} planes", *counts])

    @property
    def judged(self) -> Judged | None:
        """The worst of the planes against the specification; None where there is none."""
        return specification_verdict([plane.record for plane in self.planes])

    @property
    def against_specification(self) -> str:
        """How the planes together stand to the specification; "" where there is none."""
        if not self.specification.limits:
            return ""
        return SPECIFICATION[str(self.judged)] if self.judged else "no limit holds for these planes"


def calibration_page(report: Report) -> str:
    """The report as HTML, its pictures inside; everything in it that came from outside is escaped."""
    sheets = [(sheet, _pictures(sheet, f"p{i}", report.overlays)) for i, sheet in enumerate(report.planes, 1)]
    return render(
        "calibration.html",
        report=report,
        sheets=sheets,
        method=METHODS.get(report.procedure, ""),
        sources=_sources(report.planes),
        phase_known=f"{otf_figures.PHASE_KNOWN_DEG:g}",
    )


def _sources(sheets: Sequence[PlaneSheet]) -> list[str]:
    """What the uncertainties of any plane are made of, in words."""
    told = {column for sheet in sheets if sheet.budget is not None for column in sheet.budget.columns}
    return [words for words in TERMS.values() if words in told]


def _pictures(sheet: PlaneSheet, name: str, overlays: Sequence[Overlay] = ()) -> Mapping[str, Any]:
    """The figures of a plane, as far as there is something to draw."""
    record, pictures = sheet.record, dict[str, Any]()
    if record.psf is not None:
        pictures["psf"] = psf_figures.psf_figure(record.psf, None, f"{name}-psf")
        pictures["log"] = psf_figures.log_psf_figure(record.psf, f"{name}-log")
        pictures["energy"] = psf_figures.energy_figure(radial_profile(record.psf), f"{name}-energy")
        axis = otf_figures.FrequencyAxis(str(record.unit), record.factor)
        pictures["phase"] = otf_figures.phase_figure(record.psf, f"{name}-phase", axis)
        pictures["map"] = otf_figures.mtf_map_figure(record.psf, f"{name}-map", record.diffraction, axis)
        if record.quality is not None:
            others = curves_over(overlays, record)
            pictures["mtf"] = otf_figures.mtf_figure(
                record.quality, None, f"{name}-mtf", record.diffraction, axis, others
            )
            pictures["others"] = list(others)
    if record.inter_image is not None:
        pictures["inter_image"] = psf_figures.kernel_figure(record.inter_image, f"{name}-kernel")
    if sheet.chart is not None and sheet.photograph is not None:
        pictures["chart"] = {
            "photograph": psf_figures.photograph_figure(sheet.photograph, sheet.chart, f"{name}-photograph"),
            "residual": psf_figures.residual_figure(record.name, sheet.chart, f"{name}-residual"),
            "diagnostics": sheet.chart.diagnostics,
        }
    if sheet.outline is not None and sheet.photograph is not None:
        pictures["pair"] = psf_figures.pair_figure(sheet.photograph, sheet.outline, f"{name}-pair")
    return pictures


def curves_over(overlays: Sequence[Overlay], record: PlaneResult) -> dict[str, Mapping[str, Array]]:
    """The curves of other results that are of a plane, by their names. Raises BadParameter where units differ."""
    found = {one.name: one.of(record.name, record.unit) for one in overlays}
    return {name: columns for name, columns in found.items() if columns}


# --- of files alone ----------------------------------------------------------------------------------------------


def report_of_files(
    procedure: str,
    frames: Sequence[RawFrame],
    results: Sequence[PlaneResult],
    parameters: Mapping[str, object],
    specification: Specification | None = None,
    overlays: Sequence[Overlay] = (),
) -> Report:
    """The report of a command: what the files themselves tell about camera and conditions.

    Parameters
    ----------
    frames : the photographs, the first being the one in which charts were found
    specification : what the results were held to, where they were
    overlays : results whose MTF is drawn over these
    """
    exposure = frames[0].exposure
    return Report(
        subject=camera_words(exposure) or printable(frames[0].path.name),
        procedure=procedure,
        planes=[_sheet(one, frames) for one in results],
        shots=[shot_of(frame) for frame in frames],
        parameters=parameters,
        conditions=exposure_lines(exposure),
        specification=specification or Specification(),
        overlays=overlays,
        beside="",
    )


def _sheet(one: PlaneResult, frames: Sequence[RawFrame]) -> PlaneSheet:
    """A plane with what its figures need: the chart's photograph, or the near one and where the far one lies in it."""
    name, found = one.name, one.found
    if isinstance(found, PatternPsf):
        return PlaneSheet(one, frames[0].planes[name])
    if isinstance(found, TwoPhotoPsf):
        near, far = (frames[i].planes[name] for i in ((1, 0) if found.swapped else (0, 1)))
        return PlaneSheet(one, near, found.warp.forward(_rim(far)))
    return PlaneSheet(one)


def _rim(plane: Plane) -> Array:
    """A plane's outline, closed, (n, 2), in its pixels (x, y)."""
    rows, columns = plane.samples.shape
    corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows], [0, 0]]) - 0.5
    t = np.linspace(0, 1, 17)[:, None]
    return np.concatenate([a + t * (b - a) for a, b in pairwise(corners)])


def shot_of(frame: RawFrame, note: str = "") -> ReportShot:
    """A photograph as its file tells of it."""
    exposure = frame.exposure
    return ReportShot(
        printable(frame.path), frame.sha256, exposure_words(exposure), printable(exposure.captured_at or ""), note
    )


def camera_words(exposure: Exposure) -> str:
    """Camera and lens, as far as the camera noted them."""
    return ", ".join(printable(one) for one in (exposure.camera, exposure.lens) if one)


def exposure_lines(exposure: Exposure) -> list[ReportLine]:
    """What the camera noted about the first photograph."""
    distance = exposure.subject_distance_mm
    noted = {
        "Camera": exposure.camera,
        "Lens": exposure.lens,
        "Exposure": exposure_words(exposure),
        "Distance noted by the camera": f"{distance:.0f} mm" if distance else "",
        "Taken": exposure.captured_at,
    }
    return [ReportLine(name, printable(words)) for name, words in noted.items() if words]
