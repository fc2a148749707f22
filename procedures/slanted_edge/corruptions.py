"""Corruptions of an edge: tests of them, and what those that it cannot exclude add to the curve's uncertainty."""

import math

import numpy as np
from scipy.ndimage import maximum_filter1d

from procedures.corruption.directions import mask_gain
from procedures.corruption.family import (
    GHOSTED,
    MOSAIC,
    OVERSHOOT,
    PERIODIC,
    SCATTER,
    SHARPENED,
    SPARED,
    TONE_CURVE,
    VEILED,
    Strength,
    nuisance,
)
from procedures.corruption.noise import CONTRASTS, MASK_RADII, noise_checks
from procedures.numerics.arrays import Array
from procedures.outcome import Check
from procedures.slanted_edge.evidence import HALO_PX, MIDTONES, WIDE_PX, Evidence
from procedures.slanted_edge.profile import EdgeProfile
from procedures.slanted_edge.transfer import FREQUENCIES, STEP, mtf_of

PRESENT = 0.5
"""Prior probability of each corruption but the ghost. Of the corrupted edges of tests/benchmarks/adversarial.py that
pass, 97.8 % then lie within two uncertainties, and one of 580 beyond three."""
MASK_PRIOR, HALO_PRIOR = 0.08, 0.05
"""Prior amounts of unsharp masks of 1 and of 3 pixels in a picture that is no RAW file."""
HALO_MODEL = 0.02
"""Standard uncertainty of the amount beside the edge by the lens's own spread function, of the lenses of
tests/benchmarks/adversarial.py."""
WIDE_MODEL = 0.01
"""Standard uncertainty, by the lens, of the amount of a mask of 10 pixels."""
GHOST_MODEL = 0.03
"""Standard uncertainty of the amount of a ghost, which takes light as a mask does, by the lens."""
MISSING_MODEL = 0.005
"""Part of that uncertainty that may also be negative: light that a lens lacks beside the edge."""
PERIODIC_PLACES = 10
"""Independent frequencies among those searched for a rise of the MTF."""
TONE_PRIOR = 0.36
"""Prior of the logarithm of a tone curve's exponent in a picture that is no RAW file."""
CONTRAST_PRIOR, CONTRAST_MODEL = 0.3, 0.1
"""Prior strength of an S-shaped tone curve, which raises the noise of the edge as a mask of this amount does; standard
uncertainty by a curve that is not centred between the plains."""
LOCAL_PRIOR, LOCAL_MODEL = 0.5, 0.05
"""Prior loss of contrast amid dark and bright by a filter of local contrast that keeps edges; standard uncertainty of
that loss by the noise's model."""
SIGN_BINS = 9
"""Frequencies over which a curve's change is the largest: it has no sign where the transfer function crosses zero."""
TONE_MODEL = 0.3
"""Standard uncertainty of that logarithm by the growth of the noise: read noise and the pixels' unlike gain."""
REPEATED, REPEATED_AT = 0.005, 0.8
"""Aliases of four bins to a pixel: relative standard uncertainty of a frequency at 0.8 cycles/pixel, growing with the
fourth power of the frequency; from edges of known transfer functions."""
TONE_STEP = 0.05
"""Exponent's logarithm, or strength of an S-shaped curve, for the numerical derivative by it."""


def corruption_checks(evidence: Evidence, *, raw: bool) -> list[Check]:
    """Tests of the corruptions that an edge shows."""
    fall = f"the edge overshoots its plains by {evidence.fall:.1f} standard uncertainties"
    halo = (
        f"{evidence.halo.value:.1%} of the light is missing beside the edge ({evidence.halo.score:.1f} uncertainties)"
    )
    return [
        *noise_checks(evidence.masks, evidence.textured, raw=raw),
        *([] if raw else [MOSAIC.check(evidence.mosaic, raw=raw, places=2 * len(CONTRASTS))]),
        TONE_CURVE.check(-evidence.growth, raw=raw),
        SCATTER.check(evidence.scatter, raw=raw, places=2),
        SPARED.check(evidence.spared, raw=raw),
        OVERSHOOT.check(evidence.fall, fall, raw=raw, places=evidence.windows),
        OVERSHOOT.check(evidence.halo.value / math.hypot(evidence.halo.uncertainty, MISSING_MODEL), halo, raw=raw),
        VEILED.check(evidence.tail, raw=raw),
        PERIODIC.check(evidence.period, f"{evidence.rise:.2f}", raw=raw, places=PERIODIC_PLACES),
    ]


def modes_of(evidence: Evidence, profile: EdgeProfile, mtf: Array, *, raw: bool) -> dict[str, Array]:
    """Standard deviations of the curve (f,) by the bins and each corruption not excluded: modes, of one sign at all
    frequencies."""
    f = FREQUENCIES
    modes = {
        "bins": np.gradient(mtf, STEP) * f * REPEATED * (f / REPEATED_AT) ** 4,
        SCATTER.name: mtf * (1 - np.exp(-2 * (np.pi * f * evidence.scatter_px) ** 2)),
    }
    unseen, noise = evidence.halo.unseen, evidence.halo.uncertainty
    ghost = min(abs(evidence.ghost), 1.0) * nuisance(unseen, math.hypot(noise, GHOST_MODEL), HALO_PRIOR)
    modes[GHOSTED.name] = mtf * ghost * mask_gain(f, HALO_PX)
    if raw:
        return modes
    amount = _mask_amount(evidence.masks[MASK_RADII.index(1.0)], evidence.scattered)
    halo = nuisance(unseen, math.hypot(noise, HALO_MODEL), HALO_PRIOR, PRESENT)
    wide = nuisance(evidence.wide.value, math.hypot(evidence.wide.uncertainty, WIDE_MODEL), HALO_PRIOR, PRESENT)
    exponent, spread = _tone(evidence)
    # a curve may bend either way: one corruption each
    bent = [nuisance(sign * exponent, spread, TONE_PRIOR, PRESENT) for sign in (1, -1)]
    known = evidence.scattered
    contrast = nuisance(known.value, math.hypot(known.uncertainty, CONTRAST_MODEL), CONTRAST_PRIOR, PRESENT)
    loss = math.hypot(evidence.compressed.uncertainty, LOCAL_MODEL)
    local = nuisance(evidence.compressed.value, loss, LOCAL_PRIOR, PRESENT)
    return modes | {
        SHARPENED.name: mtf * amount * mask_gain(f, 1.0),
        OVERSHOOT.name: mtf * halo * mask_gain(f, HALO_PX),
        "wide mask": mtf * wide * mask_gain(f, WIDE_PX),
        TONE_CURVE.name: math.hypot(*bent) * _by_tone(profile),
        "contrast": np.hypot(contrast * _by_contrast(profile, 1), local * _by_contrast(profile, MIDTONES)),
    }


def _mask_amount(plains: Strength, edge: Strength) -> float:
    """Nuisance of a mask that is as likely to spare the plains, by a threshold, as it is to sharpen them."""
    unseen = [one for one in (plains, edge) if math.isfinite(one.uncertainty)]
    information = sum(one.uncertainty**-2 for one in unseen)
    both = sum(one.unseen / one.uncertainty**2 for one in unseen) / information if unseen else 0.0
    spread = information**-0.5 if unseen else math.inf
    alone = nuisance(edge.unseen, edge.uncertainty, MASK_PRIOR, PRESENT)
    return math.hypot(alone, nuisance(both, spread, MASK_PRIOR, PRESENT)) / 2**0.5


def _tone(evidence: Evidence) -> tuple[float, float]:
    """Logarithm of a tone curve's exponent 1/g and its uncertainty, by the growth of photon noise, as the picture to 2
    - g."""
    if not math.isfinite(evidence.exponent):
        return 0.0, math.inf
    return math.log(max(2 - evidence.exponent, 0.5)), TONE_MODEL


def _by_tone(profile: EdgeProfile) -> Array:
    """Change of the curve (f,) by the logarithm of a tone curve's exponent."""
    floor = 1e-3 * profile.contrast
    levels = profile.light[0] + profile.contrast * np.concatenate([[0.0, 1.0], np.clip(profile.esf, 0, 1)])
    low, high, *curved = np.maximum(levels, floor) ** (1 + TONE_STEP)
    return _by_curve(profile, (np.array(curved) - low) / (high - low))


def _by_contrast(profile: EdgeProfile, exponent: int) -> Array:
    """Change of the curve (f,) by a tone curve whose slope at light l rises as (4 l (1 - l))^exponent."""
    light = np.linspace(0, 1, 401)
    change = np.cumsum((4 * light * (1 - light)) ** exponent) * light[1]  # the slope is 0 at both ends
    curved = light + TONE_STEP * (change - change[-1] * light)
    return _by_curve(profile, np.interp(np.clip(profile.esf, 0, 1), light, curved))


def _by_curve(profile: EdgeProfile, curved: Array) -> Array:
    window = np.asarray(profile.tail), profile.flat_px, profile.end_px
    both = mtf_of(np.stack([np.clip(profile.esf, 0, 1), curved]), *window)
    return np.asarray(maximum_filter1d(np.abs(both[1] - both[0]) / TONE_STEP, SIGN_BINS))
