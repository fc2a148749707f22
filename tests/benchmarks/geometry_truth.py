"""Stated uncertainties of a camera's geometry against lenses that the program does not know: parameters and projection.

tests/benchmarks/geometry_truth.py [lenses | rig]... [--draws=N] [--first=N] [--views=N] [--noise=PX] [--lens=NAME]

The lenses are OpenCV's formulas (its projectPoints and fisheye.projectPoints), which the program's projection does not
use; charts bend by polynomials of their own and every node errs. The camera is chosen by the program.

lenses  errors over stated uncertainties (z): of the principal point and the focal length, rms over draws; of the
        projection at the charts' distance and at infinity, over the covered frame, rms, and the share below 1
rig     errors of a second camera's pose over stated uncertainties, six a draw
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from procedures.geometry.estimate import Geometry, GeometryParameters, calibrate_geometry
from procedures.geometry.rig import estimate_rig, rig_camera
from procedures.geometry.uncertainty import enclosed, projection_uncertainty
from procedures.geometry.views import Pose
from tests.benchmarks import options
from tests.procedures.geometry.simulated_views import (
    CELL_MM,
    Shoot,
    Taken,
    TrueCamera,
    fixed_to_charts,
    plan,
    printed,
    seen,
    true_poses,
)

SIZE = (3000, 2000)


@dataclass(frozen=True)
class Fisheye(TrueCamera):
    """OpenCV's fisheye: odd powers of the angle."""

    k: tuple[float, float, float, float] = (0.01, -0.004, 0.001, 0.0)

    def project(self, points: np.ndarray) -> np.ndarray:
        (fx, fy), (cx, cy) = self.focal_px, self.centre
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        given = np.ascontiguousarray(points)[:, None]
        return cv2.fisheye.projectPoints(given, np.zeros(3), np.zeros(3), K, np.array(self.k))[0][:, 0]


@dataclass(frozen=True)
class Rational(TrueCamera):
    """OpenCV's quotient of polynomials with prism: coefficients in its order, k1, k2, p1, p2, k3, k4, ..., s4."""

    distortion: tuple[float, ...] = ()

    def project(self, points: np.ndarray) -> np.ndarray:
        (fx, fy), (cx, cy) = self.focal_px, self.centre
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        given = np.ascontiguousarray(points)[:, None]
        return cv2.projectPoints(given, np.zeros(3), np.zeros(3), K, np.array(self.distortion))[0][:, 0]


FOCAL, CENTRE = (2600.0, 2602.0), (1507.0, 991.0)
PLACE = {"focal_px": FOCAL, "centre": CENTRE, "size": SIZE}
LENSES = {
    "plain": Rational(**PLACE, distortion=(-0.12, 0.06, 0, 0, 0)),
    "tangential": Rational(**PLACE, distortion=(-0.12, 0.06, 4e-4, -3e-4, -0.01)),
    "prism": Rational(**PLACE, distortion=(-0.12, 0.06, 0, 0, 0, 0, 0, 0, 9e-4, 0, -9e-4, 0)),
    "prism_and_more": Rational(**PLACE, distortion=(-0.2, 0.1, 3e-4, 3e-4, -0.03, 0, 0, 0, 6e-4, 1e-4, 9e-4, -1e-4)),
    "rational": Rational(**PLACE, distortion=(0.4, 0.1, 2e-4, -1e-4, 0.01, 0.55, 0.2, 0.02, 2e-4, 0, 1e-4, 0)),
    "fisheye": Fisheye((1300.0, 1301.0), CENTRE, SIZE),
    "170": Fisheye((1215.0, 1215.0), CENTRE, SIZE, k=(-0.012, 0.004, -0.0015, 0.0002)),
}


def calibrated(lens: TrueCamera, draw: int, views: int, noise: float) -> tuple[Taken, Geometry]:
    """One draw's photographs, with print errors of 0.02 mm and a sheet bent by 0.3 mm, and the camera from them."""
    shoot = Shoot(lens, count=views, noise_px=noise, print_mm=0.02, bend_mm=0.3, width_px=1300.0, every=2)
    rng = np.random.default_rng(draw)
    nodes, poses = printed(shoot, rng), true_poses(shoot)
    taken = Taken(seen(shoot, poses, nodes, rng), poses, plan(shoot), nodes)
    outcome = calibrate_geometry(taken.views, lens.size, GeometryParameters(CELL_MM, 0.0), taken.nodes)
    return taken, outcome.result()


def lenses(names: list[str], draws: range, views: int, noise: float) -> None:
    """z of every lens."""
    for name in names:
        lens, models = LENSES[name], []
        of_parameters: dict[str, list[float]] = {}
        of_pixels: dict[str, list[np.ndarray]] = {}
        sizes: dict[str, list[float]] = {}
        for draw in draws:
            taken, found = calibrated(lens, draw, views, noise)
            models.append(found.camera.model)
            truth = dict(zip(("fx", "fy", "cx", "cy"), (*lens.focal_px, *lens.centre), strict=True))
            for parameter, value in truth.items():
                number = found.numbers().get(parameter)
                if number is not None:
                    of_parameters.setdefault(parameter, []).append((number.value - value) / number.uncertainty)
            pixels = found.camera.frame_grid(13, 9)
            pixels = pixels[enclosed(found.region, pixels)]
            for where, distance in (("the charts", found.maps[0].distance_mm), ("infinity", np.inf)):
                poses = [one.pose for one in found.views]
                error = np.linalg.norm(
                    fixed_to_charts(found.camera, poses, taken, lens, pixels, distance) - pixels, axis=1
                )
                stated = projection_uncertainty(found.adjustment, pixels, distance)
                of_pixels.setdefault(where, []).append(error / stated)
                sizes.setdefault(where, []).append(rms(error))
        counts = ", ".join(f"{model} {models.count(model)}" for model in set(models))
        print(f"{name:15s} {len(draws)} draws from {draws[0]}, {views} views; {counts}")
        print(f"  z rms of {', '.join(f'{p} {rms(z):.2f}' for p, z in of_parameters.items())}")
        for where, z in of_pixels.items():
            by_draw, every = ", ".join(f"{rms(one):.1f}" for one in z), np.concatenate(z)
            shares = f"z rms {rms(every):.2f}, {np.mean(every < 1):.0%} below 1, by draw {by_draw}"
            print(f"  projection at {where}: error {rms(sizes[where]):.4f} px, {shares}", flush=True)


def rig(draws: int, views: int, noise: float) -> None:
    """Errors of a second and a third camera over stated: six a camera and draw, no more than 2.5 are accepted."""
    wide = replace(LENSES["prism"], focal_px=(2300.0, 2301.0), centre=(1488.0, 1012.0))
    lenses = (LENSES["tangential"], wide, LENSES["fisheye"])
    stands = [
        Pose(np.eye(3), np.zeros(3)),
        Pose(Rotation.from_rotvec([0.02, 0.08, 0.01]).as_matrix(), np.array([-60.0, 3.0, 8.0])),
        Pose(Rotation.from_rotvec([-0.05, 0.03, 0.3]).as_matrix(), np.array([40.0, -30.0, 5.0])),
    ]
    every = []
    for draw in range(draws):
        rng = np.random.default_rng(1000 + draw)
        shoot = Shoot(lenses[0], count=views, noise_px=noise, print_mm=0.02, bend_mm=0.3, width_px=1000.0, every=2)
        nodes, poses = printed(shoot, rng), true_poses(shoot)
        cameras = []
        for lens, stand in zip(lenses, stands, strict=True):
            stood = [Pose(stand.R @ one.R, stand.R @ one.t + stand.t) for one in poses]
            photographs = seen(replace(shoot, camera=lens), stood, nodes, rng)
            outcome = calibrate_geometry(photographs, lens.size, GeometryParameters(CELL_MM, 0.0), plan(shoot))
            cameras.append(rig_camera(outcome.result()))
        outcome = estimate_rig(cameras)
        found = outcome.result()
        for i, (pose, truth) in enumerate(zip(found.poses, stands[1:], strict=True)):
            turn = pose.R @ truth.R.T
            error = np.concatenate([Rotation.from_matrix(turn).as_rotvec(), pose.t - turn @ truth.t])
            own = found.covariance[6 * i : 6 * i + 6, 6 * i : 6 * i + 6]
            every.append(error / np.sqrt(np.diag(own)))
            models = ", ".join(one.camera.model for one in cameras)
            chi_square = error @ np.linalg.solve(own, error) / 6
            print(
                f"draw {draw}, camera {i + 2}: z {every[-1].round(2)}, error {error.round(5)}, chi2/6 {chi_square:.2f}"
            )
            print(f"  {outcome.verdict}, {models}", flush=True)
    print(f"largest {np.abs(every).max():.2f}, rms {np.sqrt(np.mean(np.square(every), axis=0)).round(2)}")


def rms(values: np.ndarray | list[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == "__main__":
    given = options(__doc__, "what", what=["lenses"], draws=10, first=0, views=12, noise=0.03, lens=list(LENSES))
    if "lenses" in given.what:
        lenses(given.lens, range(given.first, given.first + given.draws), given.views, given.noise)
    if "rig" in given.what:
        rig(given.draws, given.views, given.noise)
