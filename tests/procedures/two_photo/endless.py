"""Two photographs of a wall through optics with an infinite PSF: the scene's spectrum times the analytic OTF.

The wall is periodic and has detail up to two cycles per near pixel, so that both photographs are aliased. Nothing is
truncated: the numbers of the analytic OTF are the ground truth.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import scipy.fft
from scipy.ndimage import map_coordinates

from ..pattern_psf.analytic_camera import circular
from .wall import Otf, Pair, leaves

Array = np.ndarray
TEXELS = 4
"""Texels per near pixel."""
RIM_PX = 40
"""Near pixels of the wall beyond the near photograph on every side."""


CAMERAS = {"f/2.8": circular(3.25), "f/5.6": circular(1.62, fill=0.9), "f/8": circular(1.14, blur_px=0.3)}


def mtf_nyquist(otf: Otf) -> float:
    """|OTF| at half a cycle per pixel along x."""
    return float(otf(np.float64(0.5), np.float64(0)))


def pink(size: int, rng: np.random.Generator, power: float = 1.0) -> Array:
    """A wall whose amplitude falls as 1 / f^power, periodic, of mean 0.4 and standard deviation 0.12."""
    spectrum = scipy.fft.rfft2(rng.standard_normal((size, size), dtype=np.float32))
    f = np.hypot(scipy.fft.fftfreq(size)[:, None], scipy.fft.rfftfreq(size)) * size
    wall = scipy.fft.irfft2(spectrum / np.maximum(f, 8.0).astype(np.float32) ** power, (size, size))
    return np.asarray(0.4 + 0.12 * wall / wall.std(), np.float32)


WALLS: dict[str, Callable[[int, np.random.Generator], Array]] = {"pink": pink, "leaves": leaves}


@lru_cache(maxsize=2)
def _spectrum(wall: str, size: int, seed: int) -> Array:
    return scipy.fft.rfft2(WALLS[wall](size, np.random.default_rng(seed)))


def _imaged(spectrum: Array, otf: Otf, per_texel: float) -> Array:
    """The wall through optics, `per_texel` pixels per texel."""
    size = len(spectrum)
    fx, fy = scipy.fft.rfftfreq(size) / per_texel, scipy.fft.fftfreq(size)[:, None] / per_texel
    H = otf(fx, fy)
    return scipy.fft.irfft2(spectrum * H.astype(np.complex64 if np.iscomplexobj(H) else np.float32), (size, size))


def _splines(size: int) -> Array:
    """Transfer function of quintic splines, (size, size // 2 + 1), with knot values 1, 26, 66, 26, 1 over 120."""
    along, down = (2 * np.pi * f for f in (scipy.fft.rfftfreq(size), scipy.fft.fftfreq(size)))
    across, upright = ((66 + 52 * np.cos(w) + 2 * np.cos(2 * w)) / 120 for w in (along, down))
    return np.asarray(across * upright[:, None], np.float32)


def photographs(
    otf: Otf,
    *,
    wall: str | Array = "pink",
    zoom: float = 4.6,
    size: int = 150,
    noise: float = 0.004,
    seed: int = 1,
    tilt: float = 0.0,
    roll: float = 0.0,
    near_otf: Otf | None = None,
    far_wall: Array | None = None,
) -> Pair:
    """A far photograph of `size` pixels and a near one of the same part of the wall, noise in both."""
    near_size = int(size * zoom)
    whole = scipy.fft.next_fast_len((near_size + 2 * RIM_PX) * TEXELS, real=True)
    spectrum = _spectrum(wall, whole, seed) if isinstance(wall, str) else scipy.fft.rfft2(wall)
    near = _imaged(spectrum, near_otf or otf, 1 / TEXELS)
    of_far = spectrum if far_wall is None else scipy.fft.rfft2(far_wall)
    far = _imaged(of_far / _splines(whole), otf, 1 / (TEXELS * zoom))  # the coefficients of its splines
    first = (whole - TEXELS * near_size) // 2
    near = near[first : first + TEXELS * near_size : TEXELS, first : first + TEXELS * near_size : TEXELS]
    c, s = np.cos(roll), np.sin(roll)
    centred = np.array([[1, 0, -(size - 1) / 2], [0, 1, -(size - 1) / 2], [tilt / size, -0.6 * tilt / size, 1.0]])
    centred[2, 2] -= centred[2, :2].sum() * (size - 1) / 2
    middle = (near_size - 1) / 2
    H = np.array([[zoom * c, -zoom * s, middle + 0.3], [zoom * s, zoom * c, middle - 0.2], [0, 0, 1]]) @ centred
    y, x = np.indices((size, size))
    w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    u, v = ((H[i, 0] * x + H[i, 1] * y + H[i, 2]) / w * TEXELS + first for i in (0, 1))
    far = map_coordinates(far, [v, u], order=5, mode="grid-wrap", prefilter=False)
    rng = np.random.default_rng(1000 + seed)
    near, far = (image + rng.normal(0, noise, image.shape) for image in (near, far))
    return Pair(near.astype(np.float32), far.astype(np.float32), H)
