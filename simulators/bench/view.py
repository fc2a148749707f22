"""View of the bench's camera: chart or sheets, with the blur of the camera's motion during the exposure."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath

import numpy as np
from scipy.spatial.transform import Rotation

from procedures.pattern import Chart
from simulators.bench.body import Opening
from simulators.camera.camera import ChartTruth, Lens, Photograph, SimulatedCamera
from simulators.camera.optics import Optics, Path
from simulators.camera.pupil import defocus_um
from simulators.camera.sensor import Sensor
from simulators.camera.sheets import FlatSheet, Frame, PlacedSheet, draw, draw_moving
from simulators.world.projection import ObjectPose as ChartPose
from simulators.world.projection import Projection
from simulators.world.scene import Illumination, PlacedChart, Scene, Wall
from simulators.world.world import Array, CameraPoses, World

INSTANTS_PER_S = 480  # samples modes up to 60 Hz eight times per period
MIN_INSTANTS, MAX_INSTANTS = 8, 96
NEGLIGIBLE_PX = 0.01
NEGLIGIBLE_DEG = 0.05


def bench_camera() -> SimulatedCamera:
    """A small sensor behind 24 mm: half to one and a half sensor pixels per 0.3 mm cell over the bench's rail."""
    return SimulatedCamera(Lens(focal_length_mm=24.0), Sensor(rows=480, columns=640), pitch_um=5.94)


def instants(opening: Opening) -> Array:
    """Times, equally spaced over an exposure, at which the camera's path is sampled."""
    count = min(max(round(INSTANTS_PER_S * opening.exposure_s), MIN_INSTANTS), MAX_INSTANTS)
    return np.asarray(opening.begin_s + opening.exposure_s * (np.arange(count) + 0.5) / count)


@dataclass(frozen=True)
class Mount:
    """Mounting of the chart: offset from the middle of the stage's travel, and rotation as in `projection.Pose`."""

    right_mm: float = 0.0
    down_mm: float = 0.0
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    def turn(self) -> Rotation:
        """Rotation relative to a chart that hangs straight."""
        return Rotation.from_euler("ZYX", [self.roll_deg, self.yaw_deg, self.pitch_deg], degrees=True)


@dataclass(frozen=True)
class SensorMount:
    """The sensor's tilt and the screws that hold it, equally spaced around its centre.

    slopes : (x, y) slope of the sensor relative to the image of a chart square to the lens, in um/mm, right and down in
        the photograph
    offset_um : float, distance of its centre from its first place, away from the lens
    count, radius_mm, pitch_mm, first_deg
        Of the screws: number, radius, pitch, and angle of the first, clockwise from the top as seen from behind the
        camera.
    """

    slopes: tuple[float, float] = (0.0, 0.0)
    offset_um: float = 0.0
    count: int = 3
    radius_mm: float = 12.0
    pitch_mm: float = 0.35
    first_deg: float = 30.0

    def turned(self, turns: Sequence[float]) -> "SensorMount":
        """The mount after turns of the screws, each of which moves its position away from the lens by the pitch.

        Seen from behind the camera, a screw on the right is at the left of the photograph, one at the top at its lower
        edge.
        """
        angles = np.radians(self.first_deg + 360 * np.arange(self.count) / self.count)
        at = self.radius_mm * np.column_stack([-np.sin(angles), np.cos(angles)])
        moved = np.linalg.lstsq(np.column_stack([np.ones(self.count), at]), 1000 * self.pitch_mm * np.array(turns))[0]
        offset, right, down = (float(one) for one in moved)
        slopes = self.slopes[0] + right, self.slopes[1] + down
        return replace(self, slopes=slopes, offset_um=self.offset_um + offset)

    def tilt_um(self, camera: SimulatedCamera) -> tuple[float, float]:
        """The slopes as defocus per half diagonal."""
        half_mm = np.hypot(camera.sensor.rows, camera.sensor.columns) * camera.pitch_um / 2000
        x, y = (defocus_um(slope * half_mm / 1000, camera.lens.f_number) for slope in self.slopes)
        return x, y


def mean_pose(centres: Array, turns: Rotation) -> ChartPose:
    """Mean pose of a flat object, from its centre and rotation at each instant of an exposure."""
    x, y, z = (float(value) for value in centres.mean(axis=0))
    roll, yaw, pitch = (float(angle) for angle in turns.mean().as_euler("ZYX", degrees=True))
    return ChartPose((x, y, z), yaw, pitch, roll)


def turning(pose: CameraPoses) -> bool:
    """Whether the camera rotates so much that the blur varies over the frame."""
    return max(float(np.ptp(angle)) for angle in (pose.pan_deg, pose.tilt_deg, pose.roll_deg)) > NEGLIGIBLE_DEG


@dataclass
class View:
    """The camera in front of a chart, or of sheets, in the middle of the stage's travel.

    focus_mm : fixed focus, which drifts by `focus_drift_mm_per_c`; None focuses on the chart before each exposure
    mount : position of the chart; None for no chart
    sheets : evenly lit sheets instead of the chart, from back to front; the truths of a photograph are then in texels
    slope : relative change of the illumination from the chart's centre to its edges
    held : mounting of the sensor

    The noise of a frame depends only on the seed of `rng` and the opening's number.
    """

    world: World
    rng: np.random.Generator
    camera: SimulatedCamera = field(default_factory=bench_camera)
    chart: Chart = field(default_factory=Chart.from_seed)
    cell_mm: float = 0.3
    focus_mm: float | None = None
    focus_drift_mm_per_c: float = -1.5
    mount: Mount | None = field(default_factory=Mount)
    slope: tuple[float, float] = (0.0, 0.0)
    sheets: tuple[FlatSheet, ...] = ()
    held: SensorMount = field(default_factory=SensorMount)
    taken: list[Photograph] = field(default_factory=list)

    def chart_pose(self, pose: CameraPoses, behind_mm: float = 0.0) -> tuple[Array, Rotation]:
        """Centre, (n, 3) mm, and rotation of the chart or a sheet at each instant, in the camera's frame."""
        mount = self.mount or Mount()
        middle = {name: (low + high) / 2 for name, (low, high) in self.world.room.travel.items()}
        right, down = middle["x_mm"] - pose.x_mm + mount.right_mm, pose.y_mm - middle["y_mm"] + mount.down_mm
        offset = np.column_stack([right, down, pose.z_mm + behind_mm])
        turned = pose.turn.inv()
        return np.asarray(turned.apply(offset)), turned * mount.turn()

    def photograph(self, opening: Opening, path: FilePath | None = None) -> Photograph:
        """Expose once, with the motion of the chart's image as part of the blur."""
        taken = (
            self._sheets_photograph(opening, path)
            if self.sheets and self.mount
            else self._chart_photograph(opening, path)
        )
        self.taken.append(taken)
        return taken

    def _chart_photograph(self, opening: Opening, path: FilePath | None) -> Photograph:
        centres, turns = self.chart_pose(self.world.pose(instants(opening)))
        centre = centres.mean(axis=0)
        placed = PlacedChart(self.chart, mean_pose(centres, turns), self.cell_mm)
        middle_s = opening.begin_s + opening.exposure_s / 2
        light = Illumination(self.world.lamp(middle_s)) if self.mount is None else self._light(placed, middle_s)
        scene = Scene((placed,) if self.mount else (), Wall(centre[2] + 500.0), light)
        focus_mm = self._focus_mm(middle_s, float(centre[2]))
        lens, held = self.camera.lens, self.held
        off_um = defocus_um(held.offset_um / 1000, lens.f_number)
        lens = replace(lens, tilt_um=held.tilt_um(self.camera), defocus_um=off_um)
        camera = replace(self.camera, lens=lens, focus_mm=focus_mm, optics=self._optics(centres, focus_mm))
        return camera.photograph(scene, self._noise(opening.number), path, exposure_s=opening.exposure_s)

    def _sheets_photograph(self, opening: Opening, path: FilePath | None) -> Photograph:
        pose, middle_s = self.world.pose(instants(opening)), opening.begin_s + opening.exposure_s / 2
        camera = replace(self.camera, focus_mm=self._focus_mm(middle_s, float(pose.z_mm.mean())))
        placed = [self._placed(sheet, pose, camera) for sheet in self.sheets]
        sensor, projection = camera.sensor, camera.projection(camera.focused_at(Scene()))
        drawn = self._drawn(placed, pose, projection, (sensor.rows, sensor.columns), sensor.tile)
        light = self.world.lamp(middle_s) * drawn
        rng = self._noise(opening.number)
        taken = camera.photograph(Scene(), rng, path, exposure_s=opening.exposure_s, light=light)
        truths = (ChartTruth(projection.pinhole() @ one.to_space(), projection, one.optics) for one in placed)
        return replace(taken, truths=tuple(truths))

    def _placed(self, sheet: FlatSheet, pose: CameraPoses, camera: SimulatedCamera) -> PlacedSheet:
        """Mean pose of a sheet, and its blur by optics, defocus and motion.

        If the camera rotates, the motion varies over the frame and is drawn instant by instant instead.
        """
        centres, turns = self.chart_pose(pose, sheet.behind_mm)
        focus_mm = camera.focused_at(Scene())
        path = centres.mean(axis=0)[None] if turning(pose) else centres
        placed = PlacedSheet(sheet, mean_pose(centres, turns), self._optics(path, focus_mm))
        return replace(placed, optics=replace(camera, optics=placed.optics).optics_at(placed, focus_mm))

    def _drawn(
        self, placed: Sequence[PlacedSheet], pose: CameraPoses, projection: Projection, shape: tuple[int, int],
        tile: Mapping[tuple[int, int], str],
    ) -> Frame:  # fmt: skip
        if not turning(pose):
            return draw(placed, projection, shape, tile)
        poses = [self.chart_pose(pose, one.sheet.behind_mm) for one in placed]
        instants = [[mean_pose(centres[k : k + 1], turns[k : k + 1]) for centres, turns in poses]
                    for k in range(pose.x_mm.size)]  # fmt: skip
        return draw_moving(placed, instants, projection, shape, tile)

    def _noise(self, number: int) -> np.random.Generator:
        seed = self.rng.bit_generator.seed_seq
        assert isinstance(seed, np.random.SeedSequence)
        return np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, number)))

    def _light(self, placed: PlacedChart, t_s: float) -> Illumination:
        return replace(self.camera.light_on(placed, self.slope), level=self.world.lamp(t_s))

    def _focus_mm(self, t_s: float, distance_mm: float) -> float:
        if self.focus_mm is None:
            return distance_mm
        return self.focus_mm + self.focus_drift_mm_per_c * (self.world.temperature_c(t_s) - self.world.room.ambient_c)

    def _optics(self, centres: Array, focus_mm: float) -> Optics:
        """The camera's optics with the movement of the chart's image during the exposure."""
        sharp = self.camera.optics or Optics.typical(f_number=self.camera.lens.f_number, pitch_um=self.camera.pitch_um)
        image = self.camera.projection(focus_mm).principal_px * centres[:, :2] / centres[:, 2:]
        path = image - image.mean(axis=0)
        if np.abs(path).max() < NEGLIGIBLE_PX:
            return sharp
        return sharp.also(Path(tuple((float(x), float(y)) for x, y in path)))

    def develop(self, opening: Opening) -> bytes:
        """The bytes of the DNG of one opening."""
        with tempfile.TemporaryDirectory() as folder:
            path = FilePath(folder) / "frame.dng"
            self.photograph(opening, path)
            return path.read_bytes()
