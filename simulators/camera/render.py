"""The image on the sensor: scene, projection and optics, sampled at the centres of the pixels.

The ideal image is integrated exactly over small hat functions on a grid finer than the pixels. Its spectrum is
multiplied by the ratio of the optical transfer function to that of a hat, and folded to sample it at the pixels'
centres, with the aliasing of a camera. Aliasing on the fine grid is the only approximation; with 8 samples per pixel it
changes no pixel of a chart by more than 6e-5 of full light (`tests/simulators/camera/test_render.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import fft

from drivers.dng import Shot, write_dng
from simulators.camera.optics import Complex, Optics
from simulators.camera.sensor import Mosaic, Sensor
from simulators.world.projection import Projection, Segments, coverage
from simulators.world.scene import Illumination, PlacedChart, Scene, Stroke, strokes

LUMINANCE = (0.2126, 0.7152, 0.0722)  # response of a sensor without a mosaic to red, green and blue (ITU-R BT.709)


def photograph_render(
    picture: npt.NDArray[np.floating], optics: Optics, sensor: Sensor, rng: np.random.Generator,
    path: Path | None = None, *, white_e: float = 25e3, shot: Shot | None = None,
) -> Mosaic:  # fmt: skip
    """Digital numbers of a render, (sensor.rows, sensor.columns); a DNG of them where `path` is given.

    Raises ValueError if the picture is not a whole multiple of the sensor's size.

    picture : (n rows, n columns, 3)
        Linear light, 1 = white, each value the mean over its cell; n cells per sensor pixel along each axis. The
        optics act on what these cells resolve: with n = 1 what lies beyond half a cycle per pixel has aliased already.
    white_e : float, electrons that white gives in green, or without a mosaic
    """
    n = picture.shape[0] // sensor.rows
    if picture.shape != (n * sensor.rows, n * sensor.columns, 3) or n == 0:
        size = f"{sensor.rows} x {sensor.columns}"
        raise ValueError(f"a sensor of {size} needs a picture some times as large; got {picture.shape}")
    light = np.empty((sensor.rows, sensor.columns))
    period = 1 if sensor.cfa is None else 2
    for colour in set(sensor.tile.values()):
        samples = blur_and_sample(_channel(picture, colour), optics, colour, n)
        for x, y in (place for place, one in sensor.tile.items() if one == colour):
            light[y::period, x::period] = samples[y::period, x::period]
    mosaic = sensor.expose(light, white_e, rng)
    if path is not None:
        write_dng(path, mosaic, shot or Shot(), cfa=sensor.cfa, black=sensor.black, white=sensor.white)
    return mosaic


def blur_and_sample(channel: Array, optics: Optics, colour: str, n: int) -> Array:
    """Light on the pixels: the optics' transfer function over that of the cells, taken at the pixels' centres."""
    margin = n * optics.margin_px()
    wide = np.pad(channel, margin, mode="symmetric")
    fy, fx = fft.fftfreq(wide.shape[0])[:, None], fft.rfftfreq(wide.shape[1])[None, :]
    transfer = optics.otf(n * fx, n * fy, colour) / (np.sinc(fx) * np.sinc(fy))
    centre = np.exp(1j * np.pi * (n - 1) * fx) * np.exp(1j * np.pi * (n - 1) * fy)  # of n cells, from the first's
    blurred: Array = fft.irfft2(fft.rfft2(wide) * transfer * centre, s=wide.shape)
    return np.maximum(blurred[margin : margin + channel.shape[0] : n, margin : margin + channel.shape[1] : n], 0.0)


def _channel(picture: npt.NDArray[np.floating], colour: str) -> Array:
    if colour == "Y":
        return np.asarray(picture @ np.array(LUMINANCE), np.float64)
    return np.asarray(picture[..., "RGB".index(colour)], np.float64)


Array = npt.NDArray[np.float64]
Frame = npt.NDArray[np.float32]

LEAST_MARGIN_PX = 24  # smallest margin of sensor pixels around a rendered region: the Fourier transform is periodic

SURROUND_PX = 16  # sensor pixels around a chart's sheet that are rendered as exactly as the chart
FINE_SIDE = 3072  # fine samples per side of a transform, without margins; larger regions are rendered in tiles
PLAIN_OVERSAMPLING = 2
"""Fine samples per sensor pixel outside charts, where the image is accurate to a few per cent of an edge."""
TILE_PX = 512  # side of the tiles in which the rest of a frame is drawn


STRIP_ROWS = 256  # fine rows painted at once: a strip fits the cache, and a slanted line crosses few of its columns


@dataclass(frozen=True)
class Region:
    """A rectangle of sensor pixels: its first pixel (x, y), its size."""

    x: int
    y: int
    width: int
    height: int

    def meets(self, bounds: tuple[float, float, float, float]) -> bool:
        """Whether an object within these x and y limits may touch it, with a margin of one pixel."""
        x0, x1, y0, y1 = bounds
        return x0 <= self.x + self.width and x1 >= self.x - 1 and y0 <= self.y + self.height and y1 >= self.y - 1

    def tiles(self, side: int) -> Iterator[Region]:
        """The region cut into equal tiles no longer than `side`."""
        columns, rows = -(-self.width // side), -(-self.height // side)
        xs = [self.x + self.width * i // columns for i in range(columns + 1)]
        ys = [self.y + self.height * i // rows for i in range(rows + 1)]
        for y0, y1 in pairwise(ys):
            for x0, x1 in pairwise(xs):
                yield Region(x0, y0, x1 - x0, y1 - y0)

    def grown(self, pixels: int) -> Region:
        """The region with a margin on all sides, at even pixels; sizes are even products of small primes."""
        x, y = (2 * ((p - pixels) // 2) for p in (self.x, self.y))
        right, bottom = self.x + self.width + pixels, self.y + self.height + pixels
        width, height = (2 * fft.next_fast_len(-(-n // 2), real=True) for n in (right - x, bottom - y))
        return Region(x, y, width, height)


@dataclass(frozen=True, eq=False)
class IdealImage:
    """The ideal image of a scene without blur: outlines from back to front, and the light."""

    outlines: Sequence[Stroke]
    background: float
    light: Illumination

    @classmethod
    def of(cls, scene: Scene, projection: Projection) -> IdealImage:
        """The ideal image of a scene through a lens."""
        return cls(list(strokes(scene, projection)), scene.wall.reflectance, scene.light)

    def behind(self) -> list[Stroke]:
        """The strokes outside charts."""
        return [stroke for stroke in self.outlines if stroke.chart is None]

    def by_chart(self) -> dict[PlacedChart, list[Stroke]]:
        """The charts from back to front with their strokes."""
        charts = {stroke.chart: None for stroke in self.outlines if stroke.chart}
        return {chart: [stroke for stroke in self.outlines if stroke.chart is chart] for chart in charts}


def render_region(
    picture: IdealImage, optics: Optics, region: Region, colours: Mapping[tuple[int, int], str], *, oversampling: int,
    margin_px: int | None = None,
) -> Array:  # fmt: skip
    """Light on the pixels of a region, 1 where reflectance and illumination are 1, (height, width).

    colours : mapping of (x, y) to str
        The colour of each pixel of the mosaic's tile, by position: {(0, 0): "Y"} without a mosaic.
    oversampling : int, fine samples per sensor pixel along each axis
    margin_px : int or None, sensor pixels to render around the region; None: as far as the optics reach
    """
    period = 1 + max(x for x, _ in colours)
    wide = region.grown(margin_px or max(LEAST_MARGIN_PX, optics.margin_px()))
    fine_columns = wide.width * oversampling
    passing = {colour: transfer(optics, colour, wide, oversampling) for colour in sorted(set(colours.values()))}
    columns = max(factors.shape[1] for factors in passing.values())
    # the first columns of an image's spectrum; overwrites the image
    lines = fft.rfft(_ideal(picture, wide, oversampling), axis=1, workers=2, overwrite_x=True)[:, :columns]
    spectrum = np.asarray(fft.fft(lines, axis=0, workers=2, overwrite_x=True), dtype=np.complex128)
    light = np.empty((wide.height, wide.width))
    for colour, factors in passing.items():
        filtered = _filtered(spectrum, factors)
        for px, py in (place for place, one in colours.items() if one == colour):
            light[py::period, px::period] = _sample(filtered, (px, py), oversampling, period, fine_columns)
    top, left = region.y - wide.y, region.x - wide.x
    return light[top : top + region.height, left : left + region.width]


def render_frame(
    picture: IdealImage, optics: Callable[[PlacedChart | None], Optics], shape: tuple[int, int],
    colours: Mapping[tuple[int, int], str], *, oversampling: int,
) -> Frame:  # fmt: skip
    """Light on a whole frame (rows, columns), float32: exact around every chart, plain elsewhere.

    Around a chart there are `oversampling` fine samples per sensor pixel along each axis. Objects on the wall are
    drawn with fewer, in the tiles that they touch.

    optics : callable, the optics at a chart, or at the wall (None): they may differ by distance and place in the frame
    """
    y, x = (np.arange(size, dtype=np.float64) for size in shape)
    frame = np.empty(shape, dtype=np.float32)
    for top in range(0, shape[0], STRIP_ROWS):
        light = picture.light.at(x[None, :], y[top : top + STRIP_ROWS, None])
        frame[top : top + STRIP_ROWS] = picture.background * light
    for region in _busy_tiles(picture.behind(), shape):
        light = render_region(picture, optics(None), region, colours, oversampling=PLAIN_OVERSAMPLING)
        _paste(frame, region, np.maximum(light, 0.0))  # a coarse grid may undershoot at an edge
    for placed, pieces in picture.by_chart().items():
        around = bounding_region(pieces, shape, SURROUND_PX)
        if around is not None:
            local = optics(placed)
            for tile in around.tiles(FINE_SIDE // oversampling):
                _paste(frame, tile, render_region(picture, local, tile, colours, oversampling=oversampling))
    return frame


def bounding_region(pieces: Sequence[Stroke], shape: tuple[int, int], pixels: int) -> Region | None:
    """The part of a frame (rows, columns) that strokes touch, with a margin in pixels; None if they miss it."""
    boxes = np.array([stroke.bounds for stroke in pieces])
    x0, y0 = (max(int(np.floor(boxes[:, i].min())) - pixels, 0) for i in (0, 2))
    x1, y1 = (min(int(np.ceil(boxes[:, i].max())) + pixels + 1, size) for i, size in ((1, shape[1]), (3, shape[0])))
    return Region(x0, y0, x1 - x0, y1 - y0) if x1 > x0 and y1 > y0 else None


def transfer(optics: Optics, colour: str, wide: Region, oversampling: int) -> Array | Complex:
    """Factor of the fine image's spectrum: the optics' transfer function divided by that of its hats.

    Rows in the order of `fftfreq`; rows and columns end at the cutoff of the pupil.
    """
    return _transfer(optics, colour, wide.height * oversampling, wide.width * oversampling, oversampling)


@lru_cache(maxsize=4)
def _transfer(optics: Optics, colour: str, rows: int, columns: int, oversampling: int) -> Array | Complex:
    fx, fy = oversampling * fft.rfftfreq(columns), oversampling * fft.fftfreq(rows)
    fx, fy = (f[np.abs(f) <= optics.cutoff(colour)] for f in (fx, fy))
    fx, fy = fx[None, :], fy[:, None]
    hat: Array = np.sinc(fx / oversampling) ** 2 * np.sinc(fy / oversampling) ** 2
    return optics.otf(fx, fy, colour) / hat


def _filtered(spectrum: Complex, factors: Array | Complex) -> Complex:
    """The part of a spectrum that `transfer` passes, all of its rows."""
    rows, columns = factors.shape
    down = rows // 2
    filtered = np.zeros((len(spectrum), columns), dtype=np.complex128)
    for those, ours in ((slice(0, rows - down), slice(0, rows - down)), (slice(-down, None), slice(rows - down, None))):
        np.multiply(spectrum[those, :columns], factors[ours], out=filtered[those])
    return filtered


def _ideal(ideal: IdealImage, wide: Region, n: int) -> Array:
    """The picture without blur through hats: n samples to a pixel, the first on the first pixel's centre."""
    picture = np.full((n * wide.height, n * wide.width), ideal.background)
    for stroke in ideal.outlines:
        if wide.meets(stroke.bounds):
            _paint(picture, stroke, (wide.x, wide.y), n)
    x, y = (np.arange(n * size) / n + first for size, first in ((wide.width, wide.x), (wide.height, wide.y)))
    for top in range(0, len(y), STRIP_ROWS):
        picture[top : top + STRIP_ROWS] *= ideal.light.at(x[None, :], y[top : top + STRIP_ROWS, None])
    return picture


def _paint(picture: Array, stroke: Stroke, first: tuple[int, int], n: int) -> None:
    """Put one stroke on the fine picture, strip by strip, touching only the samples that it reaches."""
    starts, ends = ((points - first) * n for points in (stroke.segments.starts, stroke.segments.ends))
    whole = Segments(starts, ends, stroke.segments.weights)
    top = max(math.floor(starts[:, 1].min()), 0)
    bottom = min(math.ceil(starts[:, 1].max()) + 1, picture.shape[0])
    for y0 in range(top, bottom, STRIP_ROWS):
        y1 = min(y0 + STRIP_ROWS, bottom)
        near = whole.inside(y0 - 1, y1)
        x = np.concatenate([near.starts[:, 0], near.ends[:, 0]])
        if not len(x):
            continue
        x0, x1 = max(math.floor(x.min()), 0), min(math.ceil(x.max()) + 1, picture.shape[1])
        if x1 > x0:
            area = coverage(near.moved(x0, y0), (y1 - y0, x1 - x0))
            part = picture[y0:y1, x0:x1]
            area *= stroke.reflectance - part if stroke.opaque else stroke.reflectance
            part += area


def _sample(spectrum: Complex, phase: tuple[int, int], n: int, period: int, columns: int) -> Array:
    """The fine picture of a spectrum at every `period`-th pixel from pixel `phase` (x, y) on, by folding its rows.

    columns : of the fine picture; the spectrum is zero beyond its own.
    """
    rows, step = spectrum.shape[0], n * period
    turn = 2j * np.pi * n * phase[1]  # of a whole turn of frequency: row r of the spectrum is shifted by r / rows of it
    folds = np.exp(turn * np.arange(step) / step) / step
    folded = (folds @ spectrum.reshape(step, -1)).reshape(rows // step, -1)
    folded *= np.exp(turn * np.arange(rows // step) / rows)[:, None]
    lines = fft.irfft(fft.ifft(folded, axis=0), columns, axis=1)
    return np.asarray(lines[:, n * phase[0] :: step], dtype=np.float64)


def _paste(frame: Frame, region: Region, part: Array) -> None:
    frame[region.y : region.y + region.height, region.x : region.x + region.width] = part


def _busy_tiles(pieces: Sequence[Stroke], shape: tuple[int, int]) -> Iterator[Region]:
    """Tiles of a frame that strokes may touch."""
    for tile in Region(0, 0, shape[1], shape[0]).tiles(TILE_PX):
        around = tile.grown(SURROUND_PX)
        if any(around.meets(stroke.bounds) for stroke in pieces):
            yield tile
