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
from drivers.clock import Clock
from drivers.folder_camera import FolderCamera, Tether
from drivers.frame_files.dng_folder import DngFolder, OpticsMetadata
from drivers.frames import Inspect
from drivers.genicam.camera import GenicamCamera, GenicamSettings
from drivers.gphoto import GphotoCamera
from drivers.grbl import GrblStage
from drivers.grbl_envelope import GrblAxis
from drivers.imu import CableLatency, FastImu, StrigImu, WitImu
from drivers.interfaces import Device, Parser, Shutter
from drivers.light import DmxLight, DmxParser, GrblLight, LampProperties
from drivers.micromanager.camera import MicroManagerCamera
from drivers.micromanager.core import Core
from drivers.micromanager.shutter import MicroManagerShutter
from drivers.micromanager.stage import MicroManagerAxis, MicroManagerStage
from drivers.protocols.grbl import GrblParser
from drivers.protocols.grbl_link import GrblLink
from drivers.protocols.imu import FastParser, WitParser
from drivers.protocols.tmcl import TmclParser
from drivers.protocols.zaber import ZaberParser
from drivers.rangefinder import BoschParser, BoschRangefinder, JrtParser, JrtRangefinder
from drivers.shaker import ShakerAxis, StrigShaker
from drivers.shutter import NullParser, RelayShutter, RtsShutter, StrigParser, StrigShutter
from drivers.tmcl.stage import TmclAxis, TmclStage
from drivers.transport import SerialTransport
from drivers.watchdog import Released, StrigWatchdog
from drivers.wire.transcript import Transcript
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
        log = self.wire_log / f"wire-{name}.txt" if self.wire_log else None
        self.transcripts[name] = transcript = Transcript(file=log)
        return SerialTransport(port, parser, clock=self.clock, transcript=transcript, **options)

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


def _folder(name: str, parts: MakerContext, *, folder: str, shutter: str, **tether: Any) -> FolderCamera:
    box = cast(Shutter, parts.made[shutter])
    return FolderCamera(parts.folder / folder, box, parts.inspect, tether=Tether(**tether), clock=parts.clock)


def _gphoto(
    name: str, parts: MakerContext, *, folder: str, model: str = "", port: str = "", shutter: str | None = None
) -> GphotoCamera:
    box = cast(Shutter, parts.made[shutter]) if shutter else None
    place = parts.folder / folder
    return GphotoCamera(place, parts.inspect, model=model, port=port, shutter=box, clock=parts.clock)


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


def _wit(name: str, parts: MakerContext, *, port: str, baud: int = 115200, **latency: float) -> WitImu:
    return WitImu(parts.wire(name, port, WitParser, baud=baud), clock=parts.clock, latency=_latency(latency))


def _fast(name: str, parts: MakerContext, *, port: str, baud: int = 115200, **options: float) -> FastImu:
    latency, wire = _latency(options), parts.wire(name, port, FastParser, baud=baud)
    return FastImu(wire, clock=parts.clock, latency=latency, **options)


def _latency(options: dict[str, float]) -> CableLatency | None:
    """The measured delay of a cable, taken out of the options; None where it is to be bounded by round trips."""
    latency_s, within_s = options.pop("latency_s", None), options.pop("latency_within_s", 1e-3)
    return None if latency_s is None else CableLatency(latency_s, within_s, "common event")


def _strig_imu(name: str, parts: MakerContext, *, box: str) -> StrigImu:
    return StrigImu(cast(StrigShutter, parts.made[box]), clock=parts.clock)


def _jrt(name: str, parts: MakerContext, *, port: str, baud: int = 19200) -> JrtRangefinder:
    return JrtRangefinder(parts.wire(name, port, JrtParser, baud=baud), clock=parts.clock)


def _bosch(name: str, parts: MakerContext, *, port: str, baud: int = 115200) -> BoschRangefinder:
    return BoschRangefinder(parts.wire(name, port, BoschParser, baud=baud), clock=parts.clock)


def _dmx(name: str, parts: MakerContext, *, port: str, channels: Sequence[int] = (1,), **panel: float) -> DmxLight:
    return DmxLight(parts.wire(name, port, DmxParser), channels, panel=LampProperties(**panel), clock=parts.clock)


def _grbl_light(
    name: str, parts: MakerContext, *, on: str | None = None, port: str | None = None, **panel: float
) -> GrblLight:
    link, own = parts.link(on, name, port)
    return GrblLight(link, panel=LampProperties(**panel), clock=parts.clock, owns_link=own)


MAKERS: dict[str, Callable[..., Device]] = {
    "grbl": _grbl,
    "zaber": _zaber,
    "tmcl_stage": _tmcl_stage,
    "strig": _strig,
    "strig_shaker": _strig_shaker,
    "strig_imu": _strig_imu,
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
    "grbl_light": _grbl_light,
}


def maker_of(driver: str) -> Callable[..., Device]:
    """The maker of a driver's devices. Raises KeyError where there is none of that name."""
    return MAKERS[driver] if driver in MAKERS else added_drivers()[driver].make
