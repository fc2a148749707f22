"""`station refocus`: a restoration's picture with another aperture and focus, and what it cannot work on."""

import json
import re
import shutil
import subprocess
from base64 import b64decode
from html import unescape
from importlib.resources import files

import cv2
import numpy as np
import pytest

from procedures import CameraSetting, write_field
from procedures.restoration.masks.blur_models import pillbox, polygon
from procedures.restoration.refocus import _mean_of_views
from tests.procedures.correction.small_lens import SmallLens
from tests.program import run

LENS = {"metres": "behind", "focal_length_mm": 12.0, "f_number": [2.8, 2.0], "focus_m": [0.45, 0.45],
        "pixel_pitch_um": 6.0}  # fmt: skip


def write_restored(folder):
    rng = np.random.default_rng(1)
    sharp = np.kron(rng.uniform(0.1, 0.9, (12, 16)), np.ones((4, 4))).astype(np.float32)
    cv2.imwrite(str(folder / "sharp.tiff"), sharp)
    w = np.full(sharp.shape, 1.0, np.float32)
    w[:, 32:] = 3.0
    np.save(folder / "w.npy", w)
    record = {"schema": "station/restore/1", "procedure": "restore", "input": [], "parameters": LENS, "verdict": "pass"}
    (folder / "result.json").write_text(json.dumps(record))


@pytest.fixture
def restored(tmp_path):
    folder = tmp_path / "restored"
    folder.mkdir()
    write_restored(folder)
    return folder


def test_focus_moves_from_one_half_to_the_other(restored, tmp_path):
    sharp = cv2.imread(str(restored / "sharp.tiff"), cv2.IMREAD_UNCHANGED)
    # blur radii 1 and 3 px behind 0.45 m at f/2.8 lie at 0.506 and 0.670 m: 1/l = 1/l_s - r / (rho zeta)
    scale = 12 / 5.6 * (1 / (1 / 12 - 1 / 450)) / 0.006
    metres = [1 / (1 / 450 - r / scale) / 1000 for r in (1, 3)]
    for n, (near, far) in enumerate(((np.s_[:, 4:28], np.s_[:, 38:60]), (np.s_[:, 38:60], np.s_[:, 4:28]))):
        out = tmp_path / f"o{n}"
        run("refocus", restored, "--f-number", 1.4, "--focus-m", metres[n], "--out", out)
        picture = cv2.imread(str(out / "refocused.tiff"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_allclose(picture[near], sharp[near], atol=1e-6)
        assert np.abs(picture[far] - sharp[far]).max() > 0.1
        record = json.loads((out / "result.json").read_text())
        plane = record["planes"]["picture"]
        assert plane["depth_of_field_near"]["value"] < metres[n] < plane["depth_of_field_far"]["value"]
        assert "Pictures" in (out / "report.html").read_text()


def test_a_field_leaves_an_even_picture_even_and_must_have_its_size(restored, tmp_path):
    even = np.full((48, 64), 0.5, np.float32)
    cv2.imwrite(str(restored / "sharp.tiff"), even)
    for name, shape in (("field", even.shape), ("other", (60, 60))):
        write_field(tmp_path / f"{name}.h5", {"Y": SmallLens(shape, 0.8).field("Y")}, {}, [], {})
    words = ("refocus", restored, "--f-number", 4, "--focus-m", 0.6, "--out")
    run(*words, tmp_path / "o", "--field", tmp_path / "field.h5")
    picture = cv2.imread(str(tmp_path / "o" / "refocused.tiff"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_allclose(picture, even, atol=1e-6)  # no light is lost at the rim
    run(*words, tmp_path / "p", "--field", tmp_path / "other.h5", code=2, says="frames of 64 x 48 pixels")


@pytest.fixture(scope="module")
def node():
    program = shutil.which("node")
    if program is None:
        pytest.skip("no Node.js")

    def call(expression, **values):
        source = files("station.reports.templates").joinpath("refocus.js").read_text("utf-8")
        stub = "globalThis.document = {querySelectorAll: () => []};"
        given = f"const given = {json.dumps(values)};"
        code = f"{stub}{source}{given}console.log(JSON.stringify({expression}))"
        return json.loads(subprocess.run([program, "-e", code], check=True, capture_output=True, text=True).stdout)

    return call


@pytest.mark.parametrize(("aperture", "shape"), [("circle()", pillbox()), ("polygon(5)", polygon(5))])
def test_the_pages_script_draws_the_programs_picture(node, rng, aperture, shape):
    light, radius = rng.random((1, 20, 24)), np.repeat([[2.0, -3.0]], 12, axis=1) * np.ones((20, 1))
    expected = _mean_of_views(light, radius, shape)
    # as many views; the sampled shape decides otherwise at its border only
    drawn = node(f"Array.from(meanOfViews(given.light, given.radius, 20, 24, BOKEH.{aperture}, 1024))",
                 light=light.ravel().tolist(), radius=radius.ravel().tolist())  # fmt: skip
    np.testing.assert_allclose(np.reshape(drawn, (20, 24)), expected[0], atol=0.01)


def test_the_pages_script_has_the_programs_optics(node):
    setting = CameraSetting(50, 2.0, 1500.0, 6.0)
    drawn = node("blurRadius(given.inverse, {focal_length_mm: 50, pitch_um: 6}, 2, 1 / 1.5)", inverse=[0.5, 1, 2])
    np.testing.assert_allclose(drawn, setting.blur_radius_px(np.array([2000.0, 1000.0, 500.0])), rtol=1e-12)


def test_the_page_has_controls_of_aperture_focus_and_bokeh(restored, tmp_path):
    run("refocus", restored, "--f-number", 2, "--focus-m", 0.6, "--out", tmp_path / "o")
    page = (tmp_path / "o" / "report.html").read_text()
    assert all(f'name="{name}"' in page for name in ("aperture", "focus", "bokeh"))
    assert "meanOfViews" in page
    lens = json.loads(unescape(re.search('data-lens="([^"]*)"', page)[1]))
    png = re.search('base64,([^"]*)" alt="inverse distances"', page)[1]
    coded = cv2.imdecode(np.frombuffer(b64decode(png), np.uint8), cv2.IMREAD_COLOR)
    inverse = lens["least"] + (256.0 * coded[..., 2] + coded[..., 1]) / 65535 * (lens["most"] - lens["least"])
    taken = CameraSetting(12, 2.8, 450.0, 6.0)
    np.testing.assert_allclose(inverse[0, [0, -1]], 1000 / taken.distance_mm(np.array([-1.0, -3.0])), atol=1e-4)


@pytest.mark.parametrize(
    ("change", "words", "code"),
    [
        ({"metres": None}, "--metres front", 4),
        ({"f_number": []}, "no whole restoration", 4),
        ({"pixel_pitch_um": 0.0001}, "blur circles", 2),
    ],
)
def test_what_is_no_restoration_in_metres_is_refused(restored, tmp_path, change, words, code):
    record = json.loads((restored / "result.json").read_text())
    record["parameters"] |= change
    (restored / "result.json").write_text(json.dumps(record))
    run("refocus", restored, "--f-number", 2, "--focus-m", 0.6, "--out", tmp_path / "o", code=code, says=words)
    assert not (tmp_path / "o").exists()
