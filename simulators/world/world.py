"""One world for all simulated devices: camera position, vibration, temperature, and light.

Everything is a function of time, so devices may be queried in any order: the stage moves the axes, moves excite the
modes, rangefinder and camera observe the pose, the IMU its derivatives.
"""

import math
import threading
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from simulators.world.motion import Axis, Mode, Shock

Array = NDArray[np.float64]
GRAVITY_M_S2 = 9.80665
UNIT = np.array([1.0, -1.0, -1.0])
"""Rotation between a picture's axes, y down and z ahead, and an inertial unit's, y up and z back."""


@dataclass(frozen=True)
class CameraPoses:
    """The camera's pose relative to the chart at (n,) times, thermal drift and vibration included.

    x right, y up, z away from the chart from its plane; pan and tilt as yaw and pitch of the optical axis, to the right
    and up; roll about it, clockwise as seen by the camera.
    """

    x_mm: Array
    y_mm: Array
    z_mm: Array
    pan_deg: Array
    tilt_deg: Array
    roll_deg: Array

    @property
    def turn(self) -> Rotation:
        """Rotation of the camera's x right, y down and z ahead relative to a camera facing the chart squarely."""
        return Rotation.from_euler("YXZ", np.column_stack([self.pan_deg, self.tilt_deg, self.roll_deg]), degrees=True)


@dataclass(frozen=True)
class SinusoidalDrive:
    """Sinusoidal motion of an axis by a shaker: amplitude cos(2 pi frequency t + phase), in the axis' unit."""

    axis: str
    amplitude: float
    frequency_hz: float
    phase: float = 0.0

    def response(self, t_s: Array) -> tuple[Array, Array]:
        """Displacement and acceleration at (n,) times."""
        w = 2 * math.pi * self.frequency_hz
        x = self.amplitude * np.cos(w * t_s + self.phase)
        return x, -w * w * x


@dataclass(frozen=True)
class PathDrive:
    """Periodic motion of an axis along a path by a shaker: points in its unit, `interval_s` apart.

    Between the points it follows a periodic cubic spline.
    """

    axis: str
    began_s: float
    interval_s: float
    points: tuple[float, ...]

    @cached_property
    def _spline(self) -> CubicSpline:
        times = self.interval_s * np.arange(len(self.points) + 1)
        return CubicSpline(times, [*self.points, self.points[0]], bc_type="periodic")

    def response(self, t_s: Array) -> tuple[Array, Array]:
        """Displacement and acceleration at (n,) times."""
        since = t_s - self.began_s
        return np.asarray(self._spline(since)), np.asarray(self._spline(since, 2))


@dataclass(frozen=True)
class WorldParameters:
    """Properties of the world: geometry, temperature, vibration."""

    near_mm: float = 800.0  # from the chart to the camera at z_mm = 0
    travel: Mapping[str, tuple[float, float]] = field(
        default_factory=lambda: {
            "x_mm": (0.0, 300.0),
            "y_mm": (0.0, 200.0),
            "z_mm": (0.0, 1500.0),
            "pan_deg": (-30.0, 30.0),
            "tilt_deg": (-20.0, 20.0),
        }
    )
    modes: tuple[Mode, ...] = (
        Mode("x_mm", 11.0, 0.04, 0.3),
        Mode("y_mm", 14.0, 0.05, 0.3),
        Mode("z_mm", 17.0, 0.04, 0.3),
        Mode("pan_deg", 9.0, 0.05, 0.2),
        Mode("tilt_deg", 10.0, 0.05, 0.2),
        Mode("shock_mm", 55.0, 0.06, 1.0),
    )
    arm_mm: float = 400.0  # sway of the head turns the camera by displacement / arm
    ambient_c: float = 21.0
    warming_c: float = 3.0
    warming_s: float = 1800.0
    swing_c: float = 0.3
    swing_period_s: float = 600.0
    expansion_per_c: float = 23e-6  # an aluminium rail
    shock_mm_s: float = 2.0  # what the shutter's opening gives the body
    lamp_warm_up: float = 0.05
    lamp_warm_up_s: float = 120.0


class World:
    """Ground truth as a function of the bench's clock, in seconds."""

    def __init__(self, room: WorldParameters | None = None) -> None:
        self.room = room or WorldParameters()
        middle = {name: (low + high) / 2 for name, (low, high) in self.room.travel.items()}
        self.axes = {name: Axis(low, high, middle[name]) for name, (low, high) in self.room.travel.items()}
        self._kicks: list[Shock] = []
        self._lamp_s, self._lamp = [-math.inf], [1.0]
        self._driven: list[tuple[float, tuple[SinusoidalDrive | PathDrive, ...]]] = [(-math.inf, ())]
        self._lock = threading.Lock()

    def temperature_c(self, t_s: float) -> float:
        """Room temperature: warms up and oscillates with the air conditioning."""
        room = self.room
        warming = room.warming_c * (1 - math.exp(-t_s / room.warming_s))
        return room.ambient_c + warming + room.swing_c * math.sin(2 * math.pi * t_s / room.swing_period_s)

    def set_lamp(self, level: float, now_s: float) -> None:
        with self._lock:
            self._lamp_s.append(max(now_s, self._lamp_s[-1]))
            self._lamp.append(level)

    def lamp(self, t_s: float) -> float:
        """Illumination of the chart relative to full; a lamp that was just switched is slightly brighter."""
        at = max(bisect_right(self._lamp_s, t_s) - 1, 0)
        since_s = t_s - self._lamp_s[at]
        return self._lamp[at] * (1 + self.room.lamp_warm_up * math.exp(-since_s / self.room.lamp_warm_up_s))

    def shake(self, now_s: float) -> None:
        """Excite the body by the shutter's mechanism."""
        with self._lock:
            self._kicks.append((now_s, self.room.shock_mm_s, 0.0))

    def drive(self, drives: tuple[SinusoidalDrive | PathDrive, ...], now_s: float) -> None:
        """Move the camera by a shaker from now on; no drives stop it."""
        with self._lock:
            self._driven.append((now_s, drives))

    def _shocks(self, name: str, since_s: float, until_s: float) -> tuple[list[Shock], float]:
        """Shocks of an axis in that span, and the steady acceleration before it."""
        if name == "shock_mm":
            return [shock for shock in self._kicks if since_s <= shock[0] <= until_s], 0.0
        axis = self.axes[name]
        return axis.shocks(since_s, until_s), axis.acceleration(since_s)

    def sway(self, t_s: Array) -> dict[str, tuple[Array, Array]]:
        """Displacement and acceleration of each vibrating axis, per (n,) times, in its unit."""
        moved = {name: (np.zeros_like(t_s), np.zeros_like(t_s)) for name in (*self.axes, "shock_mm", "roll_deg")}
        first_s, last_s = float(t_s.min()), float(t_s.max())
        for mode in self.room.modes:
            shocks, steady = self._shocks(mode.axis, first_s - mode.lasts_s(), last_s)
            if shocks or steady:
                x, a = mode.response(shocks, t_s, steady)
                moved[mode.axis] = (moved[mode.axis][0] + x, moved[mode.axis][1] + a)
        ends = [since for since, _ in self._driven[1:]] + [math.inf]
        for (since, drives), until in zip(self._driven, ends, strict=True):
            live = (t_s >= since) & (t_s < until)
            for drive in drives if live.any() else ():
                x, a = drive.response(t_s)
                moved[drive.axis] = (moved[drive.axis][0] + live * x, moved[drive.axis][1] + live * a)
        return moved

    def pose(self, t_s: Array) -> CameraPoses:
        """The camera's pose at (n,) times."""
        return self._pose(t_s, {name: x for name, (x, _) in self.sway(t_s).items()})

    def _pose(self, t_s: Array, sway: Mapping[str, Array]) -> CameraPoses:
        place = {name: axis.positions(t_s) for name, axis in self.axes.items()}
        warm = np.array([self.temperature_c(t) for t in t_s.tolist()]) - self.room.ambient_c
        turned = np.degrees(1.0 / self.room.arm_mm)
        return CameraPoses(
            x_mm=place["x_mm"] + sway["x_mm"],
            y_mm=place["y_mm"] + sway["y_mm"] + sway["shock_mm"],
            z_mm=self.room.near_mm + place["z_mm"] * (1 + self.room.expansion_per_c * warm) + sway["z_mm"],
            pan_deg=place["pan_deg"] + sway["pan_deg"] + turned * sway["x_mm"],
            tilt_deg=place["tilt_deg"] + sway["tilt_deg"] + turned * (sway["y_mm"] + sway["shock_mm"]),
            roll_deg=sway["roll_deg"],
        )

    def distance_mm(self, t_s: float) -> float:
        """Distance from the camera's principal plane to the chart."""
        return float(self.pose(np.array([t_s])).z_mm[0])

    def ideal_imu(self, t_s: Array) -> tuple[Array, Array]:
        """Readings of an ideal IMU on the camera: (n, 3) specific force in m/s^2, (n, 3) rotation rate in rad/s.

        Its x is the camera's to the right, its y up, its z back.
        """
        n, h = t_s.size, 2e-4
        moments = np.concatenate([t_s, t_s - h, t_s + h])
        sway = self.sway(moments)
        force = np.zeros((n, 3))
        for column, name in enumerate(("x_mm", "y_mm", "z_mm")):
            driven = np.array([self.axes[name].acceleration(t) for t in t_s.tolist()])
            force[:, column] = (driven + sway[name][1][:n]) / 1000
        force[:, 1] += sway["shock_mm"][1][:n] / 1000 + GRAVITY_M_S2
        turn = self._pose(moments, {name: x for name, (x, _) in sway.items()}).turn
        rate = (turn[n : 2 * n].inv() * turn[2 * n :]).as_rotvec() / (2 * h)
        return turn[:n].inv().apply(force * UNIT) * UNIT, rate * UNIT
