"""The base class of procedures of photographs, with a procedure of three lines."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from procedures.outcome import BadParameter, Outcome, Quantity, Verdict
from station.procedure import PhotographProcedure, PlaneSettings
from station.procedure.base import PictureSettings, beside, chart_source, plane_result
from station.results.result_files import plain
from station.results.units import Unit

MEAN = Quantity(0.5, "1", 0.1, "mean", 9)


class Mean(PhotographProcedure[PlaneSettings]):
    """The mean of a plane; a plane darker than one half is refused."""

    name, title, help = "mean", "mean", "Measure the mean."

    def run(self, frames, settings):
        level = {name: float(plane.samples.mean()) for name, plane in frames[-1].planes.items()}
        return {
            name: Outcome(SimpleNamespace(numbers={"mean": Quantity(mean, "1", 0.1, "", 9)}, curves={}), Verdict.PASS)
            if mean > 0.5 else Outcome(None, Verdict.REFUSED, "it is dark", "expose longer")
            for name, mean in level.items()
        }  # fmt: skip


@pytest.fixture
def photograph(tmp_path):
    def write(name, level):
        cv2.imwrite(str(tmp_path / name), np.full((6, 8), round(65535 * level), np.uint16))
        return tmp_path / name

    return write


def test_a_photograph_becomes_a_record(photograph):
    paths, seen = [photograph("a.png", 0.25), photograph("b.png", 0.75)], []
    measured = Mean().measure(paths, PlaneSettings(), progress=lambda name, *_: seen.append(name))
    assert seen == ["read a.png", "read b.png"]
    record = plain(measured.record())
    assert [one["path"] for one in record["input"]] == [str(path) for path in paths]
    assert (record["schema"], record["procedure"]) == ("station/mean/1", "mean")
    assert record["planes"]["Y"]["mean"]["value"] == pytest.approx(0.75, abs=1e-4)
    assert not measured.refused
    assert Mean().measure(paths[:1], PlaneSettings()).refused
    assert (Mean.has_page, Mean.usual_page, Mean.has_mtf, Mean().steps(paths)) == (True, True, False, 2)
    assert [Mean().draws(one) for one in (measured, Mean().measure(paths[:1], PlaneSettings()))] == [True, False]


@pytest.mark.parametrize(
    ("value", "numbers"),
    [
        (None, {}),
        (SimpleNamespace(numbers={"mean": MEAN}), {"mean": MEAN}),
        (SimpleNamespace(numbers=lambda: {"mean": MEAN}), {"mean": MEAN}),
    ],
)
def test_a_plane_has_the_numbers_of_its_estimate(value, numbers):
    plane = plane_result("Y", Outcome(value, Verdict.DOUBTFUL, "dim", "more light"), {"kept": 3})
    assert (plane.name, plane.verdict, plane.reason, plane.remedy) == ("Y", Verdict.DOUBTFUL, "dim", "more light")
    assert (plane.numbers, plane.curves, plane.details["kept"]) == (numbers, {}, 3)
    assert (plane.pitch, plane.duration_s, plane.unit) == (0, 0.0, Unit.CYCLES)


def test_a_chart_is_given_once(tmp_path):
    usual, first, second = (chart_source(None, seed).chart.cells for seed in (None, 1, 2))
    np.testing.assert_array_equal(usual, first)
    assert (usual != second).any()
    with pytest.raises(BadParameter, match="from its cells or from its seed"):
        chart_source(tmp_path / "cells.png", 1)


def test_a_path_lies_beside_the_file_that_names_it_unless_it_is_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here.png").touch()
    folder = tmp_path / "folder"
    assert beside(tmp_path / "away.png", folder) == tmp_path / "away.png"
    for name, expected in (("here.png", "here.png"), ("there.png", str(folder / "there.png"))):
        assert str(beside(type(tmp_path)(name), folder)) == expected


def test_a_pgm_is_linear_also_where_that_is_stated(tmp_path):
    (path := tmp_path / "a.pgm").write_bytes(b"P5 3 2 200\n" + bytes([100] * 6))
    assert (PictureSettings(encoding="linear").read(path).planes["Y"].samples == 0.5).all()
    with pytest.raises(BadParameter, match="a PGM are taken as linear; srgb is stated"):
        PictureSettings(encoding="srgb").read(path)
