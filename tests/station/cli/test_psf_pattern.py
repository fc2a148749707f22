import hashlib
import json

import numpy as np
import pytest

from procedures.pattern import Chart
from tests.program import run


@pytest.fixture
def photograph(shared_data):
    return shared_data / "pattern_photo" / "img_example.pgm"


@pytest.fixture
def bits(shared_data):
    return shared_data / "pattern_photo" / "pattern_noise.pgm"


@pytest.fixture
def raw_file(shared_data):
    return shared_data / "raw" / "tinydng_colorchart.dng"


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def files_of(*planes):
    kinds = ("psf", "npy"), ("covariance", "npy"), ("mtf", "csv"), ("psf", "png")
    more = ("psf", "fits"), ("psf", "tiff"), ("profile", "csv")
    of_planes = [f"{kind}_{plane}.{suffix}" for plane in planes for kind, suffix in (*kinds, *more)]
    return sorted([*of_planes, "budget.csv", "numbers.csv", "result.json"])


def test_record_follows_the_schema(estimator, photograph, bits, tmp_path):
    run("psf", "pattern", photograph, "--bits", bits, "--solver", "nnls", "--out", tmp_path)
    record = json.loads((tmp_path / "result.json").read_text())
    keys = ["schema", "procedure", "input", "parameters", "duration_s", "choice", "planes", "software"]
    assert [key for key in record if key in keys] == keys
    assert (record["schema"], record["procedure"]) == ("station/psf/1", "pattern")
    sha256 = hashlib.sha256(photograph.read_bytes()).hexdigest()
    assert record["input"] == [{"path": str(photograph), "sha256": sha256}]
    assert record["parameters"].items() >= {"s": 4, "k": 17, "solver": "nnls"}.items()
    assert hashlib.sha256(bits.read_bytes()).hexdigest() in record["parameters"]["chart"]
    assert "numpy" in record["software"]["packages"]
    assert record["duration_s"] >= 0


def test_json_prints_the_record_with_null_for_numbers_that_are_not_finite(estimator, photograph, tmp_path):
    done = run("psf", "pattern", photograph, "--out", tmp_path, "--json")
    assert done.stdout == (tmp_path / "result.json").read_text()
    plane = json.loads(done.stdout, parse_constant=pytest.fail)["planes"]["Y"]
    assert (plane["unknown"]["value"], plane["unknown"]["uncertainty"]) == (None, None)
    assert plane["diagnostics"]["whiteness"] is None
    assert run("psf", "pattern", photograph, "--out", tmp_path).stdout == ""


def test_log_json_makes_every_line_an_object(estimator, photograph, tmp_path, refused):
    estimator.answers["Y"] = refused
    done = run("psf", "pattern", photograph, "--out", tmp_path, "--log-json", code=5)
    lines = [json.loads(line) for line in done.stderr.splitlines()]
    assert [line["event"] for line in lines] == ["step", "plane", "written"]
    assert lines[1].items() >= {"level": "error", "plane": "Y", "verdict": "refused"}.items()
    assert all({"ts", "level", "event"} <= line.keys() for line in lines)


@pytest.mark.parametrize(("words", "planes"), [([], "G1"), (["--plane", "all"], "R G1 G2 B"), (["--plane", "B"], "B")])
def test_planes_of_a_raw_file(estimator, raw_file, tmp_path, words, planes):
    run("psf", "pattern", raw_file, "--out", tmp_path, *words)
    assert [asked[0].name for asked in estimator.asked] == planes.split()
    assert names_in(tmp_path) == files_of(*planes.split())


def test_parameters_and_chart_reach_the_estimator(estimator, raw_file, bits, tmp_path):
    run("psf", "pattern", raw_file, "--bits", bits, "-s", 3, "-k", 13, "--solver", "clip", "--out", tmp_path)
    ((_, chart, parameters, _),) = estimator.asked
    assert (parameters.s, parameters.k, parameters.solver) == (3, 13, "clip")
    assert chart.cells.mean() == pytest.approx(0.5, abs=0.01)


def test_diffraction_limit_is_that_of_the_plane(estimator, shared_data, tmp_path):
    # the camera noted f/6.2; a plane's pixels are two of the sensor's apart
    raw_file = shared_data / "raw" / "RAW_KODAK_DC50.KDC"
    run("psf", "pattern", raw_file, "--plane", "all", "--pixel-pitch-um", 5, "--out", tmp_path)
    limits = {asked[0].name: asked[3] for asked in estimator.asked}
    assert {name: limit.wavelength_nm for name, limit in limits.items()} == {"R": 600, "G1": 530, "G2": 530, "B": 460}
    assert (limits["B"].f_number, limits["B"].pixel_pitch_um) == (6.2, 10)


def test_given_optics_are_recorded(estimator, photograph, tmp_path):
    words = ("--pixel-pitch-um", 5.7, "--f-number", 8, "--wavelength-nm", 546)
    run("psf", "pattern", photograph, *words, "--out", tmp_path)
    parameters = json.loads((tmp_path / "result.json").read_text())["parameters"]
    assert parameters.items() >= {"pixel_pitch_um": 5.7, "f_number": 8.0, "wavelength_nm": 546.0}.items()
    run("psf", "pattern", photograph, "--f-number", 8, "--out", tmp_path)
    assert estimator.asked[1][3] is None  # without a pitch, no diffraction limit


@pytest.mark.parametrize(("words", "seed"), [([], 1), (["--seed", 7], 7), (["--seed", 0], 0)])
def test_chart_comes_from_its_seed(estimator, photograph, tmp_path, words, seed):
    run("psf", "pattern", photograph, "--out", tmp_path, *words)
    np.testing.assert_array_equal(estimator.asked[0][1].cells, Chart.from_seed(seed).cells)
    assert json.loads((tmp_path / "result.json").read_text())["parameters"]["chart"] == f"seed {seed}"


def test_refused_plane_does_not_stop_the_others(estimator, raw_file, tmp_path, refused):
    estimator.answers["G1"] = refused
    done = run("psf", "pattern", raw_file, "--plane", "all", "--out", tmp_path, code=5)
    assert names_in(tmp_path) == files_of("R", "G2", "B")
    assert "no chart was found" in done.stderr
    assert "photograph the whole chart" in done.stderr
    planes = json.loads((tmp_path / "result.json").read_text())["planes"]
    assert planes["G1"] == {"verdict": "refused", "reason": refused.reason, "remedy": refused.remedy}
    assert planes["B"]["verdict"] == "pass"


def test_doubtful_plane_is_written_and_warned_about(estimator, photograph, tmp_path, doubtful):
    estimator.answers["Y"] = doubtful
    run("psf", "pattern", photograph, "--out", tmp_path, says="warning: Y: doubtful; s/t is 2.4")
    assert names_in(tmp_path) == files_of("Y")


def test_files_of_a_plane_refused_now_do_not_stay(estimator, raw_file, tmp_path, refused):
    run("psf", "pattern", raw_file, "--plane", "all", "--out", tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    estimator.answers["G1"] = refused
    run("psf", "pattern", raw_file, "--out", tmp_path, code=5)
    assert names_in(tmp_path) == ["notes.txt", "result.json"]


def test_older_result_stays_whole_when_the_new_photograph_cannot_be_read(estimator, photograph, tmp_path):
    run("psf", "pattern", photograph, "--out", tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    run("psf", "pattern", tmp_path / "absent.pgm", "--out", tmp_path, code=4)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--physics"], "--pixel-pitch-um"),
        (["--plane", "G9"], "; got 'G9'"),
        (["-s", "0"], "s must be 1 or more; got s = 0"),
        (["-k", "16"], "k must be odd and 3 or more, so that the support has a centre; got k = 16"),
        (["-k", "1"], "got k = 1"),
        (["-k", "103"], "k at most 101; got s = auto, k = 103"),
        (["-s", "four"], "give a whole number, or auto; got 'four'"),
        (["--solver", "magic"], "'magic' is not one of"),
        (["--seed", "3", "--bits", "x.pgm"], "give one of them"),
        (["--loud"], "No such option"),
    ],
)
def test_usage_is_exit_2_and_leaves_nothing(estimator, photograph, tmp_path, words, sentence):
    out = tmp_path / "out"
    run("psf", "pattern", photograph, "--out", out, *words, code=2, says=sentence)
    assert not out.exists()
    assert estimator.asked == []


@pytest.mark.parametrize("out", ["file.txt", "file.txt/below"])
def test_folder_that_cannot_be_written_is_found_before_the_estimate(estimator, photograph, tmp_path, out):
    (tmp_path / "file.txt").write_text("here first")
    run("psf", "pattern", photograph, "--out", tmp_path / out, code=2, says="folder that can be written")
    assert estimator.asked == []


def test_photograph_that_cannot_be_read_is_exit_4_and_leaves_nothing(estimator, shared_data, tmp_path):
    out = tmp_path / "a" / "b"
    done = run("psf", "pattern", shared_data / "raw" / "linear_no_mosaic.dng", "--out", out, code=4, says="error: ")
    assert "already demosaicked" in done.stderr
    assert "what to do: give the RAW file as the camera wrote it" in done.stderr
    assert not (tmp_path / "a").exists()


def test_interrupted_run_is_exit_130_and_leaves_nothing(estimator, photograph, tmp_path):
    estimator.answers["Y"] = KeyboardInterrupt()
    run("psf", "pattern", photograph, "--out", tmp_path / "out", code=130)
    assert not (tmp_path / "out").exists()


def test_fault_of_the_program_is_named_with_the_way_to_its_traceback(estimator, photograph, tmp_path, monkeypatch):
    estimator.answers["Y"] = ZeroDivisionError("by a careless line")
    done = run("psf", "pattern", photograph, "--out", tmp_path / "out", code=70)
    assert "ZeroDivisionError: by a careless line" in done.stderr
    assert "STATION_TRACEBACK=1" in done.stderr
    monkeypatch.setenv("STATION_TRACEBACK", "1")
    done = run("psf", "pattern", photograph, "--out", tmp_path, code=None)
    assert isinstance(done.exception, ZeroDivisionError)
