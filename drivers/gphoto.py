"""A tethered body through libgphoto2. The only import of gphoto2, which is optional (extra `tether`).

All of libgphoto2 runs in one thread: it is not thread-safe, and may block for seconds. One exposure may
produce several files (RAW and JPEG) in any order, so files are collected until the body has been quiet for a while.
"""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Annotated, Any, TypeVar

from drivers.errors import BadConfiguration, Clock, EmergencyStopped, FrameMissing, LineLost, NoAnswer, Rejected
from drivers.frames import (
    FrameCamera,
    Inspect,
    KnownSensor,
    SensorText,
    check_settings,
    is_raw,
    sensor_format,
    sha256_of,
)
from drivers.interfaces import CameraSettings, Condition, ExposedFile, FrameFormat, Identity, Shutter
from drivers.making import DriverOptions, MakerContext
from drivers.options import SHUTTER, FolderName, device, text
from drivers.wire.connection import closed_after_errors, line_condition, not_connected

T = TypeVar("T")
CALL_S = 15.0
QUIET_S = 1.0
REMEDIES = {
    -53: "another program holds the camera: close it, or run `gio mount -s gphoto2`",
    -105: "check the model's name",
    -52: "switch the camera on and plug its cable in",
    -7: "check the camera's cable",
    -110: "the camera is busy: wait, or switch it off and on",
}
WIDGETS = {
    "exposure_s": ("shutterspeed", "shutterspeed2", "exptime"),
    "iso": ("iso", "isospeed"),
    "f_number": ("aperture", "f-number"),
}
"""Setting names by maker: Canon has an `aperture`, Nikon and Sony an `f-number`."""
NEAREST = 0.12  # allowed distance of a requested value from the choices: half of a third of a stop
TAKES_S = 3.0  # time limit for a body to accept a setting


@dataclass(frozen=True)
class BodyFile:
    """A file in the body."""

    folder: str
    name: str


class _Owner:
    """The one thread that calls libgphoto2."""

    def __init__(self, name: str) -> None:
        self._calls: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._serve, name=f"gphoto {name}", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while (call := self._calls.get()) is not None:
            future, work = call
            try:
                future.set_result(work())
            except Exception as error:  # handed over to whoever called
                future.set_exception(error)

    def call(self, work: Callable[[], T], timeout_s: float) -> T:
        """Run `work` in the thread and return its result. Raises NoAnswer, and what `work` raises."""
        future: Future[T] = Future()
        self._calls.put((future, work))
        try:
            return future.result(timeout_s)
        except FutureTimeout:
            raise NoAnswer(f"the camera did not answer within {timeout_s:g} s", "switch it off and on") from None

    def end(self) -> None:
        self._calls.put(None)
        self._thread.join(timeout=2.0)


class GphotoCamera(FrameCamera):
    """A Camera on libgphoto2; frames are saved to `folder`.

    With `shutter`, that fires; without, the body is triggered over its cable. Empty `model` and `port` select the
    first body found.
    """

    def __init__(
        self, folder: Path, inspect: Inspect, *, model: str = "", port: str = "", shutter: Shutter | None = None,
        pulse_s: float = 0.1, patience_s: float = 20.0, sensor: FrameFormat | None = None, clock: Clock | None = None,
    ) -> None:  # fmt: skip
        super().__init__(clock)
        self._sensor = KnownSensor(folder, inspect, sensor)
        self._stray: set[BodyFile] | None = None
        self._folder, self._inspect = folder, inspect
        self._model, self._port = model, port
        self._shutter, self._pulse_s, self._patience_s = shutter, pulse_s, patience_s
        self._owner: _Owner | None = None
        self._gp: Any = None
        self._camera: Any = None

    @property
    def address(self) -> str:
        return f"{self._model or 'first body'} at {self._port or 'any port'}"

    def connect(self) -> Identity:
        """Load the library and open the body. Raises DeviceError."""
        self.close()
        try:
            import gphoto2
        except ImportError as error:
            raise BadConfiguration(
                "gphoto2 is not installed", "install it: pip install 'calibration-station[tether]'"
            ) from error
        self._gp = gphoto2
        self._owner = _Owner(self.address)
        with closed_after_errors(self):
            return self._do(self._open)

    def _open(self) -> Identity:
        gp, camera = self._gp, self._gp.Camera()
        if self._model:
            abilities = gp.CameraAbilitiesList()
            abilities.load()
            camera.set_abilities(abilities.get_abilities(abilities.lookup_model(self._model)))
        if self._port:
            ports = gp.PortInfoList()
            ports.load()
            camera.set_port_info(ports.get_info(ports.lookup_path(self._port)))
        camera.init()
        self._camera = camera
        model = camera.get_abilities().model
        return Identity(model, f"libgphoto2 {gp.gp_library_version(gp.GP_VERSION_SHORT)[0]}", "", self.address)

    def close(self) -> None:
        """Close the body and end the thread."""
        owner, self._owner = self._owner, None
        camera, self._camera = self._camera, None
        if owner is None:
            return
        if camera is not None:
            try:
                owner.call(camera.exit, CALL_S)
            except Exception:  # a body that is gone raises on closing
                camera = None
        owner.end()

    def _do(self, work: Callable[[], T], timeout_s: float = CALL_S) -> T:
        """Run `work` in the library's thread. Raises DeviceError."""
        if self._owner is None:
            raise not_connected(f"the camera ({self.address})")
        try:
            return self._owner.call(work, timeout_s)
        except self._gp.GPhoto2Error as error:
            raise LineLost(
                f"{self.address}: {error}", REMEDIES.get(error.code, "switch the camera off and on")
            ) from error

    def condition(self) -> Condition:
        return line_condition(self._camera is not None)

    def sensor(self) -> FrameFormat | None:
        """The configured format, or that of the newest file fetched."""
        return self._sensor.read()

    def configure(self, settings: CameraSettings) -> None:
        """Set what can be set from the host, to the nearest choice of the body. Raises DeviceError."""
        self.settings = settings
        for name, wanted in asdict(settings).items():
            if name in WIDGETS and wanted is not None:
                self._do(partial(self._choose, WIDGETS[name], float(wanted)))

    def _choose(self, names: Sequence[str], wanted: float) -> None:
        """Set the first of these settings that the body has, and verify it. Raises Rejected."""
        try:
            config = self._camera.get_config()
        except self._gp.GPhoto2Error as error:
            if error.code == self._gp.GP_ERROR_NOT_SUPPORTED:
                return  # set on the body by hand; the file is checked later
            raise
        name, widget = next(((n, w) for n in names if (w := self._child(config, n)) is not None), ("", None))
        if widget is None:
            return
        choice = self._nearest(name, widget, wanted)
        if choice is None or widget.get_value() == choice:
            return
        if widget.get_readonly():
            raise self._not_taken(name, choice, widget.get_value())
        widget.set_value(choice)
        self._camera.set_config(config)
        deadline_s = self.clock.now_s() + TAKES_S
        while (now := self._camera.get_config().get_child_by_name(name).get_value()) != choice:
            if self.clock.now_s() > deadline_s:
                raise self._not_taken(name, choice, now)
            self.clock.sleep(0.1)

    def _child(self, config: Any, name: str) -> Any:
        try:
            return config.get_child_by_name(name)
        except self._gp.GPhoto2Error:
            return None

    def _nearest(self, name: str, widget: Any, wanted: float) -> str | None:
        """The choice nearest to `wanted`, None if the body offers none. Raises Rejected."""
        choices = {text: value for text in widget.get_choices() if (value := read_choice(text))}
        if not choices:
            return None
        nearest: str = min(choices, key=lambda text: abs(choices[text] / wanted - 1))
        if not min(choices.values()) / (1 + NEAREST) <= wanted <= max(choices.values()) * (1 + NEAREST):
            offered = f"{min(choices, key=choices.__getitem__)} .. {max(choices, key=choices.__getitem__)}"
            raise Rejected(
                f"the camera ({self.address}) has no {name} of {wanted:g}: it offers {offered}, {nearest} the nearest",
                "choose a value that it has, or turn its dial to M",
            )
        return nearest

    def _not_taken(self, name: str, choice: str, now: str) -> Rejected:
        return Rejected(
            f"the camera ({self.address}) did not accept {name} = {choice}: it is set to {now}",
            "turn its dial to M, and switch off its automatic setting",
        )

    def files(self) -> list[BodyFile]:
        """Every RAW file in the body. Raises DeviceError."""
        return self._do(lambda: self._list("/"))

    def _list(self, folder: str) -> list[BodyFile]:
        here = [BodyFile(folder, name) for name in _names(self._camera.folder_list_files(folder)) if is_raw(Path(name))]
        for name in _names(self._camera.folder_list_folders(folder)):
            here += self._list(f"{folder.rstrip('/')}/{name}")
        return here

    def fetch(self, place: BodyFile) -> Path:
        """Copy a file to the folder, under its own name or, if that exists, a new one. Raises DeviceError."""
        target = self._folder / place.name
        for number in range(1, 10_000):
            if not target.exists():
                break
            target = self._folder / f"{Path(place.name).stem}-{number}{Path(place.name).suffix}"
        part = target.with_suffix(".part")
        self._do(
            lambda: self._camera.file_get(place.folder, place.name, self._gp.GP_FILE_TYPE_NORMAL).save(str(part)),
            self._patience_s,
        )
        part.rename(target)
        return target

    def _expose(self) -> ExposedFile:
        requested_s = self.clock.now_s()
        # wait for the file of a stopped exposure, which could be taken for the next one's
        if self._stray is not None:
            with suppress(FrameMissing):
                self._new_file(self._stray)
            self._stray = None
        before = set(self.files()) if self._shutter else set()
        self._check_stops()  # the body's list may take long
        try:
            times = self._shutter.fire(self._pulse_s) if self._shutter else None
            place = self._new_file(before) if self._shutter else self._triggered()
        except EmergencyStopped:
            self._stray = before
            raise
        path = self.fetch(place)
        try:
            facts = self._inspect(path)
        except Exception as error:
            raise FrameMissing(f"{path.name} does not decode: {error}", "check the card, then repeat") from error
        check_settings(path, facts, self.settings)
        received_s = self.clock.now_s()
        return ExposedFile(path, sha256_of(path), path.stat().st_size, self.settings, requested_s, received_s, times)

    def _new_file(self, before: set[BodyFile]) -> BodyFile:
        """The RAW file of an externally fired shot: from the body's events, or else by listing."""
        added = self._do(self._collect, self._longest_s() + CALL_S)
        if added is not None:
            return self._the_raw(added)
        deadline_s = self.clock.now_s() + self._longest_s()
        while self.clock.now_s() < deadline_s:
            new = [place for place in self._do(self._list_afresh, self._longest_s()) if place not in before]
            if new:
                return new[0]
            self._check_stops()
            self.clock.sleep(0.2)
        return self._the_raw([])

    def _list_afresh(self) -> list[BodyFile]:
        """Every RAW file; libgphoto2 caches a listing until the body is opened again."""
        self._camera.exit()
        self._camera.init()
        return self._list("/")

    def _longest_s(self) -> float:
        return self._patience_s + (self.settings.exposure_s or 0.0)

    def _the_raw(self, added: list[BodyFile]) -> BodyFile:
        raw = [place for place in added if is_raw(Path(place.name))]
        if not raw:
            names = ", ".join(place.name for place in added) or "none"
            raise FrameMissing(
                f"no RAW file came within {self._longest_s():g} s (files: {names})",
                "set the body to RAW and check its card",
            )
        return raw[0]

    def _triggered(self) -> BodyFile:
        """Trigger over the cable and return the new RAW file."""

        def shoot() -> list[BodyFile]:
            self._camera.trigger_capture()
            return self._collect() or []

        return self._the_raw(self._do(shoot, self._longest_s() + CALL_S))

    def _collect(self) -> list[BodyFile] | None:
        """Files added by the body until it is done and quiet; None if it sends no events."""
        gp, added, complete = self._gp, list[BodyFile](), False
        deadline_s = self.clock.now_s() + self._longest_s()
        quiet_since_s = self.clock.now_s()
        while self.clock.now_s() < deadline_s:
            self._check_stops()
            try:
                kind, data = self._camera.wait_for_event(200)  # milliseconds
            except gp.GPhoto2Error as error:
                if error.code == gp.GP_ERROR_NOT_SUPPORTED:
                    return None
                raise
            if kind == gp.GP_EVENT_FILE_ADDED:
                added.append(BodyFile(data.folder, data.name))
            complete = complete or kind == gp.GP_EVENT_CAPTURE_COMPLETE
            if kind != gp.GP_EVENT_TIMEOUT:
                quiet_since_s = self.clock.now_s()
            elif added and (complete or self.clock.now_s() - quiet_since_s > QUIET_S):
                break
        return added

    def emergency_stop(self) -> None:
        """Stop waiting for a file, and open the contacts if a shutter box is used; a body's exposure ends by itself."""
        super().emergency_stop()
        if self._shutter is not None:
            self._shutter.emergency_stop()


def _names(listed: Any) -> list[str]:
    return [listed.get_name(i) for i in range(listed.count())]


def read_choice(text: str) -> float | None:
    """The number in `1/250`, `0.5s`, `f/5.6`, `400`; None if there is none."""
    text = text.strip().lower().removeprefix("f/").removeprefix("f").removesuffix("s").strip()
    over, _, under = text.partition("/")
    try:
        return float(over) / float(under or 1)
    except (ValueError, ZeroDivisionError):
        return None


@dataclass(frozen=True, kw_only=True)
class GphotoOptions(DriverOptions):
    """Options of driver "gphoto"."""

    folder: FolderName
    model: Annotated[str, text('"Canon EOS R5"')] = ""
    port: Annotated[str, text('"usb:001,004"', "libgphoto2's name of a port in quotes")] = ""
    shutter: Annotated[str, device(SHUTTER, '"shutter"')] | None = None
    sensor: SensorText | None = None

    def make(self, parts: MakerContext) -> GphotoCamera:
        box, sensor = parts.other(self.shutter) if self.shutter else None, sensor_format(self.sensor)
        return GphotoCamera(
            parts.folder / self.folder, parts.inspect, model=self.model, port=self.port, shutter=box, sensor=sensor,
            clock=parts.clock,
        )  # fmt: skip
