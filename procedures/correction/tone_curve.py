"""Error of a corrected picture by a tone curve that is not known: its spread under plausible curves.

Blur acts on light. Samples decoded by another curve differ from blurred light most at edges, where deblurring amplifies
the difference. Some tiles are corrected again under each plausible curve.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from procedures.correction.deconvolve import DeconvolutionTile
from procedures.reading.development import LINEAR, Development, ToneCurve, named_curve

Single = npt.NDArray[np.float32]

POWERS = (2.0 / 2.2, 2.4 / 2.2)
"""Powers of light by which displays and programs differ from sRGB's curve, of gamma 2.2 on average."""
CONTRAST = 0.35
"""Slope at half of white, in excess of 1, of the S-shaped curve by which a mild picture style adds contrast."""

BITS_FOR_THE_EYE = 8


@dataclass(frozen=True)
class CurveError:
    """Root mean square difference of a picture under plausible curves from that under the assumed one, white = 1.

    light : of linear light
    levels : of levels, each picture encoded by the curve by which its samples were decoded
    """

    light: float
    levels: float

    @classmethod
    def of(cls, pictures: Iterable[tuple[ToneCurve, Single]], curve: ToneCurve, assumed: Single) -> "CurveError":
        """The error from pictures of light by their curves, and the one under the assumed curve."""
        each = [(light - assumed, other.encoded(light) - curve.encoded(assumed)) for other, light in pictures]
        return cls(*(float(np.sqrt(np.mean(np.square(parts)))) for parts in zip(*each, strict=True)))


def plausible(development: Development) -> list[ToneCurve]:
    """Curves by which samples may have been encoded instead; samples of 16 bits without a profile may be linear."""
    curve = development.curve
    levels = np.linspace(0, 1, len(curve.light))
    style = levels + CONTRAST / (1 + CONTRAST) * np.sin(2 * np.pi * levels) / (2 * np.pi)  # its inverse
    lights = [*(curve.light**power for power in POWERS), np.interp(style, levels, curve.light)]
    linear = [named_curve(LINEAR)] if development.assumed and development.bits > BITS_FOR_THE_EYE else []
    return [*(ToneCurve(curve.name, light) for light in lights), *linear]


def decoded_again(
    tile: DeconvolutionTile, first: Single, gains: Single, curve: ToneCurve, other: ToneCurve
) -> tuple[DeconvolutionTile, Single]:
    """A tile of balanced samples and its initial picture as if decoded by another curve."""

    def again(light: Single, channel: Sequence[int]) -> Single:
        gain = gains[list(channel), None, None]
        return np.asarray(other.decoded(curve.encoded(light * gain)) / gain, dtype=np.float32)

    gain = gains[list(tile.channel), None, None]
    z = again(tile.z, tile.channel)
    slope = other.slope(z * gain) / np.maximum(curve.slope(tile.z * gain), 1e-6)
    weight = np.where(tile.weight > 0, tile.weight / np.maximum(slope, 1e-3) ** 2, tile.weight).astype(np.float32)
    return replace(tile, z=z, weight=weight), again(first, range(len(first)))
