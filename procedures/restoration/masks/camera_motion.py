"""Blur over the frame from the camera's poses during the exposure: a rig that translates and rotates (6.7).

Poses are given, or integrated from the record of an inertial unit on a vibrating rig. The scene's points are projected
through them, which gives the curves of any motion's velocity field (5.1) in integrated form.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from procedures.numerics.arrays import Array
from procedures.outcome import BadInput, BadParameter, Refused
from procedures.raw import ImuRecord, ShakerPath, ShakerResponse
from procedures.reading.arrays import SMALLEST, checked_array, checked_number
from procedures.restoration.masks.blur_models import DepthUnit
from procedures.restoration.masks.blur_operator import MaskStack
from procedures.restoration.masks.checks import check_extent
from procedures.restoration.masks.line_rasterisation import path_mask
from procedures.restoration.masks.mask_fields import MaskField, positions

FLIPPED = np.array([1.0, -1.0, -1.0])
"""From an inertial unit's axes, x right and y up, to the picture's, y down and z ahead."""
FEWEST = 16
"""Smallest number of samples of a record."""
LARGEST_READING = 1e6
"""Largest position, acceleration or rate of a record, in SI units."""
LATEST_S, LEAST_INTERVAL_S = 1e11, 1e-7
"""Limits of times, which may count from 1970, and of intervals: no unit or tracker samples at 10 MHz."""
MOST_MASK_SAMPLES = 1 << 29
"""Limit for the masks of all photographs: 4 GB, and 10 s of processor time."""
MOST_TURN = 0.15
"""Largest rotation in radians for which rates may be summed without regard to their order."""
WHOLE_ROUND = 0.02
"""Tolerated deviation of an exposure from whole rounds of a path, so that its start does not matter."""
INSTANTS = 512
"""Poses per exposure: those of a path of 100 pixels are a fifth of a pixel apart."""


LEVEL_PX = 0.25
"""Step of w between masks, which are interpolated."""
NODE_PX, EVEN_PX = 0.5, 0.1
"""Difference allowed between the paths of neighbouring nodes, whose masks are blended, and the difference up to which
they are constant over the frame, pixels."""
MOST_NODES = 12
"""Maximum along one axis: each has its own masks in memory."""
LEAST_W = 0.5
"""Pixels that translations must reach at the smallest distance; below, depth is undetermined."""
LEAST_PATH_M = 2e-5
"""Smallest translation of the rig: 0.02 pixels at one metre and a focal length of 1000 pixels."""


@dataclass(frozen=True)
class Poses:
    """Poses at equal times relative to the rig at rest: positions and rotation vectors (n, 3), x right, y down, z
    ahead."""

    position_m: Array
    turn_rad: Array

    @property
    def planar_path(self) -> Array:
        """The scene's path in the picture without rotations and motion in depth, (n, 2), metres: (5.3)."""
        return -self.position_m[:, :2]


def poses_of(imu: ImuRecord, exposure_s: float, late_s: float = 0.0) -> Poses:
    """Poses during an exposure, from a record that goes beyond it both ways and whose times are late by `late_s`.

    Gravity is rotated with the rig and subtracted as the mean. The unit's offsets cause a line in the rotations and a
    parabola in the positions, which are subtracted, as a vibrating rig has neither. The unit is assumed at the lens;
    one mounted elsewhere measures rotations as additional translations.

    Raises BadInput if the record is too short, unordered, does not cover the exposure, or rotates by more than a few
    degrees.
    """
    t = check_record(imu, exposure_s, late_s)
    turn = _without_drift(t, _integral(t, imu.rotation_rad_s * FLIPPED), 1)
    if np.abs(turn).max() > MOST_TURN:
        raise BadInput(
            f"the rig may rotate by up to {np.degrees(MOST_TURN):.0f} degrees; the record has "
            f"{np.degrees(np.abs(turn).max()):.0f} degrees",
            "record a rig that vibrates, in radians per second",
        )
    force = Rotation.from_rotvec(turn).apply(imu.acceleration_m_s2 * FLIPPED)
    position = _without_drift(t, _integral(t, _integral(t, force - force.mean(axis=0))), 2)
    at = late_s + np.linspace(0, exposure_s, INSTANTS)
    return Poses(CubicSpline(t, position)(at), CubicSpline(t, turn)(at))


def poses_at(time_s: Array, position_m: Array, turn_rad: Array) -> Poses:
    """Poses during an exposure that lasts from the first to the last of the times, as from a tracker or a robot.

    time_s : (n,); position_m, turn_rad : (n, 3), x right, y up, z back, relative to the rig at rest; rotations are
    rotation vectors. Interpolation is linear.

    Raises BadInput if there are fewer than two, times do not increase, a component jumps by half a turn, or numbers are
    too large.
    """
    if len(time_s) < 2:
        raise BadInput(f"a motion needs poses at two times or more; got {len(time_s)}", "record the whole exposure")
    time_s = _times(time_s)
    position_m, turn_rad = (_vectors(one, "poses", len(time_s)) for one in (position_m, turn_rad))
    if np.abs(np.diff(turn_rad, axis=0)).max() > np.pi:
        raise BadInput("the rotations jump by half a turn and more", "give rotation vectors in radians, not degrees")
    at = np.linspace(time_s[0], time_s[-1], INSTANTS)
    position, turn = (np.stack([np.interp(at, time_s, one) for one in a.T], axis=1) for a in (position_m, turn_rad))
    return Poses(position * FLIPPED, turn * FLIPPED)


def poses_on(shaker_path: ShakerPath, exposure_s: float, late_s: float = 0.0) -> Poses:
    """Poses during an exposure, from the path that was commanded, which is gone around as a periodic cubic spline.

    The rig follows it by the response of each axis, at the harmonics of a round. `late_s` : how late its times are.

    Raises BadInput if the start of the exposure on the path is not known, and the exposure is no whole number of
    rounds.
    """
    points = _vectors(shaker_path.position_m, "a shaker's path", None)
    interval_s = checked_number(shaker_path.interval_s, "the interval of a shaker's path", LEAST_INTERVAL_S)
    began_s = checked_number(shaker_path.since_s or 0.0, "the opening of the shutter", -LATEST_S, LATEST_S)
    round_s = interval_s * len(points)
    rounds = exposure_s / round_s
    if shaker_path.since_s is None and abs(rounds - max(round(rounds), 1)) > WHOLE_ROUND * rounds:
        raise BadInput(
            f"the exposure of {exposure_s:g} s is no whole number of rounds of {round_s:g} s, and its start is "
            "not known",
            "wire the hot shoe, or expose a whole round",
        )
    at = began_s + late_s + np.linspace(0, exposure_s, INSTANTS)
    spline = CubicSpline(interval_s * np.arange(len(points) + 1), [*points, points[0]], bc_type="periodic")
    position = spline(at)
    if any(one != ShakerResponse() for one in shaker_path.response):
        position = _followed(spline(np.arange(INSTANTS) * round_s / INSTANTS), shaker_path, at / round_s)
    return Poses(np.asarray(position) * FLIPPED, np.zeros((INSTANTS, 3)))


def _followed(command: Array, shaker_path: ShakerPath, phase: Array) -> Array:
    """Positions of the axes for a round of commands (n, 3), at phases in rounds."""
    spectrum = np.fft.rfft(command, axis=0)
    round_s = shaker_path.interval_s * len(shaker_path.position_m)
    harmonic = np.arange(len(spectrum))
    answer = spectrum * np.stack([one.at(harmonic / round_s) for one in shaker_path.response], axis=1)
    waves = np.exp(2j * np.pi * phase[:, None] * harmonic)
    weight = np.where((harmonic == 0) | (2 * harmonic == len(command)), 1.0, 2.0)[:, None]
    return np.asarray((waves @ (weight * answer)).real / len(command))


def check_record(imu: ImuRecord, exposure_s: float, late_s: float = 0.0) -> Array:
    """The record's times. Raises BadInput, see `poses_of`."""
    if len(imu.time_s) < FEWEST:
        reason = f"motion needs {FEWEST} samples or more; got {len(imu.time_s)}"
        raise BadInput(reason, "record at 100 Hz or more")
    t = _times(imu.time_s)
    for vectors in (imu.acceleration_m_s2, imu.rotation_rad_s):
        _vectors(vectors, "accelerations and rates of a record", len(t))
    if t[0] > min(late_s, 0.0) or t[-1] < exposure_s + max(late_s, 0.0):
        raise BadInput(
            f"the record must cover the exposure, 0 s to {exposure_s:.3f} s; it is from {t[0]:.3f} s to {t[-1]:.3f} s",
            "begin it before the shutter opens, end it after the shutter closes; time 0 is the opening",
        )
    return t


def _times(values: object) -> Array:
    remedy = "give seconds, sort the rows, drop repeated ones"
    t: Array = checked_array(values, "times of a record", (None,), low=-LATEST_S, high=LATEST_S, remedy=remedy)
    least = float(np.diff(t).min(initial=np.inf))
    if least < LEAST_INTERVAL_S:
        raise BadInput(f"times of a record must increase by {LEAST_INTERVAL_S:g} s or more; got {least:g} s", remedy)
    return t


def _vectors(values: object, what: str, count: int | None) -> Array:
    remedy = "give three components in SI units, drop the rows that lack one"
    vectors: Array = checked_array(values, what, (count, 3), low=-LARGEST_READING, high=LARGEST_READING, remedy=remedy)
    return vectors


def _integral(t: Array, rate: Array) -> Array:
    return np.asarray(CubicSpline(t, rate).antiderivative()(t))


def _without_drift(t: Array, x: Array, degree: int) -> Array:
    """x without its polynomial trend, fitted with small weights at the ends, where broken periods resemble drift."""
    weight = np.sin(np.pi * (t - t[0] + 1e-9) / (t[-1] - t[0] + 2e-9))
    fit = np.polynomial.polynomial.polyfit(t, x, degree, w=weight)
    return np.asarray(x - np.polynomial.polynomial.polyval(t, fit).T)


def image_curves(poses: Poses, x: float, y: float, inverse_m: Array) -> Array:
    """Image curves of the point at (x, y) of the rig at rest, relative to it, (levels, n, 2); in focal lengths.

    inverse_m : (levels,) inverse depths; 0 is infinity.
    """
    point = np.array([x, y, 1.0]) - np.asarray(inverse_m, float)[:, None, None] * poses.position_m
    direction = np.einsum("nji,lnj->lni", Rotation.from_rotvec(poses.turn_rad).as_matrix(), point)
    return np.asarray(direction[..., :2] / direction[..., 2:] - (x, y))


def planar_stacks(paths: Sequence[Array], max_w: float) -> list[MaskStack]:
    """Masks of recorded paths (n, 2) without rotation, w their half-width in pixels (5.2), (5.3). Raises Refused."""
    half = max(float(np.abs(path).max()) for path in paths)
    if half < LEAST_PATH_M:
        raise Refused("the rig must move during the exposures; it was at rest", "set it in motion, then expose")
    levels, R = int(np.ceil(max_w / LEVEL_PX)) + 2, int(np.ceil(max_w)) + 3
    scales = np.arange(levels) * LEVEL_PX / half
    return [MaskStack(np.stack([path_mask(path * scale, R) for scale in scales]), LEVEL_PX) for path in paths]


@dataclass(frozen=True)
class MotionBlur:
    """The masks of each photograph, and the pixels of w per unit of inverse depth, 1/m."""

    fields: tuple[MaskField, ...]
    px_per_inverse_m: float

    @property
    def unit(self) -> DepthUnit:
        """Unit of w."""
        return DepthUnit("1/m", 1 / self.px_per_inverse_m)


def motion_blur(
    exposures: Sequence[Poses], focal_px: float, shape: tuple[int, int], max_inverse_m: float
) -> MotionBlur:
    """Masks over the frame for inverse depths up to `max_inverse_m` (5.2); the axis is at the frame's centre.

    w is the inverse depth in pixels: the largest excursion due to translation. All masks are relative to the rig at
    rest, so they contain the displacement between the photographs.

    Raises BadParameter if focal length or inverse depth are not positive, or the motion is too large for the
    photographs; Refused if the rig translated too little to determine depth.
    """
    if not all(SMALLEST < one < LARGEST_READING for one in (focal_px, max_inverse_m)):
        raise BadParameter(
            f"focal length and greatest inverse depth must be positive, got {focal_px} pixels and {max_inverse_m} 1/m",
            "give the focal length in pixels, and 1 / the least distance in metres",
        )
    per_inverse = px_per_inverse_m(exposures, focal_px, shape)
    curves = _over_frame(exposures, focal_px, shape, np.array([0.0, max_inverse_m]))
    if per_inverse * max_inverse_m < LEAST_W:
        raise Refused(
            f"the rig's translations reach {per_inverse * max_inverse_m:.2f} pixels at the smallest distance: "
            "too little to determine depth",
            "set the rig in motion parallel to the picture, or come nearer",
        )
    reach = float(np.abs(curves).max()) * 1.05 + 3
    check_extent(reach, shape)
    R, grid, count = int(np.ceil(reach)), _grid(curves), np.ceil(per_inverse * max_inverse_m / LEVEL_PX) + 2
    samples = len(exposures) * grid[0] * grid[1] * count * (2 * R + 1) ** 2
    if samples > MOST_MASK_SAMPLES:
        raise BadParameter(
            f"the masks of a motion have up to {MOST_MASK_SAMPLES:g} samples, these would have {samples:.2g}",
            "lower the greatest inverse depth, or move the rig less",
        )
    levels = np.arange(int(count)) * LEVEL_PX
    rows, columns = positions(grid, shape, R)

    def stack(poses: Poses, row: float, column: float) -> MaskStack:
        x, y = ((at - (size - 1) / 2) / focal_px for at, size in ((column, shape[1]), (row, shape[0])))
        paths = image_curves(poses, x, y, np.asarray(levels / per_inverse, np.float64)) * focal_px
        return MaskStack(np.stack([path_mask(path, R) for path in paths]), LEVEL_PX)

    return MotionBlur(
        tuple(MaskField(tuple(tuple(stack(p, y, x) for x in columns) for y in rows)) for p in exposures), per_inverse
    )


def px_per_inverse_m(exposures: Sequence[Poses], focal_px: float, shape: tuple[int, int]) -> float:
    """Largest image shift by translations, in pixels per 1/m of inverse depth. Raises Refused if there is none."""
    curves = _over_frame(exposures, focal_px, shape, np.array([0.0, 1.0]))
    with np.errstate(invalid="ignore"):  # infinities are refused below
        reach = float(np.abs(curves[..., 1, :, :] - curves[..., 0, :, :]).max())
    if not LEAST_PATH_M * focal_px <= reach < np.inf:
        reason = "the rig must move parallel to the picture during the exposures, and not into the scene"
        raise Refused(reason, "set it in motion, then expose")
    return reach


def _over_frame(exposures: Sequence[Poses], focal_px: float, shape: tuple[int, int], inverse_m: Array) -> Array:
    """Curves at 3 x 3 positions of the frame, pixels: (photographs, 3, 3, inverse depths, n, 2)."""
    rows, columns = positions((3, 3), shape, 0)
    y, x = (rows - (shape[0] - 1) / 2) / focal_px, (columns - (shape[1] - 1) / 2) / focal_px
    return np.array([[[image_curves(p, b, a, inverse_m) for b in x] for a in y] for p in exposures]) * focal_px


def _grid(curves: Array) -> tuple[int, int]:
    """Numbers of nodes for which the curves change little from one to the next."""

    def nodes(along: Array) -> int:
        change = sum(float(np.hypot(*np.moveaxis(b - a, -1, 0)).max()) for a, b in pairwise(along))
        return 1 if change < EVEN_PX else min(int(np.ceil(change / NODE_PX)) + 1, MOST_NODES)

    return nodes(np.moveaxis(curves, 1, 0)), nodes(np.moveaxis(curves, 2, 0))
