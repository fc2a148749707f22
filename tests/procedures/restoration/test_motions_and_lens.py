"""The plan for a lens's blur in addition to recorded motions: questions, caveats, and the blur."""

from pathlib import Path

import numpy as np
import pytest

from procedures import BadParameter, BlurSpec, CameraSetting, blur_of
from procedures.plan import HAS_SHAKER, Ask, facts_as
from procedures.raw import Plane, RawFrame, ShakerPath
from procedures.reading.exposure import Exposure
from procedures.restoration.facts import BOTH, MOTIONS, RestorationFacts
from procedures.restoration.known_blur import blur_spec
from procedures.restoration.masks.mask_fields import MaskField
from procedures.restoration.plan import parameters_of, plan
from procedures.restoration.plan_checks import check_first

FACTS = {"blur_by": BOTH, "max_w": 4.0, "lens_f_number": 4.0, "focus_m": 1.0, "pixel_pitch_um": 8.0}
LENS = CameraSetting(24.0, 4.0, 1000.0, 8.0)
ROUND = np.arange(48) * np.pi / 24


def frame(along: int, **exposure):
    """A photograph during one round of a shaker, mostly along one axis."""
    position_m = np.zeros((48, 3))
    position_m[:, along], position_m[:, 1 - along] = 8e-4 * np.cos(ROUND), 3e-4 * np.cos(2 * ROUND + 0.7)
    parameters = Exposure(exposure_s=0.048, **{"focal_length_mm": 24.0, **exposure})
    samples = np.random.default_rng(1).random((80, 96), np.float32)
    return RawFrame(
        Path("a"), "", {"Y": Plane("Y", samples, 1e-4)}, parameters, None, ShakerPath(position_m, 0.001, 0.0)
    )


def widths(mask):
    """Variances along x and y, pixels squared."""
    n = np.arange(len(mask)) - len(mask) // 2
    each = [mask.sum(axis=axis) for axis in (0, 1)]
    return np.array([np.sum(one * n**2) - np.sum(one * n) ** 2 for one in each])


@pytest.mark.parametrize("distance_mm", [700.0, 1000.0, 1900.0])
def test_the_blur_combines_motion_and_blur_circle_at_each_distance(distance_mm):
    frames = [frame(0), frame(1)]
    spec = blur_spec(frames, facts_as(RestorationFacts, FACTS))
    pictures = [np.ones((1, 80, 96)), np.zeros((1, 80, 96))]
    combined, alone = (blur_of(one, pictures) for one in (spec, BlurSpec(spec.source, spec.max_w)))
    w = 1000 / distance_mm / combined.unit.per_pixel
    for blurred, motion in zip(combined.masks, alone.masks, strict=True):
        more = widths(MaskField.of(blurred).at(w)) - widths(MaskField.of(motion).at(w))
        # a disc of radius r has r^2 / 4 along each axis, and masks are drawn in pixels of 1 / 12 or twice that
        np.testing.assert_allclose(more, LENS.blur_radius_px(distance_mm) ** 2 / 4, atol=0.17)


def test_missing_records_and_lens_data_are_named_and_uniform_motion_starts_evenly():
    known = facts_as(RestorationFacts, FACTS)
    unrecorded = RawFrame(Path("b"), "", frame(0).planes, frame(0).exposure)
    with pytest.raises(BadParameter, match="a record of each photograph's motion"):
        blur_spec([frame(0), unrecorded], known)
    with pytest.raises(BadParameter, match="the lens's blur is not known"):
        blur_spec([frame(0), frame(1)], facts_as(RestorationFacts, {**FACTS, "focus_m": 0.0}))
    # the camera's record of the distance suffices
    blur_spec(
        [frame(n, subject_distance_mm=900.0) for n in (0, 1)], facts_as(RestorationFacts, {**FACTS, "focus_m": 0.0})
    )
    advice = check_first(frame(0), {**FACTS, "focus_m": 0.0})
    assert advice.contradictory == ("lens_f_number", "focus_m", "pixel_pitch_um")
    noted = check_first(frame(0, f_number=5.6), FACTS)
    assert noted.contradictory == ("lens_f_number",)
    assert "given as 4, but the camera recorded 5.6" in noted.say
    parameters = parameters_of(facts_as(RestorationFacts, {"blur_by": MOTIONS, "steady": "y"}))
    assert (parameters.depth_start, parameters.symmetric_axis) == ("symmetric", "y")
    assert parameters_of(RestorationFacts()).depth_start == "matched"
    assert "steady" in asked({"blur_by": MOTIONS})
    assert "steady" not in asked({"blur_by": MOTIONS, HAS_SHAKER: True}) | asked({"blur_by": BOTH}) | asked({})


def asked(facts):
    everything = [one for step in plan().steps for one in step.requests if isinstance(one, Ask)]
    return {one.key for one in everything if one.when(facts) and one.given(facts) is None}


def test_lens_data_are_asked_for_and_recorded_motions_are_not():
    keys = asked({"blur_by": BOTH})
    assert {"lens_f_number", "focus_m", "pixel_pitch_um", "shape", "first_moves", "second"} <= keys
    assert not {"first_f_number", "second_f_number", "region", "motion_shape"} & keys
    shaken = asked({"blur_by": BOTH, HAS_SHAKER: True})
    assert "lens_f_number" in shaken
    assert not {"first_moves", "second"} & shaken
