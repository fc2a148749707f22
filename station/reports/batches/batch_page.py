"""The page of a batch: both verdicts counted, what is wrong with which photograph, and the numbers by camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import MaxNLocator

from procedures.numbers import label
from station.drawing.colours import FAINT, INK, PLANE_COLOURS
from station.drawing.style import axes_grid, svg
from station.reports.page import render

MOST_LINES = 500
"""Photographs in the page's table; summary.csv has all."""
ROOM = 18
"""Characters of a camera's name beside a figure."""


@dataclass(frozen=True)
class BatchLine:
    """One item: its files, both verdicts, what speaks against it, and its folder, from the page's."""

    files: str
    measurement: str
    specification: str
    against: str
    folder: str
    page: bool = False


@dataclass(frozen=True)
class Sample:
    """One number of one item, with what it was taken with."""

    camera: str
    plane: str
    number: str
    value: float
    unit: str


@dataclass(frozen=True)
class BatchReport:
    """What the page tells.

    Attributes
    ----------
    measurements, specifications : mapping of verdict to count
    bounds : mapping of a number to the bounds that its limits set
    """

    title: str
    measurements: Mapping[str, int]
    specifications: Mapping[str, int]
    lines: Sequence[BatchLine]
    samples: Sequence[Sample] = ()
    bounds: Mapping[str, Sequence[float]] = field(default_factory=dict)
    undone: int = 0


@dataclass(frozen=True)
class _Spread:
    """A number of a camera's plane over all items."""

    camera: str
    plane: str
    words: str
    n: int
    median: float
    least: float
    greatest: float
    unit: str


def batch_page(report: BatchReport) -> str:
    """The page as HTML, its pictures inside, the results beside it linked."""
    numbers = dict.fromkeys(one.number for one in report.samples)
    figures = [
        (label(name), _distribution([one for one in report.samples if one.number == name], name, report))
        for name in numbers
    ]
    shown = report.lines[:MOST_LINES]
    return render(
        "batch.html", report=report, lines=shown, more=len(report.lines) - len(shown), figures=figures,
        spreads=list(_spreads(report.samples)),
    )  # fmt: skip


def _grouped(samples: Sequence[Sample]) -> dict[tuple[str, str, str], list[Sample]]:
    groups: dict[tuple[str, str, str], list[Sample]] = {}
    for one in samples:
        groups.setdefault((one.camera, one.plane, one.number), []).append(one)
    return groups


def _spreads(samples: Sequence[Sample]) -> list[_Spread]:
    found = []
    for (camera, plane, number), group in sorted(_grouped(samples).items()):
        values = np.array([one.value for one in group])
        told = float(np.median(values)), float(values.min()), float(values.max())
        found.append(_Spread(camera, plane, label(number), len(group), *told, group[0].unit))
    return found


def _distribution(samples: Sequence[Sample], name: str, report: BatchReport) -> Markup:
    """Every item's number as a point, a row for each camera and plane, with the medians and the limits."""
    groups = _grouped(samples)
    left_in = 1.6 if len({camera for camera, *_ in groups}) > 1 else 0.4
    figure, ((axes,),) = axes_grid(4.6, 0.9 + 0.28 * len(groups), rim_in=(left_in, 0.25, 0.42, 0.08))
    for row, ((_, plane, _), group) in enumerate(groups.items()):
        values = np.array([one.value for one in group])
        axes.plot(values, np.full(len(values), row), "|", ms=9, mew=1, color=PLANE_COLOURS.get(plane, INK), alpha=0.7)
        axes.plot(np.median(values), row, "o", ms=4, color=INK)
    for bound in report.bounds.get(name, ()):
        axes.axvline(bound, color=FAINT, lw=1, ls=(0, (3, 2)))
    several = len({camera for camera, *_ in groups}) > 1
    labels = [f"{_cut(camera)} {plane}".strip() if several else plane for camera, plane, _ in groups]
    axes.set_yticks(range(len(groups)), labels)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.set_ylim(len(groups) - 0.5, -0.5)
    unit = samples[0].unit
    axes.set_xlabel(unit if unit != "1" else "")
    return svg(figure, f"batch-{name.replace('.', '-')}", f"{label(name)} of every photograph, by camera and plane")


def _cut(camera: str) -> str:
    """A camera's name as far as there is room beside a figure."""
    return camera if len(camera) <= ROOM else f"{camera[: ROOM - 1].rstrip()}…"
