"""Photographs of the chart through wide lenses, rendered by rays: which views are used, their points, and the camera.

tests/benchmarks/fisheye_views.py [LENS]... [--views=N] [--width=PX] [--noise=SHARE] [--tilt=DEG]

Nothing is shared with procedures or simulators but the chart's bitmap: every fine pixel's ray is intersected with the
sheet, the picture is blurred, averaged over pixels, and rounded to 16 bits with noise. LENS is one of LENSES,
polynomials of the angle by Kannala and Brandt, or a file of mrcal with a splined stereographic lens, evaluated by its
published formula.

Prints the views that are used, the reasons of the others, the points' errors over stated, the camera's projection error
over the covered frame, and the processor's time.
"""

import ast
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.interpolate import BSpline, RectBivariateSpline
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from procedures import GeometryParameters, Plane, calibrate_geometry
from procedures.geometry.chart_bins.photographs import views_of
from procedures.geometry.uncertainty import enclosed
from procedures.geometry.views import chart_nodes
from procedures.pattern import BLOCK, CELLS, Chart
from procedures.pattern_print.formats import bitmap
from tests.benchmarks import options
from tests.procedures.geometry.simulated_views import aligned

Array = np.ndarray

FINE = 4
"""Rays along a pixel's side."""
BLUR_PX, CELL_PIXELS = 0.6, 16
CELL_MM = 300 / 320
LEVELS = 0.08, 0.75
"""Black and white of the sheet, in fractions of full scale; the wall behind it lies between."""
COARSE = 12
"""Pixels between the rays that are computed; a spline gives those between."""


@dataclass(frozen=True)
class Lens:
    """A lens by its map from stereographic coordinates 2 tan(angle / 2) (n, 2) to pixels (n, 2)."""

    size: tuple[int, int]
    pixels: Callable[[Array], Array]
    focal_px: float
    centre: tuple[float, float]

    def project(self, points: Array) -> Array:
        """Pixels (n, 2) of points (n, 3)."""
        return self.pixels(2 * points[:, :2] / (np.linalg.norm(points, axis=1) + points[:, 2])[:, None])

    def rays(self, places: Array) -> Array:
        """Unit directions (n, 3) of pixels (n, 2), by Newton's steps."""
        u = (places - self.centre) / self.focal_px
        for _ in range(30):
            here, h = self.pixels(u), 1e-6
            J = np.stack([(self.pixels(u + h * axis) - here) / h for axis in np.eye(2)], axis=-1)
            u = u + np.linalg.solve(J, (places - here)[..., None])[..., 0]
        return directions(u)


def directions(u: Array) -> Array:
    """Unit vectors (n, 3) of stereographic coordinates (n, 2)."""
    q = np.sum(u * u, axis=-1, keepdims=True) / 4
    return np.concatenate([u, 1 - q], axis=-1) / (1 + q)


def polynomial(size: tuple[int, int], focal_px: float, centre: tuple[float, float], k: tuple[float, ...]) -> Lens:
    """r = f (a + k1 a^3 + k2 a^5 + ...) of the angle a."""

    def pixels(u: Array) -> Array:
        s = np.linalg.norm(u, axis=1, keepdims=True)
        a = 2 * np.arctan(s / 2)
        r = a * (1 + sum(one * a ** (2 * i + 2) for i, one in enumerate(k)))
        return focal_px * r / np.maximum(s, 1e-12) * u + centre

    return Lens(size, pixels, focal_px, centre)


def mrcal_lens(path: Path) -> Lens:
    """A splined stereographic lens of mrcal, by the formula of its documentation, q = f (u + spline(u)) + c.

    At half its resolution: two pixels become one.
    """
    model = ast.literal_eval(path.read_text())
    kind, *settings = model["lensmodel"].split("_order=")[1].replace("fov_x_deg", "fov").split("_")
    nx, ny, fov = (int(one.split("=")[1]) for one in settings)
    (fx, fy, cx, cy), rest = model["intrinsics"][:4], np.array(model["intrinsics"][4:])
    controls, order = rest.reshape(ny, nx, 2), int(kind)
    assert order == 3, "cubic splines alone"
    widest = 2 * np.tan(np.radians(fov) / 4)
    per_u = (nx - 1 - 2) / (2 * widest)

    def weights(at: Array, count: int) -> Array:
        basis = BSpline(np.arange(-2, count + 2, dtype=float), np.eye(count), 3, extrapolate=True)
        return basis(at)

    def pixels(u: Array) -> Array:
        x, y = u[:, 0] * per_u + (nx - 1) / 2, u[:, 1] * per_u + (ny - 1) / 2
        moved = np.einsum("nj,ni,jib->nb", weights(y, ny), weights(x, nx), controls)
        return ((u + moved) * (fx, fy) + (cx, cy) - 0.5) / 2

    return Lens(tuple(side // 2 for side in model["imagersize"]), pixels, fx / 2, (cx / 2, cy / 2))


SIZE = (3000, 2000)
LENSES = {
    "170": polynomial(SIZE, 1215.0, (1511.0, 990.0), (-0.012, 0.004, -0.0015, 0.0002)),
    "140": polynomial(SIZE, 1400.0, (1490.0, 1008.0), (-0.03, 0.006, -0.001, 0.0)),
    "180": polynomial(SIZE, 1000.0, (1503.0, 1004.0), (0.02, -0.006, 0.001, 0.0)),
}


@dataclass(frozen=True)
class Pose:
    """X_camera = R X_chart + t, in mm."""

    R: Array
    t: Array


PLACES = [(0.5, 0.5), (0.2, 0.25), (0.8, 0.25), (0.2, 0.75), (0.8, 0.7), (0.5, 0.25), (0.5, 0.75), (0.17, 0.5),
          (0.83, 0.5), (0.35, 0.35), (0.65, 0.65), (0.65, 0.35), (0.35, 0.65), (0.24, 0.3), (0.76, 0.7), (0.76, 0.3),
          (0.24, 0.7), (0.5, 0.5)]  # fmt: skip


def poses(lens: Lens, views: int, width_px: float, tilt_deg: float) -> list[Pose]:
    """Charts over the frame, tilted to all sides from the line of sight."""
    rng, found = np.random.default_rng(11), []
    for i in range(views):
        at = (np.array(PLACES[i % len(PLACES)]) + rng.uniform(-0.015, 0.015, 2)) * lens.size
        sight = lens.rays(at[None])[0]
        around = Rotation.from_rotvec(np.arccos(sight[2]) * _unit(np.cross([0, 0, 1.0], sight)))
        angle = 2 * np.pi * i * 0.381966
        tilt = np.radians(tilt_deg) * (0.7 + 0.3 * (i % 3) / 2)
        turn = Rotation.from_rotvec(tilt * np.array([np.cos(angle), np.sin(angle), 0]))
        roll = Rotation.from_rotvec([0, 0, np.pi / 2 * (i % 4) + rng.uniform(-0.15, 0.15)])
        distance = lens.focal_px * CELLS * CELL_MM / (width_px * rng.uniform(0.8, 1.15))
        found.append(Pose((around * turn * roll).as_matrix(), distance * sight))
    return found


def _unit(v: Array) -> Array:
    return v / max(np.linalg.norm(v), 1e-12)


def photograph(
    lens: Lens, pose: Pose, chart: Chart, noise: float, seed: int,
    moving: Callable[[Array], tuple[Array, Array]] | None = None,
) -> Array:  # fmt: skip
    """The picture (rows, columns), in fractions of full scale; `moving` gives R (n, 3, 3) and t (n, 3) of rows (n,)."""
    edge = (CELLS + 4 * BLOCK) / 2 * CELL_MM
    along = np.linspace(-edge, edge, 80)
    sheet = np.stack([*np.meshgrid(along, along), np.zeros((80, 80))], axis=-1).reshape(-1, 3)
    outline = lens.project(sheet @ pose.R.T + pose.t)
    low = np.maximum(np.floor(outline.min(axis=0)) - 8, 0).astype(int)
    high = np.minimum(np.ceil(outline.max(axis=0)) + 9, lens.size).astype(int)
    coarse = [np.linspace(a - 0.5, b - 0.5, int((b - a) / COARSE) + 4) for a, b in zip(low, high, strict=True)]
    x, y = np.meshgrid(*coarse)
    rays = lens.rays(np.column_stack([x.ravel(), y.ravel()]))
    u = (2 * rays[:, :2] / (1 + rays[:, 2:])).reshape(*x.shape, 2)
    fine = [(np.arange((b - a) * FINE) + 0.5) / FINE + a - 0.5 for a, b in zip(low, high, strict=True)]
    at = np.stack([RectBivariateSpline(coarse[1], coarse[0], u[..., k])(fine[1], fine[0]) for k in (0, 1)], axis=-1)
    # in the chart's frame, where the sheet is the plane z = 0; every row has its time
    R, t = moving(fine[1]) if moving else (pose.R[None], pose.t[None])
    d = directions(at) @ R
    origin = -np.einsum("nab,na->nb", R, t)[:, None]
    with np.errstate(divide="ignore"):
        along_ray = -origin[..., 2] / d[..., 2]
    where = (origin[..., :2] + along_ray[..., None] * d[..., :2]) / CELL_MM + CELLS / 2
    cells = bitmap(chart, CELL_PIXELS).astype(np.float32) / 255
    places = ((where - CELLS / 2) * CELL_PIXELS + (len(cells) - 1) / 2).astype(np.float32)
    ink = cv2.remap(
        cells, *places.transpose(2, 0, 1), cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0
    )
    paper = (np.abs(where - CELLS / 2).max(axis=-1) < CELLS / 2 + 1.6 * BLOCK) & (along_ray > 0)
    black, white = LEVELS
    light = np.where(paper, black + (white - black) * ink, np.float32(0.35))
    light = gaussian_filter(light, BLUR_PX * FINE, mode="nearest")
    rows, columns = light.shape
    light = light.reshape(rows // FINE, FINE, columns // FINE, FINE).mean(axis=(1, 3))
    picture = np.full(lens.size[::-1], 0.35)
    picture[low[1] : high[1], low[0] : high[0]] = light
    rng = np.random.default_rng(seed)
    picture += noise * np.sqrt(picture) * rng.standard_normal(picture.shape)
    return (np.round(np.clip(picture, 0, 1) * 65535) / 65535).astype(np.float32)


def true_points(lens: Lens, pose: Pose) -> Array:
    """Pixels (N, 2) of the chart's nodes."""
    return lens.project(chart_nodes(CELL_MM) @ pose.R.T + pose.t)


def measured(lens: Lens, view: int, pose: Pose, noise: float) -> tuple[object, str]:
    """The view of a rendered photograph, or the reason why it gives none."""
    chart = Chart.from_seed()
    plane = Plane("Y", photograph(lens, pose, chart, noise, view), 1 / 65535)
    outcome = views_of({"Y": plane}, chart, f"view{view:02d}")["Y"]
    return outcome.value, outcome.reason


def rms(values: Array) -> float:
    """Root mean square length."""
    return float(np.sqrt(np.mean(np.sum(np.square(values), axis=-1))))


def run(name: str, count: int, width_px: float, tilt_deg: float, noise: float) -> None:
    """The photographs of a lens, and its camera."""
    lens = LENSES[name] if name in LENSES else mrcal_lens(Path(name))
    placed, used, seconds = poses(lens, count, width_px, tilt_deg), [], 0.0
    for i, pose in enumerate(placed):
        start = time.process_time()
        view, reason = measured(lens, i, pose, noise)
        seconds += time.process_time() - start
        if view is None:
            print(f"  view {i}: {reason}", flush=True)
            continue
        error = view.points - true_points(lens, pose)[view.index]
        sigma = np.sqrt(np.einsum("naa->na", view.covariance))
        print(f"  view {i}: {len(view)} points, error {rms(error):.3f} px, "
              f"{np.sqrt(np.mean(((error - error.mean(axis=0)) / sigma) ** 2)):.2f} of stated", flush=True)  # fmt: skip
        used.append(view)
    print(f"{name}: {len(used)} of {count} views used")
    start = time.process_time()
    outcome = calibrate_geometry(used, lens.size, GeometryParameters(CELL_MM))
    print(f"  {outcome.verdict} {outcome.reason}; {time.process_time() - start:.1f} s of processor")
    if outcome.value is not None:
        camera = outcome.value.camera
        pixels = camera.frame_grid(41, 27)
        error = aligned(camera, lens, pixels[enclosed(outcome.value.region, pixels)])
        print(f"  {camera.model}: projection error {rms(error):.4f} px rms, {np.abs(error).max():.3f} at most; "
              f"residual {outcome.value.residual_scale:.2f} of the noise", flush=True)  # fmt: skip


if __name__ == "__main__":
    given = options(__doc__, "lens", lens=list(LENSES), views=18, width=700.0, tilt=30.0, noise=0.004)
    for one in given.lens:
        run(one, given.views, given.width, given.tilt, given.noise)
