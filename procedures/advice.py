"""Advice on light and exposure for every procedure, as pure functions of levels."""

import math
from dataclasses import asdict

import numpy as np

from procedures.clipping import NOMINAL
from procedures.plan import Advice, CameraFacts, Fact, Reading
from procedures.raw import Exposure, Plane

WHITE, DARKEST, BRIGHTEST = 0.8, 0.55, 0.9  # target of white on the sensor's scale, and the accepted range
MOST_CLIPPED = 0.005  # accepted fraction of clipped samples: glints, dust, hot pixels
BASE_ISO = 100.0
LONGEST_S = 2.0  # longest proposed exposure time; beyond it, more light is proposed
TILES = 64  # tiles along the frame's longer side in which the brightest paper is searched for


def nominal_times_s() -> list[float]:
    """Nominal exposure times of cameras: thirds of stops from 30 s to 1/8000 s."""
    whole = [30, 15, 8, 4, 2, 1, 1 / 2, 1 / 4, 1 / 8, 1 / 15, 1 / 30, 1 / 60, 1 / 125, 1 / 250, 1 / 500, 1 / 1000]
    whole += [1 / 2000, 1 / 4000]
    thirds = [25, 20, 13, 10, 6, 5, 3.2, 2.5, 1.6, 1.3, 0.8, 0.6, 0.4, 0.3, 1 / 5, 1 / 6, 1 / 10, 1 / 13, 1 / 20]
    thirds += [1 / 25, 1 / 40, 1 / 50, 1 / 80, 1 / 100, 1 / 160, 1 / 200, 1 / 320, 1 / 400, 1 / 640, 1 / 800]
    thirds += [1 / 1250, 1 / 1600, 1 / 2500, 1 / 3200, 1 / 5000, 1 / 6400, 1 / 8000]
    return sorted([*whole, *thirds])


def time_words(seconds: float) -> str:
    """An exposure time as displayed by cameras: 1/50 s, 0.4 s, 2 s."""
    return f"{seconds:.2g} s" if seconds >= 0.29 else f"1/{round(1 / seconds)} s"


def paper_level(plane: Plane) -> tuple[float, float]:
    """Level of the brightest tile of a frame without a chart, and its clipped fraction."""
    rows, columns = plane.samples.shape
    side = max(1, max(rows, columns) // TILES)
    cropped = plane.samples[: rows // side * side, : columns // side * side]
    tiles = cropped.reshape(rows // side, side, columns // side, side).swapaxes(1, 2).reshape(-1, side * side)
    tile = tiles[int(np.argmax(np.median(tiles, axis=1)))]
    return float(np.median(tile)), float(np.mean(tile >= NOMINAL))


def exposure_advice(level: float, clipped: float, exposure: Exposure, subject: str = "White") -> Advice:
    """Advice on the exposure for white at 80 % of the scale.

    level : of white in the brightest plane, 1 at saturation
    clipped : fraction of its samples at saturation
    subject : name of what is exposed for
    """
    readings = (
        Reading(subject.lower(), 100 * level, "%", 100 * DARKEST, 100 * BRIGHTEST),
        Reading("clipped", 100 * clipped, "%", None, 100 * MOST_CLIPPED),
    )
    if clipped > MOST_CLIPPED:
        return change_exposure(-1.0, f"{subject} is clipped", exposure.exposure_s, readings)
    if level > BRIGHTEST or level < DARKEST:
        word = "too bright" if level > BRIGHTEST else "too dark"
        change = math.log2(WHITE / max(level, 1e-3))
        finding = f"{subject} is {word}, at {100 * level:.0f} % of the scale"
        return change_exposure(change, finding, exposure.exposure_s, readings)
    if exposure.iso is not None and exposure.iso > 1.5 * BASE_ISO:
        return _lower_iso(level, exposure, readings, subject)
    return Advice(
        True, f"{subject} is at {100 * level:.0f} % of the scale; nothing is clipped.", readings, facts=_noted(exposure)
    )


def change_exposure(
    stops: float, finding: str, seconds: float | None, readings: tuple[Reading, ...], longest_s: float = LONGEST_S
) -> Advice:
    """Advice to change the exposure by this number of stops, in nominal times."""
    if seconds is None:
        more = "more" if stops > 0 else "less"
        say = f"{finding}: expose {abs(stops):.1f} stops {more}."
        return Advice(False, say, readings, by_hand={"exposure_ev": stops})
    proposed = min(nominal_times_s(), key=lambda t: abs(math.log2(t / seconds) - stops))
    if proposed > longest_s and stops > 0:
        return Advice(False, f"{finding}: increase the light to {2**stops:.1g} times as much.", readings)
    say = f"{finding}: set the exposure time from {time_words(seconds)} to {time_words(proposed)}."
    return Advice(False, say, readings, by_hand={"exposure_ev": math.log2(proposed / seconds)})


def _lower_iso(level: float, exposure: Exposure, readings: tuple[Reading, ...], subject: str) -> Advice:
    """Advice to set the base ISO, unless the exposure time becomes too long."""
    assert exposure.iso is not None
    factor = exposure.iso / BASE_ISO
    if exposure.exposure_s is None or exposure.exposure_s * factor > LONGEST_S:
        say = f"{subject} is at {100 * level:.0f} % of the scale; at ISO {exposure.iso:g} more shots will be needed."
        return Advice(True, say, readings, facts=_noted(exposure))
    seconds = exposure.exposure_s * factor * WHITE / level
    proposed = min(nominal_times_s(), key=lambda t: abs(math.log2(t / seconds)))
    say = f"Set ISO {BASE_ISO:g} and the exposure time to {time_words(proposed)} for less noise."
    change = math.log2(proposed / exposure.exposure_s)
    return Advice(False, say, readings, by_hand={"exposure_ev": change, "iso_ev": -math.log2(factor)})


def _noted(exposure: Exposure) -> dict[str, Fact]:
    names = ("camera", "lens", "exposure_s", "iso", "f_number", "focal_length_mm", "pixel_pitch_um")
    metadata = asdict(exposure)
    return {name: metadata[name] for name in names if metadata[name] is not None}


def changed_settings(exposure: Exposure, known: CameraFacts) -> str:
    """The first camera setting that differs from the accepted trial frame, or ""."""
    settings = (
        ("exposure time", " s", known.exposure_s, exposure.exposure_s),
        ("ISO", "", known.iso, exposure.iso),
        ("aperture f/", "", known.f_number, exposure.f_number),
    )
    for words, unit, before, now in settings:
        if before is not None and now is not None and abs(math.log2(now / before)) > 0.1:
            return f"the {words} is {now:g}{unit} instead of {before:g}{unit}"
    return ""
