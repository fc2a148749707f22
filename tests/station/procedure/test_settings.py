"""Settings as one model: read from TOML with the key, the value and what it must be; drawn as options."""

from pathlib import Path
from typing import Annotated, Literal

import pytest

from procedures.outcome import BadParameter
from station.common.models import TableSource, fields_of, read_model
from station.procedure.base import Settings, named_files, setting, to_record
from station.procedure.psf import ChartPsfSettings, PsfSettings
from station.procedure.schema import BUILTIN, procedure_named


class Model(Settings, frozen=True, kw_only=True):
    width_mm: Annotated[float, setting("Width of the chart.", least=1)] = 300.0
    count: Annotated[int, setting("Photographs.", least=1, most=9)] = 3
    positions: Annotated[Literal["lens", "set"], setting("What they mean.")] = "lens"
    distances_mm: tuple[Annotated[float, setting("Distances.", least=1)], ...] = ()
    table: Annotated[Path, setting("A table.")] | None = None
    pitch_um: Annotated[float, setting("Pitch.", least=0.1)] | None = None
    insist: Annotated[bool, setting("Insist.")] = False
    tile_px: Annotated[Literal[128, 256], setting("Side of a tile.")] | None = None
    side: Annotated[int, setting("Samples.", least=3)] | Literal["auto"] = "auto"


class Required(Settings, frozen=True, kw_only=True):
    radius_mm: Annotated[float, setting("Radius of the screws' circle.")]


@pytest.mark.parametrize("name", BUILTIN)
def test_settings_of_every_procedure_are_constant_and_given_by_name(name):
    models = [one for one in procedure_named(name).Settings.__mro__ if issubclass(one, Settings)]
    for model in models:
        assert model.__struct_config__.frozen
        assert model.__struct_config__.forbid_unknown_fields
        with pytest.raises(TypeError, match="positional"):
            model(None)


def test_a_table_becomes_the_model():
    table = {"width_mm": 200, "distances_mm": [100, 200.5], "table": "a.csv", "positions": "set"}
    found = read_model(Model, table, TableSource())
    assert found == Model(width_mm=200.0, distances_mm=(100.0, 200.5), table=Path("a.csv"), positions="set")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"widht_mm": 3}, r"widht_mm is not known; write width_mm"),
        ({"nothing": 3}, r"nothing is not known; use one of count, distances_mm"),
        ({"width_mm": "wide"}, r"settings\.width_mm must be a number at least 1; it is .wide."),
        ({"width_mm": 0.5}, r"width_mm must be a number at least 1; it is 0\.5"),
        ({"count": 10}, r"count must be a whole number from 1 to 9; it is 10"),
        ({"count": 2.5}, "count must be a whole number"),
        ({"positions": "chart"}, "positions must be one of lens, set; it is .chart."),
        ({"distances_mm": [1, "far"]}, "distances_mm must be a list, each a number at least 1"),
        ({"distances_mm": [1, 0.5]}, "distances_mm must be a list, each a number at least 1"),
        ({"side": 2.5}, r'side must be a whole number at least 3 or "auto"; it is 2\.5'),
        ({"side": "wide"}, r'side must be a whole number at least 3 or "auto"; it is .wide'),
        ({"insist": 1}, "insist must be true or false"),
        ({"tile_px": 100}, "tile_px must be one of 128, 256; it is 100"),
        ({"table": 4}, "table must be a path"),
        ({"pitch_um": 0}, r"pitch_um must be a number at least 0\.1; it is 0"),
    ],
)
def test_what_cannot_be_is_named_with_the_key_and_what_it_must_be(given, words):
    with pytest.raises(BadParameter, match=words):
        read_model(Model, given, TableSource(places={name: ("settings", name) for name in given}))


def test_settings_have_descriptions_for_options_and_records():
    with pytest.raises(BadParameter, match="radius_mm is missing; give it: Radius of the screws' circle"):
        read_model(Required, {}, TableSource())
    by_name = {one.name: one for one in fields_of(Model)}
    assert (by_name["width_mm"].kind, by_name["width_mm"].least, by_name["width_mm"].default) == (float, 1, 300.0)
    assert by_name["positions"].choices == ("lens", "set")
    assert (by_name["tile_px"].kind, by_name["tile_px"].choices) == (int, ("128", "256"))
    assert by_name["distances_mm"].several
    assert by_name["distances_mm"].option == "--distances-mm"
    assert by_name["table"].kind is Path
    assert (by_name["side"].kind, by_name["side"].word, by_name["side"].choices) == (int, "auto", ())
    assert fields_of(Required)[0].required
    assert to_record(Model(table=Path("a/b.csv"))) == {
        "width_mm": 300.0, "count": 3, "positions": "lens", "distances_mm": (), "table": "a/b.csv", "insist": False,
        "side": "auto",
    }  # fmt: skip


def test_files_lie_beside_the_procedure_where_they_are_there(tmp_path):
    (tmp_path / "a.csv").touch()
    assert Model(table=Path("a.csv")).placed(tmp_path).table == tmp_path / "a.csv"
    assert Model(table=Path("b.csv")).placed(tmp_path).table == Path("b.csv")
    assert named_files(Model(table=Path("b.csv"))) == [Path("b.csv")]


def test_what_was_stated_of_the_optics_stands_in_the_record():
    assert PsfSettings().given() == {}
    stated = PsfSettings(raw="8x6,RGGB,u16le,64,1023", f_number=8.0, pixel_pitch_um=4.0, trust_typed=True)
    assert stated.given() == {"pixel_pitch_um": 4.0, "f_number": 8.0, "raw": str(stated.layout), "trust_typed": True}
    assert PsfSettings(s=4).sampling() == {"s": 4, "k": None, "solver": "ls"}
    assert ChartPsfSettings(k=13, print_blur=0.3).sampling() == {"s": None, "k": 13, "solver": "ls", "print_blur": 0.3}
