"""Several photographs of one scene from nearly one position: registration, and planes on one finer grid.

A sensor aliases detail that is finer than its pixels. Photographs shifted by fractions of a pixel alias it differently:
together they resolve it, as far as the lens transmits it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from procedures.clipping import NOMINAL
from procedures.correction.checks import checks_of
from procedures.correction.noise import Noise, noise_of
from procedures.correction.optics import COLOURS, Shift
from procedures.numerics.warps import affine_between
from procedures.outcome import BadInput, Outcome, Verdict, verdict_of
from procedures.raw import Plane, RawFrame

Array = npt.NDArray[np.float64]

SHOWN = ("G1", "Y")
"""The plane used for registration."""
SMOOTHED_PX, EXPECTED = 1.0, 0.28
"""Blur of a plane before photographs are compared, as aliased detail differs between them, and the standard deviation
it leaves of white noise, 1 / (2 sqrt(pi) 1)."""
NOTHING_ALIKE = 0.7
"""Residual over contrast above which a photograph shows another scene; for two unrelated scenes it is 1.4."""
MAX_RESIDUAL, MAX_OVER_NOISE = 0.1, 3.0
"""Residual over contrast and over noise above which a photograph is set aside."""
MOST_LIGHT = 1.25
"""Largest factor of brightness of a photograph that is used."""
MOST_CHANGE_PX = 0.25
"""Tolerated displacement relative to the middle of a tile, at its window's end; more is a rotation or a zoom."""
TILE_PX = 32
"""Distance of the window's end from a tile's middle for the smallest tiles, pixels of the sensor."""
EVEN = 0.1
"""Power of a frequency among its aliases above which it counts as resolved, relative to an even distribution."""


@dataclass(frozen=True, eq=False)
class BurstRegistration:
    """Registration of a photograph to the first.

    matrix : (2, 3) float64
        Maps a point of the first photograph to this one, in pixels of the sensor.
    light : float
        Brightness relative to the first.
    residual : float
        Residual over contrast, corrected for noise.
    reason, remedy : str
        Why it is set aside; empty if it is used.
    """

    matrix: Array
    light: float
    residual: float
    reason: str = ""
    remedy: str = ""

    def moved_px(self, shape: tuple[int, int]) -> Array:
        """Displacement (x, y) of the middle of a frame of that shape, relative to the first photograph."""
        middle = np.array([shape[1] - 1, shape[0] - 1]) / 2
        return np.asarray(self.matrix[:, :2] @ middle + self.matrix[:, 2] - middle)


@dataclass(frozen=True, eq=False)
class Burst:
    """Photographs on one picture's grid.

    scale : int
        Pixels of the picture per pixel of the sensor.
    planes : by key, a plane's name and a photograph's number; `origin` and `pitch` in pixels of the picture
    noise, light : by key
    shifts : by key, residual displacement beyond `origin`
    places : of every photograph after the first
    """

    scale: int
    planes: dict[str, Plane] = field(default_factory=dict)
    noise: dict[str, Noise] = field(default_factory=dict)
    light: dict[str, float] = field(default_factory=dict)
    shifts: dict[str, Shift] = field(default_factory=dict)
    places: list[BurstRegistration] = field(default_factory=list)

    def add(
        self, frame: RawFrame, noise: Mapping[str, Noise], shifts: Mapping[str, Shift],
        place: BurstRegistration | None, number: int,
    ) -> None:  # fmt: skip
        """Add a photograph's planes at their positions in whole pixels of the sensor; the rest is a shift."""
        first = next(iter(frame.planes.values()))
        rows, columns = (size * first.pitch for size in first.samples.shape)
        whole = np.zeros(2, int) if place is None else np.rint(place.moved_px((rows, columns))).astype(int)
        for name, plane in frame.planes.items():
            key = name if place is None else f"{name} {number}"
            x, y = self.scale * (np.array(plane.origin) - whole)
            self.planes[key] = replace(plane, origin=(int(x), int(y)), pitch=self.scale * plane.pitch)
            self.noise[key] = noise[name]
            lateral = shifts.get(name)
            if place is not None:
                self.light[key] = place.light
                self.shifts[key] = _shift(place, whole, plane, lateral, self.scale)
            elif lateral is not None:
                self.shifts[key] = _scaled(lateral, self.scale)

    @property
    def resolved(self) -> float:
        """Fraction of the finer grid's frequencies that the positions of green's or grey's samples resolve.

        With samples at x_j on a grid finer by F, frequencies 1/F cycles apart are equal up to a phase; the power of the
        F x F of them is given by the eigenvalues of sum_j exp(2 pi i (a - b) x_j / F).
        """
        colour = COLOURS[next(name for name in SHOWN if name in self.planes)]
        planes = {key: plane for key, plane in self.planes.items() if COLOURS[plane.name] == colour}
        pitch = next(iter(planes.values())).pitch
        middle = [np.array(plane.samples.shape[::-1]) / 2 for plane in planes.values()]
        at = np.array([
            np.array(plane.origin) - (self.shifts[key](m[None])[0] if key in self.shifts else 0.0)
            for (key, plane), m in zip(planes.items(), middle, strict=True)
        ])  # fmt: skip
        waves = np.stack(np.meshgrid(np.arange(pitch), np.arange(pitch)), axis=-1).reshape(-1, 2) / pitch
        phases = np.exp(2j * np.pi * at @ waves.T)
        power = np.linalg.eigvalsh(phases.conj().T @ phases) / len(at)
        return float(np.mean(power > EVEN))


def gather(
    frame: RawFrame, others: Sequence[RawFrame], shifts: Mapping[str, Shift], scale: int, noise: Mapping[str, Noise]
) -> Burst:
    """Register all photographs of the same scene on a grid of `scale` times the sensor's pixels along each side.

    Raises BadInput if a photograph has other planes than the first, or another size.

    shifts : by plane, lateral colour in pixels of the sensor
    noise : of the first photograph's planes
    """
    burst = Burst(scale)
    burst.add(frame, noise, shifts, None, 1)
    for number, other in enumerate(others, start=2):
        noise_of_other = {name: noise_of(plane) for name, plane in other.planes.items()}
        place = place_of(frame, other, noise)
        processed: Outcome[BurstRegistration] = verdict_of(checks_of(other.planes, noise_of_other))
        if processed.verdict is Verdict.REFUSED and not place.reason:
            place = replace(place, reason=processed.reason, remedy=processed.remedy)
        burst.places.append(place)
        if not place.reason:
            burst.add(other, noise_of_other, shifts, place, number)
    return burst


def _scaled(shift: Shift, scale: int) -> Shift:
    return lambda points: scale * shift(points)


def _shift(
    place: BurstRegistration, whole: npt.NDArray[np.int_], plane: Plane, lateral: Shift | None, scale: int
) -> Shift:
    """Displacement of a plane's points relative to the first photograph's, less the whole pixels."""
    back = np.linalg.inv(place.matrix[:, :2])

    def at(points: Array) -> Array:
        on_sensor = points * plane.pitch + np.array(plane.origin)
        displacement = on_sensor - (on_sensor - place.matrix[:, 2]) @ back.T - whole
        return np.asarray(scale * (displacement if lateral is None else displacement + lateral(points)))

    return at


def place_of(frame: RawFrame, other: RawFrame, noise: Mapping[str, Noise]) -> BurstRegistration:
    """Register a photograph to the first, with the reason if it is set aside.

    Raises BadInput if it has other planes than the first, or another size.
    """
    _check_alike(frame, other)
    name = next(plane for plane in SHOWN if plane in frame.planes)
    first, second = frame.planes[name], other.planes[name]
    a, b = (np.minimum(plane.samples, np.float32(NOMINAL)) for plane in (first, second))
    matrix = affine_between(a, b, first.samples < NOMINAL)
    if matrix is None:
        return BurstRegistration(np.eye(2, 3), 1.0, 1.0, *_ELSEWHERE)
    light, residual, over_noise = _compared(first, second, matrix, noise[name])
    on_sensor = matrix.copy()
    origin = np.array(first.origin, dtype=np.float64)
    on_sensor[:, 2] = first.pitch * matrix[:, 2] + origin - matrix[:, :2] @ origin
    change = float(np.abs(on_sensor[:, :2] - np.eye(2)).max()) * TILE_PX
    return BurstRegistration(on_sensor, light, residual, *_set_aside(light, residual, over_noise, change))


_ELSEWHERE = ("it shows another scene, or the scene turned or from another place", "omit it")


def _set_aside(light: float, residual: float, over_noise: float, change: float) -> tuple[str, str]:
    if residual > NOTHING_ALIKE:
        return _ELSEWHERE
    if residual > MAX_RESIDUAL and over_noise > MAX_OVER_NOISE:
        return (
            f"it differs from the first by {residual:.0%} of the contrast in the common part: something moved, or its "
            "blur is different",
            "omit it",
        )
    if not 1 / MOST_LIGHT < light < MOST_LIGHT:
        return f"it is {light:.2f} times as bright as the first", "take all photographs with one exposure"
    if change > MOST_CHANGE_PX:
        most = MOST_CHANGE_PX / TILE_PX
        return (
            f"it is rotated relative to the first by more than {np.degrees(most):.2g} degrees, or scaled by more than "
            f"{most:.1%}",
            "take the photographs from a tripod or a rail, shifted by some pixels",
        )
    return "", ""


def _check_alike(frame: RawFrame, other: RawFrame) -> None:
    def words(photograph: RawFrame) -> str:
        rows, columns = next(iter(photograph.planes.values())).samples.shape
        return f"{', '.join(photograph.planes)} of {columns} x {rows} pixels"

    def layout(photograph: RawFrame) -> list[object]:
        planes = photograph.planes.items()
        return [(name, plane.samples.shape, plane.pitch, plane.origin) for name, plane in planes]

    if layout(frame) != layout(other):
        raise BadInput(
            f"photographs of one camera are needed; {frame.path.name} has {words(frame)}, {other.path.name} has "
            f"{words(other)}",
            "give photographs of one camera, neither cropped nor rotated",
        )


def _compared(first: Plane, second: Plane, matrix: Array, noise: Noise) -> tuple[float, float, float]:
    """Brightness of the second relative to the first, and the residual over contrast and over expected noise."""
    import cv2

    size = first.samples.shape[::-1]
    clear = [(plane.samples < NOMINAL).astype(np.float32) for plane in (first, second)]
    smooth = [cv2.GaussianBlur(plane.samples, (0, 0), SMOOTHED_PX) for plane in (first, second)]
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(smooth[1], matrix, size, flags=flags)
    valid = cv2.warpAffine(clear[1], matrix, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    common = cv2.erode(((valid > 0.999) & (clear[0] > 0)).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    if common.sum() < 0.1 * common.size:
        return 1.0, 1.0, np.inf
    a, b = smooth[0][common].astype(np.float64), warped[common].astype(np.float64)
    light = float(b.mean() / a.mean()) if a.mean() > 0 else 1.0
    residual = float(np.mean((b / light - a) ** 2)) if light > 0 else float(np.var(a))
    expected = 2 * EXPECTED**2 * float(noise.variance_at(a).mean())
    contrast = float(np.std(a)) or 1e-9
    return light, float(np.sqrt(max(residual - expected, 0.0))) / contrast, float(np.sqrt(residual / expected))
