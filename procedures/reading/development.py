"""How the file of a developed picture encodes light."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Array32


@dataclass(frozen=True, eq=False)
class Development:
    """How a picture's file encodes light.

    format : str, "JPEG", "WEBP", "HEIF", "PNG", "TIFF", or "RAW" of files whose mosaic has no planes or that have none
    assumed : bool, whether the curve is neither stated by the operator nor by the file's ICC profile
    bits : int, of a sample: 8 or 16
    coding : float, standard deviation of the error of block coding, as part of white's level; 0 for files without loss
    icc, exif : bytes, profile and metadata of the file; empty where it has none
    """

    format: str
    curve: "ToneCurve"
    assumed: bool
    bits: int
    coding: float = 0.0
    icc: bytes = b""
    exif: bytes = b""

    @property
    def level_error(self) -> float:
        """Standard deviation of the error of a level by rounding and coding, as part of white's."""
        return float(np.hypot((12**-0.5) / ((1 << self.bits) - 1), self.coding))

    def light_error(self, light: npt.NDArray[np.floating]) -> Array32:
        """Standard deviation of the error of light by rounding and coding, white = 1."""
        return np.asarray(self.level_error * self.curve.slope(light), dtype=np.float32)


# --- Error of JPEG's coding, from the file's quantisation tables and the coefficients that survived them ---
# A coefficient that is not rounded to zero is wrong by a twelfth of the step's square, on average. Those that are
# rounded to zero follow a Laplace distribution (Reininger and Gibson 1983), whose width the others show.

BLOCK = 8
LUMINANCE = (0.299, 0.587, 0.114)
MOST_BLOCKS = 20_000


def coding_error(levels: npt.NDArray[np.uint8], steps: Sequence[int]) -> float:
    """Standard deviation of the error of luminance by coding, as part of white's level.

    levels : (H, W, 1 or 3); steps : the 64 of luminance, row by row
    """
    from scipy.fft import dctn

    step = np.asarray(steps, dtype=np.float64).reshape(BLOCK, BLOCK)
    plane = levels @ np.array(LUMINANCE) if levels.shape[2] == 3 else levels[..., 0].astype(np.float64)
    rows, columns = (size // BLOCK * BLOCK for size in plane.shape)
    tiled = plane[:rows, :columns].reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK).swapaxes(1, 2)
    blocks = tiled.reshape(-1, BLOCK, BLOCK)
    blocks = blocks[:: max(1, len(blocks) // MOST_BLOCKS)]
    zero = np.abs(dctn(blocks - 128, axes=(1, 2), norm="ortho")) < step / 2
    share = np.clip(zero.mean(axis=0), 1e-9, 1 - 0.5 / len(blocks))
    # variance within the limits of a Laplace distribution of which this share lies within them
    t = -np.log1p(-share)  # limit over the distribution's scale
    scale = (step / 2) / t
    laplace_variance = np.asarray(scale**2 * (2 - np.exp(-t) * (t**2 + 2 * t + 2)) / share)
    variance = (1 - share) * step**2 / 12 + share * laplace_variance
    return float(np.sqrt(variance.mean()) / 255)  # the transform is orthonormal


# --- Tone curves of picture files: light of an encoded level, by sRGB's transfer function or an ICC profile ---
# References
# ----------
# IEC 61966-2-1:1999 (sRGB); ICC.1:2022, 10.6 (curveType), 10.18 (parametricCurveType).


POINTS = 4096
LINEAR, SRGB, OF_PROFILE = "linear", "srgb", "ICC profile"
_PARAMETERS = {0: 1, 1: 3, 2: 4, 3: 5, 4: 7}  # number of parameters by the type of a parametric curve


@dataclass(frozen=True, eq=False)
class ToneCurve:
    """Light, from 0 to 1, at equidistant levels from 0 to 1; `name` states where it comes from."""

    name: str
    light: Array

    def decoded(self, levels: npt.NDArray[np.floating]) -> Array32:
        """Light of levels, white = 1."""
        if self.name == LINEAR:
            return np.asarray(levels, dtype=np.float32)
        return np.asarray(np.interp(levels, self._levels, self.light), dtype=np.float32)

    def encoded(self, light: npt.NDArray[np.floating]) -> Array32:
        """Levels of light, clipped to 0 and 1."""
        return np.asarray(np.interp(light, self.light, self._levels), dtype=np.float32)

    def slope(self, light: npt.NDArray[np.floating]) -> Array32:
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
    places = _curve_places(profile)
    at = places.get(b"gTRC") or places.get(b"kTRC")
    if at is None:
        return None
    offset, size = struct.unpack_from(">II", profile, at + 4)
    light = _curve(profile[offset : offset + size])
    if not np.isfinite(light).all() or light[0] < 0 or np.any(np.diff(light) < 0) or not light[-1] > 0:
        raise ValueError("its tone curve does not rise")
    return ToneCurve(OF_PROFILE, light / light[-1])


def linear_profile(profile: bytes) -> bytes:
    """An ICC profile with the identity in place of its tone curves."""
    linear = bytearray(profile)
    for at in _curve_places(profile).values():
        (offset,) = struct.unpack_from(">I", profile, at + 4)
        linear[offset : offset + 12] = b"curv" + bytes(8)
        struct.pack_into(">I", linear, at + 8, 12)
    linear[84:100] = bytes(16)  # digest of the former content
    return bytes(linear)


def _curve_places(profile: bytes) -> dict[bytes, int]:
    """Places of the entries of tone curves in a profile's table, by signature."""
    (count,) = struct.unpack_from(">I", profile, 128)
    entries = {profile[at : at + 4]: at for at in range(132, 132 + 12 * min(count, 100), 12)}
    return {name: at for name, at in entries.items() if name[1:] == b"TRC"}


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
