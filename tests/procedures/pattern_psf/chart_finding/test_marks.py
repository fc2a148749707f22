import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procedures.pattern_psf.chart_finding.marks import find_saddles


def bow_tie(x0: float, y0: float, turn: float, *, size: int = 33, fine: int = 5) -> np.ndarray:
    """Two black quadrants along an axis turned by `turn` radians from x, meeting at (x0, y0), on white."""
    at = (np.arange(size * fine) + 0.5) / fine - 0.5
    dx, dy = at[None, :] - x0, at[:, None] - y0
    along, across = dx * np.cos(turn) + dy * np.sin(turn), -dx * np.sin(turn) + dy * np.cos(turn)
    dark = (np.abs(along) > np.abs(across)).astype(np.float32)
    return 1 - 0.9 * dark.reshape(size, fine, size, fine).mean(axis=(1, 3))


@settings(max_examples=25, deadline=None)
@given(st.floats(15, 17), st.floats(15, 17), st.floats(0, np.pi))
def test_x_corner_is_a_saddle_with_its_dark_axis(x: float, y: float, turn: float) -> None:
    found = find_saddles(bow_tie(x, y, turn))
    nearest = int(np.argmin(np.abs(found.points - (x + 1j * y))))
    # saddles are places of pixels: half a pixel off in each direction, or one where two are as good
    assert abs(found.points[nearest] - (x + 1j * y)) < 1.2
    # an off-centre saddle and its neighbours turn the axis by a few degrees
    assert abs(np.angle(found.axes[nearest] * np.exp(-2j * turn))) / 2 < np.deg2rad(6)


def test_strength_is_proportional_to_contrast() -> None:
    image = bow_tie(16, 16, 0.3)
    weak, strong = find_saddles(image), find_saddles(7 * image)
    assert np.array_equal(weak.points, strong.points)
    assert np.allclose(7 * weak.strengths, strong.strengths, rtol=1e-4)  # single precision


@pytest.mark.parametrize("level", [1e-3, 1.0, 100.0])
def test_noise_alone_leaves_few_saddles(level: float, rng: np.random.Generator) -> None:
    noise = rng.normal(5 * level, level, (500, 500)).astype(np.float32)
    # four times the noise's strength: exp(-16) of Gaussian noise, more for the quiet places taken as its measure
    assert len(find_saddles(noise).points) < 1e-3 * noise.size


def test_edges_and_ramps_have_no_saddles() -> None:
    y, x = np.mgrid[0:200, 0:200].astype(np.float32)
    for image in (x + 2 * y, (x > 0.6 * y + 40).astype(np.float32)):
        z = find_saddles(image).points
        # beyond the picture's edge it is reflected, which bends the ramp there
        assert not ((np.abs(z.real - 99.5) < 97) & (np.abs(z.imag - 99.5) < 97)).any()


@pytest.mark.parametrize("turn", np.radians([0, 11, 22.5, 40, 100]))
def test_the_axis_of_a_centred_x_corner_has_no_error_of_direction(turn: float) -> None:
    # second derivatives along axes and diagonals have one scale; the pixels' squares leave a degree at most
    found = find_saddles(bow_tie(16, 16, turn))
    nearest = int(np.argmin(np.abs(found.points - (16 + 16j))))
    assert abs(np.angle(found.axes[nearest] * np.exp(-2j * turn))) / 2 < np.deg2rad(1)
