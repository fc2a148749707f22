"""Masks that vary over the frame: one stack is a grid of one, and a field restores the blur of the field."""

import numpy as np
import pytest

from procedures import BadParameter, Scheme, Verdict
from procedures.restoration.first_depth import initial_depth
from procedures.restoration.joint.estimate import RestorationParameters, noise_of, restore
from procedures.restoration.joint.result import refocused
from procedures.restoration.masks.mask_fields import MaskField, alike, one_grid, positions
from procedures.restoration.masks.shape_fields import symmetric

from ..conftest import scene

SLOW_FIXTURES = {"photographs"}


def coma(strength):
    """A disc with light concentrated towards +x."""
    t = np.linspace(-1, 1, 65)
    x, y = np.meshgrid(t, t)
    return np.where(x**2 + y**2 <= 1, 1 + strength * x, 0.0)


@pytest.fixture(scope="module")
def lens():
    """A lens with coma that grows from the centre to the corners, at two apertures."""
    shapes = symmetric([coma(0.0), coma(0.5), coma(0.99)], (80, 96), (2, 3))
    return [shapes.masks(4.4, 6, ratio) for ratio in (1.0, 1.25)]


@pytest.fixture(scope="module")
def photographs(lens):
    return scene(lens, (80, 96), 40.0)


@pytest.mark.slow
def test_a_field_of_equal_stacks_restores_as_the_stack_does(vibrating):
    parameters = RestorationParameters(scheme=Scheme(1, 2, 2, 1, 2), dtype=np.float64)
    one = restore(list(vibrating.z), vibrating.stacks, parameters).value
    fields = [MaskField(((stack, stack), (stack, stack))) for stack in vibrating.stacks]
    many = restore(list(vibrating.z), fields, parameters).value
    # tiles of the initial depth reflect at their own rims, within reach of the whitening's response
    assert np.median(np.abs(many.w - one.w)) < 1e-3
    assert np.median(np.abs(many.sharp - one.sharp)) < 1e-3


def test_blur_of_a_lens_with_coma_is_restored_with_its_field_from_the_initial_depth(photographs, lens):
    parameters = RestorationParameters(scheme=Scheme(2, 4, 4, 1, 8))
    restored = restore(list(photographs.z), lens, parameters)
    assert restored.verdict in (Verdict.PASS, Verdict.DOUBTFUL)
    assert photographs.depth_error(restored.value.w) < 0.3
    middle = [one.middle for one in lens]
    alone = restore(list(photographs.z), middle, parameters)
    assert photographs.picture_error(restored.value.sharp) < 0.85 * photographs.picture_error(alone.value.sharp)
    assert photographs.picture_error(restored.value.sharp) < 0.65 * photographs.picture_error(photographs.z[0])
    view = refocused(restored.value, lens[0], 2.0, 2.0)
    assert view.shape == restored.value.sharp.shape
    sigmas = np.full(2, noise_of(photographs.z, lens))
    errors = [
        np.median(np.abs(start.w - photographs.w[lens[0].R : -lens[0].R, lens[0].R : -lens[0].R]))
        for start in (
            initial_depth.matched(photographs.z, lens, sigmas),
            initial_depth.algorithm_3(photographs.z, lens, sigmas),
        )
    ]
    assert max(errors) < 0.25
    assert initial_depth.algorithm_2(photographs.z, lens, sigmas[0]).w.shape == (80, 96)


def test_nodes_lie_over_the_extended_frame_and_stacks_join_fields(vibration_stacks, defocus_stacks):
    y, x = positions((3, 1), (101, 61), 5)
    np.testing.assert_allclose(y, [-5, 50, 105])
    assert x == pytest.approx([30])
    a, b = vibration_stacks
    field = MaskField(((a, b),))
    first, second = one_grid([field, a])
    assert first is field
    assert second.grid == (1, 2)
    assert not alike([field, a])
    assert alike([MaskField(((a, a),)), a])
    with pytest.raises(BadParameter, match="agree in size"):
        MaskField(((a, defocus_stacks[0]),))
    with pytest.raises(BadParameter, match="rows of equal length"):
        MaskField(((a, b), (a,)))
    with pytest.raises(BadParameter, match="grids of masks differ: 1 x 2 and 2 x 2"):
        one_grid([MaskField(((a, b),)), MaskField(((a, b), (b, a)))])
