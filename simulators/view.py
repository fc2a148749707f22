"""What the bench's camera photographs: the chart from where the camera is, blurred by the path it took meanwhile."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath

import numpy as np
from scipy.spatial.transform import Rotation

from procedures.pattern import Chart
from simulators.body import Opening
from simulators.camera import Lens, Photograph, SimulatedCamera
from simulators.optics import Optics, Path
from simulators.projection import Pose as ChartPose
from simulators.scene import Light, PlacedChart, Scene, Wall
from simulators.sensor import Sensor
from simulators.world import Array, Pose, World

INSTANTS_PER_S = 480  # of an exposure: modes up to 60 Hz are met eight times a period
FEWEST, MOST = 8, 96
NEGLIGIBLE_PX = 0.01


def bench_camera() -> SimulatedCamera:
    """A small sensor behind 24 mm: half to one and a half sensor pixels per 0.3 mm cell over the bench's rail."""
    return SimulatedCamera(Lens(focal_length_mm=24.0), Sensor(rows=480, columns=640), pitch_um=5.94)


def instants(opening: Opening) -> Array:
    """Times, equally spaced over an exposure, at which the camera's path is looked at."""
    count = min(max(round(INSTANTS_PER_S * opening.exposure_s), FEWEST), MOST)
    return np.asarray(opening.begin_s + opening.exposure_s * (np.arange(count) + 0.5) / count)


@dataclass(frozen=True)
class Mount:
    """How the chart hangs: off the middle of the stage's travel, and turned as `projection.Pose` says."""

    right_mm: float = 0.0
    down_mm: float = 0.0
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    def turn(self) -> Rotation:
        """Its turn against a chart that hangs straight."""
        return Rotation.from_euler("ZYX", [self.roll_deg, self.yaw_deg, self.pitch_deg], degrees=True)


@dataclass
class View:
    """The camera in the world, in front of a chart that hangs in the middle of the stage's travel.

    `focus_mm` None focuses on the chart before each exposure; a fixed focus drifts by `focus_drift_mm_per_c`.
    `mount` None: no chart hangs there. `slope`: how the light changes over it, from its centre to its sides. The noise
    of a frame follows from the seed of `rng` and the opening's number, however many were taken before it.
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
    taken: list[Photograph] = field(default_factory=list)

    def chart_seen(self, pose: Pose) -> tuple[Array, Rotation]:
        """The chart's centre in the camera's frame at each instant, (n, 3) mm, and its turn."""
        mount = self.mount or Mount()
        middle = {name: (low + high) / 2 for name, (low, high) in self.world.room.travel.items()}
        right, down = middle["x_mm"] - pose.x_mm + mount.right_mm, pose.y_mm - middle["y_mm"] + mount.down_mm
        offset = np.column_stack([right, down, pose.z_mm])
        turned = Rotation.from_euler("YX", np.column_stack([pose.pan_deg, pose.tilt_deg]), degrees=True).inv()
        return np.asarray(turned.apply(offset)), turned * mount.turn()

    def photograph(self, opening: Opening, path: FilePath | None = None) -> Photograph:
        """Expose once; the path of the chart's centre over the sensor becomes part of the blur."""
        centres, turns = self.chart_seen(self.world.pose(instants(opening)))
        centre = centres.mean(axis=0)
        roll, yaw, pitch = turns.mean().as_euler("ZYX", degrees=True)
        placed = PlacedChart(self.chart, ChartPose((centre[0], centre[1], centre[2]), yaw, pitch, roll), self.cell_mm)
        middle_s = opening.begin_s + opening.exposure_s / 2
        light = Light(self.world.lamp(middle_s)) if self.mount is None else self._light(placed, middle_s)
        scene = Scene((placed,) if self.mount else (), Wall(centre[2] + 500.0), light)
        focus_mm = self._focus_mm(middle_s, float(centre[2]))
        camera = replace(self.camera, focus_mm=focus_mm, optics=self._optics(centres, focus_mm))
        taken = camera.photograph(scene, self._noise(opening.number), path, exposure_s=opening.exposure_s)
        self.taken.append(taken)
        return taken

    def _noise(self, number: int) -> np.random.Generator:
        seed = self.rng.bit_generator.seed_seq
        assert isinstance(seed, np.random.SeedSequence)
        return np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, number)))

    def _light(self, placed: PlacedChart, t_s: float) -> Light:
        return replace(self.camera.light_on(placed, self.slope), level=self.world.lamp(t_s))

    def _focus_mm(self, t_s: float, distance_mm: float) -> float:
        if self.focus_mm is None:
            return distance_mm
        return self.focus_mm + self.focus_drift_mm_per_c * (self.world.temperature_c(t_s) - self.world.room.ambient_c)

    def _optics(self, centres: Array, focus_mm: float) -> Optics:
        """The camera's optics with the movement of the chart's image during the exposure."""
        sharp = self.camera.optics or Optics.typical(f_number=self.camera.lens.f_number, pitch_um=self.camera.pitch_um)
        image = self.camera.projection(focus_mm).principal_px * centres[:, :2] / centres[:, 2:]
        way = image - image.mean(axis=0)
        if np.abs(way).max() < NEGLIGIBLE_PX:
            return sharp
        return sharp.also(Path(tuple((float(x), float(y)) for x, y in way)))

    def develop(self, opening: Opening) -> bytes:
        """The bytes of the DNG of one opening."""
        with tempfile.TemporaryDirectory() as folder:
            path = FilePath(folder) / "frame.dng"
            self.photograph(opening, path)
            return path.read_bytes()
