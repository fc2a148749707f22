"""Whether a PSF from two photographs can be trusted: what is refused beforehand, and the verdict on what was found."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.choice import FINEST, Trial
from procedures.numerics.warps import homography_jacobian
from procedures.outcome import Refused, Rule, Verdict, verdict_of
from procedures.psf import Sampling
from procedures.reading.exposure import Exposure
from procedures.two_photo.diagnostics import Diagnostics, clipped_share

Array = npt.NDArray[np.float64]

CLEAR_OF = 1.02
"""By how much the zoom must exceed s that is chosen."""
COARSE_REMAINS, FINE_REMAINS, SMOOTHING, STREAKS = 1.6, 0.8, 1.35, 1.4
"""Power of the remains at coarse over fine detail, at middle over the finest, and along x over along y, that noise does
not have."""
LIGHT_TURNED = 0.005
"""Variation with the direction at coarse detail: a lens gives 0.001."""
COARSE_SHARE = 0.05
"""Share of the wall's coarse detail that may differ."""
BEYOND_LIGHT, DUG_OUT = 0.02, 4.0
"""Excess over what cosines allow, and light missing around the core in standard uncertainties."""
SMOOTHED = 0.8
"""Noise of the near photograph over the far one's."""
AT_DETAIL = 1.5
"""Power of the remains at the wall's detail over that where it has none."""
TURNED = 0.1
"""Growth of the spectrum's variation with direction, per factor e of the frequency."""
OTHER_FOCUS = 0.15
"""Share of the MTF at Nyquist that the focus may put in doubt."""
SCATTERED = 9.0
"""Variance of a number by the region's parts, over that by noise, from which it is doubted."""
Array32 = npt.NDArray[np.float32]


def check_light(near: Array32, far: Array32) -> float:
    """The larger share of clipped samples in either photograph.

    Raises
    ------
    Refused
        If too much of a photograph is clipped, or it shows next to no light, or is of a few pixels only.
    """
    clipped = []
    for photograph in (near, far):
        if min(photograph.shape) < 3:  # noise is told by second differences
            rows, columns = photograph.shape
            raise Refused(f"photographs must be 3 pixels wide and high; one is {columns} x {rows}", "give whole ones")
        clipped.append(clipped_share(photograph))
        if clipped[-1] > 0.05:
            raise Refused(
                f"the wall must not be clipped; {clipped[-1]:.0%} of a photograph is",
                "expose both less, by the same amount",
            )
        if np.percentile(photograph[::5, ::5], 99) < 0.01:
            raise Refused("the wall must stand clear of black; a photograph is all but dark", "expose both longer")
    return max(clipped)


def most_samples_per_pixel(H_near_far: Array, far_shape: tuple[int, ...]) -> int:
    """The largest s under the smallest zoom: with less the inter-image kernel is not determined. Source: as below."""
    return int(np.clip(np.ceil(_least_zoom(H_near_far, far_shape) / CLEAR_OF) - 1, 2, FINEST))


def check_distance(H_near_far: Array, far_shape: tuple[int, ...], s: int) -> None:
    """Refuse a far photograph that is not far enough for s samples per pixel.

    Source: thesis, remark 5: with lambda under s the inter-image kernel is not determined.
    """
    zoom = _least_zoom(H_near_far, far_shape)
    if zoom <= s:
        possible = int(np.ceil(zoom)) - 1
        raise Refused(
            f"s = {s} needs the far photograph from more than {s} times the near one's distance; it is from {zoom:.2f} "
            "times",
            f"take the far photograph from {1.15 * s / zoom:.2f} times its distance, or the near one from as much "
            "closer" + (f", or choose s = {possible}" if possible >= 2 else ""),
        )


def _least_zoom(H_near_far: Array, far_shape: tuple[int, ...]) -> float:
    """Near pixels per far pixel in the middle of the far photograph, along the direction where they are fewest."""
    rows, columns = far_shape
    J = homography_jacobian(H_near_far, np.array([(columns - 1) / 2, (rows - 1) / 2]))
    return float(np.linalg.svd(J, compute_uv=False)[-1])


def check_settings(a: Exposure, b: Exposure) -> None:
    """Refuse photographs that the camera noted to be of different optics: only focus and shutter may differ."""
    for unit, first, second in (
        ("f-number", a.f_number, b.f_number),
        ("focal length", a.focal_length_mm, b.focal_length_mm),
        ("camera", a.camera, b.camera),
    ):
        if first and second and first != second:
            raise Refused(
                f"both photographs need the same {unit}; they have {first} and {second}",
                "change nothing between the photographs but distance and focus",
            )


def judge(
    d: Diagnostics, asked: Sampling, tried: tuple[Trial, ...], s: int, contradicted: list[Rule]
) -> tuple[Verdict, str, str]:
    """Verdict, reason and remedy: the first refusal, else all doubts together.

    `contradicted` is what f-number and pitch forbid, as far as they are known.
    """
    return verdict_of(
        _refusals(d)
        + _doubts(d, s)
        + _other_light(d)
        + _processed(d)
        + _unlike(d, tried[-1].band_open)
        + _left_out(asked, tried[-1], d.scale)
        + contradicted
    )


def _other_light(d: Diagnostics) -> list[Rule]:
    """What the near photograph does not explain of the far one, as another light or focus leaves it: coarse."""
    doubtful = Verdict.DOUBTFUL
    return [
        Rule(
            doubtful,
            d.colour > COARSE_REMAINS,
            f"what the near photograph does not explain is coarse, {d.colour:.1f} times as strong as at fine detail: "
            "the light came from elsewhere, or the far photograph is softer than the near one",
            "take both in the same steady light, focus at either distance, and let nothing move",
        ),
        Rule(
            doubtful,
            d.light_turned > LIGHT_TURNED,
            "the contrast of coarse detail changed with its direction between the photographs: the light came from "
            "elsewhere, or the lens throws much light farther one way than the other (a corner, strong astigmatism)",
            "take both in the same light, one soon after the other, or choose a wall that is painted, not rough; in "
            "the middle of the frame only light is left as a cause",
        ),
        Rule(
            doubtful,
            d.left_over > COARSE_SHARE,
            f"{d.left_over:.0%} of the wall's coarse detail is not the same in both photographs: another light, or a "
            "response that is not linear",
            "take both in the same steady light, with the same exposure, as RAW files",
        ),
    ]


def _processed(d: Diagnostics) -> list[Rule]:
    """What it does not explain, as smoothing, sharpening, compression or motion leave it."""
    doubtful = Verdict.DOUBTFUL
    return [
        Rule(
            doubtful,
            d.smoothing > SMOOTHING,
            f"the far photograph's noise is {d.smoothing:.1f} times as strong at middle detail as at the finest: "
            "it was smoothed",
            "use the RAW files",
        ),
        Rule(
            doubtful,
            d.colour < FINE_REMAINS,
            f"what the near photograph does not explain is fine, at coarse detail {d.colour:.2f} times as strong: the "
            "far photograph was sharpened or compressed",
            "use the RAW files",
        ),
        Rule(
            doubtful,
            not 1 / STREAKS < d.streaks < STREAKS,
            f"what the near photograph does not explain is {max(d.streaks, 1 / d.streaks):.1f} times as strong along "
            "one axis as along the other: the camera moved in the far exposure, or the photograph was processed",
            "take both from a tripod, without touching the camera, as RAW files",
        ),
        Rule(
            doubtful,
            d.detail > AT_DETAIL,
            f"what the near photograph does not explain is {d.detail:.1f} times as strong at the wall's detail as "
            "where it has none: the far photograph was smoothed all but for its edges",
            "use the RAW files, or choose a flat wall",
        ),
    ]


def _unlike(d: Diagnostics, band_open: bool) -> list[Rule]:
    """What tells that the photographs are not equally sharp, equally lit and unprocessed.

    A band that ends where the OTF has not rings around the core as sharpening does.
    """
    doubtful = Verdict.DOUBTFUL
    return [
        Rule(
            doubtful,
            d.beyond_light > BEYOND_LIGHT or (d.missing_light > DUG_OUT and not band_open),
            "no PSF of light has this MTF: the far photograph was sharpened, or the near one softened",
            "use the RAW files, focused at either distance",
        ),
        Rule(
            doubtful,
            d.focus_effect > OTHER_FOCUS,
            f"the near photograph's fine detail is not what a wall of this kind has: if the focus is why, the MTF at "
            f"Nyquist is wrong by {d.focus_effect:.0%}",
            "focus again at either distance, use the RAW files, or choose a wall with more fine detail",
        ),
        Rule(
            doubtful,
            d.near_noise < SMOOTHED,
            f"the near photograph has at most {d.near_noise:.0%} of the noise that the far one has: it was smoothed, "
            "reduced or compressed, or they are not of one wall",
            "use the RAW files, with the same exposure",
        ),
        Rule(
            doubtful,
            d.turned > TURNED,
            "the near photograph's fine detail has another direction than its coarse detail: its light came from "
            "elsewhere, it was moved or processed, or the wall is such",
            "take both in the same steady light, from a tripod, of a wall without a direction",
        ),
        Rule(
            doubtful,
            d.mismatch > SCATTERED,
            f"parts of the wall disagree: {d.mismatch**0.5:.1f} times as far as noise explains",
            "choose a flat wall, photograph it squarely, in even light",
        ),
    ]


def _left_out(asked: Sampling, last: Trial, scale: float) -> list[Rule]:
    """What s and k as they were given leave out, and what no s can give from where the photographs were taken."""
    doubtful = Verdict.DOUBTFUL
    would = f"use -s {last.better[0]} -k {last.better[1]}, or leave both to the program" if last.better else "raise k"
    needed = last.s + 1
    farther = f"take the far photograph from {1.1 * needed / scale:.2f} times its distance: it needs s = {needed}"
    return [
        Rule(
            doubtful,
            asked.k is not None and last.support_short,
            f"k = {last.k} may leave out {last.truncation:.4f} of the OTF, which is known to {last.uncertainty:.4f}",
            would,
        ),
        Rule(
            doubtful,
            asked.s is not None and last.band_open and last.better is not None and last.better[0] > last.s,
            f"s = {last.s} ends the band where the OTF is still {last.band_edge:.2f}",
            would,
        ),
        Rule(
            doubtful,
            None in last.mtf50,
            f"MTF50 lies beyond the band of s = {last.s}",
            f"use -s {needed}" if needed < scale / CLEAR_OF else farther,
        ),
    ]


def _refusals(d: Diagnostics) -> list[Rule]:
    """What makes a PSF unusable, the most telling first."""
    refused = Verdict.REFUSED
    flat = "choose a flat wall without relief, photograph it squarely, and keep everything out of its way"
    return [
        Rule(
            refused,
            d.agreement < 0.3,
            f"the near photograph must explain the far one; it explains {max(d.agreement, 0):.0%} of it",
            "photograph the same flat part of a wall from both distances, in the same light",
        ),
        Rule(
            refused,
            d.local_shift_px > 0.1,
            f"the wall must be one plane; parts of it lie {d.local_shift_px:.2f} pixel from where one plane puts them",
            flat,
        ),
        Rule(
            refused,
            d.relief_px > 0.25,
            f"the wall must be flat; its relief moves details by {d.relief_px:.2f} pixel between the photographs",
            flat,
        ),
        Rule(
            refused,
            d.sharpness_ratio < 0.2,
            f"the near photograph must be as sharp as the far one; it has {d.sharpness_ratio:.0%} of its fine contrast",
            "focus again at the near distance",
        ),
        Rule(
            refused,
            d.relative_uncertainty > 1,
            f"the PSF's uncertainty is {d.relative_uncertainty:.0%} of the PSF: the wall's spectrum is too weak",
            "choose a rougher wall with detail of all sizes, expose longer, or lower s or k",
        ),
    ]


def _doubts(d: Diagnostics, s: int) -> list[Rule]:
    """What leaves a PSF usable but less than two photographs could have given."""
    return _doubts_of_wall(d, s) + _doubts_of_camera(d)


def _doubts_of_wall(d: Diagnostics, s: int) -> list[Rule]:
    """What the wall and its place may lack."""
    doubtful = Verdict.DOUBTFUL
    determined = min(d.determined_horizontal, d.determined_vertical)
    return [
        Rule(
            doubtful,
            d.local_shift_px > 0.02 and d.local_shift_significance > 6,
            f"parts of the wall lie {d.local_shift_px:.3f} pixel from where one plane puts them",
            "choose a flatter wall",
        ),
        Rule(
            doubtful,
            d.relief_px > 0.06,
            f"the wall's relief moves details by {d.relief_px:.2f} pixel between the photographs",
            "choose a wall without relief",
        ),
        Rule(
            doubtful,
            d.relative_uncertainty > 0.3,
            f"the PSF's uncertainty is {d.relative_uncertainty:.0%} of the PSF",
            "choose a rougher wall, expose longer, or lower s or k",
        ),
        Rule(
            doubtful,
            determined < s / 2,
            f"the wall's spectrum determines the MTF up to {determined:.2f} cycles/pixel only",
            "choose a wall with finer detail",
        ),
        Rule(
            doubtful,
            d.outliers > 0.02,
            f"{d.outliers:.1%} of the far photograph does not show what the near one shows",
            "keep everything out of the way between camera and wall, in the same light",
        ),
        Rule(
            doubtful,
            d.scale_spread > 0.25,
            f"the zoom between the photographs varies by {d.scale_spread:.0%} over the wall",
            "photograph the wall squarely from both distances",
        ),
    ]


def _doubts_of_camera(d: Diagnostics) -> list[Rule]:
    """What the two exposures may lack."""
    doubtful = Verdict.DOUBTFUL
    refocus = "focus again at either distance, with nothing else changed"
    return [
        Rule(
            doubtful,
            0.2 <= d.sharpness_ratio < 0.4 or d.excess > 0.05,
            "the near photograph is less sharp than the far one: the PSF comes out too sharp",
            refocus,
        ),
        Rule(
            doubtful,
            d.sharpness_ratio > 1.8,
            "the far photograph is less sharp than the near one: the PSF is that of the far one",
            refocus,
        ),
        Rule(
            doubtful,
            not 0.85 <= d.gain <= 1.15,
            f"the far photograph has {d.gain:.2f} times the near one's contrast",
            "give both the same exposure, in the same light",
        ),
        Rule(
            doubtful,
            d.light_change > 0.1,
            f"the light on the wall changed from place to place, by {d.light_change:.0%}",
            "take both photographs in the same steady light, without your shadow on the wall",
        ),
        Rule(doubtful, d.saturated > 0.01, f"{d.saturated:.1%} of a photograph is clipped", "expose both less"),
        Rule(
            doubtful,
            d.near_noise_bias > 0.1,
            f"the near photograph's noise would change the kernel by {d.near_noise_bias:.0%}: its correction is rough",
            "expose both longer",
        ),
        Rule(
            doubtful,
            d.support_cut > 0.08,
            f"about {d.support_cut:.0%} of the PSF's energy lies outside its support",
            "focus, or raise k",
        ),
        Rule(doubtful, d.moved_px > 0.1, "the map did not come to rest", "photograph the wall more squarely"),
    ]
