"""Whether a PSF from two photographs can be trusted: what is refused beforehand, and the verdict on what was found."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procedures.exposure import Exposure
from procedures.numerics.warps import homography_jacobian
from procedures.outcome import Refused, Rule, Verdict, verdict_of
from procedures.two_photo.diagnostics import Diagnostics, clipped_share

Array = npt.NDArray[np.float64]
Array32 = npt.NDArray[np.float32]


def check_light(near: Array32, far: Array32) -> None:
    """Refuse photographs of which too much is clipped, or that show next to no light."""
    for photograph in (near, far):
        clipped = clipped_share(photograph)
        if clipped > 0.05:
            raise Refused(
                f"the wall must not be clipped; {clipped:.0%} of a photograph is",
                "expose both less, by the same amount",
            )
        if np.percentile(photograph[::5, ::5], 99) < 0.01:
            raise Refused("the wall must stand clear of black; a photograph is all but dark", "expose both longer")


def check_distance(H_near_far: Array, far_shape: tuple[int, ...], s: int) -> None:
    """Refuse a far photograph that is not far enough for s samples per pixel.

    Source: thesis, remark 5: with lambda under s the inter-image kernel is not determined.
    """
    rows, columns = far_shape
    J = homography_jacobian(H_near_far, np.array([(columns - 1) / 2, (rows - 1) / 2]))
    zoom = float(np.linalg.svd(J, compute_uv=False)[-1])
    if zoom <= s:
        possible = int(np.ceil(zoom)) - 1
        raise Refused(
            f"s = {s} needs the far photograph from more than {s} times the near one's distance; it is from {zoom:.2f} "
            "times",
            f"take the far photograph from {1.15 * s / zoom:.2f} times its distance, or the near one from as much "
            "closer" + (f", or choose s = {possible}" if possible >= 2 else ""),
        )


def check_settings(a: Exposure, b: Exposure) -> None:
    """Refuse photographs that the camera noted to be of different optics: only focus and shutter may differ."""
    for name, unit in (("f_number", "f-number"), ("focal_length_mm", "focal length"), ("camera", "camera")):
        first, second = getattr(a, name), getattr(b, name)
        if first and second and first != second:
            raise Refused(
                f"both photographs need the same {unit}; they have {first} and {second}",
                "change nothing between the photographs but distance and focus",
            )


def judge(d: Diagnostics, s: int) -> tuple[Verdict, str, str]:
    """Verdict, reason and remedy: the first refusal, else all doubts together."""
    return verdict_of(_refusals(d) + _doubts(d, s))


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
