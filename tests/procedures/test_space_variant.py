from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.signal import convolve2d

from procedures.field.models import Separate
from procedures.numerics.scattered import Polynomial
from procedures.outcome import BadParameter
from procedures.psf import Psf, PsfTail
from procedures.psf_field import Node, PsfField, SpaceVariantBlur, in_half_diagonals

S, K, SHAPE = 2, 7, (40, 56)


def gaussian(width_x: float, width_y: float) -> np.ndarray:
    x = (np.arange(K) - K // 2) / S
    h = np.exp(-((x / width_x) ** 2) - (x[:, None] / width_y) ** 2)
    return h / h.sum()


def field_of(psfs: list[np.ndarray], places: np.ndarray, r: int) -> PsfField:
    """A field that is linear between nodes, by its definition and not by a fit."""
    nodes = tuple(Node(p, np.eye(2), p, Psf(h, S, np.eye(K * K) * 1e-8)) for h, p in zip(psfs, places, strict=True))
    z = np.array([h.ravel() for h in psfs])
    V = np.linalg.svd(z - z.mean(axis=0), full_matrices=False)[2][:r]
    smoother = Polynomial(in_half_diagonals(places, SHAPE), np.ones(len(places)), 1)
    n = len(places)
    return PsfField(
        "Y", SHAPE, nodes, np.full(n, 1 / n), V, V, np.zeros(r), Separate("linear", smoother), np.zeros((r, r)),
        np.zeros((K * K, K * K)),
    )  # fmt: skip


@pytest.fixture
def places() -> np.ndarray:
    return np.array([(x, y) for y in (0.0, 39.0) for x in (0.0, 28.0, 55.0)])


@pytest.fixture
def varying(places) -> PsfField:
    return field_of([gaussian(0.5 + 0.01 * x, 0.6 + 0.01 * y) for x, y in places], places, 3)


@dataclass
class Pair:
    u: np.ndarray
    v: np.ndarray


@pytest.mark.parametrize("samples_per_px", [1, 2])
def test_the_adjoint_is_the_adjoint(varying, rng, samples_per_px):
    operator = SpaceVariantBlur(varying, samples_per_px)
    for shape in ((40, 56), (23, 31)):
        u, v = rng.standard_normal((2, *shape))
        forth, back = np.sum(v * operator.blur(u)), np.sum(u * operator.blur_adjoint(v))
        # rounding of sums of some thousand products
        assert abs(forth - back) < 1e-12 * np.linalg.norm(u) * np.linalg.norm(v)


def test_a_constant_field_is_a_convolution(places, rng):
    h = gaussian(0.7, 0.5)
    psfs = [h + 1e-3 * (i - 2.5) * (gaussian(0.6, 0.6) - h) for i in range(6)]
    field = field_of(psfs, places, 1)
    constant = replace(field, components=0 * field.components)
    u = rng.random((30, 41))
    blurred = SpaceVariantBlur(constant, S).blur(u)
    np.testing.assert_allclose(blurred, convolve2d(u, np.mean(psfs, axis=0), mode="same"), atol=1e-12)


def test_light_goes_to_the_psf_and_tail_of_its_place_and_is_kept(varying, places):
    operator = SpaceVariantBlur(varying, S)
    for row, column in ((20, 30), (60, 90)):
        u = np.zeros((80, 112))
        u[row, column] = 1.0
        seen = operator.blur(u)[row - K // 2 : row + K // 2 + 1, column - K // 2 : column + K // 2 + 1]
        expected = varying.samples(np.array([[column / S, row / S]]))[0]
        np.testing.assert_allclose(seen, expected, atol=1e-12)
    u = np.zeros((40, 56))
    u[15:25, 20:30] = 1.0
    assert SpaceVariantBlur(varying).blur(u).sum() == pytest.approx(u.sum(), rel=1e-9)
    tails = [0.03 + 0.001 * i for i in range(6)]
    field = with_tails(field_of([gaussian(0.5, 0.6)] * 6, places, 1), tails)
    operator = SpaceVariantBlur(field, S)
    # the shapes end at 64 samples; what a place receives from others is by their tails, of which 2 % differ over it
    np.testing.assert_allclose(operator.blur(np.ones((150, 160)))[64:-64, 64:-64], 1, rtol=0.02 * 0.035)
    point = np.zeros((150, 160))
    point[75, 80] = 1
    seen = operator.blur(point)
    near = seen[75 - K // 2 : 76 + K // 2, 80 - K // 2 : 81 + K // 2].sum()
    assert seen.sum() == pytest.approx(1)
    amount = field.parameters(np.array([[40.0, 37.5]]))[0, -1]
    assert near == pytest.approx(1 / (1 + amount))
    assert 0.03 < amount < 0.036


def with_tails(field: PsfField, tails: list[float]) -> PsfField:
    """The field with a far tail of these amplitudes at its nodes, and no other shape."""
    n = K * K
    nodes = []
    for node, amount in zip(field.nodes, tails, strict=True):
        tail = PsfTail(np.array([amount]), 1e-6 * np.eye(1), np.zeros((n, 1)))
        nodes.append(replace(node, psf=replace(node.psf, tail=tail)))
    direction = np.zeros((1, n + 1))
    direction[0, n] = 1
    return replace(
        field, nodes=tuple(nodes), components=direction, analysis=direction, lack_rest=np.zeros((n + 1, n + 1))
    )


def test_coarser_grids_are_blurred_alike_and_finer_images_refused(varying):
    # a wave below the coarse grid's Nyquist frequency, in the middle of the image: blurred on both grids
    fine_x, coarse_x = np.arange(112) / 2, np.arange(56.0)
    wave = np.cos(2 * np.pi * 0.11 * fine_x)[None] * np.ones((80, 1))
    fine = SpaceVariantBlur(varying, 2).blur(wave)[::2, ::2]
    coarse = SpaceVariantBlur(varying, 1).blur(np.cos(2 * np.pi * 0.11 * coarse_x)[None] * np.ones((40, 1)))
    # the sinc's ends, two samples beyond the support
    np.testing.assert_allclose(coarse[10:-10, 10:-10], fine[10:-10, 10:-10], atol=0.03)
    with pytest.raises(BadParameter, match="1 to 2 samples per pixel; got 3"):
        SpaceVariantBlur(varying, 3)
