import math

import numpy as np
import pytest

from procedures import BadInput, BadParameter, Chart
from station.batch.procedure_file import read_procedure
from station.results.limits import Limit
from station.results.terms import USUAL

WHOLE = """
procedure = "pattern"
planes = ["G1", "B"]
coverage = 3
parameters = { s = 3, k = 13, solver = "nnls" }
chart = { seed = 5 }
optics = { pixel_pitch_um = 3.76, f_number = 8 }
[limits]
mtf50_horizontal = { min = 0.25 }
energy_above_nyquist = { max = 0.1, planes = ["G1"] }
"""


def test_file_is_read_as_it_is_written(procedure_file):
    found = read_procedure(procedure_file(WHOLE))
    assert (found.name, found.settings.plane) == ("pattern", "G1,B")
    assert (found.settings.s, found.settings.k, found.settings.solver) == (3, 13, "nnls")
    assert (found.settings.pixel_pitch_um, found.settings.f_number) == (3.76, 8.0)
    np.testing.assert_array_equal(found.settings.source.chart.cells, Chart.from_seed(5).cells)
    assert found.terms.specification.limits == (
        Limit("mtf50_horizontal", 0.25, math.inf, 3.0),
        Limit("energy_above_nyquist", -math.inf, 0.1, 3.0, ("G1",)),
    )


@pytest.mark.parametrize("text", ["", 'procedure = "two-photo"'])
def test_what_is_left_out_is_as_in_the_command(procedure_file, text):
    found = read_procedure(procedure_file(text))
    settings = found.settings
    assert (settings.s, settings.k, settings.plane, found.terms) == ("auto", "auto", None, USUAL)
    assert found.parameters()["s"] == "auto"


def test_auto_and_numbers_are_what_s_and_k_can_be(procedure_file):
    settings = read_procedure(procedure_file('parameters = { s = "auto", k = 21 }')).settings
    assert (settings.s, settings.k) == ("auto", 21)


@pytest.mark.parametrize(
    ("text", "reason", "remedy"),
    [
        ("proceedure = 'pattern'", "proceedure is not known", "write procedure"),
        ("parameters = { solvr = 'ls' }", "parameters.solvr is not known", "write solver"),
        ("limits = { mtf50_horizontl = { min = 1 } }", "limits.mtf50_horizontl is not known", "write mtf50_horizontal"),
        ("limits = { gamma = { minimum = 1 } }", "limits.gamma.minimum is not known", "write min"),
        ("limits = { gamma = { min = 2, max = 1 } }", "limits.gamma.min and max must leave a range", "min below max"),
        ("limits = { gamma = {} }", "must leave a range", "give min"),
        ("limits = { gamma = { min = nan } }", "limits.gamma.min must be finite", "correct"),
        ("procedure = 'patern'", "procedure must be one of correct, edge, field", "write procedure = "),
        ("procedure = 'edge'\nparameters = { s = 4 }", "parameters.s is not known", ""),
        ("procedure = 'edge'\nphysics = true", "physics is not known", "write optics"),
        ("specification = 'x.toml'\nlimits = { gamma = { min = 1 } }", "are both given", "one of them"),
        ("at = [-1]", "at must be a list, each a number at least 0", "correct"),
        ("unit = 'lp/inch'", "unit must be one of cycles/pixel, lp/mm, lw/ph", "correct"),
        ("planes = ['G']", "planes must be a list, each one of R, G1, G2, B, Y, all", "correct"),
        ("parameters = { k = 16 }", "k must be odd", "k = 17"),
        ("parameters = { s = 2.5 }", 'parameters.s must be a whole number or "auto"; it is 2.5', "correct"),
        ("parameters = { s = true }", "parameters.s must be a whole number", "correct"),
        ("chart = { seed = 1, bits = 'x.pgm' }", "from its cells or from its seed", "one of them"),
        ("chart = { bits = 'a\\u0000b' }", "chart.bits", "correct"),
        ('specification = "a\\u0000b"', "specification must be a path", "correct"),
        ('procedure = "two-photo"\npairs = { table = "a\\u0000b" }', "pairs.table must be a path", "correct"),
        ("trust_typed = 1", "trust_typed must be true or false; it is 1", "write trust_typed = true"),
        ('raw = "8x6,RGGB"', "samples must have five or three parts", "as 1920x1080"),
        ("optics = { f_number = 0 }", "optics.f_number must be a number at least 0.1", "correct"),
        ("optics = { f_number = inf }", "optics.f_number must be finite; it is inf", "correct"),
        ("parameters = { s = 3 }\nsettings = { s = 4 }", "settings.s and parameters.s are both given", "one of them"),
        ("coverage = -1", "coverage must be a number at least 0", "2"),
        ("pairs = { near = '_a' }", "pairs is not known", "parameters"),
        ("procedure = 'two-photo'\npairs = { near = '_a', far = '_a' }", "two different endings", "_near"),
        ("procedure = 'two-photo'\nchart = { seed = 1 }", "chart is not known", "use one of"),
        ("a = [", "must be a TOML file", "correct it"),
        ("'x\\u001b[2J' = 1", "is not known", "use one of"),
    ],
)
def test_what_cannot_be_meant_is_named_with_the_nearest(procedure_file, text, reason, remedy):
    with pytest.raises(BadParameter) as refused:
        read_procedure(procedure_file(text.replace("'", '"')))
    assert reason.replace("'", "") in refused.value.reason.replace("'", "")
    assert remedy in refused.value.remedy
    assert refused.value.reason.isprintable()


def test_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(BadParameter, match=r"none\.toml must be a TOML file"):
        read_procedure(tmp_path / "none.toml")


def test_cells_are_looked_for_beside_the_file(procedure_file):
    with pytest.raises(BadInput, match=r"there is no file .*cells\.pgm"):
        read_procedure(procedure_file('chart = { bits = "cells.pgm" }'))


def test_whatever_changes_a_result_changes_the_fingerprint(procedure_file):
    texts = [WHOLE, "", 'procedure = "two-photo"', "chart = { seed = 2 }", "parameters = { k = 19 }", "planes = ['B']"]
    texts += ["trust_typed = true", 'raw = "8x6,RGGB,u8,0,255"', 'raw = "8x6,BGGR,u8,0,255"']
    texts += ["optics = { f_number = 8 }", "limits = { gamma = { max = 1 } }", "limits = { gamma = { max = 2 } }"]
    prints = [repr(read_procedure(procedure_file(text)).fingerprint()) for text in texts]
    assert len(set(prints)) == len(texts)
