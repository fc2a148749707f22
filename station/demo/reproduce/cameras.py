"""The thesis's camera, simulated: photographs of the chart and of a wall, and their PSF.

Canon EOS 400D with a lens of 50 mm: pixels of 5.7 micrometres, a low-pass filter, photosites with a border. A green
plane of its mosaic is a grey sensor with twice the pitch, rendered in a quarter of the time; its filter and photosites
are half as wide in pixels of that plane.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from procedures.clipping import SensorModel
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternParameters, PatternPsf, estimate_psf
from procedures.raw import Plane
from simulators.camera.camera import Lens, Photograph, SimulatedCamera
from simulators.camera.optics import CircularPupil, FourSpots, LShapedAperture, Optics, PixelAperture
from simulators.camera.sensor import Sensor
from simulators.camera.sheets import FlatSheet, PlacedSheet, draw, leaves
from simulators.world.projection import ObjectPose
from simulators.world.scene import Illumination, Scene
from station.demo.reproduce.figures import Curve, curves

Array = npt.NDArray[np.float64]

PITCH_UM = 5.7
FILTER_PX = 0.8
PHOTOSITE_PX = 0.95
S = 4
FREQUENCIES: Array = np.linspace(0, S / 2, 101)
"""Cycles per pixel of the plane."""
WHITE_E = 20000.0
"""Electrons of white: noise of 0.7 %."""
WALL_TEXEL_MM = 0.1
EVEN = Illumination()


def optics(f_number: float) -> Optics:
    """Blurs of a green plane, whose pixel is two of the sensor wide."""
    blurs = (CircularPupil(f_number), PixelAperture(PHOTOSITE_PX / 2, PHOTOSITE_PX / 2), FourSpots(FILTER_PX / 2))
    return Optics(blurs, 2 * PITCH_UM)


def _sensor(rows: int, columns: int, cfa: str | None) -> Sensor:
    return Sensor(rows, columns, cfa, full_well_e=1.5 * WHITE_E, gain_e_per_dn=2.0)


def green_camera(f_number: float = 5.6, side: int = 160, **lens: float) -> SimulatedCamera:
    """A grey camera equivalent to one green plane, side x side pixels; `lens` are aberrations of `Lens`."""
    return SimulatedCamera(
        Lens(f_number=f_number, **lens),  # type: ignore[arg-type]
        _sensor(side, side, None),
        2 * PITCH_UM,
        optics(f_number),
        white_e_per_s=50 * WHITE_E,
    )


def mosaic_camera() -> SimulatedCamera:
    """The whole mosaic, with photosites that lack a corner, another one in red and blue than in green."""
    blurs = (CircularPupil(5.6), LShapedAperture(), FourSpots(FILTER_PX))
    sensor = _sensor(320, 320, "RGGB")
    return replace(green_camera(), sensor=sensor, pitch_um=PITCH_UM, optics=Optics(blurs, PITCH_UM))


def exposure_s(camera: SimulatedCamera) -> float:
    """Exposure at which white has WHITE_E electrons."""
    return 0.02 * (camera.lens.f_number / 5.6) ** 2


def photograph_chart(
    camera: SimulatedCamera, chart: Chart, seed: int, *, pixels: float = 100.0, light: Illumination = EVEN,
    **placed: float,
) -> Photograph:  # fmt: skip
    """The chart with its noise region `pixels` pixels of a plane wide; `placed` are `at` and angles."""
    where = camera.place(chart, pixels=pixels, **placed)  # type: ignore[arg-type]
    return camera.photograph(Scene((where,), light=light), np.random.default_rng(seed), exposure_s=exposure_s(camera))


def plane_of(photograph: Photograph, name: str = "Y") -> Plane:
    """One plane as a RAW reader returns it."""
    sensor = photograph.sensor
    step = 1 / (sensor.white - min(sensor.black))
    return Plane(name, photograph.plane(name).astype(np.float32), step, photograph.pitch)


def photograph_wall(camera: SimulatedCamera, distance_mm: float, seed: int) -> Plane:
    """A wall of dead leaves, frontal, in focus."""
    side = camera.sensor.rows
    wall = leaves((WALL_TEXELS, WALL_TEXELS), np.random.default_rng(5), largest=300.0)
    placed = PlacedSheet(
        FlatSheet(wall, WALL_TEXEL_MM), ObjectPose((0.0, 0.0, distance_mm), roll_deg=0.7), camera.sharp_optics()
    )
    light = draw((placed,), camera.projection(distance_mm), (side, side), {(0, 0): "Y"})
    rng = np.random.default_rng(seed)
    return plane_of(camera.photograph(Scene(), rng, exposure_s=exposure_s(camera), light=light))


WALL_TEXELS = 3000


def wall_pair(camera_of: Callable[[int], SimulatedCamera], ratio: float) -> tuple[Plane, Plane]:
    """Near and far photographs of one wall at distances of that ratio; `camera_of` gives the camera for a side."""
    near_mm, far_side = 900.0, 150
    near = photograph_wall(camera_of(round(far_side * ratio) + 30), near_mm, 1)
    return near, photograph_wall(camera_of(far_side), near_mm * ratio, 2)


def estimated(
    plane: Plane, chart: Chart, s: int = S, k: int = 17, solver: str = "ls", sensor: SensorModel | None = None
) -> PatternPsf:
    """The PSF from a photograph of the chart. Raises Refused if there is none."""
    return estimate_psf(plane, chart, PatternParameters(s=s, k=k, solver=solver), sensor=sensor).result()


def spectrum(h: Array, s: int, fx: npt.ArrayLike, fy: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """Transfer function of the support (k, k), s samples per pixel, at n frequencies in cycles per pixel."""
    x = (np.arange(len(h)) - len(h) // 2) / s
    across = np.exp(-2j * np.pi * np.multiply.outer(np.atleast_1d(fx), x))
    down = np.exp(-2j * np.pi * np.multiply.outer(np.atleast_1d(fy), x))
    return np.asarray(np.einsum("fi,ij,fj->f", down, h, across))


def mtf_across(h: Array) -> Array:
    """Modulus along rows, 1 at zero."""
    return np.asarray(np.abs(spectrum(h, S, FREQUENCIES, 0 * FREQUENCIES)) / h.sum())


def mtf_down(h: Array, s: int = S) -> Array:
    """Modulus along columns, 1 at zero."""
    return np.asarray(np.abs(spectrum(h, s, 0 * FREQUENCIES, FREQUENCIES)) / h.sum())


def mtf_down_uncertainty(h: Array, covariance: Array) -> Array:
    """Standard uncertainty of `mtf_down`, by the covariance (k^2, k^2) of the samples."""
    rows = np.repeat((np.arange(len(h)) - len(h) // 2) / S, len(h))
    waves = np.exp(-2j * np.pi * np.multiply.outer(FREQUENCIES, rows))
    of_h = waves @ h.ravel()
    mtf = np.abs(of_h)
    slopes = ((waves * (of_h.conj() / mtf)[:, None]).real - mtf[:, None] / h.sum()) / h.sum()
    variance = np.einsum("fi,ij,fj->f", slopes, covariance, slopes, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))  # at 0 it is 0 but for rounding


def mtf_curves(name: str, direction: str, mtfs: Mapping[str, Array], true: Array | None = None) -> Markup:
    """MTFs over `FREQUENCIES` in one plot."""
    drawn = [Curve(label, FREQUENCIES, mtf) for label, mtf in mtfs.items()]
    published = None if true is None else Curve("true", FREQUENCIES, true)
    return curves(name, drawn, x="cycles per pixel of the plane", y=f"MTF, {direction}", published=published)
