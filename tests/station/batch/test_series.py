"""A series: photographs of one setting together, the best aperture and how sure it is, its table and page."""

import csv
import io
from dataclasses import replace

import html5lib
import numpy as np
import pytest

from station.batch.item import ItemRow, PlaneRow
from station.batch.procedure_file import read_procedure
from station.calibration.series import Point, SeriesSetting, best_apertures, points_of, series_table, several
from station.procedure.builtin.series import Series
from station.reports.batches.series_page import series_page
from tests.program import run


def row(f_number, mtf50, sd=0.001, plane="G1", verdict="pass", **noted):
    numbers = {
        f"mtf50_{along}": {"value": value, "uncertainty": sd, "unit": "cycles/pixel"}
        for along, value in (("horizontal", mtf50 - 0.01), ("vertical", mtf50 + 0.01))
    }
    notes = {"f_number": f_number, "iso": 100.0, **noted} if f_number else noted
    return ItemRow(("a",), verdict, planes={plane: PlaneRow(verdict, "", "", numbers)}, noted=notes)


def test_photographs_of_one_setting_are_put_together_in_order():
    (point,) = points_of([row(4.0, 0.30, 0.002), row(4.0, 0.30, 0.002), row(4.0, 0.9, verdict="refused")])
    assert (point.value, point.photographs) == (pytest.approx(0.30), 2)
    assert point.uncertainty == pytest.approx(0.002 / 2**0.5)
    (point,) = points_of([row(4.0, 0.29, 0.001), row(4.0, 0.31, 0.001)])
    # of two values the standard error is half their distance
    assert point.uncertainty == pytest.approx(0.01)
    (point,) = points_of([replace(row(4.0, 0.30, 0.002), sha256=("a",))] * 2)  # a photograph and its copy
    assert (point.uncertainty, point.photographs) == (pytest.approx(0.002), 1)
    points = points_of([row(8.0, 0.3), row(4.0, 0.3), row(4.0, 0.2, iso=400.0), row(4.0, 0.3, plane="B")])
    assert [(one.plane, one.setting.f_number, one.setting.iso) for one in points] == [
        ("B", 4.0, 100.0), ("G1", 4.0, 100.0), ("G1", 4.0, 400.0), ("G1", 8.0, 100.0),
    ]  # fmt: skip


@pytest.mark.parametrize(("apart", "confidence"), [(10.0, 1.0), (0.0, 0.5), (1.0, 0.760)])
def test_confidence_in_the_best_aperture_is_the_chance_that_it_is(apart, confidence):
    sd = 0.001
    points = [Point("G1", "mtf50", SeriesSetting(f, None, None), value, sd, "cycles/pixel", 1)
              for f, value in ((4.0, 0.3), (5.6, 0.3 + apart * sd))]  # fmt: skip
    (best,) = best_apertures(points)
    # Phi(apart / sqrt 2); 20000 draws give a share to 0.0035: four of these
    assert best.confidence == pytest.approx(confidence, abs=0.014)
    if apart:
        assert best.f_number == 5.6
        assert "best at f/5.6, MTF50 0.3" in best.words


def test_a_series_has_a_table_and_a_page_of_every_point():
    assert best_apertures(points_of([row(4.0, 0.3), row(4.0, 0.31)])) == []
    assert best_apertures(points_of([row(None, 0.3)])) == []
    points = points_of([row(f, v) for f, v in ((2.8, 0.25), (4.0, 0.31), (5.6, 0.33), (None, 0.2))])
    table = list(csv.DictReader(io.StringIO(series_table(points).decode())))
    assert [one["f_number"] for one in table] == ["", "2.8", "4", "5.6"]
    np.testing.assert_allclose([float(one["value"]) for one in table], [0.2, 0.25, 0.31, 0.33])
    page = series_page(points, [one.words for one in best_apertures(points)])
    tree = html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(page)
    text = " ".join(" ".join(tree.itertext()).split())
    assert "Best at f/5.6" in text or "best at f/5.6" in text
    assert "over the f-number; the bars hold 95 %" in page
    rows = [row(4.0, 0.3, lens="50 mm", camera="one"), row(5.6, 0.3, lens="35 mm", camera="one"), row(8.0, 0.3)]
    assert several(rows) == ["the photographs are of several lenses: 35 mm, 50 mm"]
    rows = [row(4.0, 0.31), row(5.6, 0.33)]
    found = Series().summary(rows)
    assert list(found.files) == ["series.csv", "series.html"]
    assert found.files["series.csv"] == series_table(points_of(rows))
    assert found.lines[0].startswith("G1: best at f/5.6")
    assert "--pixel-pitch-um" in found.lines[1]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--pixel-pitch-um", "4"], "optics = { pixel_pitch_um = 4 }"),
        (["--plane", "B", "--unit", "lw/ph", "-k", "13"], 'planes = ["B"]\nunit = "lw/ph"\nparameters = { k = 13 }'),
    ],
)
def test_the_command_is_a_batch_of_that_procedure(tmp_path, monkeypatch, words, text):
    stated = []
    monkeypatch.setattr("station.cli.batch.carry_out", lambda procedure, folders, out, **more: stated.append(procedure))
    run("psf", "series", tmp_path, *words, "--out", tmp_path / "out")
    (tmp_path / "p.toml").write_text(f'procedure = "series"\n{text}\n')
    assert stated[0].fingerprint() == read_procedure(tmp_path / "p.toml").fingerprint()
