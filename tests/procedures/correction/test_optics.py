"""Blur of a photograph on its sensor's grid, compared with the transfer functions of the field's complete PSFs."""

import numpy as np
import pytest

from procedures import Plane, Psf
from procedures.correction.optics import PlaneFields
from procedures.field.interpolate import interpolate
from procedures.psf_field import Node

K, S, N = 9, 3, 64
SHAPE = (60, 80)
TAIL = np.array([0.03, 0.01, 0.004, 0.0, 0.0, -0.002])


@pytest.fixture(scope="module")
def psf():
    r2 = np.add.outer(np.arange(-4, 5) ** 2, np.arange(-4, 5) ** 2)
    h = np.exp(-r2 / 2 / 1.3**2)
    return Psf.of(np.concatenate([(h / h.sum()).ravel(), TAIL]), np.eye(K * K + 6) * 1e-8, K, S)


@pytest.fixture(scope="module")
def field(psf):
    at = [np.array([x, y]) for x in (10.0, 40.0, 70.0) for y in (10.0, 30.0, 50.0)]
    return interpolate("Y", SHAPE, [Node(one, np.eye(2) * 1e-6, one, psf, "", i) for i, one in enumerate(at)]).field


@pytest.mark.parametrize("pitch", [1, 2])
def test_details_are_blurred_by_the_complete_psf_with_the_light_beyond_its_reach(psf, field, pitch):
    optics = PlaneFields.of({"Y": Plane("Y", np.zeros(SHAPE, np.float32), 1e-4, pitch)}, {"Y": field}, {})
    fx, fy = np.meshgrid(np.arange(1, 20) / N, np.arange(0, 20) / N)
    H = optics.otf(40.0, 30.0, N)[0]
    assert H[0, 0] == pytest.approx(1, abs=1e-6)
    whole = psf.spectra(pitch * fx.ravel(), pitch * fy.ravel()) @ psf.parameters / psf.light
    # the truncated filter of the grid errs by some ten-thousandths; the light beyond the reach is 0.008 of the total
    np.testing.assert_allclose(H[:20, 1:20], whole.reshape(fx.shape), atol=1e-3)


def test_on_large_frames_rotated_photographs_reach_no_farther_than_their_supports(field):
    turn = np.array([[0.0, -0.007], [0.007, 0.0]])
    planes = {name: Plane("Y", np.zeros((4000, 6000), np.float32), 1e-4) for name in ("Y", "Y 2")}
    optics = PlaneFields.of(planes, {"Y": field}, {"Y 2": lambda points: (points - [3000.0, 2000.0]) @ turn})
    assert optics.ring < 8
    # displacement of a point at the picture's rim under a rotation by 0.007 rad, beyond first order
    dx, dy = np.linalg.solve(np.eye(2) - turn.T, [2990.0, 1990.0]) - [2990.0, 1990.0]
    assert optics.whole(5990.0, 3990.0) == {"Y 2": (round(dx), round(dy))}
    rest = np.angle(optics.otf(5990.0, 3990.0, N)[1] / optics.otf(5990.0, 3990.0, N)[0])[[0, 1], [1, 0]]
    np.testing.assert_allclose(-rest * N / (2 * np.pi), [dx - round(dx), dy - round(dy)], atol=0.02)
