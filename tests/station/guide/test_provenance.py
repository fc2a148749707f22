"""Whose word a number is, and what it was held against."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from procedures.facts import INSISTED
from procedures.raw import Exposure, Plane, RawFrame
from station.guide.catalogue import PLANS, plan_named
from station.guide.provenance import NAMES, provenance_of


def noted(**exposure: float) -> RawFrame:
    """A photograph of which the camera noted this."""
    plane = Plane("G1", np.zeros((4, 4), dtype=np.float32), 1 / 1023)
    return RawFrame(Path("1.dng"), "0" * 64, {"G1": plane}, Exposure(**exposure))


FACTS = {
    "focal_length_mm": 24.0, "pixel_pitch_um": 5.94, "chart_width_mm": 96.0, "ruler_mm": 99.5, "typed_f_number": 6.4,
    "laser_offset_mm": 120.0, "tail_f_number": 8.1, "tail_f_number_uncertainty": 0.0,
}  # fmt: skip


def test_what_the_camera_noted_is_its_word_and_the_rest_the_operator_s():
    # an f-number off by 20 % lies within three deviations of what the far tail tells: it is nobody's word but one's own
    told = provenance_of(plan_named("pattern"), FACTS, [noted(focal_length_mm=24.0)])
    assert {key: str(word) for key, word in told.items()} == {
        "focal_length_mm": "24 mm, as the camera noted it",
        "pixel_pitch_um": "5.94 µm, the operator's word; the laser agrees with it and the other sizes together",
        "chart_width_mm": "96 mm, the operator's word; the laser agrees with it and the other sizes together",
        "ruler_mm": "99.5 mm, the operator's word; the laser agrees with it and the other sizes together",
        "typed_f_number": "6.4, the operator's word; the far tail of the PSF tells 8.1 ± 0.8",
    }


def test_what_was_insisted_on_or_held_against_nothing_says_so():
    facts = {"focal_length_mm": 30.0, INSISTED + "focal_length_mm": True, "typed_f_number": 8.0}
    told = provenance_of(plan_named("field"), facts, [noted(focal_length_mm=24.0)])
    assert told["focal_length_mm"].held_against == "insisted on against what contradicts it"
    assert str(told["typed_f_number"]) == "8, the operator's word; nothing vouches for it"


def test_each_of_three_f_numbers_is_held_against_its_own_photograph():
    facts = {"first_f_number": 8.0, "second_f_number": 4.0, "third_f_number": 2.8}
    frames = [noted(f_number=8.0), noted(f_number=5.6), noted(f_number=2.8)]
    told = provenance_of(plan_named("restoration"), facts, frames)
    assert [word.told_by for word in told.values()] == ["camera", "operator", "camera"]
    # a photograph that is not there vouches for nothing
    two = provenance_of(plan_named("restoration"), facts, frames[:2])
    assert [word.told_by for word in two.values()] == ["camera", "operator", "operator"]


@pytest.mark.parametrize("plan", PLANS)
def test_every_number_whose_name_tells_that_it_is_measured_or_read_off_is_named(plan):
    asked = {key for key, ask in plan_named(plan).asks().items() if ask.kind == "number"}
    # a wish, or what others are held against
    chosen = {"wanted_mtf50", "places", "views", "ratio", "max_w", "tape_mm", "photographs"}
    assert asked <= {*NAMES, *chosen}
