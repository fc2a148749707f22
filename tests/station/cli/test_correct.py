import io
import json
import shutil
from dataclasses import replace
from functools import partial

import cv2
import exifread
import numpy as np
import pytest
import rawpy
from PIL import Image, ImageCms

from drivers.dng import Shot, write_dng
from procedures.correction.checks import check_exposure
from procedures.field.field_file import add_lights, read_camera, write_field
from procedures.field.interpolate import interpolate
from procedures.outcome import Refused
from procedures.reading.development import curve_of_profile, named_curve
from procedures.reading.exposure import Exposure
from procedures.vignetting.surface import LightSurface
from station.calibration.correction import TypedAperture, unknown_with_typed
from tests.procedures.correction.lens_photographs import RGGB, Sensor
from tests.procedures.correction.small_lens import NOTED, RIM, SmallLens, bayer, burst, grey, scene
from tests.procedures.field.lens import SHAPE as FIELD_SHAPE
from tests.procedures.field.lens import FieldCamera, K, grid, nodes
from tests.program import run

SLOW_FIXTURES = {"files"}

SHAPE, PLANES = (96, 120), (64, 80)
SHOT = Shot(
    f_number=2.8, focal_length_mm=50.0, subject_distance_mm=2000.0, make="Bench", model="One", lens="Bench 50mm"
)
CAMERA = replace(NOTED, camera="Bench One")
FEW = ("--iterations", 3)


def light(shape, **settings):
    return scene((shape[0] + 2 * RIM, shape[1] + 2 * RIM), **settings)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A mosaic as a DNG, a grey photograph without notes, and the fields of both."""
    folder = tmp_path_factory.mktemp("correct")
    lens = SmallLens(PLANES, 0.6)
    fields = dict.fromkeys(RGGB, lens.field("G1"))
    write_field(folder / "field.h5", fields, {}, [], {}, CAMERA)
    seen = bayer(dict.fromkeys(RGGB, lens), light((128, 160), channels=3), Sensor(white_e=60000.0))
    mosaic = np.zeros((128, 160), dtype=np.uint16)
    for name, (x, y) in RGGB.items():
        mosaic[y::2, x::2] = np.rint(512 + 15000 * np.clip(seen.frame.planes[name].samples, 0, 1))
    write_dng(folder / "photo.dng", mosaic, SHOT, cfa="RGGB", black=(512,) * 4, white=15512, orientation=6)
    lens = SmallLens(SHAPE, 0.8)
    plain = grey(lens, light(SHAPE), Sensor(white_e=60000.0))
    cv2.imwrite(
        str(folder / "photo.tiff"), np.rint(65535 * plain.frame.planes["Y"].samples.clip(0, 1)).astype(np.uint16)
    )
    write_field(folder / "grey.h5", {"Y": lens.field("Y")}, {}, [], {})
    return folder, seen, plain


correct = partial(run, "correct")


def stored(out, shape):
    """The TIFF's samples (rows, columns, channels): its strips lie in order at its end."""
    data = (out / "corrected.tiff").read_bytes()
    return np.frombuffer(data[-2 * int(np.prod(shape)) :], dtype="<u2").reshape(shape) / 65535


@pytest.mark.parametrize(
    ("command", "name", "given"),
    [("correct", "picture.jpg", ()), ("sharpen", "picture.png", ("--encoding", "srgb"))],
    ids=["jpeg", "png"],
)
def test_a_developed_picture_is_corrected_in_its_format_and_doubtful(files, tmp_path, command, name, given):
    folder, seen, _ = files
    curve = named_curve("srgb")
    through = curve.encoded(np.stack([seen.light[plane] for plane in ("B", "G1", "R")])).transpose(1, 2, 0)
    depth = 65535 if name.endswith("png") else 255
    levels = np.rint(depth * through).astype(np.uint16 if depth > 255 else np.uint8)
    cv2.imwrite(str(tmp_path / name), levels, [cv2.IMWRITE_JPEG_QUALITY, 97])
    run(command, tmp_path / name, "--field", folder / "field.h5", *given, "--out", tmp_path / "out")
    record = json.loads((tmp_path / "out" / "result.json").read_text())["result"]
    assert record["verdict"] == "doubtful"
    causes = record["reason"] + str(record["other_causes"])
    assert "developed" in causes
    # the curve of a file without loss is known where it is stated
    assert ("plausible tone curves" in causes) == ("curve_error" in record) == (not given)
    picture = cv2.imread(str(tmp_path / "out" / name), cv2.IMREAD_UNCHANGED)
    light = curve.decoded(picture / depth).transpose(2, 0, 1)[::-1]
    assert seen.psnr(light) > seen.psnr(curve.decoded(through).transpose(2, 0, 1)[::-1]) + 1


@pytest.mark.parametrize("suffix", [".jpg", ".webp", ".tiff"])
def test_a_developed_picture_keeps_orientation_and_metadata(files, tmp_path, suffix):
    folder, seen, _ = files
    levels = np.stack([255 * named_curve("srgb").encoded(seen.light[plane]) for plane in ("R", "G1", "B")], axis=-1)
    exif = Image.Exif()
    exif[271], exif[274], exif[33432] = "Bench", 6, "by the Bench"
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.fromarray(np.rint(levels).astype(np.uint8)).save(tmp_path / f"a{suffix}", exif=exif, icc_profile=profile)
    out = tmp_path / "out"
    correct(tmp_path / f"a{suffix}", "--field", folder / "field.h5", "--insist", *FEW, "--no-report", "--out", out)
    for path in (out / "corrected.tiff", out / f"picture{suffix}"):
        with Image.open(path) as picture:
            kept = picture.getexif()
            assert (kept[271], kept[274], kept[33432]) == ("Bench", 6, "by the Bench"), path
            middle = curve_of_profile(picture.info["icc_profile"]).decoded([0.5])
            expected = 0.5 if path.stem == "corrected" else named_curve("srgb").decoded([0.5])
            assert middle == pytest.approx(expected, abs=1e-3)


@pytest.fixture(scope="module")
def done(files, tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    return correct(files[0] / "photo.dng", "--field", files[0] / "field.h5", *FEW, "--out", out, "--json"), out


def test_a_raw_photograph_becomes_a_sharper_linear_dng_and_tiff_with_its_metadata(files, done):
    _, out = done
    assert {path.name for path in out.iterdir()} == {
        "corrected.dng", "corrected.tiff", "gain.csv", "report.html", "result.json",
    }  # fmt: skip
    picture = stored(out, (128, 160, 3)).transpose(2, 0, 1)
    seen = files[1]
    assert seen.psnr(picture) > seen.psnr(np.stack([seen.light[name] for name in ("R", "G1", "B")]))
    with rawpy.imread(str(out / "corrected.dng")) as raw:
        assert raw.raw_type.name == "Stack"
        levels = raw.raw_image[..., :3].transpose(2, 0, 1).astype(float)
    np.testing.assert_allclose(np.clip((levels - 2048) / 60000, 0, 1), picture, atol=2 / 60000)  # both round
    for name in ("corrected.tiff", "corrected.dng"):
        tags = exifread.process_file(io.BytesIO((done[1] / name).read_bytes()))
        copied = {key: str(tags[f"EXIF {key}"]) for key in ("FNumber", "FocalLength", "LensModel", "ExposureTime")}
        assert copied == {"FNumber": "14/5", "FocalLength": "50", "LensModel": "Bench 50mm", "ExposureTime": "1/50"}
        assert tags["Image Orientation"].values == [6]
        assert str(tags["Image Make"]) == "Bench"


def test_vignetting_stored_in_the_field_is_corrected(files, done, tmp_path):
    field = tmp_path / "field.h5"
    field.write_bytes((files[0] / "field.h5").read_bytes())
    falloff = {name: LightSurface(PLANES, 2, np.array([0.1, 0, -0.5, 0, -0.5])) for name in RGGB}
    add_lights(field, falloff)
    result = correct(files[0] / "photo.dng", "--field", field, *FEW, "--out", tmp_path / "out", "--json")
    record = json.loads(result.stdout)
    assert record["vignetting_undone"] == list(RGGB)
    before, after = stored(done[1], (128, 160, 3)), stored(tmp_path / "out", (128, 160, 3))
    y, x = 5, 150  # the formula itself: half a diagonal of the plane is 51.2 pixels, red lies at even pixels
    u = np.array([x / 2 - 39.5, y / 2 - 31.5]) / np.hypot(*PLANES) * 2
    light = np.exp(0.1 * u[0] - 0.5 * u @ u)
    assert after[y, x, 0] == pytest.approx(min(before[y, x, 0] / light, 1), abs=2 / 65535 / light)
    earlier = json.loads((done[1] / "result.json").read_text())["predicted"]["noise_gain"]
    assert record["predicted"]["noise_gain"]["greatest"] > 1.2 * earlier["greatest"]


def test_a_grey_photograph_whose_camera_is_not_known_is_doubtful(files, tmp_path):
    correct(files[0] / "photo.tiff", "--field", files[0] / "grey.h5", "--certificate", "--out", tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "Before: the photograph." in page
    assert '<td class="unit"><span data-unit>cycles/pixel</span></td>' in page
    assert "expanded uncertainty" not in (tmp_path / "certificate.html").read_text()  # no number has one
    record = json.loads((tmp_path / "result.json").read_text())
    assert record["verdict"] == "doubtful"
    assert "does not name its camera" in record["reason"]
    picture = stored(tmp_path, (1, *SHAPE))
    np.testing.assert_allclose(cv2.imread(str(tmp_path / "corrected.tiff"), cv2.IMREAD_UNCHANGED) / 65535, picture[0])
    plain = files[2]
    assert plain.psnr(picture) > plain.psnr(plain.frame.planes["Y"].samples[None]) + 2


def test_the_certificate_of_a_picture_is_verified_with_its_field(files, tmp_path):
    shutil.copy(files[0] / "grey.h5", tmp_path)
    words = "--field", tmp_path / "grey.h5", *FEW, "--no-report", "--certificate", "--out", tmp_path / "out"
    correct(files[0] / "photo.tiff", *words)
    certificate = tmp_path / "out" / "certificate.html"
    assert "numbers: ok, 4 of 4 computed again and equal" in run("verify", certificate).output
    (tmp_path / "grey.h5").write_bytes(b"another")
    run("verify", certificate, code=4, says=f"changed or missing: {tmp_path / 'grey.h5'}")


def test_a_result_into_the_folder_of_its_photograph_does_not_replace_it(files, done, tmp_path):
    picture = tmp_path / "corrected.tiff"
    for name in ("corrected.tiff", "result.json"):
        (tmp_path / name).write_bytes((done[1] / name).read_bytes())
    before = picture.read_bytes()
    says = "would replace"
    correct(picture, "--field", files[0] / "field.h5", "--insist", "--out", tmp_path, code=2, says=says)
    assert picture.read_bytes() == before


def test_a_field_of_another_aperture_is_refused_and_leaves_nothing(files, tmp_path):
    lens = SmallLens(PLANES, 0.6)
    write_field(tmp_path / "field.h5", {"G1": lens.field("G1")}, {}, [], {}, replace(CAMERA, f_number=5.6))
    done = correct(files[0] / "photo.dng", "--field", tmp_path, "--out", tmp_path / "out", code=5)
    assert "the field's aperture is f/5.6, the photograph's f/2.8" in done.output
    assert not (tmp_path / "out").exists()


def test_a_blurred_photograph_is_refused_as_processed_and_one_of_one_level_without_contrast(files, tmp_path):
    levels = cv2.imread(str(files[0] / "photo.tiff"), cv2.IMREAD_UNCHANGED)
    noisy = levels + np.random.default_rng(1).normal(0, 900, SHAPE)
    smooth = cv2.GaussianBlur(noisy, (0, 0), 0.8).clip(0, 65535)
    for picture, reason in ((np.full(SHAPE, 300), "has no contrast"), (smooth, "was processed")):
        cv2.imwrite(str(tmp_path / "picture.tiff"), picture.astype(np.uint16))
        words = "--field", files[0] / "grey.h5", "--out", tmp_path / "out"
        assert reason in correct(tmp_path / "picture.tiff", *words, code=5).output
    assert reason in json.loads((tmp_path / "out" / "result.json").read_text())["reason"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"camera": "Other"}, "camera"),
        ({"lens": "Other"}, "lens"),
        ({"focal_length_mm": 35.0}, "focal length"),
        ({"subject_distance_mm": 1000.0}, "focused at 1.00 m, the photograph at 2.00 m"),
    ],
)
def test_a_field_of_another_setting_is_refused_by_name(change, words):
    with pytest.raises(Refused, match=words):
        check_exposure(CAMERA, replace(CAMERA, **change))


def test_unknown_exposure_data_are_named_and_a_field_names_its_camera(files):
    assert check_exposure(CAMERA, CAMERA) == []
    assert check_exposure(replace(CAMERA, lens=None), CAMERA) == ["lens"]
    assert check_exposure(CAMERA, None) == ["the field does not name its camera"]
    assert read_camera(files[0] / "field.h5") == replace(Exposure(), **{
        name: getattr(CAMERA, name) for name in ("camera", "lens", "f_number", "focal_length_mm", "subject_distance_mm")
    })  # fmt: skip
    assert read_camera(files[0] / "grey.h5") is None


def test_a_typed_aperture_stands_for_a_lens_without_contacts_unless_the_far_tail_contradicts_it(files):
    camera, covariance = FieldCamera(), 1e-8 * np.eye(K * K + 6)
    measured = nodes(camera, grid(3, 3, 0.2), covariance, np.random.default_rng(1))
    fields = {"G1": interpolate("G1", FIELD_SHAPE, measured).field}
    photo = replace(files[1].frame, exposure=Exposure(camera="Bench One"))
    of_field = Exposure(camera="Bench One", f_number=None)
    unknown = ["lens", "aperture", "focal length", "focus distance"]

    def left(f_number, field=of_field):
        return unknown_with_typed(unknown, TypedAperture(f_number, camera.pitch_um / 2), fields, photo, field)

    assert left(camera.lens.f_number) == []
    with pytest.raises(Refused, match="far tail is that of f/3"):
        left(8.0)
    with pytest.raises(Refused, match="aperture is f/5"):
        left(2.8, replace(of_field, f_number=5.6))


def test_photographs_moved_by_parts_of_a_pixel_make_a_picture_of_twice_as_many(files, tmp_path):
    whole = (1, 2 * SHAPE[0] + 2 * RIM, 2 * SHAPE[1] + 2 * RIM)
    lens, moves = SmallLens(SHAPE, 0.8), [(0, 0), (0.4, -1.6), (1.5, 0.5), (-0.9, 0.1)]
    frames = burst({"Y": lens}, scene(whole[1:], seed=2), moves, Sensor(white_e=60000.0))
    for number, frame in enumerate(frames):
        samples = np.rint(65535 * frame.planes["Y"].samples.clip(0, 1)).astype(np.uint16)
        cv2.imwrite(str(tmp_path / f"{number}.tiff"), samples)
    paths = [tmp_path / f"{number}.tiff" for number in range(4)]
    result = correct(*paths, "--field", files[0] / "grey.h5", "--scale", 2, "--out", tmp_path / "out", "--json")
    record = json.loads(result.stdout)
    assert [one["path"] for one in record["input"]] == [str(path) for path in (*paths, files[0] / "grey.h5")]
    assert (record["scale"], record["detail_resolved"]) == (2, 0.75)
    moves_px = [one["moved_px"] for one in record["further_photographs"]]
    np.testing.assert_allclose(moves_px, moves[1:], atol=0.05)
    assert stored(tmp_path / "out", (1, 2 * SHAPE[0], 2 * SHAPE[1])).mean() == pytest.approx(0.4, abs=0.1)
    assert "2 pixels of the picture per pixel" in (tmp_path / "out" / "report.html").read_text()
