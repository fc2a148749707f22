"""Correction of photographs by their fields: checks, balancing, restoration by tiles, verdict."""

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice

import numpy as np
import numpy.typing as npt

from procedures.correction.burst import Burst, BurstRegistration, gather
from procedures.correction.checks import check_fields, check_scale, checks_of
from procedures.correction.deconvolve import DeconvolutionTile, Splitting, deconvolve, detail, mean_difference
from procedures.correction.loss import FieldError, field_error
from procedures.correction.mosaic import Mosaic
from procedures.correction.noise import Noise, noise_of, with_coding
from procedures.correction.optics import PlaneFields, Shift
from procedures.correction.prediction import Prediction, predict
from procedures.correction.priors import Prior
from procedures.correction.tiles import TileGrid
from procedures.correction.tone_curve import CurveError, curve_unknown, decoded_again, plausible
from procedures.correction.undershoot import bounded
from procedures.display import summary
from procedures.outcome import BadInput, Check, Outcome, Verdict, checked_type, verdict_of
from procedures.psf_field import PsfField
from procedures.raw import FrameLike, as_frame
from procedures.reading.development import Development

Array = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]
Progress = Callable[[int, int], None]
Answer = tuple[tuple[int, int], Single]
"""A tile's first sample, and its picture."""

SAMPLE_TILES, CURVE_TILES = 8, 4
"""Tiles for estimating the picture's mean difference before the whole is restored, and the error of a tone curve."""
LEAST_RESOLVED = 0.5
"""Smallest resolved fraction of the frequencies of a finer grid."""
TAU = {"total-variation": 0.75, "second-order": 0.25}
"""Strength of a prior, variance over mean difference, with the best results on pictures of people and things."""
LEAST_DIFFERENCE = 1e-6
"""Mean difference of a tile without any detail."""


@dataclass(frozen=True)
class CorrectionParameters:
    """Parameters of a correction.

    prior : of the picture; splitting : parameters of the solver; side : of the tiles in pixels of the picture, None to
    follow the field's variation; threads : None for the number of cores; scale : pixels of the picture per pixel of the
    sensor, along each side.
    """

    prior: Prior = field(default_factory=Prior)
    splitting: Splitting = field(default_factory=Splitting)
    side: int | None = None
    threads: int | None = None
    scale: int = 1


@dataclass(frozen=True, eq=False)
class Correction:
    """One photograph or several, corrected.

    picture : (C, H, W) float32
        On the first photograph's grid, or `scale` times as fine; white = 1: grey, or red, green, blue of the camera,
        not balanced.
    noise : of each plane of the first photograph
    tau, difference : float
        The prior's strength, and the mean length of the balanced picture's differences from which it derives.
    side : int
        Side of the tiles.
    clipped : float
        Fraction of the photograph's samples that are clipped.
    prediction : gain and cost
    optics, mosaic, prior : as used
    places : registration of every further photograph to the first
    resolved : float
        Fraction of the frequencies of the finer grid that the photographs' positions resolve.
    scale : int
        Pixels of the picture per pixel of the sensor.
    curve_error : error by the tone curve of a developed picture; None where the curve is known
    """

    picture: Single
    noise: Mapping[str, Noise]
    tau: float
    difference: float
    side: int
    clipped: float
    prediction: Prediction
    optics: PlaneFields
    mosaic: Mosaic
    prior: Prior
    places: Sequence[BurstRegistration] = ()
    resolved: float = 1.0
    scale: int = 1
    curve_error: CurveError | None = None

    __repr__ = summary

    @property
    def sensor_shape(self) -> tuple[int, int]:
        """Rows and columns of the sensor."""
        rows, columns = self.mosaic.shape
        return rows // self.scale, columns // self.scale

    @cached_property
    def field_error(self) -> FieldError:
        """Error of the picture due to the field's uncertainty; computed on first access, in some seconds."""
        return field_error(self.optics, self.mosaic, self.prior, self.tau, self.difference, self.picture)


def correct(
    frame: FrameLike, fields: Mapping[str, PsfField], shifts: Mapping[str, Shift] | None = None,
    parameters: CorrectionParameters | None = None, progress: Progress = lambda done, all: None,
    others: Sequence[FrameLike] = (),
) -> Outcome[Correction]:  # fmt: skip
    """Correct one photograph or several for the blur of their lens.

    frame : the photograph, linear: a grey plane, also as an array (rows, columns), the four of a mosaic, or a developed
    picture's, of which green is named G1; fields : by plane; shifts : by plane, its lateral colour relative to the
    reference plane, which is corrected; progress : called with the numbers of tiles done and in total; others : further
    photographs of the same scene, moved by some pixels; those of another scene are set aside.

    Raises BadInput, Refused if the field has other planes or is coarser than the picture, photographs are from
    different cameras, or one was processed (see `checks`).
    """
    p, frame, further = parameters or CorrectionParameters(), as_frame(frame), [as_frame(other) for other in others]
    for one in fields.values():
        checked_type(one, PsfField, "pass a field by plane, as read_field gives, or outcome.result() of each")
    development = frame.development
    if development and further:
        reason = "several photographs are combined from RAW files; this one is developed"
        raise BadInput(reason, "give RAW files, or one photograph")
    check_fields(frame.planes, fields, developed=development is not None)
    check_scale(frame.planes, fields, p.scale)
    noise = {name: noise_of(plane) for name, plane in frame.planes.items()}
    if development:
        noise = {name: with_coding(one, development) for name, one in noise.items()}
    checks = checks_of(frame.planes, noise, developed=development is not None)
    outcome: Outcome[Correction] = verdict_of(checks)
    if outcome.verdict is Verdict.REFUSED:
        return outcome
    burst = gather(frame, further, shifts or {}, p.scale, noise)
    mosaic = Mosaic.of(burst.planes, burst.noise, burst.light)
    optics = PlaneFields.of(burst.planes, fields, burst.shifts)
    side = p.side or optics.side(mosaic.shape)
    work = _Work(mosaic, optics, TileGrid.over(mosaic.shape, side, optics.ring), p)
    gain = work.gain()
    picture, difference = work.restored(gain, progress)
    tau = work.tau(difference)
    prediction = predict(optics, mosaic, p.prior, tau, difference)
    inputs = optics, mosaic, p.prior, burst.places, burst.resolved, p.scale
    curve_error = work.curve_error(gain, development) if development and curve_unknown(development) else None
    correction = Correction(picture, noise, tau, difference, side, mosaic.clipped, prediction, *inputs, curve_error)
    return verdict_of([*checks, _smoothed(prediction, p.scale), *_sampled(burst, p.scale)], correction)


def _sampled(burst: Burst, scale: int) -> Sequence[Check]:
    """Checks of the number of photographs used and of the resolution of the finer grid."""
    aside = [f"photograph {i}: {place.reason}" for i, place in enumerate(burst.places, start=2) if place.reason]
    remedies = dict.fromkeys(place.remedy for place in burst.places if place.reason)
    return [
        Check("photographs", 2 * len(aside), len(burst.places), Verdict.DOUBTFUL,
              f"most of the further photographs were set aside: {'; '.join(aside)}", "; ".join(remedies)),
        Check("sampling", burst.resolved, LEAST_RESOLVED, Verdict.DOUBTFUL,
              f"the photographs' positions resolve {burst.resolved:.0%} of the detail of a grid {scale} times as fine, "
              f"at least {LEAST_RESOLVED:.0%} are needed: the rest comes from the prior",
              "add photographs that are shifted by fractions of a pixel, or lower --scale",
              least=True, given=scale > 1),
    ]  # fmt: skip


def _smoothed(prediction: Prediction, scale: int) -> Check:
    """Doubtful where noise requires so strong a prior that more detail is lost than recovered."""
    before, after = (scale * float(np.median(mtf50)) for mtf50 in (prediction.before, prediction.after))
    return Check(
        "smoothing",
        before,
        after,
        Verdict.DOUBTFUL,
        f"the scene's detail is so weak relative to the noise that it is smoothed: MTF50 at edges goes from "
        f"{before:.2f} to {after:.2f} cycles/pixel of the sensor",
        "lower --strength, or expose longer",
    )


@dataclass(frozen=True, eq=False)
class _Work:
    mosaic: Mosaic
    optics: PlaneFields
    grid: TileGrid
    how: CorrectionParameters

    def tau(self, difference: float) -> float:
        """Strength of the prior for a mean difference of the picture.

        A finer grid has more differences, which are not independent: together they weigh as much as on the sensor's.
        """
        strength = self.how.prior.strength * TAU[self.how.prior.name] / self.how.scale**2
        return strength * self.mosaic.variance / difference

    def gain(self) -> float:
        """The picture's mean difference over the photograph's detail, from a sample of tiles restored twice."""
        tiles = [self._tile(start) for start in self._sample(SAMPLE_TILES)]
        prior, margin = self.how.prior, self.grid.rows.margin
        estimate = float(np.mean([mean_difference(first, prior) for _, first in tiles]))
        for _ in range(2):
            tau = self.tau(estimate)
            pictures = [deconvolve(tile, first, prior, tau, estimate, self.how.splitting) for tile, first in tiles]
            inner = [np.ascontiguousarray(u[:, margin:-margin, margin:-margin]) for u in pictures]
            estimate = max(float(np.mean([mean_difference(u, prior) for u in inner])), LEAST_DIFFERENCE)
        return estimate / max(float(np.mean([detail(first) for _, first in tiles])), LEAST_DIFFERENCE)

    def curve_error(self, gain: float, development: Development) -> CurveError:
        """Error of the picture by its tone curve, from a sample of tiles corrected under plausible ones."""
        curve, gains, prior = development.curve, self.mosaic.gains, self.how.prior
        squares = []
        for start in self._sample(CURVE_TILES):
            tile, first = self._tile(start)
            inside, pictures = self._window(start) > 0, []
            for other in (curve, *plausible(development)):
                again, begin = decoded_again(tile, first, gains, curve, other)
                size = max(gain * detail(begin), LEAST_DIFFERENCE)
                u = deconvolve(again, begin, prior, self.tau(size), size, self.how.splitting) * gains[:, None, None]
                pictures.append((u[:, inside], other.encoded(u[:, inside])))
            assumed, *others = pictures
            squares += [[np.mean((a - b) ** 2) for a, b in zip(one, assumed, strict=True)] for one in others]
        return CurveError(*(float(rms) for rms in np.sqrt(np.mean(squares, axis=0))))

    def restored(self, gain: float, progress: Progress) -> tuple[Single, float]:
        """The whole picture, in the photograph's units, and its mean difference; each tile has its own strength."""
        rows, columns = self.mosaic.shape
        out = np.zeros((self.mosaic.channels, rows, columns), dtype=np.float32)
        starts, sizes = list(self.grid), list[float]()

        def restore(start: tuple[int, int]) -> Answer:
            tile, first = self._tile(start)
            size = max(gain * detail(first), LEAST_DIFFERENCE)
            sizes.append(size)
            u = deconvolve(tile, first, self.how.prior, self.tau(size), size, self.how.splitting)
            return start, bounded(u, first, self._noise(tile))

        for done, (start, u) in enumerate(_in_parallel(restore, starts, self.how.threads), start=1):
            window, at = self._window(start), zip(start, out.shape[1:], strict=True)
            (y, ys), (x, xs) = (_overlap(first, len(window), size) for first, size in at)
            out[:, y, x] += window[ys, xs] * u[:, ys, xs]
            progress(done, len(starts))
        out *= self.mosaic.gains[:, None, None]
        return out, math.fsum(sizes) / len(sizes)

    def _sample(self, count: int) -> list[tuple[int, int]]:
        """Starts of some tiles, evenly over the frame."""
        starts = list(self.grid)
        return [starts[round(float(k))] for k in np.linspace(0, len(starts) - 1, min(count, len(starts)))]

    def _tile(self, start: tuple[int, int]) -> tuple[DeconvolutionTile, Single]:
        n = self.grid.rows.n
        x, y = self.grid.centre(start)
        moved, otf = self.optics.whole(x, y), self.optics.otf(x, y, n)
        z, weight = self.mosaic.cut(start, n, self.optics.ring, moved)
        groups = self._groups(moved)
        tile = DeconvolutionTile(
            np.stack([z[planes].sum(axis=0) for planes in groups]),
            np.stack([weight[planes].sum(axis=0) for planes in groups]),
            np.stack([otf[planes].mean(axis=0) for planes in groups]),
            [self.optics.channel[planes[0]] for planes in groups],
        )
        return tile, self.mosaic.first(z, weight)

    def _noise(self, tile: DeconvolutionTile) -> Single:
        """Standard deviation (C, n, n) of the darkest samples near each place."""
        import cv2

        most = [tile.weight[np.equal(tile.channel, c)].max(axis=0) for c in range(tile.channels)]
        near = np.stack([cv2.dilate(one, np.ones((5, 5), np.uint8)) for one in most])
        return np.asarray(np.sqrt(self.mosaic.variance / np.maximum(near, 1e-6)), dtype=np.float32)

    def _groups(self, moved: Mapping[str, tuple[int, int]]) -> list[list[int]]:
        """Planes of one colour, photograph and displacement: they have samples at different places, and one PSF."""
        groups: dict[object, list[int]] = {}
        for p, (key, colour) in enumerate(zip(self.mosaic.planes, self.optics.channel, strict=True)):
            groups.setdefault((colour, key.partition(" ")[2], moved.get(key, (0, 0))), []).append(p)
        return list(groups.values())

    def _window(self, start: tuple[int, int]) -> Single:
        return np.outer(self.grid.rows.window(start[0]), self.grid.columns.window(start[1]))


def _overlap(start: int, n: int, size: int) -> tuple[slice, slice]:
    """The part of n samples from a start that lies in the frame: as a slice of the frame, and of the tile."""
    low, high = max(start, 0), min(start + n, size)
    return slice(low, high), slice(low - start, high - start)


def _in_parallel(
    work: Callable[[tuple[int, int]], Answer], starts: list[tuple[int, int]], threads: int | None
) -> Iterable[Answer]:
    """The results in order, a few at a time to limit memory."""
    count = threads or os.cpu_count() or 1
    waiting = iter(starts)
    with ThreadPoolExecutor(count) as pool:
        pending = [pool.submit(work, start) for start in islice(waiting, 2 * count)]
        while pending:
            yield pending.pop(0).result()
            pending += [pool.submit(work, start) for start in islice(waiting, 1)]
