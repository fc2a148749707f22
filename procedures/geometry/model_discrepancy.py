"""Discrepancy of a camera model: terms of real lenses that its formula does not have.

Poses and parameters absorb most of a missing term: a thin prism looks like a shifted principal point with all charts
turned, and the residual shows a tenth of it. Therefore the missing terms of decentring, thin prism and higher radial
powers are added to the unknowns, with a prior. In the directions a in which the data determine them
independently, scaled to a prior of N(0, 1), let l be the information and z the significance. The Bayes factor for a
term against its absence is

    (1 + l)^(-1/2) exp(z^2 l / (2 (1 + l))),

which gives the probability w that the lens has it, both being equally probable beforehand. The camera without it errs
by a times the response of the unknowns, and E[a^2] = w (z^2 l / (1 + l)^2 + 1 / (1 + l)).
What the data exclude thus adds nothing; what they cannot show adds the prior.

Source: Kass, Raftery, Bayes factors, J. Am. Stat. Assoc. 90, 1995. Hoeting, Madigan, Raftery, Volinsky, Bayesian model
averaging: a tutorial, Stat. Sci. 14, 1999.
"""

import numpy as np

from procedures.geometry.adjustment import Adjustment, ModelDiscrepancy, extra_terms
from procedures.geometry.cameras import SPLINE, CameraModel
from procedures.numerics.arrays import Array

ASYMMETRIC = 1e-3
"""Prior standard deviation of decentring and thin prism, relative to the squared radius in focal lengths; terms of
higher powers are as large at the corner."""
RADIAL = 3e-3  # prior standard deviation of a radial term, relative to the radius, at the frame's corner
LARGEST_EXPONENT = 500.0  # bound of an exponent, above which a probability is 1
ASPECT = 1e-3  # prior standard deviation of the relative difference of the focal lengths along x and y


def missing_terms(camera: CameraModel, pixels: Array) -> Array:
    """Displacements (n, 2, k), in pixels, of places (n, 2) by every term that the formula does not have.

    Each by one standard deviation of its prior. A spline has all terms, k = 0.
    """
    if SPLINE in camera.model:
        return np.zeros((len(pixels), 2, 0))
    corners = np.array([(x, y) for x in (0, camera.columns - 1) for y in (0, camera.rows - 1)], dtype=np.float64)
    flat = (pixels - camera.centre) / camera.focal_px
    corner = float(np.linalg.norm((corners - camera.centre) / camera.focal_px, axis=1).max())
    x, y = flat.T
    r2, none, names = x * x + y * y, 0 * x, set(camera.names)
    share = r2 / corner**2
    asymmetric = {
        "decentring": [(2 * x * y, r2 + 2 * y * y), (r2 + 2 * x * x, 2 * x * y)],
        "prism": [(r2, none), (none, r2)],
    }
    terms = [RADIAL * share**power * flat.T for power in _two_after(sum(name.startswith("k") for name in names))]
    for kind, pair in asymmetric.items():
        for power in _two_after(_known_orders(names, kind)):
            terms += [ASYMMETRIC * share ** (power - 1) * np.array(one) for one in pair]
    if "f" in names:
        terms += [ASPECT / 2 * np.array([x, -y])]
    return np.asarray(np.stack(terms).transpose(2, 1, 0) * np.array(camera.focal_px)[None, :, None])


def _two_after(known: int) -> tuple[int, int]:
    """The two lowest orders that a formula with the first `known` ones does not have."""
    return known + 1, known + 2


def _known_orders(names: set[str], kind: str) -> int:
    """Number of powers of the squared radius that a formula has of a kind of asymmetric terms."""
    if kind == "decentring":
        return int("p1" in names) + int("p3" in names)
    return 2 if "s0" in names else int("sx1" in names)


def find_discrepancy(fit: Adjustment) -> ModelDiscrepancy | None:
    """The model discrepancy of an adjustment; None where they have all terms."""
    views = fit.problem.views
    of_views = [missing_terms(fit.state.camera.part(view.camera)[0], view.points) for view in views]
    counts = {view.camera: one.shape[-1] for view, one in zip(views, of_views, strict=True)}
    firsts = {camera: sum(k for other, k in counts.items() if other < camera) for camera in counts}
    if not any(counts.values()):
        return None
    extra = []
    for view, one in zip(views, of_views, strict=True):
        columns = np.zeros((len(view), 2, sum(counts.values())))
        columns[..., firsts[view.camera] : firsts[view.camera] + one.shape[-1]] = one
        extra.append(columns)
    terms = extra_terms(fit, extra)
    information, directions = np.linalg.eigh(terms.matrix / fit.scale**2)
    information = np.maximum(information, 0.0)
    right = directions.T @ terms.right / fit.scale**2  # z times the root of the information
    gain = right**2 / (1 + information)
    odds = np.exp(np.minimum(gain / 2, LARGEST_EXPONENT)) / np.sqrt(1 + information)
    spread = np.sqrt(odds / (1 + odds) * (gain + 1) / (1 + information))
    loads = directions * spread
    return ModelDiscrepancy((terms.response @ loads).T, loads.T)
