"""The page of a correction: before and after, whole and in parts, gain over the frame and cost."""

from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt

from procedures.correction.estimate import Correction
from procedures.raw import RawFrame
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
    before, after = _finer(_before(corrected.frame), value.scale), np.moveaxis(value.picture, 0, -1)
    balance = _balance(after)

    def pair(part: Callable[[Single], Single], captions: tuple[str, str], words: str) -> Figures:
        shown = (
            image(display_png(np.squeeze(part(one) * balance)), f"{words}: {c}")
            for one, c in zip((before, after), captions, strict=True)
        )
        return Figures([Figure(*one) for one in zip(shown, captions, strict=True)])

    developed, grey = corrected.frame.development is not None, after.shape[2] == 1
    before_words = (
        "decoded to light" if developed else "the photograph" if grey else "colours of the mosaic spread linearly"
    )
    after_words = f"After: `{'picture' if developed else 'corrected.dng'}`, `corrected.tiff`."
    captions = (f"Before: {before_words}.", after_words if grey else f"{after_words} Balanced to grey only here.")
    whole, compared = pair(lambda one: smaller(one, MAX_SIDE_PX), captions, "the whole frame"), list[Block]()
    for x, y, words in PLACES:
        part = pair(lambda one, x=x, y=y: _part(one, x, y), ("Before.", "After."), words)  # type: ignore[misc]
        compared += [Heading(f"{words}, twice its size"), part]
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


def _before(frame: RawFrame) -> Single:
    """The photograph as it came, (H, W, C), each colour of a mosaic spread over the pixels between."""
    planes = list(frame.planes.values())
    if planes[0].pitch == 1:
        return np.stack([plane.samples for plane in planes], axis=-1)
    rows, columns = (2 * size for size in planes[0].samples.shape)
    out = np.empty((rows, columns, 3), dtype=np.float32)
    for c, names in enumerate((("R",), ("G1", "G2"), ("B",))):
        shown = [_moved(frame.planes[name].samples, frame.planes[name].origin, (rows, columns)) for name in names]
        out[..., c] = sum(shown) / len(shown)
    return out


def _moved(samples: Single, origin: tuple[int, int], shape: tuple[int, int]) -> Single:
    to_plane = np.array([[0.5, 0, -origin[0] / 2], [0, 0.5, -origin[1] / 2]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(samples, to_plane, shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32
    )


def _balance(picture: Single) -> Single:
    """Gain of each colour with which the mean is grey and the brightest hundredth white."""
    means = np.maximum(picture[::4, ::4].mean(axis=(0, 1)), 1e-6)
    gains = means[len(means) // 2] / means
    white = float(np.percentile((picture[::4, ::4] * gains).max(axis=-1), 99))
    return np.asarray(gains / max(white, 1e-6), dtype=np.float32)


def _part(picture: Single, x: float, y: float) -> Single:
    rows, columns = picture.shape[:2]
    top, left = (
        int(np.clip(at * size - PART_PX / 2, 0, max(size - PART_PX, 0))) for at, size in ((y, rows), (x, columns))
    )
    cut = picture[top : top + PART_PX, left : left + PART_PX]
    return np.repeat(np.repeat(cut, 2, axis=0), 2, axis=1)


def _finer(picture: Single, scale: int) -> Single:
    """The photograph (H, W, C) on a finer grid, pixels as they are: first pixel upon first pixel."""
    nearest = [np.minimum((np.arange(scale * size) + scale // 2) // scale, size - 1) for size in picture.shape[:2]]
    return np.asarray(picture[np.ix_(*nearest)])


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
