"""Vignetting and colour shading from flats."""

from collections.abc import Sequence
from pathlib import Path

from station.calibration.vignetting import measure_flats, vignetting_measurement
from station.common.progress import Progress
from station.procedure.base import Inputs, Procedure, Settings
from station.results.measurement import Measurement


class Vignetting(Procedure[Settings]):
    """Light that is lost towards the corners, by plane."""

    name = "vignetting"
    title = "vignetting and colour shading"
    help = """Measure vignetting and colour shading from FLAT..., photographs of even light; a folder stands for its
    own.

    Turn the camera, or the light, by 180 or 90 degrees about the axis between the flats: this separates a slope of the
    light from the lens. Expose to half of the scale."""
    inputs = Inputs.PHOTOGRAPHS
    argument = "FLAT..."
    drawn_by = "field.camera_section:vignetting_page"
    method = "polynomial falloff of the lens fitted with the light's slope, by plane"

    def measured(self, paths: Sequence[Path], settings: Settings, progress: Progress) -> Measurement:
        return vignetting_measurement(measure_flats(paths, progress))
