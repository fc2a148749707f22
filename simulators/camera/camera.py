"""A camera of lens, optics, sensor and shutter; it writes a DNG and records the ground truth."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt

from drivers.dng import Shot, write_dng
from procedures.pattern import CELLS, Chart
from simulators.camera.optics import WAVELENGTHS_UM, ColourShift, Optics
from simulators.camera.pupil import Wavefront, defocus_um
from simulators.camera.render import IdealImage, render_frame
from simulators.camera.sensor import Mosaic, Sensor
from simulators.world.projection import ObjectPose, Placed, Projection, apply_homography, image_distance_mm
from simulators.world.scene import Illumination, PlacedChart, Scene

PERIOD_PX = 160
"""Pixels of the plane after which the sampled PSF repeats; the tail of Airy's disc beyond weighs less than 1e-7."""


@dataclass(frozen=True, eq=False)
class TruePsf:
    """The PSF of one plane, low-passed to s / 2 cycles per pixel: the part resolved by an estimate on the 1/s grid.

    samples : (k, k) samples [row, column], pitch 1/s pixel of the plane, centre sample at the geometric centre, scaled
        so that the sum over the whole plane is 1
    s : int, samples per pixel
    energy_outside : float, 1 minus the sum of the samples inside the support
    floor : float, relative norm of the part outside the support: a lower bound of the error of k x k samples
    """

    samples: Array
    s: int
    energy_outside: float
    floor: float

    @property
    def h(self) -> Array:
        """Samples normalised to sum 1 as those of an estimate, (k, k)."""
        return np.asarray(self.samples / self.samples.sum(), dtype=np.float64)


def true_psf(optics: Optics, s: int, k: int, *, colour: str = "Y", pitch: int = 1) -> TruePsf:
    """The PSF of a plane, s samples per pixel, k x k of them.

    pitch : int, sensor pixels per pixel of the plane: 2 for a Bayer plane
    """
    n = s * PERIOD_PX
    f = np.fft.fftfreq(n) * s / pitch  # cycles per sensor pixel
    otf = np.asarray(optics.otf(f[None, :], f[:, None], colour), dtype=np.complex128)
    whole = np.fft.fftshift(np.fft.ifft2(otf).real)
    low = n // 2 - k // 2
    inside = whole[low : low + k, low : low + k]
    energy, power = float(inside.sum()), float(np.sum(inside**2))
    floor = max(1 - power / float(np.sum(whole**2)), 0.0) ** 0.5
    return TruePsf(inside, s, 1 - energy, floor)


def true_mtf(optics: Optics, frequency: Array, angle_deg: float, *, colour: str = "Y", pitch: int = 1) -> Array:
    """Modulus of the transfer function along a direction, at frequencies in cycles per pixel of the plane."""
    f = np.asarray(frequency, dtype=np.float64) / pitch
    turn = np.radians(angle_deg)
    return np.asarray(np.abs(optics.otf(f * np.cos(turn), f * np.sin(turn), colour)), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class ChartTruth:
    """Position and optics of a chart in an image.

    H_sensor_pattern : (3, 3) pattern coordinates (cells) to sensor pixels, before distortion
    projection : Projection, holds the distortion
    optics : Optics, blur, centred on the chart's points in the given colour
    colour_shift : ColourShift, shift of colours other than green
    """

    H_sensor_pattern: Array
    projection: Projection
    optics: Optics
    colour_shift: ColourShift = field(default_factory=ColourShift)

    def sensor_points(self, cells: Array, colour: str = "G") -> Array:
        """Pattern points (n, 2) to sensor pixels (x, y) in a colour, distortion included, (n, 2)."""
        points = apply_homography(self.H_sensor_pattern, np.asarray(cells, dtype=np.float64))
        return np.asarray(self.projection.distort(points) + self.colour_shift.at(WAVELENGTHS_UM[colour]))

    def psf(self, s: int, k: int, *, colour: str = "Y", pitch: int = 1) -> TruePsf:
        return true_psf(self.optics, s, k, colour=colour, pitch=pitch)


Array = npt.NDArray[np.float64]

NOMINAL_F_NUMBER = 5.6


@dataclass(frozen=True)
class Lens:
    """A thin lens with radial distortion and third-order aberrations.

    k1, k2 : float, distortion at half the frame's diagonal; see `Projection`
    spherical_um, coma_um, astigmatism_um, field_curvature_um : float
        Root mean square path differences: the first everywhere, the others at half the frame's diagonal. As in
        Seidel's theory coma grows linearly with the distance from the axis, the last two with its square.
    axis : (float, float) intersection of the lens's axis of symmetry with the sensor, (x, y) from the frame's centre in
        half diagonals. Aberrations and lateral colour are centred on it, distortion on the frame's centre.
    tilt_um : (float, float)
        A tilted sensor: defocus, as root mean square path difference, per half diagonal along x and y.
    defocus_um : float, a sensor away from the image, in the same measure
    lateral_colour : float, relative growth of the image per micrometre of wavelength, 1 in green
    vignetting : (float, float, float) light about the lens's axis is 1 + k1 q^2 + k2 q^4 + k3 q^6, q in half diagonals
    noted : bool, whether the camera records aperture and focal length
    """

    focal_length_mm: float = 50.0
    f_number: float = NOMINAL_F_NUMBER
    k1: float = 0.0
    k2: float = 0.0
    spherical_um: float = 0.0
    coma_um: float = 0.0
    astigmatism_um: float = 0.0
    field_curvature_um: float = 0.0
    axis: tuple[float, float] = (0.0, 0.0)
    tilt_um: tuple[float, float] = (0.0, 0.0)
    defocus_um: float = 0.0
    lateral_colour: float = 0.0
    vignetting: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noted: bool = True

    def wavefront(self, x: float, y: float) -> Wavefront:
        """Aberrations at a place in the frame, (x, y) from its centre in half diagonals."""
        sensor_um = self.defocus_um + self.tilt_um[0] * x + self.tilt_um[1] * y
        x, y = x - self.axis[0], y - self.axis[1]
        q2, coma, stretch = x * x + y * y, self.coma_um, self.astigmatism_um
        return Wavefront(
            defocus_um=self.field_curvature_um * q2 + sensor_um, astigmatism_um=stretch * (x * x - y * y),
            oblique_astigmatism_um=stretch * 2 * x * y, coma_y_um=coma * y, coma_x_um=coma * x,
            spherical_um=self.spherical_um,
        )  # fmt: skip

    def falloff(self, shape: tuple[int, int]) -> npt.NDArray[np.float32]:
        """Illumination of the frame by a uniform scene, (rows, columns), 1 on the optical axis."""
        (rows, columns), (k1, k2, k3) = shape, self.vignetting
        radius = math.hypot(rows, columns) / 2
        x, y = ((np.arange(size) - (size - 1) / 2) / radius for size in (columns, rows))
        q2 = (x - self.axis[0]) ** 2 + (y[:, None] - self.axis[1]) ** 2
        return (1 + q2 * (k1 + q2 * (k2 + q2 * k3))).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Photograph:
    """One exposure: digital numbers, file, and ground truth.

    mosaic : (rows, columns) uint16, the digital numbers, as in the file
    truths : tuple of ChartTruth, ground truth of each chart of the scene, in its order
    """

    mosaic: Mosaic
    sensor: Sensor
    truths: tuple[ChartTruth, ...]
    path: Path | None = None

    def plane(self, name: str) -> Array:
        """One plane, black level subtracted, saturation at 1."""
        x, y = self.sensor.planes[name]
        step = self.pitch
        return self.sensor.linear(self.mosaic)[y::step, x::step]

    @property
    def pitch(self) -> int:
        """Sensor pixels per pixel of a plane."""
        return 1 if self.sensor.cfa is None else 2

    def true_psf(self, plane: str, s: int, k: int, chart: int = 0) -> TruePsf:
        """The PSF that an estimate from this plane and chart should find."""
        return self.truths[chart].psf(s, k, colour=plane[0], pitch=self.pitch)

    def true_otf(self, plane: str, fx: Array, fy: Array, chart: int = 0) -> npt.NDArray[np.complex128]:
        """The whole transfer function of the optics before a chart, at frequencies in cycles per pixel of a plane."""
        optics, colour = self.truths[chart].optics, plane[0]
        return np.asarray(optics.otf(fx / self.pitch, fy / self.pitch, colour), dtype=np.complex128)

    def true_points(self, plane: str, cells: Array, chart: int = 0) -> Array:
        """Images (n, 2) of pattern points (n, 2) in a plane, (x, y) in its pixels."""
        offset = np.array(self.sensor.planes[plane], dtype=np.float64)
        return (self.truths[chart].sensor_points(cells, plane[0]) - offset) / self.pitch

    def pixels_per_pattern(self, plane: str, chart: int = 0) -> float:
        """Side of the noise region in pixels of a plane: the root of its area."""
        corners = self.true_points(plane, np.array([[0, 0], [CELLS, 0], [CELLS, CELLS], [0, CELLS]]), chart)
        x, y = corners.T
        twice_area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
        return math.sqrt(abs(twice_area) / 2)


@dataclass(frozen=True)
class SimulatedCamera:
    """A camera of the simulated bench.

    optics : Optics or None, blur; None: diffraction at the lens's aperture, and the photosites
    white_e_per_s : float, electrons per second of a perfect white in full light at f/5.6, in green
    oversampling : int, fine samples per sensor pixel around a chart; None: as many as the optics require
    focus_mm : float or None, distance in focus; None focuses on the first chart of the scene
    """

    lens: Lens = field(default_factory=Lens)
    sensor: Sensor = field(default_factory=Sensor)
    pitch_um: float = 3.76
    optics: Optics | None = None
    white_e_per_s: float = 1.5e6
    oversampling: int | None = None
    focus_mm: float | None = None
    shot: Shot = field(default_factory=Shot)

    def __post_init__(self) -> None:
        if self.optics is not None and self.optics.pitch_um != self.pitch_um:
            raise ValueError(f"optics are for a pitch of {self.optics.pitch_um} um, the sensor has {self.pitch_um}")

    @property
    def plane_pitch_px(self) -> int:
        """Sensor pixels per pixel of a plane."""
        return 1 if self.sensor.cfa is None else 2

    def projection(self, focus_mm: float) -> Projection:
        """Projection of the camera focused at a distance."""
        rows, columns = self.sensor.rows, self.sensor.columns
        principal = 1000 * image_distance_mm(self.lens.focal_length_mm, focus_mm) / self.pitch_um
        centre = (columns - 1) / 2, (rows - 1) / 2
        return Projection(principal, centre, self.lens.k1, self.lens.k2, np.hypot(rows, columns) / 2)

    def place(
        self, chart: Chart, *, pixels: float, at: tuple[float, float] = (0.5, 0.5), cell_mm: float = 300 / 320,
        yaw_deg: float = 0.0, pitch_deg: float = 0.0, roll_deg: float = 0.0,
    ) -> PlacedChart:  # fmt: skip
        """A chart whose noise region is `pixels` wide in a plane, when it is frontal and in focus.

        at : (x, y) image of its centre without distortion, in fractions of the frame from the top left
        """
        f, pitch_mm = self.lens.focal_length_mm, self.pitch_um / 1000
        sensor_px_per_cell = pixels * self.plane_pitch_px / CELLS
        distance = f * (1 + cell_mm / (sensor_px_per_cell * pitch_mm))
        principal = self.projection(distance).principal_px
        x, y = (
            (fraction - 0.5) * size * distance / principal
            for fraction, size in zip(at, (self.sensor.columns, self.sensor.rows), strict=True)
        )
        return PlacedChart(chart, ObjectPose((x, y, distance), yaw_deg, pitch_deg, roll_deg), cell_mm)

    def photograph(
        self, scene: Scene, rng: np.random.Generator, path: Path | None = None, *, exposure_s: float = 0.02,
        iso: int = 100, bits: int = 16, captured_at: datetime | None = None,
        light: npt.NDArray[np.floating] | None = None,
    ) -> Photograph:  # fmt: skip
        """Expose once; write a DNG where `path` is given.

        bits : int, width of a number in the file, not less than the sensor's bits
        light : (rows, columns) result of `light` for this scene, if many photographs of it are taken
        """
        focus = self.focused_at(scene)
        projection = self.projection(focus)
        aperture = (NOMINAL_F_NUMBER / self.lens.f_number) ** 2
        sensor = self.sensor.at_iso(iso)
        irradiance = self.light(scene) if light is None else light
        if any(self.lens.vignetting):
            irradiance = irradiance * self.lens.falloff((sensor.rows, sensor.columns))
        mosaic = sensor.expose(irradiance, self.white_e_per_s * exposure_s * aperture, rng)
        truths = tuple(
            ChartTruth(
                projection.pinhole() @ chart.to_space(),
                projection,
                self.optics_at(chart, focus),
                self.colour_shift_at(chart, focus),
            )
            for chart in scene.charts
        )
        if path is not None:
            shot = self._noted(exposure_s, iso, focus, captured_at, truths)
            write_dng(path, mosaic, shot, cfa=sensor.cfa, black=sensor.black, white=sensor.white, bits=bits)
        return Photograph(mosaic, sensor, truths, path)

    def light(self, scene: Scene) -> npt.NDArray[np.floating]:
        """Light on the photosites, (rows, columns), 1 for a perfect white in full light."""
        focus = self.focused_at(scene)
        return render_frame(
            IdealImage.of(scene, self.projection(focus)),
            lambda placed: self._drawn_optics(placed, focus),
            (self.sensor.rows, self.sensor.columns),
            self.sensor.tile,
            oversampling=self.oversampling or self.sharp_optics().fine_samples(self.sensor.tile.values()),
        )

    def photograph_chart(
        self, chart: Chart, rng: np.random.Generator, path: Path | None = None, *, s_over_t: float, s: int = 4,
        at: tuple[float, float] = (0.5, 0.5), exposure_s: float = 0.02,
    ) -> Photograph:  # fmt: skip
        """One exposure of a frontal chart whose size gives this s/t at s samples per pixel."""
        placed = self.place(chart, pixels=pixels_at(s_over_t, s), at=at)
        return self.photograph(Scene((placed,)), rng, path, exposure_s=exposure_s)

    def light_on(self, placed: PlacedChart, slope: tuple[float, float]) -> Illumination:
        """Light that changes by `slope` from a chart's centre to the sides of its noise region; see `Light`."""
        projection = self.projection(placed.pose.centre_mm[2])
        x, y = apply_homography(projection.pinhole() @ placed.to_space(), np.full((1, 2), CELLS / 2))[0]
        half = CELLS / 2 * placed.cell_mm * projection.principal_px / placed.pose.centre_mm[2]
        return Illumination(slope=slope, centre_px=(float(x), float(y)), radius_px=half)

    def focused_at(self, scene: Scene) -> float:
        """Distance in focus, in mm."""
        if self.focus_mm is not None:
            return self.focus_mm
        return scene.charts[0].pose.centre_mm[2] if scene.charts else scene.wall.distance_mm

    def optics_at(self, placed: Placed, focus_mm: float) -> Optics:
        """Blur of a flat object: the camera's optics, local aberrations, and defocus at its centre."""
        f, z = self.lens.focal_length_mm, placed.pose.centre_mm[2]
        shift = image_distance_mm(f, focus_mm) - image_distance_mm(f, z)
        wavefront = self.lens.wavefront(*self._field(placed, focus_mm))
        return self.sharp_optics().aberrated(wavefront + Wavefront(defocus_um(shift, self.lens.f_number)))

    def colour_shift_at(self, placed: PlacedChart, focus_mm: float) -> ColourShift:
        """Lateral colour at a chart's centre, used for the whole chart, as the aberrations are."""
        per_um = self.lens.lateral_colour * self.projection(focus_mm).radius_px
        x, y = (q - c for q, c in zip(self._field(placed, focus_mm), self.lens.axis, strict=True))
        return ColourShift((per_um * x, per_um * y))

    def _field(self, placed: Placed, focus_mm: float) -> tuple[float, float]:
        """Position of a chart's centre without distortion, (x, y) from the frame's centre in half diagonals."""
        projection = self.projection(focus_mm)
        x, y, z = placed.pose.centre_mm
        reach = projection.principal_px / projection.radius_px / z
        return reach * x, reach * y

    def _drawn_optics(self, placed: PlacedChart | None, focus_mm: float) -> Optics:
        """Blur and shift of a chart, or of the wall."""
        if placed is None:
            return self.sharp_optics()
        shift = self.colour_shift_at(placed, focus_mm)
        optics = self.optics_at(placed, focus_mm)
        return optics.also(shift) if any(shift.px_per_um) else optics

    def sharp_optics(self) -> Optics:
        """Blur of an object in focus on the axis; `replace(camera, optics=...)` adds motion to it."""
        return self.optics or Optics.typical(f_number=self.lens.f_number, pitch_um=self.pitch_um)

    def _noted(
        self, exposure_s: float, iso: int, focus_mm: float, at: datetime | None, truths: tuple[ChartTruth, ...]
    ) -> Shot:
        """The camera's metadata of an exposure, with the true positions of the charts in the comment."""
        maps = [truth.H_sensor_pattern.tolist() for truth in truths]
        return replace(
            self.shot,
            exposure_s=exposure_s,
            iso=iso,
            f_number=self.lens.f_number if self.lens.noted else None,
            focal_length_mm=self.lens.focal_length_mm if self.lens.noted else None,
            subject_distance_mm=focus_mm,
            captured_at=at or self.shot.captured_at,
            comment=json.dumps({"H_sensor_pattern": maps}),
        )


def render_plane(scene: Scene, camera: SimulatedCamera, rng: np.random.Generator, exposure_s: float = 0.02) -> Array:
    """One grey plane of a camera without a mosaic: black level subtracted, saturation at 1, (rows, columns)."""
    return camera.photograph(scene, rng, exposure_s=exposure_s).plane("Y")


def pixels_at(s_over_t: float, s: int = 4) -> float:
    """Width of the noise region in pixels of a plane at which its t cells per pixel give this s / t."""
    return s_over_t * CELLS / s
