"""Files of a PSF measurement: samples, covariance, MTF, images and budget per plane, and the record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from procedures.numbers import SAMPLES_PER_PIXEL, SUPPORT
from procedures.numerics.arrays import Array
from station.common.sanitise import cell
from station.common.versions import software
from station.drawing.pictures import psf_picture
from station.results.exports import csv_bytes, profile_table, psf_fits, psf_tiff
from station.results.measurement import PSF, Measurement, write_measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder, npy

if TYPE_CHECKING:
    from procedures.sensor.information import Information

BUDGET = "budget.csv"

Write = Callable[[Path], None]


def psf_measurement(planes: Sequence[PlaneResult], head: RecordHead) -> Measurement:
    """The planes with their files; s and k as they were used are among the parameters of the record."""
    choice = {plane.name: [asdict(trial) for trial in plane.choice] for plane in planes if plane.choice}
    used = {plane.name: plane.psf for plane in planes if plane.psf is not None}
    entry: dict[str, Any] = {}
    for name in (SAMPLES_PER_PIXEL, SUPPORT) if used else ():
        values = {plane: psf.s if name == SAMPLES_PER_PIXEL else psf.k for plane, psf in used.items()}
        entry[name] = next(iter(values.values())) if len(set(values.values())) == 1 else values
    whole = replace(head, parameters={**head.parameters, **entry})
    files = {BUDGET: _made(budget_csv, planes)} if any(plane.quality is not None for plane in planes) else {}
    for plane in planes:
        files |= _plane_files(plane)
    return Measurement(PSF, whole, tuple(planes), entries={"choice": choice}, files=files)


def write_psf_result(folder: ResultFolder, planes: Sequence[PlaneResult], head: RecordHead) -> str:
    """Write the files of every plane and the record; returns the record's text."""
    return write_measurement(folder, psf_measurement(planes, head))


def _plane_files(plane: PlaneResult) -> dict[str, Write]:
    name, psf, files = plane.name, plane.psf, dict[str, Write]()
    if plane.curves:
        files[f"mtf_{name}.csv"] = _made(mtf_table, plane.curves, str(plane.unit))
    if psf is not None:
        files |= {
            f"profile_{name}.csv": _made(profile_table, psf, plane.pitch),
            f"psf_{name}.npy": _made(npy, psf.h),
            f"covariance_{name}.npy": _made(npy, psf.covariance),
            f"psf_{name}.fits": _made(psf_fits, psf, name, software()["version"], plane.exposure),
            f"psf_{name}.tiff": _made(psf_tiff, psf, name, plane.exposure),
            f"psf_{name}.png": _made(psf_picture, psf, f"{name}  {plane.verdict}"),
        }
    if plane.information is not None:
        files[f"information_{name}.csv"] = _made(information_table, plane.information)
    if plane.inter_image is not None:
        files[f"inter_image_{name}.npy"] = _made(npy, plane.inter_image)
    return files


def budget_csv(planes: Sequence[PlaneResult]) -> bytes:
    """Every term that contributes to a number of a plane, as CSV."""
    rows = [
        [plane.name, name, term, f"{uncertainty:.9g}", cell(number.unit)]
        for plane in planes
        if plane.quality is not None
        for name, number in plane.quality.numbers.items()
        for term, uncertainty in plane.quality.budgets.get(name, {}).items()
        if uncertainty > 0
    ]
    return csv_bytes([["plane", "number", "term", "uncertainty", "unit"], *rows])


def _made(make: Callable[..., bytes], *given: Any) -> Write:
    def write(path: Path) -> None:
        path.write_bytes(make(*given))

    return write


def mtf_table(curves: Mapping[str, Array], unit: str = "cycles/pixel") -> bytes:
    """The MTF as CSV: frequency with its unit; horizontal, vertical, radial mean, each with its error."""
    head = [f"{name} [{unit}]" if name == "frequency" else name for name in curves]
    return csv_bytes([head, *([f"{value:.9g}" for value in row] for row in zip(*curves.values(), strict=True))])


def information_table(information: Information) -> bytes:
    """NPS, NEQ and noise-equivalent MTF as CSV, over all frequencies of the upper half plane, in cycles/pixel."""
    unit = "[cycles/pixel]"
    rows = [[f"frequency_x {unit}", f"frequency_y {unit}", "mtf", "nps", "neq", "neq_uncertainty", "equivalent_mtf",
             "equivalent_mtf_uncertainty"]]  # fmt: skip
    maps = (information.mtf, information.nps, information.neq, information.neq_uncertainty, information.equivalent_mtf,
            information.equivalent_mtf_uncertainty)  # fmt: skip
    for j in range(len(information.frequencies) // 2 + 1):
        for i, fx in enumerate(information.frequencies):
            rows.append(
                [f"{value:.7g}" for value in (fx, abs(information.frequencies[j]), *(one[j, i] for one in maps))]
            )
    return csv_bytes(rows)
