"""Requirements on two photographs, and the verdict on the PSF derived from them."""

import numpy as np
import numpy.typing as npt

from procedures.choice import FINEST, OPEN, Trial
from procedures.numerics.warps import homography_jacobian
from procedures.outcome import SYMPTOM, Check, Refused, Verdict
from procedures.psf import Sampling
from procedures.raw import UNLIKELY_IN_RAW, unprocessed
from procedures.reading.exposure import Exposure
from procedures.two_photo.diagnostics import PairDiagnostics, clipped_share

Array = npt.NDArray[np.float64]

MAX_UNCERTAINTY = 0.3  # relative L2 error of the PSF above which a coarser grid is tried, and the PSF is doubtful
ZOOM_MARGIN = 1.02  # minimum of the zoom over a chosen s
COARSE_RESIDUAL, FINE_RESIDUAL, SMOOTHING, STREAKS = 1.6, 0.8, 1.35, 1.4
"""Limits of the residual's power at coarse over fine detail, at middle over the finest, and along x over along y."""
LIGHT_TURNED = 0.005  # limit of the variation with the direction at coarse detail: a lens gives 0.001
FAR_SOFTER = 1.8
"""Fine contrast of the near photograph over the far one's above which the focus of the far one is doubtful."""
PARTS_OFF_PX, PARTS_OFF_SIGMAS = 0.02, 6.0
"""Significant distance of a part of the wall from one plane, in pixels and in standard uncertainties."""
MOVED_PX = 0.1  # accepted last move of the map
COARSE_SHARE = 0.05  # accepted difference of the wall's coarse detail, relative to its amplitude
BEYOND_LIGHT, MISSING_LIGHT = 0.02, 4.0
"""Accepted violation of the inequality of cosines, and light missing around the core in standard uncertainties."""
SMOOTHED = 0.8  # minimum noise of the near photograph, relative to the far one's
AT_DETAIL = 1.5  # limit of the residual's power at the wall's detail over that where it has none
MAX_NOISE_CORRECTION, MAX_SUPPORT_CUT = 1.0, 0.15
"""Accepted correction of the kernel for the near photograph's noise, relative to the kernel; accepted share of energy
outside the support. The uncertainty covers both: see tests/benchmarks/adversarial.py."""
TURNED = 0.1  # limit of the growth of the spectrum's variation with direction, per factor e of the frequency
OTHER_FOCUS = 0.15  # accepted effect of the focus on the MTF at Nyquist
SCATTERED = 9.0  # accepted variance of a number by the region's parts, over that by noise
Array32 = npt.NDArray[np.float32]


def check_light(near: Array32, far: Array32) -> float:
    """The larger share of clipped samples in either photograph.

    Raises Refused if too much of a photograph is clipped, or it is almost black, or narrower than three pixels.
    """
    clipped = []
    for photograph in (near, far):
        rows, columns = photograph.shape
        if min(rows, columns) < 3:  # noise is estimated by second differences
            reason = f"photographs must be at least 3 pixels wide and high; one is {columns} x {rows}"
            raise Refused(reason, "give whole photographs")
        clipped.append(clipped_share(photograph))
        if clipped[-1] > 0.05:
            raise Refused(
                f"the wall must not be clipped; {clipped[-1]:.0%} of a photograph is",
                "expose both less, by the same amount",
            )
        if np.percentile(photograph[::5, ::5], 99) < 0.01:
            raise Refused("the wall must be brighter than black; a photograph is almost dark", "expose both longer")
    return max(clipped)


def most_samples_per_pixel(H_near_far: Array, far_shape: tuple[int, ...]) -> int:
    """The largest s below the smallest zoom; see `check_distance`."""
    return int(np.clip(np.ceil(_least_zoom(H_near_far, far_shape) / ZOOM_MARGIN) - 1, 2, FINEST))


def check_distance(H_near_far: Array, far_shape: tuple[int, ...], s: int) -> None:
    """Refuse a far photograph that is not far enough for s samples per pixel.

    The inter-image kernel is not determined for a zoom lambda below s (Delbracio's thesis, remark 5).
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
    """Smallest number of near pixels per far pixel along any direction, in the middle of the far photograph."""
    rows, columns = far_shape
    J = homography_jacobian(H_near_far, np.array([(columns - 1) / 2, (rows - 1) / 2]))
    return float(np.linalg.svd(J, compute_uv=False)[-1])


def check_settings(a: Exposure, b: Exposure) -> None:
    """Refuse photographs with different optics in the camera's metadata: only focus and shutter may differ."""
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


def checks_of(
    d: PairDiagnostics, asked: Sampling, tried: tuple[Trial, ...], s: int, contradicted: list[Check], *, raw: bool
) -> list[Check]:
    """All checks on a PSF.

    contradicted : contradictions to f-number and pitch, where known
    raw : whether both photographs are RAW files
    """
    return [
        *_refusals(d), *_wall_checks(d, s), *_camera_checks(d), *_light_checks(d, raw), *_processing_checks(d, raw),
        *_consistency_checks(d, raw, tried[-1].band_open), *_sampling_checks(asked, tried[-1], d.scale), *contradicted,
    ]  # fmt: skip


def _shifted(d: PairDiagnostics) -> bool:
    """Whether parts of the wall deviate from its plane: misregistered detail appears soft, smoothed and noisy."""
    return d.local_shift_px > PARTS_OFF_PX and d.local_shift_significance > PARTS_OFF_SIGMAS


def _processing(d: PairDiagnostics, raw: bool) -> float:
    return SYMPTOM if _shifted(d) else UNLIKELY_IN_RAW if raw else 1.0


def _as_raw(raw: bool) -> str:
    """Addition to a remedy where the photographs are not RAW files."""
    return "" if raw else ", as RAW files"


def _light_checks(d: PairDiagnostics, raw: bool) -> list[Check]:
    doubtful = Verdict.DOUBTFUL
    return [
        Check("coarse residual", d.colour, COARSE_RESIDUAL, doubtful,
              f"the residual of the far photograph is coarse, {d.colour:.1f} times as strong as at fine detail: "
              "the light came from elsewhere, or the far photograph is softer than the near one",
              "take both in the same steady light, focus at either distance, and let nothing move"),
        Check("direction of the light", d.light_turned, LIGHT_TURNED, doubtful,
              "the contrast of coarse detail changed with its direction between the photographs: the light came from "
              "elsewhere, or the lens spreads much light in one direction (a corner, strong astigmatism)",
              "take both in the same light, one soon after the other, or choose a wall that is painted, not rough; in "
              "the middle of the frame light is the only cause"),
        Check("coarse detail", d.coarse_residual, COARSE_SHARE, doubtful,
              f"{d.coarse_residual:.0%} of the wall's coarse detail is not the same in both photographs: another "
              "light, or a response that is not linear",
              f"take both in the same steady light, with the same exposure{_as_raw(raw)}"),
    ]  # fmt: skip


def _processing_checks(d: PairDiagnostics, raw: bool) -> list[Check]:
    doubtful, prior = Verdict.DOUBTFUL, _processing(d, raw)
    files, streaks = unprocessed(raw, "use the RAW files"), max(d.streaks, 1 / max(d.streaks, 1e-12))
    return [
        Check("smoothing", d.smoothing, SMOOTHING, doubtful,
              f"the far photograph's noise is {d.smoothing:.1f} times as strong at middle detail as at the finest: "
              "it was smoothed", files, prior=prior),
        Check("fine residual", d.colour, FINE_RESIDUAL, doubtful,
              f"the residual of the far photograph is fine, at coarse detail {d.colour:.2f} times as strong: "
              "the far photograph was sharpened or compressed", files, least=True, prior=prior),
        Check("streaks", streaks, STREAKS, doubtful,
              f"the residual of the far photograph is {streaks:.1f} times as strong along one axis as along the "
              "other: the camera moved in the far exposure"
              + ("" if raw else ", or the photograph was processed"),
              f"take both from a tripod, without touching the camera{_as_raw(raw)}"),
        Check("residual at detail", d.detail, AT_DETAIL, doubtful,
              f"the residual of the far photograph is {d.detail:.1f} times as strong at the wall's detail as where it "
              "has none: the far photograph was smoothed except at edges, or the near one is aliased",
              f"{files}, choose a flat wall, or stop the lens down", prior=prior),
    ]  # fmt: skip


def _consistency_checks(d: PairDiagnostics, raw: bool, band_open: bool) -> list[Check]:
    """Checks for unequal sharpness, unequal light and processing.

    A band that ends before the OTF does rings around the core like sharpening; a far photograph that is softer than the
    near one was not sharpened.
    """
    softer = d.sharpness_ratio > FAR_SOFTER
    doubtful, prior = Verdict.DOUBTFUL, _processing(d, raw)
    no_light = "no PSF of light has this MTF: the far photograph was sharpened, or the near one softened"
    focused = "focus again at either distance" if raw else "use the RAW files, focused at either distance"
    return [
        Check("MTF of light", d.beyond_light, BEYOND_LIGHT, doubtful, no_light, focused, given=not softer),
        Check("MTF of light", d.missing_light, MISSING_LIGHT, doubtful, no_light, focused,
              given=not (softer or band_open)),
        Check("near focus", d.focus_effect, OTHER_FOCUS, doubtful,
              f"the near photograph's fine detail is unusual for this wall: if the focus is the cause, the MTF at "
              f"Nyquist is wrong by {d.focus_effect:.0%}",
              f"focus again at either distance{'' if raw else ', use the RAW files'}, or choose a wall with more fine "
              "detail"),
        Check("near noise", d.near_noise, SMOOTHED, doubtful,
              f"the near photograph has at most {d.near_noise:.0%} of the noise that the far one has: it was smoothed, "
              "reduced or compressed, or they are not of one wall",
              f"{unprocessed(raw, 'use the RAW files')}, and give both the same exposure", least=True, prior=prior),
        Check("direction of fine detail", d.turned, TURNED, doubtful,
              "the near photograph's fine detail has another direction than its coarse detail: its light came from "
              "elsewhere, it was moved or processed, or the wall itself is anisotropic",
              "take both in the same steady light, from a tripod, of a wall without a direction"),
        Check("parts", d.mismatch**0.5, SCATTERED**0.5, doubtful,
              f"parts of the wall disagree by {d.mismatch**0.5:.1f} times their noise",
              "choose a flat wall, photograph it squarely, in even light", prior=SYMPTOM),
    ]  # fmt: skip


def _sampling_checks(asked: Sampling, last: Trial, scale: float) -> list[Check]:
    """Checks of the given s and k, and of the largest s that the distances allow."""
    doubtful = Verdict.DOUBTFUL
    better = f"use -s {last.better[0]} -k {last.better[1]}, or leave both to the program" if last.better else "raise k"
    needed = last.s + 1
    farther = f"take the far photograph from {1.1 * needed / scale:.2f} times its distance: it needs s = {needed}"
    return [
        Check("truncation", last.truncation, last.most_truncated, doubtful,
              f"k = {last.k} may truncate {last.truncation:.4f} of the OTF, which is known to {last.uncertainty:.4f}",
              better, given=asked.k is not None),
        Check("band edge", last.band_edge, OPEN, doubtful,
              f"s = {last.s} ends the band where the OTF is still {last.band_edge:.2f}", better,
              given=asked.s is not None and last.better is not None and last.better[0] > last.s),
        Check("MTF50", None in last.mtf50, 0, doubtful, f"MTF50 lies beyond the band of s = {last.s}",
              f"use -s {needed}" if needed < scale / ZOOM_MARGIN else farther),
    ]  # fmt: skip


def _refusals(d: PairDiagnostics) -> list[Check]:
    refused = Verdict.REFUSED
    flat = "choose a flat wall without relief, photograph it squarely, and keep everything out of its way"
    unsharp = (SYMPTOM if _shifted(d) else 1.0) * (SYMPTOM if d.moved_px > MOVED_PX else 1.0)
    return [
        Check("agreement", d.agreement, 0.3, refused,
              f"the near photograph must explain the far one; it explains {max(d.agreement, 0):.0%} of it",
              "photograph the same flat part of a wall from both distances, in the same light", least=True),
        Check("local shift", d.local_shift_px, 0.1, refused,
              f"the wall must be one plane; parts of it deviate by {d.local_shift_px:.2f} pixel from a plane",
              flat),
        Check("relief", d.relief_px, 0.25, refused,
              f"the wall must be flat; its relief moves details by {d.relief_px:.2f} pixel between the photographs",
              flat),
        Check("sharpness", d.sharpness_ratio, 0.2, refused,
              f"the near photograph must be as sharp as the far one; it has {d.sharpness_ratio:.0%} of its fine "
              "contrast", "focus again at the near distance", least=True, prior=unsharp),
        Check("uncertainty", d.relative_uncertainty, 1.0, refused,
              f"the PSF's uncertainty is {d.relative_uncertainty:.0%} of the PSF: the wall's spectrum is too weak",
              "choose a rougher wall with detail of all sizes, expose longer, or lower s or k"),
    ]  # fmt: skip


def _wall_checks(d: PairDiagnostics, s: int) -> list[Check]:
    doubtful = Verdict.DOUBTFUL
    determined = min(d.determined_horizontal, d.determined_vertical)
    return [
        Check("local shift", d.local_shift_px, PARTS_OFF_PX, doubtful,
              f"parts of the wall deviate by {d.local_shift_px:.3f} pixel from a plane",
              "choose a flatter wall", given=d.local_shift_significance > PARTS_OFF_SIGMAS),
        Check("relief", d.relief_px, 0.06, doubtful,
              f"the wall's relief moves details by {d.relief_px:.2f} pixel between the photographs",
              "choose a wall without relief", prior=1.0 if _shifted(d) else SYMPTOM),
        Check("uncertainty", d.relative_uncertainty, MAX_UNCERTAINTY, doubtful,
              f"the PSF's uncertainty is {d.relative_uncertainty:.0%} of the PSF",
              "choose a rougher wall, expose longer, or lower s or k"),
        Check("band", determined, s / 2, doubtful,
              f"the wall's spectrum determines the MTF up to {determined:.2f} cycles/pixel only",
              "choose a wall with finer detail", least=True),
        Check("outliers", d.outliers, 0.02, doubtful,
              f"{d.outliers:.1%} of the far photograph differs from the near one beyond noise",
              "keep everything out of the way between camera and wall, in the same light"),
        Check("scale", d.scale_spread, 0.25, doubtful,
              f"the zoom between the photographs varies by {d.scale_spread:.0%} over the wall",
              "photograph the wall squarely from both distances"),
    ]  # fmt: skip


def _camera_checks(d: PairDiagnostics) -> list[Check]:
    doubtful = Verdict.DOUBTFUL
    refocus = "focus again at either distance, with nothing else changed"
    softer = "the near photograph is less sharp than the far one: the PSF is too sharp"
    return [
        Check("sharpness", d.sharpness_ratio, 0.4, doubtful, softer, refocus, least=True),
        Check("sharpness", d.excess, 0.05, doubtful, softer, refocus),
        Check("sharpness", d.sharpness_ratio, FAR_SOFTER, doubtful,
              "the far photograph is less sharp than the near one: the PSF is that of the far one", refocus),
        Check("contrast", abs(d.gain - 1), 0.15, doubtful,
              f"the far photograph has {d.gain:.2f} times the near one's contrast",
              "give both the same exposure, in the same light"),
        Check("light", d.light_change, 0.1, doubtful,
              f"the light on the wall changed from place to place, by {d.light_change:.0%}",
              "take both photographs in the same steady light, without your shadow on the wall"),
        Check("clipping", d.saturated, 0.01, doubtful, f"{d.saturated:.1%} of a photograph is clipped",
              "expose both less"),
        Check("noise", d.near_noise_bias, MAX_NOISE_CORRECTION, doubtful,
              f"the near photograph's noise would change the kernel by {d.near_noise_bias:.0%}: its correction is "
              "rough", "expose both longer"),
        Check("support", d.support_cut, MAX_SUPPORT_CUT, doubtful,
              f"about {d.support_cut:.0%} of the PSF's energy lies outside its support", "focus, or raise k"),
        Check("convergence", d.moved_px, MOVED_PX, doubtful, "the map did not converge",
              "photograph the wall more squarely"),
    ]  # fmt: skip
