"""Row time of a shutter from a rendered video of a chart moved by hand, every row by rays at its own time.

tests/benchmarks/shutter_video.py [--readout-ms=20] [--frames=48] [--draws=1] [--noise-px=0.3] [--model=NAME]

The pictures are those of `fisheye_views`, which shares nothing with procedures or simulators but the chart's bitmap.
They give points to some hundredths of a pixel; noise of `--noise-px` is added to these. Printed for every draw: the
readout time, its error in per cent and in stated uncertainties, and what the program says of the shutter.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from procedures import Chart, GeometryParameters, Plane, calibrate_geometry
from procedures.geometry.chart_bins.photographs import views_of
from procedures.geometry.views import ChartView
from tests.benchmarks import options
from tests.benchmarks.fisheye_views import CELL_MM, Array, Pose, photograph, polynomial

SIZE, RATE_HZ = (1280, 960), 30.0
LENS = polynomial(SIZE, 1000.0, (643.0, 477.0), (-0.012, 0.004, -0.0015, 0.0002))


def pose_at(times_s: Array, phase: float) -> tuple[Array, Array]:
    """R (n, 3, 3) and t (n, 3) of a chart moved by sines of 0.4 to 1 Hz."""
    waves = 2 * np.pi * times_s[:, None] * np.array([0.61, 0.83, 0.37, 0.97, 0.71, 0.53]) + np.arange(6.0) + phase
    moves = np.sin(waves) * (80.0, 55.0, 50.0, 0.4, 0.4, 0.25)
    R = Rotation.from_euler("YXZ", moves[:, 3:]).as_matrix()
    return R, moves[:, :3] + np.array([0.0, 0.0, 600.0])


def frame(number: int, row_s: float, phase: float) -> ChartView | None:
    """The view of a rendered frame."""
    time_s, middle = number / RATE_HZ, (SIZE[1] - 1) / 2
    R, t = pose_at(np.array([time_s]), phase)
    chart = Chart.from_seed()
    picture = photograph(
        LENS, Pose(R[0], t[0]), chart, 0.004, number, lambda rows: pose_at(time_s + row_s * (rows - middle), phase)
    )
    view = views_of({"Y": Plane("Y", picture, 1 / 65535)}, chart, f"frame{number}")["Y"].value
    return None if view is None else ChartView(view.source, view.index, view.points, view.covariance, time_s=time_s)


def noisy(view: ChartView, sigma: float, rng: np.random.Generator) -> ChartView:
    """The view with noise added to its points."""
    points = view.points + sigma * rng.standard_normal(view.points.shape)
    return ChartView(view.source, view.index, points, view.covariance + sigma**2 * np.eye(2), time_s=view.time_s)


def main(readout_ms: float, frames: int, draws: int, noise_px: float, model: str | None) -> None:
    """The readout time of every draw."""
    row_s = readout_ms / 1000 / SIZE[1]
    views = [one for one in (frame(i, row_s, 0.0) for i in range(frames)) if one is not None]
    print(f"{len(views)} of {frames} frames used, readout {readout_ms:g} ms", flush=True)
    for draw in range(draws):
        rng = np.random.default_rng(draw)
        seen = [noisy(view, noise_px, rng) for view in views]
        outcome = calibrate_geometry(seen, SIZE, GeometryParameters(CELL_MM, model=model, is_video=True))
        shutter = outcome.result().shutter
        value, sigma = (1e3 * SIZE[1] * one for one in (shutter.row_s, shutter.uncertainty_s))
        share = "" if not readout_ms else f"error {100 * (value / readout_ms - 1):+.2f} %, "
        print(
            f"  {value:.4f} ± {sigma:.4f} ms, {share}z {(value - readout_ms) / sigma:+.2f}; {shutter.words}", flush=True
        )


if __name__ == "__main__":
    given = options(__doc__, readout_ms=20.0, frames=48, draws=1, noise_px=0.3, model="")
    main(given.readout_ms, given.frames, given.draws, given.noise_px, given.model or None)
