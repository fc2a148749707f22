"""Evidence of corruptions in the far photograph of a pair: scores by its residual."""

import numpy as np

from procedures.corruption import directions
from procedures.corruption.directions import BORDER, GHOST
from procedures.corruption.evidence import TextureEvidence
from procedures.corruption.family import SampleGroup, strengths
from procedures.corruption.noise import (
    DRIFT,
    MASK_RADII,
    SMOOTHING_RADII,
    TEXTURES,
    Variogram,
    mask_scores,
    texture_correlation,
)
from procedures.numerics.arrays import Array, Array32
from procedures.two_photo.inter_image import PairFit, linear_system, tiles_of

CONTRAST = 4.0  # standard deviations of a wall's light that count as the contrast of black and white


def examine(fit: PairFit, far: Array32, curve: tuple[Array, Array]) -> TextureEvidence:
    """Scores of a fit; `curve` are frequencies and MTF."""
    image = fit.as_image(fit.residual, np.nan)
    residual = Variogram.of(np.nan_to_num(image), np.isfinite(image))
    textures = [texture_correlation(*curve, exponent) for exponent in TEXTURES]
    (x, y), (rows, columns) = fit.near.corner, fit.near.shape
    middle, scale = float(np.mean(fit.samples.y)), CONTRAST * float(np.std(fit.samples.y))
    picture = np.array(far[y : y + rows, x : x + columns], dtype=np.float64)
    at = fit.samples.rows, fit.samples.columns
    picture[at] = fit.prediction
    padded = np.pad((picture - middle) / scale, BORDER, mode="edge")
    pictures = directions.filters(padded) | directions.wide_masks(padded)
    values = [one[BORDER:-BORDER, BORDER:-BORDER][at] for one in pictures.values()]
    ghost = directions.mirrored(far, (x, y), (rows, columns))
    values.append((ghost[at] - middle) / scale)
    shared, own = linear_system(fit)
    group = SampleGroup(shared, own, fit.residual / scale, tiles_of(fit))
    # the Gram matrix of the last step has the priors of the tail
    amounts = strengths([group], [np.stack(values, axis=1)], fit.equations.G, fit.variance**0.5 / scale)
    return TextureEvidence(
        mask_scores([residual], MASK_RADII),
        mask_scores([residual], SMOOTHING_RADII, [DRIFT, *textures]),
        dict(zip([*pictures, GHOST], amounts, strict=True)),
        framed=False,
    )
