"""Several photographs of one scene from nearly one place: how each lies to the first, and all on one finer grid.

A sensor's pixels see detail that is finer than themselves, folded down. Photographs that lie apart by parts of a pixel
see it folded otherwise: together they tell it, as far as the lens passes it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from procedures.clipping import NOMINAL
from procedures.correction.checks import checks_of
from procedures.correction.noise import Noise, noise_of
from procedures.correction.optics import COLOURS, Shift
from procedures.numerics.registration import affine_between
from procedures.outcome import BadInput, Outcome, Verdict, verdict_of
from procedures.raw import Plane, RawFrame

Array = npt.NDArray[np.float64]

SHOWN = ("G1", "Y")
"""The plane in which photographs are registered."""
SMOOTHED_PX, EXPECTED = 1.0, 0.28
"""Blur of a plane before photographs are compared: what is folded down goes another way in each. And what it leaves of
white noise, 1 / (2 sqrt(pi) 1)."""
NOTHING_ALIKE = 0.7
"""What differs over the contrast from which a photograph shows another scene; of two without likeness it is 1.4."""
LEFT_OVER, OF_NOISE = 0.1, 3.0
"""What differs of a photograph after all that, over the contrast and over its noise, from which it is set aside."""
MOST_LIGHT = 1.25
"""Factor of light up to which a photograph is taken in."""
MOST_CHANGE_PX = 0.25
"""Movement against the middle of a tile, at its window's end, that is let pass; more is a turn or another scale."""
TILE_PX = 32
"""How far that is from a tile's middle where tiles are smallest, pixels of the sensor."""
EVEN = 0.1
"""Power of one wave among those that fold onto each other from which it counts as told, over an even share."""


@dataclass(frozen=True, eq=False)
class Place:
    """How one photograph lies to the first.

    Attributes
    ----------
    matrix : (2, 3) float64
        Place of a point of the first photograph in it, in pixels of the sensor.
    light : float
        Over the first's.
    left_over : float
        What differs after all, over the contrast, without noise.
    reason, remedy : str
        Why it is set aside; empty where it is not.
    """

    matrix: Array
    light: float
    left_over: float
    reason: str = ""
    remedy: str = ""

    def moved_px(self, shape: tuple[int, int]) -> Array:
        """How far the middle of a frame of that shape lies from where it is in the first, (x, y)."""
        middle = np.array([shape[1] - 1, shape[0] - 1]) / 2
        return np.asarray(self.matrix[:, :2] @ middle + self.matrix[:, 2] - middle)


@dataclass(frozen=True, eq=False)
class Burst:
    """Photographs on one picture's grid.

    Attributes
    ----------
    planes : by key, a plane's name and a photograph's number; `origin` and `pitch` in pixels of the picture
    noise, light : by key
    shifts : by key, what `origin` leaves of the photographs' places
    places : of every photograph after the first
    told : float
        Share of the waves of the finer grid that the photographs' places tell apart.
    """

    planes: Mapping[str, Plane]
    noise: Mapping[str, Noise]
    light: Mapping[str, float]
    shifts: Mapping[str, Shift]
    places: Sequence[Place]
    told: float


def gather(
    frame: RawFrame, others: Sequence[RawFrame], shifts: Mapping[str, Shift], scale: int, noise: Mapping[str, Noise]
) -> Burst:
    """All photographs that show the same scene, on a grid of `scale` times the sensor's pixels along each side.

    Parameters
    ----------
    shifts : by plane, lateral colour in pixels of the sensor
    noise : of the first photograph's planes

    Raises
    ------
    BadInput
        If a photograph has other planes than the first, or another size.
    """
    laid = _Laid({}, {}, {}, {}, scale)
    laid.add(frame, noise, shifts, None, 1)
    places = []
    for number, other in enumerate(others, start=2):
        own = {name: noise_of(plane) for name, plane in other.planes.items()}
        place = _unprocessed(place_of(frame, other, noise), other, own)
        places.append(place)
        if not place.reason:
            laid.add(other, own, shifts, place, number)
    return Burst(laid.planes, laid.noise, laid.light, laid.shifts, places, _told(laid))


def _unprocessed(place: Place, frame: RawFrame, noise: Mapping[str, Noise]) -> Place:
    """The same, set aside where the photograph's noise is no sensor's."""
    judged: Outcome[Place] = verdict_of(checks_of(frame.planes, noise))
    refused = judged.verdict is Verdict.REFUSED and not place.reason
    return replace(place, reason=judged.reason, remedy=judged.remedy) if refused else place


@dataclass(frozen=True, eq=False)
class _Laid:
    """Planes, noise, light and shifts as they are gathered."""

    planes: dict[str, Plane]
    noise: dict[str, Noise]
    light: dict[str, float]
    shifts: dict[str, Shift]
    scale: int

    def add(
        self, frame: RawFrame, noise: Mapping[str, Noise], shifts: Mapping[str, Shift], place: Place | None, number: int
    ) -> None:
        """Lay a photograph's planes in their places, by whole pixels of the sensor; the rest is a shift."""
        plane = next(iter(frame.planes.values()))
        rows, columns = (size * plane.pitch for size in plane.samples.shape)
        whole = np.zeros(2, int) if place is None else np.rint(place.moved_px((rows, columns))).astype(int)
        for name, one in frame.planes.items():
            key = name if place is None else f"{name} {number}"
            x, y = self.scale * (np.array(one.origin) - whole)
            self.planes[key] = replace(one, origin=(int(x), int(y)), pitch=self.scale * one.pitch)
            self.noise[key] = noise[name]
            lateral = shifts.get(name)
            if place is not None:
                self.light[key] = place.light
                self.shifts[key] = _shift(place, whole, one, lateral, self.scale)
            elif lateral is not None:
                self.shifts[key] = _scaled(lateral, self.scale)


def _scaled(shift: Shift, scale: int) -> Shift:
    return lambda points: scale * shift(points)


def _shift(place: Place, whole: npt.NDArray[np.int_], plane: Plane, lateral: Shift | None, scale: int) -> Shift:
    """Where a plane's points lie against the first photograph's, less the whole pixels."""
    back = np.linalg.inv(place.matrix[:, :2])

    def at(points: Array) -> Array:
        seen = points * plane.pitch + np.array(plane.origin)
        moved = seen - (seen - place.matrix[:, 2]) @ back.T - whole
        return np.asarray(scale * (moved if lateral is None else moved + lateral(points)))

    return at


def place_of(frame: RawFrame, other: RawFrame, noise: Mapping[str, Noise]) -> Place:
    """How a photograph lies to the first, and why it is set aside if it is.

    Raises
    ------
    BadInput
        If it has other planes than the first, or another size.
    """
    _check_alike(frame, other)
    name = next(one for one in SHOWN if one in frame.planes)
    first, second = frame.planes[name], other.planes[name]
    one, two = (np.minimum(plane.samples, np.float32(NOMINAL)) for plane in (first, second))
    matrix = affine_between(one, two, first.samples < NOMINAL)
    if matrix is None:
        return Place(np.eye(2, 3), 1.0, 1.0, *_ELSEWHERE)
    light, left, of_noise = _compared(first, second, matrix, noise[name])
    on_sensor = matrix.copy()
    origin = np.array(first.origin, dtype=np.float64)
    on_sensor[:, 2] = first.pitch * matrix[:, 2] + origin - matrix[:, :2] @ origin
    change = float(np.abs(on_sensor[:, :2] - np.eye(2)).max()) * TILE_PX
    return Place(on_sensor, light, left, *_set_aside(light, left, of_noise, change))


_ELSEWHERE = ("it shows another scene, or the scene from another place", "leave it out")


def _set_aside(light: float, left: float, of_noise: float, change: float) -> tuple[str, str]:
    """Reason and remedy, both empty where a photograph is taken in."""
    if left > NOTHING_ALIKE:
        return _ELSEWHERE
    if left > LEFT_OVER and of_noise > OF_NOISE:
        return (
            f"it differs from the first by {left:.0%} of the contrast where both show the same: something moved, or it "
            "is blurred otherwise",
            "leave it out",
        )
    if not 1 / MOST_LIGHT < light < MOST_LIGHT:
        return f"it is {light:.2f} times as bright as the first", "take all photographs with one exposure"
    if change > MOST_CHANGE_PX:
        most = MOST_CHANGE_PX / TILE_PX
        return (
            f"it is turned against the first by more than {np.degrees(most):.2g} degrees, or drawn larger or "
            f"smaller by more than {most:.1%}",
            "take the photographs from a tripod or a rail, moved by some pixels",
        )
    return "", ""


def _check_alike(frame: RawFrame, other: RawFrame) -> None:
    def told(one: RawFrame) -> str:
        rows, columns = next(iter(one.planes.values())).samples.shape
        return f"{', '.join(one.planes)} of {columns} x {rows} pixels"

    def place(one: RawFrame) -> list[object]:
        return [(name, plane.samples.shape, plane.pitch, plane.origin) for name, plane in one.planes.items()]

    if place(frame) != place(other):
        raise BadInput(
            f"photographs of one camera are needed; {frame.path.name} has {told(frame)}, {other.path.name} has "
            f"{told(other)}",
            "give photographs of one camera, none of them cropped or turned",
        )


def _compared(first: Plane, second: Plane, matrix: Array, noise: Noise) -> tuple[float, float, float]:
    """Light of the second over the first's, what differs over the contrast, and over what noise lets expect."""
    import cv2

    size = first.samples.shape[::-1]
    clear = [(one.samples < NOMINAL).astype(np.float32) for one in (first, second)]
    smooth = [cv2.GaussianBlur(one.samples, (0, 0), SMOOTHED_PX) for one in (first, second)]
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    moved = cv2.warpAffine(smooth[1], matrix, size, flags=flags)
    seen = cv2.warpAffine(clear[1], matrix, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    both = cv2.erode(((seen > 0.999) & (clear[0] > 0)).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    if both.sum() < 0.1 * both.size:
        return 1.0, 1.0, np.inf
    a, b = smooth[0][both].astype(np.float64), moved[both].astype(np.float64)
    light = float(b.mean() / a.mean()) if a.mean() > 0 else 1.0
    differs = float(np.mean((b / light - a) ** 2)) if light > 0 else float(np.var(a))
    expected = 2 * EXPECTED**2 * float(noise.variance_at(a).mean())
    contrast = float(np.std(a)) or 1e-9
    return light, float(np.sqrt(max(differs - expected, 0.0))) / contrast, float(np.sqrt(differs / expected))


def _told(laid: _Laid) -> float:
    """Share of the waves that fold onto each other which the places of green's or grey's samples tell apart.

    With samples at x_j on a grid of one in F, waves that lie 1/F cycles apart look alike up to a phase: what is told of
    the F x F of them are the eigenvalues of sum_j exp(2 pi i (a - b) x_j / F).
    """
    planes = {key: plane for key, plane in laid.planes.items() if COLOURS[plane.name] == COLOURS[_shown(laid)]}
    pitch = next(iter(planes.values())).pitch
    middle = [np.array(plane.samples.shape[::-1]) / 2 for plane in planes.values()]
    at = np.array([
        np.array(plane.origin) - (laid.shifts[key](m[None])[0] if key in laid.shifts else 0.0)
        for (key, plane), m in zip(planes.items(), middle, strict=True)
    ])  # fmt: skip
    waves = np.stack(np.meshgrid(np.arange(pitch), np.arange(pitch)), axis=-1).reshape(-1, 2) / pitch
    phases = np.exp(2j * np.pi * at @ waves.T)
    power = np.linalg.eigvalsh(phases.conj().T @ phases) / len(at)
    return float(np.mean(power > EVEN))


def _shown(laid: _Laid) -> str:
    return next(name for name in SHOWN if name in laid.planes)
