import re
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from procedures.field import field_file
from procedures.field.maps import derive, lateral_colour
from procedures.outcome import BadInput, Outcome
from procedures.reading import hdf5
from procedures.vignetting.surface import LightSurface

from ..correction.small_lens import SmallLens
from .lens import NEAR, SHAPE, FieldCamera, grid, nodes

DOCUMENT = Path(field_file.__file__).parent / "decisions" / "0001-hdf5.md"


@pytest.fixture(scope="module")
def written(covariance, measured, interpolated, tmp_path_factory):
    path = tmp_path_factory.mktemp("field") / "field.h5"
    red = nodes(FieldCamera(period_px=NEAR), grid(), covariance, np.random.default_rng(2), "R")
    colour = lateral_colour("R", red, "G1", measured, SHAPE, 2)
    maps = derive(interpolated.field, 5)
    field_file.write_field(path, {"G1": interpolated}, {"G1": maps}, [colour], {"input": "[]", "software": "1"})
    return path


@pytest.mark.slow
def test_a_field_survives_writing_and_reading(written, interpolated):
    field = field_file.read_field(written)["G1"]
    for x, y in ((120.0, 400.0), (374.5, 249.5)):
        np.testing.assert_allclose(field.at(x, y).parameters, interpolated.field.at(x, y).parameters, atol=1e-6)
        expected = interpolated.field.at(x, y).parameter_covariance
        # covariances are stored in seven digits
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        np.testing.assert_allclose(field.at(x, y).parameter_covariance / scale, expected / scale, atol=1e-3)
    assert field.nodes[3].number == interpolated.field.nodes[3].number


@pytest.mark.slow
def test_the_five_lines_of_the_document_read_the_psf(written, camera, interpolated, monkeypatch):
    code = re.search(r"```python\n(.*?)```", DOCUMENT.read_text(), re.S)[1]
    assert len([line for line in code.splitlines() if line]) == 5
    monkeypatch.chdir(written.parent)
    names: dict = {}
    exec(code, names)
    # the nearest place of the grid, half a step of 12 pixels away at most
    near = interpolated.field.samples(np.array([[names["x"], names["y"]]]))[0]
    assert np.linalg.norm(names["psf"] - near) < 0.02 * np.linalg.norm(near)


@pytest.mark.slow
def test_the_file_alone_gives_the_tail_at_every_place(written, interpolated):
    with h5py.File(written) as file:
        anywhere = file["G1/anywhere"]
        i, j = len(anywhere["y"]) // 2, len(anywhere["x"]) // 3
        tail = anywhere["base_tail"][:] + anywhere["coefficients"][i, j] @ anywhere["components_tail"][:]
        outside = np.tensordot(tail, anywhere["tail_shapes"][:], axes=1)
        share = anywhere["energy_outside_support"][i, j]
        place = anywhere["x"][j], anywhere["y"][i]
        names = list(file["G1"].attrs["tail_shape_names"])
    psf = interpolated.field.at(*place)
    expected = psf.extended()
    side, rim = len(expected), (len(expected) - psf.k) // 2
    expected[rim : side - rim, rim : side - rim] = 0
    np.testing.assert_allclose(outside, expected, atol=1e-7)  # the shapes are float32
    assert share == pytest.approx(psf.energy_outside[0])
    assert names[0] == "1/r^3"
    assert len(names) == len(tail)


@pytest.mark.slow
def test_the_file_has_units_and_conventions_and_older_or_other_files_are_told(written, interpolated, tmp_path):
    old = tmp_path / "field.h5"
    shutil.copy(written, old)
    with h5py.File(old, "r+") as file:
        file.attrs["schema"] = field_file.WITHOUT_TAIL
        for name in ("tail", "tail_covariance", "tail_cross"):
            del file["G1/nodes"][name]
    field = field_file.read_field(old)["G1"]
    assert (field.q, interpolated.field.q) == (0, 6)
    assert field.at(300.0, 200.0).energy_outside[0] == pytest.approx(0, abs=1e-12)
    # the support alone is interpolated: by other components, within the noise
    expected = interpolated.field.at(300.0, 200.0).h
    assert np.linalg.norm(field.at(300.0, 200.0).h - expected) < 0.02 * np.linalg.norm(expected)
    with h5py.File(written) as file:
        assert file.attrs["schema"] == "station/psf-field/2"
        assert "pixel centres at integers" in file.attrs["conventions"]
        without = []
        file.visititems(
            lambda name, item: (
                without.append(name) if isinstance(item, h5py.Dataset) and "unit" not in item.attrs else None
            )
        )
    assert {name.split("/")[-1] for name in without} == {"source", "number"}
    (tmp_path / "a.h5").write_bytes(b"no HDF5")
    with pytest.raises(BadInput, match="cannot be read as HDF5"):
        field_file.read_field(tmp_path / "a.h5")
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file.attrs["schema"] = "other"
    with pytest.raises(BadInput, match="no PSF field"):
        field_file.read_field(tmp_path / "b.h5")


def place(value):
    def spoil(plane):
        plane["nodes/position"][0, 0] = value

    return spoil


def replaced(name, array):
    def spoil(plane):
        del plane[name]
        plane[name] = array

    return spoil


def shortened(name):
    """Without the last node."""
    return lambda plane: replaced(f"nodes/{name}", plane[f"nodes/{name}"][:-1])(plane)


ARRAYS = (
    "psf", "covariance", "tail", "tail_covariance", "tail_cross", "position", "position_covariance", "sensor_position",
    "source", "number",
)  # fmt: skip


def attribute(name, value):
    return lambda plane: plane.attrs.__setitem__(name, value)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (place(1e30), "`position` of /G1/nodes in .* must be finite, from -1e.06 to 1e.06"),
        (place(np.nan), "`position` of /G1/nodes in .* must be finite"),
        (replaced("nodes/position", np.zeros((4, 3))), r"`position` .* must be an array \(any, 2\)"),
        (replaced("nodes/psf", np.ones((4, 9))), r"`psf` .* must be an array \(any, k, k\)"),
        (replaced("nodes/covariance", np.ones((4, 4))), r"`covariance` .* must be an array"),
        (attribute("rows", -3), "`rows` of /G1 in .* must be finite, from 1"),
        (attribute("columns", "many"), "`columns` of /G1 in .* must be real numbers"),
        (attribute("samples_per_pixel", 0), "`samples_per_pixel` of /G1 in .* must be finite, from 1"),
        *((shortened(name), "field.h5|HDF5|must") for name in ARRAYS),
    ],
)
def test_a_field_of_other_arrays_is_refused(written, tmp_path, monkeypatch, spoil, words):
    monkeypatch.setattr(hdf5, "check_ends", lambda path, largest: None)  # it takes a second
    shutil.copy(written, tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        spoil(file["G1"])
    with pytest.raises(BadInput, match=words):
        field_file.read_field(tmp_path / "a.h5")


@pytest.mark.parametrize("lens", [SmallLens((60, 80)), SmallLens((60, 80), growth=0.0, coma=0.0)])
def test_what_was_read_is_written_again_the_same(lens, tmp_path):
    field_file.write_field(tmp_path / "a.h5", {"Y": lens.field("Y").field})
    again = field_file.read_field(tmp_path / "a.h5")
    field_file.write_field(tmp_path / "b.h5", again)
    twice = field_file.read_field(tmp_path / "b.h5")["Y"]
    np.testing.assert_array_equal(twice.at(10.0, 12.0).parameters, again["Y"].at(10.0, 12.0).parameters)
    assert twice.model.name == again["Y"].model.name


def test_an_outcome_is_no_field_and_vignetting_belongs_to_a_plane_of_its_size(tmp_path):
    with pytest.raises(TypeError, match=r"outcome.result\(\)"):
        field_file.write_field(tmp_path / "a.h5", {"Y": Outcome(SmallLens((60, 80)).field("Y").field)})
    path, slope = tmp_path / "a.h5", np.array([0.1, 0.0])
    field_file.write_field(path, {"Y": SmallLens((60, 80)).field("Y").field})
    with pytest.raises(BadInput, match="size of the field, 80 x 60 pixels; got 80 x 61"):
        field_file.add_lights(path, {"Y": LightSurface((61, 80), 1, slope)})
    # a plane without a field has any size
    field_file.add_lights(path, {"Y": LightSurface((60, 80), 1, slope), "R": LightSurface((30, 40), 1, slope)})
    assert {name: light.shape for name, light in field_file.read_lights(path).items()} == {"Y": (60, 80), "R": (30, 40)}
