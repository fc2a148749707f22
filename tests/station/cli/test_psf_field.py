import csv
import json
from functools import partial

import html5lib
import numpy as np
import pytest

from procedures import read_camera_numbers, read_field
from procedures.field import conclusion
from procedures.field.maps import derive
from procedures.pattern import CELLS, Chart
from simulators.camera.camera import SimulatedCamera
from simulators.camera.sensor import Sensor
from simulators.world.scene import Scene
from station.common.sanitise import stated
from station.results.result_files import ResultFolder, write_record
from tests.program import run

SLOW_FIXTURES = {"folder"}

CHART = Chart.from_seed()
WHITE_E = 4e5
SENSOR = Sensor(280, 310, None, bits=16, full_well_e=1.3 * WHITE_E, gain_e_per_dn=1.3 * WHITE_E / 65000)
CAMERA = SimulatedCamera(sensor=SENSOR, pitch_um=7.5, white_e_per_s=WHITE_E / 0.02, oversampling=5)
HEIGHTS = b"""image_height [pixel],frequency [cycles/pixel],sagittal,meridional
0,0.125,0.9,0.9
60,0.125,0.8,0.7
0,0.25,0.5,0.5
60,0.25,0.4,0.3
"""
"""Of another field: as much of its table as is drawn."""
PLACES = [(x, y) for y in (0.25, 0.75) for x in (0.18, 0.5, 0.82)]


def write_pgm(path, samples):
    data = np.clip(np.rint(samples * 65535), 0, 65535).astype(">u2")
    path.write_bytes(b"P5\n%d %d\n65535\n" % data.shape[::-1] + data.tobytes())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One frame with six charts, one without any, and a file that is no picture."""
    folder = tmp_path_factory.mktemp("frames")
    scene = Scene(tuple(CAMERA.place(CHART, pixels=66, at=at, roll_deg=2.0) for at in PLACES))
    shot = CAMERA.photograph(scene, np.random.default_rng(4))
    write_pgm(folder / "charts.pgm", shot.plane("Y"))
    write_pgm(folder / "empty.pgm", np.full((280, 310), 0.4))
    (folder / "torn.dng").write_bytes(b"II*\0")
    return folder, shot


@pytest.fixture(scope="module")
def done(folder, tmp_path_factory):
    """Maps have a ninth of their places."""
    out, older = tmp_path_factory.mktemp("out"), tmp_path_factory.mktemp("older")
    with ResultFolder(older, force=True) as other:
        other.write("heights_Y.csv", HEIGHTS)
        write_record(other, {"schema": "station/psf/1"})
    words = ["psf", "field", str(folder[0]), "--out", str(out), "-k", "13", "--certificate", "--json"]
    words += ["--overlay", str(older), "--without-photosite", "0.9,0.02"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conclusion, "derive", partial(derive, columns=7))
        return run(*words, code=None), out


def test_a_frame_that_fails_is_named_in_a_record_like_every_psf_s(done):
    result, out = done
    assert result.exit_code == 1, result.output
    summary = json.loads((out / "result.json").read_text())["field"]
    assert summary["failed"] == ["empty.pgm", "torn.dng"]
    assert "no chart" in summary["misses"][0]["reason"]
    assert "empty.pgm" in result.stderr
    record = json.loads(result.stdout)
    assert record["schema"] == "station/psf/1"
    assert record["procedure"] == "field"
    assert record["planes"]["Y"]["verdict"] in ("pass", "doubtful")
    assert np.load(out / "psf_Y.npy", allow_pickle=False).shape == (13, 13)
    plane = record["field"]["planes"]["Y"]
    median, of_chart = plane["mtf50_sagittal_median"], plane["budgets"]["mtf50_horizontal"]
    assert {"unit", "value", "uncertainty"} <= set(median)
    # charts of one print have its blur in common: more of them do not lower that part
    assert median["uncertainty"] > 0.7 * of_chart["print blur"] > 3 * of_chart["noise"]


def test_numbers_without_a_photosite_are_no_numbers_of_the_camera(done):
    record = json.loads(done[0].stdout)
    given, plane = record["parameters"], record["field"]["planes"]["Y"]
    assert given["photosite_fill"] == 0.9
    assert given["photosite_fill_uncertainty"] == 0.02
    assert given["photosite_fill_origin"] == "given"
    # what is divided by a photosite passes more
    assert plane["mtf50_sagittal_without_photosite_median"]["value"] > plane["mtf50_sagittal_median"]["value"]
    tables = (done[1] / f"{stem}_Y.csv" for stem in ("heights", "without_photosite"))
    camera, before = (np.genfromtxt(table, delimiter=",", names=True) for table in tables)
    assert np.all(before["sagittal"] > camera["sagittal"])
    assert "of fill factor 0.9 ± 0.02 (as given)" in (done[1] / "report.html").read_text()


@pytest.mark.parametrize(
    ("words", "said"), [("frames", "is no fill factor"), ("1.2", "a fill factor must be greater than 0")]
)
def test_a_fill_factor_that_cannot_be_meant_is_named(tmp_path, words, said):
    run("psf", "field", tmp_path, "--out", tmp_path / "out", "--without-photosite", words, code=2, says=said)


def test_numbers_of_all_places_have_one_covariance_and_a_certificate(done):
    camera = read_camera_numbers(done[1] / "camera.h5")
    assert camera.names[0] == "psf.Y.1.mtf50_horizontal"
    assert len(camera.numbers("psf.Y.6.")) == 5
    summary = json.loads(done[0].stdout)["field"]["camera"]
    assert summary["file"] == "camera.h5"
    assert summary["parts"] == ["psf.Y"]
    assert summary["geometry"]["verdict"] == "refused"
    assert "several charts" in summary["geometry"]["reason"]
    assert "several charts" in (done[1] / "report.html").read_text()
    record = json.loads(done[0].stdout)
    text = (done[1] / "certificate.html").read_text()
    number = record["field"]["planes"]["Y"]["mtf50_sagittal_median"]
    assert f"MTF50 of sagittal detail, median over the frame, {number['unit']}" in text
    assert stated(number["value"], 2 * number["uncertainty"]) in text
    assert "at the frame&#39;s centre or over the frame" in text
    assert (done[1] / "certificate.pdf").read_bytes().startswith(b"%PDF")


def test_page_and_table_show_the_mtf_over_image_height(done):
    page = (done[1] / "report.html").read_text()
    rows = list(csv.DictReader((done[1] / "heights_Y.csv").read_text().splitlines()))
    assert {"image_height [pixel]", "frequency [cycles/pixel]", "sagittal", "meridional_uncertainty"} <= rows[0].keys()
    assert {row["frequency [cycles/pixel]"] for row in rows} == {"0.125", "0.25"}
    # the band has the blur of the print, as the numbers have
    (at_centre,) = [
        float(row["radial_uncertainty"])
        for row in csv.DictReader((done[1] / "mtf_Y.csv").read_text().splitlines())
        if float(row["frequency [cycles/pixel]"]) == 0.12
    ]
    assert float(rows[0]["sagittal_uncertainty"]) > 0.8 * at_centre
    assert "Sagittal (solid) and meridional MTF (dashed) over image height" in page
    assert "Thin, with markers: older" in page
    assert "dotted: enclosed by the charts" in page
    assert "Beyond it the uncertainty grows" in page
    html5lib.HTMLParser(strict=True).parse(page)


def test_the_file_holds_all_charts_at_their_places(folder, done):
    field = read_field(done[1] / "field.h5")["Y"]
    middle = np.full((1, 2), CELLS / 2)
    true = np.array([folder[1].true_points("Y", middle, i)[0] for i in range(len(PLACES))])
    # the centre of a chart is known to a few thousandths of a pixel
    np.testing.assert_allclose(field.positions, true, atol=0.02)
    # the lens is the same everywhere: between the nodes as at them
    psf = field.at(150.0, 140.0)
    truth = folder[1].true_psf("Y", 4, 13).h
    assert np.linalg.norm(psf.h - truth) < 3 * np.sqrt(np.trace(psf.covariance)) + 0.02 * np.linalg.norm(truth)


def test_too_few_charts_are_refused(tmp_path):
    placed = CAMERA.place(CHART, pixels=66)
    shot = CAMERA.photograph(Scene((placed,)), np.random.default_rng(4))
    write_pgm(tmp_path / "one.pgm", shot.plane("Y"))
    with ResultFolder(tmp_path / "out") as older:
        older.write("field.h5", b"of an older run")
        write_record(older, {"schema": "station/psf/1"})
    result = run("psf", "field", tmp_path, "--out", tmp_path / "out", "-k", "13", code=5)
    assert not (tmp_path / "out" / "field.h5").exists()
    assert "6 places of the frame or more; plane Y has 1" in result.stderr
    assert not (tmp_path / "out" / "psf_Y.npy").exists()


def test_a_folder_without_charts_is_refused(tmp_path):
    write_pgm(tmp_path / "flat.pgm", np.full((120, 160), 0.5))
    run("psf", "field", tmp_path, "--out", tmp_path / "out", code=5, says="none of 1 photographs")
