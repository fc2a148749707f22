"""Small scenes of Mitsuba 3, an independent renderer: every sample of each pixel, its features, the converged picture.

Requires `pip install mitsuba`. Renders are kept in a folder, as they take minutes; MITSUBA_VARIANT=llvm_ad_rgb is three
times as fast where Mitsuba finds LLVM (DRJIT_LIBLLVM_PATH).
"""

import os
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]

SIDE = 128
MOST_SAMPLES = 256
PASS = 64
"""Samples of a pass of the converged picture."""
FEATURES = "albedo:albedo,nn:sh_normal,dd:depth"
CHANNELS = 7
"""Albedo, normal and depth."""


@dataclass(frozen=True)
class Render:
    """Samples (rows, columns, n, 3), the samples' features (rows, columns, n, 7), and the converged picture with the
    variance of its mean, (rows, columns, 3) each."""

    samples: Floats
    features: Floats
    truth: Floats
    truth_variance: Floats


def render(name: str, folder: Path, converged: int) -> Render:
    """Render a scene, or read it from the folder."""
    path = folder / f"{name}-{converged}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(path, **_cast(name, converged))
    with np.load(path) as file:
        return Render(**{key: file[key] for key in file.files})


def _cast(name: str, converged: int) -> dict[str, Floats]:
    import mitsuba as mi

    mi.set_variant(os.environ.get("MITSUBA_VARIANT", "scalar_rgb"))
    scene = mi.load_dict((SCENES | HELD_OUT)[name]())
    seed = zlib.crc32(name.encode()) % 10_000_000  # passes of one seed and pixel would repeat their random numbers
    passes = [np.array(mi.render(scene, spp=1, seed=seed + i)) for i in range(MOST_SAMPLES)]
    taken = np.stack(passes, axis=2)
    n = converged // PASS
    means = [np.array(mi.render(scene, spp=PASS, seed=seed + 100_000 + i))[..., :3].astype(float) for i in range(n)]
    truth, variance = np.mean(means, axis=0), np.var(means, axis=0, ddof=1) / n
    return {
        "samples": taken[..., :3],
        "features": taken[..., -CHANNELS:],
        "truth": truth.astype(np.float32),
        "truth_variance": variance.astype(np.float32),
    }


def _scene(origin: list[float], target: list[float], fov: float, **things: Any) -> dict[str, Any]:
    import mitsuba as mi

    lens, path = things.pop("lens", {"type": "perspective"}), things.pop("path", "path")
    return {
        "type": "scene",
        "integrator": {
            "type": "aov",
            "aovs": FEATURES,
            "img": {"type": path, "max_depth": 10},
        },
        "sensor": {
            **lens,
            "fov": fov,
            "to_world": mi.ScalarTransform4f().look_at(origin=origin, target=target, up=[0, 1, 0]),
            "film": {
                "type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"},
                "pixel_format": "rgb", "component_format": "float32",
            },
            "sampler": {"type": "independent"},
        },
        **things,
    }  # fmt: skip


def _diffuse(*colour: float) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(colour)}}


def _sphere(x: float, y: float, z: float, radius: float, **more: Any) -> dict[str, Any]:
    return {"type": "sphere", "center": [x, y, z], "radius": radius, **more}


def _lamp(*radiance: float) -> dict[str, Any]:
    return {"type": "area", "radiance": {"type": "rgb", "value": list(radiance)}}


def _wall(translate: list[float], axis: list[float], angle: float, size: float, bsdf: dict[str, Any]) -> dict[str, Any]:
    import mitsuba as mi

    place = mi.ScalarTransform4f().translate(translate).rotate(axis, angle).scale(size)
    return {"type": "rectangle", "to_world": place, "bsdf": bsdf}


def _room(colour: tuple[float, float, float], texture: dict[str, Any] | None = None) -> dict[str, Any]:
    plain = _diffuse(*colour)
    floor = plain if texture is None else {"type": "diffuse", "reflectance": texture}
    return {
        "floor": _wall([0, -1, 0], [1, 0, 0], -90, 2, floor),
        "back": _wall([0, 0, -1.5], [1, 0, 0], 0, 2, plain),
        "left": _wall([-1.4, 0, 0], [0, 1, 0], 90, 2, _diffuse(0.6, 0.12, 0.1)),
        "right": _wall([1.4, 0, 0], [0, 1, 0], -90, 2, _diffuse(0.12, 0.45, 0.15)),
        "ceiling": _wall([0, 1.2, 0], [1, 0, 0], 90, 2, plain),
    }


def _bulbs() -> dict[str, Any]:
    """A dim room with small lamps in view, up to 800 times as bright as the walls beside them."""
    return _scene(
        [0, 0.1, 3.2], [0, 0, 0], 48, **_room((0.08, 0.08, 0.1)),
        one=_sphere(-0.6, 0.4, -0.6, 0.08, emitter=_lamp(30, 22, 12)),
        two=_sphere(0.5, 0.1, -0.2, 0.04, emitter=_lamp(60, 60, 70)),
        three=_sphere(0.1, -0.7, 0.3, 0.12, emitter=_lamp(4, 3, 2)),
        ball=_sphere(0.65, -0.6, 0, 0.4, bsdf=_diffuse(0.5, 0.5, 0.5)),
    )  # fmt: skip


def _glass() -> dict[str, Any]:
    """Glass, brushed metal and a small lamp: caustics, whose samples are few and bright."""
    return _scene(
        [0, 0.2, 3.2], [0, -0.2, 0], 48, **_room((0.7, 0.7, 0.7)),
        lamp=_sphere(0.2, 0.9, 0.2, 0.1, emitter=_lamp(60, 55, 45)),
        glass=_sphere(-0.5, -0.6, 0.2, 0.4, bsdf={"type": "dielectric"}),
        metal=_sphere(0.6, -0.55, -0.3, 0.45, bsdf={"type": "roughconductor", "material": "Cu", "alpha": 0.15}),
    )  # fmt: skip


def _texture() -> dict[str, Any]:
    """A fine texture under a large soft lamp, through a lens with shallow depth of field."""
    import mitsuba as mi

    noise = np.random.default_rng(1).random((256, 256, 3)) * [0.8, 0.7, 0.5] + 0.05
    board = {
        "type": "bitmap", "bitmap": mi.Bitmap(noise.astype(np.float32)), "raw": True, "filter_type": "bilinear",
        "to_uv": mi.ScalarTransform4f().scale([0.25, 0.25, 1]),
    }  # fmt: skip
    return _scene(
        [0, 0.5, 3.2], [0, -0.3, 0], 48, **_room((0.6, 0.6, 0.6), board),
        lens={"type": "thinlens", "aperture_radius": 0.06, "focus_distance": 3.0},
        lamp=_wall([0, 1.19, 0], [1, 0, 0], 90, 0.5, _diffuse(0, 0, 0)) | {"emitter": _lamp(6, 6, 6)},
        near=_sphere(-0.55, -0.65, 0.9, 0.3, bsdf={"type": "plastic", "diffuse_reflectance": {"type": "rgb",
             "value": [0.2, 0.3, 0.7]}}),
        far=_sphere(0.6, -0.6, -0.6, 0.4, bsdf={"type": "diffuse", "reflectance": {"type": "checkerboard",
            "to_uv": mi.ScalarTransform4f().scale([16, 16, 1])}}),
    )  # fmt: skip


def _indirect() -> dict[str, Any]:
    """A room lit through a gap only: every sample is noisy, with a strong gradient."""
    return _scene(
        [0, 0.1, 3.2], [0, 0, 0], 48, **_room((0.75, 0.75, 0.75)),
        screen=_wall([0, 0.75, -0.2], [1, 0, 0], -90, 1.25, {"type": "twosided", "bsdf": _diffuse(0.7, 0.6, 0.4)}),
        lamp=_sphere(0, 1.05, -0.6, 0.08, emitter=_lamp(150, 150, 150)),
        cube={"type": "cube", "to_world": mi_transform([-0.5, -0.6, -0.3], 25, 0.35), "bsdf": _diffuse(0.7, 0.7, 0.7)},
        ball=_sphere(0.55, -0.65, 0.2, 0.35, bsdf=_diffuse(0.3, 0.3, 0.75)),
    )  # fmt: skip


def mi_transform(place: list[float], turn: float, size: float) -> Any:
    """A thing's place."""
    import mitsuba as mi

    return mi.ScalarTransform4f().translate(place).rotate([0, 1, 0], turn).scale(size)


def _fence() -> dict[str, Any]:
    """Rods thinner than a pixel before a bright background, with their shadows."""
    rods = {
        f"rod{i}": {"type": "cylinder", "p0": [x, -1, 0.5], "p1": [x + 0.06, 0.5, 0.5], "radius": 0.006,
                    "bsdf": _diffuse(0.05, 0.05, 0.05)}
        for i, x in enumerate(np.linspace(-0.9, 0.9, 19).tolist())
    }  # fmt: skip
    return _scene(
        [0, 0.1, 3.2], [0, -0.1, 0], 48, **_room((0.5, 0.45, 0.4)), **rods,
        lamp=_wall([0.5, 1.19, 0.9], [1, 0, 0], 90, 0.15, _diffuse(0, 0, 0)) | {"emitter": _lamp(240, 228, 204)},
    )  # fmt: skip


def _mirror() -> dict[str, Any]:
    """A mirror and a glossy floor, in which albedo and normals show nothing of what is seen."""
    checks = {"type": "checkerboard", "to_uv": mi_transform([0, 0, 0], 0, 6)}
    room = _room((0.6, 0.6, 0.6))
    room["floor"]["bsdf"] = {
        "type": "roughplastic",
        "alpha": 0.08,
        "diffuse_reflectance": {"type": "rgb", "value": 0.1},
    }
    room["left"]["bsdf"] = {"type": "diffuse", "reflectance": checks}
    return _scene(
        [0, 0.2, 3.2], [0, -0.2, 0], 48, **room,
        mirror=_sphere(-0.35, -0.45, -0.3, 0.5, bsdf={"type": "conductor", "material": "none"}),
        ball=_sphere(0.6, -0.7, 0.4, 0.3, bsdf={"type": "diffuse", "reflectance": checks}),
        lamp=_sphere(0.7, 0.8, 0.3, 0.15, emitter=_lamp(18, 18, 16)),
    )  # fmt: skip


def _fog() -> dict[str, Any]:
    """Thin fog around a lamp in view: light without a surface."""
    return _scene(
        [0, 0.1, 3.2], [0, 0, 0], 48, **_room((0.4, 0.45, 0.5)), path="volpath",
        fog={"type": "cube", "to_world": mi_transform([0, 0, -0.2], 0, 1.15), "bsdf": {"type": "null"},
             "interior": {"type": "homogeneous", "albedo": 0.9, "sigma_t": 0.4}},
        lamp=_sphere(-0.3, 0.3, 0.1, 0.1, emitter=_lamp(25, 22, 16)),
        ball=_sphere(0.5, -0.6, 0.3, 0.35, bsdf=_diffuse(0.7, 0.3, 0.2)),
    )  # fmt: skip


def _night() -> dict[str, Any]:
    """Many coloured lamps, a few pixels wide, on dark things under a dim sky."""
    rng = np.random.default_rng(5)
    lamps = {
        f"lamp{i}": _sphere(*(rng.uniform(-1, 1, 3) * [1.2, 0.8, 0.8]).tolist(), float(rng.uniform(0.015, 0.04)),
                            emitter=_lamp(*(rng.uniform(2, 40, 3)).tolist()))
        for i in range(24)
    }  # fmt: skip
    return _scene(
        [0, 0.1, 3.2], [0, 0, 0], 48, **lamps,
        floor=_wall([0, -1, 0], [1, 0, 0], -90, 3, _diffuse(0.2, 0.18, 0.15)),
        ball=_sphere(0, -0.5, 0, 0.5, bsdf={"type": "plastic", "diffuse_reflectance": {"type": "rgb", "value": 0.15}}),
        sky={"type": "constant", "radiance": {"type": "rgb", "value": [0.02, 0.025, 0.04]}},
    )  # fmt: skip


SCENES = {"bulbs": _bulbs, "glass": _glass, "texture": _texture, "indirect": _indirect}
"""Scenes on which constants of the method were chosen."""
HELD_OUT = {"fence": _fence, "mirror": _mirror, "fog": _fog, "night": _night}
"""Scenes on which none was."""
