"""`station restore` with another focus, additional defocus, a symmetric lens, and given camera poses."""

import json

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from procedures.restoration.masks.blur_models import mask_stack, pillbox, uniform_motion
from procedures.restoration.masks.blur_operator import BlurOperator
from procedures.restoration.masks.defocus_and_motion import with_defocus
from procedures.restoration.masks.shape_fields import ShapeField, symmetric
from tests.program import run

SIZE, R = (104, 124), 8
BOTH = (SIZE[0] + 2 * R, SIZE[1] + 2 * R)
QUICK = ["--scheme", "1x(4+4)+1x8"]
NEAR, FAR = 3.0, 1.8
"""w of the right and of the left half."""


@pytest.fixture(scope="module")
def picture():
    rng = np.random.default_rng(4)
    coarse = np.kron(rng.uniform(0.1, 0.9, (20, 24)), np.ones((6, 6)))[: BOTH[0], : BOTH[1]]
    return np.clip(coarse + 0.05 * gaussian_filter(rng.standard_normal(BOTH), 1), 0, 1)


def depth():
    return np.where(np.arange(BOTH[1]) < BOTH[1] // 2, FAR, NEAR) * np.ones((BOTH[0], 1))


def write(folder, images, noise_db=45):
    """Photographs with noise, as files."""
    rng = np.random.default_rng(7)
    names = [folder / f"{n}.png" for n in range(1, 1 + len(images))]
    for name, image in zip(names, images, strict=True):
        noisy = image + rng.normal(0, 10 ** (-noise_db / 20) * image.std(), image.shape)
        cv2.imwrite(str(name), np.round(np.clip(noisy, 0, 1) * 65535).astype(np.uint16))
    return names


def photographs(folder, picture, masks, noise_db=45):
    images = []
    for one in masks:
        blur = one.blur(SIZE, np.float64) if hasattr(one, "grid") else BlurOperator(one, SIZE)
        blur.focus(depth())
        images.append(blur.blur(picture))
    return write(folder, images, noise_db)


def halves(out, rim=14):
    """Median w of the left and of the right half."""
    w = np.load(out / "w.npy")[rim:-rim]
    return np.median(w[:, rim : SIZE[1] // 2 - rim]), np.median(w[:, SIZE[1] // 2 + rim : -rim])


def error(out, picture, rim=14):
    """Standard deviation of the picture's error, white = 1."""
    sharp = cv2.imread(str(out / "sharp.tiff"), cv2.IMREAD_UNCHANGED)
    return np.std((sharp - picture[R:-R, R:-R])[rim:-rim, rim:-rim])


def record_of(out):
    return json.loads((out / "result.json").read_text())


@pytest.mark.slow
@pytest.mark.parametrize("offset", [1.4, -2.4])
def test_another_focus_is_an_offset_of_the_blur(picture, tmp_path, offset):
    # at -2.4 the second is sharp between the halves, which have a blur of 0.6 each
    stacks = [mask_stack(pillbox(), 4.0, offset=by, R=R) for by in (0.0, offset)]
    images = photographs(tmp_path, picture, stacks)
    blur = ["--blur", "defocus", "--shape", "pillbox", "--offset", offset, "--max-w", "4", *QUICK]
    run("restore", *images, *blur, "--out", tmp_path / "o")
    assert halves(tmp_path / "o") == pytest.approx((FAR, NEAR), abs=0.15)
    assert record_of(tmp_path / "o")["parameters"]["offset"] == [offset]


@pytest.mark.slow
def test_motion_and_defocus_together(picture, tmp_path):
    lines = [uniform_motion(0.3), uniform_motion(1.7)]
    motion, aperture = [mask_stack(one, 4.0, R=5) for one in lines], ShapeField(((pillbox(),),))
    images = photographs(tmp_path, picture, with_defocus(motion, [aperture] * 2, [0.8, 0.8], [-1.2, -1.2]))
    for n, one in enumerate(lines):
        np.savetxt(tmp_path / f"line{n}.txt", one, fmt="%.5g")
    shapes = ["--shape", tmp_path / "line0.txt", tmp_path / "line1.txt"]
    defocus = ["--defocus-shape", "pillbox", "--defocus-ratio", "0.8", "--defocus-offset", "-1.2"]
    wide = ["--max-w", "4", *QUICK]
    run("restore", *images, "--blur", "both", *shapes, *defocus, *wide, "--out", tmp_path / "both")
    assert halves(tmp_path / "both") == pytest.approx((FAR, NEAR), abs=0.15)
    assert record_of(tmp_path / "both")["parameters"]["defocus_shape"] == ["pillbox", "pillbox"]
    # motion alone is not the complete blur
    run("restore", *images, "--blur", "motion", *shapes, *wide, "--out", tmp_path / "motion")
    assert error(tmp_path / "both", picture) < 0.8 * error(tmp_path / "motion", picture)


@pytest.mark.nightly
def test_a_symmetric_lens_is_given_by_a_few_shapes(picture, tmp_path):
    t = np.linspace(-1, 1, 65)
    x, y = np.meshgrid(t, t)
    shapes = [np.where(x**2 + y**2 <= 1, 1 + strength * x, 0.0) for strength in (0.0, 0.5, 1.0)]
    lens = symmetric(shapes, SIZE)
    images = photographs(tmp_path, picture, [lens.masks(4.0, R, ratio) for ratio in (1.0, 1.3)])
    names = [tmp_path / f"{n}.txt" for n in range(3)]
    for name, one in zip(names, shapes, strict=True):
        np.savetxt(name, one, fmt="%.6g")
    blur = ["--blur", "defocus", "--ratio", "1.3", "--max-w", "4", *QUICK]
    errors = []
    for shape in (f"radial:{','.join(map(str, names))}", names[0]):
        out = tmp_path / f"o{len(errors)}"
        run("restore", *images, *blur, "--shape", shape, "--out", out)
        errors.append(error(out, picture))
    assert halves(tmp_path / "o0") == pytest.approx((FAR, NEAR), abs=0.15)
    assert errors[0] < 0.9 * errors[1]


@pytest.mark.slow
def test_the_camera_s_poses_give_inverse_depth(picture, tmp_path):
    # each pixel is the mean over the path: no mask is used here
    focal, inverse = 800.0, {"left": 0.5, "right": 0.9}
    t = np.linspace(0, 1, 160)
    paths = [np.stack([np.cos(6 * t), np.sin(6 * t)], axis=1), np.stack([2 * t - 1, 0.6 - t], axis=1)]
    paths = [4e-3 * (one - one.mean(axis=0)) for one in paths]
    y, x = np.mgrid[0 : SIZE[0], 0 : SIZE[1]] + float(R)
    each = np.where(x < R + SIZE[1] // 2, inverse["left"], inverse["right"])
    images = []
    for n, path in enumerate(paths, start=1):
        # a camera that moves right and up sees what was to the right and above: y is down in the picture
        samples = [map_coordinates(picture, [y - focal * v * each, x + focal * h * each], order=1) for h, v in path]
        images.append(np.mean(samples, axis=0))
        rows = np.column_stack([0.1 * t, path, np.zeros((len(t), 4))])
        np.savetxt(tmp_path / f"{n}.csv", rows, delimiter=",", header="t_s,x,y,z,rx,ry,rz", comments="")
    images = write(tmp_path, images)
    records = ["--poses", tmp_path / "1.csv", tmp_path / "2.csv", "--focal-px", focal, "--max-inverse-depth", 1.2]
    run("restore", *images, "--blur", "motion", *records, *QUICK, "--out", tmp_path / "o")
    assert record_of(tmp_path / "o")["w"]["unit"] == "1/m"
    assert halves(tmp_path / "o") == pytest.approx((inverse["left"], inverse["right"]), rel=0.06)


@pytest.mark.slow
def test_uniform_motion_is_symmetric_along_its_axis(tmp_path):
    # smooth enough for cubics; most of the detail is along the motion, where it has no effect
    rng = np.random.default_rng(3)
    details = [gaussian_filter(rng.standard_normal(BOTH), wide) for wide in (5, (4, 20))]
    picture = 0.5 + sum(part * one / one.std() for part, one in zip((0.07, 0.16), details, strict=True))
    stacks = [mask_stack(uniform_motion(), 4.0, ratio=ratio, R=R) for ratio in (1.0, 1.5)]
    images = photographs(tmp_path, picture, stacks, noise_db=30)
    np.savetxt(tmp_path / "line.txt", uniform_motion(), fmt="%.5g")
    blur = ["--blur", "motion", "--shape", tmp_path / "line.txt", "--ratio", "1.5", "--max-w", "4"]
    errors = {}
    for axis in ("x", "both"):
        # one step that changes nearly nothing: the result is the initial depth
        start = ["--depth-start", "symmetric", "--symmetric-axis", axis, "--scheme", "1x(0+1)+1x1"]
        run("restore", *images, *blur, *start, "--out", tmp_path / axis)
        errors[axis] = np.abs(np.array(halves(tmp_path / axis)) - (FAR, NEAR)).max()
    # the cubic fits are accurate to a tenth of w; with the curvature along y included, blur along x is diluted
    assert errors["x"] < 0.5
    assert errors["both"] > 1.5 * errors["x"]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--blur", "motion", "--shape", "a.txt", "b.txt", "--offset", "1"], "--offset goes with --blur defocus"),
        (["--blur", "defocus", "--shape", "pillbox", "--offset", "1", "--offset", "2"], "--offset is for images after"),
        (["--blur", "defocus", "--shape", "pillbox", "--defocus-ratio", "1"], "go with --blur both"),
        (["--blur", "both", "--shape", "a.txt", "b.txt"], "needs --defocus-shape and --defocus-ratio"),
        (["--blur", "both", "--prototype-region", "0,0,9,9"], "goes with --blur motion"),
        (["--blur", "motion", "--prototype-region", "whole", "--ratio", "2"], "without --recorded-path and --ratio"),
        (["--blur", "motion", "--poses", "a.csv", "b.csv"], "--poses needs --focal-px"),
        (["--blur", "motion", "--poses", "a.csv", "b.csv", "--imu", "a.csv", "b.csv"], "not both"),
        (["--blur", "defocus", "--shape", "pillbox", "--exposure-s", "1"], "--exposure-s goes with --imu"),
        (["--blur", "motion", "--focal-px", "500"], "go with --imu"),
        (["--blur", "motion", "--imu", "a.csv", "b.csv"], "--focal-px and --max-inverse-depth"),
        (
            ["--blur", "motion", "--imu", "a.csv", "--focal-px", "500", "--max-inverse-depth", "1"],
            "one record for each",
        ),
        (["--blur", "motion", "--imu", "a.csv", "b.csv", "--shape", "c.txt"], "without --shape"),
    ],
)
def test_inconsistent_options_exit_2(tmp_path, options, complaint):
    run("restore", tmp_path / "1.png", tmp_path / "2.png", *options, "--out", tmp_path / "o", code=2, says=complaint)


def test_poses_without_a_column_exit_4(picture, tmp_path):
    images = write(tmp_path, [picture[R:-R, R:-R], picture[R + 1 : -R + 1, R:-R]])
    (tmp_path / "p.csv").write_text("t_s,x,y,z,rx,ry\n0,0,0,0,0,0\n1,0,0,0,0,0\n")
    records = ["--poses", tmp_path / "p.csv", tmp_path / "p.csv", "--focal-px", 800, "--max-inverse-depth", 1]
    run("restore", *images, "--blur", "motion", *records, "--out", tmp_path / "o", code=4, says="no column rz")
