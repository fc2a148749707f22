"""Photographs' samples at their positions on the picture's grid, colour-balanced, with weights."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.clipping import NOMINAL
from procedures.correction.noise import Noise
from procedures.correction.optics import COLOURS
from procedures.raw import Plane

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]

AT_LEAST = np.float32(-1)
"""Weight that marks a clipped sample: its value is a lower bound."""
LEVEL_PX = 5
"""Side of the mean filter whose level sets the noise of a sample."""
MOST_GAIN = 8.0


@dataclass(frozen=True, eq=False)
class Mosaic:
    """The planes of one photograph or of several on the picture's grid.

    planes, noise : by key
    light : by key
        Brightness of the photograph relative to the first; 1 if not given.
    shape : (int, int)
        Rows and columns of the picture.
    gains : (C,) float32
        Mean of each colour relative to green: samples are divided by it, so that a grey scene is grey.
    variance : float
        Variance of a typical sample, balanced; weights are 1 there.
    clipped : float
        Fraction of the samples that are clipped.
    """

    planes: Mapping[str, Plane]
    noise: Mapping[str, Noise]
    light: Mapping[str, float]
    shape: tuple[int, int]
    gains: Single
    variance: float
    clipped: float

    @classmethod
    def of(
        cls, planes: Mapping[str, Plane], noise: Mapping[str, Noise], light: Mapping[str, float] | None = None
    ) -> "Mosaic":
        """The mosaic of planes, beginning with those of the first photograph."""
        pitch = next(iter(planes.values())).pitch
        ends = [np.array(plane.samples.shape) * pitch for plane in planes.values()]
        rows, columns = (int(end) for end in np.max(ends, axis=0))
        gains = _gains(planes)
        usual = [
            float(noise[key].variance_at(np.array(np.median(plane.samples)))) / gains[COLOURS[plane.name]] ** 2
            for key, plane in planes.items()
        ]
        clipped = float(np.mean([np.mean(plane.samples >= NOMINAL) for plane in planes.values()]))
        return cls(planes, noise, light or {}, (rows, columns), gains, float(np.mean(usual)), clipped)

    @property
    def channels(self) -> int:
        """Colours of the picture."""
        return len(self.gains)

    @property
    def pitch(self) -> int:
        """Pixels of the picture per sample of a plane."""
        return next(iter(self.planes.values())).pitch

    @property
    def channel(self) -> Sequence[int]:
        """Index of the colour of each plane."""
        return [COLOURS[plane.name] for plane in self.planes.values()]

    def cut(
        self, start: tuple[int, int], n: int, ring: int, moved: Mapping[str, tuple[int, int]]
    ) -> tuple[Single, Single]:
        """Samples and weights (P, n, n) of a tile, with weights of 0 in a ring along its rim.

        moved : by key, displacement of a plane in whole pixels (x, y), by which its samples are shifted back.
        """
        z, weight = np.zeros((2, len(self.planes), n, n), dtype=np.float32)
        for p, key in enumerate(self.planes):
            dx, dy = moved.get(key, (0, 0))
            self._lay(key, (start[0] + dy, start[1] + dx), z[p], weight[p])
        for rim in (weight[:, :ring], weight[:, -ring:], weight[:, :, :ring], weight[:, :, -ring:]):
            rim[...] = 0
        return z, weight

    def _lay(self, key: str, start: tuple[int, int], z: Single, weight: Single) -> None:
        import cv2

        plane, noise, n = self.planes[key], self.noise[key], len(z)
        pitch, gain = plane.pitch, self.gains[COLOURS[plane.name]] * np.float32(self.light.get(key, 1.0))
        spans = [
            _span(at, n, origin, pitch, size)
            for at, origin, size in zip(start, plane.origin[::-1], plane.samples.shape, strict=True)
        ]
        (rows, plane_rows), (columns, plane_columns) = spans
        samples = plane.samples[plane_rows, plane_columns]
        if samples.size == 0:
            return
        level = np.asarray(cv2.blur(samples, (LEVEL_PX, LEVEL_PX)), dtype=np.float32)
        counts = np.float32(self.variance * gain**2) / noise.variance_at(level)
        counts[samples >= NOMINAL] = AT_LEAST
        for row, column in plane.bad_pixels - np.array([plane_rows.start, plane_columns.start]):
            if 0 <= row < counts.shape[0] and 0 <= column < counts.shape[1]:
                counts[row, column] = 0
        z[rows, columns] = samples / gain
        weight[rows, columns] = counts

    def first(self, z: Single, weight: Single) -> Single:
        """An initial picture (C, n, n): samples spread over their neighbours, the mean where there are none.

        Green takes the curvature of red and blue where it has no sample, and these are spread as differences from
        green, as fine detail is mostly of all colours (Malvar, He, Cutler, ICASSP 2004).
        """
        valid = (weight != 0).astype(np.float32)
        light, share = (self._by_colour(one) for one in (z * valid, valid))
        if self.channels == 1:
            return _spread(light[0], share[0], self.pitch)[None]
        others = [p for p, colour in enumerate(self.channel) if colour != 1]
        curvature = sum(_curvature(z[p], valid[p], self.pitch) for p in others) / np.maximum(share[0] + share[2], 1)
        between = _spread(light[1], share[1], self.pitch) + curvature / 2
        green = np.where(share[1] > 0, light[1] / np.maximum(share[1], 1), between)
        colours = [_spread(light[c] - share[c] * green, share[c], self.pitch) for c in (0, 2)]
        return np.stack([green + colours[0], green, green + colours[1]])

    def _by_colour(self, planes: Single) -> Single:
        out = np.zeros((self.channels, *planes.shape[1:]), dtype=np.float32)
        for plane, c in zip(planes, self.channel, strict=True):
            out[c] += plane
        return out


def _spread(light: Single, share: Single, pitch: int) -> Single:
    """Samples (n, n), with their number at each place, spread over their neighbours."""
    import cv2

    reach = max(2, pitch)
    across = reach - np.abs(np.arange(1 - reach, reach))
    tent = np.outer(across, across).astype(np.float32)
    near, much = cv2.filter2D(light, -1, tent), cv2.filter2D(share, -1, tent)
    mean = np.float32(light.sum() / max(float(share.sum()), 1.0))
    return np.where(much > 0, near / np.maximum(much, 1), mean)


def _curvature(plane: Single, valid: Single, pitch: int) -> Single:
    """Samples of a plane less the mean of their four neighbours."""
    import cv2

    cross = np.zeros((2 * pitch + 1, 2 * pitch + 1), dtype=np.float32)
    cross[[0, -1, pitch, pitch], [pitch, pitch, 0, -1]] = 1
    near, count = cv2.filter2D(plane * valid, -1, cross), cv2.filter2D(valid, -1, cross)
    return np.where(count > 0, plane - near / np.maximum(count, 1), 0) * valid


def _span(start: int, n: int, origin: int, pitch: int, size: int) -> tuple[slice, slice]:
    """Slices of a plane's samples along one axis: in the tile, and in the plane."""
    first = max(0, -(-(start - origin) // pitch))
    last = min(size, -(-(start + n - origin) // pitch))
    at = first * pitch + origin - start
    return slice(at, at + max(last - first, 0) * pitch, pitch), slice(first, max(last, first))


def _gains(planes: Mapping[str, Plane]) -> Single:
    colours = [COLOURS[plane.name] for plane in planes.values()]
    channels = max(colours) + 1
    if channels == 1:
        return np.ones(1, dtype=np.float32)
    means = [
        np.mean([_mean(plane) for plane, colour in zip(planes.values(), colours, strict=True) if colour == c])
        for c in range(channels)
    ]
    return np.clip(np.array(means) / max(float(means[1]), 1e-6), 1 / MOST_GAIN, MOST_GAIN).astype(np.float32)


def _mean(plane: Plane) -> float:
    samples = plane.samples[::4, ::4]
    kept = samples[samples < NOMINAL]
    return float(kept.mean()) if kept.size else 1.0
