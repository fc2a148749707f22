"""A GenICam camera: software trigger, one frame at a time, each written as a DNG with its exposure and gain."""

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Annotated, Any

from drivers.dng import Body, DngFolder, Frame
from drivers.errors import BadConfiguration, Clock, DeviceError, FrameMissing, FrameWrong, LineLost, Rejected
from drivers.frames import FrameCamera
from drivers.genicam.pixel_formats import PixelFormat, deepest, pixel_format, unpack
from drivers.interfaces import CameraSettings, Condition, ExposedFile, FrameFormat, Identity, ShutterTimes
from drivers.making import FrameOptions, MakerContext
from drivers.options import option, positive, text
from drivers.wire.connection import closed_after_errors, not_connected

BUFFERS = 4
SLICE_S = 0.05  # interval at which a wait for a frame checks for a stop
MICROSECONDS = 1e6
ROUNDING = 0.05  # allowed relative deviation from the requested exposure: cameras count in lines or clock ticks
GAIN_STEP_DB = 0.1  # allowed deviation from the requested gain
REMEDY = "choose a value that the camera offers: its maker's viewer or `arv-tool-0.8 features` lists them"


@dataclass(frozen=True)
class GenicamSettings:
    """Settings applied on connection.

    pixel_format : the camera's name of it; "" takes the deepest grey or raw one offered
    gain_db : None keeps the camera's gain
    patience_s : time limit of a frame after its exposure
    """

    pixel_format: Annotated[
        str,
        option(
            '"BayerRG12p"', "a grey or Bayer pixel format of 8 to 16 bits",
            pattern=r"^((Mono|Bayer(RG|BG|GR|GB))\d+\w*)\Z",
        ),
    ] = ""  # fmt: skip
    gain_db: Annotated[float, option("0.0")] | None = None
    patience_s: Annotated[float, positive("5")] = 5.0


class GenicamCamera(FrameCamera):
    """A Camera on Aravis; `camera` is its name or address as listed by Aravis, "" the first one found."""

    def __init__(
        self, frames: DngFolder, camera: str = "", settings: GenicamSettings | None = None, *,
        clock: Clock | None = None,
    ) -> None:  # fmt: skip
        super().__init__(clock)
        self._frames, self._name, self._wanted = frames, camera, settings or GenicamSettings()
        self._aravis: Any = None
        self._camera: Any = None
        self._stream: Any = None
        self._listening: tuple[Any, int] | None = None
        self._body = Body("", "")
        self._form = PixelFormat("Mono8", 8)
        self._lost = False

    @property
    def address(self) -> str:
        return self._name or "first GenICam camera"

    # --- connecting

    def connect(self) -> Identity:
        """Find the camera, take control, configure it, and arm its trigger. Raises DeviceError."""
        self.close()
        self._frames.check()
        self._aravis = load()
        with translated_errors(self.address, "check power, cable and address; close its other programs", LineLost):
            self._camera = self._aravis.Camera.new(self._name or None)
        with closed_after_errors(self):
            identity = self._identify()
            camera, aravis = self._camera, self._aravis
            with translated_errors(self.address, REMEDY):
                for feature in ("ExposureAuto", "GainAuto"):
                    if camera.is_feature_available(feature):
                        camera.set_string(feature, "Off")
                self._form = self._chosen_format(list(camera.dup_available_pixel_formats_as_strings()))
                camera.set_pixel_format_from_string(self._form.name)
                camera.set_acquisition_mode(aravis.AcquisitionMode.CONTINUOUS)
                if not camera.is_software_trigger_supported():
                    raise BadConfiguration(f"{self.address} cannot be triggered by software", "use another camera")
                camera.set_trigger("Software")
                if self._wanted.gain_db is not None:
                    self._set_gain(self._wanted.gain_db)
            self._start()
        return identity

    def _identify(self) -> Identity:
        camera = self._camera
        with translated_errors(self.address, "update the camera's firmware"):
            self._body = Body(
                camera.get_vendor_name(), camera.get_model_name(), camera.get_device_serial_number() or ""
            )
        firmware = next(filter(None, map(self._text, ("DeviceFirmwareVersion", "DeviceVersion"))), "")
        device = camera.get_device()
        self._listening = (device, device.connect("control-lost", self._lose))
        return Identity(f"{self._body.make} {self._body.model}", firmware, self._body.serial, self.address)

    def _lose(self, *_: object) -> None:
        self._lost = True

    def _text(self, feature: str) -> str:
        with suppress(DeviceError), translated_errors(self.address, ""):
            if self._camera.is_feature_available(feature):
                return str(self._camera.get_string(feature))
        return ""

    def _chosen_format(self, offered: list[str]) -> PixelFormat:
        wanted = self._wanted.pixel_format
        form = pixel_format(wanted) if wanted else deepest(offered)
        good = ", ".join(name for name in offered if pixel_format(name)) or "none that is grey or raw"
        if form is None or form.name not in offered:
            reason = f"no pixel format {wanted} that can be used" if wanted else "no grey or raw pixel format"
            raise BadConfiguration(f"{self.address} has {reason}", f"name one of its own: {good}")
        return form

    def _set_gain(self, gain_db: float) -> None:
        low, high = self._camera.get_gain_bounds()
        if not low <= gain_db <= high:
            raise Rejected(f"{self.address} has no gain of {gain_db:g} dB: it offers {low:g} .. {high:g}", REMEDY)
        self._camera.set_gain(gain_db)
        there_db = self._camera.get_gain()
        if abs(there_db - gain_db) > GAIN_STEP_DB:
            raise Rejected(f"{self.address} is set to {there_db:g} dB instead of {gain_db:g} dB", REMEDY)

    def _start(self) -> None:
        with translated_errors(self.address, "check the network: jumbo frames, firewall, a free port", LineLost):
            self._stream = self._camera.create_stream(None, None)
            size = self._camera.get_payload()
            for _ in range(BUFFERS):
                self._stream.push_buffer(self._aravis.Buffer.new_allocate(size))
            self._camera.start_acquisition()

    def _stop(self) -> None:
        """Stop the stream: a frame still due from an earlier trigger is discarded with it."""
        if self._camera is not None and self._stream is not None:
            with suppress(DeviceError), translated_errors(self.address, ""):
                self._camera.stop_acquisition()
        self._stream = None

    def close(self) -> None:
        self._stop()
        if self._listening is not None:
            device, number = self._listening
            device.disconnect(number)  # the handler would keep the camera, and the control over it
        self._listening, self._camera, self._lost = None, None, False

    def condition(self) -> Condition:
        if self._camera is None:
            return Condition("not connected", False, "connect it")
        if self._lost:
            return Condition("the camera is gone", False, "check its power and cable, then connect it again")
        return Condition("ready")

    # --- photographing

    def sensor(self) -> FrameFormat:
        """The camera's region, in its pixel format. Raises DeviceError."""
        self._require()
        with translated_errors(self.address, REMEDY):
            _, _, columns, rows = self._camera.get_region()
        return FrameFormat(columns, rows, self._form.cfa, self._form.white, self._frames.optics.pixel_pitch_um)

    def configure(self, settings: CameraSettings) -> None:
        """Set the exposure time. Raises Rejected if the camera uses another one, or an ISO is requested."""
        self._require()
        if settings.iso is not None:
            raise Rejected(f"{self.address} has a gain and no ISO", "write its gain_db in station.toml")
        if settings.exposure_s is not None:
            self._set_exposure(settings.exposure_s)
        self.settings = settings

    def _set_exposure(self, exposure_s: float) -> None:
        with translated_errors(self.address, REMEDY):
            low, high = (bound / MICROSECONDS for bound in self._camera.get_exposure_time_bounds())
            if not low <= exposure_s <= high:
                offer = f"it offers {low:g} .. {high:g}"
                raise Rejected(f"{self.address} cannot expose {exposure_s:g} s: {offer}", "choose a time in that range")
            self._camera.set_exposure_time(exposure_s * MICROSECONDS)
            there_s = self._camera.get_exposure_time() / MICROSECONDS
        if abs(there_s / exposure_s - 1) > ROUNDING:
            raise Rejected(f"{self.address} exposes {there_s:g} s instead of {exposure_s:g} s", REMEDY)

    def _require(self) -> None:
        if self._camera is None or self._lost:
            raise not_connected(self.address)

    def _expose(self) -> ExposedFile:
        self._require()
        if self._stream is None:
            self._start()
        try:
            return self._triggered()
        except DeviceError:
            self._stop()  # its frame may still come, and could be taken for the next one's
            raise

    def _triggered(self) -> ExposedFile:
        requested_s = self.clock.now_s()
        with translated_errors(self.address, REMEDY):
            exposure_s = self._camera.get_exposure_time() / MICROSECONDS
            gain_db = self._camera.get_gain() if self._camera.is_gain_available() else None
            while (stale := self._stream.try_pop_buffer()) is not None:
                self._stream.push_buffer(stale)
            begun_s = self.clock.now_s()
            self._camera.software_trigger()
        limit_s = exposure_s + self._wanted.patience_s
        deadline_s = self.clock.now_s() + limit_s
        while (buffer := self._stream.timeout_pop_buffer(int(SLICE_S * MICROSECONDS))) is None:
            self._check_stops()
            if self._lost:
                raise LineLost(f"{self.address} is gone", "check its power and cable, then connect it again")
            if self.clock.now_s() > deadline_s:
                raise FrameMissing(f"no frame came from {self.address} within {limit_s:g} s", "check its trigger")
        try:
            frame = self._read(buffer, exposure_s, gain_db)
        finally:
            self._stream.push_buffer(buffer)
        times = ShutterTimes(begun_s, begun_s + exposure_s)
        return self._frames.keep(frame, self._body, self.settings, requested_s, times)

    def _read(self, buffer: Any, exposure_s: float, gain_db: float | None) -> Frame:
        """The frame in a buffer. Raises FrameMissing if packets of it were lost."""
        if buffer.get_status() != self._aravis.BufferStatus.SUCCESS:
            status = buffer.get_status().value_nick
            raise FrameMissing(f"a frame of {self.address} is incomplete ({status})", "lower its packet size or load")
        rows, columns = buffer.get_image_height(), buffer.get_image_width()
        try:
            mosaic = unpack(buffer.get_image_data(), self._form, rows, columns, buffer.get_image_padding()[0])
        except ValueError as error:
            raise FrameWrong(f"{self.address}: {error}", "connect it again") from error
        notes = {"pixel_format": self._form.name, "frame": buffer.get_frame_id(), "camera_ns": buffer.get_timestamp()}
        comment = json.dumps(notes if gain_db is None else {**notes, "gain_db": gain_db})
        return Frame(mosaic, self._form.cfa, self._form.white, exposure_s, comment)


@dataclass(frozen=True, kw_only=True)
class GenicamOptions(GenicamSettings, FrameOptions):
    """Options of driver "genicam"."""

    camera: Annotated[str, text('"192.168.1.20"', "a camera's name or address in quotes")] = ""

    def make(self, parts: MakerContext) -> GenicamCamera:
        return GenicamCamera(self.frames(parts), self.camera, self, clock=parts.clock)


# --- Aravis, loaded on first use, with its errors converted to device errors ---

INSTALL = (
    "install it: Aravis with its introspection data (Debian: gir1.2-aravis-0.8), and PyGObject "
    "(pip install 'calibration-station[genicam]', or Debian's python3-gi in an environment that sees system packages)"
)


def load() -> Any:
    """The library. Raises BadConfiguration if it or PyGObject is not installed."""
    try:
        import gi
    except ImportError as error:
        raise BadConfiguration("PyGObject is not installed", INSTALL) from error
    try:
        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis
    except (ValueError, ImportError) as error:
        raise BadConfiguration(f"Aravis 0.8 is not installed: {error}", INSTALL) from error
    return Aravis


@contextmanager
def translated_errors(address: str, remedy: str, kind: type[DeviceError] = Rejected) -> Iterator[None]:
    """Context that converts errors of Aravis and the camera to `kind`, and to LineLost if the camera is gone."""
    from gi.repository import GLib

    try:
        yield
    except GLib.Error as error:
        gone = error.matches(GLib.quark_from_string("arv-device-error-quark"), TIMEOUT)
        if gone:
            raise LineLost(f"{address} does not answer: {error.message}", "check its power and cable") from error
        raise kind(f"{address}: {error.message}", remedy) from error


TIMEOUT = 4  # Aravis' error number of an unanswered request (ARV_DEVICE_ERROR_TIMEOUT)
