"""Result of one plane, from which files, page, screen and index are made."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from procedures.numbers import GAUSSIAN_RADIUS, MTF50_RADIAL, NUMBERS, RADIAL, Group, frequency_of, in_group, label
from procedures.numerics.arrays import Array
from procedures.outcome import Cause, Outcome, Quantity, Verdict, WithVerdict
from procedures.psf import Psf
from procedures.reading.exposure import Exposure
from station.common.sanitise import stated
from station.results.comparison import Comparison
from station.results.exports import gaussian_radius
from station.results.units import Pixels, Unit, convert_name, convert_numbers, convert_quantity

if TYPE_CHECKING:
    from procedures.choice import Trial
    from procedures.cross_check.estimate import EdgeCheck
    from procedures.pattern_psf.error_parts import Variation
    from procedures.physics.estimate import Physics
    from procedures.quality import Diffraction, Quality
    from procedures.sensor.information import Information


@dataclass(frozen=True, eq=False)
class PlaneResult:
    """Result of one plane.

    A refused one has a reason, a remedy and no PSF. One read from files has verdict, numbers, curves and samples.

    reason, remedy : the most likely cause of the verdict; `other_causes` are less likely ones
    numbers : every number with its unit and standard uncertainty, by name
    curves : the MTF as columns of (n,): frequency, and by direction the value and its uncertainty
    samples : (k, k) of the PSF's support, sum 1
    values : numbers without an uncertainty
    diagnostics : numbers on which the verdict is based
    pitch : sensor pixels per pixel of the plane; 0 if no number is in pixels of the plane
    estimate : the complete estimate, for figures
    psf, quality : the PSF with its covariance, and its numbers with budgets
    inter_image : the kernel between two photographs
    choice : tried values of s and k, the last one chosen
    variations : numbers that differ in the halves of the chart
    edges : the chart's slanted edges, for comparison with the PSF
    diffraction : the diffraction limit, if f-number and pitch are known
    physics : the physical model of the PSF, if requested
    information : NPS and NEQ, if the noise of the sensor is known
    exposure : settings recorded by the camera
    place : place in the frame, as named by limits; empty if unknown
    unit, factor : unit of frequencies, and one cycle per pixel of the plane in it
    specification : comparison with limits; None without limits
    details : further entries of the plane in the record
    unavailable : a sentence for each requested frequency without an MTF
    """

    name: str
    verdict: Verdict
    reason: str = ""
    remedy: str = ""
    numbers: Mapping[str, Quantity] = field(default_factory=dict)
    curves: Mapping[str, Array] = field(default_factory=dict)
    samples: Array | None = None
    values: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    pitch: int = 1
    estimate: Any = None
    psf: Psf | None = None
    quality: Quality | None = None
    inter_image: Array | None = None
    choice: tuple[Trial, ...] = ()
    variations: tuple[Variation, ...] = ()
    edges: tuple[EdgeCheck, ...] = ()
    diffraction: Diffraction | None = None
    physics: Outcome[Physics] | None = None
    information: Information | None = None
    exposure: Exposure | None = None
    place: str = ""
    unit: Unit = Unit.CYCLES
    factor: float = 1.0
    specification: Comparison | None = None
    unavailable: tuple[str, ...] = ()
    duration_s: float = 0.0
    details: Mapping[str, Any] = field(default_factory=dict)
    other_causes: tuple[Cause, ...] = ()

    @classmethod
    def of_outcome(cls, name: str, outcome: WithVerdict, **more: Any) -> PlaneResult:
        """The result with the verdict and the causes of an outcome; `more` are further attributes."""
        more["other_causes"] = outcome.other_causes
        return cls(name, outcome.verdict, outcome.reason, outcome.remedy, **more)

    def outcome(self, value: Any) -> Outcome[Any]:
        """Its verdict and causes as the outcome of a value."""
        return Outcome(value, self.verdict, self.reason, self.remedy, self.other_causes)

    @classmethod
    def of(cls, name: str, verdict: Verdict, psf: Psf, quality: Quality | None = None, **more: Any) -> PlaneResult:
        """The result of a PSF and its numbers; `more` are further attributes."""
        pitch = more.get("pitch", 1)
        numbers, curves = ({}, {}) if quality is None else (dict(numbers_of(quality, pitch)), curves_of(quality))
        return cls(name, verdict, numbers=numbers, curves=curves, samples=psf.h, psf=psf, quality=quality, **more)

    def quantity(self, name: str) -> Quantity | None:
        """A number by its name; one without an uncertainty has an uncertainty of 0, and the unit of the table."""
        plain = self.values.get(name)
        if name in self.numbers or not isinstance(plain, int | float):
            return self.numbers.get(name)
        return Quantity(float(plain), NUMBERS[name].unit if name in NUMBERS else "1", 0.0, "", 0)

    def in_unit(self, unit: Unit, pixels: Pixels) -> PlaneResult:
        """The result with frequencies in another unit. Raises BadParameter as `Pixels.factor`."""
        factor = pixels.factor(unit)
        if factor == 1:
            return self
        curves = {name: column * factor if name == "frequency" else column for name, column in self.curves.items()}
        variations = (replace(one, values=(one.values[0] * factor, one.values[1] * factor)) for one in self.variations)
        edges = (
            replace(edge, by_edge=convert_quantity(edge.by_edge, unit, factor),
                    by_psf=convert_quantity(edge.by_psf, unit, factor))
            for edge in self.edges
        )  # fmt: skip
        return replace(
            self,
            numbers=convert_numbers(self.numbers, unit, factor),
            curves=curves,
            quality=self.quality and _quality_in(self.quality, unit, factor),
            variations=tuple(variations),
            edges=tuple(edges),
            unit=unit,
            factor=factor,
        )


def _quality_in(quality: Quality, unit: Unit, factor: float) -> Quality:
    """Numbers and budgets in a unit; the curves stay as they were estimated."""
    scaled = {name for name, number in quality.numbers.items() if number.unit == Unit.CYCLES}
    budgets = {
        convert_name(name, factor): {term: u * (factor if name in scaled else 1) for term, u in terms.items()}
        for name, terms in quality.budgets.items()
    }
    return replace(quality, numbers=convert_numbers(quality.numbers, unit, factor), budgets=budgets)


def numbers_of(quality: Quality, pitch: int) -> Iterator[tuple[str, Quantity]]:
    """The numbers, and what follows from them for RAW developers."""
    yield from quality.numbers.items()
    if MTF50_RADIAL in quality.numbers:
        yield GAUSSIAN_RADIUS, gaussian_radius(quality.numbers[MTF50_RADIAL], pitch)


def curves_of(quality: Quality) -> dict[str, Array]:
    """The MTF along both axes and its mean over directions, each with its standard uncertainty."""
    return {
        "frequency": quality.frequencies,
        "horizontal": quality.mtf_horizontal,
        "horizontal_uncertainty": quality.uncertainty("horizontal"),
        "vertical": quality.mtf_vertical,
        "vertical_uncertainty": quality.uncertainty("vertical"),
        "radial": quality.mtf_radial,
        "radial_uncertainty": quality.uncertainty("radial"),
    }


def line_numbers(plane: PlaneResult) -> list[str]:
    """The numbers of the group LINE and the MTF at requested frequencies: "MTF50 0.412 ± 0.003 cycles/pixel"."""
    requested = [name for name in plane.numbers if (at := frequency_of(name)) and at[1] != RADIAL]
    lines = []
    for name in (*in_group(Group.LINE, {**plane.numbers, **plane.values}), *requested):
        if (number := plane.quantity(name)) is not None:
            words = f"{label(name, plane.unit)} {stated(number.value, number.uncertainty)}"
            lines.append(f"{words} {number.unit}" if number.unit != "1" else words)
    return lines
