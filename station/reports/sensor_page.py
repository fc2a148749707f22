"""A sensor's report: every number with its interval, and the plots that EMVA 1288 asks for, on one page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from markupsafe import Markup

from procedures.sensor.estimate import Pattern, SensorResult
from procedures.sensor.measured import IntervalNumber
from procedures.sensor.spectrograms import Period
from station.calibration.sensor import SensorFiles, SensorPlane
from station.common.versions import software
from station.reports import sensor_figures as figures
from station.reports.page import render

TITLES = {
    "quantum_efficiency": "Quantum efficiency η",
    "system_gain": "System gain K",
    "system_gain_at_dark": "System gain K of small signals",
    "temporal_dark_noise": "Temporal dark noise σ_d",
    "temporal_dark_noise_dn": "Temporal dark noise",
    "sensitivity_threshold": "Absolute sensitivity threshold",
    "sensitivity_threshold_photons": "Absolute sensitivity threshold",
    "saturation_capacity": "Saturation capacity",
    "saturation_photons": "Light at saturation",
    "saturation_signal": "Signal at saturation",
    "snr_max": "Largest SNR",
    "snr_max_db": "Largest SNR",
    "dynamic_range": "Dynamic range",
    "dynamic_range_db": "Dynamic range",
    "linearity_error": "Linearity error",
    "linearity_error_min": "Lowest deviation",
    "linearity_error_max": "Highest deviation",
    "dark_current": "Dark current, by mean",
    "dark_current_by_variance": "Dark current, by variance",
    "dsnu": "DSNU",
    "dsnu_row": "DSNU of rows",
    "dsnu_column": "DSNU of columns",
    "dsnu_pixel": "DSNU of pixels",
    "dsnu_without_defects": "DSNU, defects left out",
    "prnu": "PRNU",
    "prnu_row": "PRNU of rows",
    "prnu_column": "PRNU of columns",
    "prnu_pixel": "PRNU of pixels",
    "prnu_without_defects": "PRNU, defects left out",
    "prnu_highpass": "PRNU, uneven light taken out",
    "defect_pixels_dark": "Defect pixels in the dark",
    "defect_pixels_light": "Defect pixels in even light",
    "general_snr_max": "General model: largest SNR",
    "general_threshold": "General model: threshold",
    "general_dynamic_range": "General model: dynamic range",
}
"""The numbers that the page tells, in their order; `numbers.csv` holds all."""
MOST_DEFECTS = 40


@dataclass(frozen=True)
class PlaneView:
    """What the page shows of a plane."""

    name: str
    plane: SensorPlane
    rows: list[tuple[str, IntervalNumber]]
    figures: list[tuple[Markup, str]]
    periods: list[tuple[str, Period]]
    defects: list[tuple[str, int, int, float, str]]
    untold: int


def sensor_page(found: SensorFiles) -> bytes:
    """The page, UTF-8, with its figures inside."""
    return render(
        "sensor.html",
        camera=found.camera,
        inputs=found.inputs,
        missed=found.missed,
        planes=[_view(plane) for plane in found.planes],
        software=software(),
    ).encode()


def _view(plane: SensorPlane) -> PlaneView:
    found = plane.outcome.value
    if found is None:
        return PlaneView(plane.name, plane, [], [], [], [], 0)
    rows = [(title, found.numbers[name]) for name, title in TITLES.items() if name in found.numbers]
    patterns = {which: one for which, one in (("dark", found.dark), ("light", found.light)) if one is not None}
    defects = [
        (which, int(row), int(column), float(deviation), one.unit)
        for which, one in patterns.items()
        for (row, column), deviation in zip(one.defects.places, one.defects.deviation, strict=True)
    ]
    periods = [(figures.period_words(period), period) for one in patterns.values() for period in one.periods]
    drawn = [*_temporal(found, plane.name), *_spatial(patterns, plane.name)]
    return PlaneView(
        plane.name, plane, rows, drawn, periods, defects[:MOST_DEFECTS], max(0, len(defects) - MOST_DEFECTS)
    )


def _temporal(found: SensorResult, name: str) -> list[tuple[Markup, str]]:
    drawn = [
        (figures.transfer_figure(found, f"transfer-{name}"), "Photon transfer: the slope is K."),
        (figures.response_figure(found, f"response-{name}"), "Characteristic curve."),
        (figures.linearity_figure(found, f"linearity-{name}"), "Deviation from the line, with 95 % bars."),
        (figures.snr_figure(found, f"snr-{name}"), "Signal-to-noise ratio."),
    ]
    dark = figures.dark_figure(found, f"dark-{name}")
    return drawn if dark is None else [*drawn, (dark, "In the dark, over exposure, with 95 % bars.")]


def _spatial(patterns: Mapping[str, Pattern], name: str) -> list[tuple[Markup, str]]:
    words = {"dark": "Dark", "light": "Response"}
    drawn = []
    for which, one in patterns.items():
        place = f"{which}-{name}"
        drawn += [
            (
                figures.spectrogram_figure(one, f"spectrogram-{place}"),
                f"{words[which]}: spectrograms; dotted, periods.",
            ),
            (
                figures.histogram_figure(one, f"histogram-{place}"),
                f"{words[which]}: histogram; orange, limit of defects.",
            ),
            (figures.accumulated_figure(one, f"accumulated-{place}"), f"{words[which]}: accumulated histogram."),
        ]
    return drawn
