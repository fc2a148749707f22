"""The manifest of a sensor's pictures in its formats, and invalid ones."""

import os

import numpy as np
import pytest

from drivers.dng import Shot, write_dng
from procedures.outcome import BadInput
from station.calibration.sensor_folder import find_shots


@pytest.fixture
def folder(tmp_path):
    for name in ("d1.png", "d2.png", "a1.png", "a2.png"):
        (tmp_path / name).touch()
    return tmp_path


SENSOR = {"cfa": "RGGB", "black": (0,) * 4, "white": 4095}
CSV = """\
file,kind,exposure_s,photons
d1.png,dark,0.01,
d2.png,dark,0.01,
a1.png,light,0.01,1500
a2.png,light,0.01,1500
"""
TOML = """
[[level]]
kind = "dark"
exposure_s = 0.01
files = ["d1.png", "d2.png"]
[[level]]
kind = "light"
exposure_s = 0.01
photons = 1500
files = ["a1.png", "a2.png"]
"""
DESCRIPTOR = "v 4.0\nn 12 8 8\nb 10000000 1500,0\ni a1.png\ni a2.png\nd 10000000\ni d1.png\ni .\\d2.png\n"


# as the public data sets are: comments before the first line and between lines, no version
COMMENTED = "#####\r\n# Release 3.0\r\n\r\n" + DESCRIPTOR.split("\n", 1)[1].replace("d 1", "# dark pictures\r\nd 1")


@pytest.mark.parametrize(
    ("name", "text"), [("sensor.csv", CSV), ("sensor.toml", TOML), ("set.txt", DESCRIPTOR), ("set.txt", COMMENTED)]
)
def test_every_format_gives_the_same(folder, name, text):
    (folder / name).write_text(text)
    dark, light = find_shots(folder)
    assert (dark.kind, dark.level, [p.name for p in dark.paths]) == ("dark", 0.0, ["d1.png", "d2.png"])
    assert (light.kind, light.photons, [p.name for p in light.paths]) == ("light", 1500.0, ["a1.png", "a2.png"])
    assert (dark.exposure_s, light.exposure_s) == pytest.approx((0.01, 0.01))


def test_a_descriptor_separates_stacks_from_the_ladder(folder):
    (folder / "set.txt").write_text(DESCRIPTOR + "b 10000000 1400\ni a1.png\ni a2.png\ni a1.png\n")
    assert [(one.level, one.only_stack) for one in find_shots(folder)] == [(0, False), (1400, True), (1500, False)]


def test_another_text_is_no_descriptor(folder):
    (folder / "notes.txt").write_text("# notes\nb is the bright picture\n")
    with pytest.raises(BadInput, match="neither a manifest"):
        find_shots(folder)


def test_the_exposure_is_the_light_by_default(folder):
    (folder / "sensor.csv").write_text("file,kind,exposure_s\na1.png,light,0.5\n")
    assert find_shots(folder)[0].level == 0.5


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("sensor.csv", CSV.replace("dark", "grey"), "kind must be"),
        ("sensor.csv", CSV.replace("0.01", "soon"), "exposure_s must be a number"),
        ("sensor.csv", CSV.replace(",0.01,\n", ",,\n"), "exposure_s is missing"),
        ("sensor.csv", CSV.replace("d1.png", "x1.png"), "do not exist, first"),
        ("sensor.csv", CSV.replace(",1500\na2", ",\na2"), "the same measure of light"),
        ("sensor.csv", "name,kind\n", "must have the columns"),
        ("sensor.toml", "level = 3", "must contain"),
        ("sensor.toml", "level =", "is not valid TOML"),
        ("sensor.toml", TOML.replace('["d1.png", "d2.png"]', "[]"), "needs its files"),
        ("sensor.toml", TOML.replace('["d1.png", "d2.png"]', "5"), "needs its files"),
        ("sensor.toml", "x = " + "[" * 100_000, "RecursionError"),
        ("sensor.csv", CSV.replace("d1.png", "9" * 5000), "do not exist, first"),
        ("sensor.csv", CSV.replace("d1.png", "a\0b"), "do not exist, first"),
        ("sensor.csv", CSV.replace("0.01", "nan"), "exposure_s must be a number"),
        ("sensor.csv", '"' + "a" * 200_000, "field larger than"),
        ("set.txt", "v 4.0\nq 1\ni a1.png", "must be a line of an EMVA 1288 descriptor"),
        ("set.txt", "v 4.0\nb nan 1500\n", "must be a line of an EMVA 1288 descriptor"),
        ("set.txt", "v 4.0\nd -3\n", "must be a line of an EMVA 1288 descriptor"),
    ],
)
def test_an_invalid_manifest_is_refused(folder, name, text, words):
    (folder / name).write_text(text)
    with pytest.raises(BadInput, match=words):
        find_shots(folder)


def test_folder_without_manifest_is_refused(folder):
    with pytest.raises(BadInput, match="neither a manifest"):
        find_shots(folder)


def test_a_picture_without_exposure_time_is_named_and_excluded(tmp_path):
    for kind in ("dark", "light"):
        (tmp_path / kind).mkdir()
        for name in ("a.dng", "b.dng"):
            write_dng(tmp_path / kind / name, np.zeros((4, 4), np.uint16), Shot(exposure_s=0.5), **SENSOR)
    (tmp_path / "light" / "b.dng").write_bytes(b"no picture")
    missed = []
    shots = find_shots(tmp_path, missed.append)
    assert [(one.kind, one.exposure_s, len(one.paths)) for one in shots] == [("dark", 0.5, 2), ("light", 0.5, 1)]
    assert [miss.source for miss in missed] == [str(tmp_path / "light" / "b.dng")]
    with pytest.raises(BadInput, match=r"b\.dng"):
        find_shots(tmp_path)


def test_file_is_no_folder(folder):
    with pytest.raises(BadInput, match="is no folder"):
        find_shots(folder / "a1.png")


def test_a_pipe_among_the_pictures_is_not_waited_for(folder):
    os.mkfifo(folder / "a.txt")
    (folder / "set.txt").write_text(DESCRIPTOR)
    assert [one.kind for one in find_shots(folder)] == ["dark", "light"]
