import numpy as np
import pytest

from station.demo.reproduce import scenes
from station.demo.reproduce.algorithm_1 import Alternation, algorithm_1, data_term
from station.demo.reproduce.restoration_rows import restored_at


def test_algorithms_of_the_chain_lower_errors_and_cost():
    pair = scenes.pair(scenes.comatic(), None, (64, 64), picture=scenes.texture)
    stacks = scenes.stacks(scenes.comatic())
    wrong = pair.w + 0.3
    sharp, w = algorithm_1(pair.z, stacks, wrong, Alternation(3e-4, 1e-4, rounds=5, final=50))
    assert pair.w_error(w) < pair.w_error(wrong)
    assert pair.error(sharp) < pair.error(restored_at(pair, stacks, wrong))
    data = data_term(pair.z, scenes.stacks(scenes.comatic()))
    w = np.pad(pair.w + 0.3, data.R, mode="edge").astype(np.float32)
    u = data.mean()
    data.focus(w)
    downhill = data.change_adjoint(u, data.residual(u))[-1]
    step = 1e-2 / np.abs(downhill).max()
    costs = []
    for sign in (-1, 1):
        data.focus(w + np.float32(sign * step) * downhill)
        costs.append(float(np.sum(data.residual(u).astype(np.float64) ** 2) / 2))
    # central difference; masks are linear in w between levels, so that a few per cent of pixels cross a kink
    assert (costs[0] - costs[1]) / (2 * step) == pytest.approx(float(np.sum(downhill**2)), rel=0.05)
    shape = scenes.comatic()
    y, x = np.mgrid[-scenes.REACH : scenes.REACH + 1, -scenes.REACH : scenes.REACH + 1]
    for right, wrong in zip(scenes.stacks(shape), scenes.gaussian_stacks(shape), strict=True):
        for axis in (y, x):
            # masks are sampled at whole pixels: their centroids to a tenth
            assert np.sum(axis * wrong.at(4.0)) == pytest.approx(np.sum(axis * right.at(4.0)), abs=0.1)
