"""Stated error of a developed picture under a wrong tone curve, against the picture under the true one."""

from dataclasses import replace

import numpy as np
import pytest

from procedures.correction.estimate import correct
from procedures.reading.development import POINTS, SRGB, Development, ToneCurve, named_curve

from .lens_photographs import Sensor
from .small_lens import RIM, SmallLens, grey, scene

SHAPE = (110, 140)


def test_stated_error_is_that_of_a_wrong_curve():
    lens, curve = SmallLens(SHAPE, 0.7), named_curve(SRGB)
    true = ToneCurve("square", np.linspace(0, 1, POINTS) ** 2)
    photograph = grey(lens, scene(tuple(n + 2 * RIM for n in SHAPE)), Sensor(white_e=60000.0)).frame
    levels = np.rint(255 * true.encoded(photograph.planes["Y"].samples)) / 255

    def corrected(read_as, *, assumed):
        plane = replace(photograph.planes["Y"], samples=read_as.decoded(levels))
        development = Development("PNG", read_as, assumed, 8)
        return correct(replace(photograph, planes={"Y": plane}, development=development), {"Y": lens.field("Y").field})

    wrong, right = (corrected(one, assumed=one is curve).result() for one in (curve, true))
    light = np.sqrt(np.mean((wrong.picture - right.picture) ** 2))
    encoded = np.sqrt(np.mean((curve.encoded(wrong.picture) - true.encoded(right.picture)) ** 2))
    assert right.curve_error is None
    assert wrong.curve_error.light == pytest.approx(light, rel=0.5)
    assert wrong.curve_error.levels == pytest.approx(encoded, rel=0.7)
