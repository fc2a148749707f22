"""Consistency of the typed data of lens, sensor and print with laser, rail, tape measure and chart. Pure.

The distance z of a chart of known size follows from px = F cell / z. Two positions of the rail, or two readings of the
laser, give F cell without any typed number: 1 / px grows by dz / (F cell).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from procedures.numerics.arrays import Array32
from procedures.numerics.warps import apply_homography, inverse
from procedures.pattern import CELLS, DEFAULT_SEED
from procedures.pattern_psf.chart_finding.detection import ChartSighting
from procedures.pattern_psf.distance.ranging import LASER_REACH_MM, MIN_DIFFERENCE
from procedures.pattern_psf.facts import PatternFacts, RangeLook, chart_of
from procedures.pattern_psf.pose import ImagingGeometry
from procedures.plan import Advice
from procedures.raw import Exposure, Plane
from procedures.reading.exposure import TYPED, disagreements

MAX_RATIO = 1.12
"""Ratio of two estimates of F cell above which a number is wrong; focus, marks and mounts contribute 5 % together."""
TAPE_MM = 50.0  # tolerance of a distance by tape measure, in addition to the factor `MAX_RATIO`
PROBE_SHARE = 0.08  # move between two observations that determines F cell, as a fraction of the distance
MIN_CELL_CORRELATION = 0.12  # least correlation with the cells of the right seed; that with others is a few hundredths
MIN_DETAIL = 0.04
"""Least contrast of detail in the noise region, over that of white and black, for cells to be resolved."""
SHIFT_PX, SMOOTH_PX, FINE = 3, 3.0, 4


def measured_scale(looks: Sequence[RangeLook]) -> tuple[float, str] | None:
    """F cell in pixel millimetres by rail or laser, and its source; None without two distinct distances."""
    ways = {
        "rail's travel": [(look.px_per_cell, look.rail_mm) for look in looks if look.rail_mm is not None],
        "laser's readings": [(look.px_per_cell, look.laser_mm) for look in looks if look.laser_mm is not None],
    }
    for words, pairs in ways.items():
        if len(pairs) < 2:
            continue
        px, place = np.array(pairs, dtype=np.float64).T
        if np.ptp(px) >= MIN_DIFFERENCE * px.mean() and np.ptp(place) > 0:
            slope = float(np.polyfit(place, 1 / px, 1)[0])
            if slope > 0:
                return 1 / slope, words
    return None


def size_contradiction(
    look: RangeLook, optics: ImagingGeometry, known: PatternFacts, exposure: Exposure
) -> Advice | None:
    """Advice on typed numbers that contradict laser, rail or tape, with consistent values; None where none does."""
    suspects = _suspects(known, exposure)
    if known.insisted.issuperset(suspects):
        return None
    z = optics.distance_mm(look.px_per_cell)
    evidence = _evidence(look, z, known)
    if evidence is None:
        return None
    source, true_mm = evidence
    factor = z / true_mm
    fits = ", or ".join(f"{words} {value:.3g} {unit}" for words, unit, value in _fitting(suspects, known, factor))
    say = (
        f"{source} the chart is {true_mm / 1000:.2f} m away; its size and the given numbers yield {z / 1000:.2f} m. "
        f"Correct the wrong one: consistent would be about {fits}."
    )
    typed = {"focal_length_mm": known.focal_length_mm, "pixel_pitch_um": known.pixel_pitch_um}
    say += "".join(f" And {words}." for words in disagreements(exposure, typed))
    return Advice(False, say, contradictory=suspects)


def _evidence(look: RangeLook, z: float, known: PatternFacts) -> tuple[str, float] | None:
    """Source and value of a distance that contradicts the chart's size; None where nothing does."""
    measured = measured_scale((*known.looks, look))
    if measured is not None:
        true_mm = measured[0] / look.px_per_cell
        return (f"By the {measured[1]}", true_mm) if not 1 / MAX_RATIO < z / true_mm < MAX_RATIO else None
    if look.laser_mm is not None:
        return ("By the laser", look.laser_mm) if abs(look.laser_mm - z) > LASER_REACH_MM else None
    if known.tape_mm is not None and not known.looks and look.rail_mm is None:
        far_off = abs(known.tape_mm - z) > (MAX_RATIO - 1) * known.tape_mm + TAPE_MM
        return ("By the tape measure", known.tape_mm) if far_off else None
    return None


def _suspects(known: PatternFacts, exposure: Exposure) -> tuple[str, ...]:
    values = {
        "focal_length_mm": (known.focal_length_mm, exposure.focal_length_mm),
        "pixel_pitch_um": (known.pixel_pitch_um, exposure.pixel_pitch_um),
        "chart_width_mm": (known.chart_width_mm, None),
        "ruler_mm": (known.ruler_mm, None),
    }
    return tuple(
        name
        for name, (given, recorded) in values.items()
        if given is not None and not (recorded is not None and abs(given / recorded - 1) <= TYPED[name][2])
    )


def _fitting(names: Sequence[str], known: PatternFacts, factor: float) -> list[tuple[str, str, float]]:
    """Value of each of these that would be consistent, if the others are right."""
    values = {
        "focal_length_mm": ("a focal length of", "mm", known.focal_length_mm, 1 / factor),
        "pixel_pitch_um": ("a pixel pitch of", "µm", known.pixel_pitch_um, factor),
        "chart_width_mm": ("a chart as wide as", "mm", known.chart_width_mm, 1 / factor),
        "ruler_mm": ("a ruler that measures", "mm", known.ruler_mm, 1 / factor),
    }
    chosen = [values[name] for name in names]
    return [(words, unit, value * change) for words, unit, value, change in chosen if value is not None]


def cautious_mm(change: float, look: RangeLook, z: float, known: PatternFacts) -> float:
    """Limit a move along the axis to a sixth of the distance until the lens's data are verified."""
    if look.laser_mm is not None or look.rail_mm is None or measured_scale((*known.looks, look)) is not None:
        return change
    return float(np.clip(change, -2 * PROBE_SHARE * z, 2 * PROBE_SHARE * z))


def probe_mm(look: RangeLook, z: float, closer: bool, known: PatternFacts) -> float:
    """Move along the axis after which rail or laser determine F cell; 0 where they do already, or there are none."""
    if (look.laser_mm is None and look.rail_mm is None) or measured_scale((*known.looks, look)) is not None:
        return 0.0
    move, rail = -PROBE_SHARE * z if closer else PROBE_SHARE * z, known.axes.get("z_mm")
    if rail is None or rail.at is None or rail.holds(rail.at + move):
        return move
    return -move if rail.holds(rail.at - move) else 0.0


def seed_contradiction(plane: Plane, sighting: ChartSighting, known: PatternFacts) -> Advice | float | None:
    """Correlation of the cells with the seed's; advice where the cells are others, None where they are not resolved."""
    if "chart_seed" in known.insisted:
        return None
    correlation = cell_correlation(plane, sighting, known.chart_seed)
    if correlation is None or correlation >= MIN_CELL_CORRELATION:
        return correlation
    say = f"The chart does not have the cells of number {known.chart_seed}"
    default_correlation = cell_correlation(plane, sighting, DEFAULT_SEED) or 0.0
    if known.chart_seed != DEFAULT_SEED and default_correlation >= MIN_CELL_CORRELATION:
        say += f", but those of number {DEFAULT_SEED}"
    say += ". Give the number printed on it, or mount the right chart."
    return Advice(False, say, contradictory=("chart_seed",))


def cell_correlation(plane: Plane, sighting: ChartSighting, seed: int) -> float | None:
    """Largest correlation of the noise region with a seed's cells over small shifts; None where it has no detail."""
    x, y, columns, rows = _inside(sighting, plane)
    if min(columns, rows) < 8 * SHIFT_PX:
        return None
    region = plane.samples[y : y + rows, x : x + columns].astype(np.float32)
    fine = _high_pass(region)
    if float(fine.std()) < MIN_DETAIL * float(np.ptp(np.percentile(plane.samples, (1, 99)))):
        return None
    expected = _high_pass(_expected_cells(sighting, seed, (x, y, columns, rows)))
    inner = expected[SHIFT_PX:-SHIFT_PX, SHIFT_PX:-SHIFT_PX]
    return float(cv2.matchTemplate(fine, inner, cv2.TM_CCOEFF_NORMED).max())


def _inside(sighting: ChartSighting, plane: Plane) -> tuple[int, int, int, int]:
    """Central three quarters of the noise region: first pixel (x, y), columns and rows."""
    rim = CELLS / 8
    corners = np.array([[rim, rim], [CELLS - rim, rim], [CELLS - rim, CELLS - rim], [rim, CELLS - rim]])
    points = apply_homography(sighting.H_sensor_pattern, corners)
    low, high = np.maximum(np.ceil(points.min(axis=0)), 0).astype(int), np.floor(points.max(axis=0)).astype(int)
    x, y = int(low[0]), int(low[1])
    return x, y, int(min(high[0], plane.samples.shape[1])) - x, int(min(high[1], plane.samples.shape[0])) - y


def _expected_cells(sighting: ChartSighting, seed: int, box: tuple[int, int, int, int]) -> Array32:
    """Cells imaged by the pixels of the box, each the mean of FINE x FINE points."""
    x, y, columns, rows = box
    part = (np.arange(FINE) + 0.5) / FINE - 0.5
    u, v = (start + (np.arange(n)[:, None] + part).ravel() for start, n in ((x, columns), (y, rows)))
    points = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    at = np.clip(np.floor(apply_homography(inverse(sighting.H_sensor_pattern), points)), 0, CELLS - 1).astype(int)
    cells = chart_of(seed).cells[at[:, 1], at[:, 0]].reshape(rows, FINE, columns, FINE).mean(axis=(1, 3))
    return np.asarray(cells, dtype=np.float32)


def _high_pass(picture: Array32) -> Array32:
    return np.asarray(picture - cv2.GaussianBlur(picture, (0, 0), SMOOTH_PX), dtype=np.float32)
