"""Two, three and four distances of a wall rendered by Mitsuba 3, whose reconstruction filter is the camera's PSF.

The filter is a Gaussian of 0.5 pixel, which Mitsuba tabulates in 31 steps; the truth is the tabulated one. Each
photograph is a perspective view of one textured, luminous sheet, with stratified samples and noise of 0.6 % of white
added.

python -m tests.benchmarks.wall_distances [walls, default 2]; needs `mitsuba`
"""

import sys

import mitsuba as mi
import numpy as np

from procedures import Plane, TwoPhotoParameters, estimate_psf_of_wall
from procedures.numbers import HORIZONTAL, MTF_NYQUIST
from procedures.two_photo.prediction import predicted_uncertainty, together
from tests.procedures.two_photo.endless import WALLS
from tests.procedures.two_photo.wall import samples_of

NEAR_PX, TEXELS, SAMPLES, NOISE, WIDTH = 600, 4096, 144, 0.006, 0.5
RATIOS = (3.2, 4.0, 5.0)
PIXEL_RAD, STEPS = 1e-3, 31
CENTRE = (0.003, -0.002)
SETS = ((4.0,), (3.2,), (3.2, 4.0), (3.2, 4.0, 5.0))


def tabulated(f: np.ndarray) -> np.ndarray:
    """OTF along one axis of the filter as Mitsuba applies it: constant over each step of its table."""
    edges = np.linspace(0, 4 * WIDTH, STEPS + 1)
    values = np.exp(-(edges[:-1] ** 2) / (2 * WIDTH**2)) - np.exp(-8.0)
    waves = 2 * edges[:, None] * np.sinc(2 * edges[:, None] * np.ravel(f))  # integrals from -x to x
    return np.reshape(values @ np.diff(waves, axis=0) / (2 * values @ np.diff(edges)), np.shape(f))


def photograph(texture: np.ndarray, ratio: float, seed: int) -> np.ndarray:
    """The part of the wall that fills the near photograph, from `ratio` times its distance."""
    side = round(NEAR_PX / ratio)
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 1},
        "sensor": {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(side * PIXEL_RAD / 2))),
            "to_world": mi.ScalarTransform4f().look_at([*CENTRE, ratio], [*CENTRE, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": side, "height": side, "pixel_format": "luminance",
                     "rfilter": {"type": "gaussian", "stddev": WIDTH}},
            "sampler": {"type": "stratified", "sample_count": SAMPLES, "seed": seed},
        },
        "wall": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().scale(0.5 * 1.15 * NEAR_PX * PIXEL_RAD),
            "emitter": {"type": "area", "radiance": {"type": "bitmap", "bitmap": mi.Bitmap(texture), "raw": True}},
        },
    })  # fmt: skip
    image = np.array(mi.render(scene, spp=SAMPLES), np.float64)[..., 0]
    return image + np.random.default_rng(seed).normal(0, NOISE, image.shape)


def wall(kind: str, seed: int) -> None:
    """Errors and uncertainties of one wall."""
    texture = np.clip(WALLS[kind](TEXELS, np.random.default_rng(seed)), 0, 1).astype(np.float32)
    taken = {ratio: photograph(texture[..., None], ratio, 10 * seed + n) for n, ratio in enumerate((1.0, *RATIOS))}
    truth = samples_of(lambda fx, fy: tabulated(fx) * tabulated(fy), 3, 13)
    each = {ratio: predicted_uncertainty(taken[1.0].astype(np.float32), ratio, NOISE) for ratio in RATIOS}
    for ratios in SETS:
        planes = [Plane("Y", taken[ratio].astype(np.float32), 1 / 65535) for ratio in (1.0, *ratios)]
        outcome = estimate_psf_of_wall(planes, TwoPhotoParameters(s=3, k=13))
        if outcome.value is None:
            print(f"{kind:7s} {ratios}: {outcome.reason}")
            continue
        error = np.linalg.norm(outcome.value.psf.h - truth) / np.linalg.norm(truth)
        reported = outcome.value.quality.budgets[MTF_NYQUIST[HORIZONTAL]]["noise"]
        predicted = together([each[ratio] for ratio in ratios])
        print(f"{kind:7s} {ratios!s:18s} {outcome.verdict:9s} error {error:.4f}; by noise, MTF at Nyquist: reported "
              f"{reported:.4f}, predicted {predicted:.4f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    mi.set_variant("scalar_rgb")
    for index in range(int(sys.argv[1]) if len(sys.argv) > 1 else 2):
        wall(list(WALLS)[index % len(WALLS)], 1 + index)
