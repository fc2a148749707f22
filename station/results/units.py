"""Units of frequencies. Everything is computed in cycles per pixel of the plane. `PlaneResult.in_unit` converts a
result once, before it is written, so that files, page and terminal agree."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from procedures.numbers import frequency_of, name_at
from procedures.outcome import BadParameter, Quantity
from procedures.raw import RawFrame


class Unit(StrEnum):
    """Unit of frequencies: per pixel of the plane, per millimetre of the sensor, per height of the picture."""

    CYCLES = "cycles/pixel"
    LINE_PAIRS = "lp/mm"
    LINE_WIDTHS = "lw/ph"


def unit_in(text: str) -> Unit:
    """The unit named in the heading of a table; cycles per pixel without one."""
    return next((one for one in Unit if one in text), Unit.CYCLES)


@dataclass(frozen=True)
class Pixels:
    """The pixels in which the frequencies of a plane are counted.

    pitch : pixels of the sensor per pixel of the plane
    pitch_um : pitch of the sensor's pixels, if known
    height : pixels of the plane along the frame's shorter side
    """

    pitch: int = 1
    pitch_um: float | None = None
    height: int | None = None

    def factor(self, unit: Unit) -> float:
        """One cycle per pixel of the plane in a unit. Raises BadParameter where what it needs is not known."""
        if unit is Unit.CYCLES:
            return 1.0
        if unit is Unit.LINE_PAIRS:
            if not self.pitch_um:
                raise BadParameter(
                    "lp/mm needs the pitch of the sensor's pixels, which the camera did not note",
                    "give --pixel-pitch-um (in a procedure file optics.pixel_pitch_um), or another unit",
                )
            return 1000 / (self.pitch * self.pitch_um)
        if not self.height:
            raise BadParameter("lw/ph needs the size of the frame, which is not known here", "choose another unit")
        return 2.0 * self.height

    @property
    def words(self) -> str:
        """Which pixel is meant: of a mosaic's plane two of the sensor's."""
        if self.pitch == 1:
            return "of the sensor"
        return (
            f"of the colour plane, whose pixel is {self.pitch} of the sensor (per sensor pixel 1/{self.pitch} as much)"
        )


def pixels_of(frame: RawFrame, pitch_um: float | None = None) -> dict[str, Pixels]:
    """The pixels of every plane of a photograph; a pitch that is given counts before the camera's own."""
    known = pitch_um or frame.exposure.pixel_pitch_um
    return {name: Pixels(plane.pitch, known, min(plane.samples.shape)) for name, plane in frame.planes.items()}


@dataclass(frozen=True)
class Frequency:
    """A frequency as it was asked for."""

    value: float
    unit: Unit = Unit.CYCLES

    def per_pixel(self, pixels: Pixels) -> float:
        """The frequency in cycles per pixel of the plane, in six digits. Raises BadParameter as `Pixels.factor`."""
        return float(f"{self.value / pixels.factor(self.unit):.6g}")


def convert_quantity(quantity: Quantity, unit: Unit, factor: float) -> Quantity:
    """A number in a unit; those that are no frequencies stay."""
    if quantity.unit != Unit.CYCLES:
        return quantity
    return replace(quantity, value=quantity.value * factor, uncertainty=quantity.uncertainty * factor, unit=str(unit))


def convert_name(name: str, factor: float) -> str:
    """The name of a number with the frequency in it, where it has one, in the unit."""
    frequency = frequency_of(name)
    return name if frequency is None else name_at(frequency[0] * factor, frequency[1])


def convert_numbers(numbers: Mapping[str, Quantity], unit: Unit, factor: float) -> dict[str, Quantity]:
    """All numbers in a unit: their names, values, uncertainties and methods."""
    converted = {}
    for name, number in numbers.items():
        own = convert_quantity(number, unit, factor)
        if at := frequency_of(name):
            own = replace(own, method=own.method.replace(f"{at[0]:.6g} cycles/pixel", f"{at[0] * factor:.6g} {unit}"))
        converted[convert_name(name, factor)] = own
    return converted
