"""Clean and corrupted photographs by a renderer of its own: wrong passes, false alarms, coverage.

A case is lens x pose x noise x corruption, drawn by its seed. Nothing here is shared with procedures or simulators but
the chart's bitmap: pupils are autocorrelated, edges are Fourier integrals of the OTF at the pixels' centres, charts are
products in the Fourier domain, and noise, mosaics and processing are applied as a camera or a program would.

Each corruption prints its mean shift of MTF50, the verdicts, and P(pass and |z| > 3) with the upper end of its
Clopper-Pearson interval (95 %, one-sided); z is the error over the stated standard uncertainty. Clean photographs print
P(refused or doubtful) and the coverage of two stated uncertainties, of MTF50 and of the curve.

`python -m tests.benchmarks.adversarial [WORD ...] [--estimator edge|chart|wall] [--count 100] [--seed 1]`: only
corruptions whose names hold one of the words.
"""

import argparse
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import (
    gaussian_filter,
    gaussian_filter1d,
    map_coordinates,
    maximum_filter,
    minimum_filter,
    spline_filter,
    uniform_filter,
)
from scipy.stats import beta

from procedures import Plane, Roi, estimate_edge, estimate_edges, estimate_psf, estimate_psf_of_pair
from procedures.outcome import Outcome
from procedures.pattern import CELLS, Chart
from procedures.pattern_print.formats import bitmap
from tests.procedures.pattern_psf import damage

Array = np.ndarray
Rng = np.random.Generator

ZOOM_STEPS = 9
"""Sizes of which the picture of a zoom is the mean."""
FINE, CELL_PIXELS = 8, 16
"""Fine pixels along a pixel's side; pixels of the printed bitmap along a cell's."""
SHARPEST = 0.8
"""Greatest MTF50 of a lens, in cycles per pixel of the plane: an edge's MTF ends at 1."""
FAR, SHIFTED = 3.0, 0.03
"""Stated uncertainties beyond which a pass is wrong; shift of MTF50 from which a corruption counts."""
CURVE = np.arange(0.05, 0.51, 0.05)
"""Frequencies at which curves are compared, in cycles/pixel."""


@dataclass(frozen=True)
class Lens:
    """A pupil of a cutoff (cycles/pixel) with aberrations in waves, a Gaussian blur, and pixels of a fill factor.

    A share `veil` of the light is spread by a Gaussian as well: a halo, or a veil where that is wide.
    """

    cutoff: float
    blur_px: float = 0.0
    fill: float = 1.0
    defocus: float = 0.0
    spherical: float = 0.0
    coma: float = 0.0
    obstruction: float = 0.0
    veil: float = 0.0
    veil_px: float = 0.0

    def otf(self, fx: Array, fy: Array) -> Array:
        """At frequencies in cycles/pixel."""
        lens = _pupil_otf(self.defocus, self.spherical, self.coma, self.obstruction)
        at = [np.ravel(f) / self.cutoff * (PUPIL / 2) + PUPIL for f in (fy, fx)]
        parts = [map_coordinates(part, at, mode="mirror", prefilter=False).reshape(np.shape(fx)) for part in lens]
        pixel = np.sinc(self.fill * fx) * np.sinc(self.fill * fy)
        square = 2 * np.pi**2 * (fx * fx + fy * fy)
        veil = 1 + self.veil * (np.exp(-square * self.veil_px**2) - 1)
        return (parts[0] + 1j * parts[1]) * pixel * np.exp(-square * self.blur_px**2) * veil

    def along(self, angle_deg: float, f: Array) -> Array:
        """OTF along the normal of an edge that leans so far from the columns."""
        lean = np.radians(angle_deg)
        return self.otf(f * np.cos(lean), -f * np.sin(lean))

    def mtf50(self, angle_deg: float) -> float:
        """Where the MTF first falls to one half, in cycles/pixel."""
        f = np.linspace(0, 1.2, 2401)
        mtf = np.abs(self.along(angle_deg, f))
        i = int(np.argmax(mtf < 0.5))
        return float(np.interp(0.5, mtf[[i, i - 1]], f[[i, i - 1]]))


PUPIL = 512
"""Half the samples across the pupil's grid, and twice those across the pupil itself."""


@cache
def _pupil_otf(defocus: float, spherical: float, coma: float, obstruction: float) -> tuple[Array, Array]:
    """Splines of the pupil's autocorrelation, (2 PUPIL, 2 PUPIL): real, imaginary; the cutoff is PUPIL / 2 from 0."""
    v, u = (np.mgrid[-PUPIL:PUPIL, -PUPIL:PUPIL] + 0.5) / (PUPIL / 4)
    r2 = u * u + v * v
    inside = (r2 < 1) & (r2 >= obstruction**2)  # grey borders would take light from f = 0 alone
    wave = defocus * r2 + spherical * (r2 * r2 - r2) + coma * (r2 - 2 / 3) * u
    pupil = inside * np.exp(2j * np.pi * wave)
    spectrum = np.abs(np.fft.fft2(pupil)) ** 2
    otf = np.fft.fftshift(np.fft.ifft2(spectrum))
    otf = otf / otf[PUPIL, PUPIL]
    return spline_filter(otf.real, mode="mirror"), spline_filter(otf.imag, mode="mirror")


def draw_lens(rng: Rng) -> Lens:
    """One of many: MTF50 from 0.1 to 0.5 cycles/pixel."""
    kind = rng.integers(5)
    aberrations = (
        {},
        {"defocus": rng.uniform(0.1, 0.5)},
        {"spherical": rng.uniform(0.3, 1.0)},
        {"coma": rng.uniform(0.3, 0.8), "defocus": rng.uniform(-0.2, 0.2)},
        {"obstruction": rng.uniform(0.2, 0.4)},
    )[kind]
    aberrations = {name: round(float(value), 1) for name, value in aberrations.items()}
    return Lens(rng.uniform(0.6, 3.0), rng.uniform(0.0, 0.9), rng.uniform(0.6, 1.0), **aberrations)


@dataclass(frozen=True)
class Pose:
    """An edge in a picture: its lean, where its middle lies off the picture's, how many pixels the picture has."""

    angle_deg: float
    shift_px: float
    rows: int
    columns: int
    turns: int
    dark: float
    bright: float


@dataclass(frozen=True)
class Noise:
    """Electrons at the nominal white, read noise in electrons, PRNU, bits."""

    white_e: float
    read_e: float
    prnu: float
    bits: int


def draw_pose(rng: Rng) -> Pose:
    """An edge of 80 to 160 pixels."""
    rows, columns = int(rng.integers(80, 160)), int(rng.integers(60, 110))
    angle = rng.uniform(3, 12) * rng.choice([-1, 1])
    dark, bright = rng.uniform(0.05, 0.2), rng.uniform(0.6, 0.85)
    return Pose(angle, rng.uniform(-0.5, 0.5), rows, columns, int(rng.integers(4)), dark, bright)


def draw_noise(rng: Rng) -> Noise:
    """From 0.5 % to 2 % of white."""
    return Noise(np.exp(rng.uniform(np.log(4e3), np.log(4e4))), rng.uniform(2, 10), rng.uniform(0, 0.006), 16)


def spread(lens: Lens, angle_deg: float, reach_px: float) -> tuple[Array, Array]:
    """Distances and the edge spread function there: 1/2 + the integral of Im(H exp(2 pi i f d)) / (pi f)."""
    apart, count = 0.04, 2 ** int(np.ceil(np.log2(40 * reach_px / 0.04)))
    step = 1 / (count * apart)
    f = (np.arange(int(min(lens.cutoff, 6.0) / step)) + 0.5) * step
    otf = lens.along(angle_deg, f)
    d = (np.arange(count) - count // 2) * apart
    terms = np.zeros(count, complex)
    terms[: len(f)] = otf / (np.pi * f) * step * np.exp(2j * np.pi * f * d[0])
    esf = 0.5 + np.imag(np.fft.ifft(terms) * count * np.exp(1j * np.pi * step * (d - d[0])))
    near = np.abs(d) <= reach_px
    return d[near], esf[near]


Distort = Callable[[Array, Array, Array, Rng], Array]
Light = Callable[[Array], Array]
Process = Callable[[Array, float, Rng], Array]


@dataclass(frozen=True)
class Corruption:
    """What is wrong with a photograph.

    Attributes
    ----------
    distort : of the edge's distances (with x, y and a generator), in the scene or while the shutter rolls
    light : of the light on the pixels, before noise
    process : of the picture, black 0 and white 1, after noise, with the noise at white
    lens : changes of the lens
    raw : whether a RAW file can have it
    scale : pixels of the picture for one of the sensor
    print_cells : standard deviation in cells of a blur of the chart's print
    zoom : share by which the picture grows while it is taken
    """

    distort: Distort | None = None
    light: Light | None = None
    process: Process | None = None
    lens: Mapping[str, float] = field(default_factory=dict)
    raw: bool = False
    scale: float = 1.0
    print_cells: float = 0.0
    zoom: float = 0.0

    def shows(self, scene: str) -> bool:
        """Whether a scene can have it."""
        if scene != "edge" and self.distort is not None:
            return False
        return scene == "chart" or not (self.print_cells or self.zoom)


@dataclass(frozen=True)
class Photograph:
    """A plane, the true MTF50 along the edge's normal, the true curve at `CURVE`, in cycles per pixel of the plane."""

    plane: Plane
    mtf50: float
    curve: Array


def edge_light(lens: Lens, pose: Pose, corruption: Corruption, pitch: int, rng: Rng) -> tuple[Array, float]:
    """Light on the pixels around an edge, and the direction of its normal."""
    rows, columns = pose.rows * pitch, pose.columns * pitch
    y, x = np.mgrid[:rows, :columns].astype(float)
    lean = np.radians(pose.angle_deg)
    d = (x - (columns - 1) / 2 - pose.shift_px) * np.cos(lean) - (y - (rows - 1) / 2) * np.sin(lean)
    if corruption.distort is not None:
        d = corruption.distort(d, x, y, rng)
    places, values = spread(lens, pose.angle_deg, float(np.abs(d).max()) + 2)
    return np.rot90(pose.dark + (pose.bright - pose.dark) * np.interp(d, places, values), pose.turns), pose.angle_deg


def chart_light(lens: Lens, pose: Pose, corruption: Corruption, pitch: int, rng: Rng) -> tuple[Array, float]:
    """Light on the pixels around the noise chart, and the direction of their rows.

    The print's bitmap is averaged over fine pixels, multiplied by the OTF in the Fourier domain, and read at the
    pixels' centres. Its margin is as white as what lies around it.
    """
    width_px, size = (100 + 0.25 * pose.rows) * pitch, 200 * pitch
    roll, scale = np.radians(pose.angle_deg / 3), width_px * FINE / (CELLS * CELL_PIXELS)
    print_ = bitmap(Chart.from_seed(), CELL_PIXELS).astype(np.float32) / 255
    if corruption.print_cells:
        print_ = gaussian_filter(print_, corruption.print_cells * CELL_PIXELS, truncate=3)
    print_ = cv2.blur(print_, (round(1 / scale),) * 2)
    turn = scale * np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    middle = (np.array(print_.shape) - 1) / 2
    offset = size * FINE / 2 + pose.shift_px * FINE - turn @ middle
    warped = partial(cv2.warpAffine, print_, dsize=(size * FINE,) * 2, borderValue=1.0)
    grown = 1 + corruption.zoom * (np.linspace(-0.5, 0.5, ZOOM_STEPS) if corruption.zoom else np.zeros(1))
    fixed = np.full(2, size * FINE / 2)
    fine = np.mean([warped(np.column_stack([a * turn, fixed + a * (offset - fixed)])) for a in grown], axis=0)
    fy, fx = np.meshgrid(np.fft.fftfreq(size * FINE, 1 / FINE), np.fft.rfftfreq(size * FINE, 1 / FINE), indexing="ij")
    passed = np.hypot(fx, fy) < lens.cutoff
    otf = np.zeros(fx.shape, complex)
    otf[passed] = lens.otf(fx[passed], fy[passed]) / (np.sinc(fx[passed] / FINE) * np.sinc(fy[passed] / FINE))
    light = np.fft.irfft2(np.fft.rfft2(fine) * otf, fine.shape)[FINE // 2 :: FINE, FINE // 2 :: FINE]
    return pose.dark + (pose.bright - pose.dark) * light, 0.0


SCENES = {"edge": edge_light, "chart": chart_light}
WALL_PX, WALL_FINE = 130, 2
"""Side of a wall's far photograph in pixels; fine pixels along a near pixel's side."""


def wall_lights(lens: Lens, pose: Pose, rng: Rng) -> tuple[Array, Array]:
    """Light of a wall with 1/f detail on the pixels of a near and a far photograph."""
    zoom = 3.4 + 0.01 * pose.rows
    near_px = int(WALL_PX * zoom * 1.1)
    size = WALL_FINE * (near_px + 80)
    fx, fy = np.meshgrid(np.fft.rfftfreq(size, 1 / WALL_FINE), np.fft.fftfreq(size, 1 / WALL_FINE))
    spectrum = np.fft.rfft2(rng.standard_normal((size, size))) / np.maximum(np.hypot(fx, fy), 4 / near_px)
    wall = np.fft.irfft2(spectrum, (size, size))
    spectrum *= 0.12 / wall.std()
    roll, apart = np.radians(pose.angle_deg / 3), WALL_FINE * zoom
    turned = zoom * (np.cos(roll) * fx + np.sin(roll) * fy), zoom * (np.cos(roll) * fy - np.sin(roll) * fx)
    near, far = (0.4 + np.fft.irfft2(spectrum * lens.otf(*f), (size, size)) for f in ((fx, fy), turned))
    first = WALL_FINE * 40
    y, x = (np.indices((WALL_PX, WALL_PX)) - (WALL_PX - 1) / 2) * apart
    middle = (size - 1) / 2 + pose.shift_px
    at = middle + np.cos(roll) * y + np.sin(roll) * x, middle + np.cos(roll) * x - np.sin(roll) * y
    end = first + WALL_FINE * near_px
    return near[first:end:WALL_FINE, first:end:WALL_FINE], map_coordinates(far, at, order=5, mode="wrap")


def pair(seed: int, corruption: Corruption, *, source: str) -> tuple[Photograph, Photograph]:
    """Near and far photograph of a wall, both corrupted; monochrome."""
    rng = np.random.default_rng(seed)
    pose, noise = draw_pose(rng), draw_noise(rng)
    while (lens := draw_lens(rng)).mtf50(0.0) > SHARPEST:
        pass
    lens = replace(lens, **corruption.lens)
    truth = np.abs(lens.along(0.0, CURVE))
    shots = []
    for light in wall_lights(lens, pose, rng):
        light = light if corruption.light is None else corruption.light(light)
        plane = exposed(light, noise, corruption, source, rng)
        shots.append(Photograph(plane, lens.mtf50(0.0), truth))
    return shots[0], shots[1]


def exposed(light: Array, noise: Noise, corruption: Corruption, source: str, rng: Rng) -> Plane:
    """The plane of a photograph: noise, rounding, processing."""
    prnu = 1 + noise.prnu * rng.standard_normal(light.shape)
    signal = rng.poisson(np.maximum(light, 0) * noise.white_e * np.maximum(prnu, 0))
    picture = (signal + noise.read_e * rng.standard_normal(light.shape)) / noise.white_e
    steps = 2 ** (noise.bits if source == "grey" else 14) - 1
    picture = np.clip(np.rint(picture * steps), -0.02 * steps, steps) / steps
    pitch = 2 if source == "bayer" else 1
    if source == "bayer":
        picture = picture[::2, 1::2]
    if corruption.process is not None:
        picture = corruption.process(picture, float(noise.white_e**-0.5), rng)
        picture = np.clip(np.rint(picture * steps), -0.02 * steps, steps) / steps
    samples = np.ascontiguousarray(picture, dtype=np.float32)
    return Plane("Y", samples, 1 / steps, pitch=pitch, raw=source != "grey")


def photograph(seed: int, corruption: Corruption, *, source: str, scene: str = "edge") -> Photograph:
    """The case of a seed; `source` is "raw" (a monochrome sensor), "bayer" (every second pixel) or "grey" (a file)."""
    rng = np.random.default_rng(seed)
    pitch = 2 if source == "bayer" else 1
    pose, noise = draw_pose(rng), draw_noise(rng)
    while (lens := draw_lens(rng)).mtf50(0.0) * pitch > SHARPEST:
        pass
    lens = replace(lens, **corruption.lens)
    light, direction_deg = SCENES[scene](lens, pose, corruption, pitch, rng)
    if corruption.light is not None:
        light = corruption.light(light)
    plane = exposed(light, noise, corruption, source, rng)
    scale = corruption.scale / pitch
    truth = np.abs(lens.along(direction_deg, CURVE * scale))
    return Photograph(plane, lens.mtf50(direction_deg) / scale, truth)


def unsharp(amount: float, radius_px: float, threshold: float = 0.0) -> Corruption:
    """Unsharp mask; the threshold is in noises at white."""

    def process(x: Array, noise: float, rng: Rng) -> Array:
        detail = x - gaussian_filter(x, radius_px)
        return x + amount * np.where(np.abs(detail) > threshold * noise, detail, 0.0)

    return Corruption(process=process)


def changed(change: Callable[[Array], Array]) -> Corruption:
    return Corruption(process=lambda x, noise, rng: change(x))


def curve(change: Callable[[Array], Array]) -> Corruption:
    return changed(lambda x: change(np.clip(x, 0, 1)))


def srgb(x: Array) -> Array:
    return np.where(x < 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)


def shoulder(start: float, white: float) -> Corruption:
    """Linear up to a level, then an exponential approach to white."""
    room = white - start
    return curve(lambda x: np.where(x < start, x, white - room * np.exp(-(np.maximum(x, start) - start) / room)))


def enlarged(factor: float, how: int) -> Corruption:
    return Corruption(
        process=lambda x, noise, rng: cv2.resize(x, None, fx=factor, fy=factor, interpolation=how), scale=factor
    )


def resampled(scale: float, shift_px: float, how: int) -> Corruption:
    def process(x: Array, noise: float, rng: Rng) -> Array:
        y, column = np.indices(x.shape).astype(np.float32)
        return cv2.remap(
            x, column * np.float32(scale) + np.float32(shift_px), y * np.float32(scale) + np.float32(shift_px), how,
            borderMode=cv2.BORDER_REFLECT,
        )  # fmt: skip

    return Corruption(process=process)


def bilateral(noises: float, radius_px: float) -> Corruption:
    return Corruption(
        process=lambda x, noise, rng: cv2.bilateralFilter(x.astype(np.float32), -1, noises * noise, radius_px)
    )


def nl_means(strength: float) -> Corruption:
    def process(x: Array, noise: float, rng: Rng) -> Array:
        levels = np.rint(255 * np.clip(x, 0, 1)).astype(np.uint8)
        return cv2.fastNlMeansDenoising(levels, None, max(strength * 255 * noise, 1.0), 5, 15) / 255.0

    return Corruption(process=process)


def local_contrast(amount: float, radius_px: float, kept: float = 0.0) -> Corruption:
    """What a blur leaves, added: in the mid-tones, or everywhere by a filter that keeps edges above a contrast."""

    def process(x: Array, noise: float, rng: Rng) -> Array:
        wide = cv2.bilateralFilter(x.astype(np.float32), -1, kept, radius_px) if kept else gaussian_filter(x, radius_px)
        return x + amount * (1.0 if kept else (4 * x * (1 - x)) ** 2) * (x - wide)

    return Corruption(process=process)


def median_blend(share: float) -> Corruption:
    return Corruption(process=lambda x, noise, rng: (1 - share) * x + share * cv2.medianBlur(x.astype(np.float32), 3))


def wavelet(noises: float) -> Corruption:
    """Soft threshold of the undecimated Haar wavelet's two finest scales."""

    def process(x: Array, noise: float, rng: Rng) -> Array:
        total, rest = np.zeros_like(x), x
        for level in range(2):
            smooth = rest
            for axis in (0, 1):
                smooth = (np.roll(smooth, 2**level, axis) + 2 * smooth + np.roll(smooth, -(2**level), axis)) / 4
            detail = rest - smooth
            limit = noises * noise * (0.85, 0.3)[level]
            total += np.sign(detail) * np.maximum(np.abs(detail) - limit, 0)
            rest = smooth
        return total + rest

    return Corruption(process=process)


def edge_directed(steps: int, grain: float) -> Corruption:
    """Diffusion along edges, at the noise's gradients, then white grain in noises."""

    def process(x: Array, noise: float, rng: Rng) -> Array:
        smooth = x
        for _ in range(steps):
            gy, gx = np.gradient(gaussian_filter(smooth, 0.7))
            gyy = np.gradient(np.gradient(smooth, axis=0), axis=0)
            gxy, gxx = np.gradient(np.gradient(smooth, axis=1))
            square = gx * gx + gy * gy + (0.3 * noise) ** 2
            smooth = smooth + 0.2 * (gy * gy * gxx - 2 * gx * gy * gxy + gx * gx * gyy) / square
        return smooth + grain * noise * rng.standard_normal(x.shape)

    return Corruption(process=process)


def guided(radius_px: int, noises: float) -> Corruption:
    """A filter that the picture guides itself: windows with less contrast than so many noises become their mean."""

    def process(x: Array, noise: float, rng: Rng) -> Array:
        mean = partial(uniform_filter, size=2 * radius_px + 1)
        level = mean(x)
        variance = mean(x * x) - level**2
        kept = variance / (variance + (noises * noise) ** 2)
        return mean(kept) * x + mean((1 - kept) * level)

    return Corruption(process=process)


def deconvolved(steps: int, radius_px: float) -> Corruption:
    """Richardson and Lucy's iterations for a Gaussian blur."""

    def process(x: Array, noise: float, rng: Rng) -> Array:
        blur, observed = partial(gaussian_filter, sigma=radius_px), np.maximum(x, 1e-4)
        picture = observed
        for _ in range(steps):
            picture = picture * blur(observed / np.maximum(blur(picture), 1e-4))
        return picture

    return Corruption(process=process)


def limited(amount: float, radius_px: float) -> Corruption:
    """Unsharp mask within the range of the neighbours, without a halo."""

    def process(x: Array, noise: float, rng: Rng) -> Array:
        sharp = x + amount * (x - gaussian_filter(x, radius_px))
        return np.clip(sharp, minimum_filter(x, 3), maximum_filter(x, 3))

    return Corruption(process=process)


def rough(rms_px: float, length_px: float) -> Corruption:
    """The printed edge displaced at random, correlated along it."""

    def distort(d: Array, x: Array, y: Array, rng: Rng) -> Array:
        walk = gaussian_filter1d(rng.standard_normal(len(y) + 40), length_px)[20:-20]
        return d + rms_px * (walk / walk.std())[:, None]

    return Corruption(distort=distort, raw=True)


def vibration(amplitude_px: float, period_rows: float) -> Corruption:
    """Rows displaced by an oscillation while the shutter rolls."""

    def distort(d: Array, x: Array, y: Array, rng: Rng) -> Array:
        return d + amplitude_px * np.sin(2 * np.pi * y / period_rows + rng.uniform(0, 6))

    return Corruption(distort=distort, raw=True)


def veil(share: float, radius_px: float) -> Corruption:
    """A share of the light spread by the lens or a filter: it is part of the lens, and of the truth."""
    return Corruption(lens={"veil": share, "veil_px": radius_px}, raw=True)


def ghost(share: float, radius_px: float) -> Corruption:
    """The picture mirrored through its centre, blurred, added."""

    def light(picture: Array) -> Array:
        return (1 - share) * picture + share * gaussian_filter(picture[::-1, ::-1], radius_px, mode="nearest")

    return Corruption(light=light, raw=True)


def defects(share: float) -> Corruption:
    """Hot pixels, and half as many dead ones; the truth is the lens's."""

    def process(x: Array, noise: float, rng: Rng) -> Array:
        place = rng.random(x.shape)
        return np.where(place < share, rng.uniform(0.3, 1.0, x.shape), np.where(place > 1 - share / 2, 0.0, x))

    return Corruption(process=process, raw=True)


CLEAN = Corruption(raw=True)
CORRUPTIONS: dict[str, Corruption] = {
    "clean": CLEAN,
    **{f"unsharp mask {a:.0%} of {r} px": unsharp(a, r) for a, r in (
        (0.05, 1.0), (0.1, 1.0), (0.2, 1.0), (0.5, 1.0), (0.1, 0.6), (0.3, 0.6), (0.05, 3.0), (0.1, 3.0), (0.2, 3.0),
        (0.1, 6.0), (0.3, 6.0))},
    **{f"unsharp mask {a:.0%} of {r} px over {t} noises": unsharp(a, r, t) for a, r, t in (
        (0.2, 1.0, 2.0), (0.5, 1.0, 3.0), (0.3, 2.0, 3.0))},
    "gamma 2.2": curve(lambda x: x ** (1 / 2.2)),
    "gamma 1.4": curve(lambda x: x ** (1 / 1.4)),
    "gamma 0.7": curve(lambda x: x ** (1 / 0.7)),
    "sRGB": curve(srgb),
    "soft shoulder to 0.95": shoulder(0.5, 0.95),
    "soft shoulder to 0.8": shoulder(0.4, 0.8),
    "smooth step of contrast": curve(lambda x: x * x * (3 - 2 * x)),
    "clipped at 0.5": curve(lambda x: np.minimum(x, 0.5) * 1.9),
    "demosaicked bilinearly": changed(damage.demosaiced(2)),
    "enlarged x1.5, linear": enlarged(1.5, cv2.INTER_LINEAR),
    "enlarged x1.5, cubic": enlarged(1.5, cv2.INTER_CUBIC),
    "enlarged x2, Lanczos": enlarged(2.0, cv2.INTER_LANCZOS4),
    "resampled x0.999, linear": resampled(0.999, 0.3, cv2.INTER_LINEAR),
    "moved by 0.5 px, cubic": resampled(1.0, 0.5, cv2.INTER_CUBIC),
    "moved by 0.2 px, linear": resampled(1.0, 0.2, cv2.INTER_LINEAR),
    "bilateral 3 noises, 2 px": bilateral(3.0, 2.0),
    "bilateral 6 noises, 1.5 px": bilateral(6.0, 1.5),
    "NL-means, 1 noise": nl_means(1.0),
    "NL-means, 2 noises": nl_means(2.0),
    "median, 30 %": median_blend(0.3),
    "median": median_blend(1.0),
    "wavelet threshold, 1 noise": wavelet(1.0),
    "wavelet threshold, 3 noises": wavelet(3.0),
    "edge-directed denoising with grain": edge_directed(1, 0.7),
    "local contrast 20 % of 30 px, mid-tones": local_contrast(0.2, 30.0),
    **{f"local contrast 20 % of {r} px, edges kept": local_contrast(0.2, r, 0.15) for r in (6, 20)},
    "guided filter, 2 px, 3 noises": guided(2, 3.0),
    "guided filter, 1 px, 1.5 noises": guided(1, 1.5),
    "deconvolved, 3 steps of 0.7 px": deconvolved(3, 0.7),
    "sharpened within its range, 50 %": limited(0.5, 2.0),
    "JPEG 90": changed(damage.jpeg(90)),
    "JPEG 60": changed(damage.jpeg(60)),
    "rough print 0.15 px": rough(0.15, 1.0),
    "rough print 0.3 px": rough(0.3, 3.0),
    "vibration 0.3 px in 20 rows": vibration(0.3, 20),
    "vibration 0.3 px in 60 rows": vibration(0.3, 60),
    "vibration 0.5 px in 7 rows": vibration(0.5, 7),
    "print blurred by 0.5 cell": Corruption(print_cells=0.5, raw=True),
    "zoom of 1 %": Corruption(zoom=0.01, raw=True),
    "halo 8 % of 2.5 px": veil(0.08, 2.5),
    "halo 6 % of 2 px": veil(0.06, 2.0),
    "veil 20 % of 15 px": veil(0.2, 15),
    "veil 20 % of 30 px": veil(0.2, 30),
    "ghost 5 % of 3 px": ghost(0.05, 3.0),
    "hot pixels 0.05 %": defects(0.0005),
}  # fmt: skip


@dataclass(frozen=True)
class Answer:
    """What an estimator says: verdict, MTF50, its uncertainty, the curve and its uncertainty at `CURVE`, and the
    probability that MTF50 lies within two uncertainties."""

    verdict: str
    reason: str
    mtf50: float = np.nan
    uncertainty: float = np.nan
    curve: Array | None = None
    curve_uncertainty: Array | None = None
    probability: float = np.nan


def by_edge(plane: Plane, seed: int) -> Answer:
    """The slanted edge: the best of those found, or of every third photograph that of the whole plane."""
    outcome = estimate_edge(plane, Roi.whole(plane.samples)) if seed % 3 == 0 else estimate_edges(plane)[0]
    edge = outcome.value
    if edge is None or "mtf50" not in edge.numbers:
        return Answer(str(outcome.verdict), outcome.reason)
    number = edge.numbers["mtf50"]
    values, spreads = (np.interp(CURVE, edge.frequencies, part) for part in (edge.mtf, edge.uncertainty))
    known = number.value, number.uncertainty, values, spreads, outcome.value.probability
    return Answer(str(outcome.verdict), outcome.reason, *known)


def by_chart(plane: Plane, seed: int) -> Answer:
    """The noise chart, along rows."""
    return _along_rows(estimate_psf(plane, Chart.from_seed()))


def by_wall(near: Plane, far: Plane) -> Answer:
    """Two photographs of a wall, along rows."""
    return _along_rows(estimate_psf_of_pair(near, far))


def _along_rows(outcome: Outcome[Any]) -> Answer:
    if outcome.value is None or "mtf50_horizontal" not in outcome.value.quality.numbers:
        return Answer(str(outcome.verdict), outcome.reason)
    quality = outcome.value.quality
    number, curves = quality.numbers["mtf50_horizontal"], (quality.mtf_horizontal, quality.uncertainty("horizontal"))
    values, spreads = (np.interp(CURVE, quality.frequencies, part) for part in curves)
    known = number.value, number.uncertainty, values, spreads, outcome.value.probability
    return Answer(str(outcome.verdict), outcome.reason, *known)


ESTIMATORS: dict[str, Callable[[Plane, int], Answer]] = {"edge": by_edge, "chart": by_chart}
"""By the name of their scene."""


def answered(scene: str, seed: int, corruption: Corruption, source: str) -> tuple[Photograph, Answer]:
    """The photograph of a seed, or the far one of a wall, and what the scene's estimator says."""
    if scene == "wall":
        near, far = pair(seed, corruption, source=source)
        return far, by_wall(near.plane, far.plane)
    shot = photograph(seed, corruption, source=source, scene=scene)
    return shot, ESTIMATORS[scene](shot.plane, seed)


def at_most(count: int, of: int) -> float:
    """Upper end of the one-sided 95 % Clopper-Pearson interval of a probability."""
    return 1.0 if count == of else float(beta.ppf(0.95, count + 1, of - count))


@dataclass
class Tally:
    """The answers to one corruption."""

    name: str
    answers: list[tuple[Photograph, Answer]]

    def line(self, words: bool) -> str:
        """Mean error, verdicts, wrong passes, coverage; the commonest reasons where they are asked for."""
        n = len(self.answers)
        verdicts = Counter(answer.verdict for _, answer in self.answers)
        passed = [(shot, answer) for shot, answer in self.answers if answer.verdict == "pass"]
        known = [(shot, answer) for shot, answer in self.answers if np.isfinite(answer.mtf50)]
        errors = np.array([answer.mtf50 / shot.mtf50 - 1 for shot, answer in known])
        z = np.array([(answer.mtf50 - shot.mtf50) / answer.uncertainty for shot, answer in passed])
        wrong = int(np.sum(np.abs(z) > FAR))
        curve_z = np.array([(a.curve - shot.curve) / a.curve_uncertainty for shot, a in passed if a.curve is not None])
        counted = len(errors) and abs(np.mean(errors)) > SHIFTED
        text = (
            f"{self.name:38s} {np.mean(errors) if len(errors) else np.nan:+7.1%} "
            f"{np.mean([a.uncertainty / a.mtf50 for _, a in known]) if known else np.nan:6.1%} "
            f"{verdicts['pass'] / n:5.0%} {verdicts['doubtful'] / n:5.0%} {verdicts['refused'] / n:5.0%} "
            f"{wrong / n:7.1%} < {at_most(wrong, n):5.1%} "
        )
        if len(z):
            text += f"{np.mean(np.abs(z) < 2):5.0%} {np.mean(np.abs(curve_z) < 2):5.0%} {np.sqrt(np.mean(z**2)):5.2f}"
            text += f" {np.abs(z).max():5.1f} {np.abs(curve_z).max():5.1f}"
        text += " *" if counted and wrong else ""
        if words:
            reasons = Counter(a.reason.split(";")[0][:70] for _, a in self.answers if a.reason)
            text += "".join(f"\n      {count:4d} x {reason}" for reason, count in reasons.most_common(6))
        return text


def run(name: str, estimator: str, source: str, seeds: Sequence[int]) -> Tally:
    """Every seed's photograph with one corruption, through one estimator."""
    return Tally(f"{name} ({source})", [answered(estimator, seed, CORRUPTIONS[name], source) for seed in seeds])


def main() -> None:
    """Print a line for each corruption and source."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--estimator", choices=[*ESTIMATORS, "wall"], default="edge")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reasons", action="store_true")
    parser.add_argument("--sources", nargs="*", default=["grey", "raw", "bayer"])
    given = parser.parse_args()
    seeds = range(1000 * given.seed, 1000 * given.seed + given.count)
    start = time.process_time()
    print(f"{'corruption (source)':38s}   error stated  pass doubt refus  P(wrong pass)  <2 s curve   rms worst curve")
    for name, corruption in CORRUPTIONS.items():
        if not (corruption.shows(given.estimator) and any(word in name for word in given.words or [name])):
            continue
        for source in given.sources:
            photographed = source == "grey" or (corruption.raw and (source == "raw" or name == "clean"))
            if photographed and (given.estimator, source) != ("wall", "bayer"):
                print(run(name, given.estimator, source, seeds).line(given.reasons), flush=True)
    print(f"{time.process_time() - start:.0f} s of processor time")


if __name__ == "__main__":
    main()
