"""A shaker on the channels of a STRIG/2 box: it moves the camera along a path while the box's shutter is open.

Path and shot share the box's clock: the phase at which the shutter opened is known to microseconds. The protocol is
in `firmware/STRIG.md`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Annotated, Literal

from drivers.errors import BadConfiguration, Clock, DeviceError, MoveFailed, NoAnswer, OutsideTravel, Rejected
from drivers.interfaces import AxisResponse, Identity, ShakePath
from drivers.making import DriverOptions, MakerContext
from drivers.options import STRIG_BOX, AxisName, axes, device, option, positive
from drivers.shutter import KEEP_ALIVE_S, BoxDevice, StrigShutter

REST, DEEPEST = 2048, 2047  # in steps of a channel (0 to 4095): its rest position, and its amplitude
FEWEST, MOST = 2, 128
SHORTEST_S, LONGEST_S = 0.001, 1.0
ANSWER_S = 0.5


@dataclass(frozen=True)
class ShakerAxis:
    """One channel: its axis' name with the unit, and the amplitude from rest at full deflection.

    `direction` -1: the axis moves down when the channel's value rises. The others are its `AxisResponse`.
    """

    name: AxisName
    channel: Literal[0, 1]
    stroke: Annotated[float, positive("2.0")]
    direction: Literal[1, -1] = 1
    frequency_hz: Annotated[float, positive("80")] | None = None
    damping: Annotated[float, positive("0.5")] = 1.0
    gain: Annotated[float, positive("1")] = 1.0
    within_s: Annotated[float, option("0.0005", least=0)] = 0.0
    gain_uncertainty: Annotated[float, option("0.02", least=0)] = 0.0

    @property
    def response(self) -> AxisResponse:
        return AxisResponse(self.gain, self.frequency_hz, self.damping, self.within_s, self.gain_uncertainty)

    def to_steps(self, offset: float) -> int:
        """The channel's value of an offset."""
        return REST + round(DEEPEST * self.direction * offset / self.stroke)

    def to_unit(self, steps: int) -> float:
        """The offset of a channel's value."""
        return self.direction * (steps - REST) * self.stroke / DEEPEST


class StrigShaker(BoxDevice):
    """A Shaker on a box that a StrigShutter has connected."""

    what, since = "shaker", 2

    def __init__(self, box: StrigShutter, axes: Sequence[ShakerAxis], *, clock: Clock | None = None) -> None:
        super().__init__(box, clock)
        self._axes = tuple(axes)
        self._round_s = 0.0

    def connect(self) -> Identity:
        """Check that the box has channels. Raises BadConfiguration, LineLost, Rejected."""
        identity = super().connect()
        self.stop()
        return identity

    def strokes(self) -> Mapping[str, float]:
        """Amplitude of each axis from rest, in both directions."""
        return {axis.name: axis.stroke for axis in self._axes}

    def start(self, path: ShakePath) -> ShakePath:
        """Play this path; returns it as commanded, in whole steps and microseconds. Raises DeviceError."""
        self._require()
        number, interval_us = self._check(path), round(1e6 * path.interval_s)
        self.stop()
        steps = {axis.channel: [axis.to_steps(v) for v in path.offsets.get(axis.name, (0.0,) * number)]
                 for axis in self._axes}  # fmt: skip
        still = [REST] * number
        self._box.command(f"PATH {number} {interval_us}")
        for i, (x, y) in enumerate(zip(steps.get(0, still), steps.get(1, still), strict=True)):
            self._box.command(f"POINT {i} {x} {y}")
        self._box.motion.clear()
        self._round_s = number * interval_us * 1e-6
        with self._aborted_by_errors():
            self._box.command("SHAKE 1")
            if not self._box.wait(lambda: "SHAKE" in self._box.motion, ANSWER_S):
                raise NoAnswer(f"{self.address} did not report the start of the shaking", "check the cable")
        offsets = {axis.name: tuple(axis.to_unit(v) for v in steps[axis.channel]) for axis in self._axes}
        responses = {axis.name: axis.response for axis in self._axes if axis.response != AxisResponse()}
        return ShakePath(interval_us * 1e-6, offsets, responses)

    def _check(self, path: ShakePath) -> int:
        """The number of points of the path. Raises BadConfiguration, OutsideTravel."""
        strokes, lengths = self.strokes(), {len(values) for values in path.offsets.values()}
        number = max(lengths, default=0)
        if not set(path.offsets) <= set(strokes):
            raise BadConfiguration(
                f"a path of {', '.join(path.offsets)} was requested", f"axes are {', '.join(strokes)}"
            )
        if len(lengths) != 1 or not FEWEST <= number <= MOST:
            reason = f"a path of {' and '.join(map(str, sorted(lengths)))} points was requested"
            raise BadConfiguration(reason, f"give {FEWEST} to {MOST}, the same number for every axis")
        if not SHORTEST_S <= path.interval_s <= LONGEST_S:
            reason = f"points {path.interval_s:g} s apart were requested"
            raise BadConfiguration(reason, f"give an interval from {SHORTEST_S:g} to {LONGEST_S:g} s")
        for name, values in path.offsets.items():
            far = max(map(abs, values)) if all(map(math.isfinite, values)) else math.inf
            if far > strokes[name] * (1 + 1e-9):
                raise OutsideTravel(f"{name} goes {strokes[name]:g} from rest, not {far:g}", "give a smaller path")
        return number

    def began_s(self) -> float:
        """When point 0 was first output, by the clock synchronisation of the last shot. Raises MoveFailed."""
        if "REST" in self._box.motion or "SHAKE" not in self._box.motion:
            raise MoveFailed(f"the shaker at {self.address} stopped too early", "photograph again")
        return self._box.to_host_s(self._box.motion["SHAKE"].t_us)

    def stop(self) -> None:
        """Rest at the end of the round. Raises DeviceError."""
        self._require()
        with self._aborted_by_errors():
            self._box.command("SHAKE 0")
            if "SHAKE" not in self._box.motion or "REST" in self._box.motion:
                return
            deadline_s = self.clock.now_s() + self._round_s + ANSWER_S
            while not self._box.wait(lambda: "REST" in self._box.motion, min(KEEP_ALIVE_S, self._round_s + ANSWER_S)):
                if self.clock.now_s() >= deadline_s:
                    raise NoAnswer(f"{self.address} did not report that its shaker rests", "check the cable")
                self._box.command("SHAKE 0")

    @contextmanager
    def _aborted_by_errors(self) -> Iterator[None]:
        """Context in which an error lets it rest: an order without a reply may have been carried out."""
        try:
            yield
        except Rejected:
            raise
        except BaseException:
            with suppress(DeviceError):
                self._box.abort()
            raise

    def emergency_stop(self) -> None:
        """Rest at once, and open the shutter, which is on the same box."""
        self._box.emergency_stop()


@dataclass(frozen=True, kw_only=True)
class ShakerOptions(DriverOptions):
    """Options of driver "strig_shaker"."""

    box: Annotated[str, device(STRIG_BOX, '"shutter"')]
    axes: Annotated[tuple[ShakerAxis, ...], axes("channel")]

    def make(self, parts: MakerContext) -> StrigShaker:
        return StrigShaker(parts.other(self.box), self.axes, clock=parts.clock)
