import ast
import csv
import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
import yaml

from procedures import BadInput, BadParameter, GeometryParameters, Outcome, Verdict
from procedures.geometry.cameras import CameraModel
from procedures.geometry.spline_camera import SplineCamera
from procedures.geometry.uncertainty import enclosed
from procedures.geometry.views import ChartView
from procedures.numbers import projection_at
from station.batch.item import Job, work
from station.batch.procedure_file import read_procedure
from station.calibration.exports import mrcal
from station.calibration.exports.geometry import export_camera
from station.calibration.folder_photographs import by_folder, find_frames
from station.calibration.geometry import GeometryPhotographs, PlaneGeometry, conclude
from station.calibration.geometry_files import geometry_measurement
from station.calibration.stored_cameras import StoredCamera, read_camera, read_rig_camera
from station.procedure.builtin.geometry import CameraGeometry
from station.results.measurement import write_measurement
from station.results.record_head import RecordHead, files_read
from station.results.result_files import ResultFolder
from tests.golden.cases import TRUE_CAMERA, geometry_shoot
from tests.procedures.geometry.simulated_views import CELL_MM, take
from tests.procedures.geometry.simulated_views import Shoot as Photographed
from tests.program import run

SLOW_FIXTURES = {"outcome"}


@pytest.fixture(scope="module")
def shoot() -> GeometryPhotographs:
    return geometry_shoot()


@pytest.fixture(scope="module")
def outcome(shoot):
    return conclude([shoot], GeometryParameters(CELL_MM, model="OPENCV"))[0].outcome


@pytest.fixture(scope="module")
def result(shoot, outcome, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("geometry")
    with ResultFolder(path) as folder:
        head = RecordHead("geometry", files_read(shoot.records), {"width_mm": 300.0})
        measured = geometry_measurement([PlaneGeometry(shoot, outcome)], head)
        folder.write("report.html", CameraGeometry().page(measured))
        write_measurement(folder, measured)
    return path


def test_the_tables_are_those_of_the_answer(result, outcome):
    measured = outcome.value
    np.testing.assert_array_equal(np.load(result / "geometry_covariance.npy"), measured.covariance)
    with (result / "geometry_residuals.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == measured.points
    first = measured.views[0]
    assert float(rows[0]["residual_x"]) == pytest.approx(first.residual_px[0, 0], rel=1e-5)
    assert (
        (result / "geometry_projection.csv").read_text().startswith("x,y,distortion_x,distortion_y,uncertainty_px_at_")
    )


def test_several_planes_have_one_record_and_tables_of_their_own(shoot, outcome, tmp_path):
    blurred = Outcome(None, Verdict.REFUSED, "the chart is not sharp", "focus again")
    planes = [PlaneGeometry(replace(shoot, plane="R"), blurred), PlaneGeometry(shoot, outcome)]
    planes.append(PlaneGeometry(replace(shoot, plane="B"), outcome))
    with ResultFolder(tmp_path / "all") as folder:
        write_measurement(folder, geometry_measurement(planes, RecordHead("geometry")))
    planes = json.loads((tmp_path / "all" / "result.json").read_text())["planes"]
    assert [(name, one["verdict"]) for name, one in planes.items()] == [
        ("R", "refused"), ("G1", str(outcome.verdict)), ("B", str(outcome.verdict))
    ]  # fmt: skip
    tables = sorted(path.name for path in (tmp_path / "all").glob("geometry_*_covariance.npy"))
    assert tables == [f"geometry_{name}_covariance.npy" for name in ("B", "B_joint", "G1", "G1_joint")]
    assert read_camera(tmp_path / "all").source == "station geometry, plane G1"
    assert len(read_rig_camera(tmp_path / "all", "B").camera.poses) == len(outcome.value.views)
    with pytest.raises(BadInput, match="has no camera: the chart is not sharp"):
        read_camera(tmp_path / "all", "R")
    with pytest.raises(BadParameter, match="has the planes R, G1, B, not 'Y'"):
        read_camera(tmp_path / "all", "Y")


def test_a_refusal_names_a_photograph_that_gave_none(shoot):
    few = GeometryPhotographs("G1", shoot.size, (shoot.records[0], shoot.records[-1]))
    few_outcome = conclude([few], GeometryParameters(CELL_MM))[0].outcome
    assert few_outcome.verdict is Verdict.REFUSED
    assert "1 of 2 photographs gave none, dark.dng: the photograph is too dark" in few_outcome.reason


def rays(camera: CameraModel) -> tuple[np.ndarray, np.ndarray]:
    pixels = camera.frame_grid(9, 7)[10:-10]
    return pixels, camera.rays(pixels)


def opencv_pixels(K, distortion, directions) -> np.ndarray:
    K, distortion = np.asarray(K, dtype=np.float64).reshape(3, 3), np.asarray(distortion, dtype=np.float64)
    return cv2.projectPoints(directions[:, None], np.zeros(3), np.zeros(3), K, distortion)[0][:, 0]


def test_opencv_reads_its_file(result, tmp_path):
    path = tmp_path / "camera.yml"
    path.write_text(export_camera(read_camera(result), "opencv").data.decode())
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    K, distortion = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
    camera = read_camera(result).camera
    assert (storage.getNode("image_width").real(), storage.getNode("image_height").real()) == TRUE_CAMERA.size
    pixels, directions = rays(camera)
    np.testing.assert_allclose(opencv_pixels(K, distortion, directions), pixels, atol=1e-5)


def test_colmap_reads_its_file_with_its_own_pixel_centres(result, tmp_path):
    made = export_camera(read_camera(result), "colmap")
    (tmp_path / "cameras.txt").write_text(made.data.decode())
    for name in ("images.txt", "points3D.txt"):
        (tmp_path / name).write_text("")
    scene = pycolmap.Reconstruction()
    scene.read_text(str(tmp_path))
    camera = read_camera(result).camera
    np.testing.assert_allclose(CameraModel.from_colmap(scene.cameras[1]).params, camera.params, rtol=1e-15)
    assert scene.cameras[1].principal_point_x == pytest.approx(camera.centre[0] + 0.5, abs=1e-9)
    assert made.lost == ()


def test_other_programs_formats_have_opencvs_numbers(result):
    ros = yaml.safe_load(export_camera(read_camera(result), "ros").data.decode())
    pixels, directions = rays(read_camera(result).camera)
    assert ros["distortion_model"] == "plumb_bob"
    seen = opencv_pixels(ros["camera_matrix"]["data"], ros["distortion_coefficients"]["data"], directions)
    np.testing.assert_allclose(seen, pixels, atol=1e-5)
    assert ros["projection_matrix"]["data"][:3] == ros["camera_matrix"]["data"][:3]
    camera = yaml.safe_load(export_camera(read_camera(result), "kalibr").data.decode())["cam0"]
    fx, fy, cx, cy = camera["intrinsics"]
    pixels, directions = rays(read_camera(result).camera)
    assert (camera["distortion_model"], camera["resolution"]) == ("radtan", list(TRUE_CAMERA.size))
    seen = opencv_pixels([fx, 0, cx, 0, fy, cy, 0, 0, 1], camera["distortion_coeffs"], directions)
    np.testing.assert_allclose(seen, pixels, atol=1e-5)
    lens = ast.literal_eval(export_camera(read_camera(result), "mrcal").data.decode())
    assert lens["lensmodel"] == "LENSMODEL_OPENCV4"
    assert len(lens["intrinsics"]) == 8
    assert lens["imagersize"] == list(TRUE_CAMERA.size)
    assert lens["valid_intrinsics_region"][0] == lens["valid_intrinsics_region"][-1]
    fx, fy, cx, cy, *distortion = lens["intrinsics"]
    np.testing.assert_allclose(
        opencv_pixels([fx, 0, cx, 0, fy, cy, 0, 0, 1], distortion, directions), pixels, atol=1e-5
    )


MRCAL = """
import json, sys
import mrcal, numpy
model = mrcal.cameramodel(sys.argv[1])
pixels, distance_m = json.load(sys.stdin)
rays = distance_m * mrcal.unproject(numpy.array(pixels), *model.intrinsics(), normalize=True)
found = [mrcal.projection_uncertainty(rays, model, atinfinity=far, what="rms-stdev") for far in (False, True)]
print(json.dumps(numpy.sqrt(2 * numpy.mean(numpy.square(found), axis=1)).tolist()))
"""
SYSTEM = Path("/usr/bin/python3")


@pytest.fixture(scope="module")
def mrcals_python() -> Path:
    """The system's Python with Debian's python3-mrcal."""
    if not SYSTEM.exists() or subprocess.run([SYSTEM, "-I", "-c", "import mrcal"], capture_output=True).returncode:
        pytest.skip("python3-mrcal is not installed")
    return SYSTEM


@pytest.mark.parametrize("term", [None, "points"])
def test_mrcals_own_uncertainty_of_the_file_is_the_stated_one(
    result, outcome, tmp_path, mrcals_python, monkeypatch, term
):
    stored, found = read_camera(result), outcome.value
    if term is not None:  # the level of the residuals, as mrcal estimates it, but by their degrees of freedom
        monkeypatch.setattr(mrcal, "_noise", lambda *given: found.residual_scale)
    (tmp_path / "a.cameramodel").write_bytes(export_camera(stored, "mrcal").data)
    pixels = stored.camera.frame_grid(15, 11)
    pixels = pixels[enclosed(stored.region, pixels)]
    names = [projection_at(distance) for distance in (found.maps[0].distance_mm, np.inf)]
    answer = subprocess.run(
        [mrcals_python, "-I", "-c", MRCAL, tmp_path / "a.cameramodel"],
        input=json.dumps([pixels.tolist(), found.maps[0].distance_mm / 1000]), capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    stated = [found.numbers()[name].value if term is None else found.budgets()[name][term] for name in names]
    np.testing.assert_allclose(json.loads(answer.stdout), stated, rtol=0.1 if term is None else 0.03)


def test_the_error_of_a_format_is_stated_in_pixels(result):
    stored = read_camera(result)
    lens = CameraModel(
        "THIN_PRISM_FISHEYE", np.array([*stored.camera.params[:8], 0.01, 0, 2e-3, -1e-3]), *TRUE_CAMERA.size
    )
    made = export_camera(StoredCamera(lens, stored.region, ""), "kalibr")
    rms_px, max_px = (float(number) for number in re.findall(r"\d+\.\d+", made.lost[0]))
    assert 0.1 < rms_px < max_px


def test_a_spline_is_read_back_and_the_error_of_each_format_is_stated(result, tmp_path):
    stored, rng = read_camera(result), np.random.default_rng(4)
    lens = SplineCamera.over(stored.camera, f"{stored.camera.model}+SPLINE_8X6")
    lens = lens.with_params(np.concatenate([stored.camera.params, 0.3 * rng.standard_normal(96)]))
    kept = {"model": lens.model, "params": lens.params.tolist(), "columns": lens.columns, "rows": lens.rows}
    planes = {"Y": {"camera": kept, "region": stored.region.tolist()}}
    (tmp_path / "result.json").write_text(json.dumps({"procedure": "geometry", "planes": planes}))
    again = read_camera(tmp_path)
    directions = rays(stored.camera)[1]
    np.testing.assert_array_equal(again.camera.project(directions), lens.project(directions))
    for form in ("opencv", "colmap"):
        (lost,) = export_camera(again, form).lost
        # the control points' own, less what a formula draws
        assert 0.02 < float(re.findall(r"[\d.]+", lost)[0]) < 0.3


def test_what_is_no_camera_is_refused_by_name(tmp_path):
    with pytest.raises(BadInput, match="there is no file"):
        read_camera(tmp_path)
    (tmp_path / "result.json").write_text('{"procedure": "pattern", "planes": {}}')
    with pytest.raises(BadInput, match="a result of station geometry is required"):
        read_camera(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"columns": 1 << 62}, "1 to 1000000 pixels each way"),
        ({"columns": 1 << 70}, "integers must have at most 64 bits"),
        ({"rows": 480.5}, "1 to 1000000 pixels each way"),
        ({"params": [1e400, 1, 1, 1, 0, 0, 0, 0]}, "is not a finite number"),
        ({"params": [-1.0, 1, 1, 1, 0, 0, 0, 0]}, "the focal length of a camera must be finite, from 1e-30"),
        (
            {"params": [900.0, 900, 320]},
            r"the parameters of a camera OPENCV must be an array \(8\); got an array \(3\)",
        ),
        ({"model": "OPENCV_2"}, "no camera model|not whole|not exist"),
        ({"model": "OPENCV+SPLINE_3X9"}, "no camera model"),
        ({"params": "many"}, "must be real numbers"),
    ],
    ids=str,
)
def test_camera_that_cannot_be_meant_is_refused(tmp_path, change, words):
    kept = {"model": "OPENCV", "params": [900.0, 900, 320, 240, 0, 0, 0, 0], "columns": 640, "rows": 480, **change}
    planes = {"Y": {"camera": kept, "region": [[0, 0], [600, 0], [600, 400]]}}
    (tmp_path / "result.json").write_text(
        json.dumps({"procedure": "geometry", "planes": planes}).replace("Infinity", "1e400")
    )
    with pytest.raises(BadInput, match=words):
        read_camera(tmp_path)


def test_region_that_holds_no_pixel_is_refused(tmp_path):
    kept = {"model": "OPENCV", "params": [900.0, 900, 320, 240, 0, 0, 0, 0], "columns": 640, "rows": 480}
    planes = {"Y": {"camera": kept, "region": [[-9, -9], [-8, -9], [-8, -8]]}}
    (tmp_path / "result.json").write_text(json.dumps({"procedure": "geometry", "planes": planes}))
    with pytest.raises(BadInput, match="cannot be read as a camera that can be written"):
        export_camera(read_camera(tmp_path), "opencv")


@pytest.fixture
def measured(monkeypatch, tmp_path):
    """Photographs that need no measuring: their names show which views they are."""
    taken = take(Photographed(TRUE_CAMERA, count=6, every=1), np.random.default_rng(13))
    views = {f"v{i}.pgm": view for i, view in enumerate(taken.views)}

    def seen(planes, chart, source) -> dict[str, Outcome[ChartView]]:
        return {name: Outcome(replace(views[source], source=source)) for name in planes}

    monkeypatch.setattr("station.calibration.geometry.views_of", seen)
    monkeypatch.setattr("station.calibration.geometry._size", lambda frame: TRUE_CAMERA.size)
    for n, name in enumerate(views):
        (tmp_path / name).write_bytes(b"P5\n4 4\n255\n" + bytes([n] * 16))
    return [str(tmp_path / name) for name in views]


@pytest.mark.slow
def test_the_commands_calibrate_and_export(measured, tmp_path):
    out = tmp_path / "out"
    run("geometry", *measured, "--model", "OPENCV", "--no-report", "--json", "--out", out)
    entry = json.loads((out / "result.json").read_text())["planes"]["Y"]
    assert entry["verdict"] == "pass"
    run("export", out, "--to", "ros", tmp_path / "camera.yaml")
    assert yaml.safe_load((tmp_path / "camera.yaml").read_text())["image_width"] == TRUE_CAMERA.size[0]


@pytest.mark.slow
def test_a_batch_takes_the_photographs_of_each_folder_together(measured, tmp_path):
    (tmp_path / "empty.pgm").write_bytes(b"")
    (tmp_path / "p.toml").write_text(
        'procedure = "geometry"\n[limits]\nfx = { min = 9000 }\n[settings]\nmodel = "OPENCV"\nat_mm = [700]\n'
    )
    (item,) = by_folder(find_frames([tmp_path], tmp_path / "out"))
    row = work(item, Job(read_procedure(tmp_path / "p.toml"), tmp_path / "out", reports=True))
    assert (row.verdict, row.specification) == ("pass", "does not meet")
    assert row.planes["Y"].numbers["fx"]["value"] == pytest.approx(TRUE_CAMERA.focal_px[0], rel=1e-4)
    folder = tmp_path / "out" / row.folder
    assert (folder / "report.html").is_file()
    record = json.loads((folder / "result.json").read_text())
    assert record["parameters"]["chart"] == "seed 1"
    assert [one["source"] for one in record["planes"]["Y"]["left_out"]] == ["empty.pgm"]
    assert "projection_uncertainty_at_700_mm" in record["planes"]["Y"]


def test_two_photographs_are_refused_with_the_contracts_code(measured, tmp_path):
    run("geometry", *measured[:2], "--out", tmp_path / "out", code=5)
    assert json.loads((tmp_path / "out" / "result.json").read_text())["planes"]["Y"]["verdict"] == "refused"


def test_a_wrong_model_is_a_usage_error(measured, tmp_path):
    run("geometry", *measured, "--model", "BROWN", "--out", tmp_path / "out", code=2)


@pytest.mark.delicate
def test_five_views_that_barely_determine_the_principal_point_are_concluded(shared_data, tmp_path):
    folder = shared_data / "geometry" / "five_views"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    done = run("geometry", folder, "--out", tmp_path, code=None)
    record = json.loads((tmp_path / "result.json").read_text())["planes"]["Y"]
    assert "5 views are too few" in done.output
    assert record["verdict"] == "doubtful"
    # where the adjustment ended on two processors: it leaves a thirtieth of a standard uncertainty
    for name, value in {"fx": 2061.1, "fy": 2050.7, "cx": 159.1, "cy": 121.1}.items():
        assert record[name]["value"] == pytest.approx(value, abs=0.1 * record[name]["uncertainty"]), name
