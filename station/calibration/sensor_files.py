"""The measurement of a sensor: numbers, tables, and a summary as XML."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from procedures import numbers as names
from procedures.numerics.arrays import Array
from procedures.reading.exposure import Exposure
from procedures.sensor.estimate import FixedPattern, SensorResult, sensor_model
from procedures.sensor.information import input_snr, linear_snr, total_snr
from procedures.sensor.photon_transfer import gain_and_noise
from station.calibration.sensor import SensorFiles, SensorPlane
from station.results.exports import csv_bytes, csv_columns
from station.results.measurement import Measurement
from station.results.plane_result import PlaneResult
from station.results.record_head import RecordHead
from station.results.result_files import npy, number_record

SCHEMA = "station/sensor/1"
SECTIONS = {
    "sensitivity": (names.QUANTUM_EFFICIENCY, names.SYSTEM_GAIN, names.INVERSE_GAIN, names.RESPONSIVITY,
                    names.TEMPORAL_DARK_NOISE, names.SENSITIVITY_THRESHOLD, "saturation", names.SNR_MAX,
                    names.DYNAMIC_RANGE),
    "linearity": ("linearity",),
    names.DARK_CURRENT: (names.DARK_CURRENT,),
    "spatial": (names.DSNU, names.PRNU),
    "defect_pixel": ("defect_pixels",),
    "general": ("general",),
}  # fmt: skip
"""Sections of the XML summary, with prefixes of the numbers' names."""


def sensor_measurement(result: SensorFiles, head: RecordHead) -> Measurement:
    """The numbers and tables of every plane, and the summary as XML."""
    files, numbers = dict[str, bytes](), [_HEAD]
    for plane in result.planes:
        if plane.outcome.value is not None:
            for name, number in plane.outcome.value.numbers.items():
                bounds = (f"{value:.9g}" for value in (number.uncertainty, number.low, number.high))
                row = [plane.name, name, f"{number.value:.9g}", number.unit, *bounds, number.method, str(number.n)]
                numbers.append(row)
            files |= _tables(plane.name, plane.outcome.value)
            if plane.noise is not None:
                files[f"nps_{plane.name}.npy"] = npy(plane.noise.power)
    return Measurement(
        SCHEMA, head, tuple(map(_plane, result.planes)), {"camera": result.camera, "iso": result.iso},
        {**files, "numbers.csv": csv_bytes(numbers), "emva1288.xml": summary_xml(result)}, tuple(result.missed),
        Exposure(camera=result.camera, iso=result.iso), result=result,
    )  # fmt: skip


def _plane(plane: SensorPlane) -> PlaneResult:
    result = plane.outcome.value
    if result is None:
        return PlaneResult.of_outcome(plane.name, plane.outcome, pitch=0)
    joint, gain = gain_and_noise(result.transfer), result.numbers[names.SYSTEM_GAIN]
    curvature = min(result.transfer.gain_bent, gain.uncertainty)  # of the response, which a line neglects
    budget = {"noise": (gain.uncertainty**2 - curvature**2) ** 0.5, "curvature": curvature}
    details: dict[str, Any] = {
        "model": asdict(sensor_model(result, plane.step)),
        "gain_and_noise": {
            "names": list(joint.NAMES), "values": joint.values.tolist(),
            "covariance": joint.covariance.tolist(),
        },
        names.SYSTEM_GAIN: number_record(gain) | {"budget": budget},
        "rows": plane.shape[0],
        "columns": plane.shape[1],
        "diagnostics": {"light_spread": result.curves.light_spread, "gain_bent": result.transfer.gain_bent},
    }  # fmt: skip
    if plane.noise is not None:
        # digital numbers of the result, squared, per (cycle/pixel)^2
        details["noise_power"] = {"file": f"nps_{plane.name}.npy", "signal": plane.noise.signal,
                                  "blocks": plane.noise.blocks}  # fmt: skip
    for name, pattern in (("dark", result.dark), ("light", result.light)):
        if pattern is not None:
            details[f"periods_{name}"] = [
                {
                    "pattern": period.pattern,
                    "frequency": number_record(period.frequency),
                    "amplitude": number_record(period.amplitude),
                }
                for period in pattern.periods
            ]
    return PlaneResult.of_outcome(
        plane.name, plane.outcome, numbers=result.numbers, estimate=result, pitch=0, details=details
    )


_HEAD = ["plane", "number", "value", "unit", "uncertainty", "low_95", "high_95", "method", "n"]


def _defects(which: str, pattern: FixedPattern) -> Iterator[list[str]]:
    for (row, column), deviation in zip(pattern.defects.places, pattern.defects.deviation, strict=True):
        yield [which, str(int(row)), str(int(column)), f"{deviation:.6g}", pattern.unit]


def _tables(name: str, result: SensorResult) -> dict[str, bytes]:
    files = {f"transfer_{name}.csv": csv_columns(transfer_columns(result), 9)}
    patterns = {"dark": result.dark, "light": result.light}
    kinds = {
        "spectrogram": (["direction", "frequency", "amplitude", "unit"], _spectra),
        "histogram": (["deviation", "unit", "count", "normal"], _histogram),
        "defects": (["row", "column", "deviation", "unit"], _defects),
    }
    for kind, (head, rows_of) in kinds.items():
        rows = [row for which, pattern in patterns.items() if pattern for row in rows_of(which, pattern)]
        if any(patterns.values()):
            files[f"{kind}_{name}.csv"] = csv_bytes([["picture", *head], *rows])
    return files


def transfer_columns(result: SensorResult) -> dict[str, Array]:
    """Measured curves by level: light, signal, variances, linearity, and signal-to-noise ratios."""
    curves = result.curves
    signal = curves.signal[0]
    return {
        "light": curves.light[0],
        "signal": signal,
        "signal_uncertainty": np.std(curves.signal[1:], axis=0),
        "variance": curves.variance[0],
        "variance_less_dark": curves.excess[0],
        "variance_uncertainty": np.std(curves.excess[1:], axis=0),
        "deviation_percent": 100 * result.linearity.deviation[0],
        "snr": signal / np.sqrt(np.maximum(curves.variance[0], 1 / 12)),
        "snr_of_light": input_snr(curves)[0],
        "snr_linear_model": linear_snr(result.transfer, curves.light[0]),
        "snr_total": total_snr(result.transfer, result.numbers, curves.light[0]),
    }


def _spectra(which: str, pattern: FixedPattern) -> Iterator[list[str]]:
    for spectrogram in pattern.spectrograms:
        for frequency, amplitude in zip(spectrogram.frequencies, spectrogram.amplitude, strict=True):
            yield [which, spectrogram.direction, f"{frequency:.6g}", f"{amplitude:.6g}", pattern.unit]


def _histogram(which: str, pattern: FixedPattern) -> Iterator[list[str]]:
    shown = pattern.defects.histogram
    for centre, count, model in zip(shown.centres, shown.counts, shown.model, strict=True):
        yield [which, f"{centre:.6g}", pattern.unit, str(int(count)), f"{model:.6g}"]


def summary_xml(result: SensorFiles) -> bytes:
    """The numbers as the reference program arranges them, by sections and quantities, with planes above and intervals
    in addition."""
    top = ElementTree.Element("results", {"standard": "EMVA 1288", "release": "4.0"})
    if result.camera:
        ElementTree.SubElement(top, "camera").text = result.camera
    for plane in result.planes:
        of = ElementTree.SubElement(top, "plane", {"name": plane.name, "verdict": str(plane.outcome.verdict)})
        if plane.outcome.value is None:
            ElementTree.SubElement(of, "reason").text = plane.outcome.reason
            continue
        for section, beginnings in SECTIONS.items():
            part = ElementTree.SubElement(of, section)
            for quantity, number in plane.outcome.value.numbers.items():
                if quantity.startswith(beginnings):
                    item = ElementTree.SubElement(part, quantity)
                    texts = {
                        "unit": number.unit, "value": f"{number.value:.9g}", "uncertainty": f"{number.uncertainty:.6g}",
                        "low": f"{number.low:.9g}", "high": f"{number.high:.9g}", "method": number.method,
                    }  # fmt: skip
                    for name, text in texts.items():
                        ElementTree.SubElement(item, name).text = text
    ElementTree.indent(top, " ")
    data: bytes = ElementTree.tostring(top, encoding="utf-8", xml_declaration=True)
    return data + b"\n"
