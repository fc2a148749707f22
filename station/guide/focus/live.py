"""Live focus: sharpness of every new photograph, the trend, the best so far, and which way to turn the ring."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from procedures.outcome import BadInput, BadParameter, Outcome, Verdict
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters
from procedures.pattern_psf.focus.sharpness import QUICK, Sharpness, measure_sharpness
from procedures.pattern_psf.focus.sweep import Peak, TurnDirection, advise_turn, best_focus
from procedures.raw import Plane, default_plane, read_planes
from station.calibration.folder_photographs import photographs_in

if TYPE_CHECKING:
    from procedures.plan import Fact
    from station.bench.opening import Bench

POLL_S, SETTLE_S = 0.05, 0.02
"""Polling interval of a folder, and the shorter one after a new file, which is read once it stops growing."""
UNREADABLE_AFTER_S = 3.0
"""An unreadable file is retried until its size has been constant for so long."""
SWEEP = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
"""Small steps of the simulated focus ring, from the focus set by eye."""
LEFT_BY_EYE: Mapping[str, Fact] = {
    **dict.fromkeys(("printed", "mounted", "lit", "camera_set", "focused"), True),
    "hand_aim": 1.0,
    "hand_exposure_ev": 1.0,
    "hand_chart_yaw_deg": -2.6,
    "hand_chart_pitch_deg": 1.9,
}
"""State in which the operator model leaves the bench: chart in the middle, nearly square, focused by eye."""


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """A new photograph: its plane, or why it cannot be read, and the focus setting where it is known. `arrived_s` is
    the time at which its file was detected, by the source's clock."""

    path: Path
    plane: Outcome[Plane]
    arrived_s: float
    place: float | None = None


@dataclass(frozen=True, eq=False)
class FocusReading:
    """Sharpness of one photograph, and of all so far.

    took_s : from the file's arrival to its sharpness
    scores, uncertainties : MTF50 of all photographs so far, NaN where there is none
    peak : maximum of the sweep, where the settings are known
    say : what to do next
    way : which way to turn the ring
    places : focus settings of all photographs so far, NaN where they are not known
    """

    frame: LiveFrame
    sharpness: Outcome[Sharpness]
    took_s: float
    scores: tuple[float, ...]
    uncertainties: tuple[float, ...]
    peak: Peak | None
    say: str
    way: TurnDirection = TurnDirection.TRY
    places: tuple[float, ...] = ()

    @property
    def number(self) -> int:
        """Number of this photograph, from 1."""
        return len(self.scores)

    @property
    def best(self) -> int | None:
        """Number of the sharpest photograph so far, the first of equal ones."""
        known = [(score, -i) for i, score in enumerate(self.scores, 1) if score == score]
        return -max(known)[1] if known else None


@dataclass
class LiveFocus:
    """Measures successive photographs; the chart is searched for at its last position.

    `equal_steps` : the focus is turned by equal steps, so that the numbers of the photographs are its settings.
    """

    chart: Chart
    parameters: PatternParameters = QUICK
    equal_steps: bool = False
    clock: Callable[[], float] = time.monotonic
    _last: Sharpness | None = None
    _places: list[float] = field(default_factory=list)
    _scores: list[float] = field(default_factory=list)
    _uncertainties: list[float] = field(default_factory=list)

    def measure(self, frame: LiveFrame) -> FocusReading:
        """Measure a photograph, or give the reason why it cannot be measured."""
        plane, near = frame.plane, None if self._last is None else self._last.sighting
        sharpness = (
            plane.of_value(None)
            if plane.value is None
            else measure_sharpness(plane.value, self.chart, self.parameters, near)
        )
        self._last = sharpness.value or self._last
        number = float(len(self._scores) + 1) if self.equal_steps else math.nan
        mtf50 = None if sharpness.value is None else sharpness.value.mtf50
        self._scores.append(math.nan if mtf50 is None else mtf50.value)
        self._uncertainties.append(math.nan if mtf50 is None else mtf50.uncertainty)
        self._places.append(number if frame.place is None else frame.place)
        turn = advise_turn(self._scores, self._uncertainties, self._places)
        return FocusReading(
            frame,
            sharpness,
            self.clock() - frame.arrived_s,
            tuple(self._scores),
            tuple(self._uncertainties),
            best_focus(self._places, self._scores, self._uncertainties),
            turn.say,
            turn.way,
            tuple(self._places),
        )


@dataclass(frozen=True)
class PhotographSource:
    """Source of photographs until `ended` is true.

    `plane` is the plane to measure, None for the default; `clock` gives seconds.
    """

    ended: Callable[[], bool]
    plane: str | None = None
    clock: Callable[[], float] = time.monotonic

    def read(self, path: Path, arrived_s: float, place: float | None = None) -> LiveFrame:
        """A photograph's plane, or the reason why it cannot be read."""
        try:
            name = self.plane or default_plane(path)
            plane = Outcome(read_planes(path, [name])[name])
        except (BadInput, BadParameter) as error:
            return LiveFrame(path, Outcome(None, Verdict.REFUSED, error.reason, error.remedy), arrived_s, place)
        return LiveFrame(path, plane, arrived_s, place)

    def watched(self, folder: Path, pause: Callable[[float], object]) -> Iterator[LiveFrame]:
        """The photographs that arrive in a folder from now on, each once it can be read. Raises BadInput."""
        known, arrived = photographs_in(folder), dict[Path, tuple[int, float]]()
        while not self.ended():
            pause_s = POLL_S
            for path in sorted(photographs_in(folder) - known, key=lambda one: one.stat().st_mtime_ns):
                size, now_s = path.stat().st_size, self.clock()
                if arrived.get(path, (-1, 0.0))[0] != size:
                    arrived[path], pause_s = (size, now_s), SETTLE_S
                    continue
                frame = self.read(path, arrived[path][1])
                if frame.plane.value is not None or now_s - arrived[path][1] > UNREADABLE_AFTER_S:
                    known.add(path)
                    yield frame
            pause(pause_s)

    def tethered(self, bench: Bench) -> Iterator[LiveFrame]:
        """Successive exposures of the bench's camera, without movements. Raises DeviceError."""
        stops = bench.stops
        while not self.ended():
            yield self._exposed(bench, stops)

    def simulated(self, bench: Bench, places: Iterable[float] = SWEEP) -> Iterator[LiveFrame]:
        """The operator model hangs the chart, focuses by eye, and turns the ring to each setting in turn. The stages
        home first and move to the middle of their travel. Raises DeviceError."""
        hands, stops = bench.surroundings.hands, bench.stops
        if hands is None:
            raise BadParameter("turning the ring needs a simulated bench", "use --simulate")
        for name, stage in (("stage", bench.stage), ("head", bench.head)):
            bench.motions.home(name, lambda: bench.check_stops(stops))
            bench.motions.move(name, {axis: (travel.low + travel.high) / 2 for axis, travel in stage.travel().items()})
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
        """An exposure, unless the bench was stopped. Raises DeviceError."""
        bench.check_stops(stops)
        return self.read(bench.camera.expose().path, self.clock(), place)
