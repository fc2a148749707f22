"""Expected error of the restored picture, from its residual.

Errors of the masks leave a residual like noise and are treated as noise of that power. The part in which the
photographs contradict each other is observed, and the part in which they agree is assumed equally large and in the
picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve1d, uniform_filter
from scipy.optimize import nnls

from procedures.restoration.joint.noise_and_contrast import (
    BANDS,
    SIZE,
    responses,
    rings_of,
    sectors_of,
    separated,
    tile_powers,
)
from procedures.restoration.masks.blur_operator import Array, MaskStack

WINDOW = 15
"""Side of the places in which residual, texture and light are compared, pixels."""
SMOOTH = 0.25
"""Texture of the smoothest tenth of places, relative to the mean, up to which noise and mask errors can be
separated."""


UNSURE, VARIED = 0.1, 0.5
"""Relative errors of the amplified noise in a sector of frequencies, and of the band's contrast as the sector's."""


@dataclass(frozen=True, eq=False)
class PictureError:
    """Root mean squares, white = 1.

    noise : expected error of the restored picture due to amplified noise with mask errors; lost : (H, W) that due to
    the prior, larger where there is texture; blurred : error of the least blurred photograph.
    """

    noise: float
    lost: Array
    blurred: float

    @property
    def std(self) -> float:
        """Expected error of the picture over the frame."""
        return float(np.sqrt(self.noise**2 + np.mean(self.lost**2)))


def picture_error(
    stacks: list[MaskStack], depths: Array, weights: Array, residual: Array, sharp: Array, fitted: float = 0.0,
    *, as_restored: bool = False,
) -> PictureError:  # fmt: skip
    """The expected error of a picture (C, H, W) with the given `residual` (P, C, H, W).

    depths : w of equal parts of the frame; weights : effective weights of the prior in every band, see
    `effective_weights`; fitted : noise fitted by the depth; as_restored : X is
    that of the restored picture, for estimated masks, which share a part with the picture and make it too sharp.

    Where masks pass S = sum |H|^2 and the prior is L, the picture errs by (S N + (weight L)^2 X) / (S + weight L)^2: N
    the power of one photograph's residual from masks and noise, X that of the picture. The residual holds P - 1 of P
    parts of N and a part suppressed by the prior, the restored picture the rest of X and amplified noise (`separated`).
    N is estimated for the frame, X for each tile of it and each direction of frequencies.
    """
    wide = np.pad(sharp, ((0, 0), (0, 1), (0, 1)), mode="edge")
    power, slopes = tile_powers(residual), tile_powers(np.diff(wide, axis=1)[..., :-1], np.diff(wide, axis=2)[:, :-1])
    rings, sectors, count = rings_of((SIZE, SIZE)), sectors_of((SIZE, SIZE)), len(stacks)
    each = [(*responses(stacks, float(w)), responses_of_best(stacks, float(w))) for w in depths]
    noisy, blurred, lost = 0.0, 0.0, np.zeros(slopes.mean.shape[:2])
    for band in range(BANDS):
        weight, frame = weights[band], [part.of(band).mean() for part in (power, slopes)]
        S, L, best = _within(each, rings == band)
        noise, _ = separated([(S, L)], weight, count, fitted, count * frame[0], frame[1], fixed=as_restored)
        noisy += noise * np.sum(S / (S + weight * L + 1e-12) ** 2)
        whole, _ = _contrast(S, L, weight, slopes.of(band), 0.0 if as_restored else noise)
        blurred += float(whole.mean()) * np.sum((1 - np.sqrt(best)) ** 2 / L)
        for sector in np.unique(sectors):
            S, L, _ = _within(each, (rings == band) & (sectors == sector))
            contrast, unsure = _contrast(S, L, weight, slopes.of(band, sector), 0.0 if as_restored else noise)
            # where amplified noise hides a sector's contrast, that of the band is taken
            known = (VARIED * whole) ** 2 / ((VARIED * whole) ** 2 + (unsure + UNSURE * contrast) ** 2 + 1e-30)
            lost += (known * contrast + (1 - known) * whole) * np.sum((weight * L / (S + weight * L + 1e-12)) ** 2 / L)
    total = len(depths) * np.sum(rings >= 0)
    return PictureError(
        float(np.sqrt(noisy / total)), np.sqrt(slopes.over_frame(lost / total)), float(np.sqrt(blurred / total))
    )


def _within(spectra: Sequence[tuple[Array, ...]], where: Array) -> tuple[Array, ...]:
    """The spectra of all depths at some frequencies."""
    return tuple(np.concatenate([spectrum[where] for spectrum in kind]) for kind in zip(*spectra, strict=True))


def _contrast(S: Array, L: Array, weight: float, slopes: Array, noise: float) -> tuple[Array, float]:
    """Squared gradient of the sharp picture in each tile, from that of the restored one, and its uncertainty by noise
    of the given power, which the restoration has amplified; for power 0 that of the restored picture."""
    if noise == 0:
        return slopes, 0.0
    kept = S / (S + weight * L + 1e-12)
    passed = float(np.mean(kept**2)) + 1e-12
    amplified = noise * float(np.mean(L * kept / (S + weight * L + 1e-12))) / passed
    return np.maximum(slopes / passed - amplified, 0.0), UNSURE * amplified


def responses_of_best(stacks: list[MaskStack], w: float) -> Array:
    """Squared transfer function of the mask that blurs least."""
    each = [responses([stack], w)[0] for stack in stacks]
    return np.minimum(max(each, key=lambda one: float(one.mean())), 1.0)


def error_map(error: PictureError, residual: Array, window: int) -> Array:
    """The picture's expected error at every pixel, (H, W): its part by noise is distributed as the local residual."""
    power = uniform_filter((residual.astype(np.float64) ** 2).mean(axis=(0, 1)), window, mode="reflect")
    return np.asarray(np.sqrt(error.noise**2 * power / max(float(power.mean()), 1e-30) + error.lost**2))


def noise_upper_bound(z: Array) -> float:
    """Upper bound of any photograph's white noise, from it alone: upper quartile (dark ground may be clipped) of second
    differences along both axes (Immerkaer 1996)."""
    bend = np.array([1.0, -2.0, 1.0])
    rough = np.abs(convolve1d(convolve1d(z, bend, axis=-2), bend, axis=-1)) / 6
    quartile = np.percentile(rough.reshape(len(z), -1), 75, axis=1)
    return float(quartile.max() / 1.150)


def residual_noise(z: Array, residual: Array, sharp: Array, R: int) -> float:
    """Standard deviation of photographs' noise (P, C, H, W), white or not, from the residual of a picture.

    Noise of processed photographs exceeds that at their highest frequencies; it is estimated from the residual where
    there is no texture, which holds P - 1 of P parts of it.

    z, residual : (P, C, H, W); sharp : (C, H, W); R : half-size of the masks. Noise grows with light, errors of the
    masks with texture within their reach: local variances are regressed on both. 0 where no place is smooth.
    """
    wide = 2 * R + 1
    down, across = np.gradient(sharp.astype(np.float64), axis=(-2, -1))
    steep = (down**2 + across**2).mean(axis=0)
    maps = (z.mean(axis=(0, 1)), uniform_filter(steep, wide), (residual.astype(np.float64) ** 2).mean(axis=(0, 1)))
    step = slice(R, -R or None, WINDOW // 2)
    light, texture, power = (uniform_filter(image, WINDOW)[step, step].ravel() for image in maps)
    if np.percentile(texture, 10) > SMOOTH * texture.mean() or texture.size < 30:
        return 0.0
    design = np.column_stack([np.ones_like(light), light.clip(0), texture / texture.mean()])
    coefficients, trust = np.zeros(3), 1 / np.maximum(power, 1e-3 * power.mean() + 1e-30)
    for _ in range(4):
        coefficients = nnls(design * trust[:, None], power * trust)[0]
        trust = 1 / np.maximum(design @ coefficients, 1e-3 * power.mean() + 1e-30)
    return float(np.sqrt(np.mean(design[:, :2] @ coefficients[:2]))) * float(np.sqrt(len(z) / (len(z) - 1)))
