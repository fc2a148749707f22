import numpy as np

from procedures.restoration.first_depth.segments import fit_planes


def plane(shape=(60, 70), first=2.0, down=0.01, across=0.02):
    y, x = np.indices(shape)
    return first + down * y + across * x


def test_a_plane_is_reproduced():
    w = plane()
    value, mass = fit_planes(w, np.ones_like(w), 6.0)
    np.testing.assert_allclose(value[20:-20, 20:-20], w[20:-20, 20:-20], atol=1e-9)
    np.testing.assert_allclose(mass, 1)
