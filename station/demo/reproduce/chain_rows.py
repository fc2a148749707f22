"""Chapters 6 and 10 of Sorel's thesis by the thesis's own chain: Algorithm II, then Algorithm I with its solver. The
thesis's map is not published. A texture replaces it, whose blurred photographs have the same errors."""

from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from procedures.restoration.joint.data_term import restore_picture
from procedures.restoration.masks.blur_models import uniform_motion
from procedures.restoration.masks.blur_operator import MaskStack
from station.demo.reproduce import scenes
from station.demo.reproduce.algorithm_1 import Alternation, algorithm_1, data_term
from station.demo.reproduce.figures import Curve, curves, pictures
from station.demo.reproduce.restoration_rows import NOISE_WORDS, NOISES, SMALL, WEIGHT, first_depth_of, restored_at
from station.demo.reproduce.row import Order, RowValues, Setting, Values, ordered

Array = npt.NDArray[np.float64]

ITERATIONS = (1, 2, 5, 10, 20, 50, 100, 200)
CHAIN = Alternation(WEIGHT, depth_weight=0.01)
"""The thesis's scheme 50 x (8 + 10) + 100; it does not state lambda_w."""
MODERATE = 3
"""Number of levels of noise up to 20 dB."""
SHORT_ERROR, SHORT_PX = 0.25, 2  # error of the thesis's first depth, and a short range of such errors, pixels


def _pairs(shape: Array) -> list[scenes.Pair]:
    return [scenes.pair(shape, noise) for noise in NOISES]


def _errors(pairs: Sequence[scenes.Pair], restored: Sequence[Array]) -> list[float]:
    return [pair.error(u) for pair, u in zip(pairs, restored, strict=True)]


def _direct(pairs: Sequence[scenes.Pair], depths: Sequence[Array], stacks: list[MaskStack]) -> list[Array]:
    return [restored_at(pair, stacks, w) for pair, w in zip(pairs, depths, strict=True)]


def _by_noise(restored: Sequence[Array]) -> list[tuple[str, Array]]:
    return list(zip(NOISE_WORDS, restored, strict=True))


def _grows(values: Values) -> bool:
    return all(a < b for a, b in pairwise(values))


@ordered(Order("conjugate gradients are ahead of steepest descent after 200 iterations", lambda v: v[0] > 1))
def restoration_solvers(setting: Setting) -> RowValues:
    """Error term after n iterations of steepest descent and conjugate gradients: known depth, no noise, no prior."""
    shape = scenes.comatic()
    pair = scenes.pair(shape, None, SMALL)
    data = data_term(pair.z, scenes.stacks(shape))
    data.focus(np.pad(pair.w, data.R, mode="edge").astype(np.float32))
    begin = data.mean()

    def error(u: npt.NDArray[np.floating]) -> float:
        return float(np.sum(data.residual(u) ** 2) / 2)

    conjugate = [error(restore_picture(data, begin, 0.0, n)) for n in ITERATIONS]
    steepest, u = [], begin
    for n in range(1, ITERATIONS[-1] + 1):
        u = restore_picture(data, u, 0.0, 1)  # the first iteration of conjugate gradients is one of steepest descent
        if n in ITERATIONS:
            steepest.append(error(u))
    shown = [Curve("steepest descent", ITERATIONS, steepest, "o-"), Curve("conjugate gradients", ITERATIONS, conjugate)]
    figure = curves("solvers", shown, x="iterations", y="error term", log="xy")
    start, at_100 = error(begin), steepest[ITERATIONS.index(100)]
    return RowValues((steepest[-1] / conjugate[-1], (at_100 - steepest[-1]) / start, conjugate[-1] / start), (figure,))


@ordered(
    Order(
        "the error grows with the noise; up to 20 dB it is larger than with the right mask",
        lambda v: _grows(v[:4]) and v[4] > 0.9 and v[5] > 1,
    )
)
def restoration_gaussian(setting: Setting) -> RowValues:
    """Restoration at the known depth with a Gaussian instead of the true mask, four levels of noise."""
    shape = scenes.comatic()
    right, wrong = scenes.stacks(shape), scenes.gaussian_stacks(shape)
    pairs = _pairs(shape)
    restored = [restored_at(pair, wrong, pair.w) for pair in pairs]
    errors = _errors(pairs, restored)
    best = [pair.error(restored_at(pair, right, pair.w)) for pair in pairs[:MODERATE]]
    over_blurred = errors[0] / pairs[0].error(pairs[0].z[0, 0])
    over_right = min(a / b for a, b in zip(errors, best, strict=False))
    return RowValues((*errors, over_blurred, over_right), (pictures("gaussian", _by_noise(restored)),))


@ordered(
    Order(
        "the errors grow with the noise, and up to 20 dB a Gaussian mask has the larger ones",
        lambda v: _grows(v[:4]) and _grows(v[4:]) and all(a < b for a, b in zip(v[:MODERATE], v[4:], strict=False)),
    )
)
def restoration_direct(setting: Setting) -> RowValues:
    """Restoration directly at the depth of Algorithm II, with the true and with a Gaussian mask."""
    shape = scenes.comatic()
    right, wrong = scenes.stacks(shape), scenes.gaussian_stacks(shape)
    pairs = _pairs(shape)
    depths = [first_depth_of(pair, right) for pair in pairs]
    by_right, by_wrong = (_direct(pairs, depths, stacks) for stacks in (right, wrong))
    figures = (pictures("direct", _by_noise(by_right)), pictures("direct-gaussian", _by_noise(by_wrong)))
    return RowValues((*_errors(pairs, by_right), *_errors(pairs, by_wrong)), figures)


LOWERS = Order(
    "from Algorithm II's depth on, Algorithm I lowers the errors of w and of the picture", lambda v: max(v[-2:]) < 1
)


def _chained(
    pairs: Sequence[scenes.Pair], depths: Sequence[Array], stacks: list[MaskStack]
) -> tuple[list[Array], list[list[float]]]:
    """w after Algorithm I, and errors: first of w, then of w, first of the picture, then of the picture."""
    results = [algorithm_1(pair.z, stacks, w, CHAIN) for pair, w in zip(pairs, depths, strict=True)]
    maps = [w for _, w in results]
    of_w = [[pair.w_error(w) for pair, w in zip(pairs, one, strict=True)] for one in (depths, maps)]
    return maps, of_w + [_errors(pairs, one) for one in (_direct(pairs, depths, stacks), [u for u, _ in results])]


def _gains(errors: list[list[float]]) -> list[float]:
    """Greatest ratios of errors of w and of the picture, then over first, up to 20 dB."""
    return [max(b / a for a, b in zip(errors[i][:MODERATE], errors[i + 1], strict=False)) for i in (0, 2)]


@ordered(LOWERS)
def restoration_chain(setting: Setting) -> RowValues:
    """Algorithm II, then Algorithm I with the thesis's solver, out of focus, with the true and with a Gaussian mask."""
    shape = scenes.comatic()
    right, pairs = scenes.stacks(shape), _pairs(shape)
    depths = [first_depth_of(pair, right) for pair in pairs]
    maps, errors = _chained(pairs, depths, right)
    _, (_, w_wrong, _, wrong_picture) = _chained(pairs, depths, scenes.gaussian_stacks(shape))
    _, w, _, picture = errors
    noisy = gaussian_filter(np.random.default_rng(0).standard_normal(scenes.SHAPE), SHORT_PX)
    noisy = np.clip(pairs[0].w + SHORT_ERROR / noisy.std() * noisy, 0, None)
    _, short = _chained(pairs[:1], [noisy], right)
    before, after, direct, restored = (one[0] for one in short)
    remark = (
        f"Without noise, from the true w with errors of {before:.2f} pixels that are correlated over {SHORT_PX}, "
        f"Algorithm I reaches {after:.3f}; the picture's error falls from {direct:.2f} to {restored:.2f} grey levels."
    )
    figures = (pictures("chain-first", _by_noise(depths)), pictures("chain", _by_noise(maps)))
    values = (*w, *w_wrong, *picture, *wrong_picture, w_wrong[0] / w[0], *_gains(errors))
    return RowValues(values, figures, remark)


@ordered(LOWERS)
def restoration_chain_motion(setting: Setting) -> RowValues:
    """Algorithm II, then Algorithm I with the thesis's solver, motion along x, four levels of noise."""
    shape = uniform_motion()
    stacks, pairs = scenes.stacks(shape), _pairs(shape)
    depths = [first_depth_of(pair, stacks, axis="x") for pair in pairs]
    maps, errors = _chained(pairs, depths, stacks)
    figures = (pictures("chain-motion-first", _by_noise(depths)), pictures("chain-motion", _by_noise(maps)))
    return RowValues((*chain.from_iterable(errors), *_gains(errors)), figures)
