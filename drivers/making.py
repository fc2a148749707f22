"""How a driver is made from its table in station.toml: one options model beside each driver, and the context.

```python
@dataclass(frozen=True, kw_only=True)
class JrtOptions(LineOptions):          # port, baud
    baud: Baud = 19200

    def make(self, parts: MakerContext) -> JrtRangefinder:
        return JrtRangefinder(parts.wire(self.port, JrtParser, baud=self.baud), clock=parts.clock)
```
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

from drivers.dng import DngFolder, OpticsMetadata
from drivers.errors import Clock
from drivers.frames import Inspect
from drivers.interfaces import Device, Parser
from drivers.options import GRBL_STAGE, Baud, FolderName, Port, device
from drivers.protocols.grbl import GrblParser
from drivers.protocols.grbl_link import GrblLink
from drivers.transport import SerialTransport
from drivers.wire.connection import Transcript


@dataclass(frozen=True)
class MakerContext:
    """Context in which a device is made: its name, the devices made before, folders, clock, RAW file reader.

    Every line has a transcript in `transcripts`; `shared` holds what several devices use.
    """

    name: str
    made: Mapping[str, Device]
    folder: Path
    clock: Clock
    inspect: Inspect
    wire_log: Path | None = None
    transcripts: dict[str, Transcript] = field(default_factory=dict)
    shared: dict[object, Any] = field(default_factory=dict)

    def wire(self, port: str, parser: Callable[[], Parser[Any]], **options: Any) -> SerialTransport[Any]:
        """The line to a device, with its transcript."""
        return SerialTransport(port, parser, clock=self.clock, transcript=self.transcript(), **options)

    def transcript(self) -> Transcript:
        """The transcript of the device's line."""
        log = self.wire_log / f"wire-{self.name}.txt" if self.wire_log else None
        self.transcripts[self.name] = Transcript(file=log)
        return self.transcripts[self.name]

    def other(self, name: str) -> Any:
        """A device made before."""
        return self.made[name]


@dataclass(frozen=True, kw_only=True)
class DriverOptions:
    """Options of a driver, checked by their annotations.

    provides : kinds of device that others may name it as
    twin : makes its simulation for `station conform`, see `station.bench.conform.Twin`
    """

    provides: ClassVar[tuple[str, ...]] = ()
    twin: ClassVar[Callable[[], Any] | None] = None

    def make(self, parts: MakerContext) -> Device:
        raise NotImplementedError

    def problem(self) -> tuple[str, str] | None:
        """Reason and remedy if the values are inconsistent."""
        return None


@dataclass(frozen=True, kw_only=True)
class LineOptions(DriverOptions):
    """A serial line.

    The device is `makes(line, axes, clock=..., poll_s=..., ...)`: axes if it has some, and each further option by its
    name; `parser` reads the line.
    """

    makes: ClassVar[Callable[..., Device]]
    parser: ClassVar[Callable[[], Parser[Any]]]
    port: Port
    baud: Baud = 115200

    def make(self, parts: MakerContext) -> Device:
        options = {one.name: getattr(self, one.name) for one in fields(self)}
        line = parts.wire(options.pop("port"), type(self).parser, baud=options.pop("baud"))
        axes = [options.pop("axes")] if "axes" in options else []
        return type(self).makes(line, *axes, clock=parts.clock, **options)


@dataclass(frozen=True, kw_only=True)
class OutputOptions(DriverOptions):
    """An output of a GRBL controller: of a stage, or a controller of its own."""

    on: Annotated[str, device(GRBL_STAGE)] | None = None
    port: Port | None = None

    def problem(self) -> tuple[str, str] | None:
        if self.on is None and self.port is None:
            return "has neither port nor on", 'write on = "stage", or a port'
        if self.on is not None and self.port is not None:
            return "has both port and on", "keep on for an output of a stage's controller, port for one of its own"
        return None

    def link(self, parts: MakerContext) -> tuple[GrblLink, bool]:
        """The controller, and whether it is a separate one."""
        if self.on is None:
            return GrblLink(parts.wire(str(self.port), GrblParser)), True
        return parts.other(self.on).link, False


@dataclass(frozen=True, kw_only=True)
class FrameOptions(DriverOptions, OpticsMetadata):
    """A camera without files: the folder for its frames, and the optics' data for them."""

    folder: FolderName

    def frames(self, parts: MakerContext) -> DngFolder:
        return DngFolder(parts.folder / self.folder, parts.inspect, self, clock=parts.clock)
