"""Positions of an axis over time: segments of constant acceleration, past and future.

Motion is a function of time: an exposure can later query the camera's path, and the changes of
acceleration determine the excited vibrations.
"""

import math
import threading
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LONG_AGO_S = -1e9
DECAYED = 1e-4  # fraction of a shock below which its vibration is ignored
Shock = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MotionSegment:
    """From `t_s` on: position, velocity, constant acceleration."""

    t_s: float
    position: float
    velocity: float
    acceleration: float

    def at(self, t_s: float) -> tuple[float, float]:
        """Position and velocity at a later time."""
        dt = t_s - self.t_s
        return self.position + dt * (self.velocity + dt * self.acceleration / 2), self.velocity + dt * self.acceleration


class Axis:
    """One axis of the bench in its own unit; at rest until moved."""

    def __init__(self, low: float, high: float, position: float) -> None:
        self.low, self.high = low, high
        self._pieces = [MotionSegment(LONG_AGO_S, position, 0.0, 0.0)]
        self._times = [LONG_AGO_S]
        self._powered = True
        self._lock = threading.Lock()  # moved by a controller, and its motor may be switched off elsewhere

    def _piece(self, t_s: float) -> MotionSegment:
        return self._pieces[max(bisect_right(self._times, t_s) - 1, 0)]

    def positions(self, t_s: Array) -> Array:
        """Positions at (n,) times."""
        return np.array([self.position(t) for t in t_s.tolist()])

    def position(self, t_s: float) -> float:
        return self._piece(t_s).at(t_s)[0]

    def velocity(self, t_s: float) -> float:
        """Velocity in units per second."""
        return self._piece(t_s).at(t_s)[1]

    def acceleration(self, t_s: float) -> float:
        """Acceleration in units per second squared."""
        return self._piece(t_s).acceleration

    def moves(self, t_s: float) -> bool:
        """Whether it is still moving at that time."""
        piece = self._piece(t_s)
        return bool(piece.velocity or piece.acceleration)

    def append(self, t_s: float, position: float, velocity: float, acceleration: float) -> None:
        """Begin this motion at `t_s`, if its motor has current; later segments are discarded."""
        with self._lock:
            if self._powered:
                self._append(MotionSegment(t_s, position, velocity, acceleration))

    def _append(self, piece: MotionSegment) -> None:
        keep = bisect_right(self._times, piece.t_s - 1e-12)
        del self._pieces[keep:], self._times[keep:]
        self._pieces.append(piece)
        self._times.append(piece.t_s)

    def power(self, on: bool, t_s: float) -> None:
        """Switch its motor's current; without, it stops at once and cannot move."""
        with self._lock:
            self._powered = on
            if not on:
                self._append(MotionSegment(t_s, self.position(t_s), 0.0, 0.0))

    def halt(self, t_s: float) -> None:
        """Stop at once, like a motor without current."""
        self.append(t_s, self.position(t_s), 0.0, 0.0)

    def shocks(self, since_s: float = LONG_AGO_S, until_s: float = math.inf) -> list[Shock]:
        """(time, change of velocity, change of acceleration) at each segment boundary in that span."""
        shocks = []
        for i in range(max(bisect_left(self._times, since_s), 1), bisect_right(self._times, until_s)):
            before, after = self._pieces[i - 1], self._pieces[i]
            velocity = before.at(after.t_s)[1]
            shocks.append((after.t_s, after.velocity - velocity, after.acceleration - before.acceleration))
        return shocks

    def extremes(self) -> tuple[float, float]:
        """The lowest and highest position ever planned."""
        ends = [piece.at(t)[0] for piece, t in zip(self._pieces, self._times[1:], strict=False)]
        all_of_them = [piece.position for piece in self._pieces] + ends
        return min(all_of_them), max(all_of_them)


def ramps(length: float, speed: float, acceleration: float) -> list[tuple[float, float]]:
    """(duration, acceleration) of the segments that cover `length` from rest to rest: up, steady, down."""
    top = min(speed, math.sqrt(acceleration * length))
    ramp = top**2 / (2 * acceleration)
    steady = max((length - ramp - ramp) / top, 0.0)
    return [(top / acceleration, acceleration), (steady, 0.0), (top / acceleration, -acceleration)]


def travel_line(axes: Sequence[Axis], target: Sequence[float], t_s: float, speed: float, acceleration: float) -> float:
    """Move the axes together from rest along a straight line; returns the time of arrival."""
    start = [axis.position(t_s) for axis in axes]
    way = [b - a for a, b in zip(start, target, strict=True)]
    length = math.hypot(*way)
    if length == 0.0:
        return t_s
    covered, velocity, now_s = 0.0, 0.0, t_s
    for duration, rate in ramps(length, speed, acceleration):
        for axis, begin, part in zip(axes, start, way, strict=True):
            share = part / length
            axis.append(now_s, begin + share * covered, share * velocity, share * rate)
        covered += duration * (velocity + duration * rate / 2)
        velocity += duration * rate
        now_s += duration
    for axis, end in zip(axes, target, strict=True):
        axis.append(now_s, end, 0.0, 0.0)
    return now_s


def brake_line(axes: Sequence[Axis], t_s: float, acceleration: float) -> float:
    """Decelerate the axes together along their line; returns the time of rest."""
    velocity = [axis.velocity(t_s) for axis in axes]
    start = [axis.position(t_s) for axis in axes]
    speed = math.hypot(*velocity)
    if speed == 0.0:
        for axis in axes:
            axis.halt(t_s)
        return t_s
    stop_s = speed / acceleration
    for axis, begin, rate in zip(axes, start, velocity, strict=True):
        axis.append(t_s, begin, rate, -rate / stop_s)
        axis.append(t_s + stop_s, begin + rate * stop_s / 2, 0.0, 0.0)
    return t_s + stop_s


@dataclass(frozen=True)
class Mode:
    """One damped vibration mode of the bench, excited by an axis: x'' + 2 zeta w x' + w^2 x = -gain * a(t)."""

    axis: str
    frequency_hz: float
    damping: float
    gain: float

    def response(self, shocks: Sequence[Shock], t_s: Array, steady: float = 0.0) -> tuple[Array, Array]:
        """Displacement and acceleration at times `t_s`, in the axis' unit, after (time, dv, da) shocks.

        Steps da of acceleration contribute -gain da/w^2 (1 - e^(-zeta w t)(cos wd t + zeta w/wd sin wd t)); steps dv of
        velocity contribute -gain dv e^(-zeta w t) sin(wd t)/wd. Acceleration as in the equation above; `steady`
        is the acceleration before the first shock, with the mode in equilibrium.
        """
        w = 2 * math.pi * self.frequency_hz
        wd = w * math.sqrt(1 - self.damping**2)
        x, v, a = np.zeros_like(t_s), np.zeros_like(t_s), np.zeros_like(t_s)
        x -= self.gain * steady / w**2
        a -= self.gain * steady
        for moment, dv, da in shocks:
            dt = t_s - moment
            live = dt >= 0
            dt = np.where(live, dt, 0.0)
            decay = np.exp(-self.damping * w * dt) * live
            cos, sin = decay * np.cos(wd * dt), decay * np.sin(wd * dt)
            x -= self.gain * (da / w**2 * (live - cos - self.damping * w / wd * sin) + dv * sin / wd)
            v -= self.gain * (da * sin / wd + dv * (cos - self.damping * w / wd * sin))
            a -= self.gain * da * live
        return x, a - 2 * self.damping * w * v - w**2 * x

    def lasts_s(self) -> float:
        """Seconds until a shock has decayed to `DECAYED`."""
        return -math.log(DECAYED) / (self.damping * 2 * math.pi * self.frequency_hz)
