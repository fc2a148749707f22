"""The page of a restoration: before, after, depth, residual, and the refocused picture."""

from typing import Any

import numpy as np
import numpy.typing as npt
from markupsafe import Markup
from scipy.ndimage import uniform_filter

from procedures.restoration.joint.result import Restoration, refocused
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.metres import Distances
from station.drawing.pictures import encoded, levels, picture, smaller
from station.drawing.plots import Figure
from station.reports.page import Block, Figures, KeyNumbers, Note, Scripted, Section, html, image, percent
from station.reports.psf_figures import RESIDUAL_LIMIT, course_figure, map_figure
from station.reports.report import Report
from station.reports.report_page import report_page
from station.reports.restoration_files import Restored

Array = npt.NDArray[np.floating[Any]]

MAX_SIDE_PX = 720
"""Larger pictures are drawn smaller on the page; the files keep every pixel."""
KERNEL_PX = 240
PLACES, PLACE_PX = 3, 64
MAX_STD_PX = 0.5
"""Standard deviation of w above which depth is undetermined."""
RELIEF_PX = 360
RELIEF = """<div class="relief" hidden><canvas tabindex="0" aria-label="{}"></canvas><p>{}</p>
<div hidden>{}{}</div></div>"""
MIN_SPAN_PX, MIN_BLUR_PX = 0.5, 0.2
"""Span of w and blur of the ground truth below which they are not shown."""
FOCUS_AT = (("Sharp where w is large.", 90), ("Sharp where w is in its middle.", 50), ("Sharp where w is small.", 10))
"""Captions of the refocused pictures, and percentiles of w in focus."""


def restoration_page(report: Report) -> str:
    """The page. Raises ValueError without a value."""
    restored: Restored = report.result
    restoration, photographs = restored.outcome.value, restored.photographs
    if restoration is None:
        raise ValueError("a restoration without a value has no page")
    white = float(np.percentile(photographs[0], 99.5))

    def shown(picture_: Array, caption: str) -> Figure:
        small = levels(smaller(picture(picture_), MAX_SIDE_PX), 0, white)
        return Figure(image(encoded(".png", small), caption), caption)

    before = [shown(photograph, f"Photograph {n}.") for n, photograph in enumerate(photographs, 1)]
    after = shown(restoration.sharp, "Restored: `sharp.tiff` keeps the photographs’ scale.")
    kernels = [
        Figure(_kernel(one, n), f"Photograph {n}: `kernel_{n}.npy`, one square per pixel.")
        for n, one in enumerate(() if restoration.kernels is None else restoration.kernels, 1)
    ]
    refocused_ = [shown(one, caption) for caption, one in _refocused(restoration)]
    note = Note("Computed from picture and depth: a blur circle that grows with the distance from the chosen depth.")
    sections = [
        *([Section("Estimated motion", [Figures(kernels)])] if kernels else []),
        Section("Depth and its uncertainty", [Figures(_depth(restoration)), *_relief(restoration, white)]),
        *_metres(restored.distances),
        *_truth(restoration, after),
        Section("Residual", [Figures(_residual(restoration))]),
        *([Section("Refocused", [Figures(refocused_), note])] if refocused_ else []),
    ]
    slider = _slider(photographs[0], restoration.sharp, white)
    first = [Figures([slider], wide=True), Figures(_places(photographs[0], restoration.sharp, white))]
    return report_page(report, summary=[*first, Figures([*before[1:], after]), _facts(restoration)], closing=sections)


def _slider(before: Array, after: Array, white: float) -> Figure:
    """The photograph over the restored picture, up to a border that the reader moves."""
    photograph, restored = (
        image(encoded(".png", levels(smaller(picture(one), MAX_SIDE_PX), 0, white)), words)
        for one, words in ((before, "photograph 1"), (after, "restored picture"))
    )
    words = "Photograph 1, left, and the restored picture: pull the corner below the border."
    return Figure(html('<div class="slider">{}<div>{}</div></div>', restored, photograph), words)


def _places(before: Array, after: Array, white: float) -> list[Figure]:
    """Photograph and restored picture side by side at the places that changed most, each pixel as four."""
    before, after = picture(before), picture(after)
    enlarged = after.shape[0] // before.shape[0]  # a plane of a mosaic has every second pixel of the sensor
    before = np.repeat(np.repeat(before, enlarged, axis=0), enlarged, axis=1)
    change = np.asarray((after - before) ** 2, dtype=np.float64).reshape(*after.shape[:2], -1).mean(axis=2)
    change, half, figures = uniform_filter(change, PLACE_PX), PLACE_PX // 2, []
    change[:half], change[:, :half], change[-half:], change[:, -half:] = (np.float64(0),) * 4
    for _ in range(PLACES):
        y, x = np.unravel_index(np.argmax(change), change.shape)
        if not change[y, x]:
            break
        part = slice(int(y) - half, int(y) + half), slice(int(x) - half, int(x) + half)
        pair = np.concatenate([before[part], after[part]], axis=1)
        data = encoded(".png", levels(np.repeat(np.repeat(pair, 2, axis=0), 2, axis=1), 0, white))
        caption = f"Before and after, about x = {x}, y = {y}."
        figures.append(Figure(image(data, caption), caption))
        change[max(y - 2 * half, 0) : y + 2 * half, max(x - 2 * half, 0) : x + 2 * half] = 0
    return figures


def _facts(restoration: Restoration) -> KeyNumbers:
    diagnostics, unit = restoration.diagnostics, restoration.unit
    low, high = (float(one) * unit.per_pixel for one in (restoration.w.min(), restoration.w.max()))
    facts = [
        (f"{255 * diagnostics.noise:.2f}", "noise of the photographs, grey levels of 255"),
        (f"{diagnostics.residual_over_noise:.2f}", "residual over that noise; up to 1 for the right shape of blur"),
        (percent(diagnostics.picture_std), "of white: expected error of the restored picture; that of the blurred "
         f"photograph is {diagnostics.gained:.1f} times as large"),
    ]  # fmt: skip
    for n, (x, y) in enumerate(restoration.shifts[1:] if restoration.shifts.any() else (), 2):
        facts.append((f"{x:.1f}, {y:.1f}", f"shift of photograph {n} beyond its blur, corrected; x, y in pixels"))
    turns = zip(np.rad2deg(restoration.turns[1:]), restoration.zooms[1:], strict=True)
    for n, (angle, zoom) in enumerate(turns if restoration.turns.any() else (), 2):
        facts.append((f"{angle:.2f}°, {zoom:.4f}", f"rotation and zoom of photograph {n}, corrected"))
    if unit.name == "pixel":
        facts.append((f"{low:.1f} to {high:.1f}", "w, half-width of the blur in photograph 1, pixels"))
    else:
        facts.append((f"{low:.3f} to {high:.3f}", f"w, inverse depth, {unit.name}"))
    facts.append((percent(diagnostics.undetermined), "of the frame with undetermined depth"))
    if diagnostics.occlusion:
        words = "of the frame at depth edges, where a near object occludes the background: w may belong to either side"
        facts.append((percent(diagnostics.occlusion), words))
    return KeyNumbers(facts)


def _map(
    values: Array, unit: str, name: str, caption: str, limits: tuple[float, float], colours: str = "magma"
) -> Figure:
    return map_figure(smaller(values, MAX_SIDE_PX), unit, name, caption, limits=limits, colours=colours)


def _depth(restoration: Restoration) -> list[Figure]:
    unit = restoration.unit
    w, std = restoration.w * unit.per_pixel, restoration.w_std * unit.per_pixel
    words = (
        "The wider the blur, the farther the scene is from the plane of focus"
        if unit.name == "pixel"
        else "One divided by the distance from the camera"
    )
    name = "pixels" if unit.name == "pixel" else unit.name
    bound = "Lower bound of the standard deviation due to noise and texture: `w_std.npy`. Bright areas lack texture."
    return [
        _map(w, f"w in {name}", "depth", f"{words}: `w.npy`.", (float(w.min()), float(w.max())), "viridis"),
        _map(std, f"standard deviation of w in {name}", "spread", bound, (0.0, MAX_STD_PX * unit.per_pixel)),
    ]


def _relief(restoration: Restoration, white: float) -> list[Block]:
    """The restored picture over its depth, which the reader turns; nothing for a flat scene."""
    low, high = (float(np.percentile(restoration.w, p)) for p in (0.5, 99.5))
    if high - low < MIN_SPAN_PX:
        return []
    shown = (picture(restoration.sharp), (0.0, white), "restored picture"), (restoration.w, (low, high), "depth")
    images = [image(encoded(".png", levels(smaller(one, RELIEF_PX), *ends)), words) for one, ends, words in shown]
    words = "The restored picture over w, turned by dragging or the arrow keys: what is wide in photograph 1 is raised."
    return [Scripted(html(RELIEF, words, words, *images), "relief.js")]


def _residual(restoration: Restoration) -> list[Figure]:
    noise = max(restoration.diagnostics.noise, 1e-9)
    std, history = restoration.sharp_std, restoration.history
    error = "The picture’s expected error, with noise and residual: `sharp_std.tiff`."
    contours = "Visible contours indicate misplaced depth edges, or a wrong shape of blur."
    rounds = [r.n for r in history], [r.cost for r in history], [255 * r.residual for r in history]
    top, limits = float(np.percentile(std, 99)), (-RESIDUAL_LIMIT, RESIDUAL_LIMIT)
    scaled, words = restoration.residual[0].mean(axis=0) / noise, "photograph 1 less prediction, in σ of the noise"
    return [
        _map(std, "standard deviation of the picture, white = 1", "uncertain", error, (0.0, top)),
        _map(scaled, words, "residual", contours, limits, "RdBu_r"),
        course_figure(*rounds, "course"),
    ]


def _truth(restoration: Restoration, after: Figure) -> list[Section]:
    truth = restoration.ground_truth
    if truth is None:
        return []
    limit = 3 * max(truth.stated_error, 1e-6)
    before = ", ".join(
        f"photograph {n} {f'{db:.1f} dB' if np.isfinite(db) else 'not alignable'}"
        for n, db in enumerate(truth.before_db, 1)
    )
    softer = (
        f" The ground truth is as soft as the picture after a Gaussian blur of {truth.softer_px:.2f} pixels; after "
        f"this blur the error is {100 * truth.error_as_soft:.2f} %."
        if truth.softer_px > MIN_BLUR_PX
        else ""
    )
    words = (
        f"PSNR relative to the ground truth (white = 1): restored picture {truth.psnr_db:.1f} dB, {before}. The error "
        f"is {100 * truth.error:.2f} % of white, without the ground truth’s noise; the estimated error is "
        f"{100 * truth.stated_error:.2f} %.{softer} The comparison covers {percent(truth.compared)} of the frame; the "
        f"ground truth is {truth.light:.2f} times as bright."
    )
    caption = "Picture less ground truth: `difference.tiff`. Colours end at three times the estimated error."
    off = truth.difference.mean(axis=0)
    drawn = _map(off, "picture less ground truth, white = 1", "difference", caption, (-limit, limit), "RdBu_r")
    return [Section("Comparison with the ground truth", [words, Figures([after, drawn])])]


def _metres(distances: Distances | None) -> list[Section]:
    if distances is None or not distances.determined:
        return []
    low, high = (float(each) for each in np.nanpercentile(distances.metres, (0.5, 99.5)))
    most = float(np.nanpercentile(distances.std, 95))
    words = (
        f"{low:.2f} to {high:.2f} m from the lens, with a standard uncertainty of "
        f"{float(np.nanmedian(distances.std)):.3f} m in the median; determined for {percent(distances.determined)} of "
        f"the frame."
    )
    texts = (
        "From the blur’s radius and the camera’s data: `distance.npy`. Empty at weak texture and at depth edges.",
        "From noise, from other depths that fit as well, and from the camera’s data: `distance_std.npy`.",
    )
    maps = [
        _map(distances.metres, "distance in m", "distance", texts[0], (low, high), "viridis"),
        _map(distances.std, "standard uncertainty in m", "distance_std", texts[1], (0.0, most)),
    ]
    return [Section("Distance in metres", [words, Figures(maps)])]


def _refocused(restoration: Restoration) -> list[tuple[str, Array]]:
    """The sharp picture for a lens of the photographs' depth of focus, focused at three depths. Blur grows with the
    distance from the plane of focus; it is a blur circle, whatever blurred the photographs."""
    span = float(restoration.w.max() - restoration.w.min())
    if span < MIN_SPAN_PX:
        return []
    stack = mask_stack(pillbox(), span)
    return [(words, refocused(restoration, stack, float(np.percentile(restoration.w, p)))) for words, p in FOCUS_AT]


def _kernel(kernel: Array, n: int) -> Markup:
    side = max(1, KERNEL_PX // len(kernel))
    enlarged = np.kron(kernel, np.ones((side, side)))
    return image(encoded(".png", levels(enlarged, 0, float(kernel.max()))), f"kernel of photograph {n}")
