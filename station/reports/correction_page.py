"""The page of a correction: before and after, whole and in parts, gain over the frame and cost."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from procedures.correction.estimate import Correction
from procedures.raw import Plane, RawFrame
from station.calibration.correction import Corrected
from station.drawing.pictures import display_png, smaller
from station.drawing.plots import Figure
from station.reports.page import Block, Figures, Heading, Items, KeyNumbers, Note, Section, image, percent
from station.reports.psf_figures import map_figure
from station.reports.report import Report
from station.reports.report_page import report_page

Single = npt.NDArray[np.float32]

MAX_SIDE_PX, PART_PX = 720, 180
"""Sizes of pictures on the page: whole, and the parts shown at twice their size."""
PLACES = ((0.5, 0.5, "In the middle"), (0.06, 0.06, "Near the upper left corner"), (0.94, 0.94, "Near the lower right"))


def correction_page(report: Report) -> str:
    """The page with embedded pictures. Raises ValueError without a value."""
    corrected: Corrected = report.result
    value = corrected.outcome.value
    if value is None:
        raise ValueError("a correction without a value has no page")
    frame, after = corrected.frame, np.moveaxis(value.picture, 0, -1)
    balance = _balance(after)

    def pair(before: Single, after: Single, captions: tuple[str, str], words: str) -> Figures:
        shown = (
            image(display_png(np.squeeze(one * balance)), f"{words}: {c}")
            for one, c in zip((before, after), captions, strict=True)
        )
        return Figures([Figure(*one) for one in zip(shown, captions, strict=True)])

    developed, grey = frame.development is not None, after.shape[2] == 1
    before_words = (
        "decoded to light" if developed else "the photograph" if grey else "colours of the mosaic spread linearly"
    )
    after_words = f"After: `{'picture' if developed else 'corrected.dng'}`, `corrected.tiff`."
    captions = (f"Before: {before_words}.", after_words if grey else f"{after_words} Balanced to grey only here.")
    reduced = smaller(after, MAX_SIDE_PX)
    whole, compared = pair(_whole(frame, reduced.shape), reduced, captions, "the whole frame"), list[Block]()
    for x, y, words in PLACES:
        rows, columns = (_window(at, size) for at, size in zip((y, x), after.shape, strict=False))
        parts = (_part(frame, rows, columns, value.scale), after[rows, columns])
        before, sharp = (np.repeat(np.repeat(one, 2, axis=0), 2, axis=1) for one in parts)
        compared += [Heading(f"{words}, twice its size"), pair(before, sharp, ("Before.", "After."), words)]
    sections = [
        Section("Before and after, in parts", compared),
        Section("Gain and cost", [_maps(value), Note("The same numbers are in `gain.csv`.")]),
    ]
    return report_page(report, summary=[whole, *_summary(corrected, value)], closing=sections)


def _summary(corrected: Corrected, value: Correction) -> list[Block]:
    noise = {name: float(one.variance_at(np.array([0.5]))[0] ** 0.5) for name, one in value.noise.items()}
    facts = [
        *((percent(sigma), f"noise of {name} at half of white, of white") for name, sigma in noise.items()),
        (percent(value.clipped), "of the samples clipped: they are lower bounds of the light"),
        (f"{value.side} pixels", "side of a tile"),
    ]
    if value.scale > 1:
        words = "its detail, determined by the photographs’ places"
        facts.append(
            (percent(value.resolved), f"{value.scale} pixels of the picture per pixel of the sensor: share of {words}")
        )
    lines = [f"Lateral colour corrected: {', '.join(corrected.undone) or 'none, the field has none'}."]
    for frame, place in zip(corrected.others, value.places, strict=True):
        x, y = place.moved_px(value.sensor_shape)
        words = (
            f"excluded: {place.reason}"
            if place.reason
            else f"moved by {x:+.2f}, {y:+.2f} pixels, {place.light:.3f} times the light, residual contrast "
            f"{percent(place.residual)}"
        )
        lines.append(f"{frame.path.name}: {words}.")
    return [KeyNumbers(facts), Items(lines)]


def _whole(frame: RawFrame, shape: tuple[int, ...]) -> Single:
    """The photograph as it came, reduced to a shape; a mosaic's planes are laid upon each other."""
    return _colours(frame, lambda plane: cv2.resize(plane.samples, shape[1::-1], interpolation=cv2.INTER_AREA))


def _part(frame: RawFrame, rows: slice, columns: slice, scale: int) -> Single:
    """The photograph as it came in a window of a picture that is `scale` times as fine, (rows, columns, C); samples are
    spread linearly over the pixels between."""
    shape = columns.stop - columns.start, rows.stop - rows.start

    def spread(plane: Plane) -> npt.NDArray[Any]:
        first = np.array([columns.start, rows.start]) / scale - plane.origin
        to_plane = np.column_stack([np.eye(2) / scale, first]) / plane.pitch
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(plane.samples, to_plane, shape, flags=flags, borderMode=cv2.BORDER_REPLICATE)

    return _colours(frame, spread)


def _colours(frame: RawFrame, resampled: Callable[[Plane], npt.NDArray[Any]]) -> Single:
    """Resampled planes as (H, W, C), both greens of a mosaic together."""
    names = [("R",), ("G1", "G2"), ("B",)] if "G2" in frame.planes else [(name,) for name in frame.planes]
    colours = [np.mean([resampled(frame.planes[name]) for name in of], axis=0) for of in names]
    return np.stack(colours, axis=-1)


def _balance(picture: Single) -> Single:
    """Gain of each colour with which the mean is grey and the brightest hundredth white."""
    means = np.maximum(picture[::4, ::4].mean(axis=(0, 1)), 1e-6)
    gains = means[len(means) // 2] / means
    white = float(np.percentile((picture[::4, ::4] * gains).max(axis=-1), 99))
    return np.asarray(gains / max(white, 1e-6), dtype=np.float32)


def _window(at: float, size: int) -> slice:
    first = int(np.clip(at * size - PART_PX / 2, 0, max(size - PART_PX, 0)))
    return slice(first, min(first + PART_PX, size))


def _maps(value: Correction) -> Figures:
    predicted, scale = value.prediction, value.scale
    top, nyquist = max(float(predicted.noise_gain.max()), 1), 0.5 * scale
    maps = (
        ("before", scale * predicted.before, "MTF50 before, cycles/pixel", nyquist, "Of green or grey."),
        ("after", scale * predicted.after, "MTF50 after, cycles/pixel", nyquist,
         "At edges, where differences are ten times the picture’s mean."),
        ("gain", predicted.noise_gain, "noise after over before", top,
         "Where differences are as the picture’s mean; less where it is flatter."),
    )  # fmt: skip
    return Figures(
        [map_figure(values, unit, name, caption, limits=(0, most)) for name, values, unit, most, caption in maps]
    )
