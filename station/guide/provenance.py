"""Provenance of the input numbers of a result, and the evidence with which each was compared.

A number that agrees with the camera's metadata has the camera as its source; any other has the operator. Laser, rail,
tape, chart cells and the far tail of the PSF are evidence only, since they cannot always decide.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from procedures.pattern_psf.distance.consistency import measured_scale
from procedures.pattern_psf.estimate import PUPIL_SPREAD
from procedures.pattern_psf.facts import SIZES, PatternFacts
from procedures.plan import INSISTED, Facts, Plan, facts_as
from procedures.quality import CAMERA, OPERATOR
from procedures.raw import RawFrame
from procedures.reading.exposure import TYPED

NAMES = {
    "focal_length_mm": "focal length", "pixel_pitch_um": "pixel pitch", "chart_width_mm": "width of the chart",
    "ruler_mm": "printed ruler", "chart_seed": "number of the chart", "typed_f_number": "f-number",
    "near_mm": "near distance", "first_f_number": "first f-number", "second_f_number": "second f-number",
    "third_f_number": "third f-number", "lens_f_number": "f-number of all", "focus_m": "distance of focus",
    "screw_count": "number of screws", "screw_radius_mm": "screws' radius", "screw_pitch_mm": "screws' pitch",
    "first_screw_deg": "place of the first screw",
}  # fmt: skip
NOTED = {
    "lens_f_number": ("f_number", 0),
    "first_f_number": ("f_number", 0),
    "second_f_number": ("f_number", 1),
    "third_f_number": ("f_number", 2),
}
"""Field of the camera's metadata and index of the photograph; by default the same name and the first photograph."""


@dataclass(frozen=True)
class Provenance:
    """Provenance of one number: value, source (`CAMERA`, `OPERATOR`), and the evidence compared with it, or ""."""

    value: float
    unit: str
    source: str
    evidence: str

    def record(self) -> dict[str, Any]:
        """Its entry in a record."""
        return {"value": self.value, "unit": self.unit, "source": self.source, "evidence": self.evidence}

    def __str__(self) -> str:
        given = f"{self.value:g} {self.unit}".rstrip()
        if self.source == CAMERA:
            return f"{given}, recorded by the camera"
        return f"{given}, given by the operator; {self.evidence or 'not verified'}"


def provenance_of(plan: Plan, facts: Facts, frames: Sequence[RawFrame]) -> dict[str, Provenance]:
    """Provenance of every known number of the plan, by its question's key; the frames hold the camera's metadata."""
    asks = plan.asks()
    known = {key: facts[key] for key in NAMES if key in asks and key in facts}
    if not known or not frames:
        return {}
    return {
        key: Provenance(float(value), asks[key].unit, *_source(key, float(value), facts, frames))
        for key, value in known.items()
        if isinstance(value, float | int) and value
    }


def _source(key: str, value: float, facts: Facts, frames: Sequence[RawFrame]) -> tuple[str, str]:
    field, which = NOTED.get(key, (key, 0))
    by_camera = asdict(frames[which].exposure).get(field) if which < len(frames) else None
    if by_camera and abs(value / by_camera - 1) <= TYPED[field][2]:
        return CAMERA, ""
    if facts.get(INSISTED + key):
        return OPERATOR, "confirmed by the operator despite a contradiction"
    return OPERATOR, EVIDENCE[key](facts) if key in EVIDENCE else ""


def _by_size(facts: Facts) -> str:
    """Evidence on lens, sensor and print: a measurement of their product."""
    known = facts_as(PatternFacts, facts)
    measured = measured_scale(known.looks)
    if measured is not None:
        return f"consistent with the {measured[1]} and the other sizes"
    if known.laser_offset_mm is not None:
        return "consistent with the laser and the other sizes"
    return "" if known.tape_mm is None else "consistent with the tape measure and the other sizes"


def _by_cells(facts: Facts) -> str:
    return "" if facts_as(PatternFacts, facts).seed_agreement is None else "consistent with the chart's cells"


def _by_tail(facts: Facts) -> str:
    f_number, u = facts.get("tail_f_number"), facts.get("tail_f_number_uncertainty")
    if not isinstance(f_number, float | int) or not isinstance(u, float | int):
        return ""
    return f"the far tail of the PSF gives {f_number:.1f} ± {np.hypot(u, PUPIL_SPREAD * f_number):.1f}"


def _by_laser(facts: Facts) -> str:
    laser_mm = facts.get("near_laser_mm")
    return f"the laser read {laser_mm / 1000:.2f} m" if isinstance(laser_mm, float | int) else ""


EVIDENCE: Mapping[str, Callable[[Facts], str]] = {
    **dict.fromkeys(SIZES, _by_size),
    "chart_seed": _by_cells,
    "typed_f_number": _by_tail,
    "near_mm": _by_laser,
}
