"""A batch's procedure file: what to measure, with which settings, and the limits of the results.

```toml
procedure = "pattern"               # or any other procedure
specification = "lens.toml"         # beside this file; or the same [limits] and [[limit]] here
unit = "cycles/pixel"               # of every frequency, here and in the results; or "lp/mm", "lw/ph"
at = [0.25]                         # further frequencies of the MTF
coverage = 2                        # guard bands of the limits in here, in standard uncertainties
pairs = { near = "_near", far = "_far" }      # how names of a pair end; or { table = "pairs.csv" }

[settings]                          # the options of the command, by name; [parameters] is the same
sensor = "result.json"              # beside this file

[limits]
mtf50_horizontal = { min = 0.25 }
energy_above_nyquist = { max = 0.05, planes = ["G1", "G2"] }
```

Settings may also be given outside [settings], where the procedure has them:

```toml
planes = ["G1"]                     # or ["all"]; by default G1 of a RAW file, Y of a grey image
chart = { seed = 1 }                # or bits = "cells.pgm", beside this file
optics = { pixel_pitch_um = 3.76, f_number = 8, wavelength_nm = 530 }
physics = false
trust_typed = false                 # true: the optics take precedence over what the cameras recorded in their files
raw = "1920x1080,RGGB,u16le,64,1023"
```
"""

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field, make_dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from station.common.models import TableSource, fields_of, name_of, one_of, read_model, read_value
from station.common.toml_text import KeyPath, toml_value
from station.procedure.base import Inputs, Procedure, Settings, to_record
from station.procedure.schema import procedure_named, procedure_names
from station.results.specification_file import PLANES, FrequencyValue, SpecificationTable, read_specification
from station.results.terms import USUAL, Terms
from station.results.units import Frequency, Unit

USUAL_PROCEDURE = "pattern"
IN_PAIRS = (Inputs.PAIR, Inputs.SCENE, Inputs.RESULTS)
"""Inputs that belong together by their names, or by a row of a table."""
TABLES: Mapping[str, tuple[str, ...]] = {
    "chart": ("bits", "seed"),
    "optics": ("pixel_pitch_um", "f_number", "wavelength_nm"),
}
"""Tables of settings, for procedures that have all of them."""
AT_THE_TOP = ("physics", "trust_typed", "raw")
"""Settings outside any table."""
ALL = "all"
PlaneName = Annotated[str, one_of(lambda: (*PLANES, ALL))]


@dataclass(frozen=True, eq=False)
class BatchProcedure:
    """A procedure with its settings.

    terms : unit of frequencies, further frequencies, and specification
    endings : how the names of a pair's photographs end
    pairs : a table whose rows name the photographs of an item, in place of endings
    """

    procedure: Procedure[Any]
    settings: Settings
    terms: Terms = USUAL
    endings: tuple[str, str] = ("", "")
    pairs: Path | None = None

    @property
    def name(self) -> str:
        return self.procedure.name

    def parameters(self) -> dict[str, Any]:
        """Settings and unit as plain data."""
        return {**to_record(self.settings), **self.terms.parameters()}

    def fingerprint(self) -> dict[str, Any]:
        """All that a result depends on besides its files, as plain data."""
        at = [one.value for one in self.terms.at]
        limits = {name: value for name, value in self.terms.specification.to_record().items() if name != "path"}
        return {"procedure": self.name, "specification": limits, "at": at, **self.parameters()}


def read_procedure(path: Path) -> BatchProcedure:
    """The procedure of a file. Raises BadParameter if it is unreadable, or a key or value is invalid (naming the
    nearest key); BadInput for unreadable cells."""
    content, source = TableSource.read(path)
    known = next(one for one in fields_of(ProcedureTable) if one.name == "procedure")
    name = read_value(known, content.get("procedure", USUAL_PROCEDURE), source, ("procedure",))
    procedure, folder = procedure_named(name), path.parent
    file: Any = read_model(_file_model(procedure), content, source)
    settings = _settings(content, file, procedure.Settings, source).placed(folder)
    endings, pairs = (("", ""), None)
    if procedure.inputs in IN_PAIRS:
        (first, one), (second, other), (_, rows) = asdict(file.pairs).items()
        if rows and content["pairs"].keys() != {"table"}:
            source.refuse(("pairs", "table"), "and endings are both given", "give one of them")
        if not one or not other or one == other:
            remedy = ", ".join(f"{key} = {toml_value(ending)}" for key, ending in procedure.endings.items())
            source.refuse(("pairs", first), f"and pairs.{second} must be two different endings", f"write {remedy}")
        endings, pairs = (one, other), folder / rows if rows else None
    batch = BatchProcedure(procedure, settings, _terms(file, folder, source), endings, pairs)
    settings.check()
    return batch


@dataclass(frozen=True, kw_only=True)
class ProcedureTable(SpecificationTable):
    """The keys of every procedure file."""

    procedure: Annotated[str, one_of(procedure_names)] = USUAL_PROCEDURE
    specification: Path | None = None
    at: tuple[FrequencyValue, ...] = ()


def _file_model(procedure: Procedure[Any]) -> type[ProcedureTable]:
    """The keys of a procedure's file: those of every one, its tables of settings, and settings outside of them."""
    known = {one.name for one in fields_of(procedure.Settings)}
    extra: list[Any] = [(name, Any, None) for name in AT_THE_TOP if name in known]
    extra += [(name, dict[str, Any], field(default_factory=dict)) for name in _tables(known)]
    if "plane" in known:
        extra.append(("planes", tuple[PlaneName, ...], ()))
    if procedure.inputs in IN_PAIRS:
        endings = [(key, str, ending) for key, ending in procedure.endings.items()]
        pairs = make_dataclass("PairsTable", [*endings, ("table", Path | None, None)], frozen=True)
        extra.append(("pairs", pairs, field(default_factory=pairs)))
    return make_dataclass("ProcedureFile", extra, bases=(ProcedureTable,), frozen=True, kw_only=True)


def _tables(known: Collection[str]) -> dict[str, Collection[str]]:
    """The tables of settings that a procedure has, and their keys."""
    tables = {name: keys for name, keys in TABLES.items() if set(keys) <= set(known)}
    return {**tables, "parameters": known, "settings": known}


def _settings(content: Mapping[str, Any], file: Any, model: type[Settings], source: TableSource) -> Settings:
    known = [one.name for one in fields_of(model)]
    tables: list[tuple[KeyPath, Mapping[str, Any], Collection[str]]] = [
        ((), {name: value for name, value in content.items() if name in AT_THE_TOP}, known),
        *(((name,), getattr(file, name), keys) for name, keys in _tables(known).items()),
    ]
    given: dict[str, Any] = {}
    places: dict[str, KeyPath] = {}
    if planes := getattr(file, "planes", ()):
        given["plane"], places["plane"] = ALL if ALL in planes else ",".join(planes), ("planes",)
    for path, table, keys in tables:
        for key, value in table.items():
            if key not in keys:
                source.refuse_unknown((*path, key), list(keys))
            if key in given:
                source.refuse((*path, key), f"and {name_of(places[key])} are both given", "give one of them")
            given[key], places[key] = value, (*path, key)
    places = {name: ("settings", name) for name in known} | places
    return read_model(model, given, replace(source, places=places))


def _terms(file: Any, folder: Path, source: TableSource) -> Terms:
    """Unit and frequencies; the specification, of a file beside this one or of this one."""
    own = file.to_specification(source)
    if file.specification and own.limits:
        source.refuse(("specification",), "and limits in this file are both given", "give one of them")
    unit = Unit(file.unit)
    at = tuple(Frequency(value, unit) for value in file.at)
    return Terms(unit, at, read_specification(folder / file.specification) if file.specification else own)
