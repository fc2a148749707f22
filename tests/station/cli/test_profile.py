import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from drivers.dng import Shot, write_dng
from procedures.field.field_file import read_camera, write_field
from procedures.outcome import BadInput
from procedures.raw import Exposure
from station.calibration.profiles import find_profiles, profile_for
from tests.procedures.correction.small_lens import NOTED, SmallLens
from tests.program import run

WIDE = replace(NOTED, f_number=8.0)
CLOSE = replace(NOTED, subject_distance_mm=500.0)


profile = partial(run, "profile")


@pytest.fixture(scope="module")
def fields(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fields")
    field = {"Y": SmallLens((40, 56), 0.6).field("Y")}
    for name, exposure in {
        "usual": NOTED,
        "wide": WIDE,
        "close": CLOSE,
        "adapted": Exposure(camera="Bench One"),
    }.items():
        write_field(folder / f"{name}.h5", field, {}, [], {}, exposure)
    return folder


@pytest.fixture
def library(tmp_path, fields, monkeypatch):
    monkeypatch.setenv("STATION_PROFILES", str(tmp_path / "library"))
    for name in ("usual", "wide", "close"):
        profile("add", fields / f"{name}.h5")
    return tmp_path / "library"


def test_a_field_is_found_by_the_settings_of_a_photograph(library, tmp_path):
    shot = Shot(f_number=8.0, focal_length_mm=50.0, subject_distance_mm=2000.0, make="Bench", model="One",
                lens="Bench 50mm")  # fmt: skip
    write_dng(
        tmp_path / "photo.dng", np.full((64, 64), 4000, np.uint16), shot, cfa="RGGB", black=(512,) * 4, white=15512
    )
    found = json.loads(profile("find", tmp_path / "photo.dng", "--json").stdout)["profiles"]
    assert [one["f_number"] for one in found] == [8.0]
    assert found[0]["path"] == str(library / "Bench-One_Bench-50mm_f8_50mm_2m.h5")
    assert found[0]["not_compared"] == []


def test_settings_that_are_not_given_are_reported_as_not_compared(library):
    done = profile("find", "--camera", "Bench One", "--lens", "Bench 50mm", "--f-number", 2.8)
    assert done.stdout.count("f2.8") == 2  # focused at 2 m and at 0.5 m
    assert "focal length, focus distance" in done.stdout


def test_settings_without_a_field_are_refused_with_the_nearest_reason(library):
    with pytest.raises(BadInput, match=r"no field for these settings; .*the field's aperture is f/2.8, .* f/4"):
        find_profiles(replace(CLOSE, f_number=4.0), library)
    assert profile_for(CLOSE) == library / "Bench-One_Bench-50mm_f2.8_50mm_0.5m.h5"


def test_an_adapted_lens_is_named_by_hand(library, fields):
    refused = profile("add", fields / "adapted.h5", code=2, says="does not record its lens, f-number")
    assert "give --lens, --f-number" in refused.output
    profile("add", fields / "adapted.h5", "--lens", "Old 58mm", "--f-number", 2)
    kept = read_camera(library / "Bench-One_Old-58mm_f2.h5")
    assert (kept.camera, kept.lens, kept.f_number) == ("Bench One", "Old 58mm", 2.0)
    again = profile("add", fields / "adapted.h5", "--lens", "Old 58mm", "--f-number", 2, code=None)
    assert "give --replace" in again.output
    profile("add", fields / "adapted.h5", "--lens", "Old 58mm", "--f-number", 2, "--replace")


@pytest.mark.parametrize("suffix", [".jpg", ".tiff"])
def test_a_field_is_found_for_a_developed_picture(library, tmp_path, suffix):
    exif = Image.Exif()
    exif[271], exif[272], exif[33437] = "Bench", "One", IFDRational(8)
    Image.new("RGB", (64, 48)).save(tmp_path / f"a{suffix}", exif=exif)
    found = json.loads(profile("find", tmp_path / f"a{suffix}", "--json").stdout)["profiles"]
    assert [one["f_number"] for one in found] == [8.0]


def test_names_in_any_script_are_names_of_their_own(library, fields):
    lenses = "\u5149\u5b66", "\u955c\u5934"
    for lens in lenses:
        profile("add", fields / "adapted.h5", "--lens", lens, "--f-number", 2)
    assert all((library / f"Bench-One_{lens}_f2.h5").exists() for lens in lenses)


def test_an_export_does_not_replace_the_result(fields):
    result = fields / "usual.h5"
    before = result.read_bytes()
    profile("export", result, "--to", "gmic", "--columns", 2, result, code=2, says="must be another file")
    assert result.read_bytes() == before


def test_a_profile_is_exported(library, tmp_path):
    out = tmp_path / "filters.py"
    profile("export", library / "Bench-One_Bench-50mm_f8_50mm_2m.h5", "--to", "python", "--columns", 2, out)
    assert "Bench One, Bench 50mm, f/8" in out.read_text()
