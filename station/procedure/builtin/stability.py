"""The stability of repeated PSFs of one camera, from their results."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from procedures.numerics.arrays import Array
from procedures.outcome import BadInput, Outcome
from procedures.pattern_psf.stability import HALF, THRESHOLDS, Stability, stability_of
from station.common.durable_files import sha256_of
from station.common.progress import Progress
from station.procedure.base import Inputs, Procedure, Settings, plane_result, setting, to_record
from station.results.exports import csv_columns
from station.results.measurement import Measurement
from station.results.reader import read_result
from station.results.record_head import InputFile, RecordHead, files_read
from station.results.result_files import RECORD

AGAIN = "name results of station psf pattern or psf two-photo, of one camera in one place"


class StabilitySettings(Settings, frozen=True, kw_only=True):
    """The limit of the stable domain."""

    limit: Annotated[
        float, setting("Greatest relative sensitivity of the MTF in the stable domain.", least=1e-6, most=1)
    ] = 0.03


class StabilityOfPsf(Procedure[StabilitySettings]):
    """Results of photographs from similar viewpoints."""

    name = "stability"
    title = "stability of repeated PSFs"
    help = """Measure how far the PSFs of RESULTs agree: three or more of station psf pattern or psf two-photo, of
    photographs with the same camera and settings, from similar viewpoints.

    The relative sensitivity of a region of frequencies is the mean of the MTF's standard deviation over the mean of the
    MTF. Reported are that of all frequencies, that of those whose MTF is 5 % or more, and the largest region above one
    value of the MTF in which it is at most --limit: the stable domain."""
    inputs = Inputs.RESULTS
    argument = "RESULT RESULT RESULT..."
    Settings = StabilitySettings
    suffixes = frozenset((RECORD,))
    method = "relative sensitivity of the MTF over regions of frequencies (Delbracio 2013, Figure 2.17)"

    def measured(self, paths: Sequence[Path], settings: StabilitySettings, progress: Progress) -> Measurement:
        by_plane: list[dict[str, tuple[Array, int]]] = []
        photographs: list[InputFile] = []
        for path in paths:
            folder = path.parent if path.is_file() else path
            measured = read_result(folder)
            s = measured.head.parameters.get("s")
            psfs = {
                plane.name: (plane.samples, int(s[plane.name] if isinstance(s, dict) else s))
                for plane in measured.planes
                if plane.samples is not None and s
            }
            if not psfs:
                raise BadInput(f"{folder} has no PSF", AGAIN)
            by_plane.append(psfs)
            photographs.append(InputFile(str(path), " ".join(one.sha256 for one in measured.head.input)))
            progress(f"read {path}")
        files_read(photographs)
        names = [name for name in by_plane[0] if all(name in one for one in by_plane)]
        if not names:
            raise BadInput("the results must have a plane in common", AGAIN)
        estimates = {name: stability_of([one[name] for one in by_plane], settings.limit) for name in names}
        planes = tuple(plane_result(name, Outcome(estimate)) for name, estimate in estimates.items())
        files = {
            f"stability_{name}.csv": csv_columns({"least_mtf": THRESHOLDS, "sensitivity": one.sensitivity}, 6)
            for name, one in estimates.items()
        }
        inputs = tuple(InputFile(str(path), sha256_of(path / RECORD if path.is_dir() else path)) for path in paths)
        head = RecordHead(self.name, inputs, to_record(settings))
        return Measurement(self.schema, head, planes, files=files)

    def page(self, measurement: Measurement) -> bytes:
        """The sensitivity over the regions, and the mean MTF with its scatter."""
        # imported here: it draws, which is slow to load
        from station.drawing.colours import INK, PLANE_COLOURS
        from station.drawing.plots import curve, finished, legend, plot_axes
        from station.reports.page import Figures
        from station.reports.report_page import report_page

        sensitivity, mean = plot_axes(3.6, 2.6), plot_axes(3.6, 2.6)
        for plane in measurement.planes:
            estimate: Stability = plane.estimate
            looks: dict[str, Any] = {"colour": PLANE_COLOURS.get(plane.name, INK), "label": plane.name}
            curve(sensitivity, THRESHOLDS, estimate.sensitivity, **looks)
            curve(mean, estimate.frequencies[HALF:], estimate.mean[HALF, HALF:], estimate.std[HALF, HALF:], **looks)
        legend(mean, "best")
        figures = [
            finished(sensitivity, "sensitivity", "Relative sensitivity of the region above each value of the MTF.",
                     xlabel="least MTF of the region", ylabel="relative sensitivity", ylim=(0, None)),
            finished(mean, "mean", "Mean MTF along rows; the band holds 95 % of the results.",
                     xlabel="cycles/pixel", ylabel="MTF"),
        ]  # fmt: skip
        return report_page(self.report(measurement), summary=[Figures(figures)]).encode()
