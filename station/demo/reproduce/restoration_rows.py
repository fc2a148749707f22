"""Chapter 10 of Sorel's thesis: simulated restorations at several levels of noise and weights.

The thesis's picture, an old map, is not published; a drawing replaces it (`scenes`). Errors are root mean squares, in
grey levels of 256 and pixels of w; the thesis calls them MSE.
"""

from dataclasses import replace

import numpy as np

from procedures.numerics.arrays import Array
from procedures.pattern import Chart
from procedures.restoration.joint.data_term import restore_picture
from procedures.restoration.joint.estimate import RestorationParameters, first_depth, noise_of, restore
from procedures.restoration.masks.blur_models import uniform_motion
from procedures.restoration.masks.blur_operator import MaskStack
from procedures.restoration.masks.gaussian_constant import gaussian_constant
from procedures.restoration.masks.thin_lens import CameraSetting
from simulators.world.scene import Scene
from station.demo.reproduce import cameras, scenes
from station.demo.reproduce.algorithm_1 import data_term
from station.demo.reproduce.figures import Curve, curves, pictures
from station.demo.reproduce.row import Order, RowValues, Setting, increases, ordered

NOISES: tuple[float | None, ...] = (None, 40.0, 20.0, 10.0)
NOISE_WORDS = ("no noise", "40 dB", "20 dB", "10 dB")
WEIGHTS, MORE_WEIGHTS = (3e-4, 1e-3, 3e-3), (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
WEIGHT = 1e-3
"""lambda_u in the units of our cost; the thesis's is 5e-3, in units that it does not state. With this one the error of
Figure 10.3 (a), which is the regularisation's, is the thesis's on the texture."""
STEPS = 100
SMALL = (122, 178)
"""Half the thesis's frame along each axis."""


def restored_at(
    pair: scenes.Pair, stacks: list[MaskStack], w: Array, weight: float = WEIGHT, steps: int = STEPS
) -> Array:
    """The picture (H, W) of least cost at a depth w, Tikhonov, by conjugate gradients."""
    data = data_term(pair.z, stacks)
    R = data.R
    data.focus(np.pad(w, R, mode="edge").astype(np.float32))
    picture = restore_picture(data, data.mean(), weight, steps)
    return np.asarray(picture[0, R:-R, R:-R], dtype=np.float64)


BLUR_CIRCLES_PX = (1.5, 2.0, 3.0, 4.0)
CHART_PX = 150.0
WIDE_OPEN = 2.8


@ordered(Order("sigma is proportional to the radius of the blur circle", lambda v: v[0] <= 0.05))
def restoration_sigma(setting: Setting) -> RowValues:
    """A Gaussian of sigma = k r for defocus: k by the noise chart, photographed out of focus by a known amount."""
    chart, camera = Chart.from_seed(), cameras.green_camera(WIDE_OPEN, 200)
    where = camera.place(chart, pixels=CHART_PX)
    distance_mm = where.pose.centre_mm[2]
    psfs, radii = [], []
    for seed, radius in enumerate(BLUR_CIRCLES_PX):
        sharp = CameraSetting(camera.lens.focal_length_mm, WIDE_OPEN, distance_mm, camera.pitch_um)
        blurred = replace(sharp, focus_mm=1 / (1 / distance_mm - radius / sharp.scale_px_mm))
        defocused = replace(camera, focus_mm=blurred.focus_mm)
        rng, exposure_s = np.random.default_rng(seed), cameras.exposure_s(camera)
        shot = defocused.photograph(Scene((where,)), rng, exposure_s=exposure_s)
        psfs.append(cameras.estimated(cameras.plane_of(shot), chart, s=2, k=4 * round(radius) + 9).psf)
        radii.append(float(blurred.blur_radius_px(distance_mm)))
    lens = gaussian_constant(psfs, radii)
    figures = (
        curves("sigma", [Curve("nearest Gaussian", radii, lens.sigmas_px, "o"),
                         Curve("k r", radii, lens.k.value * np.array(radii))],
               x="radius of the blur circle, pixels", y="sigma, pixels"),
        pictures("sigma-psf", [(f"r = {r:.1f}", psf.h) for r, psf in zip(radii, psfs, strict=True)], cmap="viridis"),
    )  # fmt: skip
    return RowValues((lens.departure, lens.k.value), figures, f"k = {lens.k.value:.3f} ± {lens.k.uncertainty:.3f}.")


@ordered(increases("the error grows with the noise", (0, 4)))
def restoration_known(setting: Setting) -> RowValues:
    """Restoration at the known depth, four levels of noise, 100 steps of conjugate gradients, Tikhonov."""
    shape = scenes.comatic()
    right, wrong = scenes.stacks(shape), scenes.gaussian_stacks(shape)
    pairs = [scenes.pair(shape, noise) for noise in NOISES]
    weights = MORE_WEIGHTS if setting.full else WEIGHTS
    grid = np.array([[pair.error(restored_at(pair, right, pair.w, w)) for w in weights] for pair in pairs])
    at = weights.index(WEIGHT)
    blurred = pairs[0].error(pairs[0].z[0, 0])
    gaussian = pairs[0].error(restored_at(pairs[0], wrong, pairs[0].w))
    longer = pairs[0].error(restored_at(pairs[0], right, pairs[0].w, WEIGHT, 2 * STEPS))
    clear = restored_at(pairs[1], right, pairs[1].w)
    figures = (
        pictures(
            "known-pictures",
            [("true", pairs[1].sharp), ("blurred, 40 dB", pairs[1].z[0, 0]), ("restored", clear), ("w", pairs[1].w)],
            columns=2,
        ),
        curves(
            "known-grid",
            [Curve(words, weights, row, "o-") for words, row in zip(NOISE_WORDS, grid, strict=True)],
            x="weight of the picture's prior",
            y="error, grey levels",
            log="xy",
        ),
    )
    measured = (*grid[:, at], gaussian / blurred, longer / grid[0, at], grid[0, at - 1] / grid[0, at])
    return RowValues((*map(float, measured), float(grid[3, at - 1] / grid[3, at])), figures)


UNKNOWN_ORDER = increases("the errors of picture and w grow with the noise from 40 dB on", (1, 4), (5, 8))


def _grid(shape: Array, name: str) -> RowValues:
    stacks = scenes.stacks(shape)
    pairs = [scenes.pair(shape, noise, picture=scenes.map_drawing, picture_seed=7) for noise in NOISES]
    restored = [restore(list(pair.z), stacks).result() for pair in pairs]
    w = [pair.w_error(one.w) for pair, one in zip(pairs, restored, strict=True)]
    picture = [pair.error(one.sharp[0]) for pair, one in zip(pairs, restored, strict=True)]
    shown = [(f"w, {words}", one.w) for words, one in zip(NOISE_WORDS, restored, strict=True)]
    shown += [(words, one.sharp[0]) for words, one in zip(NOISE_WORDS, restored, strict=True)]
    return RowValues((*w, *picture), (pictures(name, shown),))


@ordered(Order("the restored picture has a smaller error than the blurred photograph", lambda v: v[3] < 1))
def restoration_40db(setting: Setting) -> RowValues:
    """Picture and depth from two photographs out of focus, noise of 40 dB, a quarter of the frame."""
    shape = scenes.comatic()
    stacks = scenes.stacks(shape)
    pair = scenes.pair(shape, 40.0, SMALL)
    restored = restore(list(pair.z), stacks).result()
    picture = pair.error(restored.sharp[0])
    best = pair.error(restored_at(pair, stacks, pair.w))
    figure = pictures(
        "unknown-40",
        [("blurred", pair.z[0, 0]), ("restored", restored.sharp[0]), ("w estimated", restored.w), ("w true", pair.w)],
        columns=2,
    )
    return RowValues((pair.w_error(restored.w), picture, picture / best, picture / pair.error(pair.z[0, 0])), (figure,))


@ordered(UNKNOWN_ORDER)
def restoration_defocus(setting: Setting) -> RowValues:
    """Picture and depth from two photographs out of focus with coma, four levels of noise."""
    return _grid(scenes.comatic(), "unknown-defocus")


@ordered(UNKNOWN_ORDER)
def restoration_motion(setting: Setting) -> RowValues:
    """Picture and depth from two photographs blurred by motion along x, four levels of noise."""
    return _grid(uniform_motion(), "unknown-motion")


@ordered(increases("the error grows with the noise from 40 dB on", (1, 4)))
def restoration_start(setting: Setting) -> RowValues:
    """Depth maps directly from the filter-based Algorithm II, smoothed by an 11 × 11 median."""
    shape = scenes.comatic()
    stacks = scenes.stacks(shape)
    textures = [[scenes.pair(shape, noise, picture_seed=n) for noise in NOISES] for n in range(TEXTURES)]
    drawing = scenes.pair(shape, None, picture=scenes.map_drawing, picture_seed=7)
    depths = [[first_depth_of(pair, stacks) for pair in pairs] for pairs in textures]
    errors = [[pair.w_error(w) for pair, w in zip(*one, strict=True)] for one in zip(textures, depths, strict=True)]
    blurred = [[pairs[0].error(photograph[0]) for photograph in pairs[0].z] for pairs in textures]
    matched = ", ".join(f"{pair.w_error(first_depth_of(pair, stacks, 'matched')):.2f}" for pair in textures[0])
    drawn = first_depth_of(drawing, stacks)
    first, second = _mean(blurred)
    remark = (
        f"The blurred textures have errors of {first:.1f} and {second:.1f} grey levels, the thesis's map 17.2 and 19.2."
        f" Without noise w has errors of {min(e[0] for e in errors):.2f} to {max(e[0] for e in errors):.2f} pixels for"
        f" these textures, and {drawing.w_error(drawn):.2f} for a drawing of a map, which has areas without"
        f" texture; {drawing.away_from_steps(drawn):.2f} away from depth steps. The program's default start has errors"
        f" of {matched} pixels on the first texture."
    )
    figure = pictures("start", [(words, w) for words, w in zip(NOISE_WORDS, depths[0], strict=True)])
    return RowValues(_mean(errors), (figure,), remark)


def first_depth_of(pair: scenes.Pair, stacks: list[MaskStack], start: str = "symmetric", axis: str = "both") -> Array:
    """The first depth (H, W) by one of the program's algorithms."""
    p = RestorationParameters(depth_start=start, symmetric_axis=axis)
    return np.asarray(first_depth(pair.z, stacks, noise_of(pair.z, stacks), p).w, dtype=np.float64)


def _mean(lines: list[list[float]]) -> tuple[float, ...]:
    return tuple(np.mean(lines, axis=0).tolist())


TEXTURES = 4
