"""How the file of a developed picture encodes light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.reading.tone_curve import ToneCurve


@dataclass(frozen=True, eq=False)
class Development:
    """How a picture's file encodes light.

    Attributes
    ----------
    format : str
        "JPEG", "WEBP", "HEIF", "PNG", "TIFF", or "RAW" of files whose mosaic has no planes or that have none.
    curve : ToneCurve
    assumed : bool
        Whether the curve is neither stated by the operator nor by the file's ICC profile.
    bits : int
        Of a sample: 8 or 16.
    coding : float
        Standard deviation of the error of block coding, as part of white's level; 0 for files without loss.
    icc, exif : bytes
        Profile and metadata of the file; empty where it has none.
    """

    format: str
    curve: ToneCurve
    assumed: bool
    bits: int
    coding: float = 0.0
    icc: bytes = b""
    exif: bytes = b""

    @property
    def level_error(self) -> float:
        """Standard deviation of the error of a level by rounding and coding, as part of white's."""
        return float(np.hypot((12**-0.5) / ((1 << self.bits) - 1), self.coding))

    def light_error(self, light: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
        """Standard deviation of the error of light by rounding and coding, white = 1."""
        return np.asarray(self.level_error * self.curve.slope(light), dtype=np.float32)
