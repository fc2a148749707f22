"""Numbers read from the PSF itself: widths, energies inside circles and above Nyquist, shape, with their gradients.

Every one is of the band-limited PSF between its samples, and of all light: the tail outside the support counts.
Lengths are in pixels of the plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from procedures.numbers import (
    CENTROID_X,
    CENTROID_Y,
    ELLIPSE_ANGLE,
    ELLIPTICITY,
    ENERGY_ABOVE_NYQUIST,
    FWHM_HORIZONTAL,
    FWHM_VERTICAL,
)
from procedures.psf import Psf

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

FINE = 4
"""Points per sample between which the energy inside a circle is summed."""
FINE_SECTION = 16
"""The same of a section whose width is read."""
OUTER = 0.67
"""Share of the band beyond which its outer third lies."""
CIRCLES = (0.5, 0.8)
"""Shares of all light whose radii are told."""
AROUND = 4
"""Samples around the support that its interpolation needs."""


@dataclass(frozen=True)
class DrawnNumber:
    """A number as it is drawn from a PSF: its name, value, unit, method, and its gradient by the parameters."""

    name: str
    value: float
    unit: str
    method: str
    gradient: Array


def spatial_numbers(psf: Psf) -> list[DrawnNumber]:
    """Width, shape, energy: the numbers read from the band-limited PSF itself."""
    x = psf.offsets_px
    above, slope = energy_above_nyquist(psf)
    found = [
        _of_support(psf, CENTROID_X, np.tile(x, psf.k)),
        _of_support(psf, CENTROID_Y, np.repeat(x, psf.k)),
        _width(psf, FWHM_HORIZONTAL, 1),
        _width(psf, FWHM_VERTICAL, 0),
        DrawnNumber(ENERGY_ABOVE_NYQUIST, above, "1", "share of |OTF|^2", slope),
    ]
    return [*found, *_encircled(psf), *_ellipse_numbers(psf)]


def energy_within(psf: Psf, radius_px: float) -> tuple[float, Array]:
    """Share of all light within a radius about the centre, of the band-limited PSF, and its derivative (k^2 + q,)."""
    image, light = psf.extended(), psf.light
    size = min(2 * (int(np.ceil(radius_px * psf.s)) + AROUND) + 1, len(image))
    rim = (len(image) - size) // 2
    by_image = np.zeros_like(image)
    by_image[rim : len(image) - rim, rim : len(image) - rim] = _fine_grid(size, psf.s).within(radius_px)
    share = float(np.sum(by_image * image)) / light
    return share, (psf.contract(by_image) - share * psf.weights) / light


def energy_above_nyquist(psf: Psf) -> tuple[float, Array]:
    """Share of |OTF|^2 outside |fx|, |fy| <= 1/2, what noise adds taken away, and its derivative (k^2 + q,)."""
    image = psf.extended()
    S = _band_kernel(len(image), psf.s, 0.5)
    through = S @ image @ S
    inside = float(np.sum(through * image)) - _noise_of_energy(psf, 0.5)
    whole = float(np.sum(image**2)) - _noise_of_energy(psf, psf.s / 2)
    if whole <= 0:
        return np.nan, np.full(len(psf.parameters), np.nan)
    return 1 - inside / whole, psf.contract(2 * (inside / whole * image - through) / whole)


def energy_beyond_band(psf: Psf, above: float, uncertainty: float) -> float:
    """By how much the share of energy above Nyquist may be too small for what lies beyond the band.

    As much again as in the band's outer third: behind a zero of the photosite's OTF no less may follow than before it.
    """
    image, edge = psf.extended(), OUTER * psf.s / 2
    S = _band_kernel(len(image), psf.s, edge)
    inside = float(np.sum((S @ image @ S) * image)) - _noise_of_energy(psf, edge)
    whole = float(np.sum(image**2)) - _noise_of_energy(psf, psf.s / 2)
    outer = 1 - inside / whole if whole > 0 else 0.0
    return (1 - above) * float(np.sqrt(outer**2 - uncertainty**2)) if outer > uncertainty else 0.0


def _of_support(psf: Psf, name: str, x: Array) -> DrawnNumber:
    """The first moment over the support, which alone has one: a tail of 1/r^3 has none."""
    h = psf.h.ravel()
    total = h.sum()
    value = float(h @ x / total)
    gradient = np.concatenate([(x - value) / total, np.zeros(len(psf.parameters) - psf.k**2)])
    return DrawnNumber(name, value, "pixel", "first moment inside the support, from the PSF's centre", gradient)


def section_widths(psf: Psf) -> tuple[float, float]:
    """Full widths at half maximum of the band-limited sections through the centre, along rows and along columns."""
    middle = psf.k // 2
    horizontal, vertical = _widths(np.stack([psf.h[middle], psf.h[:, middle]]), psf.s).tolist()
    return horizontal, vertical


def _width(psf: Psf, name: str, axis: int) -> DrawnNumber:
    """One of `section_widths`, along rows (1) or columns (0)."""
    middle = psf.k // 2
    profile = psf.h[middle] if axis else psf.h[:, middle]
    used = middle * psf.k + np.arange(psf.k) if axis else middle + psf.k * np.arange(psf.k)
    step = 1e-4 * max(float(np.abs(profile).max()), 1e-30)
    steps = step * np.vstack([np.zeros(psf.k), np.eye(psf.k), -np.eye(psf.k)])
    value, *moved = _widths(profile + steps, psf.s).tolist()
    gradient = np.zeros(len(psf.parameters))
    gradient[used] = (np.array(moved[: psf.k]) - moved[psf.k :]) / (2 * step)
    return DrawnNumber(name, value, "pixel", "band-limited section through the centre", gradient)


def _widths(profiles: Array, s: int) -> Array:
    """Full widths at half maximum (b,) of band-limited sections (b, k), in pixels; NaN where there is none."""
    values = profiles @ _between(profiles.shape[1])
    peak = values.argmax(axis=1)[:, None]
    below = values < np.take_along_axis(values, peak, 1) / 2
    at = np.arange(values.shape[1])
    right, left = below & (at > peak), below & (at < peak)
    there = right.any(axis=1) & left.any(axis=1)
    high, low = right.argmax(axis=1), values.shape[1] - 1 - left[:, ::-1].argmax(axis=1)
    width = _half_way(values, peak, high, high - 1) - _half_way(values, peak, low, np.minimum(low + 1, at[-1]))
    return np.asarray(np.where(there, width, np.nan) / (FINE_SECTION * s))


@lru_cache(maxsize=8)
def _between(k: int) -> Array:
    """Band-limited interpolation of k samples, `FINE_SECTION` points a sample: (k, n)."""
    t = np.arange((k - 1) * FINE_SECTION + 1) / FINE_SECTION
    return np.asarray(np.sinc(t - np.arange(k)[:, None]))


def _half_way(values: Array, peak: Indices, outer: Indices, inner: Indices) -> Array:
    """Where sections (b, n) fall to half of their value at `peak` (b, 1), between two samples (b,) of each."""
    rows = np.arange(len(values))
    half, beyond, before = values[rows, peak[:, 0]] / 2, values[rows, outer], values[rows, inner]
    with np.errstate(divide="ignore", invalid="ignore"):  # where there is no crossing
        return np.asarray(inner + (outer - inner) * (before - half) / (before - beyond))


@lru_cache(maxsize=16)
def _band_kernel(size: int, s: int, edge: float) -> Array:
    """(size, size): S h S . h is the integral of |OTF|^2 over |fx|, |fy| <= edge (cycles/pixel), of sum h^2."""
    part = 2 * edge / s
    return np.asarray(part * np.sinc(part * (np.arange(size)[:, None] - np.arange(size))))


def _noise_of_energy(psf: Psf, edge: float) -> float:
    """What noise of the samples adds, on average, to the energy at |fx|, |fy| <= edge."""
    noise = psf.covariance if psf.lacking is None else psf.covariance - psf.lacking
    if edge >= psf.s / 2:
        return float(np.trace(noise))
    S = _band_kernel(psf.k, psf.s, edge)
    C = noise.reshape(psf.k, psf.k, psf.k, psf.k)
    return float(np.sum(S * np.tensordot(S, C, axes=((0, 1), (0, 2)))))


@dataclass(frozen=True)
class _FineGrid:
    """Points between the samples of an image, `FINE` a sample, each for a square of light.

    Attributes
    ----------
    M : (n, size) float64
        Band-limited interpolation along one axis.
    r : (n^2,) float64
        The points' distances from the centre, in pixels.
    order : (n^2,) int
        The points by their distance.
    rising : (n^2,) float64
        The distances in that order.
    slant : (n^2,) float64
        |cos| and |sin| of the points' directions, the smaller over the sum of both: 0 along the axes, 1/2 between them.
    side : float
        Of a point's square, in pixels.
    """

    M: Array
    r: Array
    order: Indices
    rising: Array
    slant: Array
    side: float

    def within(self, radius_px: float) -> Array:
        """What each sample (size, size) adds to the light inside a circle."""
        share = (self.r < radius_px).astype(np.float64)
        rim = np.abs(self.r - radius_px) < 2 * self.side
        share[rim] = self.covered(radius_px, self.r[rim], self.slant[rim])[1]
        return np.asarray(self.M.T @ (share / FINE**2).reshape(len(self.M), len(self.M)) @ self.M)

    def covered(self, radius_px: float, r: Array, slant: Array) -> Array:
        """Shares of the squares at distances r (b,) that count as inside three circles, (3, b): one smaller than the
        radius by a square's side, its own, one larger.

        Squares that a line covers in part blur the circle by a square's side, whose variance is side^2 / 12: half of it
        times the second difference is taken away. A line covers a square as far as the integral of a trapezium, the
        square's shadow along the line.
        """
        away = (radius_px - r) / self.side + np.arange(-2, 3)[:, None]
        across = np.clip(away * np.hypot(slant, 1 - slant), -0.5, 0.5)
        beyond = np.maximum(np.abs(across) - (0.5 - slant), 0.0)  # the flat top
        share = 0.5 + (across - np.sign(across) * beyond * beyond / (2 * np.maximum(slant, 1e-9))) / (1 - slant)
        return np.asarray(share[1:4] - (share[2:] - 2 * share[1:4] + share[:3]) / 24)


@lru_cache(maxsize=8)
def _fine_grid(size: int, s: int) -> _FineGrid:
    """The grid of an image (size, size)."""
    t = (np.arange(FINE * (size - 1) + 1) - FINE * (size // 2)) / FINE
    r = np.hypot(t, t[:, None]).ravel() / s
    order = np.argsort(r, kind="stable")
    x, y = np.abs(t), np.abs(t[:, None])
    slant = (np.minimum(x, y) / np.maximum(x + y, 1e-9)).ravel()
    M = np.sinc(t[:, None] - (np.arange(size) - size // 2))
    return _FineGrid(M, r, order, r[order], slant, 1 / (FINE * s))


@dataclass(frozen=True)
class Circle:
    """The circle about the marks' centre within which a share of all light lies; NaN where there is none.

    Attributes
    ----------
    radius : float
        In pixels.
    density : float
        By how much the share grows with the radius, per pixel.
    size : int
        Side of the central square of samples that it was found by.
    """

    radius: float
    density: float
    size: int


def circle(psf: Psf, image: Array, share: float) -> Circle:
    """The circle of a share of all light of the band-limited PSF, whose `extended()` image is given.

    Most circles lie inside the support: the far samples are only looked at where they must be.
    """
    near = _circle(psf, image, min(psf.k + 2 * AROUND, len(image)), share)
    return near if np.isfinite(near.radius) or near.size == len(image) else _circle(psf, image, len(image), share)


def _circle(psf: Psf, image: Array, size: int, share: float) -> Circle:
    """The same by the central samples of the image alone."""
    rim, grid = (len(image) - size) // 2, _fine_grid(size, psf.s)
    fine = grid.M @ image[rim : len(image) - rim, rim : len(image) - rim] @ grid.M.T
    light = fine.ravel()[grid.order] / (FINE**2 * psf.light)
    r, slant, side = grid.rising, grid.slant[grid.order], grid.side
    running = np.cumsum(light[: np.searchsorted(r, (size // 2) / psf.s)])
    if not len(running) or running.max() < share or running[0] >= share:
        return Circle(np.nan, np.nan, size)
    radius, density = float(r[np.argmax(running >= share)]), 1.0
    for _ in range(6):  # Newton's steps on the smooth sum
        first, last = np.searchsorted(r, (radius - 3 * side, radius + 3 * side)).tolist()
        near, places = light[first:last], (r[first:last], slant[first:last])
        # between circles two sides apart: the points of one side alone are too few, and 15 % off
        inner, own, outer = (grid.covered(radius, *places) @ near).tolist()
        inside, density = float(light[:first].sum()) + own, (outer - inner) / (2 * side)
        step = (share - inside) / density
        radius += step
        if abs(step) < 1e-9:
            break
    return Circle(radius, density, size)


def name_of_circle(share: float) -> str:
    """The name of the radius of a share of all light."""
    return f"encircled_energy_{share * 100:.0f}"


def _encircled(psf: Psf) -> list[DrawnNumber]:
    """Radii about the marks' centre within which shares of all light lie, of the band-limited PSF."""
    image, found = psf.extended(), []
    for share in CIRCLES:
        one, by_image = circle(psf, image, share), np.zeros_like(image)
        gradient = np.full(len(psf.parameters), np.nan)
        if np.isfinite(one.radius):
            rim = (len(image) - one.size) // 2
            within = _fine_grid(one.size, psf.s).within(one.radius)
            by_image[rim : len(image) - rim, rim : len(image) - rim] = within
            gradient = (share * psf.weights - psf.contract(by_image)) / psf.light / one.density
        found.append(
            DrawnNumber(name_of_circle(share), one.radius, "pixel", f"radius of {share:.0%} of all light", gradient)
        )
    return found


def _moment_weight(psf: Psf) -> Array:
    """Gaussian weight (k^2,) as wide as the PSF's core: without it the far samples' noise rules the moments."""
    middle = psf.k // 2
    core = _widths(np.stack([psf.h[middle], psf.h[:, middle]]), psf.s)
    sigma = 1.5 * float(np.nanmean(core)) / 2.355 if np.isfinite(core).any() else psf.k / (4 * psf.s)
    x = psf.offsets_px
    return np.asarray(np.exp(-(x**2 + (x**2)[:, None]) / (2 * sigma**2)).ravel())


def _ellipse_numbers(psf: Psf) -> list[DrawnNumber]:
    """Ellipticity 1 - b/a, and the major axis' angle, of the second moments under a Gaussian weight."""
    x, y = np.tile(psf.offsets_px, psf.k), np.repeat(psf.offsets_px, psf.k)
    w = _moment_weight(psf)
    monomials = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y]) * w[:, None]
    value, slope = _ellipse(psf.h.ravel() @ monomials)
    gradients = np.zeros((2, len(psf.parameters)))
    gradients[:, : psf.k**2] = slope @ monomials.T
    method = "weighted second moments"
    return [
        DrawnNumber(ELLIPTICITY, float(value[0]), "1", f"1 - b/a of {method}", gradients[0]),
        DrawnNumber(ELLIPSE_ANGLE, float(value[1]), "degree", "major axis, from x towards y", gradients[1]),
    ]


def _ellipse(sums: Array) -> tuple[Array, Array]:
    """Ellipticity and angle in degrees (2,) of weighted sums of 1, x, y, xx, xy, yy, and their derivative (2, 6)."""
    total = sums[0]
    cx, cy, mxx, mxy, myy = sums[1:] / total
    xx, xy, yy = mxx - cx * cx, mxy - cx * cy, myy - cy * cy
    half, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    minor, major = half - spread, half + spread
    if not (minor > 0 and spread > 0):
        return np.full(2, np.nan), np.full((2, 6), np.nan)
    # by the central moments first: half and spread, then minor and major
    of_spread = np.array([(xx - yy) / 4, xy, (yy - xx) / 4]) / spread
    of_half = np.array([0.5, 0.0, 0.5])
    flat = -np.sqrt(minor / major) / 2 * ((of_half - of_spread) / minor - (of_half + of_spread) / major)
    turn = np.degrees(np.array([-xy / 2, (xx - yy) / 2, xy / 2]) / (2 * spread**2))
    central = np.array(
        [
            [2 * cx * cx - mxx, -2 * cx, 0, 1, 0, 0],
            [2 * cx * cy - mxy, -cy, -cx, 0, 1, 0],
            [2 * cy * cy - myy, 0, -2 * cy, 0, 0, 1],
        ]
    )
    value = np.array([1 - np.sqrt(minor / major), np.degrees(np.arctan2(2 * xy, xx - yy) / 2)])
    return value, np.stack([flat, turn]) @ central / total
