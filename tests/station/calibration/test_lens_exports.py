"""Distortion, lateral colour and vignetting for lensfun and as a DNG's opcodes, undone as these would undo them."""

import json
import struct
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import rawpy
from scipy.ndimage import map_coordinates

from drivers.dng import Shot, write_dng
from procedures import BadInput, BadParameter, read_frame
from procedures.field.maps import LateralColour
from procedures.field.surfaces import fit_surface
from procedures.geometry.cameras import CameraModel
from procedures.geometry.conversion import as_radial
from procedures.psf_field import in_half_diagonals
from procedures.reading.dng_opcodes import OPCODE_LIST_2, fix_vignette_radial, with_opcodes
from procedures.vignetting.surface import LightSurface
from station.calibration.exports.dng import export_dng, farthest
from station.calibration.exports.lensfun import GivenNames, LensNames, best_radial, export_lensfun, unit_px
from station.calibration.stored_cameras import StoredCamera
from station.calibration.vignetting import StoredVignetting
from tests.program import run
from tests.station.calibration.opcodes import doubles_of, gain_map, opcodes_in

COLUMNS, ROWS = 600, 400
CAMERA = CameraModel("OPENCV", np.array([900.0, 900, 306.0, 195.0, -0.10, 0.02, 0.0, 0.0]), COLUMNS, ROWS)
DECENTRED = CameraModel("OPENCV", np.array([900.0, 900, 306.0, 195.0, -0.10, 0.02, 8e-4, -5e-4]), COLUMNS, ROWS)
REGION = np.array([[0.0, 0], [COLUMNS - 1, 0], [COLUMNS - 1, ROWS - 1], [0, ROWS - 1]])
NAMES = LensNames("Made", "Made 50", "Made One", 50.0, 2.8, 55.5)
PLANE = (ROWS // 2, COLUMNS // 2)
# log light is -0.35 times the squared distance, in half diagonals of 180 pixels, from (0.02, -0.015) / 0.7
CENTRE = (149.5 + 0.02 / 0.7 * np.hypot(150, 100), 99.5 - 0.015 / 0.7 * np.hypot(150, 100))
LIGHT = LightSurface(PLANE, 2, np.array([0.02, -0.015, -0.35, 0.0, -0.35]))


def stored(camera: CameraModel = CAMERA) -> StoredCamera:
    return StoredCamera(camera, REGION, "")


def lateral(plane: str, stretch: float) -> LateralColour:
    x, y = np.meshgrid(np.linspace(20, PLANE[1] - 20, 5), np.linspace(20, PLANE[0] - 20, 4))
    positions = np.column_stack([x.ravel(), y.ravel()])
    away = (2 * positions - [306.0, 195.0]) / unit_px(COLUMNS, ROWS)
    shift = away * (stretch + 0.4 * stretch * np.sum(away**2, axis=1))[:, None]
    covariance = np.tile(1e-6 * np.eye(2), (len(positions), 1, 1))
    surface = fit_surface(in_half_diagonals(positions, PLANE), shift, covariance, (3,))
    return LateralColour(plane, "G1", PLANE, positions, shift, covariance, surface)


COLOURS = {"R": lateral("R", 0.3), "B": lateral("B", -0.2)}


def test_the_entry_of_lensfun_has_what_its_schema_asks_for():
    # the centre is fitted with it, which takes most of p1 and p2 at a distance
    plain, decentred = best_radial(stored()), best_radial(stored(DECENTRED))
    assert plain.difference.rms_px < 0.02
    assert 0.02 < decentred.difference.rms_px < decentred.difference.max_px < 1
    made = export_lensfun(stored(), NAMES, COLOURS, LIGHT)
    top = ElementTree.fromstring(made.data)
    lens = top.find("lens")
    assert [one.tag for one in lens.find("calibration")] == ["distortion", "tca", "vignetting", "vignetting"]
    assert float(lens.find("cropfactor").text) == pytest.approx(43.2666 / (np.hypot(600, 400) * 0.0555), rel=1e-5)
    assert [one.split(":")[0] for one in made.lost[-3:]] == [
        "lateral colour of R", "lateral colour of B", "vignetting",
    ]  # fmt: skip


def lensfun_modifier(text: str, **wanted):
    lensfunpy = pytest.importorskip("lensfunpy", reason="lensfunpy reads these files")
    database = lensfunpy.Database(xml=text, load_common=False, load_bundled=False)
    (lens,), (camera,) = database.lenses, database.cameras
    modifier = lensfunpy.Modifier(lens, camera.crop_factor, COLUMNS, ROWS)
    modifier.initialize(50.0, 2.8, 10.0, 1.0, pixel_format=np.float32)
    return modifier


def test_lensfun_corrects_distortion_colour_and_vignetting_within_the_stated_errors():
    made = export_lensfun(stored(), NAMES)
    seen = lensfun_modifier(made.data).apply_geometry_distortion()
    estimate = best_radial(stored())
    y, x = np.mgrid[40:360:40, 40:560:40]
    points = np.column_stack([x.ravel(), y.ravel()]).astype(float)
    # rays of the corrected picture's pixels, seen by the camera itself; lensfun computes in float32
    rays = np.column_stack([(points - estimate.centre) / estimate.focal_px, np.ones(len(points))])
    true = CAMERA.project(rays)
    inside = ((true > 0) & (true < [COLUMNS - 1, ROWS - 1])).all(axis=1)
    error = np.linalg.norm(seen[y.ravel(), x.ravel()] - true, axis=1)[inside]
    assert error.max() < estimate.difference.max_px + 2e-3
    made = export_lensfun(stored(), NAMES, COLOURS)
    seen = lensfun_modifier(made.data).apply_subpixel_distortion()
    for channel, plane in ((0, "R"), (2, "B")):
        places = np.round(2 * COLOURS[plane].positions).astype(int)
        moved = seen[places[:, 1], places[:, 0], channel] - places
        true, _ = COLOURS[plane].at(places / 2)
        assert np.sqrt(np.mean(np.sum((moved - true) ** 2, axis=1))) < 0.05
    made = export_lensfun(stored(), NAMES, None, LIGHT)
    y, x = np.mgrid[:ROWS, :COLUMNS]
    places = np.column_stack([x.ravel(), y.ravel()])
    picture = np.repeat(0.5 * LIGHT.at(places / 2).reshape(ROWS, COLUMNS, 1), 3, axis=2).astype(np.float32)
    assert lensfun_modifier(made.data).apply_color_modification(picture)
    rms = float(made.lost[-1].split(" rms, ")[1].split("%")[0]) / 100
    assert np.ptp(picture[..., 1]) / picture[..., 1].mean() < 2 * rms + 1e-3


def test_a_lens_without_focal_length_requires_it():
    with pytest.raises(BadParameter, match="focal length in mm"):
        GivenNames("", None, None, None, None, None).completed(None, 900.0, with_light=False)
    names = GivenNames("", None, None, None, None, 5.0).completed(None, 900.0, with_light=False)
    assert names.focal_mm == pytest.approx(4.5)


@pytest.fixture(scope="module")
def photo(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("dng") / "photo.dng"
    mosaic = np.random.default_rng(4).integers(600, 9000, (ROWS, COLUMNS)).astype(np.uint16)
    write_dng(path, mosaic, Shot(), cfa="RGGB", black=(512, 512, 512, 512), white=16383)
    return path


def test_the_copy_is_the_same_photograph_with_opcodes(photo, tmp_path):
    light = StoredVignetting("G1", LIGHT, CENTRE)
    made = export_dng(photo.read_bytes(), photo.name, stored(DECENTRED), light, (COLUMNS, ROWS))
    copy = tmp_path / "copy.dng"
    copy.write_bytes(made.data)
    with rawpy.imread(str(photo)) as before, rawpy.imread(str(copy)) as after:
        np.testing.assert_array_equal(before.raw_image, after.raw_image)
    one, two = read_frame(photo), read_frame(copy)
    np.testing.assert_array_equal(one.planes["G1"].samples, two.planes["G1"].samples)
    assert one.exposure == two.exposure
    assert [opcode.number for opcode in opcodes_in(made.data)] == [3, 1]
    assert len(made.lost) == 2


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("before", "after"), [((1, 1, 0, 0), (1, 3, 0, 0)), ((1, 4, 0, 0), (1, 4, 0, 0))])
def test_a_reader_must_know_the_opcodes(order, before, after):
    tags = [(254, 4, 1, struct.pack(order + "I", 0)), (262, 3, 1, struct.pack(order + "HH", 32803, 0)),
            (50706, 1, 4, bytes((1, 4, 0, 0))), (50707, 1, 4, bytes(before))]  # fmt: skip
    head = (b"II" if order == "<" else b"MM") + struct.pack(order + "HIH", 42, 8, len(tags))
    data = head + b"".join(struct.pack(order + "HHI", *one[:3]) + one[3] for one in tags) + bytes(4)
    made = with_opcodes(data, [fix_vignette_radial((0.0,) * 5, (0.5, 0.5))], "photo")
    assert struct.pack(order + "HHI", 50707, 1, 4) + bytes(after) in made


def test_the_warp_goes_where_the_camera_sees(photo):
    made = export_dng(photo.read_bytes(), "photo", stored(DECENTRED), None, (COLUMNS, ROWS))
    kr, kt, centre = np.split(np.array(doubles_of(opcodes_in(made.data)[0])), [4, 6])
    middle = centre * [COLUMNS - 1, ROWS - 1]
    m = farthest(middle, (COLUMNS, ROWS))
    focal = as_radial(DECENTRED, REGION, "even", min(COLUMNS, ROWS) / 2, decentring=True).focal_px
    rays = DECENTRED.rays(DECENTRED.frame_grid(7, 5))
    x, y = (rays[:, :2] * focal / m).T
    r2 = x * x + y * y
    # the specification's formula
    radial = kr[0] + kr[1] * r2 + kr[2] * r2**2 + kr[3] * r2**3
    u = x * radial + kt[1] * (r2 + 2 * x * x) + 2 * kt[0] * x * y
    v = y * radial + kt[0] * (r2 + 2 * y * y) + 2 * kt[1] * x * y
    error = np.column_stack([u, v]) * m + middle - DECENTRED.frame_grid(7, 5)
    assert np.abs(error).max() < 0.01


def test_the_gain_of_the_opcode_is_one_over_the_light(photo):
    light = StoredVignetting("G1", LIGHT, CENTRE)
    made = export_dng(photo.read_bytes(), "photo", None, light, (COLUMNS, ROWS))
    *k, cx, cy = doubles_of(opcodes_in(made.data)[0])
    middle = np.array([cx * (COLUMNS - 1), cy * (ROWS - 1)])
    points = CAMERA.frame_grid(9, 7)
    r = np.linalg.norm(points - middle, axis=1) / farthest(middle, (COLUMNS, ROWS))
    gain = 1 + sum(one * r ** (2 * i + 2) for i, one in enumerate(k))
    even = gain * LIGHT.at(points / 2)
    assert np.ptp(even) / even.mean() < 1e-4  # a Gaussian by five even powers


def test_gain_maps_make_every_plane_of_the_mosaic_even(photo, tmp_path):
    # red falls off by another law: the map holds colour shading, which one radial formula cannot
    red = LightSurface(PLANE, 2, np.array([0.05, 0.0, -0.5, 0.1, -0.4]))
    lights = {"R": (StoredVignetting("R", red, CENTRE), (0, 0)), "G1": (StoredVignetting("G1", LIGHT, CENTRE), (1, 0))}
    made = export_dng(photo.read_bytes(), "photo", None, None, (COLUMNS, ROWS), lights)
    (tmp_path / "copy.dng").write_bytes(made.data)
    with rawpy.imread(str(photo)) as before, rawpy.imread(str(tmp_path / "copy.dng")) as after:
        np.testing.assert_array_equal(before.raw_image, after.raw_image)
    opcodes = opcodes_in(made.data, OPCODE_LIST_2)
    assert [one.number for one in opcodes] == [9, 9]
    for opcode, (stored_light, origin) in zip(opcodes, lights.values(), strict=True):
        stored_map = gain_map(opcode)
        assert (stored_map.origin, stored_map.pitch, stored_map.size) == (origin, 2, (COLUMNS, ROWS))
        y, x = np.mgrid[origin[1] : ROWS : 38, origin[0] : COLUMNS : 38].reshape(2, -1).astype(float)
        # as the specification's reader: centres at (i + 1/2) / n, bilinear between the points
        at = np.stack([(y + 0.5) / ROWS, (x + 0.5) / COLUMNS]) * (np.array(stored_map.gains.shape)[:, None] - 1)
        gain = map_coordinates(stored_map.gains, at, order=1)
        even = gain * stored_light.light.at((np.column_stack([x, y]) - origin) / 2)
        assert np.abs(even - 1).max() < 5e-4  # 41 points a side, the curvature of the light between them


def test_opcodes_take_the_place_of_those_that_were_there(photo):
    once = export_dng(photo.read_bytes(), "photo", stored(), None, (COLUMNS, ROWS)).data
    twice = export_dng(once, "photo", stored(DECENTRED), None, (COLUMNS, ROWS)).data
    assert len(opcodes_in(twice)) == 1


@pytest.mark.parametrize(
    ("data", "words"), [(b"P5\n4 4\n255\n", "not a DNG"), (b"II*\0\xff\xff\0\0", "truncated within")]
)
def test_what_is_no_dng_is_refused(data, words):
    with pytest.raises(BadInput, match=words):
        with_opcodes(data, [], "photo")


def test_a_photograph_of_another_size_is_refused(photo):
    with pytest.raises(BadParameter, match="600 x 402"):
        export_dng(photo.read_bytes(), "photo", stored(), None, (COLUMNS, ROWS + 2))


@pytest.mark.slow
def test_the_commands_measure_flats_and_export(photo, tmp_path):
    y, x = np.mgrid[:ROWS, :COLUMNS]
    light = 1 - 0.3 * ((x - 300) ** 2 + (y - 200) ** 2) / (300**2 + 200**2)
    for i in (1, 2):
        mosaic = np.random.default_rng(i).poisson(512 + 7000 * light).astype(np.uint16)
        write_dng(tmp_path / f"flat{i}.dng", mosaic, Shot(), cfa="RGGB", black=(512,) * 4, white=16383)
    run("vignetting", tmp_path / "flat1.dng", tmp_path / "flat2.dng", "--out", tmp_path / "v")
    entry = json.loads((tmp_path / "v" / "result.json").read_text())["planes"]["G1"]
    assert entry["corner_light"]["value"] == pytest.approx(0.7, abs=5 * entry["corner_light"]["uncertainty"] + 0.003)
    copy = tmp_path / "copy.dng"
    run("export", tmp_path / "v", "--to", "dng", "--photo", photo, copy)
    assert [one.number for one in opcodes_in(copy.read_bytes())] == [3]
    words = ["export", str(tmp_path / "v"), "--to", "dng", "--photo", str(photo), "--gain-map", str(copy)]
    run(*words)
    assert [one.number for one in opcodes_in(copy.read_bytes(), OPCODE_LIST_2)] == [9, 9, 9, 9]
    run("export", tmp_path / "v", "--to", "dng", copy, code=2)
