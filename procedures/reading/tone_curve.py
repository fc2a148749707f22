"""Tone curves of picture files: light of an encoded level, by sRGB's transfer function or an ICC profile.

References
----------
IEC 61966-2-1:1999 (sRGB); ICC.1:2022, 10.6 (curveType), 10.18 (parametricCurveType).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

POINTS = 4096
LINEAR, SRGB = "linear", "srgb"
_PARAMETERS = {0: 1, 1: 3, 2: 4, 3: 5, 4: 7}
"""Number of parameters by the type of a parametric curve."""


@dataclass(frozen=True, eq=False)
class ToneCurve:
    """Light, from 0 to 1, at equidistant levels from 0 to 1; `name` states where it comes from."""

    name: str
    light: Array

    def decoded(self, levels: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
        """Light of levels, white = 1."""
        if self.name == LINEAR:
            return np.asarray(levels, dtype=np.float32)
        return np.asarray(np.interp(levels, self._levels, self.light), dtype=np.float32)

    def encoded(self, light: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
        """Levels of light, clipped to 0 and 1."""
        return np.asarray(np.interp(light, self.light, self._levels), dtype=np.float32)

    def slope(self, light: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
        """Change of light per change of level, at the levels of this light."""
        return np.asarray(np.interp(light, self.light, np.gradient(self.light, self._levels)), dtype=np.float32)

    @cached_property
    def _levels(self) -> Array:
        return np.linspace(0, 1, len(self.light))


def named_curve(encoding: str) -> ToneCurve:
    """The curve of "linear" or "srgb"."""
    levels = np.linspace(0, 1, POINTS)
    if encoding == LINEAR:
        return ToneCurve(LINEAR, levels)
    return ToneCurve(SRGB, np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4))


def curve_of_profile(profile: bytes) -> ToneCurve | None:
    """The tone curve of an ICC profile, of its green or grey channel; None for a profile without a matrix and curves.

    Raises ValueError or struct.error for a damaged profile.
    """
    (count,) = struct.unpack_from(">I", profile, 128)
    places = {profile[at : at + 4]: struct.unpack_from(">II", profile, at + 4)
              for at in range(132, 132 + 12 * min(count, 100), 12)}  # fmt: skip
    offset, size = places.get(b"gTRC") or places.get(b"kTRC") or (0, 0)
    if not size:
        return None
    light = _curve(profile[offset : offset + size])
    if not np.isfinite(light).all() or light[0] < 0 or np.any(np.diff(light) < 0) or not light[-1] > 0:
        raise ValueError("its tone curve does not rise")
    return ToneCurve("ICC profile", light / light[-1])


def _curve(data: bytes) -> Array:
    levels = np.linspace(0, 1, POINTS)
    if data[:4] == b"para":
        (kind,) = struct.unpack_from(">H", data, 8)
        values = np.frombuffer(data, ">i4", _PARAMETERS[kind], 12) / 65536
        return _parametric(kind, levels, *(*values, *(0.0,) * (7 - len(values))))
    (count,) = struct.unpack_from(">I", data, 8)
    if count == 0:
        return levels
    if count == 1:
        return np.asarray(levels ** (struct.unpack_from(">H", data, 12)[0] / 256))
    table = np.frombuffer(data, ">u2", count, 12) / 65535
    return np.interp(levels, np.linspace(0, 1, count), table)


def _parametric(
    kind: int, x: Array, g: float, a: float, b: float, c: float, d: float, e: float, f: float
) -> Array:  # fmt: skip
    """ICC.1, table 68: from a level on a power, below it linear or constant."""
    if kind == 0:
        return np.asarray(x**g)
    start = d if kind >= 3 else -b / a
    power = np.maximum(a * x + b, 0) ** g
    if kind in (3, 4):
        return np.where(x >= start, power + e, c * x + f)
    return np.where(x >= start, power + c, c)
