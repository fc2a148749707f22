"""A rendered scene in depth, photographed at two apertures and restored; compared with the renderer's truth. Exposure
times compensate for the apertures, so that both photographs have the same mean."""

import hashlib
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.dng import Shot
from procedures.outcome import Outcome
from procedures.raw import read_frame
from procedures.ray_histogram.film import Film
from procedures.ray_histogram.film_files import read_film, write_film
from procedures.ray_histogram.multiscale import filter_film
from procedures.restoration.joint.estimate import RestorationParameters, restore
from procedures.restoration.joint.kernel_sizes import stacks_of
from procedures.restoration.joint.result import Restoration
from procedures.restoration.masks.blur_models import pillbox
from procedures.restoration.masks.thin_lens import CameraSetting
from simulators.camera.optics import Optics
from simulators.camera.render import blur_and_sample, photograph_render
from simulators.camera.sensor import Sensor
from simulators.rays.path_tracer import RayScene, ThinLensCamera, blur_diameter_px, cast, depth_map
from simulators.rays.ray_scenes import leaves_in_depth
from station.common.progress import Progress, silent
from station.drawing.pictures import display_png
from station.reports.ray_page import StripRow
from station.results.result_files import ResultFolder, npy

Array = npt.NDArray[np.float64]

NAME = "leaves-in-depth"
APERTURES = (1.4, 1.0)
RATIO = APERTURES[0] / APERTURES[1]
PLANE = "G1"
PITCH = 2
WHITE_E = 25e3
EXPOSURE_S = 0.02


@dataclass(frozen=True)
class DepthPlan:
    """Size of the photographs, samples per pixel of each render, seed, and parameters of the restoration."""

    rows: int
    columns: int
    samples: int
    seed: int
    parameters: RestorationParameters | None = None

    @property
    def sensor(self) -> Sensor:
        return Sensor(rows=self.rows, columns=self.columns)

    def camera(self, f_number: float) -> ThinLensCamera:
        return leaves_in_depth(self.rows, self.columns, f_number)[1]

    @property
    def max_w(self) -> float:
        """Largest half-width of blur in the first photograph, that of infinity, in samples of a plane."""
        return float(blur_diameter_px(self.camera(APERTURES[0]), np.inf)) / 2 / PITCH


@dataclass(frozen=True, eq=False)
class RestoredDepth:
    """A restoration and its truth.

    photographs : (rows, columns), the plane of both files, 1 = saturation
    sharp, w : (rows, columns), the picture of a pinhole camera through the same optics, on the same scale, and the true
        half-width of blur in samples of the first photograph's plane
    sha256 : mapping of file name to hash.
    """

    plan: DepthPlan
    photographs: tuple[Array, Array]
    outcome: Outcome[Restoration]
    sharp: Array
    w: Array
    sha256: dict[str, str]

    @property
    def restoration(self) -> Restoration:
        """The restoration. Raises ValueError if it was refused."""
        if self.outcome.value is None:
            raise ValueError("a restoration without a value has nothing to compare")
        return self.outcome.value

    @cached_property
    def rim(self) -> int:
        """Rim that light from beyond the frame reaches, samples; excluded from all figures."""
        return int(np.ceil(self.plan.max_w * RATIO + 0.5))

    @property
    def figures(self) -> dict[str, Any]:
        """Errors of w (samples), of distance, and of the picture (grey levels of 255), without the rim."""
        inside = np.s_[self.rim : -self.rim, self.rim : -self.rim]
        error = (self.restoration.w - self.w)[inside]
        camera = self.plan.camera(APERTURES[0])
        setting = CameraSetting(camera.focal_mm, camera.f_number, camera.focus_mm, camera.pitch_um * PITCH)
        near, true = (setting.distance_mm(-np.asarray(w[inside], np.float64)) for w in (self.restoration.w, self.w))
        pictures = {"photographs": self.photographs, "restored": (self.restoration.sharp[0],)}
        levels = {name: [_rms((one - self.sharp)[inside] / _white(self.plan)) * 255 for one in several]
                  for name, several in pictures.items()}  # fmt: skip
        return {
            "w_px": {
                "rms_error": _rms(error),
                "median_error": float(np.median(np.abs(error))),
                "mean_error": float(error.mean()),
                "rms_error_of_start": _rms((self.restoration.start.w - self.w)[inside]),
                "true": [float(self.w[inside].min()), float(self.w[inside].max())],
            },
            "distance_median_relative_error": float(np.median(np.abs(near / true - 1))),
            "rms_error_of_picture": levels,
            "rim_px": self.rim,
        }


def restored_depth(
    folder: ResultFolder, films: Path, plan: DepthPlan, *, threads: int = 1, progress: Progress = silent
) -> RestoredDepth:
    """Render, filter, photograph at two apertures and restore from the files; writes them and `NAME-w.npy`."""
    sharp = _picture(films, plan, np.inf, threads, progress)
    names = tuple(f"{NAME}-f{f_number:g}.dng" for f_number in APERTURES)
    for name, f_number in zip(names, APERTURES, strict=True):
        picture = _picture(films, plan, f_number, threads, progress)
        _photograph(picture, plan, f_number, folder.staging / name)
    files = [folder.staging / name for name in names]
    first, second = (read_frame(file, [PLANE]).planes[PLANE].samples.astype(np.float64) for file in files)
    stacks = stacks_of([pillbox()] * 2, (1.0, RATIO), plan.max_w, first.shape)
    outcome = restore([first[None], second[None]], stacks, plan.parameters)
    sha256 = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    light = blur_and_sample(sharp[..., 1], Optics.typical(f_number=APERTURES[0]), "G", 1)
    result = RestoredDepth(plan, (first, second), outcome, _plane(light, plan) * _white(plan), true_w(plan), sha256)
    folder.write(f"{NAME}-w.npy", npy(result.restoration.w, np.float32))
    folder.write(f"{NAME}-restored.png", display_png(result.restoration.sharp[0] / _white(plan)))
    progress(f"{NAME}: restored")
    return result


def true_w(plan: DepthPlan) -> Array:
    """Half-width of blur along the middle ray of each sample of the first photograph's plane, in samples."""
    scene, camera = leaves_in_depth(plan.rows, plan.columns, APERTURES[0])
    return _plane(blur_diameter_px(camera, depth_map(scene, camera)) / 2 / PITCH, plan)


def steps(samples: int) -> int:
    """Number of progress steps without earlier films."""
    return 3 * passes(samples) + 1


def depth_row(one: RestoredDepth) -> StripRow:
    """The restoration on the page."""
    figures, white = one.figures, _white(one.plan)
    w, levels = figures["w_px"], figures["rms_error_of_picture"]
    before = tuple(
        (f"f/{n:g}, plane {PLANE}", photo / white) for n, photo in zip(APERTURES, one.photographs, strict=True)
    )
    after = (("restored", one.restoration.sharp[0] / white), ("through a pinhole", one.sharp / white))
    depth = (
        ("w estimated", _spread(one, one.restoration.w)),
        ("true w", _spread(one, one.w)),
        ("error of w; grey is none", np.asarray(0.5 + (one.restoration.w - one.w) / np.ptp(one.w), np.float64)),
    )
    command = f"station restore {' '.join(one.sha256)} --blur defocus --shape pillbox --ratio {RATIO}"
    facts = (
        f"{one.outcome.verdict}{f': {one.outcome.reason}' if one.outcome.reason else ''}.",
        f"w, half the blur's width, is {w['true'][0]:.2f} to {w['true'][1]:.2f} samples: root mean square error "
        f"{w['rms_error']:.3f}, median {w['median_error']:.3f}, and in the median "
        f"{figures['distance_median_relative_error']:.1%} of the distance.",
        f"Grey levels of 255 from the pinhole's picture: {levels['restored'][0]:.1f} restored; the photographs "
        f"{levels['photographs'][0]:.1f} and {levels['photographs'][1]:.1f}.",
        f"The same restoration from the files: {command} --max-w {one.plan.max_w} --out FOLDER",
    )
    return StripRow(f"{NAME}, restored from two apertures", (before + after, depth), facts)


def depth_entry(depth: RestoredDepth) -> dict[str, Any]:
    """The restoration in the record."""
    return {
        "scene": NAME,
        "verdict": str(depth.outcome.verdict),
        "reason": depth.outcome.reason,
        "photographs": [{"path": name, "sha256": digest} for name, digest in depth.sha256.items()],
        "plane": PLANE,
        "parameters": {"blur": "defocus", "shape": "pillbox", "ratio": RATIO, "max_w": depth.plan.max_w},
        **depth.figures,
        "diagnostics": asdict(depth.restoration.diagnostics),
    }


def _picture(films: Path, plan: DepthPlan, f_number: float, threads: int, progress: Progress) -> Array:
    scene, camera = leaves_in_depth(plan.rows, plan.columns, f_number)
    stem = f"{NAME}-f{f_number:g}-{plan.columns}x{plan.rows}-seed{plan.seed}-{plan.samples}"
    seed = int.from_bytes(hashlib.sha256(stem.encode()).digest()[:8])
    film = render_film(scene, camera, plan.samples, seed, films / f"{stem}.npz", threads=threads, progress=progress)
    return np.asarray(filter_film(film, threads=threads).picture, np.float64)


def _photograph(picture: Array, plan: DepthPlan, f_number: float, path: Path) -> None:
    camera = plan.camera(f_number)
    shot = Shot(
        exposure_s=EXPOSURE_S * (f_number / APERTURES[0]) ** 2, f_number=f_number, focal_length_mm=camera.focal_mm,
        subject_distance_mm=camera.focus_mm, comment=NAME,
    )  # fmt: skip
    rng = np.random.default_rng([plan.seed, round(10 * f_number)])
    photograph_render(picture, Optics.typical(f_number=f_number), plan.sensor, rng, path, white_e=WHITE_E, shot=shot)


def _plane(values: Array, plan: DepthPlan) -> Array:
    x, y = plan.sensor.planes[PLANE]
    return values[y::PITCH, x::PITCH]


def _white(plan: DepthPlan) -> float:
    sensor = plan.sensor
    return WHITE_E / sensor.gain_e_per_dn / (sensor.white - min(sensor.black))


def _spread(depth: RestoredDepth, w: npt.NDArray[np.floating[Any]]) -> Array:
    """w scaled so that the range of the true w is black to white."""
    return np.asarray((w - depth.w.min()) / np.ptp(depth.w), np.float64)


def _rms(error: npt.NDArray[np.floating[Any]]) -> float:
    return float(np.sqrt(np.mean(np.square(error, dtype=np.float64))))


PASS = 32
"""Samples per pixel after which a film is saved."""


def render_film(
    scene: RayScene, camera: ThinLensCamera, samples: int, seed: int, path: Path, *, threads: int = 1,
    progress: Progress = silent,
) -> Film:  # fmt: skip
    """The film of a scene with `samples` samples per pixel, continuing the film in `path`. That file must have the same
    scene, camera and seed: name it after them."""
    film = read_film(path) if path.exists() else Film.blank(camera.rows, camera.columns)
    taken = film.count.astype(np.int64) + film.dropped
    for wanted in (*range(int(taken.min()) + PASS, samples, PASS), samples):
        if (taken >= wanted).all():
            continue
        cast(scene, camera, wanted, film.add, seed=seed, taken=taken, threads=threads)
        taken = film.count.astype(np.int64) + film.dropped
        path.parent.mkdir(parents=True, exist_ok=True)
        write_film(film, path)
        progress(f"{path.stem}: {wanted} of {samples} samples per pixel")
    return film


def passes(samples: int) -> int:
    """Number of progress steps of `render_film` without an earlier film."""
    return -(-samples // PASS)
