"""A program that behaves as `rpicam-still`: lists cameras, takes options by their names, writes DNGs of their layout.

Run as `python -m tests.drivers.rpicam_still`. The variable RPICAM_TWIN of the environment holds its faults as
JSON: `cameras` (2), `delay_s` (0), `fails` (the words of an error), `no_raw` (a version that writes no DNG).
"""

import argparse
import json
import os
import random
import struct
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from drivers.tiff import byte, directory, long, rational, short, text

SMALLEST_EXPOSURE_US = 29


@dataclass(frozen=True)
class TwinSensor:
    """A sensor, its raw modes (bits, columns, rows), the colours of its tile, and its black level."""

    name: str
    tile: str | None
    modes: tuple[tuple[int, int, int], ...]
    black: int


SENSORS = (
    TwinSensor("imx477", "RGGB", ((10, 64, 48), (12, 96, 64)), 256),
    TwinSensor("imx296", None, ((10, 64, 48),), 60),
)
"""Two cameras, with a few pixels each."""


def listing(sensors: tuple[TwinSensor, ...]) -> str:
    """The answer to `--list-cameras`."""
    lines = ["Available cameras", "-----------------"]
    for number, sensor in enumerate(sensors):
        bits, columns, rows = sensor.modes[-1]
        tile = sensor.tile or "MONO"
        lines.append(f"{number} : {sensor.name} [{columns}x{rows} {bits}-bit {tile}] (/base/soc/i2c/{sensor.name}@1a)")
        for i, (depth, width, height) in enumerate(sensor.modes):
            name = f"S{sensor.tile}{depth}_CSI2P" if sensor.tile else f"R{depth}_CSI2P"
            head = "    Modes: " if i == 0 else " " * 11
            lines.append(f"{head}'{name}' : {width}x{height} [40.01 fps - (0, 0)/{columns}x{rows} crop]")
        lines.append("")
    return "\n".join(lines) if sensors else "No cameras available!"


def numbers(sensor: TwinSensor, columns: int, rows: int, bits: int, light: float) -> list[int]:
    """The pixels of a photograph, row by row: light that grows to the right, and fresh noise."""
    white, black = 2**bits - 1, sensor.black * 2 ** (bits - 12)
    ramp = [black + (0.1 + 0.8 * x / (columns - 1)) * light * white for x in range(columns)]
    noisy = (random.gauss(level, white / 200) for _ in range(rows) for level in ramp)
    return [min(max(round(level), 0), white) for level in noisy]


def dng(sensor: TwinSensor, mosaic: list[int], columns: int, bits: int, exposure_s: float, gain: float) -> bytes:
    """The file: first a thumbnail in colour, the sensor's numbers in 16 bits in a directory below it, then EXIF."""
    rows, small = len(mosaic) // columns, columns // 16
    picked = (mosaic[columns * y + x] for y in range(0, rows, 16) for x in range(0, 16 * small, 16))
    thumb = bytes(level >> (bits - 8) for level in picked for _ in range(3))
    raw = {
        254: long(0), 256: long(columns), 257: long(rows), 258: short(16), 259: short(1),
        262: short(32803 if sensor.tile else 34892), 277: short(1), 278: long(rows), 279: long(2 * len(mosaic)),
        284: short(1), 50713: short(2, 2), 50717: long(2**bits - 1),
        50714: rational(*[sensor.black * 2 ** (bits - 12)] * 4),
    }  # fmt: skip
    if sensor.tile:
        raw |= {33421: short(2, 2), 33422: byte(*("RGB".index(one) for one in sensor.tile))}
    exif = {33434: rational(exposure_s), 34855: short(int(100 * gain))}
    first = {
        254: long(1), 256: long(small), 257: long(len(thumb) // small // 3), 258: short(8, 8, 8), 259: short(1),
        262: short(2), 271: text("Raspberry Pi"), 272: text(sensor.name), 274: short(1), 277: short(3),
        278: long(len(thumb) // small // 3), 279: long(len(thumb)), 284: short(1), 305: text("rpicam-still"),
        50706: byte(1, 1, 0, 0), 50707: byte(1, 0, 0, 0), 50708: text(sensor.name),
        50728: rational(1, 1, 1), 50778: short(21),
    }  # fmt: skip
    places = dict.fromkeys(("thumb", "raw", "exif", "pixels"), 0)
    for _ in range(2):  # the lengths do not depend on the places
        head = directory({**first, 273: long(places["thumb"]), 330: long(places["raw"]),
                           34665: long(places["exif"])}, 8)  # fmt: skip
        places["thumb"] = 8 + len(head)
        places["raw"] = places["thumb"] + len(thumb) + len(thumb) % 2
        below = directory({**raw, 273: long(places["pixels"])}, places["raw"])
        places["exif"] = places["raw"] + len(below)
        places["pixels"] = places["exif"] + len(directory(exif, places["exif"]))
    padded = thumb.ljust(places["raw"] - places["thumb"], b"\0")
    body = head + padded + below + directory(exif, places["exif"])
    return struct.pack("<2sHI", b"II", 42, 8) + body + struct.pack(f"<{len(mosaic)}H", *mosaic)


class StillOptions(argparse.ArgumentParser):
    """The options, with the program's way to refuse one."""

    def error(self, message: str) -> NoReturn:
        """End as the program does."""
        fail(message)


def fail(words: str) -> NoReturn:
    """End with an error."""
    print(f"ERROR: *** {words} ***", file=sys.stderr)
    raise SystemExit(255)


def read_options(words: list[str]) -> argparse.Namespace:
    """The options that a photograph of the sensor's numbers needs."""
    options = StillOptions(add_help=False, allow_abbrev=False)
    for flag in ("--list-cameras", "--version", "--nopreview", "-n", "--immediate", "--raw", "-r"):
        options.add_argument(flag, action="store_true")
    for name, kind, usual in (
        ("--camera", int, 0), ("--shutter", int, 0), ("--gain", float, 0.0), ("--awbgains", str, "0,0"),
        ("--denoise", str, "auto"), ("--mode", str, ""), ("--output", str, ""), ("--timeout", int, 5000),
    ):  # fmt: skip
        options.add_argument(name, type=kind, default=usual)
    return options.parse_args(words)


def main(words: list[str]) -> None:
    """Do what the options say."""
    faults = json.loads(os.environ.get("RPICAM_TWIN", "{}"))
    sensors, given = SENSORS[: faults.get("cameras", 2)], read_options(words)
    if given.version:
        print("rpicam-apps build: v1.5.0 3d9ac10d5a3b 14-05-2024\nlibcamera build: v0.3.0+65-6ddd79b5")
        return
    if given.list_cameras:
        print(listing(sensors))
        return
    if not sensors:
        fail("no cameras available")
    time.sleep(faults.get("delay_s", 0.0))
    if "fails" in faults:
        fail(faults["fails"])
    sensor = sensors[given.camera]
    columns, rows, bits = (int(part) for part in given.mode.split(":")[:3])
    bits, columns, rows = min(sensor.modes, key=lambda mode: abs(mode[0] - bits) + abs(mode[1] - columns))
    exposure_s = max(given.shutter or 10_000, SMALLEST_EXPOSURE_US) * 1e-6
    mosaic = numbers(sensor, columns, rows, bits, exposure_s * (given.gain or 1.0) / 0.04)
    picture = Path(given.output)
    picture.write_bytes(b"\xff\xd8\xff\xd9")
    if given.raw and not faults.get("no_raw"):
        picture.with_suffix(".dng").write_bytes(dng(sensor, mosaic, columns, bits, exposure_s, given.gain or 1.0))


if __name__ == "__main__":
    main(sys.argv[1:])
