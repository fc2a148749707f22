"""A simulated rig that shifts and turns: restored from its IMU's record, by shifts alone, and from its true motion.

    python tests/benchmarks/restoration_turning.py [--scheme 6x(6+6)+2x10] [--rows 192] [--columns 256]

Photographs are drawn instant by instant from sheets in space, so nothing of the masks is in them. RMSE of the picture
in grey levels of 255 against the still rig's photograph; error of inverse depth in the median, against the sheets'.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procedures.raw import ImuRecord
from procedures.restoration.joint.estimate import RestorationParameters, restore
from procedures.restoration.joint.schedule import Scheme
from procedures.restoration.masks.camera_motion import INSTANTS, Poses, motion_blur, poses_of
from simulators.bench.bench import Setup, SimulatedBench
from simulators.bench.body import Opening
from simulators.bench.view import Mount
from simulators.camera.sensor import Sensor
from simulators.devices.imu import G
from simulators.world.world import SinusoidalDrive

Array = NDArray[np.float64]

OPEN_S, RATE_HZ = 0.2, 200.0
NOISE_G, NOISE_RAD_S = 0.002, 0.001
TURNS = (0.0, 1.0, 2.0, 3.0)
"""How much of what the bench's shaker turns the rig: 0.5 degrees of roll, 0.06 of pan and tilt, at 1."""
MAX_INVERSE_M = 0.9
RIM = 14


@dataclass(frozen=True)
class Taken:
    """Both photographs, the still one, and the camera's motion as recorded and as it was; focal length in pixels."""

    still: Array
    photographs: list[Array]
    recorded: list[Poses]
    true: list[Poses]
    focal_px: float


def take(turn: float, rows: int, columns: int, seed: int = 3) -> Taken:
    """Photograph the scene in depth from the rig, its turns made so much larger."""
    with tempfile.TemporaryDirectory() as folder:
        bench = SimulatedBench(Path(folder), Setup(seed=seed, virtual_time=True))
        bench.show("depth")
        view, world, rng = bench.view, bench.world, np.random.default_rng(seed)
        view.camera, view.mount = replace(view.camera, sensor=Sensor(rows=rows, columns=columns)), Mount()
        still = view.photograph(Opening(0.5, OPEN_S, 1)).plane("G1")
        rest = world.pose(np.array([0.5]))
        found = Taken(still, [], [], [], view.camera.projection(rest.z_mm[0]).principal_px / 2)
        for n, drives in enumerate(bench.motions[:2], start=1):
            world.drive(
                tuple(replace(d, amplitude=turn * d.amplitude) if "deg" in d.axis else d for d in drives), 2.0 * n
            )
            begin_s = 2.0 * n + 0.5
            found.photographs.append(view.photograph(Opening(begin_s, OPEN_S, 1 + n)).plane("G1"))
            t = np.arange(-0.25, 0.55, 1 / RATE_HZ)
            force, rate = world.ideal_imu(begin_s + t)
            force, rate = force + rng.normal(0, NOISE_G * G, force.shape), rate + rng.normal(0, NOISE_RAD_S, rate.shape)
            found.recorded.append(poses_of(ImuRecord(t, force, rate), OPEN_S))
            pose = world.pose(begin_s + np.linspace(0, OPEN_S, INSTANTS))
            shift = [pose.x_mm - rest.x_mm, rest.y_mm - pose.y_mm, rest.z_mm - pose.z_mm]
            found.true.append(Poses(np.column_stack(shift) / 1000, pose.turn.as_rotvec()))
        bench.close()
    return found


def turned(drive: SinusoidalDrive, turn: float) -> SinusoidalDrive:
    """A drive, so much larger if it turns the camera."""
    return replace(drive, amplitude=turn * drive.amplitude) if drive.axis.endswith("_deg") else drive


def rmse(picture: Array, taken: Taken) -> float:
    """Of a picture at the still one's level, 255 = its white."""
    inside = np.s_[RIM:-RIM, RIM:-RIM]
    difference = picture * taken.still.mean() / picture.mean() - taken.still
    return float(255 * np.sqrt(np.mean(difference[inside] ** 2)) / np.percentile(taken.still, 99))


def restored(taken: Taken, exposures: list[Poses], scheme: Scheme) -> tuple[float, float, tuple[int, int]]:
    """RMSE of the picture, inverse depth of the near sheet, nodes."""
    blur = motion_blur(exposures, taken.focal_px, taken.still.shape, MAX_INVERSE_M)
    z = [taken.photographs[0], taken.photographs[1] * taken.photographs[0].mean() / taken.photographs[1].mean()]
    found = restore([one[None] for one in z], blur.fields, RestorationParameters(scheme=scheme)).value
    near = np.median(found.w[RIM:-RIM, RIM : taken.still.shape[1] // 3]) * blur.unit.per_pixel
    return rmse(found.sharp[0].astype(np.float64), taken), float(near), blur.fields[0].grid


def main() -> None:
    """Print one line for each size of the turns."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scheme", default="6x(6+6)+2x10")
    parser.add_argument("--rows", type=int, default=192)
    parser.add_argument("--columns", type=int, default=256)
    told = parser.parse_args()
    scheme = Scheme.parse(told.scheme)
    print(f"{'turns':>5} {'blurred':>8} {'shifts':>8} {'record':>8} {'truth':>8} {'1/m':>7} {'nodes':>7}")
    for turn in TURNS:
        taken = take(turn, told.rows, told.columns)
        straight = [Poses(one.position_m, np.zeros_like(one.turn_rad)) for one in taken.recorded]
        shifts, record, truth = (restored(taken, one, scheme) for one in (straight, taken.recorded, taken.true))
        nodes = f"{record[2][0]} x {record[2][1]}"
        print(f"{turn:5.1f} {rmse(taken.photographs[0], taken):8.2f} {shifts[0]:8.2f} {record[0]:8.2f} {truth[0]:8.2f} "
              f"{record[1]:7.3f} {nodes:>7}", flush=True)  # fmt: skip
    print("near sheet: 0.714 1/m")


if __name__ == "__main__":
    main()
