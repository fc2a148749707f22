"""The kernel's video interface: structures and numbers of `linux/videodev2.h`, and the calls that carry them.

Reference: The Linux Kernel, Video for Linux API (userspace documentation); numbers as `_IOC` in `asm-generic/ioctl.h`.
"""

import ctypes
import mmap
import os
import select
from typing import Any

U8, U32, S32 = ctypes.c_uint8, ctypes.c_uint32, ctypes.c_int32
CAPTURE, MMAP = 1, 1  # kind of the buffers, and of their memory
CAN_CAPTURE, CAN_STREAM, HAS_DEVICE_CAPS = 0x1, 0x04000000, 0x80000000
BUFFER_ERROR, MONOTONIC, AT_BEGIN = 0x40, 0x2000, 0x10000
"""Flags of a buffer: damaged; time stamps by the monotonic clock; taken when the exposure began, not when it ended."""
CONTROL_FIXED, DISCRETE = 0x1 | 0x4, 1  # flags of a control that is disabled or read only; kind of a frame size


class Capability(ctypes.Structure):
    """struct v4l2_capability."""

    _fields_ = [
        ("driver", ctypes.c_char * 16), ("card", ctypes.c_char * 32), ("bus", ctypes.c_char * 32), ("version", U32),
        ("capabilities", U32), ("device_caps", U32), ("reserved", U32 * 3),
    ]  # fmt: skip


class FormatDescription(ctypes.Structure):
    """struct v4l2_fmtdesc."""

    _fields_ = [
        ("index", U32), ("type", U32), ("flags", U32), ("description", ctypes.c_char * 32), ("pixel_format", U32),
        ("bus_code", U32), ("reserved", U32 * 3),
    ]  # fmt: skip


class _Stepwise(ctypes.Structure):
    _fields_ = [(name, U32) for name in ("low_x", "high_x", "step_x", "low_y", "high_y", "step_y")]


class FrameSize(ctypes.Structure):
    """struct v4l2_frmsizeenum; of a discrete size `low_x` and `high_x` are its width and height."""

    _fields_ = [("index", U32), ("pixel_format", U32), ("type", U32), ("size", _Stepwise), ("reserved", U32 * 2)]


class PixelLayout(ctypes.Structure):
    """struct v4l2_pix_format."""

    _fields_ = [
        (name, U32)
        for name in (
            "width", "height", "pixel_format", "field", "line_bytes", "bytes", "colour_space", "private", "flags",
            "encoding", "quantization", "transfer",
        )
    ]  # fmt: skip


class _PictureUnion(ctypes.Union):
    _fields_ = [("picture", PixelLayout), ("pointer", ctypes.c_void_p), ("raw", U8 * 200)]


class Format(ctypes.Structure):
    """struct v4l2_format."""

    _anonymous_ = ("union",)
    _fields_ = [("type", U32), ("union", _PictureUnion)]


class BufferRequest(ctypes.Structure):
    """struct v4l2_requestbuffers."""

    _fields_ = [
        ("count", U32), ("type", U32), ("memory", U32), ("capabilities", U32), ("flags", U8), ("reserved", U8 * 3),
    ]  # fmt: skip


class _Time(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("microseconds", ctypes.c_long)]


class _TimeCode(ctypes.Structure):
    _fields_ = [("type", U32), ("flags", U32), ("digits", U8 * 4), ("user", U8 * 4)]


class _Place(ctypes.Union):
    _fields_ = [("offset", U32), ("address", ctypes.c_ulong), ("planes", ctypes.c_void_p), ("file", S32)]


class VideoBuffer(ctypes.Structure):
    """struct v4l2_buffer."""

    _anonymous_ = ("place",)
    _fields_ = [
        ("index", U32), ("type", U32), ("used", U32), ("flags", U32), ("field", U32), ("time", _Time),
        ("time_code", _TimeCode), ("sequence", U32), ("memory", U32), ("place", _Place), ("length", U32),
        ("reserved", U32), ("request", S32),
    ]  # fmt: skip

    @property
    def time_s(self) -> float:
        return float(self.time.seconds + self.time.microseconds * 1e-6)


class ControlRange(ctypes.Structure):
    """struct v4l2_queryctrl."""

    _fields_ = [
        ("id", U32), ("type", U32), ("name", ctypes.c_char * 32), ("low", S32), ("high", S32), ("step", S32),
        ("default", S32), ("flags", U32), ("reserved", U32 * 2),
    ]  # fmt: skip


class ControlValue(ctypes.Structure):
    """struct v4l2_control."""

    _fields_ = [("id", U32), ("value", S32)]


WRITE, READ = 1, 2


def request_number(direction: int, number: int, argument: type[Any]) -> int:
    """The number of a request, which contains the size of its argument."""
    return direction << 30 | ctypes.sizeof(argument) << 16 | ord("V") << 8 | number


BOTH = READ | WRITE
QUERYCAP = request_number(READ, 0, Capability)
ENUM_FMT = request_number(BOTH, 2, FormatDescription)
S_FMT = request_number(BOTH, 5, Format)
REQBUFS = request_number(BOTH, 8, BufferRequest)
QUERYBUF = request_number(BOTH, 9, VideoBuffer)
QBUF = request_number(BOTH, 15, VideoBuffer)
DQBUF = request_number(BOTH, 17, VideoBuffer)
STREAMON = request_number(WRITE, 18, ctypes.c_int)
STREAMOFF = request_number(WRITE, 19, ctypes.c_int)
G_CTRL = request_number(BOTH, 27, ControlValue)
S_CTRL = request_number(BOTH, 28, ControlValue)
QUERYCTRL = request_number(BOTH, 36, ControlRange)
ENUM_FRAMESIZES = request_number(BOTH, 74, FrameSize)

USER, CAMERA, SOURCE = 0x00980900, 0x009A0900, 0x009E0900  # first numbers of the classes of controls
AUTO_WHITE_BALANCE, GAMMA, AUTOGAIN, GAIN = USER + 12, USER + 16, USER + 18, USER + 19
SHARPNESS, BACKLIGHT = USER + 27, USER + 28
EXPOSURE_MODE, EXPOSURE_TIME, EXPOSURE_PRIORITY = CAMERA + 1, CAMERA + 2, CAMERA + 3
ANALOGUE_GAIN = SOURCE + 3


class Kernel:
    """The calls on a device file. A test has others."""

    def open(self, path: str) -> int:
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def close(self, file: int) -> None:
        os.close(file)

    def call(self, file: int, request: int, argument: Any) -> None:
        """One request; the structure is read and written. Raises OSError."""
        import fcntl  # POSIX only

        while True:
            try:
                fcntl.ioctl(file, request, argument, True)
            except InterruptedError:
                continue
            return

    def memory(self, file: int, length: int, offset: int) -> Any:
        """The memory of a buffer, which has `close`. Raises OSError."""
        return mmap.mmap(file, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, offset=offset)

    def ready(self, file: int, timeout_s: float) -> bool:
        """Whether a buffer is filled within this time."""
        return bool(select.select([file], [], [], timeout_s)[0])
