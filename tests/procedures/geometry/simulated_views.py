"""Simulated views of a chart through a known lens: points projected by OpenCV's formulas, with known noise."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from procedures.geometry.views import ChartView, Pose, chart_nodes

CELL_MM = 300 / 320
RADIAL, TANGENTIAL, THIN_PRISM = (-0.12, 0.06, -0.01), (4e-4, -3e-4), (6e-4, 0.0, -4e-4, 0.0)


WAVES = 1.5


@dataclass(frozen=True)
class TrueCamera:
    """A lens with radial, tangential and thin-prism distortion, as OpenCV defines them, pixel centres at integers.

    `wave_px` is the amplitude of waves over the frame that no formula describes, WAVES of them along either side.
    """

    focal_px: tuple[float, float] = (5200.0, 5204.0)
    centre: tuple[float, float] = (3012.0, 1989.0)
    size: tuple[int, int] = (6000, 4000)
    radial: tuple[float, float, float] = RADIAL
    tangential: tuple[float, float] = TANGENTIAL
    thin_prism: tuple[float, float, float, float] = THIN_PRISM
    wave_px: float = 0.0

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of points (n, 3) of the camera's frame."""
        (fx, fy), (cx, cy), (k1, k2, k3) = self.focal_px, self.centre, self.radial
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        distortion = np.array([k1, k2, *self.tangential, k3, 0, 0, 0, *self.thin_prism])
        seen, _ = cv2.projectPoints(np.ascontiguousarray(points)[:, None], np.zeros(3), np.zeros(3), K, distortion)
        along, down = (2 * np.pi * WAVES * seen[:, 0] / self.size).T
        waves = np.column_stack([np.sin(down) * np.cos(along), np.cos(1.2 * along + 0.5 * down)])
        return seen[:, 0] + self.wave_px * waves

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Directions (n, 3) of pixels (n, 2), by steps on `project` that leave 0.7 of the error 56 degrees off axis."""
        flat = (pixels - self.centre) / self.focal_px
        for _ in range(120):
            seen = self.project(np.column_stack([flat, np.ones(len(flat))]))
            flat = flat + (pixels - seen) / self.focal_px
        return np.column_stack([flat, np.ones(len(flat))])


@dataclass(frozen=True)
class Shoot:
    """Conditions of the photographs.

    Attributes
    ----------
    noise_px : of every point; print_mm : of every node, in the plane
    bend_mm : depth of the sheet's middle behind its edge
    every : step between the used nodes along a side
    """

    camera: TrueCamera = field(default_factory=TrueCamera)
    count: int = 12
    noise_px: float = 0.01
    print_mm: float = 0.0
    bend_mm: float = 0.0
    tilt_deg: float = 30.0
    width_px: float = 2600.0
    every: int = 1


@dataclass(frozen=True)
class Taken:
    """The views, and the truth."""

    views: list[ChartView]
    poses: list[Pose]
    nodes: np.ndarray
    true_nodes: np.ndarray


def true_poses(shoot: Shoot) -> list[Pose]:
    """Charts over the whole frame, tilted to all sides; the same for every draw of noise."""
    rng = np.random.default_rng(7)
    camera, poses = shoot.camera, []
    places = [(0.5, 0.5), (0.22, 0.3), (0.78, 0.3), (0.22, 0.7), (0.78, 0.7), (0.5, 0.3), (0.5, 0.7), (0.25, 0.5),
              (0.75, 0.5), (0.4, 0.4), (0.6, 0.6), (0.5, 0.5)]  # fmt: skip
    for i in range(shoot.count):
        at = np.array(places[i % len(places)]) * camera.size + rng.uniform(-60, 60, 2)
        distance = camera.focal_px[0] * 256 * CELL_MM / (shoot.width_px * rng.uniform(0.8, 1.15))
        around = 2 * np.pi * i * 0.381966
        tilt = np.deg2rad(shoot.tilt_deg) * (0.6 + 0.4 * (i % 3) / 2)
        turn = Rotation.from_rotvec(tilt * np.array([np.cos(around), np.sin(around), 0]))
        roll = Rotation.from_rotvec([0, 0, np.pi / 2 * (i % 4)])
        t = np.append((at - camera.centre) / camera.focal_px, 1.0) * distance
        poses.append(Pose((turn * roll).as_matrix(), t))
    return poses


def take(shoot: Shoot, rng: np.random.Generator, true_nodes: np.ndarray | None = None) -> Taken:
    """The views of one draw of print errors and noise."""
    nodes = plan(shoot)
    if true_nodes is None:
        true_nodes = printed(shoot, rng)
    poses = true_poses(shoot)
    return Taken(seen(shoot, poses, true_nodes, rng), poses, nodes, true_nodes)


def seen(shoot: Shoot, poses: list[Pose], true_nodes: np.ndarray, rng: np.random.Generator) -> list[ChartView]:
    """The views of charts in these poses, with noise."""
    views = []
    for i, pose in enumerate(poses):
        places = shoot.camera.project(pose.apply(true_nodes))
        inside = ((places >= 0) & (places <= np.array(shoot.camera.size) - 1)).all(axis=1)
        index = np.flatnonzero(inside)
        points = places[index] + shoot.noise_px * rng.standard_normal((len(index), 2))
        covariance = np.tile(shoot.noise_px**2 * np.eye(2), (len(index), 1, 1))
        views.append(ChartView(f"view{i:02d}", index, points, covariance))
    return views


def plan(shoot: Shoot) -> np.ndarray:
    """The planned nodes of the chart, (N, 3)."""
    side = int(len(chart_nodes(CELL_MM)) ** 0.5)
    return chart_nodes(CELL_MM).reshape(side, side, 3)[:: shoot.every, :: shoot.every].reshape(-1, 3)


def printed(shoot: Shoot, rng: np.random.Generator) -> np.ndarray:
    """The actual nodes of a printed, bent sheet."""
    nodes = plan(shoot)
    r2 = np.sum((nodes / nodes.max()) ** 2, axis=1)
    nodes[:, :2] += shoot.print_mm * rng.standard_normal((len(nodes), 2))
    nodes[:, 2] += shoot.bend_mm * (1 - r2 / 2)
    return nodes


def apart(camera, truth: TrueCamera, margin: float = 0.0125) -> np.ndarray:
    """Error (n, 2) of a camera's projection, in pixels, up to the best rotation.

    On a grid over the frame without `margin` of its sides: 95 % of its area, for 1.25 %.
    """
    w, h = truth.size
    x, y = np.meshgrid(np.linspace(margin, 1 - margin, 40) * (w - 1), np.linspace(margin, 1 - margin, 27) * (h - 1))
    return aligned(camera, truth, np.column_stack([x.ravel(), y.ravel()]))


def aligned(camera, truth, pixels: np.ndarray) -> np.ndarray:
    """Projection error (n, 2) of a camera at pixels (n, 2) of the true one, up to the best rotation."""
    rays, turn = truth.rays(pixels), np.zeros(3)
    for _ in range(6):
        turned = Rotation.from_rotvec(turn).apply(rays)
        error = camera.project(turned) - pixels
        nudged = [camera.project(Rotation.from_rotvec(turn + 1e-6 * axis).apply(rays)) for axis in np.eye(3)]
        J = (np.stack(nudged, axis=-1) - camera.project(turned)[..., None]) / 1e-6
        turn = turn - np.linalg.lstsq(J.reshape(-1, 3), error.ravel(), rcond=None)[0]
    return error


def fixed_to_charts(camera, poses, taken: Taken, truth: TrueCamera, pixels: np.ndarray, distance_mm: float):
    """Projection (n, 2) by a camera of objects at pixels (n, 2) of the true one that are fixed to the charts.

    The charts' frame is that of the actual nodes: the best similarity of the plan.
    """
    R, t, s = similarity(taken.nodes, taken.true_nodes)
    rays = truth.rays(pixels)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    moved = []
    for pose, found in zip(taken.poses, poses, strict=True):
        turn = found.R @ (pose.R @ R).T
        if np.isfinite(distance_mm):
            moved.append((distance_mm * rays - pose.R @ t - pose.t) @ turn.T / s + found.t)
        else:
            moved.append(rays @ turn.T)
    return camera.project(np.mean(moved, axis=0))


def similarity(plan: np.ndarray, real: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """R, t, s with s R plan + t nearest to the real nodes (Umeyama 1991)."""
    a, b = plan - plan.mean(axis=0), real - real.mean(axis=0)
    U, D, Vt = np.linalg.svd(b.T @ a)
    sign = np.array([1, 1, np.linalg.det(U @ Vt)])
    R = (U * sign) @ Vt
    s = float(np.sum(D * sign) / np.sum(a * a))
    return R, real.mean(axis=0) - s * R @ plan.mean(axis=0), s
