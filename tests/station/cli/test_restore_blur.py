"""`station restore` with the blur given by an IMU's records, by a measured PSF, and by a field of them."""

import json
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest

from procedures.raw import ImuRecord, read_frame
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.masks.blur_operator import BlurOperator
from simulators.bench.bench import Setup, SimulatedBench
from simulators.bench.body import Opening
from simulators.bench.view import Mount
from simulators.camera.sensor import Sensor
from station.calibration.restoration.inputs import imu_table, read_blur_shape, read_imu
from tests.program import run

SLOW_FIXTURES = {"shaken", "defocused"}
OPEN_S = 0.2
QUICK = ["--scheme", "1x(4+4)+1x8"]


restore = partial(run, "restore")


@pytest.fixture(scope="module")
def shaken(tmp_path_factory):
    """Photographs of a moving rig, its IMU's records, the sharp photograph, and the lens's focal length."""
    folder = tmp_path_factory.mktemp("shaken")
    bench = SimulatedBench(folder, Setup(seed=3, virtual_time=True))
    bench.show("depth")
    view, world, rng = bench.view, bench.world, np.random.default_rng(5)
    view.camera, view.mount = replace(view.camera, sensor=Sensor(rows=168, columns=224)), Mount()
    reference = view.photograph(Opening(0.5, OPEN_S, 1)).plane("G1")
    for n, drives in enumerate(bench.motions, start=1):
        world.drive(drives, 2.0 * n)
        opening = Opening(2.0 * n + 0.5, OPEN_S, 1 + n)
        view.photograph(opening, folder / f"{n}.dng")
        t = np.arange(-0.25, 0.55, 0.005)
        force, rate = world.ideal_imu(opening.begin_s + t)
        force, rate = force + rng.normal(0, 0.02, force.shape), rate + rng.normal(0, 0.001, rate.shape)
        (folder / f"{n}.csv").write_bytes(imu_table(ImuRecord(t, force + 0.05, rate + 0.002)))
    focal_px = view.camera.projection(view.focus_mm or world.distance_mm(0.5)).principal_px / 2
    bench.close()
    return folder, reference, focal_px


@pytest.fixture(scope="module")
def by_imu(shaken, tmp_path_factory):
    folder, _, focal_px = shaken
    out = tmp_path_factory.mktemp("out") / "restored"
    records = ["--imu", folder / "1.csv", folder / "2.csv", "--focal-px", focal_px, "--max-inverse-depth", 0.9]
    restore(folder / "1.dng", folder / "2.dng", "--blur", "motion", *records, *QUICK, "--out", out)
    return out


def error(picture, reference, rim=10):
    """RMSE of grey levels of 255, scaled to equal means, without the rim."""
    inside = np.s_[rim:-rim, rim:-rim]
    return (
        255 * np.std((picture * reference.mean() / picture.mean() - reference)[inside]) / np.percentile(reference, 99)
    )


def test_a_rotating_rig_is_restored_with_depth_in_inverse_metres(by_imu, shaken):
    folder, reference, _ = shaken
    sharp = cv2.imread(str(by_imu / "sharp.tiff"), cv2.IMREAD_UNCHANGED)
    blurred = read_frame(folder / "1.dng", ["G1"]).planes["G1"].samples
    assert error(sharp, reference) < 0.4 * error(blurred, reference)
    record = json.loads((by_imu / "result.json").read_text())
    assert record["w"]["unit"] == "1/m"
    w = np.load(by_imu / "w.npy")
    # the near sheet is 1.4 m away; see `tests/end_to_end/test_restoration.py` for all of them
    assert np.median(w[10:-10, 10:40]) == pytest.approx(1 / 1.4, rel=0.1)
    assert record["w"]["greatest"] == pytest.approx(float(w.max()), rel=1e-5)
    assert record["parameters"]["exposure_s"] == [OPEN_S, OPEN_S]
    assert min(record["parameters"]["nodes"]) > 1
    assert "inverse depth, 1/m" in (by_imu / "report.html").read_text(encoding="utf-8")


def test_a_written_record_is_read_identically(tmp_path):
    rng = np.random.default_rng(1)
    imu = ImuRecord(np.arange(20) / 200, rng.normal(size=(20, 3)), rng.normal(size=(20, 3)))
    (tmp_path / "a.csv").write_bytes(b"# of a rig\n" + imu_table(imu))
    found = read_imu(tmp_path / "a.csv")
    np.testing.assert_allclose(found.time_s, imu.time_s, rtol=1e-6)
    np.testing.assert_allclose(found.rotation_rad_s, imu.rotation_rad_s, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("t_s,ax,ay,az,wx,wy\n0,1,2,3,4,5\n", "no column wz"),
        ("t_s,ax,ay,az,wx,wy,wz\n0,1,2,3,4,5,fast\n", "row 2: 7 finite numbers"),
        ("t_s,ax,ay,az,wx,wy,wz\n0,1,2,3,4,5\n", "row 2: 7 finite numbers"),
        ("t_s,ax,ay,az,wx,wy,wz\n0,1,2,3,4,5,6\n", "16 samples"),
        ("", "no column t_s"),
    ],
)
def test_an_invalid_record_exits_4(shaken, tmp_path, text, complaint):
    folder, _, focal_px = shaken
    (tmp_path / "bad.csv").write_text(text)
    records = ["--imu", tmp_path / "bad.csv", folder / "2.csv", "--focal-px", focal_px, "--max-inverse-depth", 0.9]
    done = restore(folder / "1.dng", folder / "2.dng", "--blur", "motion", *records, "--out", tmp_path / "o", code=4)
    assert complaint in done.output
    assert not (tmp_path / "o").exists()


@pytest.fixture(scope="module")
def defocused(tmp_path_factory):
    """Photographs at two apertures, and the lens's PSF as in a result, s = 3, with noise, measured at w = 3."""
    folder = tmp_path_factory.mktemp("defocused")
    rng = np.random.default_rng(4)
    coarse = np.kron(rng.uniform(0.1, 0.9, (20, 24)), np.ones((6, 6)))[:116, :136]
    for n, ratio in enumerate((1.0, 1.25), start=1):
        blur = BlurOperator(mask_stack(pillbox(), 4.2, ratio=ratio, R=6), (104, 124))
        blur.focus(np.where(np.arange(136) < 68, 2.4, 3.4) * np.ones((116, 1)))
        image = blur.blur(coarse) + rng.normal(0, 0.002, (104, 124))
        cv2.imwrite(str(folder / f"{n}.png"), np.clip(image * 65535, 0, 65535).astype(np.uint16))
    x, y = np.meshgrid(*[(np.arange(25) - 12) / 3] * 2)
    h = (np.hypot(x, y) <= 3.0) + rng.normal(0, 0.01, (25, 25))
    np.save(folder / "psf_Y.npy", h / h.sum())
    np.savetxt(folder / "psf.txt", h / h.sum())
    (folder / "result.json").write_text(json.dumps({"parameters": {"s": 3, "k": 25}}))
    return folder


@pytest.mark.parametrize("shape", [["psf_Y.npy"], ["psf.txt", "--samples-per-pixel", "3"]])
def test_a_measured_psf_is_a_shape(defocused, tmp_path, shape):
    given = [defocused / shape[0], *shape[1:], "--ratio", 1.25, "--max-w", 4.2, "--scheme", "1x(4+4)+1x6"]
    restore(defocused / "1.png", defocused / "2.png", "--blur", "defocus", "--shape", *given, "--out", tmp_path / "o")
    parameters = json.loads((tmp_path / "o" / "result.json").read_text())["parameters"]
    # a sample is a third of a pixel wide, and noise removes the rim
    assert parameters["measured"][0]["half_width_px"] == pytest.approx(3.0, abs=0.35)
    assert 0 < parameters["measured"][0]["negative_light"] < 0.1
    w = np.load(tmp_path / "o" / "w.npy")
    scale = parameters["measured"][0]["half_width_px"] / 3.0
    assert np.median(w[15:-15, 15:50]) == pytest.approx(2.4 * scale, abs=0.3)
    assert np.median(w[15:-15, 74:-15]) == pytest.approx(3.4 * scale, abs=0.3)


def test_a_psf_without_its_samples_is_refused(defocused, tmp_path):
    images = [defocused / "1.png", defocused / "2.png", "--blur", "defocus", "--ratio", 1.25, "--out", tmp_path / "o"]
    (tmp_path / "psf_Y.npy").write_bytes((defocused / "psf_Y.npy").read_bytes())
    restore(*images, "--shape", tmp_path / "psf_Y.npy", code=2, says="--samples-per-pixel")
    restore(*images, "--shape", defocused / "psf.txt", code=4, says="must be finite, from 0")


def test_a_field_must_fit_plane_and_frame(defocused, tmp_path):
    from procedures.field.field_file import write_field
    from procedures.field.interpolate import interpolate
    from procedures.psf import Psf
    from procedures.psf_field import Node

    h = np.load(defocused / "psf_Y.npy")[4:-4, 4:-4]
    nodes = []
    for x, y in np.random.default_rng(2).uniform(0, 100, (12, 2)):
        where = np.array([x, y])
        nodes.append(Node(where, 1e-4 * np.eye(2), where, Psf(h / h.sum(), 3, 1e-8 * np.eye(h.size)), "a", len(nodes)))
    write_field(tmp_path / "field.h5", {"Y": interpolate("Y", (104, 124), nodes)}, {}, [], {})
    images = [defocused / "1.png", defocused / "2.png", "--blur", "defocus", "--shape", tmp_path / "field.h5"]
    restore(*images, "--ratio", 1.25, "--max-w", 2.0, "--scheme", "1x(1+1)+1x1", "--out", tmp_path / "o")
    small = [tmp_path / "1.png", tmp_path / "2.png"]
    for one in small:
        cv2.imwrite(str(one), cv2.imread(str(defocused / one.name), cv2.IMREAD_UNCHANGED)[:80])
    restore(*small, *images[2:], "--out", tmp_path / "p", code=4, says="the size of the field's plane, 124 x 104")
    # named before there are photographs: its first plane, over itself
    shape = read_blur_shape(str(tmp_path / "field.h5"), None, None)
    assert shape.half_width_px == pytest.approx(3.0, abs=0.5)
