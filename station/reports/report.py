"""Contents of a page or a certificate: planes, photographs, conditions, specification, software."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from procedures.numbers import NUMBERS, label
from procedures.outcome import Miss
from procedures.psf_field import PsfField
from procedures.raw import RawFrame
from station.common.sanitise import printable
from station.common.versions import software
from station.reports.certificate_details import CertificateDetails
from station.reports.page import exposure_words
from station.results.comparison import MEASUREMENT, SPECIFICATION, Comparison, Compliance
from station.results.measurement import NUMBERS as NUMBERS_FILE
from station.results.measurement import Measurement
from station.results.overlay import Overlay
from station.results.plane_result import PlaneResult
from station.results.record_head import condition_words
from station.results.result_files import RECORD
from station.results.terms import specification_verdict

PAGE = "report.html"
ORDER = ("pass", "doubtful", "refused")
MOST_PARAMETERS, LONGEST = 60, 200
METHODS = {
    "pattern": "M. Delbracio, P. Musé, A. Almansa: Non-parametric Sub-pixel Local Point Spread Function Estimation. "
    "Image Processing On Line 2, 2012. doi:10.5201/ipol.2012.admm-nppsf",
    "field": "the PSF of every chart by M. Delbracio, P. Musé, A. Almansa, Image Processing On Line 2, 2012, "
    "doi:10.5201/ipol.2012.admm-nppsf; between them interpolated by the model that predicts excluded charts best",
    "edge": "ISO 12233:2023, Photography: Electronic still picture imaging, edge-based spatial frequency response",
    "two-photo": "M. Delbracio, A. Almansa, P. Musé: Recovering the Subpixel PSF from Two Photographs at Different "
    "Distances. Image Processing On Line 3, 2013. doi:10.5201/ipol.2013.77",
}


@dataclass(frozen=True)
class ReportLine:
    """A condition or a device: its name, and a text."""

    name: str
    words: str


@dataclass(frozen=True)
class ReportShot:
    """A photograph.

    file, sha256 : str
    exposure : settings recorded by the camera
    taken : date and time from the camera or the journal
    note : why it does not count
    """

    file: str
    sha256: str
    exposure: str = ""
    taken: str = ""
    note: str = ""


@dataclass(frozen=True)
class DriftLine:
    """The drift of one number over a session, in words: its name, per hour, per kelvin."""

    name: str
    per_hour: str
    per_kelvin: str


@dataclass(frozen=True, eq=False)
class Report:
    """Contents of a page or a certificate.

    subject : camera and lens, or the photograph
    procedure, title : its name, and a line that describes it
    conditions, devices : light, temperature, distance, operator, ...; one line per device
    made : date and time, if known
    specification : its title
    overlays : results whose MTF is drawn over this one's
    frames : the photographs with their samples, the first being the one in which charts were found
    missed : inputs that were not used
    files : the result's files, from the folder of the page
    method : publication or standard
    duration_s : processing time
    drift : drift over the session
    fields : PSF over the frame, by plane
    result : the complete result, if the planes are parts of one
    record : digest of the record, see `certificate.record_digest`
    details : what a certificate states besides the measurement
    """

    subject: str
    procedure: str
    planes: Sequence[PlaneResult]
    shots: Sequence[ReportShot]
    parameters: Mapping[str, object]
    conditions: Sequence[ReportLine] = ()
    devices: Sequence[ReportLine] = ()
    made: str = ""
    specification: str = ""
    software: Mapping[str, Any] = field(default_factory=software)
    overlays: Sequence[Overlay] = ()
    frames: Sequence[RawFrame] = ()
    missed: Sequence[Miss] = ()
    files: Sequence[str] = ()
    title: str = ""
    method: str = ""
    duration_s: float | None = None
    drift: Sequence[DriftLine] = ()
    record: str = ""
    fields: Mapping[str, PsfField] = field(default_factory=dict)
    result: Any = None
    details: CertificateDetails = field(default_factory=CertificateDetails)

    @property
    def verdict(self) -> str:
        """The worst verdict of the planes."""
        return max((str(plane.verdict) for plane in self.planes), key=ORDER.index, default="refused")

    @property
    def headline(self) -> str:
        """Both verdicts in words."""
        return "; ".join(words for words in (f"measurement {self.measurement}", self.against_specification) if words)

    @property
    def measurement(self) -> str:
        """The verdict of a single plane, or the numbers of planes by verdict."""
        verdicts = [str(plane.verdict) for plane in self.planes]
        if len(verdicts) == 1:
            return f"{MEASUREMENT[verdicts[0]]}, in {self.planes[0].name}"
        counts = [f"{verdicts.count(one)} {MEASUREMENT[one]}" for one in ORDER[1:] if one in verdicts]
        return ", ".join([f"trusted in {verdicts.count('pass')} of {len(verdicts)} planes", *counts])

    @property
    def judged(self) -> Compliance | None:
        """The worst of the planes against the specification; None without limits."""
        return specification_verdict(self.planes)

    @property
    def against_specification(self) -> str:
        """The planes together against the specification; empty without limits."""
        if all(plane.specification is None for plane in self.planes):
            return ""
        return SPECIFICATION[str(self.judged)] if self.judged else "no limit holds for these planes"


def comparison(plane: PlaneResult) -> Comparison:
    """The plane's numbers compared with their limits."""
    return plane.specification or Comparison()


def numbers_of_page(plane: PlaneResult) -> list[tuple[str, Any]]:
    """All numbers of a plane with labels, in the order of `procedures.numbers`; those without uncertainty last."""
    order = {name: at for at, name in enumerate(NUMBERS)}
    names = sorted(plane.numbers, key=lambda name: order.get(name, len(order)))
    plain = [
        (NUMBERS[name].label, plain) for name in NUMBERS if name in plane.values and (plain := plane.quantity(name))
    ]
    return [*((label(name, plane.unit), plane.numbers[name]) for name in names), *plain]


def measurement_report(
    measurement: Measurement, procedure: str, *, title: str = "", method: str = "", frames: Sequence[RawFrame] = ()
) -> Report:
    """The report of a measurement."""
    numbers = [NUMBERS_FILE] if any(plane.numbers for plane in measurement.planes) else []
    camera = ", ".join(printable(one) for one in (measurement.exposure.camera, measurement.exposure.lens) if one)
    inputs = measurement.head.input
    first = inputs[0].path.rpartition("/")[2] if inputs else RECORD
    shots = [
        ReportShot(
            printable(frame.path), frame.sha256, exposure_words(frame.exposure),
            printable(frame.exposure.captured_at or ""),
        )
        for frame in frames
    ]  # fmt: skip
    exposure = measurement.exposure
    distance = exposure.subject_distance_mm
    noted = {
        "Camera": exposure.camera,
        "Lens": exposure.lens,
        "Exposure": exposure_words(exposure),
        "Distance recorded by the camera": f"{distance:.0f} mm" if distance else "",
        "Taken": exposure.captured_at,
    }
    conditions = [ReportLine(name, printable(words)) for name, words in noted.items() if words]
    return Report(
        subject=camera or (title if first == RECORD else printable(first)),
        procedure=procedure,
        planes=measurement.planes,
        shots=shots or [ReportShot(one.path, one.sha256) for one in inputs],
        parameters=measurement.head.parameters,
        conditions=[*conditions, *environment_lines(measurement.head.environment)],
        specification=measurement.terms.specification.title,
        overlays=measurement.overlays,
        frames=frames,
        missed=measurement.missed or (),
        files=list(dict.fromkeys((RECORD, *numbers, *measurement.files))),
        title=title,
        method=METHODS.get(procedure, method),
        duration_s=measurement.head.duration_s,
        result=measurement.result,
    )


def parameters_words(parameters: Mapping[str, Any]) -> str:
    """Parameters as "s = 4, k = 17": of a session's many facts the short ones, and no more than fit on a page."""
    known = ((name, " ".join(map(str, one)) if isinstance(one, list | tuple) else str(one))
             for name, one in parameters.items() if one is not None and not isinstance(one, Mapping))  # fmt: skip
    words = [f"{name} = {one}" for name, one in known if 0 < len(one) <= LONGEST]
    rest = len(words) - MOST_PARAMETERS
    return ", ".join([*words[:MOST_PARAMETERS], *([f"and {rest} more, in result.json"] if rest > 0 else [])])


def environment_lines(environment: Mapping[str, Any] | None) -> Iterator[ReportLine]:
    """One line for each quantity that a probe has measured."""
    for probe, quantities in (environment or {}).items():
        for name, entry in quantities.items():
            yield ReportLine(printable(f"{name} ({probe})"), printable(condition_words(entry)))
