"""How well the geometry is found and how honest its uncertainty is, on simulated views; against OpenCV's calibration.

tests/benchmarks/geometry.py [spread | spline | discrepancy | opencv | speed | photographs | bins]... [--draws=N]

A camera of 24 megapixels with radial, tangential and thin-prism distortion, 12 views, a print that errs by 0.05 mm at
every node and a sheet that bends by 0.5 mm; points with noise of 0.01 pixel.
"""

import os
import platform
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from procedures import Chart, GeometryParameters, Plane, calibrate_geometry, read_frame, view_of
from procedures.geometry.adjustment import AdjustmentProblem, adjust
from procedures.geometry.cameras import MODELS
from procedures.geometry.reference import first_state, fit_formula, fit_model
from procedures.geometry.shape import estimated_node_errors, shape_model
from procedures.geometry.uncertainty import projection_uncertainty
from procedures.pattern_psf.chart_finding.detection import find_charts, one_chart
from procedures.pattern_psf.correspondences import bin_centres
from simulators.camera.camera import Lens, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene
from tests.benchmarks import options
from tests.procedures.geometry.simulated_views import (
    CELL_MM,
    Shoot,
    TrueCamera,
    apart,
    fixed_to_charts,
    take,
    true_poses,
)

SHOOT = Shoot(print_mm=0.05, bend_mm=0.5)
RICH, POOR = "RAD_TAN_THIN_PRISM_FISHEYE", "OPENCV"
WAVY = replace(SHOOT, camera=TrueCamera(wave_px=0.3), every=2)
PLAIN = TrueCamera(radial=(-0.12, 0.06, 0.0), thin_prism=(0.0, 0.0, 0.0, 0.0))
BLURRED = ((380, 0.1, 2.8), (380, 0.3, 5.6), (380, 1.0, 5.6), (380, 2.0, 5.6), (800, 0.3, 5.6), (800, 1.2, 8.0))
"""Of `bins`: a chart's width in pixels, standard deviation of a blur besides the lens's, f-number."""
DISTANCES = (500.0, float("inf"))


def spread(draws: int) -> None:
    """Predicted over empirical spread of the projection by a rich formula."""
    _spread(draws, RICH, SHOOT)


def spline(draws: int) -> None:
    """The same of a spline, for a lens with waves that no formula draws; and what is made of that lens by itself."""
    taken = take(WAVY, np.random.default_rng(1))
    found = calibrate_geometry(taken.views, WAVY.camera.size, GeometryParameters(CELL_MM), nodes=taken.nodes)
    assert found.value is not None
    for model in MODELS:
        poor = calibrate_geometry(taken.views, WAVY.camera.size, GeometryParameters(CELL_MM, model=model), taken.nodes)
        reported = poor.reason if poor.value is None else f"residual {poor.value.residual_scale:.1f} times the noise"
        print(
            f"{model}: {poor.verdict}, {reported}, {'' if 'too simple' in poor.reason else 'not '}flagged as too simple"
        )
    chosen, scale = found.value.camera.model, found.value.residual_scale
    print(f"chosen: {chosen}, {found.verdict}, residual {scale:.2f} times the noise", flush=True)
    _spread(draws, chosen, WAVY)


def _spread(draws: int, model: str, shoot: Shoot) -> None:
    """Predicted over empirical spread of the projection over the frame, and its error against the truth."""
    truth = shoot.camera
    pixels = np.array([(x, y) for x in np.linspace(0.06, 0.94, 9) for y in np.linspace(0.06, 0.94, 6)]) * truth.size
    moved: dict[float, list[np.ndarray]] = {d: [] for d in DISTANCES}
    predicted: dict[float, list[np.ndarray]] = {d: [] for d in DISTANCES}
    errors, start = [], None
    for draw in range(draws):
        taken = take(shoot, np.random.default_rng(1000 + draw))
        problem = AdjustmentProblem(taken.nodes, taken.views, shape_model(taken.nodes))
        if start is None:
            start = fit_formula(model, first_state(problem, truth.size), problem).state
        found = adjust(start, problem)
        node_mm = estimated_node_errors(found.state.errors_mm, found.errors_variance)
        found = adjust(found.state, replace(problem, shape=replace(problem.shape, node_mm=node_mm)))
        for d in DISTANCES:
            moved[d].append(fixed_to_charts(found.state.camera, found.state.poses, taken, truth, pixels, d))
            predicted[d].append(projection_uncertainty(found, pixels, d))
        errors.append(float(np.sqrt(np.mean(np.sum(apart(found.state.camera, truth) ** 2, axis=1)))))
    print(f"{model}, {draws} draws")
    total = np.sqrt(np.mean(np.square(errors)))
    print(f"  projection error over 95 % of the frame: rms {total:.4f} pixel, worst draw {max(errors):.4f}")
    for d in DISTANCES:
        empirical = np.sqrt(np.sum(np.var(moved[d], axis=0, ddof=1), axis=-1))
        stated = np.sqrt(np.mean(np.square(predicted[d]), axis=0))
        mean, wide = (float(np.sqrt(np.mean(one**2))) for one in (stated, empirical))
        places = f"over places {np.min(stated / empirical):.2f} to {np.max(stated / empirical):.2f}"
        off = float(np.sqrt(np.mean(np.sum((np.array(moved[d]) - pixels) ** 2, axis=-1))))
        places += f"; error over stated {off / mean:.2f}"
        print(f"  at {d:g} mm: stated {mean:.5f} pixel, spread {wide:.5f}, ratio {mean / wide:.3f}; {places}")


def discrepancy(draws: int) -> None:
    """How often an inadequate model is flagged as doubtful, and how often an adequate one."""
    small = replace(SHOOT, every=2, count=10)
    for words, shoot in (("too simple", small), ("right", replace(small, camera=PLAIN))):
        alarms = refused = 0
        for draw in range(draws):
            taken = take(shoot, np.random.default_rng(5000 + draw))
            parameters = GeometryParameters(CELL_MM, model=POOR)
            found = calibrate_geometry(taken.views, shoot.camera.size, parameters, nodes=taken.nodes)
            alarms += "too simple" in found.reason
            refused += found.value is None
        print(f"{POOR} where it is {words}: doubtful in {alarms} of {draws} draws, refused in {refused} "
              "(12 x 12 nodes, 10 views)", flush=True)  # fmt: skip


def opencv(draws: int) -> None:
    """The projection's error beside that of `calibrateCamera` on ChArUco corners of as many views of as large a board.

    The board has 12 x 12 inner corners on the chart's noise region; its corners err by the same print, and are found
    to 0.03 pixel.
    """
    flags = cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL
    for bend in (0.0, 0.5):
        ours, theirs = [], []
        for draw in range(draws):
            shoot = replace(SHOOT, bend_mm=bend)
            taken = take(shoot, np.random.default_rng(9000 + draw))
            found = calibrate_geometry(taken.views, shoot.camera.size, GeometryParameters(CELL_MM, model=RICH)).value
            assert found is not None
            ours.append(np.sqrt(np.mean(np.sum(apart(found.camera, shoot.camera) ** 2, axis=1))))
            board = take(replace(shoot, every=2, noise_px=0.03), np.random.default_rng(9500 + draw))
            objects = [board.nodes[v.index].astype(np.float32) for v in board.views]
            images = [v.points.astype(np.float32)[:, None] for v in board.views]
            for chosen in (flags, 0):
                _, K, distortion, *_ = cv2.calibrateCamera(objects, images, shoot.camera.size, None, None, flags=chosen)
                theirs.append(
                    (chosen != 0, np.sqrt(np.mean(np.sum(apart(Peer(K, distortion), shoot.camera) ** 2, axis=1))))
                )
        mine = np.sqrt(np.mean(np.square(ours)))
        for rich in (True, False):
            his = np.sqrt(np.mean([e**2 for kind, e in theirs if kind is rich]))
            kind = "rational, thin prism" if rich else "five coefficients"
            reported = f"ours {mine:.4f} pixel rms, OpenCV's {kind} {his:.3f}: {his / mine:.0f} times"
            print(f"sheet bent by {bend} mm: {reported}", flush=True)


class Peer:
    """OpenCV's answer as something that projects."""

    def __init__(self, K: np.ndarray, distortion: np.ndarray) -> None:
        self.K, self.distortion = K, distortion

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (n, 2)."""
        return cv2.projectPoints(points[:, None], np.zeros(3), np.zeros(3), self.K, self.distortion)[0][:, 0]


def speed(_: int) -> None:
    """Time of bundle adjustment of 30 views and of the whole, with its choice of the model."""
    shoot = replace(SHOOT, count=30)
    taken = take(shoot, np.random.default_rng(1))
    problem, size = AdjustmentProblem(taken.nodes, taken.views, shape_model(taken.nodes)), shoot.camera.size
    print("30 views of 24 x 24 points")
    start = timed("first state", lambda: first_state(problem, size))
    timed("one model", lambda: fit_formula(RICH, start, problem))
    timed("the reference", lambda: fit_model(None, start, problem))
    timed("everything", lambda: calibrate_geometry(taken.views, size, GeometryParameters(CELL_MM)))


def photographs(_: int) -> None:
    """Processor's time from a photograph of 24 megapixels to its points in each of its four planes, the least of three.

    30 photographs take 30 times as long; `speed` shows what then comes.
    """
    chart, camera = Chart.from_seed(), SimulatedCamera(sensor=Sensor(rows=4000, columns=6000))
    for pixels in (250, 600, 1000):
        placed = camera.place(chart, pixels=pixels, at=(0.45, 0.55), yaw_deg=20, pitch_deg=10, roll_deg=7)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "view.dng"
            camera.photograph(Scene((placed,)), np.random.default_rng(2), path)
            print(f"24 megapixels, the chart {pixels} pixels of a plane wide")
            frame, reading = least("reading", lambda path=path: read_frame(path))
        guide = frame.planes["G1"]
        seen, finding = least("finding the chart", lambda plane=guide: one_chart(find_charts(plane.samples)))
        whole = reading + finding
        for name, plane in frame.planes.items():
            x, y = ((a - b) / plane.pitch for a, b in zip(guide.origin, plane.origin, strict=True))
            there = seen.moved(x, y)
            whole += least(
                f"points in {name}", lambda plane=plane, at=there: view_of(plane, chart, "view", at).result()
            )[1]
        print(f"30 photographs       {30 * whole:.0f} s of processor", flush=True)


def bins(_: int) -> None:
    """A chart's bins against where they are, sharp and blurred: their error, what is stated, and one over the other."""
    chart = Chart.from_seed()
    for pixels, gaussian_px, f_number in BLURRED:
        side = round(1.475 * pixels)
        sensor = Sensor(side, side, None, bits=16, full_well_e=13000.0, gain_e_per_dn=0.2)
        optics = Optics.typical(f_number=f_number, pitch_um=7.52, gaussian_px=gaussian_px)
        lens = Lens(k1=-0.04, k2=0.01, focal_length_mm=12.0)
        camera = SimulatedCamera(lens, sensor, 7.52, optics, white_e_per_s=500000.0, focus_mm=700.0)
        placed = camera.place(chart, pixels=pixels, yaw_deg=20, pitch_deg=10, roll_deg=95)
        shot = camera.photograph(Scene((placed,)), np.random.default_rng(1))
        view = view_of(Plane("Y", shot.plane("Y").astype(np.float32), 1 / 65535), chart, "view").result()
        error = view.points - shot.true_points("Y", bin_centres()[view.index])
        error -= error.mean(axis=0)  # the blur's centre
        variance = np.einsum("naa->na", view.covariance)
        rms, stated = np.sqrt(np.mean(error**2)), np.sqrt(np.mean(variance))
        print(f"{pixels} pixels wide, blur of {gaussian_px:g} pixel and f/{f_number:g}: {rms:.4f} pixel, "
              f"{np.sqrt(np.mean(error**2 / variance)):.2f} times the {stated:.4f} stated", flush=True)  # fmt: skip


def least(words: str, work: Callable[[], Any]) -> tuple[Any, float]:
    """What some work gives, and the least processor's time that it took of three; prints that."""
    times = []
    for _ in range(3):
        start = time.process_time()
        answer = work()
        times.append(time.process_time() - start)
    print(f"{words:20s} {min(times):6.2f} s of processor", flush=True)
    return answer, min(times)


def timed(words: str, work: Callable[[], Any]) -> Any:
    """What some work gives; prints its time."""
    clock, processor = time.perf_counter(), time.process_time()
    answer = work()
    print(f"{words:20s} {time.perf_counter() - clock:6.2f} s, {time.process_time() - processor:6.2f} s of processor")
    return answer


def main() -> None:
    """Run what is asked for, or all."""
    parts = {
        "spread": spread,
        "spline": spline,
        "discrepancy": discrepancy,
        "opencv": opencv,
        "speed": speed,
        "photographs": photographs,
        "bins": bins,
    }
    given = options(__doc__, "parts", parts=list(parts), draws=100)
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores; "
          f"{len(true_poses(SHOOT))} views")  # fmt: skip
    for part in given.parts:
        parts[part](given.draws)


if __name__ == "__main__":
    main()
