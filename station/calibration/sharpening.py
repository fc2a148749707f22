"""How photographs of one scene can be sharpened: by their number, apertures, and the difference of their blurs."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.fft import rfft2

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter
from procedures.raw import RawFrame

FIELD, FINER, DEFOCUS, SHAKEN = "field", "finer", "defocus", "shaken"
WAYS = {
    FIELD: "one photograph through the PSF field of its lens",
    FINER: "several photographs through the PSF field, on a finer grid",
    DEFOCUS: "photographs at several apertures",
    SHAKEN: "photographs with different motion blur",
}
SAME_APERTURE = 0.06
"""Relative difference of f-numbers within which they are one: a third of a stop is 0.12."""
SIDE = 512
BANDS, SECTORS = (0.04, 0.08, 0.12, 0.16, 0.2, 0.25), 8
"""Edges of bands of frequencies in cycles/pixel, and number of directions, in which spectra are compared."""
UNLIKE = 0.25
"""Difference of the logarithms of two spectra, root mean square over bands, from which blurs differ: up to 0.1 for
photographs that are moved, 0.7 and more for discs of radius 1.5 and 2.5 pixels."""
TURNED = 0.08
"""Mean of that difference above which it shows which photograph is the softer one."""
DIRECTED = 0.45
"""Part of that difference which depends on the direction, from which it is motion: 0.02 to 0.3 of two
apertures, 0.6 to 1 of motions."""


def choose(
    frames: Sequence[RawFrame], *, field_given: bool, ratio: Sequence[float], way: str | None
) -> tuple[str, tuple[str, ...], Mapping[str, Any]]:
    """The way to sharpen these photographs, the reasons, and settings that follow from the photographs. Raises
    BadParameter if the photographs are not sufficient for it; the remedy says what is missing."""
    if len(frames) == 1:
        if not field_given:
            reason = "one photograph needs the PSF field of its lens"
            raise BadParameter(reason, "give --field, or a second photograph of the scene that is blurred differently")
        return FIELD, ("there is one photograph, and the PSF field of its lens",), {}
    apertures = [frame.exposure.f_number for frame in frames]
    if way == DEFOCUS or ratio or (way is None and not field_given and _differ(apertures)):
        if way is None:
            _check_order(frames, ratio)
        listed = ", ".join(f"{one:g}" for one in ratio) or ", ".join(f"f/{one:g}" for one in apertures if one)
        words = "--ratio states that their apertures differ by " if ratio else "their apertures differ: "
        return DEFOCUS, (words + listed,), {"ratio": _ratios(apertures, ratio)}
    if way in (FIELD, FINER) and not field_given:
        raise BadParameter(f"--way {way} needs the PSF field of the lens", "give --field")
    if way in (FIELD, FINER, SHAKEN):
        return way, (f"--way {way} was given",), {}
    size, directed = max(spectral_difference(frames[0], one) for one in frames[1:])
    words = f"their spectra differ by {size:.2f} in logarithm, {directed:.0%} of it by direction"
    if size < UNLIKE:
        if field_given:
            return FINER, (f"the photographs are equally sharp: {words}",), {}
        raise BadParameter(f"the photographs are equally sharp: {words}", "give the PSF field of the lens, --field")
    if directed < DIRECTED and not field_given:
        raise BadParameter(
            f"the photographs differ by defocus: {words}; their apertures are not recorded",
            "give --ratio, the f-number of photograph 1 over that of photograph 2; or --way shaken",
        )
    return SHAKEN, (f"the photographs are blurred differently: {words}",), {}


def _check_order(frames: Sequence[RawFrame], ratio: Sequence[float]) -> None:
    """Refuse a ratio that contradicts which photograph is the softer one: it was probably inverted. Raises
    BadParameter."""
    for number, (given, frame) in enumerate(zip(ratio, frames[1:], strict=False), start=2):
        softer = -float(_spectral_change(frames[0], frame).mean())
        if abs(softer) > TURNED and given > 0 and softer * math.log(given) < 0:
            first, second = (number, 1) if softer > 0 else (1, number)
            raise BadParameter(
                f"--ratio {given:g} states that photograph {second} is blurred more, but photograph {first} is: their "
                f"spectra differ by {abs(softer):.2f} in logarithm",
                f"give --ratio {1 / given:.4g}, or the photographs in the other order; --way defocus insists",
            )


def _differ(apertures: Sequence[float | None]) -> bool:
    known = [aperture for aperture in apertures if aperture]
    return len(known) == len(apertures) and max(known) > (1 + SAME_APERTURE) * min(known)


def _ratios(apertures: Sequence[float | None], ratio: Sequence[float]) -> tuple[float, ...]:
    if ratio:
        return tuple(ratio)
    first, *others = apertures
    if not first or not all(others):
        raise BadParameter("the apertures are not recorded", "give --ratio, N1 / N2 of the f-numbers")
    return tuple(first / other for other in others if other)


def spectral_difference(one: RawFrame, other: RawFrame) -> tuple[float, float]:
    """Difference of two photographs' spectra in logarithm, root mean square, and the part of it by direction."""
    difference = _spectral_change(one, other)
    by_direction = difference - difference.mean(axis=1, keepdims=True)
    size = math.sqrt(float(np.mean(difference**2)))
    return size, math.sqrt(float(np.mean(by_direction**2))) / max(size, 1e-9)


def _spectral_change(one: RawFrame, other: RawFrame) -> Array:
    """Logarithm of the second spectrum over the first, (bands, sectors), apart from their light."""
    logs = [np.log(band_powers(_centre(frame))) / 2 for frame in (one, other)]
    change = logs[1] - logs[0]
    return np.asarray(change - change[0].mean())


def _centre(frame: RawFrame) -> Array:
    samples = next(iter(frame.planes.values())).samples.astype(np.float64)
    rows, columns = samples.shape
    y, x = max((rows - SIDE) // 2, 0), max((columns - SIDE) // 2, 0)
    return np.asarray(samples[y : y + SIDE, x : x + SIDE])


def band_powers(picture: Array) -> Array:
    """Mean power (bands, sectors) of a picture, windowed, noise subtracted as found at the highest frequencies."""
    rows, columns = picture.shape
    window = np.hanning(rows)[:, None] * np.hanning(columns)
    spectrum = np.abs(rfft2((picture - picture.mean()) * window)) ** 2
    fy, fx = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)
    radius, sector = np.hypot(fx, fy), ((np.arctan2(fy, fx) / np.pi + 0.5) * SECTORS).astype(int) % SECTORS
    noise = float(np.median(spectrum[radius > 0.45])) / math.log(2)  # of an exponential distribution
    powers = np.empty((len(BANDS) - 1, SECTORS))
    for band, (low, high) in enumerate(pairwise(BANDS)):
        for at in range(SECTORS):
            inside = spectrum[(radius >= low) & (radius < high) & (sector == at)]
            powers[band, at] = max(float(inside.mean()) - noise, 0.1 * noise, 1e-12) if inside.size else noise
    return powers
