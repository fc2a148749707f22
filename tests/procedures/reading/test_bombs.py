"""Declared sizes are compared with the limit before anything is decoded: time and memory stay small."""

import subprocess
import sys

import pytest

from procedures import BadInput, BadParameter, read_frame
from procedures.reading.guard import LIMIT, Room, read_file

from . import bombs

ROOM = 500_000_000
"""Memory that a reader may take in addition to its libraries."""

# name -> writer, reader, and message
BOMBS = {
    "picture.tif": ("bombs.tiff(path)", "raw.read_frame(path)", "20000 x 20000 samples"),
    "tile.tif": ("bombs.tiff(path, side=64, tile=32768)", "raw.read_frame(path)", "64 x 64 samples: 4295 MB"),
    "picture.png": ("bombs.png(path)", "raw.read_frame(path)", "20000 x 20000 samples"),
    "cells.png": ("bombs.png(path)", "source.Source.from_file(path)", "has 20000 x 20000"),
    "chunk.png": ("bombs.chunk(path)", "source.Source.from_file(path)", "the PNG has no end chunk"),
    "tags.dng": ("bombs.dng(path, tags=65_000)", "raw.read_frame(path)", "at most 1000 tags; "),
    "chain.dng": ("bombs.dng(path, tags=900, directories=64)", "raw.read_frame(path)", "at most 32 image dir"),
    "vast.dng": ("bombs.dng(path, side=20_000)", "raw.read_frame(path)", "20000 x 20000 samples"),
    "film.npz": ("bombs.npz(path)", "film_files.read_film(path)", "`samples` of 1200000128 bytes"),
    "psf.npy": ("bombs.npy(path)", "arrays.read_npy(path)", "declares 8796093022208 bytes; 64 follow"),
    "film.exr": ("bombs.exr(path)", "film_files.read_film(path)", "20000 x 20000 samples of 1 channels"),
    "field.h5": ("bombs.hdf5(path)", "field_file.read_field(path)", "(100000000, 17)"),
    "colours.h5": ("bombs.colours(path)", "field_file.read_colours(path)", "(100000000, 2)"),
    "notes.dng": ("bombs.dng(path, notes=60_000)", "raw.read_frame(path)", "s: read"),  # its pixels all the same
    "deep.json": ("bombs.deep(path, '')", "text.read_json(path)", "RecursionError"),
    "deep.toml": ("bombs.deep(path, 'x = ')", "text.read_toml(path)", "RecursionError"),
    "plain.pgm": ("path.write_bytes(b'P2 20000 20000 255 ' + b'1 ' * 20_000_000)", "raw.read_frame(path)", "as text"),
}

PROGRAM = """
import os, resource, sys, time
from pathlib import Path
import cv2, exifread, h5py, numpy, rawpy, OpenEXR
from procedures import raw
from procedures.field import field_file
from procedures.outcome import BadInput
from procedures.pattern_print import source
from procedures.ray_histogram import film_files
from procedures.reading import arrays, text
for path, read in {todo!r}:
    if os.fork():
        os.wait()
        continue
    before = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (before + {room}, before + {room}))
    path, start = Path(path), time.process_time()
    try:
        eval(read)
        print(f"{{path.name}}: {{time.process_time() - start:.2f}} s: read", flush=True)
    except BadInput as error:
        print(f"{{path.name}}: {{time.process_time() - start:.2f}} s: {{error}}", flush=True)
    os._exit(0)
"""


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """Messages for all bombs, each read in a process of its own that may take 500 MB more."""
    if sys.platform != "linux":
        pytest.skip("the program's own size is read from /proc")
    folder, todo = tmp_path_factory.mktemp("bombs"), []
    for name, (write, read, _) in BOMBS.items():
        eval(write, {"bombs": bombs, "path": folder / name})
        todo.append((str(folder / name), read))
    program = PROGRAM.format(todo=todo, room=ROOM)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    print(done.stdout)
    return {line.split(":")[0]: line for line in done.stdout.splitlines()}


@pytest.mark.slow
@pytest.mark.parametrize("name", BOMBS)
def test_bomb_is_refused_by_name_within_500_mb(messages, name):
    assert name in messages
    assert BOMBS[name][2] in messages[name]


def test_limit_is_a_setting_that_the_refusal_names(tmp_path, monkeypatch):
    path = tmp_path / "wall.pgm"
    path.write_bytes(b"P5 1000 500 255\n" + bytes(range(250)) * 2000)
    monkeypatch.setenv(LIMIT, "1.5")  # half a million samples of four bytes are 2 MB
    with pytest.raises(BadInput, match=r"500000 samples: 2 MB in memory; one file may take 1\.5 MB") as refused:
        read_frame(path)
    assert refused.value.remedy.endswith(f"set {LIMIT}=2")
    monkeypatch.setenv(LIMIT, "2")
    assert read_frame(path).planes["Y"].samples.shape == (500, 1000)


def test_file_larger_than_the_limit_is_not_read_at_all(tmp_path, monkeypatch):
    monkeypatch.setenv(LIMIT, "1")
    with (tmp_path / "long.dng").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(BadInput, match=r"long\.dng has too many bytes: 1099512 MB in memory"):
        read_file(tmp_path / "long.dng")


@pytest.mark.parametrize("setting", ["lots", "0", "-1", "nan", "inf"])
def test_invalid_limit_is_named(monkeypatch, setting):
    monkeypatch.setenv(LIMIT, setting)
    with pytest.raises(BadParameter, match=f"{LIMIT} must be a positive number of megabytes; got '{setting}'"):
        Room("a.dng")
