"""The sensor's plane relative to the surface of best focus, fitted to heights at places of the frame.

A height is the distance of the sensor behind the image, in micrometres. The heights are fitted by a quadratic, which
combines the lens's field curvature with the plane nearest to the quadratic over the whole frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy import linalg, stats

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter, Refused

FEWEST = 7  # places: one more than the coefficients of a quadratic, for a degree of freedom
SINGULAR = 1e3  # condition of the design above which plane and curvature are not separated


@dataclass(frozen=True, eq=False)
class TiltedPlane:
    """Height of the sensor behind the surface of best focus: offset + slope . (x, y), and the rest of a quadratic.

    (x, y) are millimetres on the sensor from the frame's centre, to the right and down in the photograph.

    size_mm : width and height of the frame
    plane : (3,), covariance : (3, 3); offset in um, slopes in um/mm
    curvature : (3,), curvature_covariance : (3, 3); coefficients of x^2, x y and y^2, in um/mm^2
    centre : height of the quadratic at the frame's centre in um, and its variance
    places_mm, heights_um, residuals_um : (N, 2), (N,) and (N,) float64
    misfit : root of chi^2 per degree of freedom; where above 1 the covariances are scaled by its square
    chance : probability of a larger chi^2
    """

    size_mm: tuple[float, float]
    plane: Array
    covariance: Array
    curvature: Array
    curvature_covariance: Array
    centre: tuple[float, float]
    places_mm: Array
    heights_um: Array
    residuals_um: Array
    misfit: float
    chance: float

    @property
    def corners_mm(self) -> Array:
        """Corners (4, 2), from the upper left clockwise."""
        return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * self.size_mm / 2

    def height_at(self, places_mm: Array) -> Array:
        """Height (n,) of the fitted quadratic at places (n, 2)."""
        (x, y), (mean_xx, mean_yy) = places_mm.T, np.square(self.size_mm) / 12  # the plane has the quadratic's mean
        flat = self.plane[0] + places_mm @ self.plane[1:]
        return np.asarray(flat + np.stack([x * x - mean_xx, x * y, y * y - mean_yy], axis=1) @ self.curvature)

    def rms(self, planes: Array) -> Array:
        """Root mean square height over the frame of planes (n, 3), (n,)."""
        return np.sqrt(planes[:, 0] ** 2 + planes[:, 1:] ** 2 @ (np.square(self.size_mm) / 12))

    def widened(self, slope_variance: float, height_variance: float) -> TiltedPlane:
        """The plane with additional errors common to all places: of each slope, (um/mm)^2, and of the offset, um^2."""
        more = np.diag([height_variance, slope_variance, slope_variance])
        height, variance = self.centre
        return replace(self, covariance=self.covariance + more, centre=(height, variance + height_variance))


def fit_plane(places_mm: Array, heights_um: Array, covariance: Array, size_mm: tuple[float, float]) -> TiltedPlane:
    """The plane through heights (N,) with covariance (N, N) at places (N, 2), by generalised least squares.

    Where the residuals exceed the covariance, it is scaled by them (Birge's ratio).

    Raises Refused if there are fewer than seven places, or they do not determine a quadratic.
    """
    scale = float(np.hypot(*size_mm)) / 2
    x, y = (places_mm / scale).T
    design = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    if len(x) < FEWEST or np.linalg.cond(design) > SINGULAR:
        raise Refused(
            f"{len(x)} places do not separate a tilt from the lens's field curvature",
            "photograph charts at nine places: the centre, the sides and the corners of the frame",
        )
    root = linalg.cholesky(covariance, lower=True)
    A, b = (linalg.solve_triangular(root, one, lower=True) for one in (design, heights_um))
    solution = np.linalg.pinv(A)
    c = solution @ b
    freedom = len(x) - len(c)
    chi2 = float(np.sum((b - A @ c) ** 2))
    misfit = float(np.sqrt(chi2 / freedom))
    unit = np.diag(scale ** -np.array([0.0, 1, 1, 2, 2, 2]))
    c, C = unit @ c, unit @ (solution @ solution.T) @ unit * max(misfit, 1.0) ** 2
    to_plane = np.eye(6)[:3]
    to_plane[0, [3, 5]] = np.square(size_mm) / 12  # the mean of x^2 and of y^2 over the frame
    residuals = heights_um - design @ (np.linalg.inv(unit) @ c)
    return TiltedPlane(
        size_mm, to_plane @ c, to_plane @ C @ to_plane.T, c[3:], C[3:, 3:], (float(c[0]), float(C[0, 0])), places_mm,
        heights_um, residuals, misfit, float(stats.chi2.sf(chi2, freedom)),
    )  # fmt: skip


# --- positions of a focus bracket ------------------------------------------------------------------------------------


class Positions(StrEnum):
    """Meaning of the bracket's positions in millimetres.

    LENS: distance of the lens from the sensor, with any zero. SET: distance setting of the lens. CHART: distance of the
    chart from the lens, whose setting is unchanged.
    """

    LENS = "lens"
    SET = "set"
    CHART = "chart"


def behind_lens_um(position_mm: float, kind: Positions, focal_length_mm: float | None) -> float:
    """Distance of the sensor behind the lens in um, with any zero, at a position of the bracket.

    For CHART it is relative to the chart's image, which moves instead. Thin lens: 1 / image + 1 / object = 1 / focal
    length.

    Raises BadParameter if the focal length of a distance is not known, or not smaller than it.
    """
    if kind is Positions.LENS:
        return 1000 * position_mm
    if focal_length_mm is None:
        raise BadParameter(
            "distances before the lens need its focal length, which the photographs do not record",
            "give --focal-length-mm",
        )
    if position_mm <= focal_length_mm:
        raise BadParameter(
            f"a distance of {position_mm:g} mm is not beyond the focal length of {focal_length_mm:g} mm",
            "give distances in millimetres, or use --positions lens if the lens's own position is given",
        )
    image_um = 1000 * focal_length_mm * position_mm / (position_mm - focal_length_mm)
    return image_um if kind is Positions.SET else -image_um


def magnification(focal_length_mm: float, distance_mm: float) -> float:
    """Magnification of a chart at a distance from the lens."""
    return focal_length_mm / (distance_mm - focal_length_mm)
