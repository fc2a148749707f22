"""Error of a corrected picture by a tone curve that is not known: its spread under plausible curves.

Blur acts on light. Samples decoded by another curve differ from blurred light most at edges, where deblurring amplifies
the difference. Some tiles are corrected again under each plausible curve.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from procedures.correction.deconvolve import DeconvolutionTile
from procedures.reading.development import LINEAR, Development, ToneCurve, named_curve

Single = npt.NDArray[np.float32]

POWERS = (2.0 / 2.2, 2.4 / 2.2)
"""Powers of light by which displays and programs differ from sRGB's curve, of gamma 2.2 on average."""
CONTRAST = 0.35
"""Slope at half of white, in excess of 1, of the S-shaped curve by which a picture style adds contrast."""


class CurveError(NamedTuple):
    """Root mean square difference of a picture under plausible curves from that under the assumed one, white = 1: of
    linear light, and of levels, each picture encoded by the curve by which its samples were decoded."""

    light: float
    levels: float


def curve_unknown(development: Development) -> bool:
    """Whether nobody states the curve, or the file is coded in blocks: for the eye, with a style on top of it."""
    return development.curve.name != LINEAR and (development.assumed or development.coding > 0)


def plausible(development: Development) -> list[ToneCurve]:
    """Curves by which samples may have been encoded instead; samples of 16 bits without a profile may be linear."""
    curve = development.curve
    levels = np.linspace(0, 1, len(curve.light))
    style = levels + CONTRAST / (1 + CONTRAST) * np.sin(2 * np.pi * levels) / (2 * np.pi)  # its inverse
    lights = [*(curve.light**power for power in POWERS), np.interp(style, levels, curve.light)]
    linear = [named_curve(LINEAR)] if development.assumed and development.bits > 8 else []
    return [*(ToneCurve(curve.name, light) for light in lights), *linear]


def decoded_again(
    tile: DeconvolutionTile, first: Single, gains: Single, curve: ToneCurve, other: ToneCurve
) -> tuple[DeconvolutionTile, Single]:
    """A developed picture's tile (C, n, n), divided by `gains`, and its initial picture as if decoded by another
    curve."""
    gain = gains[:, None, None]
    z, begin = (other.decoded(curve.encoded(light * gain)) / gain for light in (tile.z, first))
    slope = np.maximum(other.slope(z * gain) / np.maximum(curve.slope(tile.z * gain), 1e-6), 1e-3)
    weight = np.where(tile.weight > 0, tile.weight / slope**2, tile.weight)
    return replace(tile, z=z, weight=weight), begin
