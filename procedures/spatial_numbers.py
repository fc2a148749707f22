"""Spatial numbers of a PSF with their gradients: widths, encircled energy, energy above Nyquist, shape.

All refer to the band-limited PSF between its samples and to its total energy, including the tail outside the support.
Lengths are in pixels of the plane.
"""

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
from procedures.numerics.arrays import Array
from procedures.psf import Psf

Indices = npt.NDArray[np.intp]

OVERSAMPLING = 4  # points per sample of the sum inside a circle
SECTION_OVERSAMPLING = 16  # points per sample of a section whose width is measured
INNER_BAND = 0.67  # share of the band inside its outer third
CIRCLES = (0.5, 0.8)  # shares of the total energy whose radii are reported
INTERPOLATION_MARGIN = 4  # samples around the support required for interpolation


@dataclass(frozen=True)
class DrawnNumber:
    """A number derived from a PSF, with its gradient by the parameters."""

    name: str
    value: float
    unit: str
    method: str
    gradient: Array


def first_moments(psf: Psf) -> list[DrawnNumber]:
    """Centroid (x, y) over the support, from the PSF's centre."""
    x = psf.offsets_px
    return [_first_moment(psf, CENTROID_X, np.tile(x, psf.k)), _first_moment(psf, CENTROID_Y, np.repeat(x, psf.k))]


def whole_numbers(psf: Psf) -> list[DrawnNumber]:
    """Energy above Nyquist and shape, which have no origin."""
    above, slope = energy_above_nyquist(psf)
    return [DrawnNumber(ENERGY_ABOVE_NYQUIST, above, "1", "share of |OTF|^2", slope), *_ellipse_numbers(psf)]


def centred_numbers(psf: Psf) -> list[DrawnNumber]:
    """Widths of the sections through the centre, and radii of encircled energy about it."""
    image, numbers = psf.extended(), []
    for share in CIRCLES:
        one, by_image = circle(psf, image, share), np.zeros_like(image)
        gradient = np.full(len(psf.parameters), np.nan)
        if np.isfinite(one.radius):
            rim = (len(image) - one.size) // 2
            within = _fine_grid(one.size, psf.s).within(one.radius)
            by_image[rim : len(image) - rim, rim : len(image) - rim] = within
            gradient = (share * psf.weights - psf.contract(by_image)) / psf.light / one.density
        numbers.append(
            DrawnNumber(name_of_circle(share), one.radius, "pixel", f"radius of {share:.0%} of all light", gradient)
        )
    return [_width(psf, FWHM_HORIZONTAL, 1), _width(psf, FWHM_VERTICAL, 0), *numbers]


def energy_within(psf: Psf, radius_px: float) -> tuple[float, Array]:
    """Encircled energy of the band-limited PSF within a radius about the centre, and its derivative (k^2 + q,)."""
    image, light = psf.extended(), psf.light
    size = min(2 * (int(np.ceil(radius_px * psf.s)) + INTERPOLATION_MARGIN) + 1, len(image))
    rim = (len(image) - size) // 2
    by_image = np.zeros_like(image)
    by_image[rim : len(image) - rim, rim : len(image) - rim] = _fine_grid(size, psf.s).within(radius_px)
    share = float(np.sum(by_image * image)) / light
    return share, (psf.contract(by_image) - share * psf.weights) / light


def energy_above_nyquist(psf: Psf) -> tuple[float, Array]:
    """Share of |OTF|^2 outside |fx|, |fy| <= 1/2, corrected for noise, and its derivative (k^2 + q,)."""
    image = psf.extended()
    S = _band_kernel(len(image), psf.s, 0.5)
    through = S @ image @ S
    inside = float(np.sum(through * image)) - _noise_of_energy(psf, 0.5)
    whole = float(np.sum(image**2)) - _noise_of_energy(psf, psf.s / 2)
    if whole <= 0:
        return np.nan, np.full(len(psf.parameters), np.nan)
    return 1 - inside / whole, psf.contract(2 * (inside / whole * image - through) / whole)


def energy_beyond_band(psf: Psf, above: float, uncertainty: float) -> float:
    """Possible error of the energy above Nyquist by frequencies beyond the band: the energy in its outer third, as much
    may follow beyond a zero."""
    image, edge = psf.extended(), INNER_BAND * psf.s / 2
    S = _band_kernel(len(image), psf.s, edge)
    inside = float(np.sum((S @ image @ S) * image)) - _noise_of_energy(psf, edge)
    whole = float(np.sum(image**2)) - _noise_of_energy(psf, psf.s / 2)
    outer = 1 - inside / whole if whole > 0 else 0.0
    return (1 - above) * float(np.sqrt(outer**2 - uncertainty**2)) if outer > uncertainty else 0.0


def _first_moment(psf: Psf, name: str, x: Array) -> DrawnNumber:
    """First moment over the support; that of a 1/r^3 tail does not exist."""
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
    """Width along rows (axis 1) or columns (axis 0) as in `section_widths`, with its gradient."""
    middle = psf.k // 2
    profile = psf.h[middle] if axis else psf.h[:, middle]
    used = middle * psf.k + np.arange(psf.k) if axis else middle + psf.k * np.arange(psf.k)
    step = 1e-4 * max(float(np.abs(profile).max()), 1e-30)
    steps = step * np.vstack([np.zeros(psf.k), np.eye(psf.k), -np.eye(psf.k)])
    value, *changed = _widths(profile + steps, psf.s).tolist()
    gradient = np.zeros(len(psf.parameters))
    gradient[used] = (np.array(changed[: psf.k]) - changed[psf.k :]) / (2 * step)
    return DrawnNumber(name, value, "pixel", "band-limited section through the centre", gradient)


def _widths(profiles: Array, s: int) -> Array:
    """Full widths at half maximum (b,) of band-limited sections (b, k), in pixels; NaN where there is none."""
    values = profiles @ _between(profiles.shape[1])
    peak = values.argmax(axis=1)[:, None]
    below = values < np.take_along_axis(values, peak, 1) / 2
    at = np.arange(values.shape[1])
    right, left = below & (at > peak), below & (at < peak)
    exists = right.any(axis=1) & left.any(axis=1)
    high, low = right.argmax(axis=1), values.shape[1] - 1 - left[:, ::-1].argmax(axis=1)
    width = _half_maximum(values, peak, high, high - 1) - _half_maximum(values, peak, low, np.minimum(low + 1, at[-1]))
    return np.asarray(np.where(exists, width, np.nan) / (SECTION_OVERSAMPLING * s))


@lru_cache(maxsize=8)
def _between(k: int) -> Array:
    """Band-limited interpolation of k samples, `SECTION_OVERSAMPLING` points a sample: (k, n)."""
    t = np.arange((k - 1) * SECTION_OVERSAMPLING + 1) / SECTION_OVERSAMPLING
    return np.asarray(np.sinc(t - np.arange(k)[:, None]))


def _half_maximum(values: Array, peak: Indices, outer: Indices, inner: Indices) -> Array:
    """Positions where sections (b, n) fall to half of their value at `peak` (b, 1), between two samples (b,)."""
    rows = np.arange(len(values))
    half, beyond, before = values[rows, peak[:, 0]] / 2, values[rows, outer], values[rows, inner]
    with np.errstate(divide="ignore", invalid="ignore"):  # where there is no crossing
        return np.asarray(inner + (outer - inner) * (before - half) / (before - beyond))


@lru_cache(maxsize=16)
def _band_kernel(size: int, s: int, edge: float) -> Array:
    """Matrix S (size, size): S h S . h is the integral of |OTF|^2 over |fx|, |fy| <= edge (cycles/pixel)."""
    part = 2 * edge / s
    return np.asarray(part * np.sinc(part * (np.arange(size)[:, None] - np.arange(size))))


def _noise_of_energy(psf: Psf, edge: float) -> float:
    """Expected energy of the samples' noise at |fx|, |fy| <= edge."""
    noise = psf.covariance if psf.lacking is None else psf.covariance - psf.lacking
    if edge >= psf.s / 2:
        return float(np.trace(noise))
    S = _band_kernel(psf.k, psf.s, edge)
    C = noise.reshape(psf.k, psf.k, psf.k, psf.k)
    return float(np.sum(S * np.tensordot(S, C, axes=((0, 1), (0, 2)))))


@dataclass(frozen=True)
class _FineGrid:
    """Oversampled grid of an image, `OVERSAMPLING` points per sample, each representing a square.

    M : (n, size) band-limited interpolation along one axis
    r : (n^2,) distances from the centre, in pixels
    order : (n^2,) int permutation that sorts the distances
    rising : (n^2,) sorted distances
    slant : (n^2,) smaller of |cos| and |sin| of the direction over their sum: 0 along the axes, 1/2 along the diagonals
    side : side of a square, in pixels
    """

    M: Array
    r: Array
    order: Indices
    sorted_r: Array
    slant: Array
    side: float

    def within(self, radius_px: float) -> Array:
        """Contribution of each sample (size, size) to the energy inside a circle."""
        share = (self.r < radius_px).astype(np.float64)
        rim = np.abs(self.r - radius_px) < 2 * self.side
        share[rim] = self.covered(radius_px, self.r[rim], self.slant[rim])[1]
        return np.asarray(self.M.T @ (share / OVERSAMPLING**2).reshape(len(self.M), len(self.M)) @ self.M)

    def covered(self, radius_px: float, r: Array, slant: Array) -> Array:
        """Shares (3, b) of the squares at distances r (b,) inside three circles: smaller by a square's side, exact, and
        larger.

        Partly covered squares blur the circle by a square's side, of variance side^2 / 12: half of it times the second
        difference is subtracted. The covered share is the integral of a trapezium, the projection of the square.
        """
        away = (radius_px - r) / self.side + np.arange(-2, 3)[:, None]
        across = np.clip(away * np.hypot(slant, 1 - slant), -0.5, 0.5)
        beyond = np.maximum(np.abs(across) - (0.5 - slant), 0.0)  # the flat top
        share = 0.5 + (across - np.sign(across) * beyond * beyond / (2 * np.maximum(slant, 1e-9))) / (1 - slant)
        return np.asarray(share[1:4] - (share[2:] - 2 * share[1:4] + share[:3]) / 24)


@lru_cache(maxsize=8)
def _fine_grid(size: int, s: int) -> _FineGrid:
    """Oversampled grid of an image (size, size)."""
    t = (np.arange(OVERSAMPLING * (size - 1) + 1) - OVERSAMPLING * (size // 2)) / OVERSAMPLING
    r = np.hypot(t, t[:, None]).ravel() / s
    order = np.argsort(r, kind="stable")
    x, y = np.abs(t), np.abs(t[:, None])
    slant = (np.minimum(x, y) / np.maximum(x + y, 1e-9)).ravel()
    M = np.sinc(t[:, None] - (np.arange(size) - size // 2))
    return _FineGrid(M, r, order, r[order], slant, 1 / (OVERSAMPLING * s))


@dataclass(frozen=True)
class Circle:
    """Circle about the PSF's centre that encloses a share of the total energy; NaN where there is none.

    radius : radius in pixels
    density : derivative of the share by the radius, per pixel
    size : side of the central square of samples used
    """

    radius: float
    density: float
    size: int


def circle(psf: Psf, image: Array, share: float) -> Circle:
    """Circle that encloses a share of a band-limited PSF's energy, given `extended()`; far samples are used only if
    necessary."""
    near = _circle(psf, image, min(psf.k + 2 * INTERPOLATION_MARGIN, len(image)), share)
    return near if np.isfinite(near.radius) or near.size == len(image) else _circle(psf, image, len(image), share)


def _circle(psf: Psf, image: Array, size: int, share: float) -> Circle:
    """Circle from the central samples of the image alone."""
    rim, grid = (len(image) - size) // 2, _fine_grid(size, psf.s)
    fine = grid.M @ image[rim : len(image) - rim, rim : len(image) - rim] @ grid.M.T
    light = fine.ravel()[grid.order] / (OVERSAMPLING**2 * psf.light)
    r, slant, side = grid.sorted_r, grid.slant[grid.order], grid.side
    running = np.cumsum(light[: np.searchsorted(r, (size // 2) / psf.s)])
    if not len(running) or running.max() < share or running[0] >= share:
        return Circle(np.nan, np.nan, size)
    radius, density = float(r[np.argmax(running >= share)]), 1.0
    for _ in range(6):  # Newton's steps on the smooth sum
        first, last = np.searchsorted(r, (radius - 3 * side, radius + 3 * side)).tolist()
        near, places = light[first:last], (r[first:last], slant[first:last])
        # derivative over two sides: over one side the points are too few, and it errs by 15 %
        inner, exact, outer = (grid.covered(radius, *places) @ near).tolist()
        inside, density = float(light[:first].sum()) + exact, (outer - inner) / (2 * side)
        step = (share - inside) / density
        radius += step
        if abs(step) < 1e-9:
            break
    return Circle(radius, density, size)


def name_of_circle(share: float) -> str:
    """Name of the radius of a share of the total energy."""
    return f"encircled_energy_{share * 100:.0f}"


def _moment_weight(psf: Psf) -> Array:
    """Gaussian weight (k^2,) as wide as the PSF's core, without which noise of far samples dominates the moments."""
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
    """Ellipticity and angle in degrees (2,) from weighted sums of 1, x, y, xx, xy, yy, and their derivative (2, 6)."""
    total = sums[0]
    cx, cy, mxx, mxy, myy = sums[1:] / total
    xx, xy, yy = mxx - cx * cx, mxy - cx * cy, myy - cy * cy
    half, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    minor, major = half - spread, half + spread
    if not (minor > 0 and spread > 0):
        return np.full(2, np.nan), np.full((2, 6), np.nan)
    # derivatives by the central moments: half and spread, then minor and major
    spread_slope = np.array([(xx - yy) / 4, xy, (yy - xx) / 4]) / spread
    half_slope = np.array([0.5, 0.0, 0.5])
    flat = -np.sqrt(minor / major) / 2 * ((half_slope - spread_slope) / minor - (half_slope + spread_slope) / major)
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
