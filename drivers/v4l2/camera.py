"""A camera of Linux' video interface: raw Bayer or grey frames, each from a stream of its own, written as DNGs.

The stream begins when a photograph is requested, so that no frame is older than the request; the first frames of a
stream are discarded, as sensors apply new settings late.
"""

import errno
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from ctypes import c_int
from dataclasses import dataclass
from typing import Annotated, Any

from drivers.dng import Body, DngFolder, Frame
from drivers.errors import BadConfiguration, Clock, DeviceError, FrameMissing, LineLost, Rejected
from drivers.frames import FrameCamera
from drivers.genicam.pixel_formats import PixelFormat, unpack
from drivers.interfaces import CameraSettings, Condition, ExposedFile, FrameFormat, Identity, ShutterTimes
from drivers.making import FrameOptions, MakerContext
from drivers.options import option, positive, text
from drivers.v4l2 import kernel as v4l2
from drivers.wire.connection import closed_after_errors, line_condition, not_connected

BUFFERS = 4
SLICE_S = 0.05  # interval at which a wait for a frame checks for a stop
EXPOSURE_UNIT_S = 1e-4
ROUNDING = 0.05  # allowed relative deviation from the requested exposure: the interface counts in units of 0.1 ms
MOST_LISTED = 256  # largest number of formats or sizes of a device
DEPTHS = ((8, ""), (10, ""), (12, ""), (14, ""), (16, ""), (10, "csi2"), (12, "csi2"), (14, "csi2"))
FORMATS = {
    name.ljust(4): PixelFormat(name, bits, packing, cfa)
    for cfa, names in {
        None: "GREY Y10 Y12 Y14 Y16 Y10P Y12P Y14P",
        "RGGB": "RGGB RG10 RG12 RG14 RG16 pRAA pRCC pREE",
        "BGGR": "BA81 BG10 BG12 BG14 BYR2 pBAA pBCC pBEE",
        "GRBG": "GRBG BA10 BA12 GR14 GR16 pgAA pgCC pgEE",
        "GBRG": "GBRG GB10 GB12 GB14 GB16 pGAA pGCC pGEE",
    }.items()
    for name, (bits, packing) in zip(names.split(), DEPTHS, strict=True)
}
"""Grey and raw formats by the four characters of the interface, in the order of `DEPTHS`."""
PLAIN = {
    v4l2.AUTO_WHITE_BALANCE: 0, v4l2.AUTOGAIN: 0, v4l2.EXPOSURE_PRIORITY: 0, v4l2.EXPOSURE_MODE: 1,
    v4l2.BACKLIGHT: 0, v4l2.SHARPNESS: 0, v4l2.GAMMA: 100,
}  # fmt: skip
"""Values at which a camera changes nothing by itself, where it has these controls: the mode 1 is manual, a gamma of 100
is linear."""
GONE = (errno.ENODEV, errno.EIO, errno.ENXIO, errno.ENOENT)
REMEDY = "`v4l2-ctl --list-formats-ext --list-ctrls` shows what the camera offers"


@dataclass(frozen=True)
class V4l2Settings:
    """Settings applied on connection.

    pixel_format : four characters of a grey or raw format; "" takes the deepest one offered
    columns, rows : size of the frames; None takes the largest one offered
    gain : in the camera's own unit; None keeps its gain
    discard : frames discarded at the beginning of a stream
    patience_s : time limit of a frame in addition to its exposure
    """

    pixel_format: Annotated[
        str, option('"Y16"', "the four characters of a grey or raw format", pattern=r"^[A-Za-z0-9 ]{3,4}\Z")
    ] = ""
    columns: Annotated[int, option("1280", least=1)] | None = None
    rows: Annotated[int, option("960", least=1)] | None = None
    gain: Annotated[int, option("0")] | None = None
    discard: Annotated[int, option("2", least=0, most=100)] = 2
    patience_s: Annotated[float, positive("5")] = 5.0


@contextmanager
def translated_errors(address: str, remedy: str) -> Iterator[None]:
    """Context that converts the kernel's errors into device errors."""
    try:
        yield
    except OSError as error:
        reason = f"{address}: {error.strerror}"
        if error.errno in GONE:
            raise LineLost(reason, "check its cable, and the name of its device file") from error
        if error.errno == errno.EBUSY:
            raise LineLost(f"{address} is in use by another program", "close that program") from error
        raise Rejected(reason, remedy, errno.errorcode.get(error.errno or 0, "")) from error


class V4l2Camera(FrameCamera):
    """A Camera on a device file such as /dev/video0."""

    def __init__(
        self, frames: DngFolder, device: str = "/dev/video0", settings: V4l2Settings | None = None, *,
        kernel: v4l2.Kernel | None = None, clock: Clock | None = None,
    ) -> None:  # fmt: skip
        super().__init__(clock)
        self._frames, self._path, self._wanted = frames, device, settings or V4l2Settings()
        self._kernel = kernel or v4l2.Kernel()
        self._file: int | None = None
        self._body = Body("", "")
        self._form = FORMATS["GREY"]
        self._picture = v4l2.PixelLayout()
        self._controls: dict[int, v4l2.ControlRange] = {}

    @property
    def address(self) -> str:
        return self._path

    # --- connecting

    def connect(self) -> Identity:
        """Open the device, choose its format and size, and switch its automatic settings off. Raises DeviceError."""
        self.close()
        self._frames.check()
        with translated_errors(self.address, "add yourself to the group video, then log in again"):
            self._file = self._kernel.open(self._path)
        with closed_after_errors(self):
            identity = self._identify()
            self._set_format()
            self._controls = {number: one for number in (*PLAIN, *SET) if (one := self._range(number)) is not None}
            for number, value in PLAIN.items():
                if number in self._controls:
                    self._set(number, min(max(value, self._controls[number].low), self._controls[number].high))
            if self._wanted.gain is not None:
                gain = next((one for one in (v4l2.ANALOGUE_GAIN, v4l2.GAIN) if one in self._controls), None)
                if gain is None:
                    raise BadConfiguration(f"{self.address} has no gain to be set", "remove gain from its table")
                self._set_checked(gain, self._wanted.gain, "gain")
        return identity

    def _call(self, request: int, argument: Any) -> Any:
        """One request to the device; returns its argument. Raises DeviceError."""
        if self._file is None:
            raise not_connected(self.address)
        with translated_errors(self.address, REMEDY):
            self._kernel.call(self._file, request, argument)
        return argument

    def _identify(self) -> Identity:
        capability = self._call(v4l2.QUERYCAP, v4l2.Capability())
        has_own = capability.capabilities & v4l2.HAS_DEVICE_CAPS
        abilities = capability.device_caps if has_own else capability.capabilities
        if not (abilities & v4l2.CAN_CAPTURE and abilities & v4l2.CAN_STREAM):
            raise BadConfiguration(f"{self.address} streams no pictures", "name the device file of a camera")
        driver, card = capability.driver.decode("utf-8", "replace"), capability.card.decode("utf-8", "replace")
        self._body = Body(driver, card)
        version = ".".join(str(capability.version >> shift & 0xFF) for shift in (16, 8, 0))
        return Identity(card, f"{driver} {version}", "", self.address)

    def _listed(self, request: int, make: Any) -> Iterator[Any]:
        """Every entry of a list of the device: it ends with an error."""
        for index in range(MOST_LISTED):
            try:
                yield self._call(request, make(index))
            except Rejected:
                return

    def _set_format(self) -> None:
        listed = self._listed(v4l2.ENUM_FMT, lambda index: v4l2.FormatDescription(index=index, type=v4l2.CAPTURE))
        offered = {four_characters(one.pixel_format): one.description.decode("utf-8", "replace") for one in listed}
        self._form = self._chosen_format(list(offered))
        number = int.from_bytes(self._form.name.ljust(4).encode(), "little")
        columns, rows = self._size(number)
        wanted = v4l2.Format(type=v4l2.CAPTURE)
        wanted.picture = v4l2.PixelLayout(width=columns, height=rows, pixel_format=number, field=1)
        self._picture = self._call(v4l2.S_FMT, wanted).picture
        there = (self._picture.width, self._picture.height, self._picture.pixel_format)
        if there != (columns, rows, number):
            given = f"{there[0]} x {there[1]} {four_characters(there[2])}"
            asked = f"{columns} x {rows} {self._form.name}"
            raise BadConfiguration(f"{self.address} gives {given} instead of {asked}", REMEDY)

    def _chosen_format(self, offered: list[str]) -> PixelFormat:
        wanted = self._wanted.pixel_format.ljust(4)
        usable = [FORMATS[name] for name in offered if name in FORMATS]
        form = FORMATS.get(wanted) if wanted.strip() else None
        if form is None and not wanted.strip() and usable:
            form = max(usable, key=lambda one: (one.bits, one.cfa is not None, not one.packing))
        if form is None or form not in usable:
            reason = f"no grey or raw format {wanted.strip()}" if wanted.strip() else "no grey or raw format"
            names = ", ".join(name.strip() for name in offered) or "none"
            raise BadConfiguration(f"{self.address} has {reason}: it offers {names}", "use another camera or format")
        return form

    def _size(self, number: int) -> tuple[int, int]:
        """Columns and rows: as configured, or else the largest."""
        if self._wanted.columns is not None and self._wanted.rows is not None:
            return self._wanted.columns, self._wanted.rows
        sizes = self._listed(
            v4l2.ENUM_FRAMESIZES, lambda index: v4l2.FrameSize(index=index, pixel_format=number)
        )  # fmt: skip
        largest = max(map(_largest, sizes), key=lambda size: size[0] * size[1], default=None)
        if largest is None:
            raise BadConfiguration(f"{self.address} does not list its sizes", "write columns and rows")
        return largest

    def _range(self, number: int) -> v4l2.ControlRange | None:
        """The limits of a control; None if the camera has no such control."""
        try:
            one: v4l2.ControlRange = self._call(v4l2.QUERYCTRL, v4l2.ControlRange(id=number))
        except Rejected:
            return None
        return None if one.flags & v4l2.CONTROL_FIXED else one

    def _set(self, number: int, value: int) -> int:
        """Set a control; returns what it is set to."""
        self._call(v4l2.S_CTRL, v4l2.ControlValue(id=number, value=value))
        return self._get(number)

    def _get(self, number: int) -> int:
        return int(self._call(v4l2.G_CTRL, v4l2.ControlValue(id=number)).value)

    def _set_checked(self, number: int, value: int, name: str) -> None:
        """Set a control within its limits. Raises Rejected."""
        one = self._controls[number]
        if not one.low <= value <= one.high:
            raise Rejected(f"{self.address} has no {name} of {value}: it offers {one.low} .. {one.high}", REMEDY)
        there = self._set(number, value)
        if there != value:
            raise Rejected(f"{self.address} is set to a {name} of {there} instead of {value}", REMEDY)

    def close(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            self._kernel.close(file)

    def condition(self) -> Condition:
        return line_condition(self._file is not None)

    def sensor(self) -> FrameFormat:
        """The frames' size, and their format. Raises DeviceError."""
        if self._file is None:
            raise not_connected(self.address)
        size, form = (self._picture.width, self._picture.height), self._form
        return FrameFormat(*size, form.cfa, form.white, self._frames.optics.pixel_pitch_um)

    # --- photographing

    def configure(self, settings: CameraSettings) -> None:
        """Set the exposure time. Raises Rejected if the camera uses another one, or an ISO is requested."""
        if settings.iso is not None:
            raise Rejected(f"{self.address} has a gain and no ISO", "write its gain in station.toml")
        if settings.exposure_s is not None:
            self._set_exposure(settings.exposure_s)
        self.settings = settings

    def _set_exposure(self, exposure_s: float) -> None:
        one = self._controls.get(v4l2.EXPOSURE_TIME)
        if one is None:
            if self._file is None:
                raise not_connected(self.address)
            raise Rejected(f"{self.address} has no exposure time to be set", "use another camera")
        units = round(exposure_s / EXPOSURE_UNIT_S)
        if not one.low <= units <= one.high:
            offer = f"{one.low * EXPOSURE_UNIT_S:g} .. {one.high * EXPOSURE_UNIT_S:g}"
            reason = f"{self.address} cannot expose {exposure_s:g} s: it offers {offer}"
            raise Rejected(reason, "choose a time in that range")
        there_s = self._set(v4l2.EXPOSURE_TIME, units) * EXPOSURE_UNIT_S
        if abs(there_s / exposure_s - 1) > ROUNDING:
            raise Rejected(f"{self.address} exposes {there_s:g} s instead of {exposure_s:g} s", REMEDY)

    def _expose(self) -> ExposedFile:
        requested_s = self.clock.now_s()
        exposure_s = self.settings.exposure_s or 0.0
        if v4l2.EXPOSURE_TIME in self._controls:
            exposure_s = self._get(v4l2.EXPOSURE_TIME) * EXPOSURE_UNIT_S
        gain = next((self._get(one) for one in (v4l2.ANALOGUE_GAIN, v4l2.GAIN) if one in self._controls), None)
        with self._streaming() as memories:
            for _ in range(self._wanted.discard):
                self._queue(self._filled(exposure_s).index)
            buffer = self._filled(exposure_s)
            data = bytes(memoryview(memories[buffer.index])[: buffer.used])
        notes = {"pixel_format": self._form.name, "frame": buffer.sequence, "camera_s": buffer.time_s, "gain": gain}
        comment = json.dumps({name: value for name, value in notes.items() if value is not None})
        frame = Frame(self._read(data), self._form.cfa, self._form.white, exposure_s, comment)
        return self._frames.keep(frame, self._body, self.settings, requested_s, _times(buffer, exposure_s))

    @contextmanager
    def _streaming(self) -> Iterator[list[Any]]:
        """Context of a stream, which yields the memory of its buffers."""
        request = {"type": v4l2.CAPTURE, "memory": v4l2.MMAP}
        memories: list[Any] = []
        count = self._call(v4l2.REQBUFS, v4l2.BufferRequest(count=BUFFERS, **request)).count
        try:
            for index in range(count):
                buffer = self._call(v4l2.QUERYBUF, v4l2.VideoBuffer(index=index, **request))
                with translated_errors(self.address, REMEDY):
                    memories.append(self._kernel.memory(self._file or 0, buffer.length, buffer.offset))
                self._queue(index)
            self._call(v4l2.STREAMON, c_int(v4l2.CAPTURE))
            yield memories
        finally:
            with suppress(DeviceError):  # a camera that is gone streams no more
                self._call(v4l2.STREAMOFF, c_int(v4l2.CAPTURE))
            for memory in memories:
                memory.close()
            with suppress(DeviceError):
                self._call(v4l2.REQBUFS, v4l2.BufferRequest(count=0, **request))

    def _queue(self, index: int) -> None:
        self._call(v4l2.QBUF, v4l2.VideoBuffer(index=index, type=v4l2.CAPTURE, memory=v4l2.MMAP))

    def _filled(self, exposure_s: float) -> v4l2.VideoBuffer:
        """The next buffer that is filled. Raises FrameMissing, EmergencyStopped, LineLost."""
        limit_s = exposure_s + self._wanted.patience_s
        deadline_s = self.clock.now_s() + limit_s
        while self._file is not None and not self._kernel.ready(self._file, SLICE_S):
            self._check_stops()
            if self.clock.now_s() > deadline_s:
                raise FrameMissing(f"no frame came from {self.address} within {limit_s:g} s", "connect it again")
        buffer: v4l2.VideoBuffer = self._call(v4l2.DQBUF, v4l2.VideoBuffer(type=v4l2.CAPTURE, memory=v4l2.MMAP))
        if buffer.flags & v4l2.BUFFER_ERROR:
            raise FrameMissing(f"a frame of {self.address} is damaged", "use a shorter cable or another USB port")
        return buffer

    def _read(self, data: bytes) -> Any:
        picture, form = self._picture, self._form
        padding = max(picture.line_bytes - form.octets(picture.width), 0)
        try:
            return unpack(data, form, picture.height, picture.width, padding)
        except ValueError as error:
            raise FrameMissing(f"a frame of {self.address} is incomplete: {error}", "expose again") from error


SET = (v4l2.EXPOSURE_TIME, v4l2.GAIN, v4l2.ANALOGUE_GAIN)


def _largest(size: v4l2.FrameSize) -> tuple[int, int]:
    """Columns and rows of a discrete size, whose two numbers stand first, or the largest of a range."""
    if size.type == v4l2.DISCRETE:
        return size.size.low_x, size.size.high_x
    return size.size.high_x, size.size.high_y


def _times(buffer: v4l2.VideoBuffer, exposure_s: float) -> ShutterTimes | None:
    """Begin and end of the exposure by the monotonic clock, None if the camera has another one."""
    if not buffer.flags & v4l2.MONOTONIC:
        return None
    begin_s = buffer.time_s if buffer.flags & v4l2.AT_BEGIN else buffer.time_s - exposure_s
    return ShutterTimes(begin_s, begin_s + exposure_s)


def four_characters(number: int) -> str:
    """The name of a format by its number."""
    return number.to_bytes(4, "little").decode("latin-1")


@dataclass(frozen=True, kw_only=True)
class V4l2Options(V4l2Settings, FrameOptions):
    """Options of driver "v4l2"."""

    device: Annotated[str, text('"/dev/video0"', "the name of a device file in quotes")] = "/dev/video0"

    def problem(self) -> tuple[str, str] | None:
        """Where only one side of the frame is given."""
        if (self.columns is None) != (self.rows is None):
            return "has only one of columns and rows", "write both, or none"
        return None

    def make(self, parts: MakerContext) -> V4l2Camera:
        return V4l2Camera(self.frames(parts), self.device, self, clock=parts.clock)
