"""The plan of a restoration with measured shapes: refusals when they are named, and the blur."""

from pathlib import Path

import numpy as np
import pytest

from procedures import BadInput, BadParameter, KnownShapes, blur_of
from procedures.plan import HAS_SHAKER, facts_as
from procedures.raw import Plane, RawFrame
from procedures.reading.exposure import Exposure
from procedures.restoration.facts import MOTIONS, RestorationFacts
from procedures.restoration.known_blur import blur_spec
from procedures.restoration.masks.psf_shapes import measured_shape
from procedures.restoration.plan import plan
from procedures.restoration.plan_checks import checks

FACTS = {"blur_by": "apertures", "max_w": 4.4, "first_f_number": 5.0, "second_f_number": 4.0}


def frame(samples):
    return RawFrame(Path("a"), "", {"Y": Plane("Y", samples.astype(np.float32), 1 / 65535)}, Exposure())


def measured(name, plane, size):
    """Stands for files: a measured PSF, a text array, or none."""
    if name.endswith(".npy"):
        side = 2 * int(name[0]) + 1
        return measured_shape(np.pad(np.ones((side, side)), 2), 1)
    if name.endswith(".txt"):
        return np.ones((5, 5))
    raise BadInput(f"{name} cannot be read", "name another")


def test_shapes_from_files_are_refused_or_end_the_search():
    ask = plan(measured).asks()["shape"]
    two, three = {"photographs": 2.0}, {"photographs": 3.0}
    for good in ("pillbox", "3.npy", "3.npy; 4.npy", "polygon:7;5.txt"):
        ask.check(good, two)
    with pytest.raises(BadInput, match="gone cannot be read"):
        ask.check("3.npy; gone", two)
    with pytest.raises(BadParameter, match="one for each of 3 photographs; got 2"):
        ask.check("3.npy; 4.npy", three)
    assert [ask.names_file(one) for one in ("pillbox", "polygon:7", "3.npy")] == [False, False, True]
    with pytest.raises(BadParameter, match=r"no aperture is called '3\.npy'"):
        plan().asks()["shape"].check("3.npy", two)
    ask = plan(measured).asks()["motion_shape"]
    known = {"blur_by": MOTIONS, "photographs": 2.0}
    ask.check("search", known)
    ask.check("3.npy; 5.txt", known)
    with pytest.raises(BadParameter, match="2 motions need 2 kernels; got 1"):
        ask.check("3.npy", known)
    with pytest.raises(BadParameter, match="pillbox is the shape of an aperture"):
        ask.check("pillbox; 3.npy", known)
    answers = {**known, "motion_shape": "3.npy; 5.txt"}
    keys = {key for key, one in plan().asks().items() if one.when(answers)}
    assert "region" not in keys
    assert not ask.when({**known, HAS_SHAKER: True})


def test_measured_shapes_are_common_or_each_photographs_and_fields_of_its_size(rng):
    image = 0.5 + 0.1 * rng.standard_normal((80, 96))
    frames, apertures = [frame(image)] * 2, {**FACTS, "shape": "3.npy"}
    one = blur_spec(frames, facts_as(RestorationFacts, apertures), measured).source
    assert (len(one.shapes), one.ratios) == (2, (1.0, 1.25))
    # one each: the ratio is that of their half-widths, 4.5 / 3.5
    each = blur_spec(frames, facts_as(RestorationFacts, {**apertures, "shape": "3.npy; 4.npy"}), measured)
    assert each.source.ratios == ()
    blur = blur_of(each, [image[None], image[None, ::-1]])
    assert blur.ratios[1] == pytest.approx(4.5 / 3.5)
    models = blur_spec(frames, facts_as(RestorationFacts, {**apertures, "shape": "pillbox; a.txt"}), measured)
    assert models.source.ratios == (1.0, 1.25)
    motions = {"blur_by": MOTIONS, "motion_shape": "3.npy; 5.txt"}
    assert isinstance(blur_spec(frames, facts_as(RestorationFacts, motions), measured).source, KnownShapes)

    def of_field(name, plane, size):
        if size is not None:
            raise BadInput(f"the field is not of {plane}, {size[1]} x {size[0]}", "give whole photographs")

    advice = checks(of_field)["first"](frame(image), {**FACTS, "shape": "field.h5"})
    assert advice.contradictory == ("shape",)
    assert "not of Y, 96 x 80: give whole" in advice.say
