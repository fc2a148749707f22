"""A sensor's report: every number with its interval, and the plots that EMVA 1288 asks for, on one page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from markupsafe import Markup

from procedures.numbers import Group, in_group
from procedures.sensor.estimate import FixedPattern, SensorResult
from procedures.sensor.measured import IntervalNumber
from procedures.sensor.spectrograms import Period
from station.calibration.sensor import SensorFiles, SensorPlane
from station.common.versions import software
from station.reports import sensor_figures as figures
from station.reports.page import render

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
        inputs=found.files,
        missed=found.missed,
        planes=[_view(plane) for plane in found.planes],
        software=software(),
    ).encode()


def _view(plane: SensorPlane) -> PlaneView:
    found = plane.outcome.value
    if found is None:
        return PlaneView(plane.name, plane, [], [], [], [], 0)
    rows = [(one.label, found.numbers[one]) for one in in_group(Group.HEADLINE, found.numbers)]
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


def _spatial(patterns: Mapping[str, FixedPattern], name: str) -> list[tuple[Markup, str]]:
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
