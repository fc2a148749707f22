"""A camera of an Alpaca server: its exposures are fetched and written as DNGs: everything downstream is one way."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from drivers.alpaca.link import AlpacaLink, AlpacaServer, Levels
from drivers.clock import Clock, SystemClock
from drivers.errors import BadConfiguration, EmergencyStopped, FrameMissing, FrameWrong, Rejected
from drivers.frame_files.dng_folder import Body, DngFolder, Frame
from drivers.interfaces import CameraSettings, Condition, ExposedFile, Identity
from drivers.wire.connection import line_condition, not_connected

POLL_S = 0.05
MONOCHROME, RGGB = 0, 2
FAILED = 5
"""Of the states of a camera."""
TILE = ("RG", "GB")
LARGEST = np.iinfo(np.uint16).max


@dataclass(frozen=True)
class AlpacaCameraSettings:
    """What is set when it is connected.

    Attributes
    ----------
    exposure_s : of exposures, until another is asked for
    patience_s : how long an exposure may take beside its own time, and so may the fetching
    """

    exposure_s: float = 0.1
    patience_s: float = 30.0


class AlpacaCamera:
    """A Camera of an Alpaca server; frames are saved by `frames`."""

    def __init__(
        self,
        server: AlpacaServer,
        number: int,
        frames: DngFolder,
        settings: AlpacaCameraSettings | None = None,
        *,
        clock: Clock | None = None,
    ) -> None:
        self.clock = clock or SystemClock()
        self._wanted = settings or AlpacaCameraSettings()
        self.settings = CameraSettings(exposure_s=self._wanted.exposure_s)
        self._frames = frames
        self._link = AlpacaLink(server, "camera", number)
        self._one_frame = threading.Lock()
        self._stops = 0
        self._body = Body("", "")

    @property
    def address(self) -> str:
        """Device and server."""
        return self._link.address

    def connect(self) -> Identity:
        """Connect it. Raises DeviceError."""
        self.close()
        self._frames.check()
        identity = self._link.open()
        self._body = Body("Alpaca", identity.model.removeprefix("Alpaca "))
        return identity

    def close(self) -> None:
        """Leave it."""
        self._link.close()

    def condition(self) -> Condition:
        """Whether it is there."""
        return line_condition(self._link.is_open)

    def configure(self, settings: CameraSettings) -> None:
        """Take the exposure time from now on; the rest is the lens's, and what the file tells is checked against it."""
        exposure_s = self.settings.exposure_s if settings.exposure_s is None else settings.exposure_s
        self.settings = CameraSettings(exposure_s, settings.iso, settings.f_number)

    def expose(self) -> ExposedFile:
        """One photograph, fetched, written and read again. Raises DeviceError."""
        if not self._one_frame.acquire(blocking=False):
            raise Rejected(f"{self.address} exposes already", "wait for the frame")
        try:
            return self._expose()
        finally:
            self._one_frame.release()

    def _expose(self) -> ExposedFile:
        if not self._link.is_open:
            raise not_connected(self.address)
        stops, requested_s = self._stops, self.clock.now_s()
        asked_s = float(self.settings.exposure_s or 0.0)
        with self._link.asked():
            self._link.device.StartExposure(asked_s, True)
        self._wait(stops, asked_s)
        levels = self._link.image(self._wanted.patience_s)
        self._check_stops(stops)
        return self._frames.keep(self._frame(levels, asked_s), self._body, self.settings, requested_s)

    def _wait(self, stops: int, asked_s: float) -> None:
        """Until the image is ready; whatever ends this before, the exposure is aborted."""
        deadline_s = self.clock.now_s() + asked_s + self._wanted.patience_s
        try:
            while not self._ready():
                self._check_stops(stops)
                if self.clock.now_s() > deadline_s:
                    told = f"{self.address} had no image {self._wanted.patience_s:g} s after its exposure"
                    raise FrameMissing(told, "look at its server, or raise patience_s")
                self.clock.sleep(POLL_S)
        except BaseException:
            self._link.shout("abortexposure")
            self._check_stops(stops)
            raise

    def _ready(self) -> bool:
        try:
            with self._link.asked():
                if self._link.device.ImageReady:
                    return True
                failed = int(self._link.device.CameraState) == FAILED
        except Rejected as error:  # what went wrong some servers tell here, others nowhere
            raise FrameMissing(error.reason, error.remedy) from error
        if failed:
            raise FrameMissing(f"{self.address} says that its exposure failed", "look at its server, then repeat")
        return False

    def _check_stops(self, stops: int) -> None:
        if self._stops != stops:
            raise EmergencyStopped(f"emergency stop at {self.address}", "make it safe, then expose again")

    def _frame(self, levels: Levels, asked_s: float) -> Frame:
        """The image with what the camera tells of it. Raises FrameWrong, BadConfiguration."""
        device = self._link.device
        with self._link.asked():
            white, colours = int(device.MaxADU), int(device.SensorType)
            offset = (int(device.BayerOffsetX), int(device.BayerOffsetY)) if colours == RGGB else (0, 0)
        if colours not in (MONOCHROME, RGGB):
            raise BadConfiguration(f"{self.address} is no monochrome or Bayer camera", "use one that is")
        low, high = int(levels.min(initial=0)), int(levels.max(initial=0))
        if low < 0 or high > LARGEST or levels.size == 0:
            told = f"{levels.shape[1]} x {levels.shape[0]} numbers from {low} to {high}"
            raise FrameWrong(f"{self.address} sent {told}", f"set it to give numbers from 0 to {LARGEST}")
        cfa = None if colours == MONOCHROME else _shifted(offset)
        return Frame(levels.astype(np.uint16), cfa, min(white, LARGEST), self._told_s(asked_s))

    def _told_s(self, asked_s: float) -> float:
        """How long the exposure was, by the camera where it tells."""
        try:
            with self._link.asked():
                return float(self._link.device.LastExposureDuration)
        except Rejected:
            return asked_s

    def emergency_stop(self) -> None:
        """Abort the exposure, past whatever is being asked."""
        self._stops += 1
        if self._link.is_open:
            self._link.shout("abortexposure")


def _shifted(offset: tuple[int, int]) -> str:
    """The 2 x 2 tile from the first pixel on, of a mosaic whose red lies at this offset."""
    x, y = offset
    return "".join(TILE[(row + y) % 2][(column + x) % 2] for row in (0, 1) for column in (0, 1))
