"""Live focus: every photograph that comes gives its sharpness, the trend, the best so far, and which way to turn."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.frames import RAW_SUFFIXES
from procedures.outcome import BadInput, BadParameter, Outcome, Verdict
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters
from procedures.pattern_psf.focus.sharpness import QUICK, Sharpness, measure_sharpness
from procedures.pattern_psf.focus.sweep import Peak, TurnDirection, advise_turn, best_focus
from procedures.raw import Plane, default_plane, read_planes

if TYPE_CHECKING:
    from procedures.plan import Fact
    from station.bench.opening import Bench

SUFFIXES = RAW_SUFFIXES | {".tif", ".tiff", ".png", ".pgm"}
POLL_S, SETTLE_S = 0.05, 0.02
"""How often a folder is looked at, and how soon again where something has come: what still grows is not read yet."""
GROWN_S = 3.0
"""A file that cannot be read is tried again until its size has rested so long."""
SWEEP = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
"""Small steps of the simulated focus ring, from where the eye put it."""
LEFT_BY_EYE: Mapping[str, Fact] = {
    **dict.fromkeys(("printed", "mounted", "lit", "camera_set", "focused"), True),
    "hand_aim": 1.0,
    "hand_exposure_ev": 1.0,
    "hand_chart_yaw_deg": -2.6,
    "hand_chart_pitch_deg": 1.9,
}
"""How the simulated person leaves the bench, whatever was done on it before: the chart in the middle, nearly square,
and focused by eye."""


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A photograph as it came: its plane, or why it cannot be read; the setting of the focus where it is known.

    `arrived_s` is when its file was there, by the clock of whoever saw it.
    """

    path: Path
    plane: Outcome[Plane]
    arrived_s: float
    place: float | None = None


@dataclass(frozen=True, eq=False)
class FocusSeen:
    """What one photograph told, and all of them so far.

    Attributes
    ----------
    frame : LiveFrame
    found : Outcome[Sharpness]
    took_s : from the file's arrival to its number
    scores, uncertainties : MTF50 of all photographs so far, NaN where none could be told
    peak : top of the sweep, where its settings are known
    say : what to do next
    way : which way to turn the ring
    places : settings of the focus of all photographs so far, NaN where they are not known
    """

    frame: LiveFrame
    found: Outcome[Sharpness]
    took_s: float
    scores: tuple[float, ...]
    uncertainties: tuple[float, ...]
    peak: Peak | None
    say: str
    way: TurnDirection = TurnDirection.TRY
    places: tuple[float, ...] = ()

    @property
    def number(self) -> int:
        """Of this photograph, from 1."""
        return len(self.scores)

    @property
    def best(self) -> int | None:
        """Number of the sharpest so far, of equal ones the first."""
        known = [(score, -i) for i, score in enumerate(self.scores, 1) if score == score]
        return -max(known)[1] if known else None


@dataclass
class LiveFocus:
    """Measures one photograph after the other; the chart is looked for where it was seen last.

    `equal_steps`: the focus is turned by one equal step from frame to frame, so that their numbers are its settings.
    """

    chart: Chart
    parameters: PatternParameters = QUICK
    equal_steps: bool = False
    clock: Callable[[], float] = time.monotonic
    _last: Sharpness | None = None
    _places: list[float] = field(default_factory=list)
    _scores: list[float] = field(default_factory=list)
    _uncertainties: list[float] = field(default_factory=list)

    def see(self, frame: LiveFrame) -> FocusSeen:
        """Measure a photograph; one that cannot be read or measured says why."""
        found = self._measure(frame.plane)
        self._last = found.value or self._last
        self._note(frame, found)
        turn = advise_turn(self._scores, self._uncertainties, self._places)
        return FocusSeen(
            frame,
            found,
            self.clock() - frame.arrived_s,
            tuple(self._scores),
            tuple(self._uncertainties),
            best_focus(self._places, self._scores, self._uncertainties),
            turn.say,
            turn.way,
            tuple(self._places),
        )

    def _measure(self, plane: Outcome[Plane]) -> Outcome[Sharpness]:
        if plane.value is None:
            return plane.of_value(None)
        near = None if self._last is None else self._last.sighting
        return measure_sharpness(plane.value, self.chart, self.parameters, near)

    def _note(self, frame: LiveFrame, found: Outcome[Sharpness]) -> None:
        number = float(len(self._scores) + 1) if self.equal_steps else math.nan
        mtf50 = None if found.value is None else found.value.mtf50
        self._scores.append(math.nan if mtf50 is None else mtf50.value)
        self._uncertainties.append(math.nan if mtf50 is None else mtf50.uncertainty)
        self._places.append(number if frame.place is None else frame.place)


# --- where photographs come from ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class PhotographSource:
    """Where photographs come from, until `ended` says that no more are wanted.

    `plane` is the plane to look at, None for the usual one; `clock` tells seconds.
    """

    ended: Callable[[], bool]
    plane: str | None = None
    clock: Callable[[], float] = time.monotonic

    def read(self, path: Path, arrived_s: float, place: float | None = None) -> LiveFrame:
        """A photograph's plane, or why there is none."""
        try:
            name = self.plane or default_plane(path)
            plane = Outcome(read_planes(path, [name])[name])
        except (BadInput, BadParameter) as error:
            return LiveFrame(path, Outcome(None, Verdict.REFUSED, error.reason, error.remedy), arrived_s, place)
        return LiveFrame(path, plane, arrived_s, place)

    def watched(self, folder: Path, pause: Callable[[float], object]) -> Iterator[LiveFrame]:
        """The photographs that arrive in a folder from now on, each as soon as it can be read. Raises BadInput."""
        known, arrived = _photographs(folder), dict[Path, tuple[int, float]]()
        while not self.ended():
            pause_s = POLL_S
            for path in sorted(_photographs(folder) - known, key=lambda one: one.stat().st_mtime_ns):
                size, now_s = path.stat().st_size, self.clock()
                if arrived.get(path, (-1, 0.0))[0] != size:
                    arrived[path], pause_s = (size, now_s), SETTLE_S
                    continue
                frame = self.read(path, arrived[path][1])
                if frame.plane.value is not None or now_s - arrived[path][1] > GROWN_S:
                    known.add(path)
                    yield frame
            pause(pause_s)

    def tethered(self, bench: Bench) -> Iterator[LiveFrame]:
        """One exposure of the bench's camera after the other; nothing is moved. Raises DeviceError."""
        stops = bench.stops
        while not self.ended():
            yield self._exposed(bench, stops)

    def simulated(self, bench: Bench, places: Iterable[float] = SWEEP) -> Iterator[LiveFrame]:
        """A simulated person hangs the chart, focuses by eye, and turns the ring to one place after the other.

        The stages home first, and go to the middle of their travel. Raises DeviceError.
        """
        hands, stops = bench.surroundings.hands, bench.stops
        if hands is None:
            raise BadParameter("only a simulated bench has hands that turn the ring", "use --simulate")
        for name, stage in (("stage", bench.stage), ("head", bench.head)):
            bench.motions.home(name, lambda: bench.check_stops(stops))
            bench.motions.move(name, {axis: (one.low + one.high) / 2 for axis, one in stage.travel().items()})
        bench.light.set_level(1.0)
        bench.surroundings.stand_before("chart")
        hands.take_up(LEFT_BY_EYE)
        at = 0.0
        for place in places:
            if self.ended():
                return
            hands.follow({"focus_steps": place - at})
            at = place
            yield self._exposed(bench, stops, place)

    def _exposed(self, bench: Bench, stops: int, place: float | None = None) -> LiveFrame:
        """An exposure, unless everything was stopped. Raises DeviceError."""
        bench.check_stops(stops)
        return self.read(bench.camera.expose().path, self.clock(), place)


def _photographs(folder: Path) -> set[Path]:
    """Those in a folder. Raises BadInput where there is none."""
    if not folder.is_dir():
        raise BadInput(f"there is no folder {folder}", "create it, or name another one")
    return {p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith((".", "~"))}
