"""The guided procedures by name: their plans, and who writes their results."""

from __future__ import annotations

import importlib
from dataclasses import dataclass

from procedures.outcome import BadParameter
from procedures.plan import Plan


@dataclass(frozen=True)
class Entry:
    """A plan: where it is, and what it is in a few words.

    A plan without a PSF names the module under `station` whose `write_result(folder, outcomes, frames, about, results)`
    writes its result.
    """

    module: str
    title: str
    writer: str = ""


PLANS = {
    "pattern": Entry(
        "procedures.pattern_psf.plan",
        "the PSF from a printed noise chart",
    ),
    "two-photo": Entry(
        "procedures.two_photo.plan",
        "the PSF from two photographs of a textured wall",
    ),
    "field": Entry(
        "station.guide.field_plan",
        "the PSF over the whole frame, from the chart at many places",
        writer="station.reports.field_files",
    ),
    "restoration": Entry(
        "procedures.restoration.plan",
        "picture and depth from two blurred photographs",
        writer="station.reports.restoration_files",
    ),
}
DEFAULT = "pattern"


def _entry(name: str) -> Entry:
    if name not in PLANS:
        raise BadParameter(f"there is no plan {name!r}", f"choose one of {', '.join(PLANS)}")
    return PLANS[name]


def plan_named(name: str) -> Plan:
    """The plan of that name, imported now. Raises BadParameter."""
    plan: Plan = importlib.import_module(_entry(name).module).plan()
    return plan


def writer_of(name: str) -> str:
    """The module that writes a plan's result, "" where that is a PSF. Raises BadParameter."""
    return _entry(name).writer
