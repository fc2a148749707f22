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

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from procedures.raw import GREY_PLANE, MOSAIC_PLANES
from station.common.models import TableSource, fields_of, read_model
from station.common.sanitise import printable
from station.common.toml_table import TomlTable
from station.procedure.base import Inputs, Procedure
from station.procedure.registry import procedure_named, procedure_names
from station.procedure.settings import Settings, to_record
from station.results.specification_file import read_specification, specification_in
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


@dataclass(frozen=True, eq=False)
class BatchProcedure:
    """A procedure with its settings.

    Attributes
    ----------
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
        """The procedure's name."""
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
    """The procedure that a file describes.

    Raises
    ------
    BadParameter
        If it cannot be read, has an unknown key (the nearest one is named), or a value is not valid.
    BadInput
        If the chart's cells cannot be read.
    """
    table = TomlTable.read(path)
    name = table.get("procedure", str, USUAL_PROCEDURE)
    if name not in procedure_names():
        raise table.wrong("procedure", f"is {printable(name)!r}", f"use one of {', '.join(procedure_names())}")
    procedure, folder = procedure_named(name), path.parent
    settings = _settings(table, procedure.Settings).placed(folder)
    endings, pairs = ("", ""), None
    if procedure.inputs in IN_PAIRS:
        endings, pairs = _pairs(table.table("pairs"), folder, procedure.endings)
    batch = BatchProcedure(procedure, settings, _terms(table, folder), endings, pairs)
    table.end()
    settings.check()
    return batch


def _settings(table: TomlTable, model: type[Settings]) -> Settings:
    """The settings of all tables, and those outside of tables."""
    known = {one.name for one in fields_of(model)}
    given: dict[str, Any] = {}
    shown = {name: f"settings.{name}" for name in known}

    def take(source: TomlTable, keys: Collection[str], where: str = "") -> None:
        for key in keys:
            if source.has(key):
                if key in given:
                    raise source.wrong(key, f"and {shown[key]} are both given", "give one of them")
                given[key], shown[key] = source.peek(key), f"{where}{key}"

    if "plane" in known and (planes := _planes(table)):
        given["plane"] = planes
    take(table, known.intersection(AT_THE_TOP))
    tables = {name: keys for name, keys in TABLES.items() if known.issuperset(keys)}
    for name, keys in {**tables, "parameters": known, "settings": known}.items():
        inside = table.table(name)
        take(inside, keys, f"{name}.")
        inside.end()
    return read_model(model, given, TableSource(shown=shown))


def _planes(table: TomlTable) -> str:
    known, planes = (*MOSAIC_PLANES, GREY_PLANE, ALL), table.words("planes")
    for plane in planes:
        if plane not in known:
            raise table.wrong("planes", f"has {printable(plane)!r}", f"use one of {', '.join(known)}")
    return ALL if ALL in planes else ",".join(planes)


def _terms(table: TomlTable, folder: Path) -> Terms:
    """Unit and frequencies; the specification, of a file beside this one or of this one."""
    own = specification_in(table)
    name = table.get("specification", str, "")
    if name and own.limits:
        raise table.wrong("specification", "and limits in this file are both given", "give one of them")
    unit = Unit(table.get("unit", str, str(Unit.CYCLES)).lower())  # checked by `specification_in`
    at = tuple(Frequency(value, unit) for value in table.numbers("at"))
    return Terms(unit, at, read_specification(folder / name) if name else own)


def _pairs(table: TomlTable, folder: Path, usual: Mapping[str, str]) -> tuple[tuple[str, str], Path | None]:
    """How a pair's names end, or the table that names them."""
    keys = list(usual)
    one, other = (table.get(key, str, usual[key]) for key in keys)
    rows = table.get("table", str, "")
    table.end()
    if rows and any(table.has(key) for key in keys):
        raise table.wrong("table", "and endings are both given", "give one of them")
    if not one or not other or one == other:
        words = f"and pairs.{keys[1]} must be two different endings"
        raise table.wrong(keys[0], words, f'write {keys[0]} = "{usual[keys[0]]}", {keys[1]} = "{usual[keys[1]]}"')
    return (one, other), folder / rows if rows else None
