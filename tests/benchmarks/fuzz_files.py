"""Small files of every format that the station reads, written by its own writers, and how each is read."""

import json
import os
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import numpy as np
import rawpy  # noqa: F401  (loaded once, before the forks)

from drivers.dng import Shot, write_dng
from procedures.field.field_file import read_camera as read_camera_of_field
from procedures.field.field_file import read_colours, read_field, write_field
from procedures.field.interpolate import interpolate
from procedures.field.maps import DEGREES, LateralColour
from procedures.field.surfaces import fit_surface
from procedures.outcome import ProcedureError, Verdict
from procedures.pattern_print.source import Source
from procedures.psf import Psf
from procedures.psf_field import Node, in_half_diagonals
from procedures.raw import read_frame
from procedures.ray_histogram.film import film_of_samples
from procedures.ray_histogram.film_files import read_film, write_film
from procedures.ray_histogram.filter import FilterParameters
from procedures.ray_histogram.multiscale import filter_film
from procedures.reading import hdf5
from procedures.reading.exposure import Exposure
from procedures.reading.sensor_dump import DumpLayout
from procedures.restoration.joint.estimate import RestorationParameters
from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.masks import blur_models
from procedures.restoration.masks.blur_operator import BlurOperator
from procedures.restoration.masks.camera_motion import Poses, motion_blur, poses_of
from procedures.restoration.masks.psf_shapes import measured_field
from procedures.restoration.photograph_blur import BlurSpec, KnownShapes, UnknownMotion, blur_of
from procedures.restoration.unknown_motion.motion_splines import fit_recorded
from procedures.restoration.unknown_motion.recorded_paths import read_path, recorded_masks
from procedures.slanted_edge.estimate import estimate_edges
from station.batch.procedure_file import read_procedure
from station.bench.opening import make_bench, read_config
from station.calibration.exports.geometry import CAMERA_FORMATS, export_camera
from station.calibration.field_photographs import focus_positions
from station.calibration.restoration.inputs import (
    COLUMNS,
    POSE_COLUMNS,
    Shape,
    imu_table,
    read_blur_shape,
    read_imu,
    read_poses,
)
from station.calibration.sensor import measure_sensor
from station.calibration.sensor_folder import Shots, find_shots
from station.calibration.sensor_models import read_sensor
from station.calibration.stored_cameras import read_camera, read_rig_camera
from station.calibration.vignetting import measure_flats, read_joint_formula, read_vignetting
from station.results.plane_result import PlaneResult
from station.results.psf_files import write_psf_result
from station.results.reader import read_result
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder, damage
from station.results.specification_file import read_specification
from station.sessions.index import Index
from station.sessions.reader import check_whole, read_session, verify, verify_results
from tests.psfs import gaussian
from tests.station.sessions.faulty_disk import FaultyDisk
from tests.station.sessions.work import Camera as SessionCamera
from tests.station.sessions.work import Work

SIZE = (40, 60)


def _fork(words: list[str], **_: object) -> Any:
    """An HDF5 file gone through in a fork, where the reader begins an interpreter, which takes longer than all else."""
    child = os.fork()
    if child == 0:
        sys.argv = ["-c", *words[3:]]
        with suppress(BaseException):
            exec(words[2], {})
        os._exit(0)
    return SimpleNamespace(returncode=os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))


hdf5.subprocess = SimpleNamespace(run=_fork, TimeoutExpired=TimeoutError)  # type: ignore[attr-defined, assignment]


def _rng() -> np.random.Generator:
    return np.random.default_rng(7)


def _levels() -> np.ndarray:
    return _rng().integers(200, 60_000, SIZE, dtype=np.uint16)


def _picture(path: Path) -> None:
    path.write_bytes(cv2.imencode(path.suffix, _levels())[1].tobytes())


def _pgm(path: Path) -> None:
    path.write_bytes(b"P5 60 40 65535\n" + _levels().astype(">u2").tobytes())


def _plain_pgm(path: Path) -> None:
    path.write_text("P2\n# levels\n60 40\n65535\n" + " ".join(map(str, _levels().ravel())))


def _dng(path: Path) -> None:
    shot = Shot(exposure_s=0.02, iso=100, f_number=8.0)
    write_dng(path, _levels() // 8, shot, cfa="RGGB", black=(64, 64, 64, 64), white=8191, bits=16)


def _cells(path: Path) -> None:
    path.write_bytes(cv2.imencode(".png", 255 * _rng().integers(0, 2, (256, 256), dtype=np.uint8))[1].tobytes())


def samples() -> np.ndarray:
    return _rng().random((8, 9, 6, 3)).astype(np.float32)


def _film(path: Path) -> None:
    write_film(film_of_samples(samples()), path)


def _exr(path: Path) -> None:
    import OpenEXR

    film = film_of_samples(samples())
    bins = film.histogram.reshape(*film.count.shape, 60).astype(np.float32)
    channels = {f"Bin_{i:04d}": np.ascontiguousarray(bins[..., i]) for i in range(60)}
    channels |= {"Bin_0060": film.count.astype(np.float32)}
    channels |= {name: np.ascontiguousarray(film.mean[..., i], np.float32) for i, name in enumerate("RGB")}
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, channels).write(str(path))


def _psf(width: float = 1.0, k: int = 9) -> Psf:
    return gaussian(0.5 * width, 3, k)


def _result(path: Path) -> None:
    """A result's folder, whose file of this name is then mutated."""
    with ResultFolder(path.parent) as folder:
        write_psf_result(folder, [PlaneResult.of("G1", Verdict.PASS, _psf())], RecordHead("pattern"))
    (path.parent / "mtf_G1.csv").write_text("frequency,horizontal,vertical,radial\n0,1,1,1\n0.5,0.4,0.4,0.4\n")


def _field(path: Path) -> None:
    places = np.array([(x, y) for y in (5.0, 20.0, 35.0) for x in (5.0, 30.0, 55.0)])
    rng = _rng()
    nodes = [
        Node(xy, np.eye(2) * 1e-4, 2 * xy, _psf(1 + 0.002 * xy[0] + 0.01 * rng.standard_normal(), 5)) for xy in places
    ]
    noted = Exposure(camera="Box", lens="50 mm", f_number=8.0, focal_length_mm=50.0)
    shift = 0.01 * (places - places.mean(axis=0)) / 30
    colour = LateralColour("G1", "G2", SIZE, places, shift, np.tile(np.eye(2) * 1e-6, (9, 1, 1)), None)  # type: ignore[arg-type]
    colour = replace(colour, surface=fit_surface(in_half_diagonals(places, SIZE), shift, colour.covariance, DEGREES))
    write_field(path, {"G1": interpolate("G1", SIZE, nodes)}, {}, [colour], {"input": "[]"}, noted)


def _dump(path: Path) -> None:
    path.write_bytes(_levels().astype("<u2").tobytes())


SENSOR = {
    "procedure": "sensor",
    "iso": 100,
    "planes": {
        "G1": {
            "model": {
                "gain": 0.1, "gain_uncertainty": 1e-3, "dark_level": 64.0, "dark_variance": 9.0, "saturation": 4000.0,
                "signal_at_saturation": 4100.0, "bend": [-0.02, 0.001], "bend_uncertainty": 1e-4, "dsnu": 1.0,
                "prnu": 0.01,
            },
            "noise_power": {"file": "nps_G1.npy", "signal": 2000.0, "blocks": 60},
        },
    },
}  # fmt: skip
"""What a sensor's record shows that others use."""


def _sensor(path: Path) -> None:
    """A sensor's record and noise spectrum."""
    (path.parent / "sensor.json").write_text(json.dumps(SENSOR, indent=1))
    np.save(path.parent / "nps_G1.npy", 200 + _rng().random((8, 8)))


def _read_sensor(path: Path) -> None:
    photograph: Any = SimpleNamespace(exposure=SimpleNamespace(iso=100.0), planes={"G1": None})
    known = read_sensor(path.parent / "sensor.json", photograph)
    known.models["G1"].linearised(np.linspace(-10, 4000, 50))
    if known.noise:
        known.information("G1", _psf())


def _camera(path: Path) -> None:
    """A geometry's record."""
    camera = {"model": "OPENCV", "params": [900.0, 905, 320, 240, -0.1, 0.02, 1e-4, 2e-4], "columns": 640, "rows": 480}
    region = [[10.0, 10], [600, 12], [610, 450], [15, 460]]
    path.write_text(json.dumps({"procedure": "geometry", "planes": {"Y": {"camera": camera, "region": region}}}))


def _exports(path: Path) -> None:
    stored = read_camera(path)
    for form in CAMERA_FORMATS:
        export_camera(stored, form)


def _pictures(text: str) -> Callable[[Path], None]:
    """A manifest and the pictures that it names."""

    def write(path: Path) -> None:
        path.write_text(text)
        for name in ("d1.png", "d2.png", "a1.png", "a2.png"):
            (path.parent / name).touch()

    return write


def _session(path: Path) -> None:
    """A session that came to its end; the file is one of its own."""
    folder = Work(path.parent / "sessions", SessionCamera(path.parent / "incoming")).go(FaultyDisk()).folder
    path.write_bytes((folder / path.name).read_bytes())
    path.with_name("which").write_text(str(folder))


def _read_session(path: Path) -> None:
    """The file put into its session, which is listed, and read whole."""
    folder = Path(path.with_name("which").read_text())
    (folder / path.name).chmod(0o644)
    (folder / path.name).write_bytes(path.read_bytes())
    with Index(folder.parent) as index:
        index.sessions()
    record = read_session(folder)
    check_whole(record)
    verify(folder, record.state)
    verify_results(record)


def _text(text: str) -> Callable[[Path], None]:
    return lambda path: path.write_text(text) and None


def _record(path: Path, columns: tuple[str, ...], along: float, about: float) -> None:
    """What a rig that vibrates writes, 20 rows at 100 Hz from 0.02 s before the opening of the shutter on."""
    t = np.arange(-2, 18) / 100
    waves = [size * np.sin(2 * np.pi * (5 + n) * t + n) for n, size in enumerate([along] * 3 + [about] * 3)]
    rows = [",".join(columns), *(",".join(f"{value:.6g}" for value in row) for row in np.column_stack([t, *waves]))]
    path.write_text("\n".join(rows) + "\n")


def _moved(poses: Poses) -> None:
    _finite(motion_blur([poses, poses], 300.0, FRAME, 1.0).fields[0].middle.masks)


def _imu_motion(path: Path) -> None:
    imu = read_imu(path)
    imu_table(imu)
    _moved(poses_of(imu, 0.1))


def _path(path: Path) -> None:
    """Where the search of a motion begins that was recorded."""
    found = recorded_masks(np.stack([one[0] for one in photographs()]), [read_path(path), CIRCLE], 3)
    _finite(fit_recorded(CIRCLE, found[0], 2.0))


@cache
def photographs() -> list[np.ndarray]:
    """Two of a flat scene, defocused unlike."""
    rng, shape = _rng(), blur_models.pillbox()
    scene = 0.4 + 0.1 * np.sign(rng.standard_normal((12, 17))).repeat(4, 0).repeat(4, 1)
    taken = []
    for ratio in (1.0, 1.3):
        blur = BlurOperator(blur_models.mask_stack(shape, 2.0, ratio=ratio, R=4), FRAME)
        blur.focus(np.full(blur.extended, 1.2))
        taken.append(blur.blur(scene[None]) + 0.002 * rng.standard_normal((1, *FRAME)))
    return taken


def restored(shape: Shape | None = None) -> None:
    """The photographs restored, in the shortest way, as if this had blurred them."""
    one = blur_models.pillbox() if shape is None else shape
    quick = RestorationParameters(scheme=Scheme(1, 2, 2, 1, 2))
    blur = blur_of(BlurSpec(KnownShapes((one, one), (1.0, 1.3)), 2.0), photographs())
    _finite(blur.restored(photographs(), quick).result().sharp)


def _shape(path: Path, samples_per_px: int | None = None) -> None:
    restored(read_blur_shape(str(path), "G1", FRAME, samples_per_px))


def _kernel(path: Path) -> None:
    """A kernel that a restoration found, beside its record."""
    np.save(path.parent / "kernel_1.npy", _psf(k=7).h)
    (path.parent / "result.json").write_text(json.dumps({"kernels": ["kernel_1.npy"], "parameters": {"s": 3}}))


def _blur(path: Path) -> None:
    for field_ in read_field(path).values():
        restored(measured_field(field_, FRAME, (2, 2)))
        _finite(field_.at(20.0, 20.0).h)


def _geometry(path: Path) -> None:
    """The views of a geometry, with their points."""
    views = [{"source": f"{n}.dng", "R": np.eye(3).tolist(), "t_mm": [0.0, 10.0 * n, 900.0]} for n in range(3)]
    camera = {"model": "SIMPLE_RADIAL", "columns": 90, "rows": 60, "params": [100.0, 45.0, 30.0, 0.0]}
    planes = {"Y": {"views": views, "camera": camera, "region": [[0, 0], [89, 0], [89, 59]]}}
    (path.parent / "result.json").write_text(json.dumps({"procedure": "geometry", "planes": planes}))
    np.save(path.parent / "geometry_nodes.npy", np.zeros((4, 3)))
    np.save(path.parent / "geometry_points.npy", [[n, node, 5, 7, 0.1, 0, 0.1] for n in range(3) for node in range(4)])


def _vignetting(path: Path) -> None:
    """The light of a plane, and what its numbers share."""
    light = {"rows": 40, "columns": 60, "degree": 2, "coefficients": [0.0, 0.0, -0.1, 0.0, -0.1]}
    record = {
        "procedure": "vignetting",
        "planes": {"Y": {"light": light, "centre": [30.0, 20.0]}},
        "formula": {"planes": ["Y"], "values": [30.0, 20.0, -0.1, 0.01, 0.0]},
    }
    (path.parent / "result.json").write_text(json.dumps(record))
    np.save(path.parent / "vignetting_covariance.npy", np.eye(5) * 1e-6)


def _lights(path: Path) -> None:
    for one in read_vignetting(path.parent).values():
        one.light.at(np.array([[20.0, 20.0]]))
    read_joint_formula(path.parent)


def _tiny(data: bytes) -> bytes:
    """A picture of a few pixels, its size stated by the content."""
    columns, rows, *levels = (*data[-400:], *bytes(400))
    columns, rows = 1 + columns % 9, 1 + rows % 9
    return f"P5 {columns} {rows} 255\n".encode() + bytes(levels[: columns * rows])


def _tiny_frame(path: Path) -> None:
    """Everything that is made of one photograph or two, each refusing it in its own way."""
    (plane,) = read_frame(path).planes.values()
    both = np.stack([plane.samples, plane.samples[::-1] + 0.01]).astype(np.float64)
    darks, lights = Shots("dark", 0.01, None, None, (path,) * 2), Shots("light", 0.01, 9.0, None, (path,) * 2)
    for work in (
        lambda: estimate_edges(plane),
        lambda: measure_flats([path]),
        lambda: measure_sensor([darks, *[lights] * 3], None),
        lambda: blur_of(BlurSpec(UnknownMotion("whole")), [one[None] for one in both]),
        lambda: blur_of(BlurSpec(UnknownMotion()), [one[None] for one in both]),
    ):
        with suppress(ProcedureError):
            work()


def _noted(path: Path) -> None:
    read_camera_of_field(path)
    for colour in read_colours(path).values():
        _finite(colour.shift_at(np.array([[20.0, 20.0]])))


def _filter(path: Path) -> None:
    _finite(filter_film(read_film(path).checked(), FEW, threads=1).picture)


def _frame(path: Path, layout: DumpLayout | None = None) -> None:
    for plane in read_frame(path, layout=layout).planes.values():
        _finite(plane.samples)


LAYOUT = DumpLayout(60, 40, "RGGB", "u16le", 64, 65535)
FEW = FilterParameters(scales=1, search=2)


FRAME = SIZE
CIRCLE = np.stack([np.cos(np.arange(30) / 5), np.sin(np.arange(30) / 5)], axis=1)


def _finite(values: np.ndarray) -> None:
    if not values.size or not np.isfinite(values).all():
        raise ArithmeticError("a result that is not a finite number")


def _positions(path: Path) -> None:
    focus_positions(path, [Path(f"{n}.dng") for n in range(9)])


PROCEDURE = """procedure = "pattern"
planes = ["G1"]
coverage = 2
parameters = { s = 4, k = 17, solver = "ls" }
chart = { seed = 1 }
optics = { pixel_pitch_um = 3.76, f_number = 8, wavelength_nm = 530 }
raw = "1920x1080,RGGB,u16le,64,1023"
[limits]
mtf50_horizontal = { min = 0.25 }
"""
SPECIFICATION = """coverage = 2
[limits]
energy_above_nyquist = { max = 0.05, planes = ["G1", "G2"] }
[[limit]]
number = "mtf"
at = 0.25
min = 0.5
place = "centre"
"""
BENCH = """[devices.stage]
driver = "grbl"
port = "socket://127.0.0.1:9"
axes = [{ name = "z_mm", letter = "X", feed_per_min = 3000 }]
[devices.shutter]
driver = "strig"
port = "socket://127.0.0.1:10"
[devices.camera]
driver = "folder"
folder = "incoming"
shutter = "shutter"
"""
LADDER = """file,kind,exposure_s,photons
d1.png,dark,0.01,
d2.png,dark,0.01,
a1.png,light,0.01,1500
a2.png,light,0.01,1500
"""
LEVELS = """[[level]]
kind = "dark"
exposure_s = 0.01
files = ["d1.png", "d2.png"]
[[level]]
kind = "light"
exposure_s = 0.01
photons = 1500
files = ["a1.png", "a2.png"]
"""
DESCRIPTOR = "v 4.0\nn 12 8 8\nb 10000000 1500,0\ni a1.png\ni a2.png\nd 10000000\ni d1.png\ni .\\d2.png\n"
SHAPE = "\n".join(" ".join(f"{v:.4g}" for v in row) for row in _psf(k=7).h)
PATH = "\n".join(f"{np.cos(n / 5):.3f} {np.sin(n / 7):.3f}" for n in range(30))


def _stored(path: Path) -> None:
    """A film's archive without compression, whose members can be summed again."""
    write_film(film_of_samples(samples()), path)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)


def _summed_png(data: bytes) -> bytes:
    """The same with the sums that its chunks have now: else a decoder looks no further."""
    changed, at = bytearray(data), 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        end = at + 8 + length
        if end + 4 > len(data):
            break
        changed[end : end + 4] = struct.pack(">I", zlib.crc32(data[at + 4 : end]))
        at = end + 4
    return bytes(changed)


def _summed_zip(data: bytes) -> bytes:
    """The same with the sums that its members have now, as far as they are found."""
    changed, at = bytearray(data), data.find(b"PK\1\2")
    while at >= 0 and at + 46 <= len(data):
        size, local = struct.unpack_from("<I", data, at + 20)[0], struct.unpack_from("<I", data, at + 42)[0]
        if local + 30 <= len(data):
            begin = local + 30 + sum(struct.unpack_from("<HH", data, local + 26))
            changed[at + 16 : at + 20] = struct.pack("<I", zlib.crc32(data[begin : begin + size]))
        at = data.find(b"PK\1\2", at + 46)
    return bytes(changed)


# name of the file -> how it is written, how it is read
READERS: dict[str, tuple[Callable[[Path], None], Callable[[Path], object]]] = {
    "frame.dng": (_dng, _frame),
    "frame.png": (_picture, _frame),
    "summed.png": (_cells, Source.from_file),
    "shades.png": (_picture, _frame),
    "frame.tif": (_picture, _frame),
    "frame.pgm": (_pgm, _frame),
    "plain.pgm": (_plain_pgm, _frame),
    "frame.raw": (_dump, lambda path: _frame(path, LAYOUT)),
    "cells.png": (_cells, Source.from_file),
    "film.npz": (_film, _filter),
    "summed.npz": (_stored, _filter),
    "film.exr": (_exr, _filter),
    "psf_G1.npy": (_result, _shape),
    "result.json": (_result, lambda path: (read_result(path.parent), damage(path.parent), _shape_beside(path))),
    "mtf_G1.csv": (_result, lambda path: read_result(path.parent)),
    "field.h5": (_field, _blur),
    "colours.h5": (_field, _noted),
    "sensor.json": (_sensor, _read_sensor),
    "nps_G1.npy": (_sensor, _read_sensor),
    "camera.json": (_camera, _exports),
    "sensor.csv": (_pictures(LADDER), lambda path: find_shots(path.parent)),
    "sensor.toml": (_pictures(LEVELS), lambda path: find_shots(path.parent)),
    "set.txt": (_pictures(DESCRIPTOR), lambda path: find_shots(path.parent)),
    "session.toml": (_session, _read_session),
    "journal.jsonl": (_session, _read_session),
    "journal.head": (_session, _read_session),
    "kernel_1.npy": (_kernel, _shape),
    "geometry_points.npy": (_geometry, lambda path: read_rig_camera(path.parent)),
    "vignetting_covariance.npy": (_vignetting, _lights),
    "shape.txt": (_text(SHAPE), _shape),
    "psf.txt": (_text(SHAPE), lambda path: _shape(path, 3)),
    "path.txt": (_text(PATH), _path),
    "imu.csv": (lambda path: _record(path, COLUMNS, 8.0, 0.1), _imu_motion),
    "poses.csv": (lambda path: _record(path, POSE_COLUMNS, 5e-3, 5e-3), lambda path: _moved(read_poses(path))),
    "tiny.pgm": (_pgm, _tiny_frame),
    "focus.csv": (_text("photograph,mm\n" + "\n".join(f"{n}.dng,{n / 7}" for n in range(9))), _positions),
    "specification.toml": (_text(SPECIFICATION), read_specification),
    "procedure.toml": (_text(PROCEDURE), read_procedure),
    "station.toml": (_text(BENCH), lambda path: make_bench(read_config(path), folder=path.parent).close()),
}


def _shape_beside(path: Path) -> None:
    _shape(path.parent / "psf_G1.npy")


AFTER = {"tiny.pgm": _tiny, "summed.png": _summed_png, "shades.png": _summed_png, "summed.npz": _summed_zip}
"""What is done to a mutation of the file of this name."""
