"""Terms of a result: unit of frequencies, requested frequencies of the MTF, specification."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from procedures.numbers import name_at
from procedures.outcome import BadParameter
from station.results.comparison import Comparison, Compliance, Judgement, worst
from station.results.limits import BOTH, Specification, Spot, compare
from station.results.plane_result import PlaneResult
from station.results.units import Frequency, Pixels, Unit


@dataclass(frozen=True)
class Terms:
    """Requests in addition to the estimate.

    unit : of every frequency in terminal, page, tables and record
    at : where the MTF is reported
    specification : limits of the numbers; may be empty
    """

    unit: Unit = Unit.CYCLES
    at: Sequence[Frequency] = ()
    specification: Specification = field(default_factory=Specification)

    def frequencies(self, pixels: Pixels) -> tuple[float, ...]:
        """Where the MTF has to be known, in cycles per pixel of the plane. Raises BadParameter as `Pixels.factor`."""
        pixels.factor(self.unit)  # an unknown unit is refused before the work
        asked = (*self.at, *self.specification.frequencies)
        return tuple(sorted({one.per_pixel(pixels) for one in asked}))

    def with_known_unit(self, pixels: Pixels) -> "Terms":
        """The terms, in cycles per pixel if the data for the unit are unknown."""
        try:
            pixels.factor(self.unit)
        except BadParameter:
            return replace(self, unit=Unit.CYCLES)
        return self

    def apply(self, record: PlaneResult, pixels: Pixels, spots: Sequence[Spot] = ()) -> PlaneResult:
        """A plane's result, compared with the specification, in the unit."""
        comparison = compare(record, self.specification, pixels, spots)
        compared = replace(record, specification=comparison) if self.specification.limits else record
        return replace(compared, unavailable=tuple(self._unavailable(record, pixels))).in_unit(self.unit, pixels)

    def _unavailable(self, record: PlaneResult, pixels: Pixels) -> Iterator[str]:
        """A sentence for each frequency asked for at which a plane that has numbers has no MTF."""
        for one in self.at if record.numbers else ():
            wanted = one.per_pixel(pixels)
            if any(name_at(wanted, direction) in record.numbers for direction in ("", *BOTH)):
                continue
            reason = "it is beyond the measured range"
            if record.psf is not None and wanted > record.psf.s / 2:
                last = record.psf.s / 2 * pixels.factor(one.unit)
                reason = (
                    f"a PSF of s = {record.psf.s} ends at {last:.4g} {one.unit}; "
                    f"ask for less, or give s = {math.ceil(2 * wanted)} or more"
                )
            yield f"no MTF is reported at {one.value:g} {one.unit}: {reason}"

    def undecided(self, record: PlaneResult, reason: str) -> PlaneResult:
        """A plane's result that cannot be compared with the specification, with the reason."""
        words = f"the specification cannot be judged: {reason}"
        judgement = Judgement("", Compliance.UNDECIDED, None, 0.0, None, None, "", "", words)
        return replace(record, specification=Comparison(Compliance.UNDECIDED, (judgement,)))

    def parameters(self) -> dict[str, Any]:
        """Entries of a record's parameters; empty for the default."""
        return {"unit": str(self.unit)} if self.unit is not Unit.CYCLES else {}

    def specified(self, planes: Sequence[PlaneResult]) -> dict[str, Any] | None:
        """Specification of a record with the verdict; None without limits."""
        if not self.specification.limits:
            return None
        verdict = specification_verdict(planes)
        return {"verdict": verdict and str(verdict), **self.specification.to_record()}


USUAL = Terms()


def specification_verdict(planes: Sequence[PlaneResult]) -> Compliance | None:
    """The worst of the planes' verdicts against their specification; None where no limit holds for any."""
    judged = [plane.specification.judged for plane in planes if plane.specification and plane.specification.judged]
    return worst(judged) if judged else None
