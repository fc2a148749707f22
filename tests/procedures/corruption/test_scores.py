"""Strengths of corruptions in linear systems whose truth is known."""

import numpy as np
import pytest

from procedures.corruption.directions import GHOST_PX, filters, mask, mirrored
from procedures.corruption.family import SampleGroup, Strength, strengths

Array = np.ndarray


def parts(rng: np.random.Generator, truth: Array, counts: tuple[int, ...]) -> tuple[list[SampleGroup], list[Array]]:
    """Parts that share five columns, with two of their own, and directions of these strengths in unit noise."""
    made, directions = [], []
    for count in counts:
        shared, own = rng.standard_normal((count, 5)), rng.standard_normal((count, 2))
        along = rng.standard_normal((count, len(truth))) + shared[:, :1] + own[:, :1]
        y = shared @ [3.0, -2, 1, 0.5, 4] + own @ [7.0, -1] + along @ truth + rng.standard_normal(count)
        made.append(SampleGroup(shared.astype(np.float32), own, y, np.arange(count) * 10 // count))
        directions.append(along)
    gram = sum(one.projected_gram() for one in made)
    return made, [directions, gram]


def test_strengths_of_parts_are_those_of_least_squares(rng):
    truth = 0.2
    scores = []
    for _ in range(60):
        made, (directions, gram) = parts(rng, np.array([truth]), (300, 200))
        (one,) = strengths(made, directions, gram, 1.0)
        scores.append((one.value - truth) / one.uncertainty)
    # the uncertainty is the larger of two that agree to a quarter: the scores are a little narrower than normal
    assert np.mean(scores) == pytest.approx(0, abs=3 / 60**0.5)
    assert 0.65 < np.std(scores) < 1.2
    made, (directions, gram) = parts(rng, np.array([0.5]), (300,))
    empty = SampleGroup(np.zeros((0, 5), np.float32), np.zeros((0, 2)), np.zeros(0), np.zeros(0, int))
    (alone,) = strengths(made, directions, gram, 1.0)
    (both,) = strengths([*made, empty], [*directions, np.zeros((0, 1))], gram, 1.0)
    assert both.value == pytest.approx(alone.value, rel=1e-9)
    assert Strength().score == 0
    assert Strength().unseen == 0
    samples = rng.random((60, 81)).astype(np.float32)
    whole = mirrored(samples, (0, 0), samples.shape)
    assert mirrored(samples, (13, 7), (20, 30)) == pytest.approx(whole[7:27, 13:43], abs=1e-12)
    # white noise of variance 1/12 after a Gaussian, mirrored
    assert np.var(whole[15:-15, 15:-15]) == pytest.approx(1 / 12 / (4 * np.pi * GHOST_PX**2), rel=0.4)
    slope = np.add.outer(0.01 * np.arange(40), 0.02 * np.arange(50))
    for name, change in (*filters(slope).items(), ("mask", mask(slope, 2.0))):
        assert np.abs(change[10:-10, 10:-10]).max() < 1e-6, name
