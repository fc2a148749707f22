"""Images on flat sheets at several distances: projected, blurred separately, and composited.

Charts are drawn from outlines, sheets from texels: a smooth image, interpolated by cubic convolution and sampled above
the cutoff of the optics.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

from simulators.camera.camera import NOMINAL_F_NUMBER, Lens, SimulatedCamera
from simulators.camera.optics import Optics
from simulators.camera.sensor import Sensor
from simulators.world.projection import ObjectPose, Projection, apply_homography
from simulators.world.world import SinusoidalDrive

Array = npt.NDArray[np.float64]
Frame = npt.NDArray[np.float32]
Spectrum = npt.NDArray[np.complex64]

OVERSAMPLING = 3
"""Fine samples per sensor pixel along each axis; optics and photosites pass almost nothing above half of it."""
SMOOTH_TEXELS = 0.7  # standard deviation of the low-pass filter applied before interpolation
SUPERSAMPLED = 4  # subtexel bits of the leaves' outlines


@dataclass(frozen=True, eq=False)
class FlatSheet:
    """A picture on a flat sheet.

    reflectance : (rows, columns) float32
    texel_mm : float, side of a texel
    behind_mm : float, distance behind the position of a chart
    cover : (rows, columns) float32 or None
        1 on the sheet, 0 outside it; None: the sheet continues beyond its picture, mirrored.
    """

    reflectance: Frame
    texel_mm: float
    behind_mm: float = 0.0
    cover: Frame | None = None


@dataclass(frozen=True, eq=False)
class PlacedSheet:
    """A sheet in space, with the pose of its centre, and its blur."""

    sheet: FlatSheet
    pose: ObjectPose
    optics: Optics

    def to_space(self) -> Array:
        """Texels (x, y, 1) to space in mm, homogeneous, (3, 3)."""
        rows, columns = self.sheet.reflectance.shape
        c = self.sheet.texel_mm
        centred = np.array([[c, 0.0, -c * (columns - 1) / 2], [0.0, c, -c * (rows - 1) / 2], [0.0, 0.0, 1.0]])
        return np.asarray(self.pose.plane_to_space() @ centred, dtype=np.float64)


def leaves(
    shape: tuple[int, int], rng: np.random.Generator, *, largest: float, background: float = 0.4,
    per_leaf: float = 300.0,
) -> Frame:  # fmt: skip
    """Dead leaves: occluding discs whose number falls with the cube of their size, (rows, columns) float32.

    largest : radius of the largest in texels; the smallest have 2
    per_leaf : texels of the picture for each leaf
    """
    rows, columns = shape
    picture = np.full(shape, background, np.float32)
    count = round(rows * columns / per_leaf)
    radius = (2.0**-2 - rng.random(count) * (2.0**-2 - largest**-2)) ** -0.5
    places, levels = rng.random((count, 2)) * (columns, rows), rng.uniform(0.06, 0.9, count)
    unit = 2**SUPERSAMPLED
    for (x, y), r, level in zip(places, radius, levels, strict=True):
        cv2.circle(picture, (int(unit * x), int(unit * y)), int(unit * r), float(level), -1, shift=SUPERSAMPLED)
    return smooth(picture)


def smooth(picture: Frame) -> Frame:
    """The image low-passed for interpolation."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), SMOOTH_TEXELS), dtype=np.float32)


def draw(
    sheets: Sequence[PlacedSheet],
    projection: Projection,
    shape: tuple[int, int],
    colours: Mapping[tuple[int, int], str],
) -> Frame:
    """Light on a frame (rows, columns), 1 where reflectance and illumination are 1, for a lens without distortion.

    Each sheet is blurred by its own optics, and so is its cover, over what lies farther back.

    sheets : from the back to the front, the first without a cover
    colours : the colour of each pixel of the mosaic's tile, by position (x, y)
    """
    if (level := _even(sheets)) is not None:
        return np.full(shape, level, np.float32)
    n, period = OVERSAMPLING, 1 + max(x for x, _ in colours)
    margin = 2 * -(-max(sheet.optics.margin_px() for sheet in sheets) // 2)
    wide = tuple(n * fft.next_fast_len(size + 2 * margin, real=True) for size in shape)
    spectra = [_spectra(sheet, projection, margin, wide) for sheet in sheets]
    frame = np.empty(shape, np.float32)
    for colour in sorted(set(colours.values())):
        light = np.zeros(wide, np.float32)
        for (picture, cover), transfer in zip(
            spectra, [_transfer(sheet.optics, colour, wide) for sheet in sheets], strict=True
        ):
            if cover is not None:
                light *= 1 - fft.irfft2(cover * transfer, wide)
                light += fft.irfft2(picture * transfer, wide)
            else:
                light = fft.irfft2(picture * transfer, wide)
        samples = light[n * margin : n * (margin + shape[0]) : n, n * margin : n * (margin + shape[1]) : n]
        for x, y in (place for place, its in colours.items() if its == colour):
            frame[y::period, x::period] = samples[y::period, x::period]
    return np.maximum(frame, 0.0)


def _even(sheets: Sequence[PlacedSheet]) -> np.float32 | None:
    """Level of a uniform panel, which blur does not change; None for other sheets."""
    (first, *others) = sheets
    picture = first.sheet.reflectance
    return None if others or np.ptp(picture) else np.float32(picture.flat[0])


def draw_moving(
    sheets: Sequence[PlacedSheet], poses: Sequence[Sequence[ObjectPose]], projection: Projection,
    shape: tuple[int, int], colours: Mapping[tuple[int, int], str],
) -> Frame:  # fmt: skip
    """Light on a frame as by `draw`, from sheets that move relative to the camera: the mean over all instants.

    Each sheet is blurred at its pose in `sheets`, then projected at its pose at each instant, and composited there.

    poses : at equally spaced instants, of each sheet
    """
    n, period = OVERSAMPLING, 1 + max(x for x, _ in colours)
    # from sensor pixels at an instant to those where the sheet was drawn
    ways = [
        [_drawn(sheet, projection) @ np.linalg.inv(_drawn(replace(sheet, pose=pose), projection))
         for sheet, pose in zip(sheets, instant, strict=True)]
        for instant in poses
    ]  # fmt: skip
    # largest displacement of the frame's corners in pixels
    corners = np.array([[x, y] for x in (0, shape[1] - 1) for y in (0, shape[0] - 1)], dtype=np.float64)
    moved = (np.abs(apply_homography(M, corners) - corners).max() for way in ways for M in way)
    margin = 2 * -(-(max(sheet.optics.margin_px() for sheet in sheets) + int(np.ceil(max(moved)))) // 2)
    wide = tuple(n * fft.next_fast_len(size + 2 * margin, real=True) for size in shape)
    to_fine = np.array([[n, 0, n * margin], [0, n, n * margin], [0, 0, 1.0]])
    spectra = [_spectra(sheet, projection, margin, wide) for sheet in sheets]
    frame = np.empty(shape, np.float32)
    for colour in sorted(set(colours.values())):
        layers = [_layer(spectrum, _transfer(placed.optics, colour, wide), wide)
                  for spectrum, placed in zip(spectra, sheets, strict=True)]  # fmt: skip
        for x, y in (place for place, its in colours.items() if its == colour):
            part = frame[y::period, x::period]
            from_part = np.array([[period, 0, x], [0, period, y], [0, 0, 1.0]])
            instants = ([to_fine @ M @ from_part for M in way] for way in ways)
            part[:] = sum(_seen(layers, maps, part.shape) for maps in instants) / len(ways)
    return np.maximum(frame, 0.0)


def _drawn(placed: PlacedSheet, projection: Projection) -> Array:
    """A sheet's texels to sensor pixels, (3, 3)."""
    return projection.pinhole() @ placed.to_space()


def _layer(spectra: tuple[Spectrum, Spectrum | None], transfer: Spectrum, wide: tuple[int, ...]) -> list[Frame]:
    """A sheet's blurred image, and its blurred cover if it has one."""
    return [np.asarray(fft.irfft2(one * transfer, wide), np.float32) for one in spectra if one is not None]


def _seen(layers: Sequence[Sequence[Frame]], maps: Sequence[Array], shape: tuple[int, ...]) -> Frame:
    """Composite of layers, each interpolated through its map from pixels to fine samples."""
    light = np.zeros(shape, np.float32)
    for layer, M in zip(layers, maps, strict=True):
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        picture, *cover = (cv2.warpPerspective(one, M, shape[::-1], flags=flags) for one in layer)
        light = np.asarray(light * (1 - cover[0]) + picture if cover else picture, np.float32)
    return light


def _spectra(
    placed: PlacedSheet, projection: Projection, margin: int, wide: tuple[int, ...]
) -> tuple[Spectrum, Spectrum | None]:
    """Spectra of a sheet's covered image and of its cover, on fine samples."""
    to_sensor = np.array([[1 / OVERSAMPLING, 0, -margin], [0, 1 / OVERSAMPLING, -margin], [0, 0, 1]])
    M = np.linalg.inv(_drawn(placed, projection)) @ to_sensor

    def read(texels: Frame, border: int) -> Frame:
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        return np.asarray(cv2.warpPerspective(texels, M, wide[::-1], flags=flags, borderMode=border), dtype=np.float32)

    if placed.sheet.cover is None:
        return fft.rfft2(read(placed.sheet.reflectance, cv2.BORDER_REFLECT)), None
    picture = read(placed.sheet.reflectance * placed.sheet.cover, cv2.BORDER_CONSTANT)
    return fft.rfft2(picture), fft.rfft2(read(placed.sheet.cover, cv2.BORDER_CONSTANT))


def _transfer(optics: Optics, colour: str, wide: tuple[int, ...]) -> Spectrum:
    fy = OVERSAMPLING * fft.fftfreq(wide[0])[:, None]
    fx = OVERSAMPLING * fft.rfftfreq(wide[1])[None, :]
    return np.asarray(optics.otf(fx, fy, colour), dtype=np.complex64)


# --- Subjects of a simulated bench other than the chart ---

WALL_MM = (252.0, 190.0)
WALL_TEXEL_MM = 0.05
LARGEST_MM, PER_LEAF = 12.0, 100.0
"""Radius of the wall's largest leaves, the smallest being below a pixel from the near end of the rail; texels per leaf.
"""
WALL_NEAR_MM, WALL_F_NUMBER = 360.0, 16.0
"""Four times as far is well within the rail's travel. The lens is stopped down: its MTF is low beyond the near
photograph's Nyquist frequency, where detail would be folded back."""


SHAKE_HZ, SHAKE_MM = 10.0, 1.9
DIAGONAL_MM = SHAKE_MM / 1.5
ROLL_DEG, PAN_DEG = 0.5, 0.06
MOTIONS = (
    (
        *(SinusoidalDrive("x_mm", SHAKE_MM, SHAKE_HZ), SinusoidalDrive("y_mm", 0.5 * SHAKE_MM, 2 * SHAKE_HZ, 0.6)),
        *(SinusoidalDrive("roll_deg", ROLL_DEG, SHAKE_HZ, 0.4), SinusoidalDrive("pan_deg", PAN_DEG, SHAKE_HZ, 2.0)),
        SinusoidalDrive("tilt_deg", PAN_DEG, 2 * SHAKE_HZ, 1.0),
    ),
    (
        *(SinusoidalDrive("y_mm", SHAKE_MM, SHAKE_HZ), SinusoidalDrive("x_mm", 0.5 * SHAKE_MM, 2 * SHAKE_HZ, 1.1)),
        *(SinusoidalDrive("roll_deg", ROLL_DEG, SHAKE_HZ, 2.4), SinusoidalDrive("pan_deg", PAN_DEG, 2 * SHAKE_HZ, 0.3)),
        SinusoidalDrive("tilt_deg", PAN_DEG, SHAKE_HZ, 1.7),
    ),
    (
        *(SinusoidalDrive(axis, DIAGONAL_MM, SHAKE_HZ) for axis in ("x_mm", "y_mm")),
        *(
            SinusoidalDrive("x_mm", 0.5 * DIAGONAL_MM, 2 * SHAKE_HZ),
            SinusoidalDrive("y_mm", 0.5 * DIAGONAL_MM, 2 * SHAKE_HZ, np.pi),
        ),
        *(SinusoidalDrive("roll_deg", ROLL_DEG, SHAKE_HZ, 3.4), SinusoidalDrive("pan_deg", PAN_DEG, SHAKE_HZ, 0.9)),
        SinusoidalDrive("tilt_deg", PAN_DEG, 2 * SHAKE_HZ, 2.4),
    ),
)
"""Loops along x, along y and across both, while the rig nods and rolls: twice around in the lamp's exposure."""


@dataclass(frozen=True)
class Subject:
    """Sheets from back to front; none for the chart.

    `camera`: None for the bench's default. `f_number`: aperture of the lens. `slopes`: slopes of the sensor relative to
    the image, in um/mm. `motions`: vibrations of the rig; only these rotate its camera. `near_mm`: distance from the
    camera at the rail's near end; None for that of a chart.
    """

    sheets: tuple[FlatSheet, ...] = ()
    camera: SimulatedCamera | None = None
    f_number: float = NOMINAL_F_NUMBER
    motions: tuple[tuple[SinusoidalDrive, ...], ...] = ()
    slopes: tuple[float, float] = (0.0, 0.0)
    near_mm: float | None = None


def frame_camera() -> SimulatedCamera:
    """A monochrome camera whose frame is six charts wide and four high at the target s/t of the guide."""
    return SimulatedCamera(Lens(focal_length_mm=24.0), Sensor(rows=480, columns=640, cfa=None), pitch_um=11.88)


def wall(rng: np.random.Generator) -> Subject:
    """A flat wall with detail of all sizes, wider than the camera sees from the far end of the rail."""
    columns, rows = (round(size / WALL_TEXEL_MM) for size in WALL_MM)
    picture = leaves((rows, columns), rng, largest=LARGEST_MM / WALL_TEXEL_MM, per_leaf=PER_LEAF)
    return Subject((FlatSheet(picture, WALL_TEXEL_MM),), f_number=WALL_F_NUMBER, near_mm=WALL_NEAR_MM)


def depth(rng: np.random.Generator) -> Subject:
    """Three walls of leaves, one behind the other, before a rig that shakes: the nearest on the left, a round one."""
    back, middle, front = (
        FlatSheet(leaves((900, 1200), rng, largest=120.0, per_leaf=80.0), texel_mm) for texel_mm in (0.6, 0.45, 0.35)
    )
    x, y = (np.arange(n) - (n - 1) / 2 for n in (1200, 900))
    disc = np.hypot(0.45 * x - 60.0, 0.45 * y[:, None] + 40.0) < 45.0
    left = np.broadcast_to(0.35 * x < 10.0, (900, 1200))
    sheets = (
        replace(back, behind_mm=1050.0),
        replace(middle, cover=_cover(disc), behind_mm=350.0),
        replace(front, cover=_cover(left), behind_mm=-150.0),
    )
    return Subject(sheets, f_number=16.0, motions=MOTIONS)


PANEL_MM = 4000.0  # side of the light panel: it fills the frame from anywhere on the rail


def panel() -> Subject:
    """A uniform light panel."""
    return Subject((FlatSheet(np.ones((8, 8), dtype=np.float32), PANEL_MM / 8),))


EDGE_MM, EDGE_TEXEL_MM, EDGE_DEG = 40.0, 0.05, 5.0
"""Side of a dark square, whose edges are slanted, on a light sheet twice as wide; texels are smaller than pixels."""


def edge() -> Subject:
    """The slanted edges of a dark square."""
    side = EDGE_MM / EDGE_TEXEL_MM
    picture = np.full((round(2 * side), round(2 * side)), 0.8, np.float32)
    corners = cv2.boxPoints(((side, side), (side, side), EDGE_DEG))
    cv2.fillPoly(picture, [np.rint(corners).astype(np.int32)], 0.1)
    return Subject((FlatSheet(smooth(picture), EDGE_TEXEL_MM),))


TILT_F_NUMBER, TILT_SLOPES = 2.8, (9.0, -6.0)
"""f-number, and slopes in um/mm of a sensor that shall be squared to its lens: 68 um from side to side."""


def _cover(inside: npt.NDArray[np.bool_]) -> Frame:
    return smooth(inside.astype(np.float32))


SUBJECTS: Mapping[str, Callable[[np.random.Generator], Subject]] = {
    "chart": lambda rng: Subject(),
    "frame": lambda rng: Subject(camera=frame_camera()),
    "tilt": lambda rng: Subject(camera=frame_camera(), f_number=TILT_F_NUMBER, slopes=TILT_SLOPES),
    "wall": wall,
    "depth": depth,
    "panel": lambda rng: panel(),
    "edge": lambda rng: edge(),
}
"""Subjects by the names used in plans."""
