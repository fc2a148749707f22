"""Refusals of `station restore`: exit code, requirement and input, remedy, and no folder left behind."""

import cv2
import numpy as np
import pytest

from tests.program import run

QUICK = ["--scheme", "1x(1+1)", "--max-w", "5.2"]


@pytest.fixture(scope="module")
def folder(shared_data, tmp_path_factory):
    """A corner of the vibrating pair as 1.pgm and 2.pgm, and typical mistakes."""
    source, target = shared_data / "synthetic" / "restoration", tmp_path_factory.mktemp("refused")
    whole = [cv2.imread(str(source / f"vibration_40dB_{n}.pgm"), cv2.IMREAD_UNCHANGED) for n in (1, 2)]
    corner = np.s_[100:200, 180:300]
    rng = np.random.default_rng(0)
    level = [np.full((100, 120), grey, np.uint16) for grey in (30000, 31000)]
    images = {
        "first": whole[0][corner],
        "second": whole[1][corner],
        "upright": np.rot90(whole[1][corner]),
        "overhead": np.rot90(whole[1][corner], 2),
        "smaller": whole[1][100:190, 180:300],
        "far": whole[1][100:200, 150:270],
        "near": whole[1][100:200, 188:308],
        "white": np.where(whole[1] > 30000, 65535, whole[1])[corner].astype(np.uint16),
        "level1": level[0],
        "level2": level[1],
        "noise1": (level[0] + 60 * rng.standard_normal((100, 120))).astype(np.uint16),
        "noise2": (level[0] + 60 * rng.standard_normal((100, 120))).astype(np.uint16),
    }
    for name, image in images.items():
        cv2.imwrite(str(target / f"{name}.pgm"), image)
    for n in (1, 2):
        (target / f"shape{n}.txt").write_text((source / f"vibration_shape{n}.txt").read_text())
    return target


def refuse(folder, tmp_path, arguments, code, *says):
    """Exit code and sentences are these, and no folder of results is left."""
    names = {p.stem: p for p in folder.iterdir()}
    result = run("restore", *(names.get(a, a) for a in arguments), "--out", tmp_path / "o", code=code)
    assert not (tmp_path / "o").exists(), result.stderr
    assert all(one in result.stderr for one in says), result.stderr


@pytest.mark.parametrize(
    ("one", "two", "code", "complaint", "remedy"),
    [
        ("first", "smaller", 4, "of one size, got 120 x 100, 120 x 90", "crop photographs"),
        ("first", "first", 4, "1 and 2 are identical", "different motion or aperture"),
        ("first", "upright", 4, "of one size, got 120 x 100, 100 x 120", "to one orientation"),
        ("first", "overhead", 4, "photograph 2 is turned by 180 degrees", "turn it back"),
        ("first", "far", 5, "shifted by (29, 1) pixels, more than the masks' 6", "register the photographs"),
        ("first", "near", 5, "shifted by (-8, 0) pixels, more than the masks' 6", "register the photographs"),
        ("first", "white", 5, "63% of a photograph is saturated; at most 20%", "expose less"),
        ("level1", "level2", 5, "need texture", "structure"),
        ("noise1", "noise2", 5, "need texture", "structure"),
        ("first", "absent.pgm", 4, "no file absent.pgm", "check the path"),
        ("first", "shape1", 4, "text file, not a photograph", "RAW"),
    ],
)
def test_photographs(folder, tmp_path, one, two, code, complaint, remedy):
    words = [one, two, "--blur", "motion", "--shape", "shape1", "shape2", *QUICK]
    refuse(folder, tmp_path, words, code, complaint, remedy)


SHAPES = {
    "3 3 1\n1 2 1\n": (4, "must be an array (k, k); got an array (2, 3)", "resample"),
    "1 1 1 1\n" * 4: (4, "odd number of rows, 3 or more; got 4", "resample"),
    "1": (4, "odd number of rows, 3 or more; got 1", "resample"),
    "0 1 0\n1 -2 1\n0 1 0\n": (4, "must be finite, from 0 to 1e+30; got -2 to 1", "clip its noise"),
    "0 1 0\n1 nan 1\n0 1 0\n": (4, "must be finite", "text array of numbers"),
    "0 0 0\n0 0 0\n0 0 0\n": (4, "positive sum", "resample it"),
    "": (4, "got an array (0)", "text array of numbers"),
    "1 2 3\n1 2\n1 2 3\n": (4, "rows of equal length", "text array of numbers"),
    "hello world\n": (4, "could not convert string to float: 'hello'", "text array of numbers"),
    "\x00\xff": (4, "must be UTF-8 text", "text array of numbers"),
}


@pytest.mark.parametrize("text", SHAPES)
def test_shape_files(folder, tmp_path, text):
    (tmp_path / "shape.txt").write_bytes(text.encode("latin-1"))
    arguments = ["first", "second", "--blur", "motion", "--shape", str(tmp_path / "shape.txt"), "shape2", *QUICK]
    refuse(folder, tmp_path, arguments, *SHAPES[text])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "code", "complaint"),
    [
        (["defocus", "--shape", "pillbox"], 2, "ratio 1 with equal shapes"),
        (["defocus", "--shape", "pillbox", "--ratio", "1"], 2, "ratio 1 with equal shapes"),
        (["motion", "--shape", "shape1"], 2, "ratio 1 with equal shapes"),
        (["motion", "--shape", "shape1", "shape1"], 2, "ratio 1 with equal shapes"),
        (["motion", "--shape", "absent.txt", "shape2"], 4, "there is no file absent.txt"),
        (["motion", "--shape", "pillbox", "--ratio", "1.2"], 2, "pillbox is a blur of --blur defocus"),
        (["motion", "--shape", "polygon:6", "--ratio", "1.2"], 2, "polygon:6 is a blur of --blur defocus"),
        (["defocus", "--shape", "polygon:2", "--ratio", "1.2"], 2, "an aperture needs 3 blades or more"),
        (["defocus", "--shape", "polygon:six", "--ratio", "1.2"], 2, "a polygon is given by its blades"),
        (["motion"], 2, "one shape, or one for each of 2 images; got 0"),
        (["defocus", "--shape", "pillbox", "--ratio", "0"], 2, "ratio of w must be positive, got 0"),
        (["defocus", "--shape", "pillbox", "--ratio", "-1.2"], 2, "ratio of w must be positive, got -1.2"),
        (["defocus", "--shape", "pillbox", "--ratio", "nan"], 2, "not a finite number"),
        (["defocus", "--shape", "pillbox", "--ratio", "1e9"], 2, "too large for photographs of 120 x 100"),
        (["defocus", "--shape", "pillbox", "--ratio", "1.2", "--ratio", "1.3"], 2, "here 1; got 2 values"),
        (["defocus", "--shape", "pillbox", "--ratio", "1.2", "--max-w", "nan"], 2, "not a finite number"),
        (["defocus", "--shape", "pillbox", "--ratio", "1.2", "--max-w", "30"], 2, "half-size 37 pixels are too large"),
        (["motion", "--shape", "shape1", "shape2", "--max-w", "0"], 2, "max w"),
        (["motion", "--shape", "shape1", "shape2", "--scheme", "often"], 2, "scheme"),
        (["motion", "--prototype-region", "10,10"], 2, "X,Y,W,H"),
        (["motion", "--prototype-region", "0,0,60,96", "--recorded-path", "p.txt"], 2, "one path for each"),
        (["motion", "--prototype-region", "90,60,60,60"], 2, "must lie within photographs of 120 x 100"),
        (["motion", "--prototype-region", "-5,0,60,60"], 2, "must lie within photographs of 120 x 100"),
    ],
)
def test_blurs_and_ranges(folder, tmp_path, options, code, complaint):
    refuse(folder, tmp_path, ["first", "second", "--scheme", "1x(1+1)", "--blur", *options], code, complaint)
