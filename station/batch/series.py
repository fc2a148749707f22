"""A series' points from a batch's rows: what the camera noted of each photograph, and what its planes gave."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from procedures.numbers import EDGE_MTF50, MTF50_HORIZONTAL, MTF50_VERTICAL, STREHL, WAVEFRONT_RMS
from station.batch.item import USABLE, ItemRow
from station.calibration.series import PAGE, TABLE, Best, Point, SeriesSetting, best_apertures, series_table, together
from station.common.atomic_files import write_whole
from station.common.sanitise import printable

NUMBERS: Mapping[str, tuple[str, ...]] = {
    EDGE_MTF50: (MTF50_HORIZONTAL, MTF50_VERTICAL),
    STREHL: (STREHL,),
    WAVEFRONT_RMS: (WAVEFRONT_RMS,),
}
"""What is followed: a number, and those of a plane whose mean it is."""
ONE = {"camera": "cameras", "lens": "lenses", "focal_length_mm": "focal lengths"}
"""What a series has one of."""


def points_of(rows: Sequence[ItemRow]) -> list[Point]:
    """Every number of every plane at every setting, in their order; what gave no measurement is left out."""
    found: dict[tuple[str, str, SeriesSetting], list[tuple[float, float, str]]] = {}
    for row in rows:
        setting = SeriesSetting(*(_number(row.noted.get(key)) for key in ("f_number", "focus_distance_mm", "iso")))
        for plane, one in row.planes.items():
            for number, parts in NUMBERS.items() if one.verdict in USABLE else ():
                if all(part in one.numbers for part in parts):
                    told = [one.numbers[part] for part in parts]
                    found.setdefault((plane, number, setting), []).append(_mean_of_parts(told))
    points = [Point(*key, *together(shots), shots[0][2], len(shots)) for key, shots in found.items()]
    return sorted(points, key=_order)


def best_of(rows: Sequence[ItemRow]) -> list[Best]:
    """The best aperture of each plane, where there are several."""
    return best_apertures(points_of(rows))


def several(rows: Sequence[ItemRow]) -> list[str]:
    """What differs among photographs that should be of one lens on one camera from one mounting, in sentences."""
    found = []
    for key, words in ONE.items():
        values = sorted({str(row.noted[key]) for row in rows if key in row.noted})
        if len(values) > 1:
            found.append(f"the photographs are of several {words}: {', '.join(map(printable, values))}")
    return found


def write_series(out: Path, rows: Sequence[ItemRow]) -> list[Path]:
    """Write a series' table and page into its folder; returns their paths."""
    from station.reports.batches.series_page import series_page  # here: it draws, which is slow to load

    points = points_of(rows)
    page = series_page(points, best_apertures(points)).encode()
    files = {out / TABLE: series_table(points), out / PAGE: page}
    for path, data in files.items():
        write_whole(path, data)
    return [*files]


def _order(one: Point) -> tuple[Any, ...]:
    setting = (one.setting.f_number, one.setting.focus_mm, one.setting.iso)
    return one.plane, one.number, *(-1.0 if value is None else value for value in setting)


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def _mean_of_parts(parts: Sequence[Mapping[str, Any]]) -> tuple[float, float, str]:
    """The mean of numbers of one photograph; their errors have much in common, so they are not made less."""
    value = sum(one["value"] for one in parts) / len(parts)
    return value, sum(one.get("uncertainty", 0.0) for one in parts) / len(parts), parts[0].get("unit", "1")
