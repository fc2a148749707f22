"""Charts in pictures of wide lenses: the picture as a pinhole camera turned towards the chart would give it.

A fisheye bends the sides of a chart. A pinhole camera turned towards it shows them straight, however far from the axis
the chart lies. The lens is taken as equidistant, r = f times the angle from the axis, with one of a few focal lengths:
what remains of the bending is small over one chart, and the positions of its bins are measured in the picture itself.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from procedures.geometry.chart_bins.large_chart import reduced
from procedures.numerics.arrays import Array, Array32
from procedures.numerics.warps import apply_homography, cubic_monomials, fit_homography, inverse
from procedures.pattern import CELLS
from procedures.pattern_psf.chart_finding.detection import ChartSighting, find_charts
from procedures.pattern_psf.correspondences import Correspondences
from procedures.pattern_psf.registration import Registration

FOCAL_RATIOS, NEARER = (1.5, 0.64, 1.1, 0.83, 0.52), (0.95, 1.05, 0.9, 1.1)
"""Focal lengths relative to half the frame's diagonal, the usual ones first: 0.64 for 180 degrees over the diagonal.
Then those near the best one: all marks of a chart lie on straight lines up to 5 % from the true one."""
SEARCH_RATIOS, PLACES = (0.6, 0.72), (0.5, 0.2, 0.8)
"""Focal lengths, and places in fractions of the frame along both sides, where an unknown chart is searched for."""
SEARCHED_PX = 400  # half the side of a picture that is searched: 45 degrees
SURROUNDINGS = 1.3  # half the side of a picture of one chart, relative to the width of its noise region


@dataclass(frozen=True, eq=False)
class TurnedView:
    """A pinhole camera in place of an equidistant one.

    centre : (2,) float64, of the equidistant picture, (x, y) in pixels
    focal_px : float, its focal length
    turn : (2,) float64
        Direction of the pinhole camera: a place of the picture relative to its centre, divided by the focal length.
    scale : float, focal length of the pinhole camera, relative to `focal_px`
    half_px : int, the pinhole's picture extends so far to all sides of its central pixel
    """

    centre: Array
    focal_px: float
    turn: Array
    scale: float
    half_px: int

    def to_plane(self, points: Array) -> Array:
        """Places (n, 2) of the equidistant picture at points (n, 2) of the pinhole's."""
        flat = (points - self.half_px) / (self.focal_px * self.scale)
        # from the pinhole camera's frame to the equidistant one's
        turn = Rotation.from_rotvec([-self.turn[1], self.turn[0], 0.0]).as_matrix()
        x, y, z = (np.column_stack([flat, np.ones(len(flat))]) @ turn.T).T
        rho = np.hypot(x, y)
        stretch = self.focal_px * np.arctan2(rho, z) / np.maximum(rho, np.finfo(float).tiny)
        return np.asarray(self.centre + stretch[:, None] * np.column_stack([x, y]))

    @property
    def factor(self) -> int:
        """By which the picture is reduced before it is resampled."""
        return max(round(1 / self.scale), 1)

    def picture(self, samples: Array32) -> Array32:
        """The pinhole's picture of a plane."""
        along = np.arange(2 * self.half_px + 1, dtype=np.float64)
        x, y = np.meshgrid(along, along)
        places = shrunk(self.to_plane(np.column_stack([x.ravel(), y.ravel()])), self.factor).astype(np.float32)
        x32, y32 = places.T.reshape(2, *x.shape)
        small = reduced(samples, self.factor)
        return np.asarray(cv2.remap(small, x32, y32, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))

    def moved(self, x: float, y: float) -> "TurnedView":
        """The camera for a plane whose content is shifted by (x, y) pixels."""
        return replace(self, centre=self.centre + np.array([x, y]))

    def towards(self, place: Array, width_px: float, most_px: float) -> "TurnedView":
        """The camera turned to a place of the plane, for a chart of a width there, shown at most so wide."""
        scale = min(1.0, most_px / width_px)
        return replace(
            self,
            turn=(place - self.centre) / self.focal_px,
            scale=scale,
            half_px=round(SURROUNDINGS * scale * width_px),
        )

    def with_focal(self, focal_px: float) -> "TurnedView":
        """The camera turned to the same place of an equidistant picture with another focal length."""
        return replace(self, focal_px=focal_px, turn=self.turn * self.focal_px / focal_px)

    def registered(self, bins: Correspondences) -> tuple[Registration, Correspondences]:
        """Map from the plane, reduced by `factor`, to cells; and the bins of the pinhole's picture in that plane."""
        points = shrunk(self.to_plane(bins.points), self.factor)
        return fitted_registration(points, bins.cells), replace(bins, points=points)


def find_turned(
    samples: Array32, most_px: float, sighting: ChartSighting | None = None
) -> tuple[ChartSighting, TurnedView] | None:
    """The chart with the most marks in the pictures of turned cameras, by the camera turned towards it.

    samples : (rows, columns) float32
    most_px : float, greatest width of the chart in the picture
    sighting : ChartSighting, what the plane itself shows of it; None: it is searched for
    """
    size = np.array(samples.shape[::-1], dtype=np.float64)
    if sighting is None:
        places = [np.array(one) * size for one in product(PLACES, PLACES)]
        searched = _best(samples, (_view(size, *one) for one in product(SEARCH_RATIOS, places)))
        if searched is None:
            return None
        sighting, view = searched
        place, width = view.to_plane(sighting.centre()[None])[0], float(sighting.widths().max()) / view.scale
    else:
        place, width = sighting.centre(), float(sighting.widths().max())
    view, half = _view(size, FOCAL_RATIOS[0], place).towards(place, width, most_px), np.linalg.norm(size) / 2
    best = _best(samples, (view.with_focal(float(ratio * half)) for ratio in FOCAL_RATIOS))
    if best is None or best[0].visible.all() or (sighting is not None and _marks(best) <= sighting.visible.sum()):
        return best
    nearer = _best(samples, (best[1].with_focal(share * best[1].focal_px) for share in NEARER))
    return best if nearer is None else max(best, nearer, key=_marks)


def _best(samples: Array32, views: Iterable[TurnedView]) -> tuple[ChartSighting, TurnedView] | None:
    """The chart with the most marks, and the camera that shows it; the first with all of them."""
    best = None
    for view in views:
        for sighting in find_charts(view.picture(samples)):
            if best is None or sighting.visible.sum() > _marks(best):
                best = sighting, view
        if best is not None and best[0].visible.all():
            break
    return best


def _marks(candidate: tuple[ChartSighting, TurnedView]) -> int:
    return int(candidate[0].visible.sum())


def _view(size: Array, ratio: float, place: Array) -> TurnedView:
    """Camera to search with around a place of a plane of a size."""
    centre, focal = (size - 1) / 2, ratio * float(np.linalg.norm(size)) / 2
    return TurnedView(centre, focal, (place - centre) / focal, min(1.0, SEARCHED_PX / focal), SEARCHED_PX)


def quarters(bins: Correspondences) -> list[Correspondences]:
    """The bins of the four quarters of a chart: the bending left in each is a sixteenth of that over the whole."""
    quarter = (bins.cells > CELLS / 2) @ np.array([1, 2])
    return [bins.take(quarter == q) for q in range(4)]


def joined(parts: Sequence[Correspondences]) -> Correspondences:
    """The bins of all parts."""
    return Correspondences(
        *(np.concatenate(one) for one in zip(*((p.index, p.points, p.covariance) for p in parts), strict=True))
    )


def shrunk(points: Array, factor: int) -> Array:
    """Points in pixels of the reduced picture."""
    return np.asarray((points - (factor - 1) / 2) / factor)


def fitted_registration(points: Array, cells: Array) -> Registration:
    """The map from points (n, 2) of a plane to cells (n, 2) by a homography and cubics, by least squares."""
    H, centre = fit_homography(points, cells), points.mean(axis=0)
    radius = float(np.linalg.norm(points - centre, axis=1).max())
    columns = np.column_stack([cubic_monomials(*((points - centre) / radius).T), np.ones(len(points))])
    displacement = np.linalg.lstsq(columns, apply_homography(inverse(H), cells) - points, rcond=None)[0]
    return Registration(H, centre, radius, displacement[:9].T.astype(np.float64)).translated(displacement[9])
