"""A small analytic lens, a scene, and simulated photographs of it; the method is given only the lens's PSFs.

The transfer function at a position is a tilted Gaussian with some coma (an odd phase) times a pixel's aperture. The
blur is applied point by point over a fine grid of positions, by its own transforms.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from procedures.field.interpolate import Interpolation, interpolate
from procedures.psf import Psf
from procedures.psf_field import Node
from procedures.raw import Exposure, Plane, RawFrame

from .lens_photographs import RGGB, Sensor, blurred, kernels_over

Array = np.ndarray
S, K = 4, 17
PERIOD = 40
RIM = 24


@dataclass(frozen=True)
class SmallLens:
    """A lens over a plane of given shape: sigma in pixels of the plane at the centre, and its growth outwards."""

    shape: tuple[int, int]
    sigma_px: float = 0.45
    growth: float = 0.9
    coma: float = 0.12
    shift_px: float = 0.0
    """Magnification error relative to the reference, in pixels of the plane at half the frame's diagonal, outwards."""

    def otf(self, x: float, y: float, fx: Array, fy: Array) -> Array:
        """Transfer function at frequencies in cycles per pixel of the plane."""
        rows, columns = self.shape
        u = np.array([x - (columns - 1) / 2, y - (rows - 1) / 2]) / (np.hypot(rows, columns) / 2)
        radius = np.hypot(*u)
        along = (u / radius if radius > 0 else np.array([1.0, 0.0])) @ np.stack([fx.ravel(), fy.ravel()])
        f2 = (fx**2 + fy**2).ravel()
        radial, across = self.sigma_px * (1 + self.growth * radius**2), self.sigma_px
        blur = np.exp(-2 * np.pi**2 * (radial**2 * along**2 + across**2 * (f2 - along**2)))
        odd = np.exp(-2j * np.pi * self.coma * radius * along * 4 * np.minimum(f2, 1.0))
        odd = odd * np.exp(-2j * np.pi * self.shift_px * radius * along)
        return (blur * odd).reshape(fx.shape) * np.sinc(fx * 0.7) * np.sinc(fy * 0.7)

    def kernel(self, x: float, y: float, per_px: int) -> Array:
        """The PSF sampled `per_px` times per pixel; odd size, centre in the middle."""
        n = PERIOD * per_px
        f = np.fft.fftfreq(n) * per_px
        h = np.fft.fftshift(np.fft.ifft2(self.otf(x, y, *np.meshgrid(f, f))).real)
        return h[1:, 1:]

    def node(self, x: float, y: float, noise: float, rng: np.random.Generator, number: int) -> Node:
        """The PSF's support as measured from a chart there, with noise of its samples."""
        whole = self.kernel(x, y, S)
        low = len(whole) // 2 - K // 2
        h = whole[low : low + K, low : low + K] + noise * rng.standard_normal((K, K))
        at = np.array([x, y])
        return Node(
            at, np.eye(2) * 1e-6, at, Psf(h / h.sum(), S, np.eye(K * K) * max(noise, 1e-7) ** 2), "lens", number
        )

    def field(self, name: str, noise: float = 1e-6, seed: int = 11) -> Interpolation:
        """The PSF field measured at 5 x 4 positions."""
        rng = np.random.default_rng(seed)
        rows, columns = self.shape
        places = [(x, y) for y in np.linspace(0, rows - 1, 4) for x in np.linspace(0, columns - 1, 5)]
        unshifted = SmallLens(self.shape, self.sigma_px, self.growth, self.coma)
        nodes = [unshifted.node(x, y, noise, rng, i) for i, (x, y) in enumerate(places)]
        return interpolate(name, self.shape, nodes)


def scene(shape: tuple[int, int], seed: int = 1, channels: int = 1) -> Array:
    """Light of things with edges, fine lines and shades (C, H, W), 0.05 to 0.8; band-limited to the pixels."""
    rng = np.random.default_rng(seed)
    shapes = [np.sign(gaussian_filter(rng.standard_normal(shape), s)) for s in (12, 7, 4)]
    shades = gaussian_filter(rng.standard_normal(shape), 9)
    lines = np.abs(gaussian_filter(rng.standard_normal(shape), 3)) < 0.008
    light = 0.4 + 0.14 * shapes[0] + 0.07 * shapes[1] + 0.04 * shapes[2] + 0.05 * shades / shades.std() - 0.1 * lines
    tints = (
        np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]) if channels == 1 else np.array([[0.5, 0.1], [0, 0], [-0.2, 0.4]])
    )
    patches = np.stack([np.sign(gaussian_filter(rng.standard_normal(shape), s)) for s in (10, 6)])
    colours = [light * np.exp(0.5 * np.tensordot(tints[c], patches, axes=1)) for c in range(channels)]
    return np.stack([np.clip(gaussian_filter(one, 0.5), 0.05, 0.8) for one in colours])


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph, the truth (C, H, W) on the sensor's grid, and the light before the sensor's noise."""

    frame: RawFrame
    truth: Array
    light: Mapping[str, Array] = field(default_factory=dict)

    def psnr(self, picture: Array, rim: int = 0) -> float:
        """PSNR of a picture (C, H, W) relative to the truth, white = 1."""
        inside = (..., slice(rim, picture.shape[-2] - rim), slice(rim, picture.shape[-1] - rim))
        return float(-10 * np.log10(np.mean((picture - self.truth)[inside] ** 2)))


def shifted(light: Array, dx: float, dy: float) -> Array:
    """The light (H, W) shifted by (dx, dy) pixels, also by fractions; periodic."""
    fy, fx = np.fft.fftfreq(light.shape[0])[:, None], np.fft.rfftfreq(light.shape[1])
    return np.fft.irfft2(np.fft.rfft2(light) * np.exp(-2j * np.pi * (fx * dx + fy * dy)), light.shape)


def rotated(light: Array, degrees: float, zoom: float) -> Array:
    """The light (H, W) rotated about its centre and scaled."""
    matrix = cv2.getRotationMatrix2D(((light.shape[1] - 1) / 2, (light.shape[0] - 1) / 2), degrees, zoom)
    how = {"flags": cv2.INTER_LANCZOS4, "borderMode": cv2.BORDER_REFLECT}
    return np.asarray(cv2.warpAffine(light, matrix, light.shape[::-1], **how))


NOTED = Exposure(camera="Bench One", lens="Bench 50mm", f_number=2.8, focal_length_mm=50.0, subject_distance_mm=2000.0)


def grey(lens: SmallLens, light: Array, sensor: Sensor, seed: int = 0) -> Photograph:
    """A grey photograph of light (1, H + 2 RIM, W + 2 RIM)."""
    kernels = kernels_over(lambda x, y: lens.kernel(x, y, 1), lens.shape, (9, 11))
    through = blurred(light[0], kernels, RIM)
    samples = sensor.read(through, np.random.default_rng(seed))
    frame = RawFrame(Path("grey"), "", {"Y": Plane("Y", samples, 1 / sensor.steps)}, NOTED)
    return Photograph(frame, light[:, RIM:-RIM, RIM:-RIM], {"Y": through})


def bayer(
    lenses: Mapping[str, SmallLens],
    light: Array,
    sensor: Sensor,
    origins: Mapping[str, tuple[int, int]] = RGGB,
    seed: int = 0,
) -> Photograph:
    """A mosaic of light (3, H + 2 RIM, W + 2 RIM) on the sensor's grid; planes have half as many rows and columns."""
    rng, planes, through = np.random.default_rng(seed), {}, {}
    whole = tuple(n - 2 * RIM for n in light.shape[1:])
    for name, (x0, y0) in origins.items():
        lens = lenses[name]
        kernels = kernels_over(
            lambda x, y, lens=lens, x0=x0, y0=y0: lens.kernel((x - x0) / 2, (y - y0) / 2, 2), whole, (9, 11)
        )
        through[name] = blurred(light["RGB".index(name[0])], kernels, RIM)
        samples = sensor.read(through[name][y0::2, x0::2], rng)
        planes[name] = Plane(name, samples, 1 / sensor.steps, 2, (x0, y0))
    return Photograph(RawFrame(Path("mosaic"), "", planes, NOTED), light[:, RIM:-RIM, RIM:-RIM], through)


def burst(
    lenses: Mapping[str, SmallLens],
    fine: Array,
    moves: Sequence[tuple[float, float]],
    sensor: Sensor,
    light: Sequence[float] | None = None,
    turns: Sequence[tuple[float, float]] | None = None,
) -> list[RawFrame]:
    """Photographs of light (C, 2 H + 2 RIM, 2 W + 2 RIM) on a grid twice as fine as the sensor's: each shifted by (x,
    y) pixels of the sensor, with its own brightness, rotation and scale; a mosaic, or grey of one lens."""
    photographs, whole = [], tuple(n - 2 * RIM for n in fine.shape[1:])
    origins, pitch = (RGGB, 2) if len(fine) > 1 else ({"Y": (0, 0)}, 1)
    for number, (dx, dy) in enumerate(moves):
        rng, planes = np.random.default_rng(number), {}
        scenes = [shifted(one if turns is None else rotated(one, *turns[number]), 2 * dx, 2 * dy) for one in fine]
        for name, (x0, y0) in origins.items():
            lens, per = lenses[name], 2 * pitch

            def kernel(x: float, y: float, lens=lens, per=per, x0=x0, y0=y0) -> Array:
                return lens.kernel(x / per - x0 / pitch, y / per - y0 / pitch, per)

            kernels = kernels_over(kernel, whole, (9, 11))
            through = blurred(scenes["RGB".find(name[0]) if len(fine) > 1 else 0], kernels, RIM)
            through = through * (1.0 if light is None else light[number])
            samples = sensor.read(through[2 * y0 :: per, 2 * x0 :: per], rng)
            planes[name] = Plane(name, samples, 1 / sensor.steps, pitch, (x0, y0))
        photographs.append(RawFrame(Path(f"photograph {number + 1}"), "", planes, NOTED))
    return photographs
