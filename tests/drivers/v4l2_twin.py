"""A camera at the boundary of Linux' video interface: answers the kernel's requests by their numbers, byte for byte.

Structures are read and written at the byte offsets of `linux/videodev2.h` on 64-bit systems, not by the driver's
definitions. A sensor's new settings take effect in the third frame of a stream, as in UVC cameras.
"""

import errno
import itertools
import mmap
import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.errors import Clock, SystemClock

Numbers = npt.NDArray[np.uint16]
CAPTURE, MMAP, NONE = 1, 1, 1
DONE, DAMAGED, MONOTONIC = 0x4, 0x40, 0x2000
PAGE = 4096
LATE_FRAMES = 2
CAPABILITIES = 0x85200001
"""Capture, extended pixel format, streaming, and that `device_caps` are given."""
EXPOSURE_TIME, EXPOSURE_MODE, EXPOSURE_PRIORITY = 0x009A0902, 0x009A0901, 0x009A0903
GAIN, SHARPNESS, GAMMA, WHITE_BALANCE = 0x00980913, 0x0098091B, 0x00980910, 0x0098090C
DEPTHS = {"GREY": 8, "Y10 ": 10, "Y16 ": 16, "RGGB": 8, "RG10": 10, "pRAA": 10, "pgCC": 12, "YUYV": 0, "MJPG": 0}
UNIT_S = 1e-4


@dataclass
class FakeControl:
    """A control: its name, limits and value."""

    name: str
    low: int
    high: int
    value: int


def usual_controls() -> dict[int, FakeControl]:
    """The controls of a UVC camera, as it wakes up: everything automatic."""
    return {
        EXPOSURE_MODE: FakeControl("Auto Exposure", 0, 3, 3),
        EXPOSURE_TIME: FakeControl("Exposure Time, Absolute", 1, 10000, 156),
        EXPOSURE_PRIORITY: FakeControl("Exposure, Dynamic Framerate", 0, 1, 1),
        GAIN: FakeControl("Gain", 0, 100, 0),
        SHARPNESS: FakeControl("Sharpness", 0, 6, 3),
        GAMMA: FakeControl("Gamma", 72, 500, 220),
        WHITE_BALANCE: FakeControl("White Balance, Automatic", 0, 1, 1),
    }


@dataclass
class FakeCamera:
    """The device behind a device file, and its faults.

    `formats` by their four characters, with the sizes of each. `damage` and `short` are numbers of frames, counted from
    1 over all streams; a `stalled` camera sends none, and `gone` is one whose cable was pulled.
    """

    formats: Mapping[str, tuple[tuple[int, int], ...]] = field(default_factory=lambda: {"RG10": ((48, 32), (96, 64))})
    controls: dict[int, FakeControl] = field(default_factory=usual_controls)
    card: str = "Fake Camera: Fake Camera"
    period_s: float = 1 / 30
    clock: Clock = field(default_factory=SystemClock)
    damage: frozenset[int] = frozenset()
    short: frozenset[int] = frozenset()
    busy: bool = False
    gone: bool = False
    stalled: bool = False
    alignment: int = 32

    def __post_init__(self) -> None:
        self._files = itertools.count(1000)
        self._open: set[int] = set()
        self._format, self._width, self._height = "", 0, 0
        self._memories: list[mmap.mmap] = []
        self._queued: list[int] = []
        self._began_s: float | None = None
        self._taken = self._in_stream = 0
        self._exposures = [self.controls[EXPOSURE_TIME].value if EXPOSURE_TIME in self.controls else 100] * LATE_FRAMES

    # --- the calls of `drivers.v4l2.kernel.Kernel`

    def open(self, path: str) -> int:
        self._check()
        file = next(self._files)
        self._open.add(file)
        return file

    def close(self, file: int) -> None:
        """Close it, which ends its stream."""
        self._open.discard(file)
        self._began_s = None

    def call(self, file: int, request: int, argument: Any) -> None:
        """One request: the bytes of the argument are changed in place."""
        self._check()
        if file not in self._open:
            raise _failure(errno.EBADF)
        handler = HANDLERS.get(request)
        if handler is None:
            raise _failure(errno.ENOTTY)
        size, handle = handler
        view = memoryview(argument).cast("B")
        if len(view) != size:
            raise _failure(errno.EFAULT)
        handle(self, view)

    def memory(self, file: int, length: int, offset: int) -> mmap.mmap:
        """The memory of the buffer that begins at this offset."""
        memory = self._memories[offset // PAGE]
        if length != len(memory):
            raise _failure(errno.EINVAL)
        return memory

    def ready(self, file: int, timeout_s: float) -> bool:
        """Whether a frame ends within this time."""
        if self.gone:
            return True
        due_s = self._due_s()
        now_s = self.clock.now_s()
        if due_s is None or due_s > now_s + timeout_s:
            self.clock.sleep(timeout_s)
            return self.gone
        self.clock.sleep(max(due_s - now_s, 0.0))
        return True

    def _check(self) -> None:
        if self.gone:
            raise _failure(errno.ENODEV)

    # --- frames

    @property
    def exposure_s(self) -> float:
        """The exposure time of the next frame, which settings reach late."""
        return UNIT_S * self._exposures[0]

    def _due_s(self) -> float | None:
        """When the next frame ends; None without a stream or a free buffer."""
        if self._began_s is None or not self._queued or self.stalled:
            return None
        return self._began_s + self.period_s * (self._in_stream + 1) + self.exposure_s

    def _take(self) -> int:
        """Count a frame, and return its number."""
        self._taken, self._in_stream = self._taken + 1, self._in_stream + 1
        if EXPOSURE_TIME in self.controls:
            self._exposures = [*self._exposures[1:], self.controls[EXPOSURE_TIME].value]
        return self._taken

    def numbers(self, exposure_s: float, number: int) -> Numbers:
        """The pixels of a frame: light that grows to the right, and noise of its own."""
        white = 2 ** DEPTHS[self._format] - 1
        light = np.linspace(0.1, 0.9, self._width) * exposure_s / 0.02 * white / 2
        noise = np.random.default_rng(number).normal(0, white / 200, (self._height, self._width))
        levels: Numbers = np.clip(white / 16 + light + noise, 0, white).astype(np.uint16)
        return levels

    def _line_bytes(self) -> int:
        name, width = self._format, self._width
        octets = width * DEPTHS[name] // 8 if name[0] == "p" else width * (1 if DEPTHS[name] == 8 else 2)
        return -(-octets // self.alignment) * self.alignment

    def _packed(self, numbers: Numbers) -> bytes:
        depth = DEPTHS[self._format]
        if self._format[0] == "p":
            rows = [_csi2(row.tolist(), depth) for row in numbers]
        else:
            rows = [row.astype("u1" if depth == 8 else "<u2").tobytes() for row in numbers]
        return b"".join(row.ljust(self._line_bytes(), b"\xa5") for row in rows)

    # --- requests

    def _query_capabilities(self, view: memoryview) -> None:
        head = struct.pack("<16s32s32s3I", b"uvcvideo", self.card.encode(), b"usb-0000:00:14.0-1", 0x060100,
                           CAPABILITIES, CAPABILITIES & 0x7FFFFFFF)  # fmt: skip
        view[: len(head)] = head

    def _enumerate_formats(self, view: memoryview) -> None:
        index, kind = struct.unpack_from("<2I", view)
        if kind != CAPTURE or index >= len(self.formats):
            raise _failure(errno.EINVAL)
        name = list(self.formats)[index]
        struct.pack_into("<I32s4s", view, 8, 0, f"{name.strip()} pixels".encode(), name.encode())

    def _enumerate_sizes(self, view: memoryview) -> None:
        index, name = struct.unpack_from("<I4s", view)
        sizes = self.formats.get(name.decode(), ())
        if index >= len(sizes):
            raise _failure(errno.EINVAL)
        struct.pack_into("<3I", view, 8, 1, *sizes[index])

    def _get_format(self, view: memoryview) -> None:
        if struct.unpack_from("<I", view)[0] != CAPTURE:
            raise _failure(errno.EINVAL)
        line = self._line_bytes() if self._format else 0
        struct.pack_into(
            "<2I4s3I", view, 8, self._width, self._height, self._format.encode(), NONE, line, line * self._height
        )

    def _set_format(self, view: memoryview) -> None:
        if self.busy or self._memories:
            raise _failure(errno.EBUSY)
        width, height, name = struct.unpack_from("<2I4s", view, 8)
        if (chosen := name.decode()) not in self.formats:
            chosen = next(iter(self.formats))
        sizes = self.formats[chosen]
        nearest = min(sizes, key=lambda size: abs(size[0] - width) + abs(size[1] - height))
        self._format, (self._width, self._height) = chosen, nearest
        self._get_format(view)

    def _request_buffers(self, view: memoryview) -> None:
        count, kind, memory = struct.unpack_from("<3I", view)
        if (kind, memory) != (CAPTURE, MMAP) or self._began_s is not None:
            raise _failure(errno.EINVAL if self._began_s is None else errno.EBUSY)
        size = self._line_bytes() * self._height
        self._memories, self._queued = [mmap.mmap(-1, size) for _ in range(count)], []
        struct.pack_into("<I", view, 12, 1)

    def _query_buffer(self, view: memoryview) -> None:
        index = struct.unpack_from("<I", view)[0]
        if index >= len(self._memories):
            raise _failure(errno.EINVAL)
        struct.pack_into("<Q I", view, 64, index * PAGE, len(self._memories[index]))

    def _queue(self, view: memoryview) -> None:
        index, kind = struct.unpack_from("<2I", view)
        if kind != CAPTURE or index >= len(self._memories) or index in self._queued:
            raise _failure(errno.EINVAL)
        self._queued.append(index)

    def _dequeue(self, view: memoryview) -> None:
        if self._began_s is None:
            raise _failure(errno.EINVAL)
        due_s = self._due_s()
        if due_s is None or due_s > self.clock.now_s():
            raise _failure(errno.EAGAIN)
        exposure_s, index = self.exposure_s, self._queued.pop(0)
        number = self._take()
        data = self._packed(self.numbers(exposure_s, number))
        self._memories[index][: len(data)] = data
        used = len(data) // 2 if number in self.short else len(data)
        flags = DONE | MONOTONIC | (DAMAGED if number in self.damage else 0)
        struct.pack_into("<5I", view, 0, index, CAPTURE, used, flags, NONE)
        struct.pack_into("<2q", view, 24, int(due_s), int(due_s % 1 * 1e6))
        struct.pack_into("<2I", view, 56, self._in_stream - 1, MMAP)
        struct.pack_into("<Q I", view, 64, index * PAGE, len(self._memories[index]))

    def _stream_on(self, view: memoryview) -> None:
        self._began_s, self._in_stream = self.clock.now_s(), 0

    def _stream_off(self, view: memoryview) -> None:
        self._began_s, self._queued = None, []

    def _control(self, view: memoryview) -> FakeControl:
        number = struct.unpack_from("<I", view)[0]
        if number not in self.controls:
            raise _failure(errno.EINVAL)
        return self.controls[number]

    def _get_control(self, view: memoryview) -> None:
        struct.pack_into("<i", view, 4, self._control(view).value)

    def _set_control(self, view: memoryview) -> None:
        one, value = self._control(view), struct.unpack_from("<i", view, 4)[0]
        if one is self.controls.get(EXPOSURE_TIME) and self.controls[EXPOSURE_MODE].value != 1:
            raise _failure(errno.EACCES)  # the camera sets it itself
        one.value = min(max(value, one.low), one.high)

    def _query_control(self, view: memoryview) -> None:
        one = self._control(view)
        struct.pack_into("<I32s5i", view, 4, 1, one.name.encode(), one.low, one.high, 1, one.low, 0)


def _failure(number: int) -> OSError:
    return OSError(number, os.strerror(number))


def _csi2(row: list[int], depth: int) -> bytes:
    """A row in groups of high bytes and one number of the low bits."""
    group, low = (2, 4) if depth == 12 else (4, depth - 8)
    packed = bytearray()
    for first in range(0, len(row), group):
        pixels = row[first : first + group]
        packed += bytes(number >> low for number in pixels)
        rest = sum((number & (2**low - 1)) << (low * i) for i, number in enumerate(pixels))
        packed += rest.to_bytes(group * low // 8, "little")
    return bytes(packed)


HANDLERS = {
    0x80685600: (104, FakeCamera._query_capabilities),
    0xC0405602: (64, FakeCamera._enumerate_formats),
    0xC0D05604: (208, FakeCamera._get_format),
    0xC0D05605: (208, FakeCamera._set_format),
    0xC0145608: (20, FakeCamera._request_buffers),
    0xC0585609: (88, FakeCamera._query_buffer),
    0xC058560F: (88, FakeCamera._queue),
    0xC0585611: (88, FakeCamera._dequeue),
    0x40045612: (4, FakeCamera._stream_on),
    0x40045613: (4, FakeCamera._stream_off),
    0xC008561B: (8, FakeCamera._get_control),
    0xC008561C: (8, FakeCamera._set_control),
    0xC0445624: (68, FakeCamera._query_control),
    0xC02C564A: (44, FakeCamera._enumerate_sizes),
}
"""The requests that this camera knows: size of the argument, and the answer."""
