import numpy as np

from procedures.restoration.first_depth.segments import fit_planes


def plane(shape=(60, 70), first=2.0, down=0.01, across=0.02):
    y, x = np.indices(shape)
    return first + down * y + across * x


def test_a_plane_is_reproduced_except_for_damping():
    # slopes are damped by sigma / 4 relative to a variance of sigma^2, less at the frame, where windows are truncated
    w = plane()
    planes = fit_planes(w, np.ones_like(w), 6.0)
    inside = np.s_[20:-20, 20:-20]
    np.testing.assert_allclose(planes.value[inside], w[inside], atol=1e-9)
    np.testing.assert_allclose(planes.across[inside], 0.02 / (1 + 1 / 24), rtol=1e-3)
    np.testing.assert_allclose(planes.down[inside], 0.01 / (1 + 1 / 24), rtol=1e-3)
