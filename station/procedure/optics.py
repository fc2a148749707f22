"""Settings of procedures whose results depend on pixel pitch, aperture and wavelength."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from procedures.raw import RawFrame
from procedures.reading.exposure import Exposure, check_typed
from station.calibration.planes import Limit, diffraction_limit
from station.common.sanitise import printable
from station.procedure.base import PlaneSettings
from station.procedure.settings import setting
from station.results.units import Pixels, pixels_of

INSIST = "add --trust-typed, or in a procedure file write trust_typed = true"


class OpticsReading(PlaneSettings, frozen=True, kw_only=True):
    """Planes of photographs, and the optics that they were taken with."""

    pixel_pitch_um: Annotated[float, setting("Of the sensor, for the diffraction limit.", least=0.1)] | None = None
    f_number: Annotated[float, setting("The aperture.  [default: as the camera noted it]", least=0.1)] | None = None
    wavelength_nm: Annotated[float, setting("[default: R 600, G 530, B 460, Y 550]", least=100)] | None = None
    trust_typed: Annotated[
        bool, setting("Take --f-number and --pixel-pitch-um against what the camera noted.")
    ] = False  # fmt: skip

    @property
    def optics(self) -> dict[str, Any]:
        """Pitch, aperture and wavelength by name."""
        return {name: getattr(self, name) for name in ("pixel_pitch_um", "f_number", "wavelength_nm")}

    def read(self, path: Path) -> RawFrame:
        """The planes asked for. Raises ProcedureError, and where what was typed contradicts what the camera noted."""
        frame = super().read(path)
        if not self.trust_typed:
            check_typed(frame.exposure, self.optics, printable(path), INSIST)
        return frame

    def limit(self, exposure: Exposure, *, needed: bool = False) -> Limit:
        """The diffraction limit of each plane; it raises BadParameter where it is needed and not known."""
        return partial(diffraction_limit, exposure, needed=needed, **self.optics)

    def pixels(self, frame: RawFrame) -> Mapping[str, Pixels]:
        """The pixels of each plane."""
        return pixels_of(frame, self.pixel_pitch_um)

    def plane_pixels(self, frame: RawFrame) -> Pixels:
        """The pixels of the planes, which are alike."""
        return next(iter(self.pixels(frame).values()))

    def given(self) -> dict[str, Any]:
        """The values stated, for the record."""
        values = {name: value for name, value in self.optics.items() if value is not None}
        if self.raw is not None:
            values["raw"] = str(self.layout)
        return values | ({"trust_typed": True} if self.trust_typed else {})
