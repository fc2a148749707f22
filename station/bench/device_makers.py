"""Drivers by their name in station.toml; their options have been checked before (device_check)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from drivers.alpaca.camera import AlpacaCamera, AlpacaCameraSettings
from drivers.alpaca.link import AlpacaAddress
from drivers.alpaca.stage import AlpacaAxis, AlpacaStage
from drivers.alpaca.switch import AlpacaLight, AlpacaShutter, AlpacaSwitch
from drivers.artnet import ArtNetLight
from drivers.clock import Clock
from drivers.folder_camera import FolderCamera, Tether
from drivers.frame_files.dng_folder import DngFolder, OpticsMetadata
from drivers.frames import Inspect
from drivers.gcs import GcsParser, GcsStage
from drivers.genicam.camera import GenicamCamera, GenicamSettings
from drivers.gphoto import GphotoCamera
from drivers.grbl import GrblStage
from drivers.grbl_envelope import GrblAxis
from drivers.imu import FastImu, WitImu
from drivers.interfaces import PROBE_UNITS, Device, Parser, SensorFormat, Shutter, Transport
from drivers.light import DmxLight, DmxParser, GrblLight, LampProperties
from drivers.micromanager.camera import MicroManagerCamera
from drivers.micromanager.core import Core
from drivers.micromanager.shutter import MicroManagerShutter
from drivers.micromanager.stage import MicroManagerAxis, MicroManagerStage
from drivers.newport import Esp301Stage, NewportParser, Smc100Stage
from drivers.polled_stage import PolledAxis, PolledStage
from drivers.protocols.grbl import GrblParser
from drivers.protocols.grbl_link import GrblLink
from drivers.protocols.imu import FastParser, WitParser
from drivers.protocols.tmcl import TmclParser
from drivers.protocols.zaber import ZaberParser
from drivers.rangefinder import BoschParser, BoschRangefinder, JrtParser, JrtRangefinder
from drivers.scpi import ProbeChannel, ScpiLight, ScpiParser, ScpiProbe, SupplySettings
from drivers.shaker import ShakerAxis, StrigShaker
from drivers.shutter import NullParser, RelayShutter, RtsShutter, StrigParser, StrigShutter
from drivers.thorlabs import AptParser, AptStage
from drivers.tmcl.stage import TmclAxis, TmclStage
from drivers.transport import SerialTransport
from drivers.watchdog import Released, StrigWatchdog
from drivers.wire.transcript import Transcript
from drivers.wire.visa import VISA, VisaTransport
from drivers.zaber import ZaberAxis, ZaberStage
from station.bench.device_options import added_drivers


@dataclass(frozen=True)
class MakerContext:
    """Context of the makers: devices made so far, folders, clock, RAW file reader.

    Every line has a transcript in `transcripts`; devices of one Micro-Manager configuration share its core.
    """

    made: Mapping[str, Device]
    folder: Path
    clock: Clock
    inspect: Inspect
    wire_log: Path | None = None
    transcripts: dict[str, Transcript] = field(default_factory=dict)
    cores: dict[Path, Core] = field(default_factory=dict)

    def wire(self, name: str, port: str, parser: Callable[[], Parser[Any]], **options: Any) -> SerialTransport[Any]:
        """The line to a device, with its transcript."""
        self.transcripts[name] = transcript = Transcript(file=self._log(name))
        return SerialTransport(port, parser, clock=self.clock, transcript=transcript, **options)

    def instrument(self, name: str, port: str, baud: int, library: str) -> Transport[str]:
        """The line to an instrument: a VISA resource, or a port."""
        if not port.lower().startswith(VISA):
            return self.wire(name, port, ScpiParser, baud=baud)
        self.transcripts[name] = transcript = Transcript(file=self._log(name))
        return VisaTransport(port, ScpiParser, library=library, clock=self.clock, transcript=transcript)

    def _log(self, name: str) -> Path | None:
        return self.wire_log / f"wire-{name}.txt" if self.wire_log else None

    def link(self, on: str | None, name: str, port: str | None) -> tuple[GrblLink, bool]:
        """The stage's GRBL controller, or a separate one; and whether it is separate."""
        if on is None:
            return GrblLink(self.wire(name, str(port), GrblParser)), True
        return cast(GrblStage, self.made[on]).link, False

    def core(self, config: str, adapters: str | None) -> Core:
        """The core of this Micro-Manager configuration file."""
        path = (self.folder / config).resolve()
        return self.cores.setdefault(path, Core(path, None if adapters is None else self.folder / adapters))

    def frames(self, folder: str, **optics: Any) -> DngFolder:
        """The folder for frames of a camera without files."""
        return DngFolder(self.folder / folder, self.inspect, OpticsMetadata(**optics), clock=self.clock)


def _grbl(
    name: str, parts: MakerContext, *, port: str, axes: Sequence[Mapping[str, Any]], baud: int = 115200,
    reset_on_open: str = "expect", poll_s: float = 0.2,
) -> GrblStage:  # fmt: skip
    dtr = False if reset_on_open == "avoid" else None
    wire = parts.wire(name, port, GrblParser, baud=baud, dtr=dtr)
    made = [GrblAxis(**axis) for axis in axes]
    return GrblStage(wire, made, clock=parts.clock, reset_on_open=reset_on_open, poll_s=poll_s)


def _zaber(
    name: str,
    parts: MakerContext,
    *,
    port: str,
    axes: Sequence[Mapping[str, Any]],
    baud: int = 115200,
    poll_s: float = 0.1,
) -> ZaberStage:
    made = [ZaberAxis(**axis) for axis in axes]
    return ZaberStage(parts.wire(name, port, ZaberParser, baud=baud), made, clock=parts.clock, poll_s=poll_s)


def _tmcl_stage(
    name: str, parts: MakerContext, *, port: str, axes: Sequence[Mapping[str, Any]], baud: int = 9600, **limits: Any
) -> TmclStage:
    made = [TmclAxis(**{**axis, "travel": tuple(axis["travel"])}) for axis in axes]
    return TmclStage(parts.wire(name, port, TmclParser, baud=baud), made, clock=parts.clock, **limits)


def _polled(
    stage: type[PolledStage[Any]], parser: Callable[[], Parser[Any]], baud: int
) -> Callable[..., PolledStage[Any]]:
    """The maker of a `PolledStage` on a serial line."""
    usual = baud

    def make(
        name: str, parts: MakerContext, *, port: str, axes: Sequence[Mapping[str, Any]], baud: int = usual,
        poll_s: float = 0.1, **settings: Any,
    ) -> PolledStage[Any]:  # fmt: skip
        made = [PolledAxis(**{**axis, "travel": tuple(axis["travel"]) if "travel" in axis else None}) for axis in axes]
        return stage(parts.wire(name, port, parser, baud=baud), made, clock=parts.clock, poll_s=poll_s, **settings)

    return make


def _strig(name: str, parts: MakerContext, *, port: str, baud: int = 115200) -> StrigShutter:
    return StrigShutter(parts.wire(name, port, StrigParser, baud=baud), clock=parts.clock)


def _strig_shaker(name: str, parts: MakerContext, *, box: str, axes: Sequence[Mapping[str, Any]]) -> StrigShaker:
    made = [ShakerAxis(**axis) for axis in axes]
    return StrigShaker(cast(StrigShutter, parts.made[box]), made, clock=parts.clock)


def _strig_watchdog(name: str, parts: MakerContext, *, box: str, stages: Sequence[str]) -> StrigWatchdog:
    return StrigWatchdog(cast(StrigShutter, parts.made[box]), [cast(Released, parts.made[stage]) for stage in stages])


def _rts(name: str, parts: MakerContext, *, port: str) -> RtsShutter:
    return RtsShutter(parts.wire(name, port, NullParser, rts=False), clock=parts.clock)


def _relay(name: str, parts: MakerContext, *, on: str | None = None, port: str | None = None) -> RelayShutter:
    link, own = parts.link(on, name, port)
    return RelayShutter(link, clock=parts.clock, owns_link=own)


def _sensor(text: str | None) -> SensorFormat | None:
    """The format written as "6000x4000 RGGB 14": size, colours of the tile or `grey`, bits."""
    if text is None:
        return None
    size, colours, bits = text.split()
    columns, rows = map(int, size.split("x"))
    return SensorFormat(columns, rows, None if colours == "grey" else colours, 2 ** int(bits) - 1)


def _folder(
    name: str, parts: MakerContext, *, folder: str, shutter: str, sensor: str | None = None, **tether: Any
) -> FolderCamera:
    box, place = cast(Shutter, parts.made[shutter]), parts.folder / folder
    tethered = Tether(**tether)
    return FolderCamera(place, box, parts.inspect, tether=tethered, sensor=_sensor(sensor), clock=parts.clock)


def _gphoto(
    name: str, parts: MakerContext, *, folder: str, model: str = "", port: str = "", shutter: str | None = None,
    sensor: str | None = None,
) -> GphotoCamera:  # fmt: skip
    box = cast(Shutter, parts.made[shutter]) if shutter else None
    place, known = parts.folder / folder, _sensor(sensor)
    return GphotoCamera(place, parts.inspect, model=model, port=port, shutter=box, sensor=known, clock=parts.clock)


def _micromanager_stage(
    name: str, parts: MakerContext, *, config: str, axes: Sequence[Mapping[str, Any]], adapters: str | None = None,
    patience_s: float = 60.0,
) -> MicroManagerStage:  # fmt: skip
    made = [MicroManagerAxis(**{**axis, "travel": tuple(axis["travel"])}) for axis in axes]
    return MicroManagerStage(parts.core(config, adapters), made, patience_s=patience_s, clock=parts.clock)


def _micromanager_camera(
    name: str, parts: MakerContext, *, config: str, device: str, folder: str, adapters: str | None = None,
    mosaic: str = "none", **optics: Any,
) -> MicroManagerCamera:  # fmt: skip
    frames, cfa = parts.frames(folder, **optics), None if mosaic == "none" else mosaic
    return MicroManagerCamera(parts.core(config, adapters), device, frames, cfa=cfa, clock=parts.clock)


def _micromanager_shutter(
    name: str, parts: MakerContext, *, config: str, device: str, adapters: str | None = None
) -> MicroManagerShutter:
    return MicroManagerShutter(parts.core(config, adapters), device, clock=parts.clock)


def _genicam(
    name: str, parts: MakerContext, *, folder: str, camera: str = "", pixel_format: str = "",
    gain_db: float | None = None, patience_s: float = 5.0, **optics: Any,
) -> GenicamCamera:  # fmt: skip
    settings = GenicamSettings(pixel_format, gain_db, patience_s)
    return GenicamCamera(parts.frames(folder, **optics), camera, settings, clock=parts.clock)


def _alpaca_stage(
    name: str, parts: MakerContext, *, server: str, axes: Sequence[Mapping[str, Any]], password_variable: str = "",
    patience_s: float = 60.0,
) -> AlpacaStage:  # fmt: skip
    made = [AlpacaAxis(**axis) for axis in axes]
    return AlpacaStage(AlpacaAddress(server, password_variable), made, patience_s=patience_s, clock=parts.clock)


def _alpaca_camera(
    name: str, parts: MakerContext, *, server: str, folder: str, device: int = 0, password_variable: str = "",
    exposure_s: float = 0.1, patience_s: float = 30.0, **optics: Any,
) -> AlpacaCamera:  # fmt: skip
    settings = AlpacaCameraSettings(exposure_s, patience_s)
    at = AlpacaAddress(server, password_variable)
    return AlpacaCamera(at, device, parts.frames(folder, **optics), settings, clock=parts.clock)


def _alpaca_light(
    name: str,
    parts: MakerContext,
    *,
    server: str,
    switch: int,
    device: int = 0,
    password_variable: str = "",
    **panel: float,
) -> AlpacaLight:
    line = AlpacaSwitch(AlpacaAddress(server, password_variable), device, switch)
    return AlpacaLight(line, panel=LampProperties(**panel), clock=parts.clock)


def _alpaca_shutter(
    name: str, parts: MakerContext, *, server: str, switch: int, device: int = 0, password_variable: str = ""
) -> AlpacaShutter:
    line = AlpacaSwitch(AlpacaAddress(server, password_variable), device, switch)
    return AlpacaShutter(line, clock=parts.clock)


def _wit(name: str, parts: MakerContext, *, port: str, baud: int = 115200) -> WitImu:
    return WitImu(parts.wire(name, port, WitParser, baud=baud), clock=parts.clock)


def _fast(name: str, parts: MakerContext, *, port: str, baud: int = 115200, **scale: float) -> FastImu:
    return FastImu(parts.wire(name, port, FastParser, baud=baud), clock=parts.clock, **scale)


def _jrt(name: str, parts: MakerContext, *, port: str, baud: int = 19200) -> JrtRangefinder:
    return JrtRangefinder(parts.wire(name, port, JrtParser, baud=baud), clock=parts.clock)


def _bosch(name: str, parts: MakerContext, *, port: str, baud: int = 115200) -> BoschRangefinder:
    return BoschRangefinder(parts.wire(name, port, BoschParser, baud=baud), clock=parts.clock)


def _dmx(name: str, parts: MakerContext, *, port: str, channels: Sequence[int] = (1,), **panel: float) -> DmxLight:
    return DmxLight(parts.wire(name, port, DmxParser), channels, panel=LampProperties(**panel), clock=parts.clock)


def _artnet(
    name: str, parts: MakerContext, *, host: str, universe: int = 0, channels: Sequence[int] = (1,), **panel: float
) -> ArtNetLight:
    return ArtNetLight(host, channels, universe=universe, panel=LampProperties(**panel), clock=parts.clock)


def _scpi_light(
    name: str, parts: MakerContext, *, port: str, full: float, baud: int = 9600, visa_library: str = "@py",
    warm_up_s: float = 0.0, pwm_hz: float = 0.0, **supply: Any,
) -> ScpiLight:  # fmt: skip
    line = parts.instrument(name, port, baud, visa_library)
    return ScpiLight(line, SupplySettings(full, **supply), panel=LampProperties(warm_up_s, pwm_hz), clock=parts.clock)


def _scpi_probe(
    name: str, parts: MakerContext, *, port: str, baud: int = 9600, visa_library: str = "@py", **queries: Any
) -> ScpiProbe:
    channels = [
        ProbeChannel(one, queries[one], queries.get(f"{one}_uncertainty")) for one in PROBE_UNITS if one in queries
    ]
    return ScpiProbe(parts.instrument(name, port, baud, visa_library), tuple(channels))


def _grbl_light(
    name: str, parts: MakerContext, *, on: str | None = None, port: str | None = None, **panel: float
) -> GrblLight:
    link, own = parts.link(on, name, port)
    return GrblLight(link, panel=LampProperties(**panel), clock=parts.clock, owns_link=own)


MAKERS: dict[str, Callable[..., Device]] = {
    "grbl": _grbl,
    "zaber": _zaber,
    "tmcl_stage": _tmcl_stage,
    "esp301": _polled(Esp301Stage, NewportParser, 921600),
    "smc100": _polled(Smc100Stage, NewportParser, 57600),
    "apt": _polled(AptStage, AptParser, 115200),
    "gcs": _polled(GcsStage, GcsParser, 115200),
    "strig": _strig,
    "strig_shaker": _strig_shaker,
    "strig_watchdog": _strig_watchdog,
    "rts": _rts,
    "relay": _relay,
    "folder": _folder,
    "gphoto": _gphoto,
    "micromanager_stage": _micromanager_stage,
    "micromanager_camera": _micromanager_camera,
    "micromanager_shutter": _micromanager_shutter,
    "genicam": _genicam,
    "alpaca_stage": _alpaca_stage,
    "alpaca_camera": _alpaca_camera,
    "alpaca_light": _alpaca_light,
    "alpaca_shutter": _alpaca_shutter,
    "wit": _wit,
    "fast": _fast,
    "jrt": _jrt,
    "bosch": _bosch,
    "dmx": _dmx,
    "artnet": _artnet,
    "scpi_light": _scpi_light,
    "scpi_probe": _scpi_probe,
    "grbl_light": _grbl_light,
}


def maker_of(driver: str) -> Callable[..., Device]:
    """The maker of a driver's devices. Raises KeyError where there is none of that name."""
    return MAKERS[driver] if driver in MAKERS else added_drivers()[driver].make
