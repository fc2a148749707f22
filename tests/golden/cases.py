"""One small run of every procedure, from files that are made here: what its record and its page hold is frozen.

Each case is a function of a fresh folder that writes its inputs there and returns the words of the command, or writes
the result itself where the photographs would take minutes to render.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from drivers.dng import Shot, write_dng
from procedures import Chart, GeometryParameters, Outcome, Verdict, write_field
from simulators.bench.demonstration import EXPOSURE_S, ISO, Staging, stage
from simulators.camera.sensor import Sensor
from station.calibration.geometry import GeometryPhotographs, ViewRecord, conclude
from station.calibration.geometry_files import geometry_measurement
from station.calibration.tilt import tilt_measurement
from station.demo.small_inputs import defocused, six_charts, tilted_sensor
from station.procedure.builtin.geometry import CameraGeometry
from station.procedure.schema import procedure_named
from station.results.measurement import write_measurement
from station.results.record_head import RecordHead, files_read
from station.results.result_files import ResultFolder
from tests.benchmarks.witnessed import CORRUPTIONS
from tests.benchmarks.witnessed import photographs as witnessed_photographs
from tests.procedures.correction.small_lens import SmallLens
from tests.procedures.correction.small_lens import grey as grey_photograph
from tests.procedures.geometry.simulated_views import CELL_MM, Shoot, TrueCamera, take
from tests.procedures.two_photo.wall import gaussian, photographs
from tests.station.cli.test_rig import write as write_rig_cameras
from tests.station.manual.conftest import edge_levels, render_samples

Words = Sequence[object]
OUT = "out"
TRUE_CAMERA = TrueCamera(radial=(-0.12, 0.06, 0.0), thin_prism=(0.0, 0.0, 0.0, 0.0))


def chart_photograph(path: Path, seed: int) -> Path:
    """A DNG of one chart."""
    camera, scene = stage(Staging("small", "Small", (0.5, 0.5), 1.0, rows=260, columns=260), Chart.from_seed())
    rng = np.random.default_rng(seed)
    camera.photograph(scene, rng, path, exposure_s=EXPOSURE_S, iso=ISO, light=camera.light(scene))
    return path


def save(path: Path, samples: np.ndarray) -> Path:
    """Grey levels, 1 is white, as a picture of 16 bits."""
    cv2.imwrite(str(path), np.rint(65535 * np.clip(samples, 0, 1)).astype(np.uint16))
    return path


def witnessed(folder: Path) -> Words:
    """Four photographs of one chart by the independent renderer, with page and certificate."""
    four, _ = witnessed_photographs(21000, CORRUPTIONS["clean"])
    roles = {"short": four.short, "long": four.long, "near": four.near, "defocused": four.defocused}
    paths = [save(folder / f"{name}.png", plane.samples) for name, plane in roles.items()]
    return "psf", "witnessed", *paths, "--exposure-ratio", "2", "--report", "--certificate"


def pattern(folder: Path) -> Words:
    """One plane of a RAW file, with page and certificate."""
    return "psf", "pattern", chart_photograph(folder / "photo.dng", 1), "--plane", "G1", "--report", "--certificate"


def series(folder: Path) -> Words:
    """Two photographs of one chart as one series of a batch."""
    (folder / "shoot").mkdir()
    for seed in (2, 3):
        chart_photograph(folder / "shoot" / f"frame{seed}.dng", seed)
    limits = "[limits]\nmtf50_horizontal = { min = 0.2 }\n"
    (folder / "lens.toml").write_text(f'procedure = "pattern"\nplanes = ["G1"]\n\n{limits}', encoding="utf-8")
    return "batch", folder / "shoot", "--procedure", folder / "lens.toml", "--jobs", 1


def two_photo(folder: Path) -> Words:
    """A wall from two distances."""
    pair = photographs(gaussian(0.42, 0.37), tilt=0.04)
    return "psf", "two-photo", save(folder / "near.png", pair.near), save(folder / "far.png", pair.far), "--report"


def field(folder: Path) -> Words:
    """Six charts in one frame."""
    (folder / "frames").mkdir()
    save(folder / "frames" / "charts.pgm", six_charts())
    return "psf", "field", folder / "frames", "--certificate"


def edge(folder: Path) -> Words:
    """A slanted edge."""
    cv2.imwrite(str(folder / "edge.png"), edge_levels())
    return "mtf", "edge", folder / "edge.png", "--report"


def geometry_shoot() -> GeometryPhotographs:
    """Six views of a known camera, their charts' points drawn by formulas, and an unusable photograph."""
    taken = take(Shoot(TRUE_CAMERA, count=6, print_mm=0.02, bend_mm=0.2), np.random.default_rng(12))
    good = [
        ViewRecord(Path(f"{view.source}.dng"), f"{n:064}", view, Verdict.PASS) for n, view in enumerate(taken.views)
    ]
    bad = ViewRecord(Path("dark.dng"), "1" * 64, None, Verdict.REFUSED, "the photograph is too dark", "expose longer")
    return GeometryPhotographs("G1", TRUE_CAMERA.size, (*good, bad))


def geometry(folder: Path) -> None:
    """Six views of a known camera."""
    shoot = geometry_shoot()
    found = conclude([shoot], GeometryParameters(CELL_MM, model="OPENCV"))
    with ResultFolder(folder / OUT) as results:
        whole = geometry_measurement(found, RecordHead("geometry", files_read(shoot.records), {"width_mm": 300.0}))
        results.write("report.html", CameraGeometry().page(whole))
        write_measurement(results, whole)


def rig(folder: Path) -> Words:
    """Two cameras by their results of geometry."""
    return "rig", *write_rig_cameras(folder)


def shoot_sensor(folder: Path, simulated: Sensor, levels: int, stack: int) -> Path:
    """A ladder of light, a dark and a flat stack as RAW files; full well, and 14 bits, are reached at 0.07 s."""
    rng, times_s = np.random.default_rng(4), np.linspace(0.003, 0.141, levels)

    def shoot(kind: str, name: str, exposure_s: float) -> None:
        (folder / kind).mkdir(parents=True, exist_ok=True)
        light = np.full((simulated.rows, simulated.columns), float(kind == "light"))
        mosaic = simulated.expose(light, 40000 / 0.07 * exposure_s, rng)
        path = folder / kind / f"{name}.dng"
        write_dng(path, mosaic, Shot(exposure_s=exposure_s), cfa="RGGB", black=(512,) * 4, white=16383)

    for at, exposure_s in enumerate(times_s):
        for which in "ab":
            shoot("light", f"{at:02d}{which}", float(exposure_s))
    for n in range(stack):
        shoot("light", f"flat{n:02d}", float(times_s[6]))
        shoot("dark", f"dark{n:02d}", float(times_s[6]))
    for n in range(2):
        shoot("dark", f"short{n}", float(times_s[0]))
    return folder


def sensor(folder: Path) -> Words:
    """The ladder and stacks of a sensor."""
    simulated = Sensor(rows=64, columns=80, prnu=0.01, read_noise_e=12.0, gain_e_per_dn=2.6)
    return "sensor", shoot_sensor(folder / "shoot", simulated, 16, 16), "--plane", "G1"


def tilt(folder: Path) -> None:
    """The known tilt."""
    found = Outcome(tilted_sensor())
    with ResultFolder(folder / OUT) as results:
        measured = tilt_measurement(RecordHead("tilt"), "G1", found)
        results.write("report.html", procedure_named("tilt").page(measured))
        write_measurement(results, measured)


def vignetting(folder: Path) -> Words:
    """Three flats of light that falls off towards the corners."""
    y, x = np.mgrid[-1:1:96j, -1:1:128j]
    rng = np.random.default_rng(7)
    for name in "abc":
        save(folder / f"{name}.png", (0.5 - 0.1 * (x**2 + y**2)) + 0.001 * rng.standard_normal(x.shape))
    return "vignetting", *(folder / f"{name}.png" for name in "abc")


def correct(folder: Path) -> Words:
    """A grey photograph through a small lens's field."""
    from tests.procedures.correction.lens_photographs import Sensor as Grey
    from tests.station.cli.test_correct import SHAPE, light

    lens = SmallLens(SHAPE, 0.8)
    seen = grey_photograph(lens, light(SHAPE), Grey(white_e=60000.0))
    write_field(folder / "grey.h5", {"Y": lens.field("Y")}, {}, [], {})
    return "correct", save(folder / "photo.tiff", seen.frame.planes["Y"].samples), "--field", folder / "grey.h5"


def rays(folder: Path) -> Words:
    """All samples of a small render."""
    np.savez(folder / "film.npz", samples=render_samples())
    return "rays", folder / "film.npz", "--threads", 1


def restoration(folder: Path) -> Words:
    """A wall of one depth, out of focus twice."""
    for number, sigma in ((1, 1.0), (2, 1.5)):
        save(folder / f"blurred_{number}.pgm", defocused(sigma))
    words = "--blur", "defocus", "--shape", "gaussian", "--ratio", 1.5, "--max-w", 6
    return "restore", folder / "blurred_1.pgm", folder / "blurred_2.pgm", *words


CASES: dict[str, Callable[[Path], Words | None]] = {
    one.__name__: one
    for one in (
        pattern, witnessed, series, two_photo, field, edge, geometry, rig, sensor, tilt, vignetting, correct, rays,
        restoration,
    )
}  # fmt: skip
