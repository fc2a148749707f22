"""Provenance of input numbers, and the evidence compared with them."""

from pathlib import Path

import numpy as np
import pytest

from procedures.plan import INSISTED
from procedures.raw import Exposure, Plane, RawFrame
from station.guide.catalogue import PLANS, plan_named
from station.guide.provenance import NAMES, provenance_of


def noted(**exposure: float) -> RawFrame:
    """A photograph with this metadata of the camera."""
    plane = Plane("G1", np.zeros((4, 4), dtype=np.float32), 1 / 1023)
    return RawFrame(Path("1.dng"), "0" * 64, {"G1": plane}, Exposure(**exposure))


FACTS = {
    "focal_length_mm": 24.0, "pixel_pitch_um": 5.94, "chart_width_mm": 96.0, "ruler_mm": 99.5, "typed_f_number": 6.4,
    "laser_offset_mm": 120.0, "tail_f_number": 8.1, "tail_f_number_uncertainty": 0.0,
}  # fmt: skip


def test_the_source_of_each_number_is_marked():
    # an f-number wrong by 20 % is consistent with the far tail within three standard deviations: it is not verified
    provenance = provenance_of(plan_named("pattern"), FACTS, [noted(focal_length_mm=24.0)])
    assert {key: str(one) for key, one in provenance.items()} == {
        "focal_length_mm": "24 mm, recorded by the camera",
        "pixel_pitch_um": "5.94 µm, given by the operator; consistent with the laser and the other sizes",
        "chart_width_mm": "96 mm, given by the operator; consistent with the laser and the other sizes",
        "ruler_mm": "99.5 mm, given by the operator; consistent with the laser and the other sizes",
        "typed_f_number": "6.4, given by the operator; the far tail of the PSF gives 8.1 ± 0.8",
    }
    facts = {"focal_length_mm": 30.0, INSISTED + "focal_length_mm": True, "typed_f_number": 8.0}
    provenance = provenance_of(plan_named("field"), facts, [noted(focal_length_mm=24.0)])
    assert provenance["focal_length_mm"].evidence == "confirmed by the operator despite a contradiction"
    assert str(provenance["typed_f_number"]) == "8, given by the operator; not verified"
    facts = {"first_f_number": 8.0, "second_f_number": 4.0, "third_f_number": 2.8}
    frames = [noted(f_number=8.0), noted(f_number=5.6), noted(f_number=2.8)]
    provenance = provenance_of(plan_named("restoration"), facts, frames)
    assert [one.source for one in provenance.values()] == ["camera", "operator", "camera"]
    # a missing photograph verifies nothing
    two = provenance_of(plan_named("restoration"), facts, frames[:2])
    assert [one.source for one in two.values()] == ["camera", "operator", "operator"]


@pytest.mark.parametrize("plan", PLANS)
def test_every_measured_or_read_number_is_named(plan):
    asked = {key for key, ask in plan_named(plan).asks().items() if ask.kind == "number"}
    # a target, or a reference for others
    chosen = {"wanted_mtf50", "places", "views", "ratio", "max_w", "farther", "tape_mm", "photographs"}
    assert asked <= {*NAMES, *chosen}
