"""The sensor's tilt and backfocus, and the screws that correct them, from a focus bracket."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from procedures.raw import default_plane
from station.calibration.field_photographs import focus_positions, photographs
from station.common.progress import Progress
from station.procedure.base import ChartSettings, Inputs, Procedure, beside, setting, to_record
from station.results.measurement import Measurement
from station.results.record_head import InputFile, RecordHead

if TYPE_CHECKING:
    from procedures.tilt.estimate import TiltParameters


class TiltSettings(ChartSettings, frozen=True, kw_only=True):
    """The bracket, the optics, the screws."""

    focus: Annotated[Path, setting("A CSV table: photograph's name, position in mm.")]
    positions: Annotated[
        Literal["lens", "set", "chart"],
        setting("The positions are the lens's distance from the sensor (any zero), the distance set, or the chart's."),
    ] = "lens"
    position_uncertainty_mm: Annotated[float, setting("Of each.", least=0)] = 0.0
    nominal_mm: (
        Annotated[float, setting("Where the sensor should be in focus: gives the backfocus.", least=-1e5)] | None
    ) = None
    nominal_uncertainty_mm: Annotated[float, setting("Of that position.", least=0)] = 0.0
    focal_length_mm: Annotated[float, setting("[default: as the camera noted it]", least=0.1)] | None = None
    distance_mm: Annotated[float, setting("Of the chart, where the positions are not its.", least=1)] | None = None
    chart_tilt_deg: Annotated[
        float, setting("Standard uncertainty of the chart's squareness to the lens.", least=0, most=30)
    ] = 0.3
    pixel_pitch_um: Annotated[float, setting("Of the sensor.  [default: as the camera noted it]", least=0.1)] | None = (
        None
    )
    screws: Annotated[int, setting("That hold the sensor.", least=3, most=12)] = 3
    screw_radius_mm: Annotated[float, setting("Of their circle about the frame's centre.", least=1)]
    screw_pitch_mm: Annotated[float, setting("What a turn moves the sensor by.", least=0.01)]
    first_screw_deg: Annotated[
        float, setting("Place of the first, clockwise from the top, seen from behind the camera.", least=-360, most=360)
    ] = 0.0
    turn_uncertainty: Annotated[float, setting("Of a turn by hand.", least=0)] = 0.02
    frequency: Annotated[float, setting("Cycles per pixel.", least=0.01, most=1)] = 0.25

    def parameters(self, first: Path) -> TiltParameters:
        """The settings, completed from the first photograph's metadata. Raises BadParameter."""
        from procedures.tilt.estimate import TiltParameters
        from procedures.tilt.plane import Positions, Screws
        from station.calibration.tilt import known_optics

        pitch_um, focal_length_mm = known_optics(first, self.pixel_pitch_um, self.focal_length_mm)
        return TiltParameters(
            pitch_um,
            Positions(self.positions),
            focal_length_mm,
            distance_mm=self.distance_mm,
            position_uncertainty_mm=self.position_uncertainty_mm,
            chart_tilt_deg=self.chart_tilt_deg,
            nominal_mm=self.nominal_mm,
            nominal_uncertainty_mm=self.nominal_uncertainty_mm,
            frequency=self.frequency,
            screws=Screws(
                self.screws, self.screw_radius_mm, self.screw_pitch_mm, self.first_screw_deg, self.turn_uncertainty
            ),
        )


class TiltOfSensor(Procedure[TiltSettings]):
    """A focus bracket with charts at nine places of the frame."""

    name = "tilt"
    title = "the sensor against the surface of best focus"
    help = """Measure the sensor's tilt and backfocus from FOLDER, a focus bracket with charts at nine places of the
    frame.

    Reports how far and which way each screw of the sensor is to be turned, and the probability that this helps. Turn,
    take the bracket again, and run it again."""
    inputs = Inputs.FOLDER
    Settings = TiltSettings
    drawn_by = "tilt_page:tilt_page"
    method = "plane through the heights of best focus at the charts' places, by generalised least squares"

    def steps(self, paths: Sequence[Path]) -> int:
        return len(photographs(paths[0]))

    def measured(self, paths: Sequence[Path], settings: TiltSettings, progress: Progress) -> Measurement:
        from procedures.field.estimate import BRACKET
        from procedures.field.measuring import measure
        from station.calibration.tilt import check_known, measure_tilt, tilt_measurement

        (folder,) = paths
        frames = photographs(folder)
        positions = focus_positions(beside(settings.focus, folder), frames)
        frames = [path for path in frames if path.name in positions]
        parameters = settings.parameters(frames[0])
        check_known(parameters, positions)  # what is missing is reported before the work, not after it
        name = settings.plane_name or default_plane(frames[0], settings.layout)
        measured = measure(frames, [name], settings.source.chart, BRACKET, progress, settings.layout)
        result = measure_tilt(measured, name, positions, parameters)
        given = {
            **to_record(settings), "chart": settings.source.origin, "pixel_pitch_um": parameters.pixel_pitch_um,
            "focal_length_mm": parameters.focal_length_mm,
        }  # fmt: skip
        head = RecordHead(self.name, tuple(InputFile(str(path), sha256) for path, sha256 in measured.frames), given)
        return tilt_measurement(head, name, result, measured.misses)

    def lines(self, measurement: Measurement) -> list[str]:
        from station.calibration.tilt import screw_lines

        (plane,) = measurement.planes
        return [] if plane.estimate is None else screw_lines(plane.estimate)
