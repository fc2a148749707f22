"""In what terms a result is told: the unit of its frequencies, those at which its MTF is told, what it is held to."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from procedures.numbers import name_at
from procedures.outcome import BadParameter
from station.results.comparison import Comparison, Judged, Judgement, worst
from station.results.limits import BOTH, Specification, Spot, compare
from station.results.plane_result import PlaneResult
from station.results.units import Frequency, Pixels, Unit


@dataclass(frozen=True)
class Terms:
    """What was asked for beside the estimate itself.

    Attributes
    ----------
    unit : Unit
        Of every frequency in terminal, page, tables and record.
    at : sequence of Frequency
        Where the MTF is told.
    specification : Specification
        What the numbers are held to; without limits where there is none.
    """

    unit: Unit = Unit.CYCLES
    at: Sequence[Frequency] = ()
    specification: Specification = field(default_factory=Specification)

    def frequencies(self, pixels: Pixels) -> tuple[float, ...]:
        """Where the MTF has to be known, in cycles per pixel of the plane. Raises BadParameter as `Pixels.factor`."""
        pixels.factor(self.unit)  # what cannot be told in the end is refused before the work
        asked = (*self.at, *self.specification.frequencies)
        return tuple(sorted({one.per_pixel(pixels) for one in asked}))

    def tellable(self, pixels: Pixels) -> Terms:
        """The same, in cycles per pixel where what the unit needs is not known."""
        try:
            pixels.factor(self.unit)
        except BadParameter:
            return replace(self, unit=Unit.CYCLES)
        return self

    def told(self, record: PlaneResult, pixels: Pixels, spots: Sequence[Spot] = ()) -> PlaneResult:
        """A plane's result, compared with the specification and told in the unit."""
        found = compare(record, self.specification, pixels, spots)
        compared = replace(record, specification=found) if self.specification.limits else record
        return replace(compared, untold=tuple(self._untold(record, pixels))).in_unit(self.unit, pixels)

    def _untold(self, record: PlaneResult, pixels: Pixels) -> Iterator[str]:
        """A sentence for each frequency asked for at which a plane that has numbers has no MTF."""
        for one in self.at if record.numbers else ():
            wanted = one.per_pixel(pixels)
            if any(name_at(wanted, direction) in record.numbers for direction in ("", *BOTH)):
                continue
            reason = "it is beyond what was measured"
            if record.psf is not None and wanted > record.psf.s / 2:
                last = record.psf.s / 2 * pixels.factor(one.unit)
                reason = (
                    f"a PSF of s = {record.psf.s} ends at {last:.4g} {one.unit}; "
                    f"ask for less, or give s = {math.ceil(2 * wanted)} or more"
                )
            yield f"no MTF is reported at {one.value:g} {one.unit}: {reason}"

    def undecided(self, record: PlaneResult, reason: str) -> PlaneResult:
        """A plane's result that cannot be held to the specification, with the reason."""
        words = f"the specification cannot be judged: {reason}"
        judgement = Judgement("", Judged.UNDECIDED, None, 0.0, None, None, "", "", words)
        return replace(record, specification=Comparison(Judged.UNDECIDED, (judgement,)))

    def parameters(self) -> dict[str, Any]:
        """What a record's parameters tell of them, where it is not the usual."""
        return {"unit": str(self.unit)} if self.unit is not Unit.CYCLES else {}

    def specified(self, planes: Sequence[PlaneResult]) -> dict[str, Any] | None:
        """What a record tells of its specification: all of it, and the verdict; None where there is none."""
        if not self.specification.limits:
            return None
        verdict = specification_verdict(planes)
        return {"verdict": verdict and str(verdict), **self.specification.told()}


USUAL = Terms()


def specification_verdict(planes: Sequence[PlaneResult]) -> Judged | None:
    """The worst of the planes' verdicts against their specification; None where no limit holds for any."""
    judged = [one.specification.judged for one in planes if one.specification and one.specification.judged]
    return worst(judged) if judged else None


def comparison_of(entry: Mapping[str, Any]) -> Comparison | None:
    """What a plane's entry in a record tells of its specification; None where it tells nothing that can be read."""
    told = entry.get("specification")
    if not isinstance(told, dict) or not isinstance(told.get("limits"), list):
        return None
    try:
        judged = Judged(told["verdict"]) if told.get("verdict") else None
        judgements = [
            Judgement(
                one["number"], Judged(one["verdict"]), one["value"], one["uncertainty"], one["min"], one["max"],
                one["unit"], one["place"], str(one["words"]),
            )
            for one in told["limits"]
        ]  # fmt: skip
    except (KeyError, TypeError, ValueError):
        return None
    return Comparison(judged, tuple(judgements))
