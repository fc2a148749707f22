"""Mutates small files of every format and reads them: each must end in a right result or a stated refusal.

    python tests/benchmarks/fuzz_readers.py [--mutations 6000] [--seed 1] [--only npz,exr] [--keep FOLDER]

Files of every format that the station reads are written by its own writers, small. Each mutation of one (bytes flipped,
runs zeroed, cut out, doubled or swapped, numbers made extreme, the end missing; words of text replaced) is read in a
process of its own: a fork with every library loaded, limited in address space (2 GB beside what is there) and in time
(60 s of processor). What it comes to is counted: 0 read, 2, 4, 5 refused as stated, 70 something unforeseen, `signal`
ended by the system. The seed of each mutation is told, and `--keep` keeps the files that came to neither.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: a process with threads cannot be forked safely
os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import numpy as np
import rawpy  # noqa: F401  (loaded once, before the forks)

from procedures.field.field_file import read_field, write_field
from procedures.field.interpolate import interpolate
from procedures.outcome import Verdict
from procedures.pattern_print.source import Source
from procedures.psf import Psf
from procedures.psf_field import Node
from procedures.raw import read_frame
from procedures.ray_histogram.film import film_of_samples
from procedures.ray_histogram.film_files import read_film, write_film
from procedures.ray_histogram.filter import FilterParameters
from procedures.ray_histogram.multiscale import filter_film
from procedures.restoration.masks.psf_shapes import measured_field
from procedures.restoration.unknown_motion.recorded_paths import read_path
from simulators.camera.dng import Shot, write_dng
from station.batch.procedure_file import read_procedure
from station.bench.opening import make_bench, read_config
from station.calibration.field_photographs import focus_positions
from station.calibration.restoration_inputs import from_shapes, imu_table, read_imu
from station.results.plane_result import PlaneResult
from station.results.reader import read_result
from station.results.result_files import ResultFolder, write_psf_result
from station.results.result_seal import damage

ROOM, TIME_S = 2_000_000_000, 60
"""Address space beside what the program has, bytes; seconds of processor."""
SIZE = (40, 60)
EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
WORDS = (
    "nan",
    "inf",
    "-1",
    "0",
    "1e999",
    "9" * 400,
    "[" * 3000,
    '"',
    "{}",
    "null",
    "true",
    "\0",
    "\x1b[2J",
    "a" * 9999,
)

# --- files and their readers -------------------------------------------------------------------------------------


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


def _samples() -> np.ndarray:
    return _rng().random((8, 9, 6, 3)).astype(np.float32)


def _film(path: Path) -> None:
    write_film(film_of_samples(_samples()), path)


def _exr(path: Path) -> None:
    import OpenEXR

    film = film_of_samples(_samples())
    bins = film.histogram.reshape(*film.count.shape, 60).astype(np.float32)
    channels = {f"Bin_{i:04d}": np.ascontiguousarray(bins[..., i]) for i in range(60)}
    channels |= {"Bin_0060": film.count.astype(np.float32)}
    channels |= {name: np.ascontiguousarray(film.mean[..., i], np.float32) for i, name in enumerate("RGB")}
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, channels).write(str(path))


def _psf(width: float = 1.0, k: int = 9) -> Psf:
    x = np.arange(k) - k // 2
    h = np.exp(-(x[:, None] ** 2 + x**2) / (2 * (1.5 * width) ** 2))
    return Psf(h / h.sum(), 3, np.eye(k * k) * 1e-8)


def _result(path: Path) -> None:
    """A result's folder, whose file of this name is then mutated."""
    with ResultFolder(path.parent) as folder:
        write_psf_result(folder, [PlaneResult.of("G1", Verdict.PASS, _psf())], {"procedure": "pattern"})
    (path.parent / "mtf_G1.csv").write_text("frequency,horizontal,vertical,radial\n0,1,1,1\n0.5,0.4,0.4,0.4\n")


def _field(path: Path) -> None:
    places = np.array([(x, y) for y in (5.0, 20.0, 35.0) for x in (5.0, 30.0, 55.0)])
    rng = _rng()
    nodes = [
        Node(xy, np.eye(2) * 1e-4, 2 * xy, _psf(1 + 0.002 * xy[0] + 0.01 * rng.standard_normal(), 5)) for xy in places
    ]
    write_field(path, {"G1": interpolate("G1", SIZE, nodes)}, {}, [], {"input": "[]"})


def _text(text: str) -> Callable[[Path], None]:
    return lambda path: path.write_text(text) and None


def _imu(path: Path) -> None:
    path.write_text("t_s,ax,ay,az,wx,wy,wz\n" + "\n".join(f"{n / 100},0.1,9.81,0.2,0.01,0.02,0.03" for n in range(20)))


def _shape(path: Path, samples_per_px: int | None = None) -> None:
    photographs = [_rng().random((1, 64, 64)), _rng().random((1, 64, 64))]
    from_shapes([str(path), str(path)], (1.0, 1.3), None, photographs, plane="G1", samples_per_px=samples_per_px)


def _blur(path: Path) -> None:
    for field_ in read_field(path).values():
        measured_field(field_, field_.shape, (2, 2))
        _finite(field_.at(20.0, 20.0).h)


def _filter(path: Path) -> None:
    _finite(filter_film(read_film(path).checked(), FEW, threads=1).picture)


def _frame(path: Path) -> None:
    for plane in read_frame(path).planes.values():
        _finite(plane.samples)


FEW = FilterParameters(scales=1, search=2)


def _finite(values: np.ndarray) -> None:
    if not values.size or not np.isfinite(values).all():
        raise ArithmeticError("a result that is no finite number")


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
SHAPE = "\n".join(" ".join(f"{v:.4g}" for v in row) for row in _psf(k=7).h)
PATH = "\n".join(f"{np.cos(n / 5):.3f} {np.sin(n / 7):.3f}" for n in range(30))

# name of the file -> how it is written, how it is read
READERS: dict[str, tuple[Callable[[Path], None], Callable[[Path], object]]] = {
    "frame.dng": (_dng, _frame),
    "frame.png": (_picture, _frame),
    "frame.tif": (_picture, _frame),
    "frame.pgm": (_pgm, _frame),
    "plain.pgm": (_plain_pgm, _frame),
    "cells.png": (_cells, Source.from_file),
    "film.npz": (_film, _filter),
    "film.exr": (_exr, _filter),
    "psf_G1.npy": (_result, _shape),
    "result.json": (_result, lambda path: (read_result(path.parent), damage(path.parent), _shape_beside(path))),
    "mtf_G1.csv": (_result, lambda path: read_result(path.parent)),
    "field.h5": (_field, _blur),
    "shape.txt": (_text(SHAPE), _shape),
    "psf.txt": (_text(SHAPE), lambda path: _shape(path, 3)),
    "path.txt": (_text(PATH), read_path),
    "imu.csv": (_imu, lambda path: imu_table(read_imu(path))),
    "focus.csv": (_text("photograph,mm\n" + "\n".join(f"{n}.dng,{n / 7}" for n in range(9))), _positions),
    "procedure.toml": (_text(PROCEDURE), read_procedure),
    "station.toml": (_text(BENCH), lambda path: make_bench(read_config(path), folder=path.parent).close()),
}


def _shape_beside(path: Path) -> None:
    _shape(path.parent / "psf_G1.npy")


# --- mutations ---------------------------------------------------------------------------------------------------


def mutated(data: bytes, rng: random.Random, text: bool) -> bytes:
    """The content with one to four things wrong with it."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(TEXT if text and rng.random() < 0.7 else BINARY)(data, rng)
    return data


def _place(data: bytes, rng: random.Random) -> int:
    """Anywhere, and half of the time where headers are."""
    return rng.randrange(max(1, min(len(data), 600) if rng.random() < 0.5 else len(data)))


def _flip(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 3, 20))):
        if changed:
            changed[_place(data, rng)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _extreme(data: bytes, rng: random.Random) -> bytes:
    at, width, order = _place(data, rng), rng.choice((1, 2, 4, 8)), rng.choice(("little", "big"))
    number = rng.choice(EXTREMES) & (256**width - 1)
    return data[:at] + number.to_bytes(width, order) + data[at + width :]


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _zero(data: bytes, rng: random.Random) -> bytes:
    at, n = _place(data, rng), rng.choice((4, 16, 300))
    return data[:at] + bytes(min(n, len(data) - at)) + data[at + n :]


def _remove(data: bytes, rng: random.Random) -> bytes:
    at = _place(data, rng)
    return data[:at] + data[at + rng.choice((1, 2, 12, 100)) :]


def _double(data: bytes, rng: random.Random) -> bytes:
    at, n = _place(data, rng), rng.choice((1, 12, 100, 3000))
    return data[: at + n] + data[at:]


def _swap(data: bytes, rng: random.Random) -> bytes:
    first, second, n = _place(data, rng), _place(data, rng), rng.choice((2, 12, 64))
    one, other = sorted((first, second))
    if other - one < n or other + n > len(data):
        return _flip(data, rng)
    return data[:one] + data[other : other + n] + data[one + n : other] + data[one : one + n] + data[other + n :]


def _word(data: bytes, rng: random.Random) -> bytes:
    """One word or number of a text replaced."""
    pieces = data.replace(b",", b" , ").split(b" ")
    pieces[rng.randrange(len(pieces))] = rng.choice(WORDS).encode()
    return b" ".join(pieces)


def _line(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True) or [b""]
    at = rng.randrange(len(lines))
    lines[at : at + 1] = rng.choice(([], [lines[at]] * 2, [rng.choice(WORDS).encode() + b"\n"]))
    return b"".join(lines)


BINARY = (_flip, _flip, _extreme, _extreme, _cut, _zero, _remove, _double, _swap)
TEXT = (_word, _word, _word, _line)

# --- one reading in a process of its own -------------------------------------------------------------------------


@dataclass
class Counts:
    """What came of the mutations: how often each code, the largest growth and longest time, what was unforeseen."""

    codes: Counter[str] = field(default_factory=Counter)
    memory: int = 0
    time_s: float = 0.0
    odd: list[str] = field(default_factory=list)


def read_apart(read: Callable[[Path], object], path: Path) -> tuple[str, int, float, str]:
    """Code, growth of memory in bytes, seconds of processor, and the traceback of what was unforeseen."""
    ear, mouth = os.pipe()
    start = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
    child = os.fork()
    if child == 0:
        os.close(ear)
        os._exit(_limited(read, path, mouth))
    os.close(mouth)
    with os.fdopen(ear, "rb") as file:
        told = file.read().decode(errors="replace")
    _, status, used = os.wait4(child, 0)
    code = str(os.waitstatus_to_exitcode(status)) if os.WIFEXITED(status) else signal.Signals(os.WTERMSIG(status)).name
    return code, max(0, 1024 * used.ru_maxrss - start), used.ru_utime + used.ru_stime, told


def _limited(read: Callable[[Path], object], path: Path, mouth: int) -> int:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + ROOM, size + ROOM))
    resource.setrlimit(resource.RLIMIT_CPU, (TIME_S, TIME_S + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        read(path)
    except Exception as error:
        if type(getattr(error, "exit_code", None)) is int and hasattr(error, "remedy"):
            return int(error.exit_code)
        os.write(mouth, traceback.format_exc()[-3000:].encode())
        return 70
    return 0


def fuzz(
    mutations: int, seed: int, only: Sequence[str] = (), keep: Path | None = None, told: bool = False
) -> dict[str, Counts]:
    """Counts by file, of so many mutations shared out evenly."""
    chosen = {name: one for name, one in READERS.items() if not only or any(part in name for part in only)}
    counts: dict[str, Counts] = defaultdict(Counts)
    if any(name.startswith("film") for name in chosen):  # its kernels are made or loaded once, not in every fork
        filter_film(film_of_samples(_samples()).checked(), FEW, threads=1)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as raw:
        for name, (write, read) in chosen.items():
            path = Path(raw, name.replace(".", "-"), name)
            path.parent.mkdir()
            writer = os.fork()  # its libraries may start threads
            if writer == 0:
                write(path)
                os._exit(0)
            if os.waitpid(writer, 0)[1] != 0:
                raise SystemExit(f"{name} could not be written")
            whole, begin = path.read_bytes(), time.perf_counter()
            code, _, _, what = read_apart(read, path)
            if code != "0":
                raise SystemExit(f"{name} cannot be read as it was written: {code} {what}")
            for n in range(mutations // len(chosen)):
                mark = f"{seed}/{name}/{n}"
                rng = random.Random(mark)
                path.write_bytes(mutated(whole, rng, path.suffix in (".txt", ".csv", ".json", ".toml")))
                _count(counts[name], mark, read_apart(read, path), path, keep)
            if told:
                _tell(name, counts[name], time.perf_counter() - begin)
    return counts


def _count(counts: Counts, mark: str, answer: tuple[str, int, float, str], path: Path, keep: Path | None) -> None:
    code, memory, time_s, what = answer
    counts.codes[code] += 1
    counts.memory, counts.time_s = max(counts.memory, memory), max(counts.time_s, time_s)
    if code not in ("0", "2", "4", "5"):
        counts.odd.append(f"{mark}: {code}: {what}")
        if keep:
            keep.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, keep / mark.replace("/", "-"))


def _tell(name: str, counts: Counts, took_s: float) -> None:
    codes = ", ".join(f"{code}: {n}" for code, n in sorted(counts.codes.items()))
    print(f"{name:15} {codes:45} {counts.memory / 1e6:6.0f} MB  {counts.time_s:5.2f} s  ({took_s:.0f} s)", flush=True)
    for what in {one.strip().splitlines()[-1]: one for one in counts.odd}.values():
        print("    " + what.strip().replace("\n", "\n    "))


def main() -> None:
    """Mutate, read, count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mutations", type=int, default=6000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="Parts of names, with commas between.")
    parser.add_argument("--keep", type=Path, help="Folder for the files that came to no stated end.")
    given = parser.parse_args()
    counts = fuzz(given.mutations, given.seed, [one for one in given.only.split(",") if one], given.keep, told=True)
    total = sum((one.codes for one in counts.values()), Counter[str]())
    print(f"{total.total()} mutations, seed {given.seed}: {dict(sorted(total.items()))}")
    sys.exit(any(one.odd for one in counts.values()))


if __name__ == "__main__":
    main()
