"""Nodes of different supports are widened to one without changing their PSFs."""

import numpy as np
import pytest

from procedures import Refused, otf
from procedures.field.interpolate import widened, with_common_support
from procedures.psf import Psf, PsfTail
from procedures.psf_field import Node

S = 4


def psf(k: int = 9, s: int = S, with_tail: bool = True) -> Psf:
    x = (np.arange(k) - k // 2) / s
    h = np.exp(-((x / 0.6) ** 2) - (x[:, None] / 0.5) ** 2)
    n = k * k
    tail = PsfTail(np.array([0.05, 0.01, 0.004, -0.003, 0.002, 0.001]), 1e-6 * np.eye(6), np.zeros((n, 6)))
    return Psf(h / h.sum(), s, 1e-8 * np.eye(n), tail if with_tail else PsfTail.none(n))


def nodes(*psfs: Psf) -> list[Node]:
    return [Node(np.zeros(2), np.eye(2), np.zeros(2), one, "a.dng", number) for number, one in enumerate(psfs, 1)]


def test_widening_keeps_the_transfer_function_with_the_covariance_of_repeated_widening(rng):
    narrow = psf()
    wide = widened(narrow, 17)
    assert wide.h.sum() == pytest.approx(1)
    f = np.linspace(0, 2, 21)
    for turn in (0.0, 0.4, 1.2):
        # both kernels end at one circle and are made of the same powers of r: nothing but rounding differs
        here, there = (otf(one, f * np.cos(turn), f * np.sin(turn)) for one in (narrow, wide))
        np.testing.assert_allclose(there, here, atol=1e-12)
    assert wide.tail_density_px == pytest.approx(narrow.tail_density_px)
    root = np.sqrt(np.diag(narrow.parameter_covariance))
    drawn = []
    for _ in range(300):
        p = narrow.parameters + root * rng.standard_normal(len(root))
        drawn.append(widened(Psf.of(p, narrow.parameter_covariance, 9, S), 13).parameters)
    expected = np.diag(widened(narrow, 13).parameter_covariance)
    # a variance of 300 draws is right to 8 %, one sigma; the largest of 175 may be off by 3.5 of them
    np.testing.assert_allclose(np.var(drawn, axis=0), expected, rtol=0.3)
    root = rng.standard_normal((15, 15))
    p, C = rng.uniform(0.5, 1, 15), root @ root.T
    step = 1e-6 * np.eye(15)
    unit = [Psf.of_unit_sum(p + d, C, 3, S).parameters for d in (*step, *-step)]
    J = (np.array(unit[:15]) - unit[15:]).T / 2e-6
    np.testing.assert_allclose(Psf.of_unit_sum(p, C, 3, S).parameter_covariance, J @ C @ J.T, atol=1e-6)
    assert [node.psf.k for node in with_common_support(nodes(psf(9), psf(13)))] == [13, 13]


@pytest.mark.parametrize(
    ("psfs", "words"),
    [
        ((psf(), psf(s=3)), "the same samples per pixel; chart 1 of a.dng has s = 4, chart 2 of a.dng has s = 3"),
        ((psf(), psf(with_tail=False)), "chart 1 of a.dng has 6 tail shapes and chart 2 of a.dng has no tail"),
        ((psf(9, with_tail=False), psf(13, with_tail=False)), "chart 1 of a.dng has k = 9, another k = 13"),
    ],
)
def test_nodes_of_different_samplings_are_refused(psfs, words):
    with pytest.raises(Refused, match=words):
        with_common_support(nodes(*psfs))
