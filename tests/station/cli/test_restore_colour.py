import json

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms
from scipy.ndimage import gaussian_filter

from drivers.dng import Shot, write_dng
from procedures.developed import read_developed
from procedures.raw import Exposure, Plane, RawFrame
from procedures.reading.development import Development, named_curve
from procedures.restoration.masks.blur_models import mask_stack, pillbox
from procedures.restoration.masks.blur_operator import BlurOperator
from station.calibration.restoration.developed import picture_file
from tests.program import run

SHAPE, R = (96, 112), 8
LIGHT = np.array([0.6, 1.0, 0.7])
QUICK = ("--blur", "defocus", "--shape", "pillbox", "--ratio", "1.25", "--max-w", "3", "--scheme", "4x(8+8)+1x10")


@pytest.fixture(scope="module")
def light():
    """Two photographs of a grey scene at two depths, and the sharp one (3, 3, H, W), with a contrast of 30 levels."""
    rng, extended = np.random.default_rng(5), (SHAPE[0] + 2 * R, SHAPE[1] + 2 * R)
    grey = 0.5 + 0.13 * np.sign(gaussian_filter(rng.standard_normal(extended), 6))
    grey = gaussian_filter(grey + 0.3 * np.clip(gaussian_filter(rng.standard_normal(extended), 1.5), -0.4, 0), 0.6)
    w = np.where(np.arange(extended[1]) > extended[1] / 2, 4.6, 3.4) * np.ones(extended)
    photographs = []
    for ratio in (1.0, 1.25):
        blur = BlurOperator(mask_stack(pillbox(), 5.6, ratio=ratio, R=R), SHAPE)
        blur.focus(w)
        photographs.append(blur.blur(LIGHT[:, None, None] * grey))
    photographs = np.stack(photographs)
    truth = (LIGHT[:, None, None] * grey)[None, :, R:-R, R:-R]
    return np.concatenate([photographs + 1.2e-3 * rng.standard_normal(photographs.shape), truth])


def restore(files, out, *words):
    return run("restore", *files, *QUICK, *words, "--out", out)


@pytest.mark.slow
def test_a_grey_scene_in_two_raw_files_stays_grey(light, tmp_path):
    *files, truth = [tmp_path / "a.dng", tmp_path / "b.dng", tmp_path / "truth.dng"]
    for path, z in zip([*files, truth], light, strict=True):
        mosaic = np.zeros(SHAPE, np.uint16)
        for (y, x), c in {(0, 0): 1, (0, 1): 0, (1, 0): 2, (1, 1): 1}.items():
            mosaic[y::2, x::2] = np.rint(500 + 15000 * z[c, y::2, x::2])
        write_dng(path, mosaic, Shot(), cfa="GRBG", black=(500,) * 4, white=15500)
    restore(files, tmp_path / "out", "--plane", "all", "--reference", str(truth))
    sharp = cv2.imread(str(tmp_path / "out" / "sharp.tiff"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert sharp.shape == (*SHAPE, 3)
    balanced = sharp / LIGHT
    # planes stacked without their displacement differed by half the contrast
    assert 255 * np.std(balanced[..., 0] - balanced[..., 2]) < 2
    w = np.load(tmp_path / "out" / "w.npy")
    assert w.shape == SHAPE
    # in pixels of a plane, as --max-w: 1.7 and 2.3
    assert np.median(w[20:-20, 70:]) == pytest.approx(2.3, abs=0.15)
    assert (tmp_path / "out" / "report.html").exists()
    comparison = json.loads((tmp_path / "out" / "result.json").read_text())["ground_truth"]
    # of the planes' samples: those of red and blue are between green's
    off = (sharp - light[2].transpose(1, 2, 0))[12:-12, 12:-12]
    assert comparison["error"] == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.3)
    middle = [SHAPE[1] / 4, SHAPE[0] / 4]
    np.testing.assert_allclose(np.array(comparison["matrix"]) @ [*middle, 1], middle, atol=0.05)


def encode(z):
    return np.where(z <= 0.0031308, 12.92 * z, 1.055 * np.clip(z, 0, 1) ** (1 / 2.4) - 0.055).transpose(1, 2, 0)


COARSE = ("--max-w", "6", "--scheme", "1x(4+4)+1x4")


@pytest.mark.slow
@pytest.mark.parametrize("linear", [False, True])
def test_colour_files_are_restored_by_their_encoding(light, tmp_path, linear):
    files = [tmp_path / "a.tiff", tmp_path / "b.tiff"]
    rng = np.random.default_rng(4)
    for path, z in zip(files, light[:2], strict=True):
        z = z + 0.01 * rng.standard_normal(z.shape) * np.sqrt(z)  # of photons
        levels = z.transpose(1, 2, 0) if linear else encode(z)
        cv2.imwrite(str(path), np.rint(65535 * np.clip(levels, 0, 1)).astype(np.uint16)[..., ::-1])
    restore(files, tmp_path / "out", "--encoding", "srgb", *COARSE)
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["parameters"]["encoding"] == "srgb"
    assert record["parameters"]["planes"] == ["R", "G", "B"]
    assert ("seem to be linear" in json.dumps(record)) == linear
    if not linear:
        sharp, picture = (
            cv2.imread(str(tmp_path / "out" / name), cv2.IMREAD_UNCHANGED)[..., ::-1]
            for name in ("sharp.tiff", "picture.tiff")
        )
        assert sharp.mean(axis=(0, 1)) == pytest.approx(light[0].mean(axis=(1, 2)), rel=0.02)
        np.testing.assert_allclose(picture / 65535, encode(np.moveaxis(sharp, -1, 0)), atol=2e-4)


@pytest.mark.slow
def test_jpeg_files_are_restored_with_doubt_and_written_as_jpeg(light, tmp_path):
    files = [tmp_path / "a.jpg", tmp_path / "b.jpg"]
    profile, exif = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes(), Image.Exif()
    exif[274] = 6  # to be turned by a quarter
    for path, z in zip(files, light[:2], strict=True):
        image = Image.fromarray(np.rint(255 * encode(z)).astype(np.uint8))
        image.save(path, quality=92, icc_profile=profile, exif=exif)
    restore(files, tmp_path / "out", *COARSE)
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert "sharpening and noise reduction" in json.dumps(record["result"])
    assert record["result"]["verdict"] == "doubtful"
    with Image.open(tmp_path / "out" / "picture.jpg") as picture:
        assert picture.info["icc_profile"] == profile
        assert picture.getexif()[274] == 6
        assert picture.size == (SHAPE[1], SHAPE[0])
        levels = np.asarray(picture) / 255
    sharp = cv2.imread(str(tmp_path / "out" / "sharp.tiff"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    np.testing.assert_allclose(levels, encode(np.moveaxis(sharp, -1, 0)), atol=0.06)
    assert (levels - encode(np.moveaxis(sharp, -1, 0))).std() < 0.01


@pytest.mark.parametrize(("kind", "bits"), [("PNG", 8), ("PNG", 16), ("TIFF", 16), ("WEBP", 8), ("HEIF", 8)])
def test_pictures_are_written_in_the_format_that_was_read(light, tmp_path, kind, bits):
    if kind == "HEIF":
        pytest.importorskip("pillow_heif", reason="pillow-heif is not installed")
    profile, exif = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes(), Image.Exif()
    exif[271] = "Maker"
    development = Development(kind, named_curve("srgb"), True, bits, 0.0, profile, exif.tobytes())
    planes = {c: Plane(c, light[2][i].astype(np.float32), 1 / 255) for i, c in enumerate("RGB")}
    frame = RawFrame(tmp_path / "a", "", planes, Exposure(), development=development)
    ((name, write),) = picture_file(frame, light[2], words="restored").items()
    write(tmp_path / name)
    again = read_developed(tmp_path / name)
    assert (again.development.format, again.development.bits, again.development.icc) == (kind, bits, profile)
    samples = np.stack([one.samples for one in again.planes.values()])
    assert np.abs(samples - light[2]).mean() < (0.01 if kind in ("WEBP", "HEIF") else 1.2 / ((1 << bits) - 1))
