"""A batch's procedure as a file says it: what to estimate, how, and what is good enough.

```toml
procedure = "pattern"               # or "two-photo", "field", "edge", "series", "restore" (see `restoration_file`)
planes = ["G1"]                     # or ["all"]; by default G1 of a RAW file, Y of a grey image
specification = "lens.toml"         # beside this file; or the same [limits] and [[limit]] here
unit = "cycles/pixel"               # of every frequency, here and in the results; or "lp/mm", "lw/ph"
at = [0.25]                         # frequencies at which the MTF is told too
coverage = 2                        # guard bands of the limits in here, in standard uncertainties
parameters = { s = "auto", k = "auto", solver = "ls" }
chart = { seed = 1 }                # or bits = "cells.pgm", beside this file
optics = { pixel_pitch_um = 3.76, f_number = 8, wavelength_nm = 530 }
physics = false                     # pattern, series: whether PSFs are explained by photosites and aberrations
trust_typed = false                 # true: optics count against what the cameras noted in their files
raw = "1920x1080,RGGB,u16le,64,1023"          # where the photographs are a sensor's samples without a header
pairs = { near = "_near", far = "_far" }      # two-photo: how names of a pair end; or { table = "pairs.csv" }

[limits]
mtf50_horizontal = { min = 0.25 }
energy_above_nyquist = { max = 0.05, planes = ["G1", "G2"] }
```
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from procedures.field.estimate import FIELD as FIELD_PARAMETERS
from procedures.outcome import BadParameter
from procedures.pattern import DEFAULT_SEED
from procedures.pattern_print.source import Source
from procedures.pattern_psf.estimate import PatternParameters
from procedures.psf import Sampling
from procedures.raw import GREY_PLANE, MOSAIC_PLANES
from procedures.reading.sensor_dump import DumpLayout
from procedures.two_photo.estimate import TwoPhotoParameters
from station.common.sanitise import printable
from station.common.toml_table import Table
from station.procedure.base import Inputs
from station.procedure.registry import procedure_named, procedure_names
from station.procedure.settings import Settings, placed, read_settings, to_record
from station.results.specification_file import read_specification, specification_in
from station.results.terms import USUAL, Terms
from station.results.units import Frequency, Unit

if TYPE_CHECKING:
    from station.calibration.restoration.restorations import RestorationOptions

PATTERN, TWO_PHOTO, FIELD, EDGE, SERIES, RESTORE = "pattern", "two-photo", "field", "edge", "series", "restore"
DEFAULTS: Mapping[str, Sampling | None] = {
    PATTERN: PatternParameters(),
    TWO_PHOTO: TwoPhotoParameters(),
    FIELD: FIELD_PARAMETERS,
    EDGE: None,
    SERIES: PatternParameters(),
    RESTORE: None,
}
"""How a PSF is sampled by each procedure; None where there is none."""
ENDINGS: Mapping[str, Mapping[str, str]] = {
    TWO_PHOTO: {"near": "_near", "far": "_far"},
    RESTORE: {"first": "_1", "second": "_2"},
}
"""Of procedures whose items are pairs: which photograph's name ends how, where nothing is told."""
OF_CHARTS = (PATTERN, FIELD, SERIES)
ALL = "all"
OPTICS = ("pixel_pitch_um", "f_number", "wavelength_nm")


@dataclass(frozen=True, eq=False)
class Procedure:
    """What is done with every photograph, or pair of them.

    Attributes
    ----------
    name : "pattern", "two-photo", "field" (a folder's photographs together), "edge", "series" or "restore"
    parameters : PatternParameters or TwoPhotoParameters, or None of edges and restorations
    planes : tuple of str
        Empty for the default one of each file, ("all",) for all.
    chart : Source or None
        The cells that were photographed; None where no chart was.
    optics : mapping of str to float
        Of pixel_pitch_um, f_number and wavelength_nm those that are given.
    terms : Terms
        The unit, further frequencies, and what the results are held to.
    endings : (str, str)
        How the names of a pair's photographs end.
    pairs : Path or None
        A table whose rows name the photographs of an item, in place of endings.
    restoration : RestorationOptions or None
        As the file says them; None of other procedures.
    folder : Path
        Of the procedure file, where files lie that it names.
    layout : DumpLayout or None
        How the samples lie in photographs without a header; None where each file tells it itself.
    physics : bool
        Whether PSFs are explained by photosites, low-pass filter, diffraction and aberrations.
    trust_typed : bool
        Whether `optics` count against what a camera noted in its files.
    settings : Settings or None
        Of a procedure of `station.procedure`; None of the others.
    """

    name: str
    parameters: Sampling | None
    planes: tuple[str, ...] = ()
    chart: Source | None = None
    optics: Mapping[str, float] = field(default_factory=dict)
    terms: Terms = USUAL
    endings: tuple[str, str] = ("", "")
    pairs: Path | None = None
    restoration: RestorationOptions | None = None
    folder: Path = Path()
    layout: DumpLayout | None = None
    trust_typed: bool = False
    physics: bool = False
    settings: Settings | None = None

    @property
    def inputs(self) -> Inputs:
        """What one item of a batch is."""
        if self.settings is not None:
            return procedure_named(self.name).inputs
        if self.name in ENDINGS:
            return Inputs.PAIR
        return Inputs.PHOTOGRAPHS if self.name == FIELD else Inputs.PHOTOGRAPH

    @property
    def chart_source(self) -> Source:
        """The chart that was photographed. Raises BadParameter where none was."""
        if self.chart is None:
            raise BadParameter(f"the procedure {self.name} photographs no chart", "choose another procedure")
        return self.chart

    def told(self) -> dict[str, Any]:
        """The parameters as a record tells them, in the manner of `station psf`."""
        chart = {} if self.chart is None else {"chart": self.chart.origin}
        layout = {"raw": str(self.layout)} if self.layout else {}
        trust = {"trust_typed": True} if self.trust_typed else {}
        physics = {"physics": True} if self.physics else {}
        sampling = {} if self.parameters is None else self.parameters.told()
        if self.restoration is not None:
            sampling = self.restoration.entries
        if self.settings is not None:
            sampling = to_record(self.settings)
        return {**sampling, **physics, **chart, **self.optics, **layout, **trust, **self.terms.parameters()}

    def fingerprint(self) -> dict[str, Any]:
        """All that a result depends on, as plain data."""
        at = [one.value for one in self.terms.at]
        held = {name: value for name, value in self.terms.specification.told().items() if name != "path"}
        return {"procedure": self.name, "planes": list(self.planes), "specification": held, "at": at, **self.told()}


def read_procedure(path: Path) -> Procedure:
    """The procedure that a file describes.

    Raises
    ------
    BadParameter
        If it cannot be read, has a key that is not known (the nearest one is named) or a value that cannot be meant.
    BadInput
        If the chart's cells cannot be read.
    """
    table = Table.read(path)
    name = table.get("procedure", str, PATTERN)
    if name not in (*DEFAULTS, *procedure_names()):
        raise table.wrong(
            "procedure", f"is {printable(name)!r}", f"use one of {', '.join((*DEFAULTS, *procedure_names()))}"
        )
    if name not in DEFAULTS:
        return _measuring(table, name, path.parent)
    if name == RESTORE:
        return _restoration(table, path.parent)
    endings, pairs = Procedure.endings, None
    if name in ENDINGS:
        endings, pairs = _pairs(table.table("pairs"), path.parent, ENDINGS[name])
    procedure = Procedure(
        name,
        _parameters(table.table("parameters"), DEFAULTS[name]),
        _planes(table),
        _chart(table.table("chart"), path.parent) if name in OF_CHARTS else None,
        _optics(table.table("optics")),
        _terms(table, path.parent),
        endings,
        pairs,
        layout=_layout(table),
        trust_typed=table.get("trust_typed", bool, False),
        physics=table.get("physics", bool, False) if name in (PATTERN, SERIES) else False,
    )
    table.end()
    return procedure


def _measuring(table: Table, name: str, beside: Path) -> Procedure:
    """Of a procedure with a model of settings: its keys stand in [settings]."""
    measuring = procedure_named(name)
    settings = placed(read_settings(measuring.Settings, table.get("settings", dict, {}), "settings."), beside)
    endings, pairs = Procedure.endings, None
    if measuring.inputs in (Inputs.PAIR, Inputs.RESULTS):
        endings, pairs = _pairs(table.table("pairs"), beside, measuring.endings)
    found = Procedure(
        name, None, terms=_terms(table, beside), settings=settings, folder=beside, endings=endings, pairs=pairs
    )
    table.end()
    return found


def _auto(table: Table, name: str, default: int | None) -> int | None:
    """A whole number, or "auto" for what the program chooses."""
    return table.number_or(name, "auto", default)


def _parameters(table: Table, default: Sampling | None) -> Sampling | None:
    if default is None:
        table.end()
        return None
    s, k, solver = (
        _auto(table, "s", default.s),
        _auto(table, "k", default.k),
        table.get("solver", str, default.solver),
    )
    table.end()
    return replace(default, s=s, k=k, solver=solver)


def _planes(table: Table, known: tuple[str, ...] = (*MOSAIC_PLANES, GREY_PLANE, ALL)) -> tuple[str, ...]:
    planes = table.words("planes")
    for plane in planes:
        if plane not in known:
            raise table.wrong("planes", f"has {printable(plane)!r}", f"use one of {', '.join(known)}")
    return (ALL,) if ALL in planes else planes


def _chart(table: Table, beside: Path) -> Source:
    seed, bits = table.get("seed", int, DEFAULT_SEED), table.get("bits", str, "")
    if bits and table.has("seed"):
        raise table.wrong("bits", "and chart.seed are both given", "give one of them")
    table.end()
    try:
        return Source.from_file(beside / bits) if bits else Source.from_seed(seed)
    except ValueError as error:  # a path with a null character in it
        raise table.wrong("bits", "is no file's name") from error


def _layout(table: Table) -> DumpLayout | None:
    return DumpLayout.parse(table.get("raw", str, "")) if table.has("raw") else None


def _optics(table: Table) -> dict[str, float]:
    found = {name: table.get(name, float, 0.0) for name in OPTICS if table.has(name)}
    table.end()
    for name, value in found.items():
        if not 0 < value < math.inf:
            raise table.wrong(name, f"must be more than 0; it is {value:g}")
    return found


def _terms(table: Table, beside: Path) -> Terms:
    """Unit and frequencies; the specification, of a file beside this one or of this one."""
    own = specification_in(table)
    name = table.get("specification", str, "")
    if name and own.limits:
        raise table.wrong("specification", "and limits in this file are both given", "give one of them")
    unit = Unit(table.get("unit", str, str(Unit.CYCLES)).lower())  # `specification_in` has looked at it
    at = tuple(Frequency(value, unit) for value in table.numbers("at"))
    return Terms(unit, at, read_specification(beside / name) if name else own)


def _pairs(table: Table, beside: Path, usual: Mapping[str, str]) -> tuple[tuple[str, str], Path | None]:
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
    return (one, other), beside / rows if rows else None


def _restoration(table: Table, beside: Path) -> Procedure:
    """Of restorations, which have no chart, no optics and no limits."""
    from station.batch.restoration_file import read_restoration  # here: it loads what restores

    options = read_restoration(table.table("parameters"))
    planes = _planes(table)
    if len(planes) > 1:
        raise table.wrong("planes", "must be one plane here", 'write ["G1"], or ["all"] for colour')
    endings, pairs = _pairs(table.table("pairs"), beside, ENDINGS[RESTORE])
    found = Procedure(
        RESTORE, None, planes, endings=endings, pairs=pairs, restoration=options, folder=beside, layout=_layout(table)
    )
    table.end()
    return found
