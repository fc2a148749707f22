"""Whether what was typed about lens, sensor and print can be true: held against laser, rail, tape and the chart. Pure.

A chart of known size tells its distance z by px = F cell / z. Looks from two places of the rail, or two readings of the
laser, tell F cell without any number that was typed: 1 / px grows by dz / (F cell).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from procedures.numerics.warps import apply_homography, inverse
from procedures.pattern import CELLS, DEFAULT_SEED
from procedures.pattern_psf.chart_finding.detection import ChartSighting
from procedures.pattern_psf.distance.ranging import APART, LASER_REACH_MM
from procedures.pattern_psf.facts import PatternFacts, RangeLook, chart_of
from procedures.pattern_psf.pose import Optics
from procedures.plan import Advice
from procedures.raw import Exposure, Plane
from procedures.reading.exposure import TYPED, disagreements

Array = npt.NDArray[np.float64]

WRONG = 1.12
"""Factor between two ways to tell F cell, from which a number is wrong: focus, marks and mounts make 5 % together."""
TAPE_MM = 50.0
"""How well a distance is taken from the lens by tape, beside the factor `WRONG`."""
PROBE = 0.08
"""Of the distance: a move between two looks that tells F cell."""
ALIKE = 0.12
"""Correlation with the cells of the right seed, at least; others reach some hundredths."""
DETAIL = 0.04
"""Contrast of detail within the noise region, over that of white and black, from which cells are seen at all."""
SHIFT_PX, SMOOTH_PX, FINE = 3, 3.0, 4


# --- sizes -------------------------------------------------------------------------------------------------------


def measured_scale(looks: Sequence[RangeLook]) -> tuple[float, str] | None:
    """F cell in pixels times millimetres by rail or laser, and by which; None from hardly one distance."""
    ways = {
        "rail's travel": [(one.px_per_cell, one.rail_mm) for one in looks if one.rail_mm is not None],
        "laser's readings": [(one.px_per_cell, one.laser_mm) for one in looks if one.laser_mm is not None],
    }
    for words, pairs in ways.items():
        if len(pairs) < 2:
            continue
        px, place = np.array(pairs, dtype=np.float64).T
        if np.ptp(px) >= APART * px.mean() and np.ptp(place) > 0:
            slope = float(np.polyfit(place, 1 / px, 1)[0])
            if slope > 0:
                return 1 / slope, words
    return None


def size_contradiction(look: RangeLook, optics: Optics, known: PatternFacts, exposure: Exposure) -> Advice | None:
    """Which typed numbers contradict laser, rail or tape, and what each would have to be; None where none does."""
    suspects = _suspects(known, exposure)
    if known.insisted.issuperset(suspects):
        return None
    z = optics.distance_mm(look.px_per_cell)
    told = _evidence(look, z, known)
    if told is None:
        return None
    found, true_mm = told
    factor = z / true_mm
    fits = ", or ".join(f"{words} {value:.3g} {unit}" for words, unit, value in _fitting(suspects, known, factor))
    say = (
        f"{found} the chart is {true_mm / 1000:.2f} m away, by its size and the numbers given {z / 1000:.2f} m. "
        f"One of them is wrong: it would fit with about {fits}."
    )
    typed = {"focal_length_mm": known.focal_length_mm, "pixel_pitch_um": known.pixel_pitch_um}
    say += "".join(f" And {words}." for words in disagreements(exposure, typed))
    return Advice(False, say, contradictory=suspects)


def _evidence(look: RangeLook, z: float, known: PatternFacts) -> tuple[str, float] | None:
    """What tells another distance than the chart's size, and which; None where nothing does."""
    measured = measured_scale((*known.looks, look))
    if measured is not None:
        true_mm = measured[0] / look.px_per_cell
        return (f"By the {measured[1]}", true_mm) if not 1 / WRONG < z / true_mm < WRONG else None
    if look.laser_mm is not None:
        return ("By the laser", look.laser_mm) if abs(look.laser_mm - z) > LASER_REACH_MM else None
    if known.tape_mm is not None and not known.looks and look.rail_mm is None:
        far_off = abs(known.tape_mm - z) > (WRONG - 1) * known.tape_mm + TAPE_MM
        return ("By the tape measure", known.tape_mm) if far_off else None
    return None


def _suspects(known: PatternFacts, exposure: Exposure) -> tuple[str, ...]:
    """The typed numbers that the camera's notes do not vouch for."""
    values = {
        "focal_length_mm": (known.focal_length_mm, exposure.focal_length_mm),
        "pixel_pitch_um": (known.pixel_pitch_um, exposure.pixel_pitch_um),
        "chart_width_mm": (known.chart_width_mm, None),
        "ruler_mm": (known.ruler_mm, None),
    }
    return tuple(
        name
        for name, (given, noted) in values.items()
        if given is not None and not (noted is not None and abs(given / noted - 1) <= TYPED[name][2])
    )


def _fitting(names: Sequence[str], known: PatternFacts, factor: float) -> list[tuple[str, str, float]]:
    """What each of these would have to be, the others being right."""
    values = {
        "focal_length_mm": ("a focal length of", "mm", known.focal_length_mm, 1 / factor),
        "pixel_pitch_um": ("a pixel pitch of", "µm", known.pixel_pitch_um, factor),
        "chart_width_mm": ("a chart as wide as", "mm", known.chart_width_mm, 1 / factor),
        "ruler_mm": ("a ruler that measures", "mm", known.ruler_mm, 1 / factor),
    }
    chosen = [values[name] for name in names]
    return [(words, unit, value * change) for words, unit, value, change in chosen if value is not None]


def cautious_mm(change: float, look: RangeLook, z: float, known: PatternFacts) -> float:
    """A move along the axis, no farther than a sixth of the distance while nothing vouches for the lens's numbers."""
    if look.laser_mm is not None or look.rail_mm is None or measured_scale((*known.looks, look)) is not None:
        return change
    return float(np.clip(change, -2 * PROBE * z, 2 * PROBE * z))


def probe_mm(look: RangeLook, z: float, closer: bool, known: PatternFacts) -> float:
    """A move along the axis after which rail or laser tell F cell; 0 where they do already, or there are none."""
    if (look.laser_mm is None and look.rail_mm is None) or measured_scale((*known.looks, look)) is not None:
        return 0.0
    move, rail = -PROBE * z if closer else PROBE * z, known.axes.get("z_mm")
    if rail is None or rail.at is None or rail.holds(rail.at + move):
        return move
    return -move if rail.holds(rail.at - move) else 0.0


# --- cells -------------------------------------------------------------------------------------------------------


def seed_contradiction(plane: Plane, sighting: ChartSighting, known: PatternFacts) -> Advice | float | None:
    """How well the cells agree with the seed's; an advice where they are others, None where none can be seen."""
    if "chart_seed" in known.insisted:
        return None
    found = cells_alike(plane, sighting, known.chart_seed)
    if found is None or found >= ALIKE:
        return found
    say = f"The chart shows other cells than those of its number {known.chart_seed}"
    own = cells_alike(plane, sighting, DEFAULT_SEED) or 0.0
    if known.chart_seed != DEFAULT_SEED and own >= ALIKE:
        say += f"; they are those of {DEFAULT_SEED}"
    say += ". Give the number that is printed on it, or hang the right chart."
    return Advice(False, say, contradictory=("chart_seed",))


def cells_alike(plane: Plane, sighting: ChartSighting, seed: int) -> float | None:
    """Correlation of the noise region with a seed's cells, the best of small shifts; None where it has no detail."""
    x, y, columns, rows = _inside(sighting, plane)
    if min(columns, rows) < 8 * SHIFT_PX:
        return None
    seen = plane.samples[y : y + rows, x : x + columns].astype(np.float32)
    fine = _fine(seen)
    if float(fine.std()) < DETAIL * float(np.ptp(np.percentile(plane.samples, (1, 99)))):
        return None
    expected = _fine(_drawn(sighting, seed, (x, y, columns, rows)))
    inner = expected[SHIFT_PX:-SHIFT_PX, SHIFT_PX:-SHIFT_PX]
    return float(cv2.matchTemplate(fine, inner, cv2.TM_CCOEFF_NORMED).max())


def _inside(sighting: ChartSighting, plane: Plane) -> tuple[int, int, int, int]:
    """The middle three quarters of the noise region: first pixel (x, y), columns and rows."""
    rim = CELLS / 8
    corners = np.array([[rim, rim], [CELLS - rim, rim], [CELLS - rim, CELLS - rim], [rim, CELLS - rim]])
    points = apply_homography(sighting.H_sensor_pattern, corners)
    low, high = np.maximum(np.ceil(points.min(axis=0)), 0).astype(int), np.floor(points.max(axis=0)).astype(int)
    x, y = int(low[0]), int(low[1])
    return x, y, int(min(high[0], plane.samples.shape[1])) - x, int(min(high[1], plane.samples.shape[0])) - y


def _drawn(sighting: ChartSighting, seed: int, box: tuple[int, int, int, int]) -> npt.NDArray[np.float32]:
    """The cells as the box's pixels see them, each the mean of FINE x FINE points."""
    x, y, columns, rows = box
    part = (np.arange(FINE) + 0.5) / FINE - 0.5
    u, v = (start + (np.arange(n)[:, None] + part).ravel() for start, n in ((x, columns), (y, rows)))
    points = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    at = np.clip(np.floor(apply_homography(inverse(sighting.H_sensor_pattern), points)), 0, CELLS - 1).astype(int)
    drawn = chart_of(seed).cells[at[:, 1], at[:, 0]].reshape(rows, FINE, columns, FINE).mean(axis=(1, 3))
    return np.asarray(drawn, dtype=np.float32)


def _fine(picture: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """What varies within a few pixels."""
    return np.asarray(picture - cv2.GaussianBlur(picture, (0, 0), SMOOTH_PX), dtype=np.float32)
