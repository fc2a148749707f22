"""The PSF over the frame from simulated DNG files: against the truth with 25 nodes, and how long 100 places take.

Usage: psf_field.py accuracy|speed [FOLDER], the folder keeping the photographs for another run.
"""

from __future__ import annotations

import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from procedures.field.maps import FieldMap, numbers_of, radius_direction
from procedures.pattern import Chart
from procedures.pattern_psf.centre import mark_offset
from procedures.pattern_psf.estimate import PatternParameters
from procedures.psf import Psf
from simulators.camera import Lens, SimulatedCamera
from simulators.demonstration import OPTICS, PITCH_UM
from simulators.optics import Optics
from simulators.pupil import Wavefront
from simulators.scene import Scene
from simulators.sensor import Sensor
from simulators.truth import true_psf
from station.compare import align
from station.field import FieldResult, conclude, measure

S, K = 4, 17
PIXELS = 102.4  # s/t = 1.6
BOUND_S = 60.0
LENS = Lens(
    focal_length_mm=50.0, f_number=2.8, k1=-0.01, spherical_um=0.02, coma_um=0.09, astigmatism_um=0.10,
    field_curvature_um=0.08, axis=(0.08, -0.05), lateral_colour=0.006,
)  # fmt: skip
SENSOR = Sensor(1000, 1500, full_well_e=60000.0, gain_e_per_dn=3.78)
EXPOSURE = {"exposure_s": 0.02, "iso": 400, "bits": 14}
COLUMNS = (0.1, 0.3, 0.5, 0.7, 0.9)
ROWS = ((0.15, 0.5, 0.85), (0.325, 0.675))  # of each photograph: neighbouring rows would overlap
MAP_COLUMNS = 7  # the truth takes seconds a place
COMPARED = ("G1", "R")


def camera(lens: Lens) -> SimulatedCamera:
    """The simulated camera with a lens."""
    return SimulatedCamera(lens, SENSOR, PITCH_UM, Optics(OPTICS.blurs, PITCH_UM), white_e_per_s=1.5e5)


def photograph_grid(folder: Path) -> None:
    """25 charts in two photographs of 1.5 megapixels."""
    chart, rng = Chart.from_seed(), np.random.default_rng(5)
    for number, rows in enumerate(ROWS, 1):
        one = camera(LENS)
        places = [(x, y) for y in rows for x in COLUMNS]
        scene = Scene(tuple(one.place(chart, pixels=PIXELS, at=at, roll_deg=rng.uniform(-2, 2)) for at in places))
        one.photograph(scene, rng, folder / f"grid-{number}.dng", **EXPOSURE)


def photograph_singles(folder: Path) -> None:
    """100 photographs of 1.5 megapixels with one chart each."""
    chart, rng = Chart.from_seed(), np.random.default_rng(6)
    one = camera(Lens(focal_length_mm=50.0, f_number=2.8))
    for number in range(100):
        at = (0.1 + 0.8 * (number % 10) / 9, 0.15 + 0.7 * (number // 10) / 9)
        scene = Scene((one.place(chart, pixels=PIXELS, at=at, roll_deg=rng.uniform(-4, 4)),))
        one.photograph(scene, rng, folder / f"place-{number:03}.dng", **EXPOSURE)


def truth(x: float, y: float, plane: str) -> np.ndarray:
    """The PSF (K, K) that the lens has at a place of a plane (pixels of the plane), of sum 1."""
    rows, columns = SENSOR.rows, SENSOR.columns
    origin = np.array(SENSOR.planes[plane])
    at = 2 * np.array([x, y]) + origin - (np.array([columns, rows]) - 1) / 2
    half = np.hypot(rows, columns) / 2
    q = np.linalg.norm(at) / half
    ideal = q  # the field is counted where the undistorted lens shows it
    for _ in range(20):
        ideal = q / (1 + LENS.k1 * ideal**2)
    u = at / half * (ideal / q if q else 1.0)
    optics = Optics(OPTICS.blurs, PITCH_UM).aberrated(LENS.wavefront(float(u[0]), float(u[1])) + Wavefront())
    return true_psf(optics, S, K, colour=plane[0], pitch=2).h


def coverage(found: FieldResult, plane: int, truths: dict[tuple[float, float], np.ndarray]) -> None:
    """How much of each map holds the truth in its 95 % band."""
    one = found.planes[plane]
    shape = one.interpolation.field.shape
    for i, m in enumerate(one.maps[:4]):
        inside = total = 0
        for (x, y), h in truths.items():
            value, _ = numbers_of(Psf(h, S, np.zeros((K * K, K * K))), radius_direction(shape, x, y))
            j, k = int(np.argmin(abs(m.y - y))), int(np.argmin(abs(m.x - x)))
            total += 1
            inside += abs(m.value[j, k] - value[i]) < 1.96 * m.uncertainty[j, k]
        print(f"  {m.name:22} truth in the 95 % band at {inside / total:4.0%} of {total} places")


def colour_coverage(found: FieldResult) -> None:
    """The same of lateral colour, whose truth is the lens's and the marks' displacement by the PSFs' shape."""
    for colour in (one for one in found.colours if one.plane in COMPARED):
        wavelength = {"R": 0.6, "G": 0.53, "B": 0.46}[colour.plane[0]]
        radial, tangential = colour.maps(MAP_COLUMNS)
        inside = total = 0
        for j, y in enumerate(radial.y):
            for k, x in enumerate(radial.x):
                if np.isfinite(radial.value[j, k]):
                    expected = chief_shift(x, y, colour.plane, wavelength)
                    for m, angle in ((radial, 0.0), (tangential, np.pi / 2)):
                        turn = radius_direction(colour.shape, x, y) + angle
                        along = expected @ [np.cos(turn), np.sin(turn)]
                        total += 1
                        inside += abs(m.value[j, k] - along) < 1.96 * m.uncertainty[j, k]
        print(f"  lateral colour of {colour.plane:4} truth in the 95 % band at {inside / total:4.0%} of {total} values")


def chief_shift(x: float, y: float, plane: str, wavelength: float) -> np.ndarray:
    """Shift (x, y) in sensor pixels of a plane against G1: lateral colour, and what the marks' centres differ by."""
    rows, columns = SENSOR.rows, SENSOR.columns
    at = 2 * np.array([x, y]) + np.array(SENSOR.planes[plane]) - (np.array([columns, rows]) - 1) / 2
    half = np.hypot(rows, columns) / 2
    chief = LENS.lateral_colour * (wavelength - 0.53) * half * (at / half - LENS.axis)
    marks = [mark_offset(truth(x, y, name), S, np.eye(2)) for name in (plane, "G1")]
    return chief + 2 * (marks[0] - marks[1])


def accuracy(folder: Path) -> None:
    """Errors between the nodes and at them, and how often the maps hold the truth."""
    if not list(folder.glob("grid-*.dng")):
        photograph_grid(folder)
    measured = measure(sorted(folder.glob("grid-*.dng")), None, Chart.from_seed(), PatternParameters(S, K))
    import station.field as module
    from procedures.field.maps import derive

    module.derive = lambda field: derive(field, MAP_COLUMNS)
    found = conclude(measured)
    for number, one in enumerate(found.planes):
        field = one.interpolation.field
        name, axis = one.record.name, one.interpolation.axis
        spread = np.sqrt(np.diag(axis.covariance))
        print(f"{name}: {len(field.nodes)} nodes, {field.model.name}, {len(field.components)} components, "
              f"axis {axis.position.round(3)} ± {spread.round(3)}, true {LENS.axis}")  # fmt: skip
        if name not in COMPARED:
            continue
        at_nodes = [error(node.psf.h, truth(*node.position, name)) for node in field.nodes]
        m: FieldMap = one.maps[0]
        places = [
            (float(x), float(y)) for j, y in enumerate(m.y) for k, x in enumerate(m.x) if np.isfinite(m.value[j, k])
        ]
        truths = {place: truth(*place, name) for place in places}
        between = [error(field.at(*place).h, h) for place, h in truths.items()]
        print(f"  error at the nodes {np.mean(at_nodes):.2%}, between them {np.mean(between):.2%} "
              f"(most {np.max(between):.2%}): {np.mean(between) / np.mean(at_nodes):.2f} times, bound 1.5")  # fmt: skip
        coverage(found, number, truths)
    colour_coverage(found)


def error(h: np.ndarray, true: np.ndarray) -> float:
    """Relative L2 distance after the best subpixel shift: the centre of a PSF with coma is a convention."""
    return float(np.linalg.norm(h - align(true, h)[0]) / np.linalg.norm(true))


def speed(folder: Path) -> None:
    """The whole command on 100 photographs of one chart each, four planes."""
    if not list(folder.glob("place-*.dng")):
        photograph_singles(folder)
    out = folder / "result"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    words = [sys.executable, "-m", "station", "psf", "field", str(folder), "--out", str(out)]
    subprocess.run(words, check=True, stderr=subprocess.DEVNULL, cwd=Path(__file__).resolve().parents[2])
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"100 places x 4 planes: {wall:.1f} s, {wall / BOUND_S:.2f} of the bound; {cpu:.1f} s of processor time, "
          f"peak memory {after.ru_maxrss / 2**20:.2f} GiB")  # fmt: skip


def main() -> None:
    """Print environment and figures."""
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores")
    what = sys.argv[1] if len(sys.argv) > 1 else "accuracy"
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(temporary)
        folder.mkdir(exist_ok=True)
        {"accuracy": accuracy, "speed": speed}[what](folder)


if __name__ == "__main__":
    main()
