"""The bench's camera as an Alpaca camera: full sensor or a subframe, unbinned, numbers as in the RAW file."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, cast

from drivers.interfaces import Camera, CameraSettings, ExposedFile, FrameFormat
from procedures.raw import RawFrame, default_plane, read_frame
from station.bench.opening import frame_format
from station.service.alpaca.device import AlpacaDevice, Member, Task, absent, constant, refuse_operation
from station.service.alpaca.protocol import (
    INVALID_VALUE,
    NOT_IMPLEMENTED,
    VALUE_NOT_SET,
    AlpacaError,
    Mosaic,
    Parameters,
    first_red,
    sensor_image,
)
from station.service.bench_state import ServedBench

LONGEST_S = 3600.0
IDLE, EXPOSING, FAILED = 0, 2, 5
MONOCHROME, RGGB = 0, 2
"""Sensor types: every 2 x 2 mosaic is RGGB with an offset."""


@dataclass(frozen=True)
class Taken:
    """A photograph: its numbers as on the sensor, its record, its start."""

    levels: Mosaic
    frame: RawFrame
    exposure: ExposedFile
    began: datetime


class BenchCamera(AlpacaDevice):
    """ICameraV4. The sensor's format is the driver's, and from the first photograph on that of the file."""

    def __init__(self, served: ServedBench, number: int) -> None:
        assert served.bench is not None
        self._camera: Camera = served.bench.camera
        self._task = Task(served)
        self._taken: Taken | None = None
        self._ready = False
        self._aborted = False
        self._part: dict[str, int] = {"startx": 0, "starty": 0}
        super().__init__(served, "camera", number, "camera", {"camera": self._camera})

    def readable(self) -> Mapping[str, Member]:
        members: dict[str, Member] = {
            "bayeroffsetx": lambda given: self._red[0],
            "bayeroffsety": lambda given: self._red[1],
            "camerastate": lambda given: self._state(),
            "cameraxsize": lambda given: self._size[0],
            "cameraysize": lambda given: self._size[1],
            "imagearray": lambda given: self._shown_part(),
            "imagearrayvariant": lambda given: self._shown_part(),
            "imageready": lambda given: self._image_ready(),
            "lastexposureduration": lambda given: self._last_duration(),
            "lastexposurestarttime": lambda given: self._last.began.strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3],
            "maxadu": lambda given: self._sensor.white,
            "numx": lambda given: self._wanted("numx", self._size[0]),
            "numy": lambda given: self._wanted("numy", self._size[1]),
            "percentcompleted": lambda given: self._percent(),
            "pixelsizex": lambda given: self._pitch_um(),
            "pixelsizey": lambda given: self._pitch_um(),
            "sensortype": lambda given: MONOCHROME if self._sensor.cfa is None else RGGB,
            "startx": lambda given: self._part["startx"],
            "starty": lambda given: self._part["starty"],
        }
        return {**members, **CONSTANTS, **absent(*NEITHER, *ONLY_READ)}

    def writable(self) -> Mapping[str, Member]:
        members: dict[str, Member] = {
            "abortexposure": lambda given: self._abort(),
            "binx": lambda given: only(given, "BinX", 1),
            "biny": lambda given: only(given, "BinY", 1),
            "numx": lambda given: self._set_part(given, "NumX"),
            "numy": lambda given: self._set_part(given, "NumY"),
            "readoutmode": lambda given: only(given, "ReadoutMode", 0),
            "startexposure": self._start,
            "startx": lambda given: self._set_part(given, "StartX"),
            "starty": lambda given: self._set_part(given, "StartY"),
        }
        return members | absent(*NEITHER, "pulseguide", "stopexposure")

    def state(self) -> Mapping[str, Any]:
        return {"CameraState": self._state(), "ImageReady": self._ready}

    def _start(self, given: Parameters) -> None:
        duration_s = given.number("Duration")
        given.flag("Light")  # a body cannot keep its shutter closed: every frame is a light frame
        if not 0 <= duration_s <= LONGEST_S:
            message = f"Duration must be between 0 and {LONGEST_S:g} s; got {duration_s:g}"
            raise AlpacaError(INVALID_VALUE, message)
        if self._taken is not None:
            self._check_part(self._taken.levels)
        ready = self._ready
        if not self._task.running:  # before it begins: another client may abort it at once
            self._ready, self._aborted = False, False
        try:
            self._task.begin(f"an exposure of {duration_s:g} s", lambda: self._expose(duration_s))
        except AlpacaError:
            self._ready = ready
            raise

    def _expose(self, duration_s: float) -> None:
        self._camera.configure(CameraSettings(exposure_s=duration_s or None))
        began = datetime.now(UTC)
        exposure = self._camera.expose()
        frame = read_frame(exposure.path)
        self._taken = Taken(sensor_image(list(frame.planes.values())), frame, exposure, began)
        self.served.picture.show(frame.planes[default_plane(exposure.path)])
        self._check_part(self._taken.levels)
        self._ready = not self._aborted

    def _abort(self) -> None:
        if self._task.running:
            self._aborted = True
            self._task.halt(self._camera.emergency_stop)

    def _state(self) -> int:
        if self._task.running:
            return EXPOSING
        return FAILED if self._task.failure is not None else IDLE

    def _image_ready(self) -> bool:
        self._task.check()
        return self._ready and not self._task.running

    def _percent(self) -> int:
        if not self._task.running:
            raise refuse_operation("nothing is being exposed; begin with StartExposure")
        return 0

    def _shown_part(self) -> Mosaic:
        """The numbers of the requested subframe. Raises AlpacaError if there is no image."""
        if not self._image_ready():
            raise refuse_operation("there is no image; begin with StartExposure, and wait for ImageReady")
        levels = self._last.levels
        self._check_part(levels)
        x, y = self._part["startx"], self._part["starty"]
        rows, columns = self._wanted("numy", levels.shape[0]), self._wanted("numx", levels.shape[1])
        return levels[y : y + rows, x : x + columns]

    def _wanted(self, number: str, size: int) -> int:
        return self._part.get(number, size)

    def _check_part(self, levels: Mosaic) -> None:
        rows, columns = levels.shape
        for start, number, size in (("startx", "numx", columns), ("starty", "numy", rows)):
            first, count = self._part[start], self._wanted(number, size)
            if not (first >= 0 and count >= 1 and first + count <= size):
                message = f"{start} {first} and {number} {count} must be within 0 .. {size}"
                raise AlpacaError(INVALID_VALUE, message)

    def _set_part(self, given: Parameters, name: str) -> None:
        value = given.whole(name)
        if value < (1 if name.startswith("Num") else 0):
            raise AlpacaError(INVALID_VALUE, f"{name} must not be below 0, nor a size 0; got {value}")
        self._part[name.lower()] = value

    @property
    def _sensor(self) -> FrameFormat:
        if self._taken is not None:
            frame = self._taken.frame
            return frame_format(list(frame.planes.values()), frame.exposure.pixel_pitch_um)
        known = self._camera.sensor()
        if known is None:
            remedy = "write `sensor` for the camera in station.toml, or take a photograph with StartExposure"
            raise AlpacaError(VALUE_NOT_SET, f"the sensor of {self._camera.address} is not known yet; {remedy}")
        return known

    @property
    def _last(self) -> Taken:
        if self._taken is None:
            raise refuse_operation("no photograph was taken yet; begin with StartExposure")
        return self._taken

    @property
    def _size(self) -> tuple[int, int]:
        return self._sensor.columns, self._sensor.rows

    @property
    def _red(self) -> tuple[int, int]:
        red = first_red(self._sensor)
        if red is None:
            raise AlpacaError(NOT_IMPLEMENTED, "BayerOffset is not implemented: the sensor has no colours")
        return red

    def _last_duration(self) -> float:
        recorded = self._last.frame.exposure.exposure_s
        requested = self._last.exposure.settings.exposure_s
        if recorded is None and requested is None:
            raise AlpacaError(VALUE_NOT_SET, "neither client nor file give the exposure time; send a Duration above 0")
        return recorded if recorded is not None else cast(float, requested)

    def _pitch_um(self) -> float:
        pitch_um = self._sensor.pixel_pitch_um
        if pitch_um is None:
            raise AlpacaError(VALUE_NOT_SET, "the camera's files do not give the pixel pitch; look it up in its data")
        return pitch_um


CONSTANTS: Mapping[str, Member] = {
    **dict.fromkeys(("binx", "biny", "maxbinx", "maxbiny"), constant(1)),
    **dict.fromkeys(("exposuremin", "exposureresolution"), constant(0.0)),
    **dict.fromkeys(
        ("canasymmetricbin", "canfastreadout", "cangetcoolerpower", "canpulseguide", "cansetccdtemperature",
         "canstopexposure", "hasshutter", "ispulseguiding"), constant(False),
    ),
    "canabortexposure": constant(True), "exposuremax": constant(LONGEST_S), "readoutmode": constant(0),
    "readoutmodes": constant(["RAW"]), "sensorname": constant(""),
}  # fmt: skip
NEITHER = ("cooleron", "fastreadout", "gain", "offset", "setccdtemperature", "subexposureduration")
ONLY_READ = (
    "ccdtemperature", "coolerpower", "electronsperadu", "fullwellcapacity", "gainmax", "gainmin", "gains",
    "heatsinktemperature", "offsetmax", "offsetmin", "offsets",
)  # fmt: skip


def only(given: Parameters, name: str, value: int) -> None:
    """Raises AlpacaError unless the value is the only possible one."""
    received = given.whole(name)
    if received != value:
        raise AlpacaError(INVALID_VALUE, f"{name} can be {value} only; got {received}")
