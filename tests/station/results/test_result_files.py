import contextlib
import csv
import errno
import hashlib
import json
import math
import os
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from procedures import Diffraction, Psf, assess
from procedures.choice import with_parts
from procedures.numbers import GAUSSIAN_RADIUS, MTF50_RADIAL
from procedures.outcome import BadParameter, Outcome, Quantity, Verdict
from procedures.physics.estimate import Physics
from procedures.sensor.defects import IntervalNumber
from station.drawing.pictures import psf_picture
from station.results.plane_result import PlaneResult, numbers_of
from station.results.psf_files import information_table, write_psf_result
from station.results.record_head import RecordHead
from station.results.result_files import ResultFolder, json_text, number_record, plane_record, write_record
from tests.psfs import gaussian


def psf_of(h, s=4):
    return Psf(h, s, np.zeros((h.size, h.size)))


def delta(k, row, column):
    h = np.zeros((k, k))
    h[row, column] = 1.0
    return h


def test_physics_of_a_psf_stands_in_its_plane(tmp_path):
    h = delta(3, 1, 1)
    number = Quantity(0.95, "pixel", 0.01, "known", 9)
    physics = Physics("square", "four spots", None, {"side": number}, 250.0, 240, 0.001, h, (("square", 0.0),))
    record = PlaneResult.of("G1", Verdict.PASS, psf_of(h), physics=Outcome(physics, Verdict.DOUBTFUL, "why", "what"))
    with ResultFolder(tmp_path) as folder:
        stated = json.loads(write_psf_result(folder, [record], RecordHead("pattern")))["planes"]["G1"]["physics"]
    assert (stated["verdict"], stated["reason"], stated["remedy"]) == ("doubtful", "why", "what")
    assert (stated["aperture"], stated["low_pass_filter"], stated["missing_corner_deg"]) == (
        "square",
        "four spots",
        None,
    )
    assert stated["side"]["value"] == 0.95
    assert stated["candidates"] == [{"model": "square", "criterion": 0.0}]


def test_every_term_of_every_number_is_told_beside_it(tmp_path):
    psf = gaussian(0.7, 3, 13)
    limit = Diffraction(8.0, 8.0, 530.0)
    quality = with_parts(assess(psf, n=5000, diffraction=limit), {"strehl": {"noise": 3e-4, "light": 4e-4}})
    record = PlaneResult.of("G1", Verdict.PASS, psf, quality, diffraction=limit)
    with ResultFolder(tmp_path) as folder:
        stated = json.loads(write_psf_result(folder, [record], RecordHead("pattern")))["planes"]["G1"]
    with (tmp_path / "budget.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["plane", "number", "term", "uncertainty", "unit"]
    strehl = {row["term"]: float(row["uncertainty"]) for row in rows if row["number"] == "strehl"}
    assert (strehl["noise"], strehl["light"]) == (3e-4, 4e-4)
    for name, number in quality.numbers.items():
        terms = [float(row["uncertainty"]) for row in rows if row["number"] == name]
        assert np.linalg.norm(terms) == pytest.approx(number.uncertainty, rel=1e-6)
    assert stated["diffraction"]["cutoff"] == pytest.approx(8.0 / (0.53 * 8.0))


def test_records_are_indented_by_one_and_hold_no_number_that_json_has_not():
    assert json_text({"a": [1, math.nan], "é": np.float64(0.5)}) == '{\n "a": [\n  1,\n  null\n ],\n "é": 0.5\n}\n'


OLDER = '{"schema": "station/psf/1"}'


def test_nothing_is_visible_before_it_is_published(tmp_path):
    with ResultFolder(tmp_path / "out") as folder:
        folder.write("psf_Y.npy", b"half")
        assert not (tmp_path / "out" / "psf_Y.npy").exists()
    assert not (tmp_path / "out").exists()


def test_folder_that_was_there_stays(tmp_path):
    with ResultFolder(tmp_path):
        pass
    assert tmp_path.is_dir()
    assert list(tmp_path.iterdir()) == []


def test_full_disk_is_named_and_the_older_result_stays(tmp_path, monkeypatch):
    (tmp_path / "result.json").write_text(OLDER)
    with ResultFolder(tmp_path) as folder:
        monkeypatch.setattr(Path, "write_bytes", Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
        with pytest.raises(BadParameter, match="No space left") as refusal:
            folder.write("psf_Y.npy", b"")
    assert "make room" in refusal.value.remedy
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_record_is_the_last_file_to_appear(tmp_path, monkeypatch):
    moved = []
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda source, target: (moved.append(target.name), replace(source, target)))
    with ResultFolder(tmp_path) as folder:
        for name in ("result.json", "psf_Y.npy", "covariance_Y.npy"):
            folder.write(name, b"")
        folder.publish()
    assert moved == ["covariance_Y.npy", "psf_Y.npy", "result.json"]


def test_record_of_the_older_result_goes_before_its_files_are_replaced(tmp_path, monkeypatch):
    (tmp_path / "result.json").write_text(OLDER)
    monkeypatch.setattr(os, "replace", lambda *_: pytest.fail("power is lost"))
    with ResultFolder(tmp_path) as folder:
        folder.write("psf_Y.npy", b"")
        with pytest.raises(pytest.fail.Exception):
            folder.publish()
    assert not (tmp_path / "result.json").exists()


def test_saved_psf_is_the_same_to_the_last_bit(tmp_path, rng):
    h = rng.normal(size=(5, 5))
    with ResultFolder(tmp_path) as folder:
        write_psf_result(folder, [PlaneResult.of("G1", Verdict.PASS, psf_of(h))], RecordHead("pattern"))
    np.testing.assert_array_equal(np.load(tmp_path / "psf_G1.npy", allow_pickle=False), h)
    assert json.loads((tmp_path / "result.json").read_text())["planes"]["G1"]["verdict"] == "pass"


def shown(psf):
    """The picture, and where it has the colour of the greatest value."""
    picture = cv2.imdecode(np.frombuffer(psf_picture(psf, "Y"), np.uint8), cv2.IMREAD_COLOR).astype(int)
    yellow = np.abs(picture[:, :560] - (37, 231, 253)).max(axis=2) < 3
    return picture, np.argwhere(yellow)


@pytest.mark.parametrize(("row", "column"), [(2, 8), (8, 2), (14, 14)])
def test_picture_shows_rows_downwards_and_columns_to_the_right(row, column):
    _, bright = shown(psf_of(delta(17, row, column)))
    top_left, bottom_right = bright.min(axis=0), bright.max(axis=0)
    # 480 // 17 = 28 picture pixels a sample, from (64, 40) on
    np.testing.assert_array_equal(top_left, [40 + 28 * row, 64 + 28 * column])
    np.testing.assert_array_equal(bottom_right - top_left, [27, 27])


@pytest.mark.parametrize(("s", "k"), [(2, 3), (3, 13), (8, 65)])
def test_picture_of_any_size_is_drawn(s, k):
    picture, _ = shown(psf_of(delta(k, k // 2, k // 2), s))
    assert min(picture.shape[:2]) >= 480


def test_folders_inside_are_published_too_and_foreign_files_stay(tmp_path):
    inner = tmp_path / "results" / "one"
    inner.mkdir(parents=True)
    for name in ("psf_R.npy", "notes.txt"):
        (inner / name).write_text("older")
    with ResultFolder(tmp_path) as folder:
        with ResultFolder(folder.staging / "results" / "one") as part:
            part.write("psf_B.npy", b"new")
            part.publish()
        folder.write("result.json", b"{}")
        folder.publish()
    assert sorted(path.name for path in inner.iterdir()) == ["notes.txt", "psf_B.npy", "psf_R.npy"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result.json", "results"]


@pytest.mark.parametrize("named", ["link", "link/result"])
def test_result_goes_where_a_link_to_a_folder_leads(tmp_path, named):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with ResultFolder(tmp_path / named) as folder:
        write_psf_result(folder, [], RecordHead("pattern"))
    assert (tmp_path / named.replace("link", "real") / "result.json").is_file()


def written(folder, *names, force=False, inputs=()):
    with ResultFolder(folder, force=force, inputs=inputs) as place:
        for name in names:
            place.write(name, b"the program's")
        write_record(place, {"schema": "station/psf/1"})


@pytest.mark.parametrize("name", ["report.html", "result.json", "sharp.tiff"])
def test_file_of_somebody_else_is_named_before_any_work_and_stays(tmp_path, name):
    (tmp_path / name).write_text("mine")
    with (
        pytest.raises(BadParameter, match=f"holds {name}, which the program has not written") as refusal,
        ResultFolder(tmp_path),
    ):
        pytest.fail("it was entered")
    assert "--force" in refusal.value.remedy
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "mine")]


def test_page_that_was_edited_is_not_the_programs_any_more(tmp_path):
    written(tmp_path, "report.html")
    written(tmp_path, "report.html")
    (tmp_path / "report.html").write_text("with my notes")
    with pytest.raises(BadParameter, match="not written in this form"):
        written(tmp_path, "psf_Y.npy")
    assert (tmp_path / "report.html").read_text() == "with my notes"
    written(tmp_path, "report.html", force=True)
    assert (tmp_path / "report.html").read_bytes() == b"the program's"


@pytest.mark.parametrize("force", [False, True])
def test_a_result_does_not_replace_its_own_inputs(tmp_path, force):
    # neither a file of an older result, which would be removed, nor one of the same name
    written(tmp_path, "field.h5", "report.html")
    (tmp_path / "other.bin").write_bytes(b"mine")
    with pytest.raises(BadParameter, match=r"would replace .*field.h5, which is read for it"):
        written(tmp_path, "psf_Y.npy", force=force, inputs=[tmp_path / "field.h5"])
    if force:
        with pytest.raises(BadParameter, match=r"would replace .*other.bin"):
            written(tmp_path, "other.bin", force=force, inputs=[tmp_path / "other.bin"])
    assert (tmp_path / "other.bin").read_bytes() == b"mine"
    assert (tmp_path / "field.h5").exists()


def test_files_of_an_older_result_go_and_others_stay(tmp_path):
    written(tmp_path, "psf_Y.npy", "report.html")
    (tmp_path / "mtf_notes.txt").write_text("mine")
    written(tmp_path, "psf_G1.npy")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mtf_notes.txt", "psf_G1.npy", "result.json"]


def test_folder_left_by_a_crash_between_two_files_is_still_the_programs(tmp_path, monkeypatch):
    written(tmp_path, "psf_Y.npy", "report.html")
    replace, moved = os.replace, []

    def one_only(source, target):
        if moved:
            raise KeyboardInterrupt
        moved.append(replace(source, target))

    monkeypatch.setattr(os, "replace", one_only)
    with pytest.raises(KeyboardInterrupt):
        written(tmp_path, "psf_Y.npy", "psf_G1.npy")
    monkeypatch.undo()
    assert not (tmp_path / "result.json").exists()
    written(tmp_path, "psf_Y.npy")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["psf_Y.npy", "result.json"]


def test_record_that_names_files_elsewhere_removes_none(tmp_path):
    (tmp_path / "precious.npy").write_bytes(b"")
    digest = hashlib.sha256(b"").hexdigest()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "result.json").write_text(
        json.dumps({"schema": "station/psf/1", "files": {"../precious.npy": digest}})
    )
    written(tmp_path / "out", "psf_Y.npy")
    assert (tmp_path / "precious.npy").exists()


def test_edges_and_the_gaussian_radius_stand_beside_the_psf():
    by_edge, by_psf = (Quantity(value, "cycles/pixel", 0.01, "known", 9) for value in (0.31, 0.30))
    edge = SimpleNamespace(
        edge=SimpleNamespace(orientation="vertical", normal_deg=3.0), by_edge=by_edge, by_psf=by_psf, difference=0.01,
        sigmas=0.7,
    )  # fmt: skip
    (entry,) = plane_record(PlaneResult("G1", Verdict.PASS, "", "", {}, edges=(edge,)))["edges"]
    assert (entry["orientation"], entry["normal_deg"], entry["difference"], entry["sigmas"]) == (
        "vertical", 3, 0.01, 0.7,
    )  # fmt: skip
    assert (entry["mtf50_edge"]["value"], entry["mtf50_psf"]["value"]) == (0.31, 0.30)
    mtf50 = Quantity(0.25, "cycles/pixel", 0.01, "", 9)
    assert dict(numbers_of(SimpleNamespace(numbers={"fwhm": mtf50}), 1)) == {"fwhm": mtf50}
    both = dict(numbers_of(SimpleNamespace(numbers={MTF50_RADIAL: mtf50}), 2))
    assert both.keys() == {MTF50_RADIAL, GAUSSIAN_RADIUS}
    # exp(-2 pi^2 sigma^2 f^2) = 1/2, in pixels of the sensor
    assert np.exp(-2 * (np.pi * both[GAUSSIAN_RADIUS].value / 2 * 0.25) ** 2) == pytest.approx(0.5)


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="no list of open files here")
@pytest.mark.parametrize("published", [True, False])
def test_folder_of_results_is_left_closed_and_empty_if_it_failed(tmp_path, published):
    before = os.listdir("/proc/self/fd")
    with contextlib.suppress(ZeroDivisionError), ResultFolder(tmp_path / "new" / "out") as folder:
        folder.write("a.txt", b"1")
        if not published:
            raise ZeroDivisionError
        write_record(folder, {"schema": "station/psf/1"})
    assert os.listdir("/proc/self/fd") == before
    assert (tmp_path / "new").exists() == published


def test_intervals_and_information_are_tabulated():
    known = {"value": 3.0, "unit": "bit", "uncertainty": 0.5, "method": "known", "n": 9}
    assert number_record(Quantity(**known)) == known
    assert number_record(IntervalNumber(**known, low=2.0, high=4.0)) == {**known, "interval": [2.0, 4.0]}
    names = ("mtf", "nps", "neq", "neq_uncertainty", "equivalent_mtf", "equivalent_mtf_uncertainty")
    maps = {name: np.arange(16.0).reshape(4, 4) + 100 * n for n, name in enumerate(names)}
    table = information_table(SimpleNamespace(frequencies=np.fft.fftfreq(4), **maps)).decode()
    rows = list(csv.reader(table.splitlines()))
    assert rows[0] == ["frequency_x [cycles/pixel]", "frequency_y [cycles/pixel]", *names]
    expected = [[fx, fy, *(one[j, i] for one in maps.values())]
                for j, fy in enumerate((0, 0.25, 0.5)) for i, fx in enumerate((0, 0.25, -0.5, -0.25))]  # fmt: skip
    np.testing.assert_array_equal(np.array(rows[1:], dtype=float), expected)
