"""The plan of a restoration: what its checks say of the two photographs, and its way to picture and depth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procedures.facts import facts_as
from procedures.outcome import BadInput, BadParameter, Refused, Verdict
from procedures.plan import Ask, Shoot
from procedures.raw import Felt, Plane, RawFrame
from procedures.reading.exposure import Exposure
from procedures.restoration.facts import APERTURES, MOTIONS, RestorationFacts
from procedures.restoration.flat_part import parts, region_of
from procedures.restoration.masks.camera_motion import planar_stacks
from procedures.restoration.masks.thin_lens import CameraSetting
from procedures.restoration.plan import aperture_ratio, check_first, check_second, estimate, plan
from procedures.restoration.two_photographs import blur_ratio, blur_relation, rig_poses

from .conftest import scene

FACTS = {"blur_by": "apertures", "max_w": 4.4, "scheme": "3x(4+4)+1x4", "first_f_number": 5.0, "second_f_number": 4.0}


def frame(samples, **exposure):
    return RawFrame(Path("a"), "", {"Y": Plane("Y", samples.astype(np.float32), 1 / 65535)}, Exposure(**exposure))


@pytest.fixture(scope="module")
def pair(defocus_stacks):
    return scene(defocus_stacks, (80, 96), 40.0)


def test_a_scene_with_detail_is_good_and_its_level_is_kept(pair):
    image = 0.8 * pair.z[0, 0] / pair.z[0, 0].max()
    advice = check_first(frame(image), FACTS)
    assert advice.good, advice.say
    assert advice.facts["first_level"] == pytest.approx(image.mean(), rel=1e-6)


def test_a_scene_without_detail_is_not(rng):
    advice = check_first(frame(0.7 + 0.003 * rng.standard_normal((80, 96))), FACTS)
    assert "detail is only" in advice.say


def test_a_second_photograph_that_is_darker_tells_by_how_much_to_expose_longer(pair):
    first = check_first(frame(pair.z[0, 0]), FACTS)
    advice = check_second(frame(0.7 * pair.z[1, 0]), {**FACTS, **first.facts})
    assert "darker than the first" in advice.say
    # a factor of 0.7 is half a stop; blur hardly changes the mean
    assert advice.by_hand["exposure_ev"] == pytest.approx(np.log2(1 / 0.7), abs=0.05)


def test_apertures_that_are_too_near_each_other_are_told(pair):
    level = {"first_level": float(pair.z[1, 0].mean()), "first_f_number": 5.6, "second_f_number": 5.2}
    advice = check_second(frame(pair.z[1, 0], f_number=5.2), {**FACTS, **level})
    assert "differ by a factor of 1.08" in advice.say


@pytest.mark.parametrize(("check", "which", "wrong"), [(check_first, "first", 8.0), (check_second, "second", 3.2)])
def test_an_f_number_that_the_camera_noted_otherwise_is_named_and_may_be_insisted_on(pair, check, which, wrong):
    noted = {"first": 5.0, "second": 4.0}[which]
    image = 0.8 * pair.z[0, 0] / pair.z[0, 0].max()
    facts = {**FACTS, "first_level": float(image.mean()), f"{which}_f_number": wrong}
    advice = check(frame(image, f_number=noted), facts)
    assert not advice.good
    assert advice.doubted == (f"{which}_f_number",)
    assert f"given as {wrong:g}, and the camera noted {noted:g}" in advice.say
    assert check(frame(image, f_number=noted), {**facts, f"insisted_{which}_f_number": True}).doubted == ()


def test_a_pixel_pitch_that_the_camera_noted_otherwise_is_named(pair):
    advice = check_first(frame(pair.z[0, 0], pixel_pitch_um=4.0), {**FACTS, "pixel_pitch_um": 5.94})
    assert advice.doubted == ("pixel_pitch_um",)


@pytest.mark.parametrize("factor", [1.2, 2.0, 1 / 1.2, 0.5])
def test_an_f_number_of_a_lens_that_notes_none_is_held_against_the_light(pair, factor):
    # from f/5 to f/4 at the same light: 0.64 of the time gives the same level
    image = 0.8 * pair.z[0, 0] / pair.z[0, 0].max()
    facts = {**FACTS, "first_level": float(image.mean()), "first_exposure_s": 0.05}
    assert check_second(frame(image, exposure_s=0.032), facts).good
    advice = check_second(frame(image, exposure_s=0.032), {**facts, "first_f_number": 5.0 * factor})
    assert advice.doubted == ("first_f_number", "second_f_number")
    assert "By exposure times and light the first f-number is 1.25 times the second" in advice.say


def test_the_blurs_go_as_the_apertures():
    assert blur_ratio(facts_as(RestorationFacts, FACTS)) == 1.25
    assert aperture_ratio(RestorationFacts(first_f_number=4.0, second_f_number=5.0)) == 1.25
    with pytest.raises(BadParameter, match="first f-number is not known; tell both"):
        blur_ratio(RestorationFacts())


def test_two_planes_of_focus_are_an_offset_of_the_blur(pair):
    known = facts_as(RestorationFacts, {**FACTS, "pixel_pitch_um": 6.0})
    focus = (800.0, 760.0)
    first, second = (frame(pair.z[0, 0], focal_length_mm=50.0, subject_distance_mm=one) for one in focus)
    ratio, offset = blur_relation(first, second, known)
    # by the radii themselves, of a scene behind both planes: w is a radius without its sign
    at = np.array([900.0, 1200.0, 4000.0])
    w = [-CameraSetting(50.0, n, one, 6.0).blur_radius_px(at) for n, one in zip((5.0, 4.0), focus, strict=True)]
    np.testing.assert_allclose(ratio * w[0] + offset, w[1], rtol=1e-9)
    assert offset > 1
    assert blur_relation(first, first, known) == (1.25, 0.0)
    assert blur_relation(first, second, facts_as(RestorationFacts, FACTS)) == (1.25, 0.0)


def test_a_shape_that_no_aperture_has_is_asked_again(pair):
    image = 0.8 * pair.z[0, 0] / pair.z[0, 0].max()
    assert check_first(frame(image), {**FACTS, "shape": "polygon:9"}).good
    for typed in ("star", "polygon:two"):
        advice = check_first(frame(image), {**FACTS, "shape": typed})
        assert advice.doubted == ("shape",)
        assert typed in advice.say


def test_parts_are_marked_or_those_with_the_most_detail():
    assert region_of("10, 20,30,40") == (10, 20, 30, 40)
    assert region_of("auto") is None
    with pytest.raises(BadParameter, match="four whole numbers"):
        region_of("left")
    picture = np.zeros((100, 100))
    picture[60:90, 10:40] = np.random.default_rng(1).normal(size=(30, 30))
    x, y, width, height = next(parts(picture, 40))
    assert (x <= 10 and x + width >= 30 and y <= 60 and y + height >= 80) or (x, y) == (0, 60)


@pytest.mark.slow
def test_two_photographs_become_picture_and_depth(pair):
    outcome = estimate([frame(one[0]) for one in pair.z], FACTS, {})["picture"]
    assert outcome.verdict is not Verdict.REFUSED, outcome.reason
    # the published way ends near 0.1 pixel after twenty rounds; this is four
    assert pair.depth_error(outcome.value.w) < 0.4
    assert pair.picture_error(outcome.value.sharp) < 0.5 * pair.picture_error(pair.z[0])


def test_one_photograph_is_not_enough(pair):
    with pytest.raises(BadInput, match="two photographs; 1 count"):
        estimate([frame(pair.z[0, 0])], FACTS, {})


def test_the_imu_is_recorded_during_both():
    shoots = [request for step in plan().steps for request in step.requests if isinstance(request, Shoot)]
    assert [(shoot.purpose, shoot.record_motion) for shoot in shoots] == [("first", True), ("second", True)]


def test_the_rig_s_path_is_the_record_s_less_its_drift():
    t = np.arange(-0.2, 0.6, 0.005)
    w = 2 * np.pi * 10.0
    position = np.column_stack([2e-3 * np.cos(w * t), 1e-3 * np.sin(2 * w * t), 0 * t])
    acceleration = position * [-(w**2), -4 * w**2, 0] + [0.3, 9.8, -0.2]  # gravity, and a unit that is not level
    felt = Felt(t, acceleration, np.zeros((len(t), 3)))
    frame = RawFrame(Path("a"), "", {}, Exposure(exposure_s=0.2), felt)
    path = rig_poses(frame).planar_path
    times = np.linspace(0, 0.2, len(path))
    # the scene moves against the rig, and y of a picture is down; splines through ten samples a period of the faster
    # one lose little, and drift fitted to eight periods takes some hundredths of a motion with it
    expected = np.column_stack([-2e-3 * np.cos(w * times), 1e-3 * np.sin(2 * w * times)])
    np.testing.assert_allclose(path, expected, atol=0.03e-3)
    assert rig_poses(replace(frame, felt=None)) is None
    assert rig_poses(replace(frame, exposure=Exposure(exposure_s=0.7))) is None  # it goes on after the record


def test_masks_of_a_recorded_path_grow_with_w():
    t = np.linspace(0, 2 * np.pi, 400)
    paths = [1e-3 * np.column_stack([np.cos(t), 0.5 * np.sin(2 * t)]), 1e-3 * np.column_stack([0 * t, np.sin(t)])]
    across, along = planar_stacks(paths, 4.0)
    x = np.arange(-across.R, across.R + 1)
    for w in (1.0, 2.5, 4.0):
        # a cosine's variance is half its amplitude's square; sharing between pixels and softness add 1/3 at most
        spread = [float((stack.at(w) * offset**2).sum()) for stack, offset in ((across, x), (along, x[:, None]))]
        np.testing.assert_allclose(spread, w**2 / 2, atol=0.35)
    with pytest.raises(Refused, match="must move"):
        planar_stacks([0 * one for one in paths], 4.0)


@pytest.mark.parametrize(
    ("kind", "asked", "not_asked"),
    [
        (APERTURES, {"first_f_number", "second_f_number", "shape"}, {"first_moves", "region"}),
        (MOTIONS, {"first_moves", "region"}, {"first_f_number", "second_f_number", "shape"}),
    ],
)
def test_what_is_asked_fits_what_blurs(kind, asked, not_asked):
    requests = (request for step in plan().steps for request in step.requests)
    keys = [one.key for one in requests if isinstance(one, Ask) and one.when({"blur_by": kind})]
    assert asked <= set(keys)
    assert not not_asked & set(keys)
    assert len(keys) == len(set(keys))


def test_the_rail_shows_what_blurs_how_bright_it_is_and_how_the_light_has_changed():
    facts = {"blur_by": MOTIONS, "first_level": 0.4, "second_level": 0.42}
    told = [plan().step(name).gave(facts) for name in ("scene", "first", "second")]
    assert told == ["motions", "mean 40 %", "light +5 %"]
    assert [plan().step(name).gave({}) for name in ("first", "second")] == ["", ""]
