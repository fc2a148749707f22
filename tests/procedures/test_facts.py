"""A plan's facts: a mapping as the journal holds it becomes values of their types, and what depends on what."""

import pytest

from procedures.field.plan import FieldFacts
from procedures.outcome import BadParameter
from procedures.pattern_psf.facts import PatternFacts, RangeLook
from procedures.plan import AxisTravel, CameraFacts, Facts, dropped, facts_as


def test_each_fact_is_of_its_type_and_what_is_not_known_is_none():
    facts: Facts = {"chart_seed": 7.0, "focal_length_mm": 24, "focus_by": "rail", "something_else": True}
    known = facts_as(PatternFacts, facts)
    assert (known.chart_seed, known.focal_length_mm, known.focus_by) == (7, 24.0, "rail")
    assert (known.pixel_pitch_um, known.f_number, known.axes) == (None, None, {})


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("focal_length_mm", "24 mm", "a number"),
        ("focal_length_mm", True, "a number"),
        ("focal_length_mm", float("nan"), "a number"),
        ("chart_seed", 1.5, "a whole number"),
        ("focus_by", 3.0, "a text"),
        ("at_z_mm", "far", "a number"),
    ],
)
def test_a_value_that_is_no_such_thing_is_named(name, value, words):
    with pytest.raises(BadParameter, match=f"{name} must be {words}"):
        facts_as(PatternFacts, {name: value})


def test_facts_are_derived_read_from_older_sessions_and_dropped_with_their_inputs():
    axes = facts_as(CameraFacts, {"at_z_mm": 5.0, "low_z_mm": 0.0, "high_z_mm": 10.0, "at_pan_deg": 1.0}).axes
    assert axes == {"z_mm": AxisTravel(5.0, 0.0, 10.0), "pan_deg": AxisTravel(1.0)}
    assert (axes["z_mm"].nearest(12.0), axes["z_mm"].nearest(-1.0), axes["z_mm"].middle) == (10.0, 0.0, 5.0)
    assert axes["pan_deg"].nearest(400.0) == 400.0
    assert axes["z_mm"].holds(10.0)
    assert not axes["z_mm"].holds(10.1)
    facts: Facts = {"range_looks": 1.0, "range_1_cell_px": 0.3, "range_1_laser_mm": 900.0}
    assert facts_as(PatternFacts, facts).looks == (RangeLook(0.3, 900.0),)
    with pytest.raises(BadParameter, match="focal length is not known; answer the step `distance`"):
        PatternFacts(chart_width_mm=96.0, pixel_pitch_um=5.9).wanted_distance_mm()
    known = ["laser_offset_mm", "range_looks", "range_1_cell_px", "tour_x", "tour_from_z_mm", "focal_length_mm", "lit"]
    assert dropped(PatternFacts, ["focal_length_mm"], known) == {"laser_offset_mm"}
    assert dropped(FieldFacts, ["focal_length_mm"], known) == {"laser_offset_mm", "tour_x", "tour_from_z_mm"}
    assert dropped(FieldFacts, ["lit", "exposure_s"], known) == frozenset()
    assert {"range_looks", "range_1_cell_px"} < dropped(PatternFacts, ["chart_width_mm"], known)
