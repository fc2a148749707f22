"""The summary of a batch, one line for each plane: as CSV, and as Parquet with typed columns; rows are streamed."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

from procedures.outcome import BadParameter
from station.batch.item import ItemRow, PlaneRow
from station.common.sanitise import cell, encodable

HEAD = (
    "files",
    "verdict",
    "plane",
    "plane_verdict",
    "reason",
    "remedy",
    "specification",
    "against",
    "folder",
    "sha256",
)
"""First columns of the summary."""
NOTED = (
    ("camera", "camera"), ("lens", "lens"), ("captured_at", "captured_at"), ("exposure [s]", "exposure_s"),
    ("f_number", "f_number"), ("iso", "iso"), ("focal_length [mm]", "focal_length_mm"),
    ("focus_distance [mm]", "focus_distance_mm"),
)  # fmt: skip
"""Headings of the settings recorded by the camera, and their names in a row."""
TEXTS = ("camera", "lens", "captured_at")
"""The text columns."""
GROUP_ROWS = 2000
"""Rows of a Parquet file that are written at once."""


def write_csv(path: Path, rows: Iterable[ItemRow], units: Mapping[str, str]) -> None:
    """The table as CSV, with the `units` of all numbers in the headings; no cell is a formula."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            [_with_unit(name, units) for name in (*HEAD, *(heading for heading, _ in NOTED), *_columns(units))]
        )
        for texts, noted, numbers in _lines(rows, units):
            shown = ["" if number is None else f"{number:.9g}" for number in numbers]
            writer.writerow([*map(cell, texts), *(cell("" if one is None else str(one)) for one in noted), *shown])


def check_parquet() -> None:
    """Raises BadParameter where pyarrow is not installed."""
    if find_spec("pyarrow") is None:
        raise BadParameter("--parquet needs pyarrow", "pip install 'calibration-station[parquet]', or use summary.csv")


def write_parquet(path: Path, rows: Iterable[ItemRow], units: Mapping[str, str]) -> None:
    """The table as Parquet: text, and numbers in double precision whose columns have their unit as metadata."""
    import pyarrow as pa
    from pyarrow import parquet

    text, number = pa.string(), pa.float64()
    fields = [pa.field(name, text) for name in HEAD]
    fields += [pa.field(key, text if key in TEXTS else number) for _, key in NOTED]
    fields += [pa.field(name, number, metadata={"unit": _unit(name, units)}) for name in _columns(units)]
    schema = pa.schema(fields)
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        lines = _lines(rows, units)
        while group := list(islice(lines, GROUP_ROWS)):
            columns = zip(*([*map(encodable, texts), *noted, *numbers] for texts, noted, numbers in group), strict=True)
            arrays = [pa.array(column, field.type) for column, field in zip(columns, fields, strict=True)]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))


Line = tuple[list[str], list[Any], list[float | None]]


def _lines(rows: Iterable[ItemRow], units: Mapping[str, str]) -> Iterator[Line]:
    """Texts of `HEAD`, settings of `NOTED`, and numbers of every plane, or of an item without planes."""
    for row in rows:
        planes: list[tuple[str, PlaneRow | None]] = [*row.planes.items()] or [("", None)]
        for name, plane in planes:
            about = row if plane is None else plane
            judged, against = (plane.specification, _against(plane)) if plane else (row.specification, row.against)
            verdict = plane.verdict if plane else ""
            texts = [" + ".join(row.files), row.verdict, name, verdict, about.reason, about.remedy, judged, against]
            values = plane.numbers if plane else {}
            numbers = [values.get(one, {}).get(kind) for one in sorted(units) for kind in ("value", "uncertainty")]
            yield [*texts, row.folder, " ".join(row.sha256)], [row.noted.get(key) for _, key in NOTED], numbers


def _against(plane: PlaneRow) -> str:
    return "; ".join(str(one["words"]) for one in plane.limits if one["verdict"] != "meets")


def _columns(numbers: Iterable[str]) -> list[str]:
    return [column for number in sorted(numbers) for column in (number, f"{number}_uncertainty")]


def _unit(column: str, units: Mapping[str, str]) -> str:
    return units.get(column) or units.get(column.removesuffix("_uncertainty")) or ""


def _with_unit(column: str, units: Mapping[str, str]) -> str:
    """A heading with the unit of its number, if it has one."""
    unit = _unit(column, units)
    return column if unit in ("", "1") else f"{column} [{unit}]"
