"""Two apertures of scenes in depth, rendered by Mitsuba 3: stated uncertainties of picture and distances, and the time.

    python -m tests.benchmarks.restoration_mitsuba FOLDER [--scenes board ball] [--seed 1]

Requires `pip install mitsuba`; renders are kept in FOLDER. Glowing walls of grain, lines and discs, 0.6 to 2.8 m before
a lens of 12 mm at f/2.8 and f/3.5 focused at 3.6 m (or at 0.43 m: behind), 6 um pixels; thin lens and occlusion are
Mitsuba's, with 1024 stratified samples per pixel. Noise 40 dB below the photographs' contrast. z: error over u.
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procedures import pillbox, restore, stacks_of
from procedures.restoration.masks.thin_lens import CameraSetting, relation
from procedures.restoration.metres import BEHIND, FRONT, CameraUncertainty, depth_spread, distances_of
from tests.benchmarks.restoration_scenes import picture

Array = np.ndarray
SHAPE, RIM, SAMPLES = (220, 300), 12, 1024
F_NUMBERS, FOCUS_MM = (2.8, 3.5), {FRONT: 3600.0, BEHIND: 430.0}
UNIT = 1000.0
"""Millimetres of the scenes' unit."""


@dataclass(frozen=True)
class Rendered:
    """Photographs (2, H, W) without sensor noise, the pinhole's picture, and the distance of each pixel, metres."""

    photographs: Array
    sharp: Array
    distance: Array


def setting(f_number: float, side: str) -> CameraSetting:
    """The camera."""
    return CameraSetting(12.0, f_number, FOCUS_MM[side], 6.0)


def rendered(folder: Path, name: str, side: str, seed: int) -> Rendered:
    """Render a scene, or read it from the folder."""
    path = folder / f"{name}-{side}-{seed}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(path, **_render(name, side, seed))
    with np.load(path) as file:
        return Rendered(**{key: file[key] for key in file.files})


def _render(name: str, side: str, seed: int) -> dict[str, Array]:
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    things = SCENES[name](seed)
    photographs = [_shot(things, setting(n, side), seed)[..., 0] for n in F_NUMBERS]
    pinhole = _shot(things, setting(F_NUMBERS[0], side), seed, sharp=True)
    return {"photographs": np.stack(photographs), "sharp": pinhole[..., 0], "distance": pinhole[..., -1]}


def _shot(things: dict[str, Any], camera: CameraSetting, seed: int, *, sharp: bool = False) -> Array:
    """A photograph; with the position of what the ray meets for a pinhole."""
    import mitsuba as mi

    zeta = camera.image_distance_mm
    lens: dict[str, Any] = {"type": "perspective"}
    if not sharp:
        lens = {"type": "thinlens", "aperture_radius": camera.aperture_radius_mm / UNIT,
                "focus_distance": camera.focus_mm / UNIT}  # fmt: skip
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "aov", "aovs": "xyz:position", "img": {"type": "path", "max_depth": 1}},
        "sensor": {
            **lens, "fov": 2 * np.degrees(np.arctan(SHAPE[1] * camera.pitch_um * 1e-3 / 2 / zeta)), "fov_axis": "x",
            "near_clip": 0.01, "far_clip": 100.0,
            "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, 1], up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": SHAPE[1], "height": SHAPE[0], "rfilter": {"type": "box"},
                     "pixel_format": "rgb", "component_format": "float32"},
            "sampler": {"type": "multijitter", "sample_count": SAMPLES},
        },
        **things,
    })  # fmt: skip
    return np.array(mi.render(scene, spp=64 if sharp else SAMPLES, seed=seed)).astype(float)


def _glowing(seed: int, per_unit: float, width: float, height: float) -> dict[str, Any]:
    """An emitter with a texture of `per_unit` texels per metre."""
    import mitsuba as mi

    texture = picture((round(height * per_unit), round(width * per_unit)), np.random.default_rng(seed))
    bitmap = mi.Bitmap(np.repeat(texture[..., None], 3, axis=2).astype(np.float32))
    return {"type": "area", "radiance": {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "bilinear"}}


def _board(
    seed: int, centre: list[float], turns: tuple[float, float], width: float, height: float, texel: float
) -> Any:
    """A rectangle facing the camera, turned about y and x, degrees."""
    import mitsuba as mi

    place = mi.ScalarTransform4f().translate(centre).rotate([0, 1, 0], 180 + turns[0]).rotate([1, 0, 0], turns[1])
    place = place.scale([width / 2, height / 2, 1])
    return {"type": "rectangle", "to_world": place, "emitter": _glowing(seed, 1 / texel, width, height)}


def board_scene(seed: int) -> dict[str, Any]:
    """A slanted wall, 1.5 to 2.7 m, with two near boards before it."""
    return {
        "wall": _board(seed, [0, 0, 2.05], (28, 0), 3.0, 1.6, 1.1e-3),
        "one": _board(seed + 100, [-0.1, -0.03, 0.95], (-12, 0), 0.3, 0.34, 0.55e-3),
        "two": _board(seed + 200, [0.07, 0.0, 0.7], (0, 20), 0.08, 0.3, 0.4e-3),
    }


def ball_scene(seed: int) -> dict[str, Any]:
    """A floor that recedes, a wall, and a ball."""
    return {
        "wall": _board(seed, [0, 0, 2.7], (0, 0), 3.0, 1.8, 1.5e-3),
        "floor": _board(seed + 100, [0, -0.1, 1.6], (0, -82), 2.4, 2.2, 0.9e-3),
        "ball": {"type": "sphere", "center": [-0.06, 0.0, 1.1], "radius": 0.1,
                 "emitter": _glowing(seed + 200, 900.0, 0.63, 0.315)},
    }  # fmt: skip


SCENES = {"board": board_scene, "ball": ball_scene}


def compare(case: Rendered, name: str, side: str, noise_db: float, seed: int) -> None:
    """Print the figures of one scene."""
    rng, inside = np.random.default_rng(seed), (slice(RIM, -RIM), slice(RIM, -RIM))
    z = [one + one.std() * 10 ** (-noise_db / 20) * rng.standard_normal(SHAPE) for one in case.photographs]
    cameras = [setting(n, side) for n in F_NUMBERS]
    ratio, offset = relation(*cameras)
    widest = float(np.abs(cameras[0].blur_radius_px(UNIT * np.array([0.5, 3.2]))).max())
    start = time.process_time()
    masks = stacks_of([pillbox()] * 2, (1.0, ratio), widest, SHAPE, (0.0, offset))
    outcome = restore([one[None] for one in z], masks)
    seconds = time.process_time() - start
    found = outcome.value
    assert found is not None, outcome.reason
    w = np.abs(cameras[0].blur_radius_px(UNIT * case.distance))
    of_w = depth_spread(found, [one[None] for one in z], masks, pillbox(), [(1.0, 0.0), (ratio, offset)])
    distances = distances_of(*of_w, cameras[0], side, CameraUncertainty(0.0, 0.0))
    error = (distances.metres - case.distance)[inside]
    known = np.isfinite(error)
    off = (found.sharp[0] - case.sharp)[inside]
    print(
        f"{side:6} {name:6} {seed}: {outcome.verdict}, w rms {_rms((found.w - w)[inside]):.3f} px; picture error "
        f"{255 * _rms(off):.2f} of 255, stated/error {_rms(found.sharp_std[inside]) / _rms(off):.2f}; determined "
        f"{known.mean():.0%}, error {1000 * np.median(np.abs(error[known])):.1f} mm (median), "
        f"{_coverage(error[known], distances.std[inside][known])}; {seconds:.0f} s of processor",
        flush=True,
    )


def _coverage(error: Array, u: Array) -> str:
    z = np.abs(error / u)
    return f"within 2 u {np.mean(z < 2):.1%}, z rms {_rms(np.minimum(z, 6)):.2f}, median {np.median(z):.2f}"


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    """Print each scene's figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), choices=SCENES)
    parser.add_argument("--sides", nargs="*", default=[FRONT], choices=(FRONT, BEHIND))
    parser.add_argument("--noise", type=float, default=40.0)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    for side in asked.sides:
        for name in asked.scenes:
            compare(rendered(asked.folder, name, side, asked.seed), name, side, asked.noise, asked.seed)


if __name__ == "__main__":
    main()
