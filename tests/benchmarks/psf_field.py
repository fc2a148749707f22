"""The PSF over the frame from simulated DNG files: against the truth with 25 nodes, and how long 100 places take.

The photographs are the scene's spectrum times the optics' own transfer function, and the truth of every number is
drawn from that function: nothing is cut to a support.

Usage: psf_field.py accuracy|speed [FOLDER], the folder keeping the photographs for another run; or
psf_field.py draws [N], N fields at each of three f-numbers, two photographs of a sensor without a mosaic each, whose
scene is drawn once and whose noise anew; or
psf_field.py corners [N], the same of N fields from the guide's usual tour, stated at the tour's four corners.
"""

import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from procedures import Chart, PatternParameters
from procedures.field.conclusion import FieldResult, PlaneField, conclude
from procedures.field.maps import MAPS, FieldMap, derive, numbers_of, radius_direction
from procedures.field.measuring import MeasuredFrames, measure, measure_frames
from procedures.field.photosite import Photosite
from procedures.field.plan import locations
from procedures.pattern_psf.centre import mark_offset
from procedures.pattern_psf.outline import SHEET
from procedures.raw import Plane, RawFrame
from procedures.reading.exposure import Exposure
from simulators.bench.demonstration import OPTICS, PITCH_UM
from simulators.camera.camera import Lens, SimulatedCamera, TruePsf, true_mtf, true_psf
from simulators.camera.optics import CircularPupil, FourSpots, GaussianBlur, Optics, PixelAperture
from simulators.camera.pupil import Wavefront
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene
from station.demo.truth_comparison import align
from tests.benchmarks import ROOT

S, K = 4, 17
PIXELS = 102.4  # s/t = 1.6
BOUND_S = 60.0
LENS = Lens(
    focal_length_mm=50.0, f_number=2.8, k1=-0.01, spherical_um=0.02, coma_um=0.09, astigmatism_um=0.10,
    field_curvature_um=0.08, axis=(0.08, -0.05), lateral_colour=0.006,
)  # fmt: skip
SENSOR = Sensor(1000, 1500, full_well_e=60000.0, gain_e_per_dn=3.78)
MONO = Sensor(500, 750, None, bits=14, full_well_e=15000.0, gain_e_per_dn=0.95)
EXPOSURE = {"exposure_s": 0.02, "iso": 400, "bits": 14}
COLUMNS = (0.1, 0.3, 0.5, 0.7, 0.9)
ROWS = ((0.15, 0.5, 0.85), (0.325, 0.675))  # of each photograph: neighbouring rows would overlap
MAP_COLUMNS = 5  # the truth takes a second a place
COMPARED = ("G1", "R")
F_NUMBERS = (2.8, 5.6, 11.0)
DRAWS = 3
FILLED = 0.475
"""Side of a photosite in pixels of the sensor without a mosaic, which stands for a plane: about half of it."""
PHOTOSITE = Photosite(FILLED**2)


def camera(lens: Lens) -> SimulatedCamera:
    """The simulated camera with a lens."""
    return SimulatedCamera(lens, SENSOR, PITCH_UM, Optics(OPTICS.blurs, PITCH_UM), white_e_per_s=1.5e5)


def grid_scenes(one: SimulatedCamera, rng: np.random.Generator) -> list[Scene]:
    """25 charts in two scenes."""
    chart = Chart.from_seed()
    scenes = []
    for rows in ROWS:
        places = [(x, y) for y in rows for x in COLUMNS]
        placed = (one.place(chart, pixels=PIXELS, at=at, roll_deg=rng.uniform(-2, 2)) for at in places)
        scenes.append(Scene(tuple(placed)))
    return scenes


def photograph_grid(folder: Path) -> None:
    """25 charts in two photographs of 1.5 megapixels."""
    one, rng = camera(LENS), np.random.default_rng(5)
    for number, scene in enumerate(grid_scenes(one, rng), 1):
        one.photograph(scene, rng, folder / f"grid-{number}.dng", **EXPOSURE)


def photograph_singles(folder: Path) -> None:
    """100 photographs of 1.5 megapixels with one chart each."""
    chart, rng = Chart.from_seed(), np.random.default_rng(6)
    one = camera(Lens(focal_length_mm=50.0, f_number=2.8))
    for number in range(100):
        at = (0.1 + 0.8 * (number % 10) / 9, 0.15 + 0.7 * (number // 10) / 9)
        scene = Scene((one.place(chart, pixels=PIXELS, at=at, roll_deg=rng.uniform(-4, 4)),))
        one.photograph(scene, rng, folder / f"place-{number:03}.dng", **EXPOSURE)


def ideal_field(lens: Lens, at: np.ndarray, shape: tuple[int, int]) -> tuple[float, float]:
    """Where the undistorted lens shows a point of the sensor, which is where its field is counted: in half diagonals.

    `at` is from the frame's centre, in pixels of a sensor of that shape.
    """
    half = np.hypot(*shape) / 2
    q = np.linalg.norm(at) / half
    ideal = q
    for _ in range(20):
        ideal = q / (1 + lens.k1 * ideal**2)
    u = at / half * (ideal / q if q else 1.0)
    return float(u[0]), float(u[1])


@dataclass(frozen=True)
class Place:
    """The optics at a place of a plane, a colour, and sensor pixels per pixel of the plane."""

    optics: Optics
    colour: str
    pitch: int

    def psf(self) -> TruePsf:
        """The samples of the truth."""
        return true_psf(self.optics, S, K, colour=self.colour, pitch=self.pitch)


@cache
def place_in_colour(x: float, y: float, plane: str) -> Place:
    """What the lens and the photosites do at a place of a plane of the DNG files (pixels of the plane)."""
    at = 2 * np.array([x, y]) + np.array(SENSOR.planes[plane]) - (np.array([SENSOR.columns, SENSOR.rows]) - 1) / 2
    wavefront = LENS.wavefront(*ideal_field(LENS, at, (SENSOR.rows, SENSOR.columns)))
    return Place(Optics(OPTICS.blurs, PITCH_UM).aberrated(wavefront + Wavefront()), plane[0], 2)


@cache
def place_in_mono(x: float, y: float, lens: Lens) -> Place:
    """The same of the sensor without a mosaic."""
    at = np.array([x, y]) - (np.array([MONO.columns, MONO.rows]) - 1) / 2
    wavefront = lens.wavefront(*ideal_field(lens, at, (MONO.rows, MONO.columns)))
    return Place(Optics(mono_parts(lens), 2 * PITCH_UM).aberrated(wavefront + Wavefront()), "Y", 1)


def mono_parts(lens: Lens) -> tuple[object, ...]:
    """The optics of the demonstration in pixels twice as large: photosites fill a quarter of them, as of a plane."""
    return CircularPupil(lens.f_number), PixelAperture(FILLED, FILLED), FourSpots(0.4), GaussianBlur(0.15)


@cache
def before_photosites(place: Place) -> Place:
    """The same optics without the photosites."""
    blurs = tuple(one for one in place.optics.blurs if not isinstance(one, PixelAperture))
    return replace(place, optics=Optics(blurs, place.optics.pitch_um))


@cache
def true_numbers(place: Place, radius: float) -> np.ndarray:
    """The numbers of MAPS at a place, of the transfer function itself; `radius` is the direction from the centre."""
    f, mtf50 = np.linspace(0, S / 2, 4001), []
    for angle in (radius + np.pi / 2, radius):
        mtf = true_mtf(place.optics, f, float(np.degrees(angle)), colour=place.colour, pitch=place.pitch)
        first = int(np.flatnonzero(mtf < 0.5)[0])
        mtf50.append(np.interp(0.5, mtf[[first, first - 1]], f[[first, first - 1]]))
    return np.array([*mtf50, mtf50[0] - mtf50[1], above_nyquist(place), place.psf().energy_outside])


def above_nyquist(place: Place, n: int = 64) -> float:
    """Share of |OTF|^2 outside |fx|, |fy| <= 1/2, of that in the band of the estimate: by the trapezoidal rule."""
    f = np.arange(n * S + 1) / (2 * n)  # 0 to S / 2 along x, and both signs along y
    both = np.concatenate([-f[:0:-1], f])
    power = np.abs(place.optics.otf(f[None, :] / place.pitch, both[:, None] / place.pitch, place.colour)) ** 2

    def total(reach: float) -> float:
        x, y = f <= reach + 1e-9, np.abs(both) <= reach + 1e-9
        return float(np.trapezoid(np.trapezoid(power[np.ix_(y, x)], axis=1), axis=0))

    return 1 - total(0.5) / total(S / 2)


Off = dict[str, list[np.ndarray]]
"""By map: rows of error, its standard uncertainty, and the truth."""


def compare_maps(found: FieldResult, plane: str, place_at: Callable[[float, float], Place], off: Off) -> None:
    """Add every place's errors of every map."""
    one = found.planes[plane].result()
    shape = one.interpolation.field.shape
    stated: list[FieldMap] = [m for m in one.maps if m.uncertainty is not None]
    for i, m in enumerate(stated):
        without = i >= len(MAPS)
        for j, k in np.argwhere(m.enclosed & np.isfinite(m.value)):
            x, y = float(m.x[k]), float(m.y[j])
            place = before_photosites(place_at(x, y)) if without else place_at(x, y)
            true = true_numbers(place, radius_direction(shape, x, y))[i - len(MAPS) if without else i]
            off.setdefault(m.name, []).append(np.array([m.value[j, k] - true, m.uncertainty[j, k], true]))


def report(off: Off) -> None:
    """Of each map: mean difference, and how often it holds the truth."""
    for name, rows in off.items():
        error, sigma, true = np.array(rows).T
        mean = f"{error.mean():+.4f}" if name.startswith("astigmatism") else f"{error.mean() / true.mean():+.2%}"
        z = np.abs(error / sigma)
        print(f"  {name:34} mean difference {mean:>8}, within 2 sigma at {np.mean(z < 2):6.1%} of {len(z)} places, "
              f"root mean square {np.sqrt(np.mean(z**2)):.2f} sigma, worst {z.max():.1f}")  # fmt: skip


def colour_coverage(found: FieldResult) -> None:
    """How often lateral colour holds the truth: the lens's, and the marks' displacement by the PSFs' shape."""
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
    marks = [mark_offset(place_in_colour(x, y, name).psf().h, S, np.eye(2)) for name in (plane, "G1")]
    return chief + 2 * (marks[0] - marks[1])


def accuracy(folder: Path) -> None:
    """One field of all planes from DNG files: maps and lateral colour, and the errors between the nodes and at them."""
    if not list(folder.glob("grid-*.dng")):
        photograph_grid(folder)
    found = concluded(measure(sorted(folder.glob("grid-*.dng")), None, Chart.from_seed(), PatternParameters(S, K)))
    for name, outcome in found.planes.items():
        tell_field(name, outcome.result())
        if name in COMPARED:
            off: Off = {}
            compare_maps(found, name, partial(place_in_colour, plane=name), off)
            report(off)
    colour_coverage(found)


def concluded(measured: MeasuredFrames, photosite: Photosite | None = None) -> FieldResult:
    """The fields, with maps of few places: the truth takes a second each."""
    import procedures.field.conclusion as module

    module.derive = lambda field, without=None: derive(field, MAP_COLUMNS, without)
    return conclude(measured, photosite=photosite)


def draws(count: int) -> None:
    """The maps of many fields against the truth at three f-numbers."""
    together: Off = {}
    for f_number in F_NUMBERS:
        lens, off = replace(LENS, f_number=f_number, lateral_colour=0.0), {}
        one = SimulatedCamera(lens, MONO, 2 * PITCH_UM, Optics(mono_parts(lens), 2 * PITCH_UM), white_e_per_s=1.5e5)
        lights = [(scene, one.light(scene)) for scene in grid_scenes(one, np.random.default_rng(5))]
        for draw in range(count):
            rng = np.random.default_rng([round(10 * f_number), draw])
            exposure_s = 0.02 * (f_number / 2.8) ** 2  # as much light at each
            shots = [one.photograph(scene, rng, light=light, exposure_s=exposure_s) for scene, light in lights]
            frames = [
                RawFrame(Path(f"{i}"), "", {"Y": Plane("Y", shot.plane("Y").astype(np.float32), 2**-14)}, Exposure())
                for i, shot in enumerate(shots)
            ]
            measured = measure_frames(frames, Chart.from_seed(), PatternParameters(S, K))
            compare_maps(concluded(measured, PHOTOSITE), "Y", partial(place_in_mono, lens=lens), off)
        print(f"f/{f_number:g}, {count} fields of {len(lights)} photographs")
        report(off)
        for name, rows in off.items():
            together.setdefault(name, []).extend(rows)
    print(f"all {len(ROWS) * count * len(F_NUMBERS)} photographs")
    report(together)


def corners(count: int) -> None:
    """The bands of the numbers where the usual tour comes nearest to the frame's corners, against the truth."""
    lens, chart = replace(LENS, lateral_colour=0.0), Chart.from_seed()
    one = SimulatedCamera(lens, MONO, 2 * PITCH_UM, Optics(mono_parts(lens), 2 * PITCH_UM), white_e_per_s=1.5e5)
    half = SHEET * PIXELS / 2
    known = dict.fromkeys(("distance_mm", "principal_px", "x", "y"), 1.0) | {"rows": 500.0, "columns": 750.0}
    known |= {"half_x": half / MONO.columns, "half_y": half / MONO.rows}
    tour = locations({f"tour_{name}": value for name, value in known.items()})
    scenes = [Scene((one.place(chart, pixels=PIXELS, at=(at.x, at.y), roll_deg=1.0),)) for at in tour]
    lights, off = [one.light(scene) for scene in scenes], {}
    for draw in range(count):
        rng, exposure = np.random.default_rng(draw), Exposure()
        shots = [one.photograph(s, rng, light=li, exposure_s=0.02) for s, li in zip(scenes, lights, strict=True)]
        planes = [Plane("Y", shot.plane("Y").astype(np.float32), 2**-14) for shot in shots]
        frames = [RawFrame(Path(f"{i}"), "", {"Y": plane}, exposure) for i, plane in enumerate(planes)]
        found = conclude(measure_frames(frames, chart, PatternParameters(S, K)))
        field = found.planes["Y"].result().interpolation.field
        (left, top), (right, bottom) = field.positions.min(axis=0), field.positions.max(axis=0)
        for x, y in ((x, y) for x in (left, right) for y in (top, bottom)):
            x, y = (float(value) for value in field.hull.nearest(np.array([[x, y]]))[0])
            psf = field.at(x, y)
            radius = radius_direction(field.shape, x, y)
            true = true_numbers(place_in_mono(x, y, lens), radius)
            for name, value, sigma, truth in zip(MAPS, *numbers_of(psf, radius), true, strict=True):
                off.setdefault(name, []).append(np.array([value - truth, sigma, truth]))
    print(f"{count} fields of {len(tour)} photographs, at the tour's corners")
    report(off)


def tell_field(name: str, one: PlaneField) -> None:
    """The model, the axis, and of the planes compared the errors of the samples at the nodes and between them."""
    field, axis = one.interpolation.field, one.interpolation.axis
    where = "not stated" if axis is None else f"{axis.position.round(3)} ± {np.sqrt(np.diag(axis.covariance)).round(3)}"
    print(f"{name}: {len(field.nodes)} nodes, {field.model.name}, {len(field.components)} components, "
          f"axis {where}, true {LENS.axis}")  # fmt: skip
    if name not in COMPARED:
        return
    at_nodes = [error(node.psf.h, place_in_colour(*map(float, node.position), name).psf().h) for node in field.nodes]
    m: FieldMap = one.maps[0]
    places = [(float(m.x[k]), float(m.y[j])) for j, k in np.argwhere(m.enclosed & np.isfinite(m.value))]
    between = [error(field.at(*place).h, place_in_colour(*place, name).psf().h) for place in places]
    print(f"  error at the nodes {np.mean(at_nodes):.2%}, between them {np.mean(between):.2%} "
          f"(most {np.max(between):.2%}): {np.mean(between) / np.mean(at_nodes):.2f} times, bound 1.5")  # fmt: skip


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
    subprocess.run(words, check=True, stderr=subprocess.DEVNULL, cwd=ROOT)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"100 places x 4 planes: {wall:.1f} s, {wall / BOUND_S:.2f} of the bound; {cpu:.1f} s of processor time, "
          f"peak memory {after.ru_maxrss / 2**20:.2f} GiB")  # fmt: skip


def main() -> None:
    """Print environment and figures."""
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores")
    what = sys.argv[1] if len(sys.argv) > 1 else "accuracy"
    if what == "draws":
        draws(int(sys.argv[2]) if len(sys.argv) > 2 else DRAWS)
        return
    if what == "corners":
        corners(int(sys.argv[2]) if len(sys.argv) > 2 else DRAWS)
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(temporary)
        folder.mkdir(exist_ok=True)
        {"accuracy": accuracy, "speed": speed}[what](folder)


if __name__ == "__main__":
    main()
