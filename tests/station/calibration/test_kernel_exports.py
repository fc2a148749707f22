"""Filters as other programs apply them, compared with the convolutions by SciPy."""

import shutil
import subprocess
import sys

import cv2
import numpy as np
import pytest
from scipy.ndimage import convolve

from procedures.correction.kernel_tiles import kernel_tiles
from procedures.reading.development import named_curve
from station.calibration.exports.kernels import export_kernels
from tests.procedures.correction.lens_photographs import Sensor, blurred, kernels_over
from tests.procedures.correction.small_lens import RIM, SmallLens, scene

SHAPE = (128, 160)
LENSES = {"R": SmallLens((64, 80), 0.6), "G1": SmallLens((64, 80), 0.5), "B": SmallLens((64, 80), 0.5)}
WHITE = 65535


@pytest.fixture(scope="module")
def tiles():
    return kernel_tiles({name: lens.field(name).field for name, lens in LENSES.items()}, columns=4, size=11)


@pytest.fixture(scope="module")
def truth():
    return np.moveaxis(scene((SHAPE[0] + 2 * RIM, SHAPE[1] + 2 * RIM), channels=3), 0, -1)


@pytest.fixture(scope="module")
def picture(truth):
    """A developed picture through the lens (rows, columns, RGB), 16 bit."""
    rng, out = np.random.default_rng(1), []
    for colour, lens in enumerate(LENSES.values()):
        kernels = kernels_over(lambda x, y, lens=lens: lens.kernel(x / 2, y / 2, 2), SHAPE, (5, 7))
        out.append(Sensor(white_e=60000.0).read(blurred(truth[..., colour], kernels, RIM), rng))
    return np.rint(WHITE * np.stack(out, axis=-1)).astype(np.uint16)


@pytest.fixture(scope="module")
def expected(tiles, picture):
    """Convolutions with every filter, times the hat function of its node."""
    hats = [[np.interp(np.arange(n), at, row) for row in np.eye(len(at))]
            for n, at in zip(SHAPE, (tiles.y, tiles.x), strict=True)]  # fmt: skip
    out = np.zeros(picture.shape)
    for i, j, colour in np.ndindex(tiles.kernels.shape[:3]):
        through = convolve(picture[..., colour].astype(float), tiles.kernels[i, j, colour], mode="nearest")
        out[..., colour] += np.outer(hats[0][i], hats[1][j]) * through
    return out.clip(0, WHITE)


def applied(tmp_path, picture, tiles, form, command, suffix="ppm"):
    """The picture after a command, in which THIS, IN and OUT are the files."""
    files = {"THIS": tmp_path / f"this.{form}", "IN": tmp_path / f"in.{suffix}", "OUT": tmp_path / f"out.{suffix}"}
    files["THIS"].write_bytes(export_kernels(tiles, form, "Bench One, f/2.8").data)
    cv2.imwrite(str(files["IN"]), picture[..., ::-1])
    words = [str(files.get(word, word)) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    return cv2.imread(str(files["OUT"]), cv2.IMREAD_UNCHANGED)[..., ::-1].astype(float)


def test_one_python_file_applies_the_filters_with_numpy_alone(tmp_path, picture, tiles, expected, truth):
    loads = "import sys, runpy; sys.argv = sys.argv[1:]; runpy.run_path(sys.argv[0], run_name='__main__');" \
        "assert not {'scipy', 'cv2', 'station', 'procedures'} & set(sys.modules)"  # fmt: skip
    made = applied(tmp_path, picture, tiles, "python", [sys.executable, "-I", "-c", loads, "THIS", "IN", "OUT"])
    np.testing.assert_allclose(made, expected, atol=0.51)  # rounded to whole numbers
    inside = (slice(12, -12), slice(12, -12))
    light = WHITE * truth[RIM:-RIM, RIM:-RIM]
    before, after = (np.sqrt(np.mean((one - light)[inside] ** 2)) for one in (picture, made))
    assert after < 0.74 * before  # the error that the filters' own equations expect, for a spectrum 1/f^2


def test_the_python_file_refuses_a_picture_of_another_size_or_form(tmp_path, picture, tiles):
    program = tmp_path / "filters.py"
    program.write_bytes(export_kernels(tiles, "python", "Bench One").data)
    np.save(tmp_path / "in.npy", picture[1:])
    for name, words in (
        ("in.npy", "a picture of (128, 160, 3) rows, columns, colours is required; got (127, 160, 3)"),
        ("in.png", f"files must be .npy, .ppm or .pgm; got {tmp_path / 'in.png'}"),
    ):
        command = [sys.executable, "-I", program, tmp_path / name, tmp_path / "out.npy"]
        assert words in subprocess.run(command, capture_output=True, text=True, check=False).stderr


@pytest.mark.parametrize(("head", "tail"), [(b"P6 160 128 255\n", b""), (b"P6\n# GIMP\n160 128 255\n", b"\n")])
def test_the_python_file_reads_every_form_of_header(tmp_path, tiles, head, tail):
    program = tmp_path / "filters.py"
    program.write_bytes(export_kernels(tiles, "python", "Bench One").data)
    (tmp_path / "in.ppm").write_bytes(head + bytes([100]) * (128 * 160 * 3) + tail)
    command = [sys.executable, "-I", program, tmp_path / "in.ppm", tmp_path / "out.ppm"]
    subprocess.run(command, timeout=20, check=True)
    assert (cv2.imread(str(tmp_path / "out.ppm")) == 100).all()  # filters of sum 1


def test_the_python_file_refuses_files_that_it_cannot_read_or_write(tmp_path, tiles):
    program = tmp_path / "filters.py"
    program.write_bytes(export_kernels(tiles, "python", "Bench One").data)
    (tmp_path / "plain.ppm").write_bytes(b"P3\n160 128\n255\n0 0 0\n")
    (tmp_path / "short.ppm").write_bytes(b"P6\n160 128\n255\n" + bytes(100))
    (tmp_path / "empty.ppm").write_bytes(b"")
    np.save(tmp_path / "float.npy", np.zeros((128, 160, 3)))
    np.save(tmp_path / "nan.npy", np.full((128, 160, 3), np.nan))
    np.save(tmp_path / "signed.npy", np.zeros((128, 160, 3), np.int64))
    for name, words in (
        ("plain.ppm", "has no header of P5 or P6"), ("empty.ppm", "has no header of P5 or P6"),
        ("short.ppm", "is truncated"), ("float.npy", "floating-point numbers are written as .npy"),
        ("nan.npy", "numbers must be finite"), ("none.ppm", "must be readable and writable pictures"),
        ("signed.npy", "must be floating-point or unsigned of 8 or 16 bits"),
    ):  # fmt: skip
        command = [sys.executable, "-I", program, tmp_path / name, tmp_path / "out.ppm"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
        assert words in done.stderr
        assert "Traceback" not in done.stderr
        assert not (tmp_path / "out.ppm").exists()


@pytest.mark.slow
@pytest.mark.parametrize("curve", ["linear", "srgb"])
@pytest.mark.skipif(shutil.which("sh") is None, reason="a shell script")
def test_imagemagick_applies_the_filters(tmp_path, picture, tiles, expected, curve):
    magick = shutil.which("magick") or shutil.which("convert")
    version = subprocess.run([magick, "-version"], capture_output=True, text=True, check=False) if magick else None
    if version is None or "ImageMagick" not in version.stdout:
        pytest.skip("ImageMagick is not installed")
    levels = np.rint(WHITE * named_curve(curve).encoded(picture / WHITE)).astype(np.uint16)
    made = applied(tmp_path, levels, tiles, "imagemagick", ["sh", "THIS", "IN", "OUT", curve])
    made = WHITE * named_curve(curve).decoded(made / WHITE)
    # filters of five digits, and eight roundings to 16 bit; it clips each of the four results that are blended
    unclipped = (expected > 0.02 * WHITE) & (expected < 0.98 * WHITE)
    assert np.percentile(np.abs(made - expected)[unclipped], 99) < 6
    assert np.median(np.abs(made - expected)) < 1


@pytest.mark.skipif(shutil.which("sh") is None, reason="a shell script")
@pytest.mark.parametrize("words", [["IN"], ["IN", "OUT", "sRGB"], ["IN", "OUT", "srgb", "more"]])
def test_the_shell_script_refuses_words_that_it_does_not_know(tmp_path, tiles, words):
    (tmp_path / "this.sh").write_bytes(export_kernels(tiles, "imagemagick", "Bench One").data)
    done = subprocess.run(["sh", tmp_path / "this.sh", *words], capture_output=True, text=True, check=False)
    assert (done.returncode, "Usage: sh THIS IN OUT [srgb|linear]" in done.stderr) == (2, True)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gmic") is None, reason="G'MIC is not installed")
def test_gmic_applies_the_filters(tmp_path, picture, tiles, expected):
    command = ["gmic", "THIS", "IN", "station_correct", "0", "cut", f"0,{WHITE}", "-o", "OUT"]
    made = applied(tmp_path, picture, tiles, "gmic", command, "tiff")
    np.testing.assert_allclose(made, expected, atol=4)  # filters of five digits


def test_rawtherapee_receives_the_radius_and_its_growth(tiles):
    export = export_kernels(tiles, "rawtherapee", "Bench One")
    values = dict(line.split("=") for line in export.data.decode().splitlines() if "=" in line)
    radius, offset = float(values["DeconvRadius"]), float(values["DeconvRadiusOffset"])
    # two decimals of a linear fit to the nodes, the corners among them
    assert radius + offset == pytest.approx(tiles.sigma_px[0, 0], abs=0.06)
    assert "the PSF is replaced by a round Gaussian" in export.lost[0]
