"""The geometry of a camera from photographs of the chart: intrinsics, distortion and poses with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from procedures.outcome import BadParameter
from procedures.pattern import BLOCK, BLOCKS
from station.common.progress import Progress
from station.procedure.base import ChartSettings, Inputs, Procedure, setting
from station.results.measurement import Measurement
from station.results.record_head import RecordHead, files_read

if TYPE_CHECKING:
    from procedures.geometry.estimate import GeometryParameters
    from station.calibration.chart_scale import ChartScale


class GeometrySettings(ChartSettings, frozen=True, kw_only=True):
    """The print, the camera model, and what is reported besides."""

    width_mm: Annotated[float, setting("Width of the printed chart's ten blocks, as measured.", least=1)] = 300.0
    width_uncertainty_mm: (
        Annotated[float, setting("Its standard uncertainty; all distances share it.  [default: 0.3 %]", least=0)] | None
    ) = None
    scale: Annotated[
        Path | None, setting("A TOML file: the width with ruler, certificate and temperatures, in place of both above.")
    ] = None
    model: Annotated[
        str | None,
        setting("One of COLMAP's camera models, or STEREOGRAPHIC+SPLINE_12X9.  [default: chosen by excluded views]"),
    ] = None
    frame_rate_hz: (
        Annotated[float, setting("The photographs are all frames of a video: measure the row time.", least=1e-3)] | None
    ) = None
    advise: Annotated[
        str | None,
        setting("Propose the next view, for the direction of a pixel or the whole frame.", metavar="X,Y|frame"),
    ] = None
    at_mm: tuple[Annotated[float, setting("Report the uncertainty at this distance too.", least=1)], ...] = ()

    @property
    def parameters(self) -> GeometryParameters:
        """Those of the estimate. Raises BadParameter where there is no such model."""
        from procedures.geometry.cameras import parameter_names
        from procedures.geometry.estimate import GeometryParameters

        if self.model is not None:
            parameter_names(self.model)
        width_mm, known = self.width_mm, self.width_uncertainty_mm
        if (scale := self.chart_scale) is not None:
            width_mm, known = scale.used_width_mm, scale.uncertainty_mm
        share = GeometryParameters.scale_uncertainty if known is None else known / width_mm
        cell_mm = width_mm / (BLOCK * BLOCKS)
        return GeometryParameters(cell_mm, share, self.model, self.at_mm, advise_px=self.pixel)

    @property
    def pixel(self) -> tuple[float, float] | None:
        """The pixel of --advise. Raises BadParameter where it is none."""
        if self.advise in (None, "frame"):
            return None
        try:
            x, y = map(float, str(self.advise).split(","))
        except ValueError:
            raise BadParameter(
                f"--advise must be frame or a pixel X,Y; got {self.advise!r}", "write --advise 120,80, for example"
            ) from None
        return x, y

    @property
    def chart_scale(self) -> ChartScale | None:
        """The record of the chart's scale. Raises BadParameter where its file is not valid."""
        from station.calibration.chart_scale import ChartScale

        return None if self.scale is None else ChartScale.read(self.scale)

    def check(self) -> None:
        """Raise ProcedureError if the chart is unreadable, or there is no such model."""
        super().check()
        _ = self.parameters


class CameraGeometry(Procedure[GeometrySettings]):
    """Photographs of one chart from many places, by plane."""

    name = "geometry"
    title = "geometry of a camera"
    help = """Calibrate a camera's geometry from PHOTO..., one chart each; a folder or a session stands for its own.

    Tilt the chart by 20 to 40 degrees to all sides and show it all over the frame, also in the corners: 12 photographs
    at one focus are a good number."""
    inputs = Inputs.PHOTOGRAPHS
    Settings = GeometrySettings
    drawn_by = "geometry_page:geometry_page"
    method = "bundle adjustment of camera, poses and chart, each point weighted by its covariance"

    def measured(self, paths: Sequence[Path], settings: GeometrySettings, progress: Progress) -> Measurement:
        from station.calibration.geometry import conclude, measure_views
        from station.calibration.geometry_files import geometry_measurement

        parameters, source, layout = settings.parameters, settings.source, settings.layout
        shoots = measure_views(paths, settings.plane_name, source.chart, layout, progress)
        given = {
            "width_mm": BLOCK * BLOCKS * parameters.cell_mm, "scale_uncertainty": parameters.scale_uncertainty,
            "model": settings.model or "auto", "chart": source.origin, **({"raw": str(layout)} if layout else {}),
            **({"advise": settings.advise} if settings.advise else {}),
            **({"frame_rate_hz": settings.frame_rate_hz} if settings.frame_rate_hz else {}),
        }  # fmt: skip
        read = [record for record in shoots[0].records if record.sha256]
        head = RecordHead(self.name, files_read(read), given)
        planes = conclude(shoots, parameters, settings.frame_rate_hz)
        return geometry_measurement(planes, head, settings.chart_scale)

    def lines(self, measurement: Measurement) -> list[str]:
        """Which camera model each plane has, from how many views, and which shutter."""
        cameras = [(plane.name, plane.estimate) for plane in measurement.planes if plane.estimate is not None]
        models = [f"{name}: {one.camera.model} from {len(one.views)} views" for name, one in cameras]
        if cameras and "advise" in measurement.head.parameters:
            from procedures.geometry.next_view import advice

            models += [f"{name}: {advice(one.next_view)}" for name, one in cameras if one.next_view is not None]
        return models + [f"{name}: {one.shutter.words}" for name, one in cameras if one.shutter is not None]
