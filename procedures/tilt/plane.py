"""The sensor's plane relative to the surface of best focus, fitted to heights at places of the frame.

A height is the distance of the sensor behind the image, in micrometres. The heights are fitted by a quadratic, which
combines the lens's field curvature with the plane nearest to the quadratic over the whole frame.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy import linalg
from scipy.special import chdtrc

from procedures.numerics.arrays import Array
from procedures.outcome import BadParameter, Quantity, Refused

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

    def widened(self, slope_variance: float, height_variance: float) -> "TiltedPlane":
        """The plane with additional errors common to all places: of each slope, (um/mm)^2, and of the offset, um^2."""
        more = np.diag([height_variance, slope_variance, slope_variance])
        height, variance = self.centre
        return replace(self, covariance=self.covariance + more, centre=(height, variance + height_variance))


def fit_plane(places_mm: Array, heights_um: Array, covariance: Array, size_mm: tuple[float, float]) -> TiltedPlane:
    """The plane through heights (N,) of covariance (N, N), scaled by larger residuals (Birge), by least squares. Raises
    Refused for fewer than seven places, or no quadratic."""
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
        heights_um, residuals, misfit, float(chdtrc(freedom, chi2)),
    )  # fmt: skip


# --- positions of a focus bracket ---


class Positions(StrEnum):
    """Meaning of a bracket's mm: LENS, distance of lens and sensor, from any zero; SET, distance setting; CHART,
    distance of the chart from an unchanged lens."""

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


# --- Turns of the screws that align the sensor with the surface of best focus, and the probability of improvement ---

DRAWS = 2000
SURE = 0.9  # probability of improvement from which a turn is advised
SEED = 20260801  # seed of the draws, so that the result is reproducible


@dataclass(frozen=True)
class Screws:
    """Screws that hold the sensor, equally spaced on a circle about the frame's centre.

    radius_mm : radius of the circle
    pitch_mm : move of the sensor per turn
    first_deg : position of the first screw, clockwise from the top, seen from behind the camera; the others follow
        clockwise
    turn_uncertainty : standard uncertainty of a turn by hand, in turns
    """

    count: int = 3
    radius_mm: float = 20.0
    pitch_mm: float = 0.35
    first_deg: float = 0.0
    turn_uncertainty: float = 0.02

    def __post_init__(self) -> None:
        if self.count < 3 or min(self.radius_mm, self.pitch_mm) <= 0 or self.turn_uncertainty < 0:
            raise BadParameter(
                f"a plane needs three screws or more, with a positive radius and pitch; got {self}",
                "measure those of the camera",
            )

    @property
    def angles_deg(self) -> Array:
        """Angle of each, clockwise from the top, seen from behind the camera."""
        return (self.first_deg + 360 * np.arange(self.count) / self.count) % 360

    @property
    def places_mm(self) -> Array:
        """Positions (count, 2) in the photograph, right and down, mirrored on both axes relative to the sensor seen
        from behind."""
        angle = np.radians(self.angles_deg)
        return self.radius_mm * np.stack([-np.sin(angle), np.cos(angle)], axis=1)

    @property
    def heights(self) -> Array:
        """Matrix (count, 3) from a plane's offset and slopes to the heights at the screws."""
        return np.column_stack([np.ones(self.count), self.places_mm])


@dataclass(frozen=True, eq=False)
class Turns:
    """Correction of a plane.

    moves : moves of the sensor at each screw, in um, away from the lens; negative is towards it
    turns : the same in turns of each screw
    helps : probability that the correction reduces the distance from the surface of best focus over the frame
    before, after : root mean square height over the frame, in um, before and expected after the correction
    """

    moves: tuple[Quantity, ...]
    turns: tuple[Quantity, ...]
    helps: float
    before: Quantity
    after: Quantity


def turns_for(sensor: TiltedPlane, screws: Screws, *, with_focus: bool) -> Turns:
    """The turns that align the sensor with the surface of best focus, and the probability of improvement.

    with_focus : whether the offset is corrected too; otherwise the mean focus over the frame is unchanged

    The probability is the share of planes, drawn from the measurement, that are flatter after turns with their own
    uncertainty.
    """
    kept = np.ones(3) if with_focus else np.array([0.0, 1.0, 1.0])
    plane, covariance = sensor.plane * kept, sensor.covariance * np.outer(kept, kept)
    to_screws = screws.heights
    heights, spread = to_screws @ plane, np.sqrt(np.diag(to_screws @ covariance @ to_screws.T))
    n = len(sensor.heights_um)
    moves = tuple(
        Quantity(float(-h), "um", float(u), "the plane at the screw, away from the lens", n)
        for h, u in zip(heights, spread, strict=True)
    )
    per_turn = 1000 * screws.pitch_mm
    turns = tuple(
        Quantity(move.value / per_turn, "turn", move.uncertainty / per_turn, "its move over the screw's pitch", n)
        for move in moves
    )
    rng = np.random.default_rng(SEED)
    true = rng.multivariate_normal(plane, covariance, DRAWS, method="eigh")
    slips = screws.turn_uncertainty * per_turn * rng.standard_normal((DRAWS, screws.count))
    remaining = true - plane + slips @ np.linalg.pinv(to_screws).T * kept
    before, after = sensor.rms(true), sensor.rms(remaining)
    method = "root mean square over the frame, of planes drawn from the measurement"
    return Turns(
        moves, turns, float(np.mean(after < before)),
        Quantity(float(sensor.rms(plane[None])[0]), "um", float(before.std()), method, n),
        Quantity(float(np.sqrt(np.mean(after**2))), "um", float(after.std()), method, n),
    )  # fmt: skip
