"""Plane-to-plane maps: homographies with polynomial displacements."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from procedures.numerics.arrays import Array, Array32, Mask

CUBIC_EXPONENTS = tuple((i - j, j) for i in range(1, 4) for j in range(i + 1))
"""Exponents (of x, of y) of the monomials of degree one to three, lowest degree first."""


def apply_homography(H: Array, points: Array) -> Array:
    """Points (n, 2) mapped by the homography H (3, 3)."""
    mapped = points @ H[:, :2].T + H[:, 2]
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def inverse(H: Array) -> Array:
    """The inverse of a square matrix."""
    return np.asarray(np.linalg.inv(H), dtype=np.float64)


def fit_homography(source: Array, target: Array) -> Array:
    """The homography (3, 3) of least squares in the target from `source`, both (n >= 4, 2): a direct linear solution,
    then three Gauss-Newton steps. Raises ValueError for fewer points."""
    if len(source) < 4:
        raise ValueError(f"a homography needs four points; got {len(source)}")
    S, T = _normalisation(source), _normalisation(target)
    a, b = apply_homography(S, source), apply_homography(T, target)
    zero = np.zeros((len(a), 3))
    ones = np.column_stack([a, np.ones(len(a))])
    rows = np.vstack([np.hstack([ones, zero, -b[:, :1] * ones]), np.hstack([zero, ones, -b[:, 1:] * ones])])
    h = np.linalg.svd(rows)[2][-1]
    h = h / h[8]
    for _ in range(3):
        h = h + _gauss_newton_step(h, a, b)
    H = np.linalg.inv(T) @ h.reshape(3, 3) @ S
    return np.asarray(H / H[2, 2])


def _gauss_newton_step(h: Array, a: Array, b: Array) -> Array:
    """Change of the homography's nine numbers (the last stays) that lowers the distances |H a - b|."""
    w = a @ h[6:8] + h[8]
    mapped = apply_homography(h.reshape(3, 3), a)
    ones = np.column_stack([a, np.ones(len(a))]) / w[:, None]
    zero = np.zeros_like(ones)
    perspective = a / w[:, None]
    J = np.vstack(
        [np.hstack([ones, zero, -mapped[:, :1] * perspective]), np.hstack([zero, ones, -mapped[:, 1:] * perspective])]
    )
    step = np.linalg.lstsq(J, (b - mapped).T.ravel(), rcond=None)[0]
    return np.append(step, 0.0)


def _normalisation(points: Array) -> Array:
    """The similarity that moves the points' centroid to 0 and scales their mean distance from it to sqrt 2."""
    centre = points.mean(axis=0)
    scale = np.sqrt(2) / np.linalg.norm(points - centre, axis=1).mean()
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])


def homography_jacobian(H: Array, point: Array) -> Array:
    """Derivative (2, 2) of the homography at a point (2,): rows are target coordinates, columns source ones."""
    w = H[2, :2] @ point + H[2, 2]
    mapped = (H[:2, :2] @ point + H[:2, 2]) / w
    return np.asarray((H[:2, :2] - np.outer(mapped, H[2, :2])) / w)


def cubic_monomials(x: Array, y: Array) -> Array:
    """The nine monomials of degree one to three at points (n,): (n, 9), in the order of `CUBIC_EXPONENTS`."""
    xx, xy, yy = x * x, x * y, y * y
    return np.stack([x, y, xx, xy, yy, xx * x, xx * y, x * yy, yy * y], axis=-1)


@dataclass(frozen=True)
class CubicWarp:
    """A map of the plane: target = H(p + d(p)), d a cubic polynomial without constant.

    The constant is absent because a translation of the map is equivalent to a shift of the kernel observed through it;
    something else must fix it.

    H : (3, 3) homography, source points (x, y) -> target points
    centre : (2,) float64, radius : float; the polynomial's argument is (p - centre) / radius
    displacement : (2, 9) coefficients of d in units of the source, for x and y, in the order of `CUBIC_EXPONENTS`
    """

    H: Array
    centre: Array
    radius: float
    displacement: Array

    def forward(self, points: Array) -> Array:
        """Targets (n, 2) of points (n, 2)."""
        return apply_homography(self.H, points + self.displacement_at(points))

    def backward(self, targets: Array) -> Array:
        """Points (n, 2) of targets (n, 2): the inverse map, by fixed-point iteration."""
        ideal = apply_homography(inverse(self.H), targets)
        points = ideal
        for _ in range(8):  # d changes by under a hundredth per unit: converged to rounding after eight steps
            points = ideal - self.displacement_at(points)
        return points

    def monomials(self, points: Array) -> Array:
        """The displacement's nine monomials at points (n, 2): (n, 9)."""
        return cubic_monomials(*((points - self.centre) / self.radius).T)

    def displacement_at(self, points: Array) -> Array:
        """The displacement d (n, 2) at points (n, 2), in units of the source."""
        if not self.displacement.any():
            return np.zeros_like(points)
        return np.asarray(self.monomials(points) @ self.displacement.T)

    def jacobian(self) -> Array:
        """Derivative (2, 2) of the targets with respect to the source at the centre, without the displacement."""
        return homography_jacobian(self.H, self.centre)

    def derivative(self, points: Array) -> Array:
        """Derivatives (n, 2, 2) of the targets with respect to the source at points (n, 2), with the displacement."""
        step = 1e-3 * self.radius
        moves = [np.array([step, 0.0]), np.array([0.0, step])]
        return np.stack([(self.forward(points + m) - self.forward(points - m)) / (2 * step) for m in moves], axis=-1)

    def translated(self, shift: Array) -> Self:
        """The map p -> self(p + shift), shifted inside the polynomial too."""
        T = np.eye(3)
        T[:2, 2] = shift
        return replace(self, H=self.H @ T)

    def displaced(self, change: Array, monomials: Array) -> Self:
        """The map with coefficients (2, 9) added, its mean displacement over points of these `monomials` (n, 9)
        unchanged."""
        drift = change @ monomials.mean(axis=0)
        return replace(self, displacement=self.displacement + change).translated(-drift)


def displacement_columns(slopes: Array, monomials: Array) -> Array:
    """Derivatives (m, 18) of samples with respect to a displacement's coefficients, those of x first.

    The mean of the monomials is subtracted, so that the columns move no centre.

    slopes : (m, 2) change of every sample per unit of displacement along x and y; monomials : (m, 9) from
    `CubicWarp.monomials`.
    """
    centred = monomials - (monomials.mean(axis=0) if len(monomials) else 0.0)
    return np.hstack([centred * slopes[:, :1], centred * slopes[:, 1:]])


# --- Affine registration of two photographs by their correlation, independent of their brightness ---
# Source: Evangelidis, Psarakis, Parametric image alignment using enhanced correlation coefficient maximization, IEEE
# TPAMI 30 (2008), in OpenCV's implementation.

MAX_ITERATIONS, TOLERANCE = 60, 1e-7
COARSE_PX = 256  # side of the reduced copies for the first guess
SMOOTHED = 5  # side of the smoothing window, pixels


def affine_between(first: Array32, second: Array32, clear: Mask) -> Array | None:
    """The affine map (2, 3) from points (x, y) of the first picture, valid where `clear`, to the second; None if not
    converged."""
    import cv2  # here: it is slow to load

    factor = min(1.0, COARSE_PX / min(first.shape))
    guess = _shift_between(first, second, factor)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, MAX_ITERATIONS, TOLERANCE)
    mask: npt.NDArray[Any] = clear.astype(np.uint8)
    try:
        _, matrix = cv2.findTransformECC(first, second, guess, cv2.MOTION_AFFINE, stop, mask, SMOOTHED)
    except cv2.error:
        return None
    return np.asarray(matrix, dtype=np.float64)


def _shift_between(first: Array32, second: Array32, factor: float) -> Array32:
    import cv2

    a, b = (cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA) for image in (first, second))
    window = cv2.createHanningWindow(a.shape[::-1], cv2.CV_32F)
    (x, y), _ = cv2.phaseCorrelate(np.asarray(a - a.mean()), np.asarray(b - b.mean()), window)
    return np.array([[1, 0, x / factor], [0, 1, y / factor]], dtype=np.float32)
