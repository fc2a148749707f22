"""Field, two photographs, slanted edge and single charts against one truth: a lens's whole transfer function.

At three f-numbers one lens with coma, astigmatism and field curvature is photographed by renderers that share nothing
with the estimators (tests/procedures/pattern_psf/analytic_camera.py, two_photo/endless.py, slanted_edge/analytic.py):
the scene's spectrum times the transfer function at the place in the frame, cut nowhere. Fields are the guide's usual
tour of nine charts, one a photograph; they are held against the truth at their centre, between the charts of the
sides, at their outermost charts, and in the frame's own corners, which lie beyond all charts. Two photographs and edges
see the lens as it is in the middle of the frame and at the tour's first corner.

Of each method, f-number and place: mean error of what passes, shares within two stated uncertainties.

Usage: whole_truth.py [fields of each f-number, default 4] [pairs and edges of each f-number and place, default 17]
[k of the fields, default as the charts ask]
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from procedures import Chart, Psf, Roi, estimate_edge
from procedures.field.estimate import FIELD
from procedures.field.interpolate import interpolate
from procedures.field.maps import MAPS, numbers_of, radius_direction
from procedures.field.measuring import measure_frames
from procedures.field.plan import locations
from procedures.outcome import Quantity, Verdict
from procedures.pattern_psf.outline import SHEET
from procedures.raw import Plane, RawFrame
from procedures.reading.exposure import Exposure
from procedures.two_photo.estimate import estimate_psf_of_pair as by_wall
from simulators.camera.camera import true_mtf, true_psf
from simulators.camera.optics import CircularPupil, GaussianBlur, Optics, PixelAperture
from tests.benchmarks.psf_field import F_NUMBERS, LENS, PIXELS, Place, S, ideal_field, true_numbers
from tests.procedures.pattern_psf import analytic_camera as of_chart
from tests.procedures.slanted_edge import analytic as of_edge
from tests.procedures.two_photo import endless as of_wall

Array = np.ndarray
SHAPE = (1000, 1500)
PITCH_UM, FILL, BLUR_PX = 11.88, 0.95, 0.15
MIDDLE = (SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2
TILE = 150
"""Side of the square about a chart that is rendered; the wall is as white as the paper."""
FINE, POINTS = 10, 5
BITS = 14
SAME_LIGHT = 4
"""Fields whose charts stand alike, with noise of their own: the others have other rolls and tilts."""
CENTRAL_PX = 150
CHART = Chart.from_seed()


@dataclass(frozen=True)
class Row:
    """One number of one result beside the truth."""

    method: str
    f_number: float
    where: str
    number: str
    value: float
    uncertainty: float
    true: float


@cache
def place_at(x: float, y: float, f_number: float) -> Place:
    """What lens and photosites do at a place of the frame, in pixels."""
    at = np.array([x, y]) - MIDDLE
    wavefront = LENS.wavefront(*ideal_field(LENS, at, SHAPE))
    parts = CircularPupil(f_number, wavefront), PixelAperture(FILL, FILL), GaussianBlur(BLUR_PX)
    return Place(Optics(parts, PITCH_UM), "Y", 1)


def tour() -> list[tuple[float, float]]:
    """Where the guide's usual tour has its charts, (x, y) in pixels."""
    known = dict.fromkeys(("distance_mm", "principal_px", "x", "y"), 1.0) | {"rows": SHAPE[0], "columns": SHAPE[1]}
    half = SHEET * PIXELS / 2
    known |= {"half_x": half / SHAPE[1], "half_y": half / SHAPE[0]}
    return [one.in_pixels(SHAPE) for one in locations({f"tour_{name}": float(v) for name, v in known.items()})]


def lights(f_number: float, rng: np.random.Generator) -> list[Array]:
    """What the sensor sees at the tour's places, black 0 and white 1: (rows, columns) each."""
    found = []
    for x, y in tour():
        corner = np.round(np.array([x, y]) - (TILE - 1) / 2).astype(int)
        shift = np.array([x, y]) - corner - (TILE - 1) / 2
        tilt = tuple(rng.uniform(-0.02, 0.02, 2))
        view = of_chart.View(PIXELS, rng.uniform(-0.05, 0.05), tilt, (float(shift[0]), float(shift[1])), TILE)
        picture = np.ones(SHAPE)
        one = of_chart.light(place_at(x, y, f_number).optics.otf, CHART, view, fine=FINE, points=POINTS)
        picture[corner[1] : corner[1] + TILE, corner[0] : corner[0] + TILE] = one
        found.append(picture)
    return found


def places() -> dict[str, list[tuple[float, float]]]:
    """Where fields are held against the truth: pixels of the frame."""
    x, y = np.array(tour()).T
    inner = [(float(a), float(b)) for a in (x.min() + 3, x.max() - 3) for b in (y.min() + 3, y.max() - 3)]
    between = [((MIDDLE[0] + a) / 2, (MIDDLE[1] + b) / 2) for a, b in inner]
    sides = [(a, MIDDLE[1] + 40) for a in (x.min() + 3, x.max() - 3)] + [
        (MIDDLE[0] + 60, b) for b in (y.min() + 3, y.max() - 3)
    ]
    rim = [(float(a), float(b)) for a in (0, SHAPE[1] - 1) for b in (0, SHAPE[0] - 1)]
    return {"centre": [MIDDLE, *between], "sides": sides, "corners": inner, "beyond": rim}


def field_rows(f_number: float, count: int, k: int | None = None) -> Iterator[Row]:
    """Fields of one f-number: the maps' numbers, and those of their charts by themselves."""
    for draw in range(count):
        if draw % SAME_LIGHT == 0:
            seen = lights(f_number, np.random.default_rng([round(10 * f_number), draw // SAME_LIGHT]))
        noise = np.random.default_rng([round(10 * f_number), draw, 1])
        planes = [of_chart.exposed(one, noise, bits=BITS) for one in seen]
        frames = [RawFrame(Path(f"{i}"), "", {"Y": plane}, Exposure()) for i, plane in enumerate(planes)]
        nodes = measure_frames(frames, CHART, replace(FIELD, k=k)).nodes["Y"]
        field = interpolate("Y", SHAPE, nodes).field
        for where, some in places().items():
            for x, y in some:
                yield from numbers_at(field.at(x, y), (x, y), f_number, ("field", where))
        for node in nodes:
            at = min(tour(), key=lambda one: float(np.hypot(*(one - node.position))))
            where = "centre" if np.hypot(*(np.array(at) - MIDDLE)) < CENTRAL_PX else "outside"
            yield from numbers_at(node.psf, at, f_number, ("one chart", where))


def numbers_at(psf: Psf, at: tuple[float, float], f_number: float, of: tuple[str, str]) -> Iterator[Row]:
    """The maps' numbers of a PSF beside the truth of its place."""
    place, radius = place_at(*at, f_number), radius_direction(SHAPE, *at)
    true = [*true_numbers(place, radius)[:-1], true_psf(place.optics, S, psf.k).energy_outside]
    for name, value, uncertainty, truth in zip(MAPS, *numbers_of(psf, radius), true, strict=True):
        yield Row(of[0], f_number, of[1], name, float(value), float(uncertainty), float(truth))


def two_places(f_number: float) -> dict[str, Place]:
    """The middle of the frame and a corner of the tour."""
    return {"centre": place_at(*MIDDLE, f_number), "corners": place_at(*tour()[0], f_number)}


def true_mtf50(place: Place, angle_deg: float) -> float:
    """Where |OTF| first falls to one half along a direction, from x towards y."""
    f = np.linspace(0, 2, 20001)
    mtf = true_mtf(place.optics, f, angle_deg)
    i = int(np.flatnonzero(mtf < 0.5)[0])
    return float(np.interp(0.5, mtf[[i, i - 1]], f[[i, i - 1]]))


def pair_rows(f_number: float, count: int) -> Iterator[Row]:
    """Two photographs of a wall: MTF50 and MTF at Nyquist along rows and columns."""
    for where, place in two_places(f_number).items():
        for draw in range(count):
            wall, zoom = ("leaves", "pink")[draw % 2], 3.4 + 1.6 * (draw % 5) / 4
            pair = of_wall.photographs(place.optics.otf, wall=wall, zoom=zoom, noise=0.005, seed=draw, size=160)
            outcome = by_wall(*(Plane("Y", np.asarray(one, np.float32), 1 / 65535) for one in (pair.near, pair.far)))
            if outcome.verdict is not Verdict.PASS:
                print(f"  two photographs, f/{f_number:g}, {where}, {wall}: {outcome.verdict}, {outcome.reason}")
                continue
            numbers = outcome.result().quality.numbers
            for axis, angle in (("horizontal", 0.0), ("vertical", 90.0)):
                nyquist = float(true_mtf(place.optics, np.array([0.5]), angle)[0])
                truths = {"mtf50": true_mtf50(place, angle), "mtf_nyquist": nyquist}
                for name, true in truths.items():
                    yield beside(("two photographs", f_number, where), name, numbers[f"{name}_{axis}"], true)


def edge_rows(f_number: float, count: int) -> Iterator[Row]:
    """Edges that lean by 2.5 to 12 degrees from the columns."""
    for where, place in two_places(f_number).items():
        rng = np.random.default_rng([round(10 * f_number), 17])
        for _ in range(count):
            angle, shift = rng.uniform(2.5, 12), rng.uniform(-0.5, 0.5)
            light = of_edge.edge(AlongNormal(place), rows=100, columns=60, angle_deg=angle, shift_px=shift)
            plane = of_edge.photograph(light, rng)
            outcome = estimate_edge(plane, Roi.whole(plane.samples))
            if outcome.verdict is not Verdict.PASS:
                print(f"  edge, f/{f_number:g}, {where}: {outcome.verdict}, {outcome.reason}")
                continue
            yield beside(
                ("slanted edge", f_number, where), "mtf50", outcome.result().numbers["mtf50"], true_mtf50(place, -angle)
            )
            nyquist = float(true_mtf(place.optics, np.array([0.5]), -angle)[0])
            yield beside(
                ("slanted edge", f_number, where), "mtf_nyquist", outcome.result().numbers["mtf_nyquist"], nyquist
            )


@dataclass(frozen=True)
class AlongNormal:
    """A place's transfer function along the normal of an edge, as `analytic.edge` takes it."""

    place: Place

    def otf(self, f: Array, angle_deg: float) -> Array:
        """The normal of an edge that leans from the columns points up from the rows."""
        angle = np.radians(-angle_deg)
        return np.asarray(self.place.optics.otf(f * np.cos(angle), f * np.sin(angle)))


def beside(of: tuple[str, float, str], name: str, found: Quantity, true: float) -> Row:
    """A number beside its truth."""
    return Row(*of, name, found.value, found.uncertainty, true)


def report(rows: list[Row]) -> None:
    """One line of some rows: mean error, share within two uncertainties, and how the errors compare with them."""
    error, sigma, true = np.array([(row.value - row.true, row.uncertainty, row.true) for row in rows]).T
    first = rows[0]
    mean = f"{error.mean():+.4f}" if first.number == "astigmatism" else f"{error.mean() / true.mean():+.2%}"
    z = np.abs(error / sigma)
    print(
        f"{first.method:16} f/{first.f_number:<4g} {first.where:8} {first.number:23} {mean:>8} "
        f"stated {np.mean(sigma / np.abs(true)):7.2%}, {np.mean(z < 2):6.1%} of {len(z):4d} within two, "
        f"rms {np.sqrt(np.mean(z**2)):.2f}, worst {z.max():.1f}",
        flush=True,
    )


def main() -> None:
    """Print the table."""
    given = [int(n) for n in sys.argv[1:]]
    fields, others, k = (*given, *(4, 17, 0)[len(given) :])
    series: list[Callable[[float], Iterator[Row]]] = [
        partial(field_rows, count=fields, k=k or None),
        partial(pair_rows, count=others),
        partial(edge_rows, count=others),
    ]
    for rows_of in series:
        for f_number in F_NUMBERS:
            groups: dict[tuple[str, str, str], list[Row]] = {}
            for row in rows_of(f_number):
                groups.setdefault((row.method, row.where, row.number), []).append(row)
            for some in groups.values():
                report(some)


if __name__ == "__main__":
    main()
