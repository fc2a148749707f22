"""Space-variant operators: identities that hold to rounding, and FFT convolution where depth is constant."""

import numpy as np
import pytest
from scipy.signal import fftconvolve

from procedures.restoration.masks import array_loops, blur_operator
from procedures.restoration.masks.blur_models import mask_stack, pillbox, uniform_motion
from procedures.restoration.masks.blur_operator import BlurOperator, FieldBlur, MaskStack

SHAPE = (37, 45)


@pytest.fixture(params=["one", "field"])
def blur(request, vibration_stacks):
    if request.param == "one":
        operator: BlurOperator | FieldBlur = BlurOperator(vibration_stacks[0], SHAPE)
    else:
        operator = FieldBlur([[vibration_stacks[0], vibration_stacks[1]], list(vibration_stacks[::-1])], SHAPE)
    return operator


@pytest.fixture
def depths(blur, rng):
    return rng.uniform(0.3, 4.2, blur.extended)


def test_gradients_and_changes_are_adjoint_to_the_blur(blur, depths, rng):
    blur.focus(depths)
    u, e = rng.standard_normal((2, *blur.extended)), rng.standard_normal((2, *SHAPE))
    # equality to rounding: sums of about 1e5 products
    assert np.vdot(blur.blur(u), e) == pytest.approx(np.vdot(u, blur.blur_adjoint(e)), rel=1e-10, abs=1e-9)
    blur.focus(depths)
    u, du = rng.standard_normal((2, 3, *blur.extended))
    dw, e = rng.standard_normal(blur.extended), rng.standard_normal((3, *SHAPE))
    gu, gw = blur.change_adjoint(u, e)
    assert np.vdot(blur.change(u, du, dw), e) == pytest.approx(np.vdot(du, gu) + np.vdot(dw, gw), rel=1e-9, abs=1e-8)
    # masks are linear between levels, so a change that stays between them is predicted to rounding
    step = blur.stack.step
    w = (np.floor(depths / step) + 0.5) * step
    u, du, dw = rng.standard_normal((3, *blur.extended))
    dw = 0.4 * step * np.clip(dw, -1, 1)
    blur.focus(w)
    predicted = blur.change(u, np.zeros_like(u), dw) + blur.blur(u + du)
    blur.focus(w + dw)
    np.testing.assert_allclose(predicted, blur.blur(u) + _unmoved(blur, w, du), atol=1e-11)


def _unmoved(blur, w, du):
    blur.focus(w)
    return blur.blur(du)


@pytest.mark.parametrize("w", [1.0, 2.37, 4.2])
def test_constant_depth_is_ordinary_convolution(vibration_stacks, w, rng):
    stack = vibration_stacks[0]
    blur = BlurOperator(stack, SHAPE)
    blur.focus(np.full(blur.extended, w))
    u = rng.standard_normal(blur.extended)
    np.testing.assert_allclose(blur.blur(u), fftconvolve(u, stack.at(w), mode="valid"), atol=1e-12)


def test_neighbours_may_have_masks_of_any_size(rng):
    # masks grow from 1 x 1 to 35 x 35, so that adjacent pixels have pairs that are one, two and three vectors wide
    R, (height, width) = 17, SHAPE
    grow = np.maximum(*np.abs(np.mgrid[-R : R + 1, -R : R + 1])) <= np.arange(R + 1)[:, None, None]
    stack = MaskStack(grow * rng.random((R + 1, 2 * R + 1, 2 * R + 1)), 1.0)
    blur = BlurOperator(stack, SHAPE)
    w, u = rng.uniform(0, R, blur.extended), rng.standard_normal(blur.extended)
    blur.focus(w)
    expected = np.zeros((height + 4 * R, width + 4 * R))
    for y, x in np.ndindex(blur.extended):
        expected[y : y + 2 * R + 1, x : x + 2 * R + 1] += u[y, x] * stack.at(w[y, x])
    photograph = expected[2 * R : 2 * R + height, 2 * R : 2 * R + width]
    np.testing.assert_allclose(blur.blur(u), photograph, atol=1e-11)
    e = rng.standard_normal(SHAPE)
    assert np.vdot(blur.blur_adjoint(e), u) == pytest.approx(np.vdot(e, photograph), rel=1e-10)


def test_fields_and_windows_are_blurred_as_the_whole(vibration_stacks, rng, blur, depths):
    stack = vibration_stacks[0]
    one, field = BlurOperator(stack, SHAPE), FieldBlur([[stack] * 3] * 2, SHAPE)
    w, u = rng.uniform(0.3, 4.2, one.extended), rng.standard_normal(one.extended)
    one.focus(w)
    field.focus(w)
    np.testing.assert_allclose(field.blur(u), one.blur(u), atol=1e-12)
    y, x, R = slice(3, 21), slice(9, 45), blur.stack.R
    around = np.s_[y.start : y.stop + 2 * R, x.start : x.stop + 2 * R]
    u = rng.standard_normal(blur.extended)
    blur.focus(depths)
    part = blur.windowed(y, x)
    part.focus(depths[around])
    np.testing.assert_allclose(part.blur(u[around]), blur.blur(u)[y, x], atol=1e-12)


def test_photographs_do_not_depend_on_the_number_of_threads(vibration_stacks, rng, monkeypatch):
    monkeypatch.setattr(blur_operator, "WORK_PER_THREAD", 1)
    blur, results = BlurOperator(vibration_stacks[0], SHAPE), []
    w, u, e = rng.uniform(0.3, 4.2, blur.extended), rng.standard_normal(blur.extended), rng.standard_normal(SHAPE)
    for threads in (1, 3):
        monkeypatch.setattr(array_loops, "most_threads", lambda n=threads: n)
        blur.focus(w)
        results.append((blur.blur(u), blur.blur_adjoint(e)))
    for one, three in zip(*results, strict=True):
        np.testing.assert_array_equal(one, three)


def test_light_is_preserved_in_single_precision_too(vibration_stacks, rng):
    # every mask has sum 1, so a uniform scene is unchanged, at any single depth
    blur = BlurOperator(vibration_stacks[1], SHAPE)
    blur.focus(np.full(blur.extended, 3.12))
    np.testing.assert_allclose(blur.blur(np.ones(blur.extended)), 1, atol=1e-12)
    w, u = rng.uniform(0.3, 4.2, (49, 57)), rng.standard_normal((49, 57))
    photographs = []
    for dtype in (np.float32, np.float64):
        blur = BlurOperator(vibration_stacks[0], SHAPE, dtype)
        blur.focus(w.astype(dtype))
        photographs.append(blur.blur(u.astype(dtype)))
    assert photographs[0].dtype == np.float32
    np.testing.assert_allclose(photographs[0], photographs[1], atol=3e-6)  # eps 6e-8 times some 50 terms
    blur = BlurOperator(vibration_stacks[0], SHAPE)
    active = rng.random(blur.extended) > 0.5
    w, u = rng.uniform(0.3, 4.2, blur.extended), rng.standard_normal(blur.extended)
    blur.focus(w)
    expected = blur.blur(u * active)
    blur.focus(w, active)
    np.testing.assert_allclose(blur.blur(u), expected, atol=1e-12)
    assert not blur.blur_adjoint(rng.standard_normal(SHAPE))[~active].any()


def test_interpolated_masks_draw_a_point_within_their_support():
    stack = mask_stack(pillbox(), 4.0)
    assert list(stack.supports()) == sorted(stack.supports())
    assert stack.supports()[-1] <= stack.R
    # one bright point: its photograph is the mask of its depth, upright
    stack = mask_stack(uniform_motion(0.6), 5.0)
    blur = BlurOperator(stack, (31, 31))
    blur.focus(np.full(blur.extended, 4.0))
    u = np.zeros(blur.extended)
    u[stack.R + 15, stack.R + 15] = 1
    R = stack.R
    np.testing.assert_allclose(blur.blur(u)[15 - R : 16 + R, 15 - R : 16 + R], stack.at(4.0), atol=1e-15)
    stack = MaskStack(np.random.default_rng(0).random((4, 3, 3)), 0.5)
    np.testing.assert_allclose(stack.at(1.0), stack.masks[2])
    np.testing.assert_allclose(stack.at(0.75), (stack.masks[1] + stack.masks[2]) / 2)


def test_curvature_is_the_squared_change_by_one_pixel(vibration_stacks):
    stack, shape = vibration_stacks[0], (14, 15)
    R = stack.R
    blur = BlurOperator(stack, shape)
    w = np.full(blur.extended, 2.52)
    blur.focus(w)
    picture, depth = stack.curvature(w)
    one = np.zeros(blur.extended)
    one[R + 7, R + 7] = 1
    assert picture[R + 7, R + 7] == pytest.approx(np.sum(blur.blur(one) ** 2), rel=0.01)
    # between two masks the derivative is their difference; the table interpolates between two such differences
    change = blur.change(np.ones(blur.extended), np.zeros(blur.extended), one)
    assert depth[R + 7, R + 7] == pytest.approx(np.sum(change**2), rel=0.1)
