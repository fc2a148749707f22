"""Pictures of the manual: every procedure measures what the simulated cameras photograph, and its page is cut up. The
pictures are drawn when the manual is written for a browser, so that they show what the program does today."""

import asyncio
import base64
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import chdir
from dataclasses import replace
from html import unescape
from io import BytesIO, StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from rich.console import Console
from rich.text import Text
from scipy.spatial.transform import Rotation

from procedures import DumpLayout, Roi, estimate_edge
from procedures.geometry.cameras import CameraModel, simple_camera
from procedures.geometry.estimate import GeometryParameters
from procedures.geometry.views import ChartView, chart_nodes
from procedures.numbers import EDGE_CROSSINGS, MTF50_HORIZONTAL
from procedures.outcome import Outcome, Verdict
from procedures.pattern import CELLS, Chart
from procedures.pattern_print.formats import encode
from procedures.pattern_print.sheet import Size
from procedures.pattern_print.source import Source
from procedures.pattern_psf.chart_finding.detection import find_chart
from procedures.pattern_psf.estimate import PatternParameters
from procedures.pattern_psf.outline import frontal_outline, present_outline
from procedures.raw import read_frame
from procedures.transfer_function import radial_profile
from simulators.bench.demonstration import EXPOSURE_S, ISO, OPTICS, WIDTH_MM, Staging, photograph, stage
from simulators.camera.optics import GaussianBlur, Optics
from station.app.app import StationApp
from station.calibration.geometry import GeometryPhotographs, ViewRecord, conclude
from station.calibration.geometry_files import geometry_measurement
from station.calibration.series import Point, SeriesSetting
from station.calibration.tilt import tilt_measurement
from station.common.models import TableSource, read_model
from station.common.progress import Progress, silent
from station.demo.demo import PRINT_BLUR, SHOWN_PLANE, compared_planes
from station.demo.guided_demo import run_guided
from station.demo.reproduce.catalogue import ROWS
from station.demo.reproduce.row import Setting
from station.demo.reproduce.runner import compute
from station.demo.small_inputs import defocused, edge_light, six_charts, tilted_sensor
from station.guide.workspace import StationLab
from station.procedure.schema import procedure_named
from station.reports import otf_figures, psf_figures
from station.reports.batches.batch_page import BatchLine, BatchReport, NumberGroup, batch_page
from station.reports.batches.series_page import series_page
from station.reports.certificate import curves_figure
from station.reports.trend import trends
from station.reports.trend_figure import trend_picture
from station.results.measurement import Measurement, write_measurement
from station.results.record_head import RecordHead, files_read
from station.results.result_files import ResultFolder
from station.service.runs import jpeg_of
from station.sessions.index import IndexedNumber

NAMESPACE = 'xmlns="http://www.w3.org/2000/svg"'
"""Namespace of an SVG file; an element of a page has none."""
SETUP = Staging("manual", "Manual", (0.5, 0.5), 1.0, rows=340, columns=340)
"""The smallest frame that holds the whole chart."""
IMAGE = re.compile(r'<img[^>]* src="data:image/png;base64,([^"]+)" alt="([^"]*)"')
DRAWING = re.compile(r'<svg role="img" aria-label="([^"]*)".*?</svg>', re.DOTALL)
PATIENCE_S = 60.0
"""Limit of the wait for a screen."""
DUMP = "60x80,Y,u16be,0,65535"
CELL_MM = 300 / 320
Pictures = dict[str, bytes]


def manual_pictures(printed: Callable[[Sequence[str]], str], progress: Progress = silent) -> Mapping[str, bytes]:
    """The pictures by the name of their files; a step of progress for each of `PARTS`. `printed(words)` is what a
    command writes to stdout."""
    pictures: Pictures = {}
    with TemporaryDirectory() as folder:
        for part in PARTS:
            drawn = part(Path(folder))
            progress(f"drew {', '.join(drawn)}")
            pictures |= drawn
        with chdir(folder):
            return pictures | _terminal_pictures(Path(), printed)


def _of_page(page: str, begins: Mapping[str, str]) -> Pictures:
    """The figures of a page by the name of a picture and the beginning of their caption."""
    drawn = {unescape(one[1]): (".svg", _file_of(one[0])) for one in DRAWING.finditer(page)}
    drawn |= {unescape(one[2]): (".png", base64.b64decode(one[1])) for one in IMAGE.finditer(page)}
    pictures = {}
    for name, begin in begins.items():
        suffix, data = next(one for caption, one in drawn.items() if caption.startswith(begin))
        pictures[f"{name}{suffix}"] = data
    return pictures


def _file_of(drawing: str) -> bytes:
    return drawing.replace("<svg", f"<svg {NAMESPACE}", 1).encode()


def _measured(name: str, paths: Sequence[Path], out: Path, **settings: object) -> str:
    """The page of a procedure's measurement, whose files are written too."""
    procedure = procedure_named(name)
    given = read_model(procedure.Settings, settings, TableSource())
    return _written(name, next(iter(procedure.measurements(paths, given))), out)


def _written(name: str, measurement: Measurement, out: Path) -> str:
    with ResultFolder(out) as folder:
        write_measurement(folder, measurement)
    return procedure_named(name).page(measurement).decode()


def _grey(path: Path, light: npt.NDArray[np.floating[Any]]) -> Path:
    cv2.imwrite(str(path), np.rint(65535 * np.clip(light, 0, 1)).astype(np.uint16))
    return path


def _pattern(folder: Path) -> Pictures:
    chart, path = Source.from_seed().with_edges(), folder / "photograph.dng"
    taken = photograph(SETUP, chart.chart, np.random.default_rng(1), path)
    frame = read_frame(path)
    frame = replace(frame, planes={SHOWN_PLANE: frame.planes[SHOWN_PLANE]})
    (plane,) = compared_planes(frame, taken, chart, PatternParameters(print_blur=PRINT_BLUR), SETUP, silent)
    estimate, truth = plane.result.estimate, plane.comparison
    assert estimate is not None  # the simulated photograph is a good one
    assert truth is not None
    psf, limit = estimate.psf, estimate.diffraction
    figures = {
        "photograph": psf_figures.photograph_figure(frame.planes[SHOWN_PLANE], estimate, "photograph"),
        "residual": psf_figures.residual_figure(SHOWN_PLANE, estimate, "residual"),
        "psf": psf_figures.psf_figure(psf, None, "psf"),
        "psf-and-truth": psf_figures.psf_figure(psf, truth.aligned, "psf-and-truth"),
        "psf-logarithmic": psf_figures.log_psf_figure(psf, "psf-logarithmic"),
        "mtf": otf_figures.mtf_figure(estimate.quality, None, "mtf", limit),
        "mtf-and-truth": otf_figures.mtf_figure(estimate.quality, truth.otf, "mtf-and-truth", limit),
        "mtf-map": otf_figures.mtf_map_figure(psf, "mtf-map", limit),
        "phase": otf_figures.phase_figure(psf, "phase"),
        "energy": psf_figures.energy_figure(radial_profile(psf), "energy"),
    }
    pictures = {f"{name}.svg": _file_of(str(figure.drawing)) for name, figure in figures.items()}
    certificate = curves_figure([plane.result])
    assert certificate is not None
    return {
        "sheet.png": encode(Path("sheet.png"), chart, Size(WIDTH_MM)).data,
        "certificate.png": certificate,
        **pictures,
    }


def _witnessed(folder: Path) -> Pictures:
    """The four photographs with witnesses, and the agreement of the PSF with those of two more photographs."""
    chart, quick = Source.from_seed().chart, {"plane": SHOWN_PLANE, "s": 3, "k": 13}
    far, near = SETUP, replace(SETUP, s_over_t=1.5, rows=510, columns=510)
    shots = (far, 0.5, 0), (far, 1, 0), (near, 1, 0), (far, 1, 0.6), (far, 1, 0), (far, 1, 0)
    paths = [folder / f"shot{n}.dng" for n in range(len(shots))]
    for n, (setup, light, blur_px) in enumerate(shots):
        camera, scene = stage(setup, chart)
        camera = replace(camera, optics=Optics((*OPTICS.blurs, GaussianBlur(blur_px)), OPTICS.pitch_um))
        camera.photograph(scene, np.random.default_rng(n), paths[n], exposure_s=light * EXPOSURE_S, iso=ISO, bits=14)
    results = [folder / name for name in ("witnessed", "again", "once-more")]
    pictures = _of_page(_measured("witnessed", paths[:4], results[0], **quick), {"witnessed": "MTF of the"})
    _measured("pattern", paths[4:5], results[1], **quick)
    _measured("pattern", paths[5:], results[2], **quick)
    return pictures | _of_page(_measured("stability", results, folder / "stability"), {"stability": "Mean MTF"})


def _series(folder: Path) -> Pictures:
    lens = [(n, 0.42 - 0.06 * np.log2(n / 5) ** 2) for n in (2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0)]
    points = [Point("G1", MTF50_HORIZONTAL, SeriesSetting(n, 2e3, 100.0), y, 0.006, "cycles/pixel", 3) for n, y in lens]
    return _of_page(series_page(points, []), {"series": ""})


def _guided(plan: str, begins: Mapping[str, str]) -> Callable[[Path], Pictures]:
    """A part from the page of a guided session on the simulated bench."""

    def part(folder: Path) -> Pictures:
        ended, _ = run_guided(folder / plan, 1, lambda sentence, remedy: None, plan)
        assert ended.report is not None
        return _of_page(ended.report.read_text(encoding="utf-8"), begins)

    return part


def _field(folder: Path) -> Pictures:
    """A frame with a chart at six places, and its correction by the field."""
    shot = _grey(folder / "charts.pgm", six_charts())
    field = _measured("field", [shot], folder / "field", s=3, k=13)
    begins = {
        "field-psfs": "The PSF of Y from", "field-places": "Where it was measured", "field-heights": "Sagittal (solid)",
        "field-map": "MTF50 of sagittal detail", "field-error": "Predicted error",
    }  # fmt: skip
    corrected = _measured("correct", [shot], folder / "corrected", field=folder / "field" / "field.h5")
    of_corrected = {"correction-before": "In the middle: Before", "correction-after": "In the middle: After"}
    return _of_page(field, begins) | _of_page(corrected, of_corrected)


def _vignetting(folder: Path) -> Pictures:
    """Four flats of light that falls off with the fourth power of the cosine."""
    y, x = np.mgrid[-1:1:96j, -1:1:128j]
    rng = np.random.default_rng(7)
    light = 0.5 * np.cos(np.arctan(0.45 * np.hypot(x, 0.75 * y))) ** 4
    paths = [_grey(folder / f"flat{n}.pgm", light + 0.001 * rng.standard_normal(x.shape)) for n in range(4)]
    return _of_page(_measured("vignetting", paths, folder / "vignetting"), {"vignetting": "Light of Y"})


def _tilt(folder: Path) -> Pictures:
    measurement = tilt_measurement(RecordHead("tilt"), "G1", Outcome(tilted_sensor(noise_um=1.0)))
    page = procedure_named("tilt").page(measurement).decode()
    return _of_page(page, {"tilt": "Height of the sensor", "screws": "The screws"})


def _restoration(folder: Path) -> Pictures:
    paths = [_grey(folder / f"blurred_{number}.pgm", defocused(sigma)) for number, sigma in ((1, 1.0), (2, 1.5))]
    lens = {"metres": "front", "f_number": (4.2, 2.8), "focus_m": (2.0,), "focal_length_mm": 50, "pixel_pitch_um": 8.0}
    settings = {"blur": "defocus", "shape": ("gaussian",), "max_w": 6, **lens}
    page = _measured("restore", paths, folder / "restored", **settings)
    begins = {"restoration-before": "photograph 1", "restoration-after": "restored", "restoration-depth": "The wider"}
    refocused = _measured("refocus", [folder / "restored"], folder / "refocused", f_number=4.0, focus_m=1.6)
    return _of_page(page, begins) | _of_page(refocused, {"refocused": "refocused"})


def _rays(folder: Path) -> Pictures:
    """A render of 16 samples per pixel: a step of light, the samples distributed exponentially."""
    light = np.where(np.hypot(*np.mgrid[-1:1:64j, -1:1:80j]) < 0.6, 0.9, 0.25)[..., None, None]
    np.savez(folder / "film.npz", samples=light * np.random.default_rng(5).exponential(1.0, (64, 80, 16, 3)))
    page = _measured("rays", [folder / "film.npz"], folder / "filtered")
    return _of_page(page, {"render": "as rendered", "render-filtered": "filtered"})


def _batch(folder: Path) -> Pictures:
    """An edge at 5.5 degrees, photographed twelve times, once out of focus."""
    rng, lines, numbers = np.random.default_rng(9), [], []
    procedure = procedure_named("edge")
    for n in range(12):
        light = edge_light(1.1 if n == 8 else 0.7)
        path = _grey(folder / f"edge{n:02d}.png", light + 0.004 * rng.standard_normal(light.shape))
        (plane,) = next(iter(procedure.measurements([path], procedure.Settings()))).planes
        numbers.append(plane.numbers[EDGE_CROSSINGS[50]])
        lines.append(
            BatchLine(path.name, str(plane.verdict), "", "", "", planes={plane.name: {EDGE_CROSSINGS[50]: numbers[-1]}})
        )
    values = [number.value for number in numbers], [number.uncertainty for number in numbers]
    group = NumberGroup("", plane.name, EDGE_CROSSINGS[50], numbers[0].unit, *values)
    return _of_page(batch_page(BatchReport("", {}, {}, lines, len(lines), [group])), {"batch": "MTF50 across"})


def _library(folder: Path) -> Pictures:
    """The plot and the page of an edge in a dump of a sensor."""
    light = edge_light() + 0.004 * np.random.default_rng(10).standard_normal((80, 60))
    path, raw = folder / "dump.raw", DUMP
    path.write_bytes(np.rint(65535 * light).astype(">u2").tobytes())
    page = _measured("edge", [path], folder / "dump", raw=raw)
    plane = read_frame(path, layout=DumpLayout.parse(raw)).planes["Y"]
    figure, file = Figure(figsize=(5, 3), layout="constrained"), BytesIO()
    estimate_edge(plane, Roi(0, 0, 60, 80)).plot(figure.add_subplot())
    figure.savefig(file, format="png", dpi=100, metadata={"Software": None})
    return {**_of_page(page, {"dump-mtf": "MTF across"}), "library-plot.png": file.getvalue()}


def _reproduced(folder: Path) -> Pictures:
    (row,) = (one for one in ROWS if one.name == "bound-expected")
    return {"reproduced.svg": _file_of(str(compute(row, Setting()).computed.figures[0]))}


def _trend(folder: Path) -> Pictures:
    """MTF50 of a lens that loses its adjustment, in eight sessions."""
    rng, measured = np.random.default_rng(11), []
    for month in range(1, 9):
        value = 0.31 - 0.004 * month + 0.002 * rng.standard_normal()
        of = (folder, "camera", "lens", "pattern", f"2026-{month:02d}-01T12:00:00+00:00", "G1", "pass")
        measured.append(IndexedNumber(*of, MTF50_HORIZONTAL, value, "cycles/pixel", 0.002))
    path = Path("session-trend.svg")
    return {path.name: trend_picture("camera", trends(measured), path)}


def _geometry(folder: Path) -> Pictures:
    """Six views of a lens with known distortion, and of a second camera 60 mm to its right."""
    lens = simple_camera("OPENCV", (5200.0, 5204.0), (3012.0, 1989.0), (6000, 4000))
    lens = replace(lens, params=np.array([*lens.params[:4], -0.12, 0.06, 4e-4, -3e-4]))
    page, _ = (_six_views(lens, 60.0 * n, folder / name) for n, name in enumerate(("left", "right")))
    return _of_page(page, {"geometry-coverage": "What the camera was", "geometry-distortion": "Distortion: from"})


def _six_views(lens: CameraModel, to_right_mm: float, out: Path) -> str:
    """The page of the geometry of a camera displaced to the right, whose files are written too."""
    rng, nodes, records = np.random.default_rng(12), chart_nodes(CELL_MM), []
    for n, place in enumerate([(0.5, 0.5), (0.25, 0.3), (0.75, 0.3), (0.25, 0.7), (0.75, 0.7), (0.5, 0.35)]):
        tilt = Rotation.from_rotvec(0.5 * np.array([np.cos(2.4 * n), np.sin(2.4 * n), 0]))
        at = (np.array(place) * (6000, 4000) - (3012, 1989)) / 5200
        points = lens.project(tilt.apply(nodes) + 500 * np.append(at, 1) - (to_right_mm, 0, 0))
        points += 0.01 * rng.standard_normal(points.shape)
        inside = np.flatnonzero(((points >= 0) & (points <= (5999, 3999))).all(axis=1))
        view = ChartView(f"view{n}", inside, points[inside], np.tile(1e-4 * np.eye(2), (len(inside), 1, 1)))
        records.append(ViewRecord(Path(f"view{n}.dng"), f"{n:064}", view, Verdict.PASS))
    shoot = GeometryPhotographs("G1", (6000, 4000), tuple(records))
    planes = conclude([shoot], GeometryParameters(CELL_MM, model="OPENCV"))
    return _written("geometry", geometry_measurement(planes, RecordHead("geometry", files_read(records), {})), out)


def _phone(folder: Path) -> Pictures:
    """The newest photograph as the service sends it, with the chart's outline as it is and as it is wanted."""
    path = folder / "phone.dng"
    photograph(SETUP, Chart.from_seed(), np.random.default_rng(13), path)
    plane = read_frame(path).planes[SHOWN_PLANE].samples
    sighting = find_chart(plane)
    wanted = frontal_outline(plane.shape, 1.05 * float(sighting.widths().mean()) / CELLS, (0.45, 0.52))
    outlines = {"#e67e22": present_outline(sighting.H_sensor_pattern), "#34ace0": wanted}
    rows, columns = plane.shape
    jpeg = base64.b64encode(jpeg_of(plane)).decode()
    drawn = "".join(
        f'<polygon points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in corners)}" fill="none" stroke="{colour}" '
        f'stroke-width="2"/>'
        for colour, corners in outlines.items()
    )
    picture = f'<image href="data:image/jpeg;base64,{jpeg}" width="{columns}" height="{rows}"/>{drawn}'
    return {"phone.svg": f'<svg {NAMESPACE} viewBox="0 0 {columns} {rows}">{picture}</svg>'.encode()}


SCREENS = ("plans", (), "homed"), ("bench", ("f3",), "ready"), ("focus", ("f7", "enter"), "s/t")
"""Name, keys that lead to the screen, and a word that it has when it is complete."""


def self_contained(svg: str) -> str:
    """A screen without fonts from the network: any fixed-width font will do, the letters' places are in the file."""
    svg = re.sub(r"@font-face \{.*?\}", "", svg, flags=re.DOTALL)
    return re.sub(r"font-family: [^;]+;", "font-family: ui-monospace, 'DejaVu Sans Mono', monospace;", svg)


def _screens(folder: Path) -> Pictures:
    """The application on the simulated bench: the plans, the devices, and live focus."""
    lab = StationLab(sessions=folder / "sessions", config=None, simulate=True)
    lab.virtual_time = True

    async def drawn() -> dict[str, str]:
        app, shown = StationApp(lab, plan="camera"), {}
        async with app.run_test(size=(100, 26)) as pilot, asyncio.timeout(PATIENCE_S):
            for name, keys, wanted in SCREENS:
                await pilot.press(*keys)
                while wanted not in (svg := app.export_screenshot(title="station")):
                    if "clear:" in svg.replace("&#160;", " "):
                        await pilot.press("1", "enter")
                    await pilot.pause(0.3)
                shown[f"screen-{name}.svg"] = svg
        return shown

    try:
        return {name: self_contained(svg).encode() for name, svg in asyncio.run(drawn()).items()}
    finally:
        lab.close()


COMMANDS = (
    ("rig", "rig left right --out rig --json"),
    ("profile-add", "profile add field --library library --camera Simulated --lens Wide --f-number 4"),
    ("profile-find", "profile find --library library --camera Simulated --lens Wide --f-number 4"),
    ("profile-export", "profile export field --to gmic filters"),
    ("sharpen", "sharpen charts.pgm --field field/field.h5 --out sharp"),
    ("explain", "explain certified"),
    ("verify", "verify certified/certificate.html"),
    ("session-list", "session list --sessions edge"),
    ("session-show", "session show SESSION --sessions edge"),
    ("session-resume", "session resume --sessions edge"),
    ("session-recompute", "session recompute SESSION --sessions edge"),
    ("session-report", "session report SESSION --sessions edge"),
    ("session-index", "session index --sessions edge"),
    ("session-delete", "session delete SESSION --sessions edge --yes"),
    ("conform", "conform zaber --operations 5"),
    ("simulate", "simulate --for-s 0"),
    ("completion", "completion bash"),
    ("init", "init project"),
    ("manual-search", "manual search mtf50"),
)
"""Pictures of what commands write, by name, in an order in which each finds its files."""
ROWS_SHOWN, COLUMNS_SHOWN = 26, 92


def _terminal_pictures(folder: Path, printed: Callable[[Sequence[str]], str]) -> Pictures:
    """The text that every command of `COMMANDS` writes, as a terminal shows it."""
    printed(["mtf", "edge", "dump.raw", "--raw", DUMP, "--certificate", "--out", "certified"])
    session = next(one.name for one in (folder / "edge").iterdir() if one.is_dir())
    pictures: Pictures = {}
    for name, command in COMMANDS:
        words = command.replace("SESSION", session).split()
        lines = [line[:COLUMNS_SHOWN] for line in printed(words).splitlines()]
        rest = ["..."] if len(lines) > ROWS_SHOWN else []
        console = Console(record=True, width=COLUMNS_SHOWN, file=StringIO())
        console.print(Text("\n".join([f"$ station {' '.join(words)}", *lines[:ROWS_SHOWN], *rest])))
        pictures[f"terminal-{name}.svg"] = self_contained(console.export_svg(title="station")).encode()
    return pictures


PARTS: tuple[Callable[[Path], Pictures], ...] = (
    _pattern,
    _guided(
        "edge", {"edge-places": "Where the edges", "edge-mtf": "MTF across", "edge-profile": "Light over the distance"}
    ),
    _guided("two-photo", {"wall-pair": "The near photograph", "wall-kernel": "The kernel"}),
    _guided(
        "sensor", {"photon-transfer": "Photon transfer", "snr": "Signal-to-noise", "spectrogram": "Dark: spectrograms"}
    ),
    _field,
    _vignetting,
    _tilt,
    _restoration,
    _witnessed,
    _series,
    _rays,
    _batch,
    _library,
    _reproduced,
    _trend,
    _geometry,
    _phone,
    _screens,
)
"""Each writes its inputs and results into a folder, and gives some pictures."""
