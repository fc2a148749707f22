"""Damaged copies of a photograph: faults of the chart, of the optics and of a camera's processing.

Photographs are from black 0 to white 1; a damaged copy keeps its photograph's scale and is clipped to it.
"""

from collections.abc import Callable, Iterator

import cv2
import numpy as np

Array = np.ndarray
Change = Callable[[Array], Array]


def _places(x: Array) -> tuple[Array, Array]:
    """Columns and rows of the samples."""
    rows, columns = np.indices(x.shape)
    return columns, rows


def soft(x: Array, sigma_px: float) -> Array:
    return cv2.GaussianBlur(x, (0, 0), sigma_px)


def banding(share: float, period_px: float) -> Change:
    return lambda x: x * (1 + share * np.sin(2 * np.pi * _places(x)[1] / period_px))


def flicker(share: float) -> Change:
    """Every row with light of its own."""
    return lambda x: x * (1 + share * np.random.default_rng(1).standard_normal(len(x))[:, None])


def falling(share: float) -> Change:
    """From one side to the other."""
    return lambda x: x * (1 + share * (_places(x)[0] / x.shape[1] - 0.5))


def gloss(radius_px: float, strength: float) -> Change:
    """A soft reflection, added."""

    def change(x: Array) -> Array:
        columns, rows = _places(x)
        away = (columns - 0.55 * x.shape[1]) ** 2 + (rows - 0.45 * x.shape[0]) ** 2
        return x + strength * (1 - x) * np.exp(-away / (2 * radius_px**2))

    return change


def shadow(share: float) -> Change:
    """Shape of an edge across the chart."""
    return lambda x: np.where(np.subtract(*_places(x)) > 20, x * (1 - share), x)


def finger(radius_px: float, level: float) -> Change:
    """A disc of one level, of the mean's, before the lower right of the chart."""

    def change(x: Array) -> Array:
        columns, rows = _places(x)
        inside = (columns - 0.6 * x.shape[1]) ** 2 + (rows - 0.65 * x.shape[0]) ** 2 < radius_px**2
        return np.where(inside, level * x.mean(), x)

    return change


def toner(count: int, radius_px: float) -> Change:
    """Black specks over the noise region."""

    def change(x: Array) -> Array:
        rng, damaged = np.random.default_rng(count), x.copy()
        columns, rows = _places(x)
        for _ in range(count):
            at = rng.uniform(0.3, 0.7, 2) * x.shape[::-1]
            damaged[(columns - at[0]) ** 2 + (rows - at[1]) ** 2 < radius_px**2] = np.percentile(x, 2)
        return damaged

    return change


def curl(most_px: float) -> Change:
    """Waves of the sheet, sideways."""

    def change(x: Array) -> Array:
        columns, rows = (one.astype(np.float32) for one in _places(x))
        moved = columns + most_px * np.sin(2 * np.pi * rows / 90).astype(np.float32)
        return cv2.remap(x.astype(np.float32), moved, rows, cv2.INTER_CUBIC).astype(np.float64)

    return change


def part_defocused(part: str, sigma_px: float) -> Change:
    def change(x: Array) -> Array:
        columns, rows = _places(x)
        left, bottom = columns < x.shape[1] / 2, rows > x.shape[0] / 2
        where = {"half": left, "bottom": bottom, "quarter": ~left & bottom}[part]
        return np.where(where, soft(x, sigma_px), x)

    return change


def jpeg(quality: int) -> Change:
    def change(x: Array) -> Array:
        levels = np.round(255 * np.clip(x, 0, 1)).astype(np.uint8)
        _, coded = cv2.imencode(".jpg", levels, [cv2.IMWRITE_JPEG_QUALITY, quality])
        return cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE) / 255.0

    return change


def sharpened(amount: float, sigma_px: float) -> Change:
    """By an unsharp mask."""
    return lambda x: x + amount * (x - soft(x, sigma_px))


def curved(gamma: float) -> Change:
    return lambda x: np.clip(x, 0, 1) ** gamma


def picture(quality: int, amount: float) -> Change:
    """Processing of a camera's JPEG: tone curve, sharpening, compression."""
    return lambda x: jpeg(quality)(sharpened(amount, 1.0)(curved(1 / 2.2)(x)))


def _range(x: Array) -> tuple[float, float]:
    """Black and white, about."""
    low, high = np.quantile(x, (0.05, 0.97))
    return float(low), float(high)


def crushed(share: float) -> Change:
    """A black level set too high, by a share of the contrast."""

    def change(x: Array) -> Array:
        low, high = _range(x)
        return np.maximum(x - (low + share * (high - low)), 0)

    return change


def floored(share: float) -> Change:
    def change(x: Array) -> Array:
        low, high = _range(x)
        return np.maximum(x, low + share * (high - low))

    return change


def clipped(share: float) -> Change:
    def change(x: Array) -> Array:
        low, high = _range(x)
        return np.minimum(x, high - share * (high - low))

    return change


def demosaiced(period: int) -> Change:
    """Green as of a Bayer mosaic (period 2: every other sample is the mean of its four neighbours) or red (1 in 4)."""

    def change(x: Array) -> Array:
        if period == 2:
            cross = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4
            return np.where(sum(_places(x)) % 2, cv2.filter2D(x, -1, cross), x)
        kept = np.zeros_like(x)
        kept[::2, ::2] = x[::2, ::2]
        return cv2.filter2D(kept, -1, np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4)

    return change


def denoised(kind: str) -> Change:
    def change(x: Array) -> Array:
        single = x.astype(np.float32)
        return (cv2.medianBlur(single, 3) if kind == "median" else cv2.bilateralFilter(single, 5, 0.05, 1.5)) * 1.0

    return change


def halved(x: Array) -> Array:
    """Reduced to half the size and enlarged again."""
    small = cv2.resize(x, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return cv2.resize(small, x.shape[::-1], interpolation=cv2.INTER_CUBIC)


def turned(degrees: float) -> Change:
    """By a program that straightens horizons: between the samples along lines."""

    def change(x: Array) -> Array:
        M = cv2.getRotationMatrix2D((x.shape[1] / 2, x.shape[0] / 2), degrees, 1.0)
        return cv2.warpAffine(x, M, x.shape[::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    return change


def noisy(sigma: float) -> Change:
    return lambda x: x + np.random.default_rng(2).normal(0, sigma, x.shape)


def rounded(levels: int) -> Change:
    return lambda x: np.round(x * levels) / levels


def _all() -> Iterator[tuple[str, Change]]:
    for share in (0.005, 0.01, 0.02, 0.05, 0.1):
        yield from ((f"banding {share} every {p} px", banding(share, p)) for p in (3.3, 8, 25))
        yield f"flicker {share}", flicker(share)
    yield from ((f"light falling by {share}", falling(share)) for share in (0.05, 0.1, 0.2, 0.4))
    for r in (5, 10, 20, 35):
        yield from ((f"gloss {v}, {r} px", gloss(r, v)) for v in (0.3, 0.6, 1.0))
        yield from ((f"finger {v}, {r} px", finger(r, v)) for v in (0.1, 0.3))
    yield from ((f"shadow {share}", shadow(share)) for share in (0.1, 0.3))
    for count in (5, 20, 80):
        yield from ((f"toner {count} of {r} px", toner(count, r)) for r in (1.0, 2.0, 4.0))
    yield from ((f"curl {a} px", curl(a)) for a in (0.3, 0.6, 1.0, 1.5))
    for sigma in (0.3, 0.4, 0.5, 0.7, 1.0):
        yield from (
            (f"{part} defocused {sigma}", part_defocused(part, sigma)) for part in ("half", "bottom", "quarter")
        )
    yield from ((f"JPEG {q}", jpeg(q)) for q in (50, 70, 80, 85, 90, 95, 98))
    yield from ((f"sharpened {a}, {r} px", sharpened(a, r)) for a in (0.2, 0.5, 1.0, 2.0) for r in (0.6, 1.0, 2.0))
    yield from ((f"gamma {g}", curved(g)) for g in (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.2, 1.4, 1.8, 2.2))
    yield from ((f"camera's JPEG {q}, sharpened {a}", picture(q, a)) for q in (85, 92) for a in (0.3, 1.0))
    for share in (0.02, 0.05, 0.1, 0.2, 0.3):
        yield f"black crushed {share}", crushed(share)
        yield f"black floored {share}", floored(share)
        yield f"white clipped {share}", clipped(share)
    yield from (("green demosaiced", demosaiced(2)), ("red demosaiced", demosaiced(4)))
    yield from (("median", denoised("median")), ("edges kept", denoised("bilateral")), ("halved", halved))
    yield from ((f"turned by {a} degrees", turned(a)) for a in (1.0, 3.0))
    yield from ((f"noise {sigma}", noisy(sigma)) for sigma in (0.01, 0.03))
    yield from ((f"{levels} levels", rounded(levels)) for levels in (64, 32))


CHANGES: dict[str, Change] = dict(_all())
SLIGHT: dict[str, Change] = {f"sharpened 0.1, {r} px": sharpened(0.1, r) for r in (0.6, 1.0, 2.0)}
"""Damages whose PSF a lens could have, too: no photograph of a chart distinguishes them."""


def damaged(photograph: Array, name: str) -> Array:
    """The damaged copy, float64, clipped to the scale."""
    return np.clip((CHANGES | SLIGHT)[name](np.asarray(photograph, np.float64)), 0, 1)
