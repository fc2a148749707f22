"""The camera body: exposes when its contacts close, then writes a RAW file into a folder.

The renderer gives the contents of the file; this module models its time, its name and its faults.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from simulators.devices.serial_device import SimClock
from simulators.world.clock import EventSource
from simulators.world.world import PathDrive, World

NEVER = float("inf")


@dataclass(frozen=True)
class Opening:
    """One opening of the shutter: begin and duration; its number seeds the frame's noise."""

    begin_s: float
    exposure_s: float
    number: int


@dataclass
class BodySettings:
    """Settings of the body, and its faults.

    `bulb` : the exposure lasts as long as the contact is closed. `pause_s` and `pieces` : the file is written in pieces
    with pauses. `companion` : a JPEG accompanies each RAW. `rename` : the file is first written as `.part`.
    """

    exposure_s: float = 0.02
    bulb: bool = False
    lag_s: float = 0.055
    readout_s: float = 0.4
    pieces: int = 1
    pause_s: float = 0.3
    companion: bool = False
    rename: bool = False
    lose_frames: frozenset[int] = frozenset()
    half_frames: frozenset[int] = frozenset()


@dataclass
class CameraBody(EventSource):
    """A tethered body whose software saves to `folder`. `develop(opening)` gives the bytes of the RAW file.

    In real time, later actions of the body run in timers, so that no wire waits for the rendering; in virtual time they
    are events of the clock. `next_number` is that of the next opening. The numbers of the files continue those in the
    folder.
    """

    world: World
    folder: Path
    develop: Callable[[Opening], bytes]
    clock: SimClock
    settings: BodySettings = field(default_factory=BodySettings)
    openings: list[Opening] = field(default_factory=list)
    next_number: int = 1
    _begun_s: float = NEVER
    _agenda: list[tuple[float, Callable[[], None]]] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def close(self, now_s: float) -> None:
        """Close the contact: after the lag the shutter opens and shakes the bench."""
        self._begun_s = now_s + self.settings.lag_s
        self.world.shake(self._begun_s)
        if not self.settings.bulb:
            self._expose(self._begun_s, self.settings.exposure_s)

    def release(self, now_s: float) -> None:
        """Open the contact, which ends a bulb exposure."""
        if self.settings.bulb and self._begun_s != NEVER:
            self._expose(self._begun_s, max(now_s + self.settings.lag_s - self._begun_s, 0.001))
        self._begun_s = NEVER

    def flash_s(self) -> float | None:
        """Time at which the hot shoe closes: when the shutter is open."""
        return None if self._begun_s == NEVER else self._begun_s

    def _expose(self, begin_s: float, exposure_s: float) -> None:
        opening = Opening(begin_s, exposure_s, self.next_number)
        self.next_number += 1
        self.openings.append(opening)
        count = len(self.openings)
        if count not in self.settings.lose_frames:
            self._plan(begin_s + exposure_s + self.settings.readout_s, lambda: self._save(opening, count))

    def _plan(self, moment_s: float, action: Callable[[], None]) -> None:
        real_s = self.clock.real_s(moment_s)
        if real_s is not None:
            timer = threading.Timer(real_s, action)
            timer.daemon = True
            timer.start()
            return
        with self._lock:
            self._agenda.append((moment_s, action))
            self._agenda.sort(key=lambda entry: entry[0])

    def next_event_s(self) -> float | None:
        with self._lock:
            return self._agenda[0][0] if self._agenda else None

    def wake(self) -> None:
        while (action := self._due(self.clock.now_s())) is not None:
            action()

    def _due(self, now_s: float) -> Callable[[], None] | None:
        with self._lock:
            return self._agenda.pop(0)[1] if self._agenda and self._agenda[0][0] <= now_s else None

    @cached_property
    def _files_before(self) -> int:
        """Number of the last file in the folder at the start."""
        numbers = (path.stem.removeprefix("IMG_") for path in self.folder.glob("IMG_*.*"))
        return max((int(number) for number in numbers if number.isdecimal()), default=0)

    def _save(self, opening: Opening, count: int) -> None:
        data, settings = self.develop(opening), self.settings
        final = self.folder / f"IMG_{self._files_before + count:04d}.DNG"
        path = final.with_suffix(".part") if settings.rename else final
        if count in settings.half_frames:
            data = data[: len(data) // 2]
        if settings.companion:
            final.with_suffix(".JPG").write_bytes(b"\xff\xd8\xff\xe0 a preview \xff\xd9")
        size = -(-len(data) // settings.pieces)
        start_s = self.clock.now_s()
        for i in range(settings.pieces):
            part = data[i * size : (i + 1) * size]
            grow = _append(path, part, final if i == settings.pieces - 1 else path)
            self._plan(start_s + i * settings.pause_s, grow)


def _append(path: Path, part: bytes, final: Path) -> Callable[[], None]:
    def action() -> None:
        with path.open("ab") as file:
            file.write(part)
        if final != path:
            path.rename(final)

    return action


# --- The shaker of the simulated bench: two voice coils that move the camera, driven by the box's channels ---

STROKE_MM = 2.0  # displacement from rest at full deflection, along x and y
REST, DEEPEST = 2048, 2047


class VoiceCoils:
    """Channel 0 moves the camera to the right, channel 1 up."""

    def __init__(self, world: World) -> None:
        self._world = world

    def play(self, points: Sequence[tuple[int, int]], interval_s: float, now_s: float) -> None:
        """Move the camera around these points from now on."""
        ways = zip(*points, strict=True)
        rounds = (
            PathDrive(axis, now_s, interval_s, tuple(STROKE_MM * (step - REST) / DEEPEST for step in way))
            for axis, way in zip(("x_mm", "y_mm"), ways, strict=True)
        )
        self._world.drive(tuple(rounds), now_s)

    def rest(self, now_s: float) -> None:
        """Return to the rest position of the springs."""
        self._world.drive((), now_s)
