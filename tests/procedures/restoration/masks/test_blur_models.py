import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procedures.outcome import BadInput, BadParameter
from procedures.restoration.masks import blur_models as models


def moments(mask):
    R = len(mask) // 2
    y, x = np.mgrid[-R : R + 1, -R : R + 1]
    cx, cy = (mask * x).sum(), (mask * y).sum()
    return cx, cy, (mask * (x - cx) ** 2).sum(), (mask * (y - cy) ** 2).sum()


SHAPES = {
    "pillbox": models.pillbox(),
    "gaussian": models.gaussian(),
    "hexagon": models.polygon(6),
    "line": models.uniform_motion(0.4),
}


@pytest.mark.parametrize("name", SHAPES)
@given(w=st.floats(0.2, 6.0))
def test_masks_preserve_light_and_centroid(name, w):
    mask = models.mask(SHAPES[name], w, 7)
    cx, cy, _, _ = moments(mask)
    assert mask.sum() == pytest.approx(1)
    assert (mask >= 0).all()
    # all four shapes have a half-turn symmetry; 11 samples per pixel centre them within their rounding
    assert np.hypot(cx, cy) < 0.05


@pytest.mark.parametrize("w", [2.0, 3.7, 5.5])
def test_the_blur_circle_has_the_variance_of_a_disc(w):
    # a disc of radius w has r^2 / 4 along each axis, a pixel adds 1/12
    _, _, xx, yy = moments(models.mask(models.pillbox(), w, 7))
    assert [xx, yy] == pytest.approx([w**2 / 4 + 1 / 12] * 2, rel=0.03)


def test_shapes_stretch_turn_and_have_the_names_of_apertures():
    # a line of half-length w: w^2 / 3 along it (5.5), the drawn line ends its thickness before the frame
    w = 6.0
    _, _, xx, yy = moments(models.mask(models.uniform_motion(0.0), w, 8))
    assert xx == pytest.approx((0.94 * w) ** 2 / 3 + 1 / 12, rel=0.02)
    assert yy < 0.15
    circle, polygon = models.pillbox(), models.polygon(64)
    assert np.mean(circle != polygon) < 0.01
    one = models.mask_stack(SHAPES["hexagon"], 3.0, R=6)
    other = models.mask_stack(SHAPES["hexagon"], 3.0, ratio=1.5, R=6)
    np.testing.assert_allclose(other.at(2.0), one.at(3.0), atol=2e-3)  # one level off by interpolation at most
    shape = np.zeros((257, 257))
    shape[:60, 100:160] = 1
    stack = models.mask_stack(shape, 4.0, ratio=1.0, offset=-2.0, R=5)
    np.testing.assert_allclose(stack.at(4.0), stack.at(0.0)[::-1, ::-1], atol=1e-12)
    # w - 6 is negative everywhere: the widest is at w = 0
    stack = models.mask_stack(SHAPES["hexagon"], 4.0, offset=-6.0)
    assert stack.R == 7
    assert moments(stack.at(0.0))[2] > moments(stack.at(4.0))[2]
    np.testing.assert_array_equal(models.named("polygon:6"), SHAPES["hexagon"])
    np.testing.assert_array_equal(models.named("pillbox"), SHAPES["pillbox"])
    assert models.named("shape.txt") is None
    with pytest.raises(BadParameter, match="blades and its rotation"):
        models.named("polygon:six")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("1 2\n3 4\n", "odd number of rows"),
        ("1 2 3\n4 5 6\n", r"must be an array \(k, k\); got an array \(2, 3\)"),
        ("1 1 1\n1 -1 1\n1 1 1\n", "must be finite, from 0 to 1e.30; got -1"),
        ("1 1 1\n1 1e308 1\n1 1 1\n", "must be finite, from -1e.30 to 1e.30"),
        ("0 0 0\n0 0 0\n0 0 0\n", "positive sum"),
        ("a b c\n", "cannot be read"),
    ],
)
def test_a_wrong_shape_file_is_refused(tmp_path, text, complaint):
    file = tmp_path / "shape.txt"
    file.write_text(text)
    with pytest.raises(BadInput, match=complaint):
        models.read_shape(file)


@pytest.mark.parametrize("lengths", [(), (7,), (7, 7, 7), (0, 0)])
def test_a_shape_of_another_rank_is_refused(lengths):
    with pytest.raises(BadInput, match=r"the shape must be an array \(k, k\)"):
        models.check_shape(np.ones(lengths))


def test_masks_that_cannot_hold_w_are_refused():
    with pytest.raises(BadParameter, match="half-size"):
        models.mask_stack(models.pillbox(), 6.0, R=4)
    with pytest.raises(BadParameter, match="3 blades"):
        models.polygon(2)
    with pytest.raises(BadInput, match="does not move"):
        models.path_shape(np.zeros((10, 2)))
