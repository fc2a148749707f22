"""A correction's report: before and after, whole and in parts, what was gained over the frame and what it cost."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from procedures.correction.estimate import Correction
from procedures.raw import RawFrame
from station.calibration.correction import Corrected, correction_numbers
from station.common.versions import software
from station.drawing.pictures import display_png
from station.reports import psf_figures
from station.reports.page import exposure_words, render
from station.results.record_head import RecordHead

Single = npt.NDArray[np.float32]

WIDEST_PX, PART_PX = 720, 180
"""Of the pictures on the page: whole, and the parts that are shown at twice their size."""
PLACES = ((0.5, 0.5, "In the middle"), (0.06, 0.06, "Near the upper left corner"), (0.94, 0.94, "Near the lower right"))


def correction_page(found: Corrected, head: RecordHead) -> bytes:
    """The page, UTF-8, with its pictures inside; `found` has a value."""
    value = found.outcome.value
    if value is None:
        raise ValueError("a correction without a value has no page")
    before, after = _finer(_before(found.frame), value.scale), np.moveaxis(value.picture, 0, -1)
    balance = _balance(after)
    return render(
        "correction.html",
        outcome=found.outcome,
        head=head,
        found=value,
        undone=found.undone,
        exposure=exposure_words(found.frame.exposure),
        medians=correction_numbers(value),
        others=list(zip(found.others, value.places, strict=True)),
        noise=_noise(value),
        whole=[_uri(_small(one) * balance) for one in (before, after)],
        parts=_parts(before, after, balance),
        **_maps(value),
        software=software(),
    ).encode()


def _before(frame: RawFrame) -> Single:
    """The photograph as it came, (H, W, C), each colour of a mosaic spread over the pixels between."""
    planes = list(frame.planes.values())
    if len(planes) == 1:
        return planes[0].samples[..., None]
    rows, columns = (2 * size for size in planes[0].samples.shape)
    out = np.empty((rows, columns, 3), dtype=np.float32)
    for c, names in enumerate((("R",), ("G1", "G2"), ("B",))):
        shown = [_moved(frame.planes[name].samples, frame.planes[name].origin, (rows, columns)) for name in names]
        out[..., c] = sum(shown) / len(shown)
    return out


def _moved(samples: Single, origin: tuple[int, int], shape: tuple[int, int]) -> Single:
    """A plane on the sensor's grid, linear between its samples."""
    to_plane = np.array([[0.5, 0, -origin[0] / 2], [0, 0.5, -origin[1] / 2]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(samples, to_plane, shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32
    )


def _balance(picture: Single) -> Single:
    """What each colour is multiplied by so that the mean is grey and the brightest hundredth white."""
    means = np.maximum(picture[::4, ::4].mean(axis=(0, 1)), 1e-6)
    gains = means[len(means) // 2] / means
    white = float(np.percentile((picture[::4, ::4] * gains).max(axis=-1), 99))
    return np.asarray(gains / max(white, 1e-6), dtype=np.float32)


def _parts(before: Single, after: Single, balance: Single) -> Sequence[tuple[str, str, str]]:
    """Places of the frame with both pictures of them."""
    return [(words, _uri(_part(before, x, y) * balance), _uri(_part(after, x, y) * balance)) for x, y, words in PLACES]


def _part(picture: Single, x: float, y: float) -> Single:
    rows, columns = picture.shape[:2]
    top, left = (
        int(np.clip(at * size - PART_PX / 2, 0, max(size - PART_PX, 0))) for at, size in ((y, rows), (x, columns))
    )
    cut = picture[top : top + PART_PX, left : left + PART_PX]
    return np.repeat(np.repeat(cut, 2, axis=0), 2, axis=1)


def _small(picture: Single) -> Single:
    factor = WIDEST_PX / max(picture.shape[:2])
    if factor >= 1:
        return picture
    small = cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    return np.asarray(small.reshape(*small.shape[:2], picture.shape[2]), dtype=np.float32)


def _uri(picture: Single) -> str:
    shown = picture[..., 0] if picture.shape[-1] == 1 else picture
    return "data:image/png;base64," + base64.b64encode(display_png(shown)).decode()


def _finer(picture: Single, scale: int) -> Single:
    """The photograph (H, W, C) on a finer grid, pixels as they are: first pixel upon first pixel."""
    if scale == 1:
        return picture
    rows, columns = (scale * size for size in picture.shape[:2])
    to_pixels = np.array([[1 / scale, 0, 0], [0, 1 / scale, 0]])
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    finer = cv2.warpAffine(picture, to_pixels, (columns, rows), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(finer.reshape(rows, columns, picture.shape[2]), dtype=np.float32)


def _noise(value: Correction) -> list[tuple[str, float]]:
    """Standard deviation of each plane's samples at half of white, of white."""
    half = np.array([0.5])
    return [(name, float(one.variance_at(half)[0] ** 0.5)) for name, one in value.noise.items()]


def _maps(value: Correction) -> dict[str, Markup]:
    told, scale = value.prediction, value.scale

    def drawn(values: npt.NDArray[np.float64], unit: str, name: str, limits: tuple[float, float]) -> Markup:
        return psf_figures.map_figure(values, unit, name, colours="viridis", limits=limits)

    return {
        "before": drawn(scale * told.before, "MTF50 before, cycles/pixel", "before", (0, 0.5 * scale)),
        "after": drawn(scale * told.after, "MTF50 after, cycles/pixel", "after", (0, 0.5 * scale)),
        "gain": drawn(told.noise_gain, "noise after over before", "gain", (0, max(float(told.noise_gain.max()), 1))),
    }
