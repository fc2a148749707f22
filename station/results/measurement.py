"""Result of a procedure, from which record, page, batch table, limits and certificate are derived."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from procedures.outcome import Miss, Verdict
from procedures.reading.exposure import Exposure
from station.common.versions import software
from station.results.exports import numbers_table
from station.results.limits import compare
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder, plane_record, write_record
from station.results.terms import USUAL, Terms
from station.results.units import Pixels

NUMBERS = "numbers.csv"
PSF = "station/psf/1"
RESTORATION = "station/restore/1"
BY_PLANE = "planes"


@dataclass(frozen=True, eq=False)
class Measurement:
    """Result of a procedure.

    schema : of the record, `station/NAME/1`
    head : procedure, inputs with their hashes, settings, duration
    planes : results by plane, with verdicts
    entries : additional entries of the record
    files : tables, arrays and images by name; a large file may be a function that writes it
    results_key : entry of the record with the planes; with a name other than "planes" there is one plane
    missed : unusable photographs; None if the record of the procedure does not list them
    exposure : settings recorded by the camera
    terms : unit of frequencies and specification
    result : the complete result for the page, if the planes are parts of one
    overlays : results whose MTF is drawn over this one's
    """

    schema: str
    head: RecordHead
    planes: tuple[PlaneResult, ...]
    entries: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, bytes | Callable[[Path], None]] = field(default_factory=dict)
    missed: tuple[Miss, ...] | None = None
    exposure: Exposure = field(default_factory=Exposure)
    terms: Terms = USUAL
    result: Any = None
    results_key: str = BY_PLANE
    overlays: Sequence[Any] = ()

    @property
    def by_name(self) -> dict[str, PlaneResult]:
        return {plane.name: plane for plane in self.planes}

    @property
    def refused(self) -> bool:
        return all(plane.verdict is Verdict.REFUSED for plane in self.planes)

    def compared(self, terms: Terms) -> "Measurement":
        """The measurement with every plane compared with the limits of a specification."""
        if not terms.specification.limits:
            return self
        pixels = (Pixels(plane.pitch or 1) for plane in self.planes)
        planes = tuple(
            replace(plane, specification=compare(plane, terms.specification, of_plane))
            for plane, of_plane in zip(self.planes, pixels, strict=True)
        )
        return replace(self, planes=planes, head=replace(self.head, specification=terms.specified(planes)), terms=terms)

    def record(self) -> dict[str, Any]:
        """Contents of `result.json`."""
        records = {plane.name: plane_record(plane) for plane in self.planes}
        unmentioned = self.missed is not None and not any("left_out" in plane.details for plane in self.planes)
        return {
            "schema": self.schema,
            **self.head.to_record(),
            **self.entries,
            self.results_key: records if self.results_key == BY_PLANE else next(iter(records.values())),
            **({"left_out": [one.to_record() for one in self.missed or ()]} if unmentioned else {}),
            "software": software(),
        }


def write_measurement(folder: ResultFolder, measurement: Measurement) -> str:
    """Write the files, the table of all numbers and the record; returns the record's text."""
    for name, data in measurement.files.items():
        folder.write(name, data)
    numbers = [(plane.name, name, number) for plane in measurement.planes for name, number in plane.numbers.items()]
    if numbers and NUMBERS not in measurement.files:
        folder.write(NUMBERS, numbers_table(iter(numbers)))
    return write_record(folder, measurement.record())
