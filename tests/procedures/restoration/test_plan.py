"""The plan of a restoration: its checks of the photographs, and the estimate."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from procedures import BadInput, BadParameter, CameraSetting, Outcome, Refused, Verdict
from procedures.plan import HAS_IMU, Ask, Shoot, facts_as
from procedures.raw import ImuRecord, Plane, RawFrame
from procedures.reading.exposure import Exposure
from procedures.restoration.facts import APERTURES, COLOUR, MOTIONS, ORDER, RestorationFacts
from procedures.restoration.flat_part import parts, region_of
from procedures.restoration.known_blur import (
    blur_ratio,
    blur_relation,
    blur_spec,
    planes_of,
    rig_poses,
    split_ground_truth,
)
from procedures.restoration.masks.camera_motion import planar_stacks
from procedures.restoration.plan import compared_to_truth, estimate, path, plan
from procedures.restoration.plan_checks import aperture_ratio, check_first, check_later, checks

from .conftest import scene

CHECKS = checks()
FACTS = {"blur_by": "apertures", "max_w": 4.4, "scheme": "3x(4+4)+1x4", "first_f_number": 5.0, "second_f_number": 4.0}


def frame(samples, **exposure):
    return RawFrame(Path("a"), "", {"Y": Plane("Y", samples.astype(np.float32), 1 / 65535)}, Exposure(**exposure))


@pytest.fixture(scope="module")
def pair(defocus_stacks):
    return scene(defocus_stacks, (80, 96), 40.0)


def test_a_scene_with_detail_is_good_and_its_level_is_recorded(pair, rng):
    image = 0.8 * pair.z[0, 0] / pair.z[0, 0].max()
    advice = check_first(frame(image), FACTS)
    assert advice.good, advice.say
    assert advice.facts["first_level"] == pytest.approx(image.mean(), rel=1e-6)
    advice = check_first(frame(0.7 + 0.003 * rng.standard_normal((80, 96))), FACTS)
    assert "detail is only" in advice.say


def test_light_and_apertures_of_the_second_photograph_are_compared_with_the_first(pair):
    first = check_first(frame(pair.z[0, 0]), FACTS)
    advice = check_later("second", frame(0.7 * pair.z[1, 0]), {**FACTS, **first.facts})
    assert "darker than the first" in advice.say
    # a factor of 0.7 is half a stop; blur hardly changes the mean
    assert advice.by_hand["exposure_ev"] == pytest.approx(np.log2(1 / 0.7), abs=0.05)
    image = 0.8 * pair.z[0, 0] / pair.z[0, 0].max()
    facts = {
        **FACTS,
        "blur_by": MOTIONS,
        **check_first(frame(image, f_number=16.0), FACTS | {"blur_by": MOTIONS}).facts,
    }
    advice = check_later("second", frame(image, f_number=16.0), facts)
    assert advice.good, advice.say
    assert [reading.name for reading in advice.readings] == ["light"]
    level = {"first_level": float(pair.z[1, 0].mean()), "first_f_number": 5.6, "second_f_number": 5.2}
    advice = check_later("second", frame(pair.z[1, 0], f_number=5.2), {**FACTS, **level})
    assert "differ by a factor of 1.08" in advice.say


@pytest.mark.parametrize(("which", "wrong"), [("first", 8.0), ("second", 3.2)])
def test_an_f_number_that_contradicts_the_camera_is_named_and_may_be_insisted_on(pair, which, wrong):
    check = CHECKS[which]
    noted = {"first": 5.0, "second": 4.0}[which]
    image = 0.8 * pair.z[0, 0] / pair.z[0, 0].max()
    facts = {**FACTS, "first_level": float(image.mean()), f"{which}_f_number": wrong}
    advice = check(frame(image, f_number=noted), facts)
    assert not advice.good
    assert advice.contradictory == (f"{which}_f_number",)
    assert f"given as {wrong:g}, but the camera recorded {noted:g}" in advice.say
    assert check(frame(image, f_number=noted), {**facts, f"insisted_{which}_f_number": True}).contradictory == ()


def test_a_third_aperture_differs_from_both_others_and_is_as_bright_as_the_first(pair):
    image = pair.z[0, 0]
    facts = {**FACTS, "photographs": 3.0, "first_level": float(image.mean())}
    assert "differ by a factor of 1.05" in check_later("third", frame(image, f_number=4.2), facts).say
    advice = check_later("third", frame(image, f_number=2.8), facts)
    assert advice.good
    assert advice.facts["third_f_number"] == 2.8
    assert "darker than the first" in check_later("third", frame(0.7 * image, f_number=2.8), facts).say
    # from f/5 to f/2.8 at the same time: 3.2 times the light
    timed = {**facts, "first_exposure_s": 0.05, "third_f_number": 2.8}
    assert check_later("third", frame(image, exposure_s=0.05), timed).contradictory == (
        "first_f_number",
        "third_f_number",
    )
    assert check_later("third", frame(image, exposure_s=0.05 * 0.3136), timed).good


def test_a_ground_truth_has_the_smallest_aperture_and_the_brightness_of_the_first(pair):
    image = pair.z[0, 0]
    facts = {**FACTS, "first_level": float(image.mean()), "first_exposure_s": 0.05, "truth_f_number": 16.0}
    advice = CHECKS["truth"](replace(frame(image, f_number=22.0), sha256="0f"), facts)
    assert advice.good
    assert (advice.facts["truth_sha256"], advice.facts["truth_f_number"]) == ("0f", 22.0)
    assert "at about f/5, the others at f/5 and wider" in CHECKS["truth"](frame(image, f_number=5.0), facts).say
    # a lens without data: ten times the time at the same light is f/5 sqrt(10)
    by_light = CHECKS["truth"](frame(image, exposure_s=0.5), facts)
    assert by_light.good
    assert by_light.readings[1].value == pytest.approx(10**0.5)
    assert "stop down" in CHECKS["truth"](frame(image, exposure_s=0.05), facts).say
    assert "darker than the first" in CHECKS["truth"](frame(0.7 * image, f_number=22.0), facts).say
    # for motions it is the light alone
    assert CHECKS["truth"](frame(image, f_number=5.0), {**facts, "blur_by": MOTIONS}).good


def test_a_ground_truth_is_known_by_its_hash_and_compared_by_its_size(pair):
    image = frame(0.8 * pair.z[0, 0] / pair.z[0, 0].max())
    advice = check_first(image, {**FACTS, "colour": COLOUR})
    assert advice.contradictory == ("colour",)
    assert "only Y: restore one plane" in advice.say
    assert check_first(image, {**FACTS, "colour": COLOUR, "insisted_colour": True}).good
    mosaic = replace(image, planes={name: replace(image.planes["Y"], name=name) for name in ("R", "G1", "G2", "B")})
    assert check_first(mosaic, {**FACTS, "colour": COLOUR}).good
    known = facts_as(RestorationFacts, {**FACTS, "colour": COLOUR})
    assert list(planes_of(mosaic, known)) == ["R", "G1", "G2", "B"]
    assert list(planes_of(image, known)) == ["Y"]
    assert list(planes_of(mosaic, RestorationFacts())) == ["G1"]
    frames = [RawFrame(Path(one), one, {}, Exposure()) for one in "abc"]
    blurred, truth = split_ground_truth(frames, RestorationFacts(truth_sha256="b"))
    assert ([one.sha256 for one in blurred], truth.sha256) == (["a", "c"], "b")
    # the hash of one before a retake
    assert split_ground_truth(frames, RestorationFacts(truth_sha256="z")) == (frames, None)
    assert split_ground_truth([replace(one, sha256="") for one in frames], RestorationFacts())[1] is None
    outcome = Outcome(SimpleNamespace(), Verdict.PASS)
    Y = frame(pair.z[0, 0]).planes
    other = frame(pair.z[0, 0, 4:]).planes
    compared = compared_to_truth(outcome, [Y, Y], other)
    assert (compared.verdict, compared.value) == (Verdict.DOUBTFUL, outcome.value)
    assert "it has Y of 96 x 76" in compared.reason


@pytest.mark.parametrize("factor", [1.2, 2.0, 1 / 1.2, 0.5])
def test_an_unrecorded_f_number_is_compared_with_the_light(pair, factor):
    # from f/5 to f/4 at the same light: 0.64 of the time gives the same level
    image = 0.8 * pair.z[0, 0] / pair.z[0, 0].max()
    facts = {**FACTS, "first_level": float(image.mean()), "first_exposure_s": 0.05}
    assert check_later("second", frame(image, exposure_s=0.032), facts).good
    advice = check_later("second", frame(image, exposure_s=0.032), {**facts, "first_f_number": 5.0 * factor})
    assert advice.contradictory == ("first_f_number", "second_f_number")
    assert "By exposure times and light the first f-number is 1.25 times the second" in advice.say


def test_two_planes_of_focus_are_an_offset_and_an_unknown_shape_is_asked_for_again(pair):
    known = facts_as(RestorationFacts, {**FACTS, "pixel_pitch_um": 6.0})
    focus = (800.0, 760.0)
    first, second = (frame(pair.z[0, 0], focal_length_mm=50.0, subject_distance_mm=one) for one in focus)
    ratio, offset = blur_relation(first, second, known)
    # by the radii themselves, for a scene behind both planes: w is an unsigned radius
    at = np.array([900.0, 1200.0, 4000.0])
    w = [-CameraSetting(50.0, n, one, 6.0).blur_radius_px(at) for n, one in zip((5.0, 4.0), focus, strict=True)]
    np.testing.assert_allclose(ratio * w[0] + offset, w[1], rtol=1e-9)
    assert offset > 1
    assert blur_relation(first, first, known) == (1.25, 0.0)
    assert blur_relation(first, second, facts_as(RestorationFacts, FACTS)) == (1.25, 0.0)
    image = 0.8 * pair.z[0, 0] / pair.z[0, 0].max()
    assert check_first(frame(image), {**FACTS, "shape": "polygon:9"}).good
    for typed in ("star", "polygon:two"):
        advice = check_first(frame(image), {**FACTS, "shape": typed})
        assert advice.contradictory == ("shape",)
        assert typed in advice.say
    advice = check_first(frame(image, pixel_pitch_um=4.0), {**FACTS, "pixel_pitch_um": 5.94})
    assert advice.contradictory == ("pixel_pitch_um",)


def test_parts_are_marked_or_have_the_most_detail():
    assert region_of("10, 20,30,40") == (10, 20, 30, 40)
    assert region_of("auto") is None
    with pytest.raises(BadParameter, match="four whole numbers"):
        region_of("left")
    picture = np.zeros((100, 100))
    picture[60:90, 10:40] = np.random.default_rng(1).normal(size=(30, 30))
    x, y, width, height = next(parts(picture, 40))
    assert (x <= 10 and x + width >= 30 and y <= 60 and y + height >= 80) or (x, y) == (0, 60)


@pytest.mark.slow
def test_two_photographs_give_picture_and_depth(pair):
    outcome = estimate([frame(one[0]) for one in pair.z], FACTS, {})["picture"]
    assert outcome.verdict is not Verdict.REFUSED, outcome.reason
    # the published method ends near 0.1 pixel after twenty rounds; this is four
    assert pair.depth_error(outcome.value.w) < 0.4
    assert pair.picture_error(outcome.value.sharp) < 0.5 * pair.picture_error(pair.z[0])


def test_three_blurs_are_proportional_to_the_apertures_and_a_flat_part_determines_two(pair):
    with pytest.raises(BadInput, match="2 photographs; 1 are available"):
        estimate([frame(pair.z[0, 0])], FACTS, {})
    with pytest.raises(BadInput, match="3 photographs; 2 are available"):
        estimate([frame(one[0]) for one in pair.z], {**FACTS, "photographs": 3.0}, {})
    known = facts_as(RestorationFacts, {**FACTS, "third_f_number": 2.5})
    source = blur_spec([frame(pair.z[0, 0])] * 3, known).source
    assert source.ratios == (1.0, 1.25, 2.0)
    assert blur_ratio(facts_as(RestorationFacts, FACTS)) == 1.25
    assert aperture_ratio(RestorationFacts(first_f_number=4.0, second_f_number=5.0)) == 1.25
    with pytest.raises(BadParameter, match="first f-number is not known; give all"):
        blur_ratio(RestorationFacts())
    assert len(source.shapes) == 3
    frames, known = [frame(pair.z[0, 0])] * 3, facts_as(RestorationFacts, {**FACTS, "blur_by": MOTIONS})
    assert blur_spec(frames[:2], known).source.region is None
    with pytest.raises(BadParameter, match=r"not of 3, .* begin with two"):
        blur_spec(frames, known)
    assert blur_spec(frames, replace(known, region="whole")).source.region == "whole"
    result = estimate(frames, {**FACTS, "blur_by": MOTIONS, "photographs": 3.0}, {})["picture"]
    assert result.verdict is Verdict.REFUSED


def test_three_loops_of_a_shaker_pass_all_directions():
    # sums of squared transfer functions: the noise gain; a third loop that repeats the first has a seventh less, and
    # one across both less still
    def noise(names, w):
        fy, fx = np.meshgrid(np.arange(-16, 17) / 32, np.arange(-16, 17) / 32, indexing="ij")
        power = np.full(fx.shape, 1e-3)
        for name in names:
            x, y = (np.array(one) for one in path(name, {"blur_by": MOTIONS}).shares.values())
            assert max(np.abs(x).max(), np.abs(y).max()) <= 0.95 + 1e-12
            waves = np.exp(-2j * np.pi * w * (fx[..., None] * x + fy[..., None] * y))
            power += np.abs(waves.mean(axis=-1)) ** 2
        return np.sqrt(np.mean(1 / power))

    assert path("truth", {"blur_by": MOTIONS}) is None
    for w in (2.0, 4.0, 8.0):
        two, again, across = (noise(n, w) for n in (("first", "second"), ("first", "second", "first"), ORDER))
        assert across < 0.85 * again < again < two


def test_two_or_three_photographs_are_taken_with_the_imu():
    ask = plan().asks()["photographs"]
    ask.check(3.0, {})
    with pytest.raises(BadParameter, match="two or three"):
        ask.check(2.5, {})
    shoots = [request for step in plan().steps for request in step.requests if isinstance(request, Shoot)]
    assert {shoot.purpose: shoot.record_motion for shoot in shoots} == {**dict.fromkeys(ORDER, True), "truth": False}


def test_the_rig_s_path_is_the_record_without_drift():
    t = np.arange(-0.2, 0.6, 0.005)
    w = 2 * np.pi * 10.0
    position = np.column_stack([2e-3 * np.cos(w * t), 1e-3 * np.sin(2 * w * t), 0 * t])
    acceleration = position * [-(w**2), -4 * w**2, 0] + [0.3, 9.8, -0.2]  # gravity, and a unit that is not level
    imu = ImuRecord(t, acceleration, np.zeros((len(t), 3)))
    frame = RawFrame(Path("a"), "", {}, Exposure(exposure_s=0.2), imu)
    path = rig_poses(frame).planar_path
    times = np.linspace(0, 0.2, len(path))
    # the scene moves opposite to the rig, and y of a picture is down; splines through ten samples a period of the
    # faster one lose little, and the drift fitted to eight periods removes some hundredths of a motion
    expected = np.column_stack([-2e-3 * np.cos(w * times), 1e-3 * np.sin(2 * w * times)])
    np.testing.assert_allclose(path, expected, atol=0.03e-3)
    assert rig_poses(replace(frame, imu=None)) is None
    assert rig_poses(replace(frame, exposure=Exposure(exposure_s=0.7))) is None  # it goes on after the record


def test_masks_of_a_recorded_path_grow_with_w():
    t = np.linspace(0, 2 * np.pi, 400)
    paths = [1e-3 * np.column_stack([np.cos(t), 0.5 * np.sin(2 * t)]), 1e-3 * np.column_stack([0 * t, np.sin(t)])]
    across, along = planar_stacks(paths, 4.0)
    x = np.arange(-across.R, across.R + 1)
    for w in (1.0, 2.5, 4.0):
        # a cosine's variance is half its squared amplitude; distribution over pixels and softness add 1/3 at most
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
@pytest.mark.parametrize("imu", [True, False])
@pytest.mark.parametrize("photographs", [2.0, 3.0])
def test_questions_fit_the_cause_of_blur(kind, asked, not_asked, imu, photographs):
    requests = [request for step in plan().steps for request in step.requests if isinstance(request, Ask)]
    facts = {"blur_by": kind, HAS_IMU: imu, "photographs": photographs}
    keys = [one.key for one in requests if one.when(facts)]
    assert asked <= set(keys)
    assert not not_asked & set(keys)
    assert len(keys) == len(set(keys))
    third = {"third", "third_f_number"} if kind == APERTURES else {"third"}
    assert {one for one in keys if one.startswith("third")} == (third if photographs == 3 else set())
    assert plan().step("third").when(facts) == (photographs == 3)
    assert "truth" not in keys
    assert "truth" in [one.key for one in requests if one.when({**facts, "ground_truth": "yes"})]
    assert [plan().step("truth").when({**facts, "ground_truth": one}) for one in ("no", "yes")] == [False, True]


def test_motions_by_hand_need_a_flat_scene_and_the_rail_shows_what_was_measured():
    facts = {"blur_by": MOTIONS, "photographs": 3.0}
    region = plan().asks()["region"]
    assert region.given(facts) == "whole"
    assert region.given({**facts, HAS_IMU: True}) is region.given({**facts, "photographs": 2.0}) is None
    (scene_ask,) = [one for one in plan().step("scene").requests
                    if isinstance(one, Ask) and one.key == "scene" and one.when(facts)]  # fmt: skip
    assert "flat" in scene_ask.question
    facts = {"blur_by": MOTIONS, "first_level": 0.4, "second_level": 0.42}
    advice = [plan().step(name).value(facts) for name in ("scene", "first", "second")]
    assert advice == ["motions", "mean 40%", "light +5 %"]
    assert [plan().step(name).value({}) for name in ("first", "second")] == ["", ""]
    assert [plan().step(name).value(facts) for name in ("third", "truth")] == ["not taken", "not taken"]
    more = {**facts, "photographs": 3.0, "third_level": 0.4, "ground_truth": "yes", "truth_level": 0.36}
    assert [plan().step(name).value(more) for name in ("third", "truth")] == ["light +0 %", "light -10 %"]
