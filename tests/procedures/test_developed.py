"""Developed pictures: their light, the error of their coding, and their files, by Pillow's and OpenCV's own writers."""

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms
from scipy.ndimage import gaussian_filter

from drivers.tiff import head, long, short
from procedures.developed import read_developed
from procedures.outcome import BadInput
from procedures.raw import read_frame
from procedures.reading.development import curve_of_profile, named_curve
from station.calibration.camera_metadata import CameraMetadata
from station.calibration.picture_files import write_linear_dng
from station.procedure.base import read_picture

LIGHT = np.linspace(0, 1, 60).reshape(4, 5, 3)
LEVELS = np.where(LIGHT <= 0.0031308, 12.92 * LIGHT, 1.055 * LIGHT ** (1 / 2.4) - 0.055)  # IEC 61966-2-1


def scene(seed=1, size=160):
    rng = np.random.default_rng(seed)
    each = [gaussian_filter(rng.standard_normal((size, size)), width) for width in (1, 2, 6)]
    grey = sum(one / one.std() for one in each)
    return np.clip(128 + 30 * grey[..., None] + 8 * rng.standard_normal(3), 0, 255).astype(np.uint8)


def saved(image, path, **options):
    Image.fromarray(image).save(path, **options)
    return path


@pytest.mark.parametrize("suffix", [".tiff", ".png"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_colours_are_read_by_their_encoding(tmp_path, suffix, kind):
    white = np.iinfo(kind).max
    for encoding, values in (("linear", LIGHT), ("srgb", LEVELS), (None, LEVELS)):
        path = tmp_path / f"{encoding}{suffix}"
        cv2.imwrite(str(path), np.rint(white * values).astype(kind)[..., ::-1])
        frame = read_developed(path, encoding)
        light = np.stack([frame.planes[c].samples for c in "RGB"], axis=-1)
        np.testing.assert_allclose(light, LIGHT, atol=2.3 / white)  # half a step, where the curve is steepest: 2.28
        assert frame.development.assumed == (encoding is None)


@pytest.mark.parametrize(("suffix", "options"), [(".jpg", {"quality": 95}), (".webp", {"quality": 95}), (".heic", {})])
def test_coded_pictures_are_read_within_their_error(tmp_path, suffix, options):
    if suffix == ".heic":
        pytest.importorskip("pillow_heif", reason="pillow-heif is not installed").register_heif_opener()
    image = scene()
    frame = read_developed(saved(image, tmp_path / f"a{suffix}", **options))
    light = np.stack([one.samples for one in frame.planes.values()], axis=-1)
    luminance = (named_curve("srgb").encoded(light) - image / 255) @ (0.299, 0.587, 0.114)
    assert luminance.std() < 2 * frame.development.coding
    assert list(frame.planes) == ["R", "G", "B"]


@pytest.mark.parametrize(("quality", "above"), [(97, 1.1), (90, 1.1), (80, 1.1), (60, 1.3)])
def test_the_coding_error_is_that_of_the_file(tmp_path, quality, above):
    image = scene()[..., 0]
    frame = read_developed(saved(image, tmp_path / "a.jpg", quality=quality))
    actual = (np.asarray(Image.open(tmp_path / "a.jpg")) - image.astype(float)).std() / 255
    assert 0.9 * actual < frame.development.coding < above * actual  # where most are zero, no Laplace distribution
    assert list(frame.planes) == ["Y"]


def test_a_profile_states_the_tone_curve():
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    np.testing.assert_allclose(
        curve_of_profile(profile).light, named_curve("srgb").light, atol=2e-4
    )  # its table's step
    at = profile.index(b"gTRC")
    offset = int.from_bytes(profile[at + 4 : at + 8], "big")
    gamma = b"curv" + bytes(4) + (1).to_bytes(4, "big") + (563).to_bytes(2, "big")  # Adobe RGB: 563 / 256
    of_gamma = profile[:offset] + gamma + profile[offset + len(gamma) :]
    levels = np.linspace(0, 1, 50)
    np.testing.assert_allclose(curve_of_profile(of_gamma).decoded(levels), levels ** (563 / 256), atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "values"),
    [(0, (2.2,)), (1, (2.2, 0.9, 0.1)), (2, (2.2, 0.8, 0.1, 0.1)), (3, (2.4, 0.9479, 0.0521, 0.0774, 0.0405)),
     (4, (2.4, 0.9, 0.05, 0.0774, 0.0405, 0.02, 0.01))],
)  # fmt: skip
def test_parametric_curves_are_those_of_the_standard(kind, values):
    body = b"para" + bytes(4) + kind.to_bytes(2, "big") + bytes(2)
    body += b"".join(round(65536 * v).to_bytes(4, "big", signed=True) for v in values)
    profile = bytes(128) + (1).to_bytes(4, "big") + b"gTRC" + (144).to_bytes(4, "big") + len(body).to_bytes(4, "big")
    light = curve_of_profile(profile + body).decoded(np.array([0.02, 0.5, 1.0]))

    def expected(x):
        g, a, b, c, d, e, f = (*values, *(0.0,) * (7 - len(values)))
        return {
            0: lambda: x**g,
            1: lambda: (a * x + b) ** g if x >= -b / a else 0.0,
            2: lambda: (a * x + b) ** g + c if x >= -b / a else c,
            3: lambda: (a * x + b) ** g if x >= d else c * x,
            4: lambda: (a * x + b) ** g + e if x >= d else c * x + f,
        }[kind]()

    np.testing.assert_allclose(light, np.array([expected(x) for x in (0.02, 0.5, 1.0)]) / expected(1.0), atol=3e-4)


def test_the_profile_is_used_and_a_damaged_one_is_not(tmp_path):
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    frame = read_developed(saved(scene(), tmp_path / "a.jpg", icc_profile=profile))
    assert (frame.development.curve.name, frame.development.assumed) == ("ICC profile", False)
    damaged = read_developed(saved(scene(), tmp_path / "b.png", icc_profile=profile[:200]))
    assert (damaged.development.curve.name, damaged.development.assumed) == ("srgb", True)


def test_an_opaque_picture_is_read_and_a_transparent_one_refused(tmp_path):
    opaque = np.dstack([scene(), np.full((160, 160), 255, np.uint8)])
    assert read_developed(saved(opaque, tmp_path / "a.png")).planes["G"].samples.shape == (160, 160)
    opaque[0, 0, 3] = 100
    with pytest.raises(BadInput, match="one channel or three"):
        read_developed(saved(opaque, tmp_path / "b.png"))


@pytest.mark.parametrize(("suffix", "mode", "words"), [
    (".jpg", "CMYK", "has CMYK"), (".webp", "RGBA", "transparency"), (".heic", "RGBA", "transparency"),
])  # fmt: skip
def test_coded_pictures_in_cmyk_or_with_transparency_are_refused(tmp_path, suffix, mode, words):
    if suffix == ".heic":
        pytest.importorskip("pillow_heif", reason="pillow-heif is not installed").register_heif_opener()
    image = Image.fromarray(scene()).convert(mode)
    image.save(tmp_path / f"a{suffix}")
    if mode == "RGBA":
        assert "G" in read_developed(tmp_path / f"a{suffix}").planes  # opaque
        image.putalpha(100)
        image.save(tmp_path / f"a{suffix}")
    with pytest.raises(BadInput, match=words):
        read_developed(tmp_path / f"a{suffix}")


@pytest.mark.parametrize(("mode", "words"), [("CMYK", "has CMYK"), ("LAB", r"has CIE L\*a\*b\*")])
def test_a_tiff_in_other_colours_than_rgb_is_refused(tmp_path, mode, words):
    Image.fromarray(scene()).convert(mode).save(tmp_path / "a.tiff")
    with pytest.raises(BadInput, match=words):
        read_developed(tmp_path / "a.tiff")


def test_a_tiff_of_16_bits_with_a_plane_for_each_colour_is_refused(tmp_path):
    # OpenCV fills the rows with the samples of other planes and reports no error
    levels = np.rint(65535 * LIGHT).astype("<u2").transpose(2, 0, 1)
    tags = {256: long(5), 257: long(4), 258: short(16, 16, 16), 259: short(1), 262: short(2), 277: short(3),
            278: long(4), 279: long(40, 40, 40), 284: short(2)}  # fmt: skip
    (tmp_path / "a.tiff").write_bytes(head(tags, {}, [40] * 3) + levels.tobytes())
    with pytest.raises(BadInput, match="each colour as a plane of its own"):
        read_developed(tmp_path / "a.tiff")


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_a_palette_is_colours(tmp_path, suffix):
    palette = Image.fromarray(scene()).quantize(16)
    palette.save(tmp_path / f"a{suffix}")
    frame = read_picture(tmp_path / f"a{suffix}", None, read_frame)
    levels = np.stack([frame.development.curve.encoded(frame.planes[c].samples) for c in "RGB"], axis=-1)
    np.testing.assert_allclose(255 * levels, np.asarray(palette.convert("RGB")), atol=0.05)


@pytest.mark.parametrize("suffix", [".jpg", ".webp", ".heic", ".png", ".tiff"])
def test_truncated_pictures_are_refused(tmp_path, suffix):
    if suffix == ".heic":
        pytest.importorskip("pillow_heif", reason="pillow-heif is not installed").register_heif_opener()
    path = saved(scene(), tmp_path / f"a{suffix}")
    data = path.read_bytes()
    for end in (20, len(data) // 2):
        with pytest.raises(BadInput) as refused:
            read_developed(path, data=data[:end])
        assert "object at" not in refused.value.reason
        assert "\n" not in refused.value.reason


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_a_heic_file_has_the_sensors_rows(tmp_path, orientation):
    pytest.importorskip("pillow_heif", reason="pillow-heif is not installed").register_heif_opener()
    tags = Image.Exif()
    tags[271], tags[274] = "Bench", orientation
    frames = [
        read_developed(saved(scene()[:96], tmp_path / "a.heic", exif=exif.tobytes())) for exif in (Image.Exif(), tags)
    ]
    upright, turned = ([plane.samples for plane in frame.planes.values()] for frame in frames)
    np.testing.assert_array_equal(turned, upright)
    kept = Image.Exif()
    kept.load(frames[1].development.exif)
    assert (kept[271], kept[274]) == ("Bench", orientation)


def test_a_tiff_of_coded_blocks_has_their_error(tmp_path):
    assert read_developed(saved(scene(), tmp_path / "a.tiff", compression="jpeg")).development.coding > 0


def test_a_text_is_no_picture(tmp_path):
    (tmp_path / "a.jpg").write_text("nothing")
    with pytest.raises(BadInput, match="no JPEG, WebP, HEIC, PNG, TIFF or RAW"):
        read_developed(tmp_path / "a.jpg")


def test_a_linear_dng_has_its_colours(tmp_path):
    light = np.random.default_rng(2).random((3, 48, 64), dtype=np.float32)
    write_linear_dng(tmp_path / "a.dng", light, CameraMetadata())
    frame = read_developed(tmp_path / "a.dng")
    np.testing.assert_allclose(np.stack([one.samples for one in frame.planes.values()]), light, atol=3e-5)
    assert (frame.development.format, frame.development.curve.name) == ("RAW", "linear")
