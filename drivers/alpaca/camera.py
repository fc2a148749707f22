"""A camera of an Alpaca server: its exposures are fetched and written as DNGs, so later stages see one format."""

import json
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from drivers.alpaca.link import AlpacaAddress, AlpacaLink, Levels, NumberedOptions
from drivers.dng import Body, DngFolder, Frame
from drivers.errors import BadConfiguration, Clock, FrameMissing, FrameWrong, Rejected
from drivers.frames import FrameCamera
from drivers.interfaces import CameraSettings, ExposedFile, FrameFormat, Identity
from drivers.making import FrameOptions, MakerContext
from drivers.options import TimeLimit, option, positive
from drivers.wire.connection import LineDevice, closed_after_errors, not_connected

POLL_S = 0.05
MONOCHROME, RGGB = 0, 2
IDLE, FAILED = 0, 5  # numbers of the camera's states
IDLE_POLLS = 3
"""Consecutive polls of an idle camera without an image after which its exposure counts as aborted elsewhere."""
TILE = ("RG", "GB")
LARGEST = np.iinfo(np.uint16).max


@dataclass(frozen=True)
class AlpacaCameraSettings:
    """Settings applied on connection.

    exposure_s : exposure time until another is configured
    patience_s : time limit of an exposure in addition to its duration, and of the fetching
    gain, offset : in the camera's own unit, the offset being its black level; None keeps the camera's
    """

    exposure_s: Annotated[float, positive("0.1")] = 0.1
    patience_s: TimeLimit = 30.0
    gain: Annotated[int, option("0", least=0)] | None = None
    offset: Annotated[int, option("0", least=0)] | None = None


class AlpacaCamera(LineDevice[AlpacaLink], FrameCamera):
    """A Camera of an Alpaca server; frames are saved by `frames`."""

    def __init__(
        self, server: AlpacaAddress, number: int, frames: DngFolder, settings: AlpacaCameraSettings | None = None, *,
        clock: Clock | None = None,
    ) -> None:  # fmt: skip
        self._link = AlpacaLink(server, "camera", number)
        self._wanted = settings or AlpacaCameraSettings()
        LineDevice.__init__(self, self._link)
        FrameCamera.__init__(self, clock, CameraSettings(exposure_s=self._wanted.exposure_s))
        self._frames = frames
        self._state = IDLE
        self._body = Body("", "")

    def connect(self) -> Identity:
        self.close()
        self._frames.check()
        identity = self._link.open()
        self._body = Body("Alpaca", identity.model.removeprefix("Alpaca "))
        with closed_after_errors(self):
            for name, value in (("Gain", self._wanted.gain), ("Offset", self._wanted.offset)):
                if value is not None:
                    self._set(name, value)
        return identity

    def _set(self, name: str, value: int) -> None:
        self._link.put(name.lower(), **{name: value})
        there = int(self._link.number_of(name.lower()))
        if there != value:
            raise Rejected(f"{self.address} has {name} {there} after {value} was set", "write one that it offers")

    def sensor(self) -> FrameFormat | None:
        """The camera's size and colours, None if its server does not know them yet. Raises DeviceError."""
        try:
            columns, rows, white, colours = self._numbers("cameraxsize", "cameraysize", "maxadu", "sensortype")
            x, y = self._numbers("bayeroffsetx", "bayeroffsety") if colours == RGGB else (0, 0)
        except Rejected:
            return None
        if colours not in (MONOCHROME, RGGB):
            raise BadConfiguration(f"{self.address} is not a monochrome or Bayer camera", "use one that is")
        cfa = None if colours == MONOCHROME else _shifted(x, y)
        return FrameFormat(columns, rows, cfa, min(white, LARGEST), self._frames.optics.pixel_pitch_um)

    def _numbers(self, *members: str) -> list[int]:
        return [int(self._link.number_of(member)) for member in members]

    def configure(self, settings: CameraSettings) -> None:
        """Use the exposure time from now on; the other settings belong to the lens and are only checked in the file."""
        exposure_s = self.settings.exposure_s if settings.exposure_s is None else settings.exposure_s
        self.settings = CameraSettings(exposure_s, settings.iso, settings.f_number)

    def _expose(self) -> ExposedFile:
        if not self._link.is_open:
            raise not_connected(self.address)
        requested_s, duration_s = self.clock.now_s(), float(self.settings.exposure_s or 0.0)
        self._link.put("startexposure", Duration=duration_s, Light=True)
        # wait until the image is ready; abort the exposure if anything interrupts the wait
        deadline_s = self.clock.now_s() + duration_s + self._wanted.patience_s
        idle = 0
        try:
            while not self._ready():
                self._check_stops()
                idle = idle + 1 if self._state == IDLE else 0
                if idle >= IDLE_POLLS:
                    raise FrameMissing(f"the exposure of {self.address} was aborted at its server", "expose again")
                if self.clock.now_s() > deadline_s:
                    reason = f"{self.address} had no image {self._wanted.patience_s:g} s after its exposure"
                    raise FrameMissing(reason, "look at its server, or raise patience_s")
                self.clock.sleep(POLL_S)
        except BaseException:
            self._link.preempt("abortexposure")
            self._check_stops()
            raise
        levels = self._link.image(self._wanted.patience_s)
        self._check_stops()
        return self._frames.keep(self._frame(levels, duration_s), self._body, self.settings, requested_s)

    def _ready(self) -> bool:
        try:
            if self._link.get("imageready"):
                return True
            self._state = int(self._link.number_of("camerastate"))
            if self._state == FAILED:
                self._link.get("imageready")
        except Rejected as error:  # some servers report here why an exposure failed, others never
            raise FrameMissing(error.reason, error.remedy) from error
        if self._state == FAILED:
            raise FrameMissing(f"{self.address} reports that its exposure failed", "look at its server, then repeat")
        return False

    def _frame(self, levels: Levels, duration_s: float) -> Frame:
        """The image with the camera's metadata. Raises FrameWrong, BadConfiguration."""
        sensor = self.sensor()
        if sensor is None:
            raise FrameWrong(f"{self.address} does not report the format of its image", "look at its server")
        low, high = int(levels.min(initial=0)), int(levels.max(initial=0))
        if low < 0 or high > LARGEST or levels.size == 0:
            content = f"{levels.shape[1]} x {levels.shape[0]} numbers from {low} to {high}"
            raise FrameWrong(f"{self.address} sent {content}", f"set it to give numbers from 0 to {LARGEST}")
        notes = {"gain": self._wanted.gain, "offset": self._wanted.offset}
        comment = json.dumps({name: value for name, value in notes.items() if value is not None})
        exposure_s = self._reported_exposure_s(duration_s)
        return Frame(levels.astype(np.uint16), sensor.cfa, sensor.white, exposure_s, comment)

    def _reported_exposure_s(self, duration_s: float) -> float:
        try:
            return self._link.number_of("lastexposureduration")
        except Rejected:
            return duration_s

    def emergency_stop(self) -> None:
        """Abort the exposure without waiting for pending requests."""
        FrameCamera.emergency_stop(self)
        if self._link.is_claimed:
            self._link.preempt("abortexposure")


def _shifted(x: int, y: int) -> str:
    """Colours of the 2 x 2 tile at the first pixel, for a mosaic whose red is at this offset."""
    return "".join(TILE[(row + y) % 2][(column + x) % 2] for row in (0, 1) for column in (0, 1))


@dataclass(frozen=True, kw_only=True)
class AlpacaCameraOptions(AlpacaCameraSettings, FrameOptions, NumberedOptions):
    """Options of driver "alpaca_camera"."""

    def make(self, parts: MakerContext) -> AlpacaCamera:
        return AlpacaCamera(self.at, self.device, self.frames(parts), self, clock=parts.clock)
