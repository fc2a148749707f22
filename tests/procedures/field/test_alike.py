"""Nodes of different supports are widened to one, and the light they tell of stays where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from procedures.field.alike import alike, widened
from procedures.outcome import Refused
from procedures.psf import Psf, PsfTail
from procedures.psf_field import Node
from procedures.quality import otf

S = 4


def psf(k: int = 9, s: int = S, with_tail: bool = True) -> Psf:
    x = (np.arange(k) - k // 2) / s
    h = np.exp(-((x / 0.6) ** 2) - (x[:, None] / 0.5) ** 2)
    n = k * k
    tail = PsfTail(np.array([0.05, 0.01, 0.004, -0.003, 0.002, 0.001]), 1e-6 * np.eye(6), np.zeros((n, 6)))
    return Psf(h / h.sum(), s, 1e-8 * np.eye(n), tail if with_tail else PsfTail.none(n))


def node(one: Psf, number: int = 1) -> Node:
    return Node(np.zeros(2), np.eye(2), np.zeros(2), one, "a.dng", number)


def test_a_widened_psf_says_the_same_of_the_light():
    narrow = psf()
    wide = widened(narrow, 17)
    assert wide.h.sum() == pytest.approx(1)
    f = np.linspace(0, 2, 21)
    for turn in (0.0, 0.4, 1.2):
        # both kernels end at one circle and are made of the same powers of r: nothing but rounding differs
        here, there = (otf(one, f * np.cos(turn), f * np.sin(turn)) for one in (narrow, wide))
        np.testing.assert_allclose(there, here, atol=1e-12)
    assert wide.tail_density_px == pytest.approx(narrow.tail_density_px)


def test_its_covariance_is_that_of_repeated_widening(rng):
    narrow = psf()
    root = np.sqrt(np.diag(narrow.parameter_covariance))
    drawn = []
    for _ in range(300):
        p = narrow.parameters + root * rng.standard_normal(len(root))
        drawn.append(widened(Psf.of(p, narrow.parameter_covariance, 9, S), 13).parameters)
    expected = np.diag(widened(narrow, 13).parameter_covariance)
    # a variance of 300 draws is right to 8 %, one sigma; the largest of 175 may be off by 3.5 of them
    np.testing.assert_allclose(np.var(drawn, axis=0), expected, rtol=0.3)


def test_nodes_of_different_supports_are_put_together():
    found = alike([node(psf(9)), node(psf(13), 2)])
    assert [one.psf.k for one in found] == [13, 13]
    assert found[1].psf.h is not None
    assert found[0].number == 1


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (
            psf(s=3),
            "a field must have the same samples per pixel; chart 1 of a.dng has s = 4, chart 2 of a.dng has s = 3",
        ),
        (psf(with_tail=False), "chart 1 of a.dng has 6 shapes of a tail and chart 2 of a.dng has no tail"),
    ],
)
def test_nodes_that_cannot_be_put_together_are_named(other, words):
    with pytest.raises(Refused, match=words):
        alike([node(psf()), node(other, 2)])


def test_different_supports_without_tails_are_refused():
    bare = [replace(node(psf(k, with_tail=False)), number=k) for k in (9, 13)]
    with pytest.raises(Refused, match=r"chart 9 of a\.dng has k = 9, another k = 13"):
        alike(bare)
