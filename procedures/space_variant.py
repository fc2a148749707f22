"""Space-variant blur and its adjoint: a sum of convolutions of the weighted image."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import oaconvolve

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.psf import extended
from procedures.psf_field import PsfField

CHUNK = 1 << 16
"""Number of samples whose coefficients are predicted at a time."""


@dataclass(frozen=True, eq=False)
class SpaceVariantBlur:
    """Blur of every point of an image by the PSF of its position; zero beyond the image.

    With h(x) = base + sum_c a_c(x) A_c, a point's light u(x) h(x) gives base * u + sum_c A_c * (a_c u). h is the whole
    PSF within the range of its tail's shapes, normalised to sum 1, which is exact where the image is flat.

    samples_per_px : samples of the image per pixel of the plane, 1 to the field's s. Its first sample lies on the first
    pixel.
    """

    field: PsfField
    samples_per_px: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.samples_per_px <= self.field.s:
            raise BadParameter(
                f"the image must have 1 to {self.field.s} samples per pixel; got {self.samples_per_px}",
                f"resample the image, or estimate the PSF with s = {self.samples_per_px}",
            )

    def blur(self, image: Array) -> Array:
        """Blurred image (rows, columns), of the same shape."""
        weight, coefficients = self._maps(np.shape(image))
        image = weight * np.asarray(image, dtype=np.float64)
        out = oaconvolve(image, self._kernels[0], mode="same")
        for kernel, coefficient in zip(self._kernels[1:], coefficients, strict=True):
            out += oaconvolve(coefficient * image, kernel, mode="same")
        return np.asarray(out)

    def blur_adjoint(self, image: Array) -> Array:
        """Adjoint of `blur`: sum v blur(u) = sum u blur_adjoint(v) for all images u, v of one shape."""
        image = np.asarray(image, dtype=np.float64)
        weight, coefficients = self._maps(image.shape)
        out = oaconvolve(image, self._kernels[0][::-1, ::-1], mode="same")
        for kernel, coefficient in zip(self._kernels[1:], coefficients, strict=True):
            out += coefficient * oaconvolve(image, kernel[::-1, ::-1], mode="same")
        return np.asarray(weight * out)

    def product_convolution(self, shape: tuple[int, int]) -> tuple[Array, Array]:
        """Filters (n, K, K) and multipliers (n, rows, columns) for an image of that shape.

        `blur` is the sum over n of each filter's convolution with its multiplier times the image.
        """
        weight, coefficients = self._maps(shape)
        return np.array(self._kernels), weight * np.concatenate([np.ones((1, *shape)), coefficients])

    def at(self, points: Array) -> Array:
        """PSFs (n, K, K) at points (n, 2) of the plane on the image's grid, each of sum 1."""
        coefficients = self.field.coefficients(points)
        psfs = self._kernels[0] + np.tensordot(coefficients, np.array(self._kernels[1:]), axes=1)
        return np.asarray(psfs / psfs.sum(axis=(1, 2), keepdims=True))

    def kernel(self, h: Array) -> Array:
        """Resample a PSF (K, K), K odd, to the image's grid with a low-pass filter; its sum is preserved."""
        ratio, half = self.samples_per_px / self.field.s, len(h) // 2
        if ratio == 1:
            return h
        reach = int(np.ceil(half * ratio)) + 2
        taps = np.sinc(np.arange(-reach, reach + 1)[:, None] - np.arange(-half, half + 1) * ratio)
        taps /= taps.sum(axis=0)
        return np.asarray(taps @ h @ taps.T)

    @cached_property
    def _images(self) -> list[Array]:
        """Base and components, support and tail, (K, K) each."""
        return [extended(p, self.field.k) for p in (self.field.base, *self.field.components)]

    @cached_property
    def _kernels(self) -> list[Array]:
        return [self.kernel(image) for image in self._images]

    def _maps(self, shape: tuple[int, ...]) -> tuple[Array, Array]:
        """Reciprocal of the PSF's sum at every position (rows, columns), and its coefficients (r, rows, columns);
        cached for the last shape."""
        kept: dict[tuple[int, ...], tuple[Array, Array]] = self.__dict__.setdefault("_kept", {})
        if shape not in kept:
            kept.clear()
            rows, columns = shape
            y, x = np.divmod(np.arange(rows * columns), columns)
            points = np.column_stack([x, y]) / self.samples_per_px
            parts = [self.field.coefficients(points[i : i + CHUNK]) for i in range(0, len(points), CHUNK)]
            coefficients = np.concatenate(parts).T.reshape(-1, rows, columns)
            sums = np.array([image.sum() for image in self._images])
            kept[shape] = 1 / (sums[0] + np.tensordot(sums[1:], coefficients, axes=1)), coefficients
        return kept[shape]
