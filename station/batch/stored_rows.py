"""The rows of a batch on the disk, and what all of them say in one pass: memory does not grow with a photograph's rows.
A batch of 100,000 photographs keeps a position for each in memory, and one number for each value that is summarised."""

from __future__ import annotations

import csv
import json
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from statistics import median
from typing import Any, overload

from procedures.numbers import Group, Number, in_group
from procedures.outcome import BadParameter
from station.batch.item import VERDICTS, ItemRow, PlaneRow, row_of_record
from station.common.sanitise import cell, encodable
from station.results.result_files import plain

GROUP = tuple[str, str, str]


def line_of(row: ItemRow) -> bytes:
    """A row as a line of JSON."""
    return (json.dumps(plain(asdict(row)), ensure_ascii=False, allow_nan=False) + "\n").encode()


class StoredRows(Sequence[ItemRow]):
    """Rows in the order of their items, read from a file of lines when they are used; written as they come."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._out = path.open("wb")
        self._at: dict[int, int] = {}
        self._end = 0
        self._sorted: list[int] | None = None

    def add(self, number: int, row: ItemRow) -> None:
        data = line_of(row)
        self._out.write(data)
        self._out.flush()
        self._at[number], self._end, self._sorted = self._end, self._end + len(data), None

    def close(self) -> None:
        self._out.close()

    def _lines(self, numbers: Sequence[int]) -> Iterator[bytes]:
        with self._path.open("rb") as file:
            for number in numbers:
                file.seek(self._at[number])
                yield file.readline()

    def write_sorted(self, path: Path) -> None:
        """Write the lines in the order of the items."""
        with path.open("wb") as file:
            file.writelines(self._lines(self._numbers))

    def replaced(self) -> None:
        """Its file is now the sorted one, and no rows are added any more."""
        self.close()
        with self._path.open("rb") as file:
            begin = 0
            for number, line in zip(self._numbers, file, strict=True):
                self._at[number], begin = begin, begin + len(line)

    def __len__(self) -> int:
        return len(self._at)

    @overload
    def __getitem__(self, index: int) -> ItemRow: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[ItemRow, ...]: ...

    def __getitem__(self, index: int | slice) -> ItemRow | tuple[ItemRow, ...]:
        if isinstance(index, slice):
            return tuple(self._rows(self._numbers[index]))
        return next(self._rows([self._numbers[index]]))

    def __iter__(self) -> Iterator[ItemRow]:
        return self._rows(self._numbers)

    def _rows(self, numbers: Sequence[int]) -> Iterator[ItemRow]:
        return (row_of_record(json.loads(line)) for line in self._lines(numbers))

    @property
    def _numbers(self) -> list[int]:
        """The numbers of the items in their order, sorted when one has been added."""
        if self._sorted is None:
            self._sorted = sorted(self._at)
        return self._sorted


@dataclass
class NumberSeries:
    """One number of all photographs by a camera in a plane: its unit, its values, and their standard uncertainties."""

    unit: str
    values: array[float] = field(default_factory=lambda: array("d"))
    uncertainties: array[float] = field(default_factory=lambda: array("d"))


@dataclass
class Tally:
    """Counts and values over the rows of a batch.

    verdicts, specifications : number of items by verdict
    planes : number of planes by name and verdict
    failed : places of the rows that are not usable
    units : of every number that a plane has
    series : values of the numbers in the summary
    """

    verdicts: Counter[str] = field(default_factory=Counter)
    specifications: Counter[str] = field(default_factory=Counter)
    planes: dict[str, Counter[str]] = field(default_factory=dict)
    failed: list[int] = field(default_factory=list)
    all_sure: bool = True
    reused: int = 0
    units: dict[str, str] = field(default_factory=dict)
    series: dict[GROUP, NumberSeries] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: Iterable[ItemRow]) -> Tally:
        """The tally of rows, in one pass."""
        tally = cls()
        for place, row in enumerate(rows):
            tally.verdicts[row.verdict] += 1
            tally.specifications[row.specification] += 1
            tally.all_sure = tally.all_sure and row.sure
            tally.reused += row.reused
            if not row.usable:
                tally.failed.append(place)
            for name, plane in row.planes.items():
                tally.planes.setdefault(name, Counter())[plane.verdict] += 1
                tally.units |= {number: str(one.get("unit", "")) for number, one in plane.numbers.items()}
                for number, one in plane.summary.items():
                    series = tally.series.setdefault((row.camera, name, number), NumberSeries(one.unit))
                    series.values.append(one.value)
                    series.uncertainties.append(one.uncertainty)
        return tally

    @property
    def followed(self) -> list[Number]:
        """The numbers in the summary over all photographs."""
        return in_group(Group.SUMMARY, {number for _, _, number in self.series})

    def statistics(self) -> dict[str, dict[str, Any]]:
        """Verdict counts of every plane, and median, minimum and maximum of the numbers in the summary."""
        summary: dict[str, dict[str, Any]] = {}
        for name, counted in sorted(self.planes.items()):
            verdicts = {verdict: counted[verdict] for verdict in VERDICTS if counted[verdict]}
            summary[name] = {"verdicts": verdicts}
            for number in self.followed:
                parts = [
                    one.values for (_, plane, other), one in self.series.items() if (plane, other) == (name, number)
                ]
                values = [value for part in parts for value in part]
                if values:
                    entry = {"n": len(values), "median": median(values), "min": min(values), "max": max(values)}
                    summary[name][number] = entry
        return summary


HEAD = (
    "files", "verdict", "plane", "plane_verdict", "reason", "remedy", "specification", "against", "folder", "sha256",
)  # fmt: skip
NOTED = (
    ("camera", "camera"), ("lens", "lens"), ("captured_at", "captured_at"), ("exposure [s]", "exposure_s"),
    ("f_number", "f_number"), ("iso", "iso"), ("focal_length [mm]", "focal_length_mm"),
    ("focus_distance [mm]", "focus_distance_mm"),
)  # fmt: skip
"""Headings of the settings recorded by the camera, and their names in a row."""
TEXTS = ("camera", "lens", "captured_at")
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
        raise BadParameter(
            "--parquet needs pyarrow, and so does a summary.parquet in --out",
            "pip install 'calibration-station[parquet]', or use summary.csv alone",
        )


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
    return "; ".join(str(limit["words"]) for limit in plane.limits if limit["verdict"] != "meets")


def _columns(numbers: Iterable[str]) -> list[str]:
    return [column for number in sorted(numbers) for column in (number, f"{number}_uncertainty")]


def _unit(column: str, units: Mapping[str, str]) -> str:
    return units.get(column) or units.get(column.removesuffix("_uncertainty")) or ""


def _with_unit(column: str, units: Mapping[str, str]) -> str:
    """A heading with the unit of its number, if it has one."""
    unit = _unit(column, units)
    return column if unit in ("", "1") else f"{column} [{unit}]"
