import numpy as np
import pytest

from procedures.numerics.warps import apply_homography
from procedures.outcome import Refused
from procedures.two_photo.registration import register

from .conftest import OTF
from .wall import Pair, photographs


def far_error(H: np.ndarray, pair: Pair) -> float:
    """Largest distance of a map from the true one, in far pixels, over the far photograph's middle."""
    y, x = np.mgrid[20:100:8, 20:100:8].reshape(2, -1).astype(float)
    points = np.stack([x, y], axis=-1)
    off = apply_homography(H, points) - apply_homography(pair.H_near_far, points)
    return float(np.abs(off).max() / 4.6)


@pytest.mark.parametrize("swapped", [False, True])
def test_order_and_map_are_recovered(pair: Pair, swapped: bool) -> None:
    a, b = (pair.far, pair.near) if swapped else (pair.near, pair.far)
    sighting = register(a, b)
    assert sighting.swapped is swapped
    # matches scatter by about 0.1 far pixel; the dense refinement needs half a pixel
    assert far_error(sighting.H_near_far, pair) < 0.25


@pytest.mark.slow
def test_whole_frames_match_and_two_walls_do_not(pair):
    frame = np.full(pair.near.shape, 0.4, np.float32)
    frame[150:270, 200:320] = pair.far
    sighting = register(frame, pair.near)
    moved = sighting.H_near_far @ np.array([[1, 0, 200], [0, 1, 150], [0, 0, 1.0]])
    assert sighting.swapped
    assert far_error(moved, pair) < 0.4
    other = photographs(OTF, seed=2)
    with pytest.raises(Refused, match="must agree on one plane"):
        register(pair.near, other.far)


def test_bare_and_mirrored_walls_are_refused(pair):
    bare = np.tile(np.linspace(0.3, 0.5, 300, dtype=np.float32), (300, 1))
    with pytest.raises(Refused, match="must have texture"):
        register(bare, bare[:80, :80])
    with pytest.raises(Refused, match="must agree"):
        register(pair.near, np.ascontiguousarray(pair.far[:, ::-1]))
