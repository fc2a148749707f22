"""Rows computed one after the other; none stops the others."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from procedures.outcome import BadParameter, ProcedureError
from station.common.progress import Progress, silent
from station.common.versions import software
from station.demo.reproduce.reproduction import CheckedFigure, Done, Reproduction, RowState
from station.demo.reproduce.row import Row, Setting
from station.results.result_files import ResultFolder, write_record

SCHEMA = "station/reproduce/1"
PAGE = "index.html"


def chosen(rows: Sequence[Row], name: str | None) -> tuple[Row, ...]:
    """The rows of that name or chapter, all without one. Raises BadParameter, with the names, if there is none."""
    found = tuple(row for row in rows if name in (None, row.name, row.chapter))
    if not found:
        names = ", ".join(row.name for row in rows)
        chapters = ", ".join(dict.fromkeys(row.chapter for row in rows))
        raise BadParameter(f"no row {name!r}", f"name a row ({names}) or a chapter ({chapters})")
    return found


def reproduce(
    out: Path, rows: Sequence[Row], setting: Setting, *, name: str | None = None, progress: Progress = silent
) -> tuple[Reproduction, str]:
    """Compute the rows, write page and record; returns what became of them, and the record's text.

    Parameters
    ----------
    out : Path
        Receives `index.html` and `result.json`.
    name : str, optional
        A row or a chapter; without one all rows are computed, the long ones only where the setting is full.
    """
    start = time.perf_counter()
    asked = chosen(rows, name)
    with ResultFolder(out) as folder:
        done = []
        for row in asked:
            one = computed(row, setting, named=row.name == name)
            done.append(one)
            progress(_sentence(one))
        found = Reproduction(tuple(done), setting.full, time.perf_counter() - start)
        folder.write(PAGE, _page(found).encode())
        return found, write_record(folder, _record(found, setting))


def computed(row: Row, setting: Setting, *, named: bool = False) -> Done:
    """A row's numbers held to the published ones, or why there are none.

    A row that breaks fails with its error, so that the others are kept; with STATION_TRACEBACK it shows where.
    """
    missing = _missing(row, setting, named=named)
    if missing:
        return Done(row, RowState.LEFT_OUT, reason=missing)
    start, worked = time.perf_counter(), time.process_time()
    done = _judged(row, setting)
    return replace(done, seconds=time.perf_counter() - start, processor_s=time.process_time() - worked)


def _judged(row: Row, setting: Setting) -> Done:
    try:
        found = row.compute(setting)
        lines = tuple(CheckedFigure(check, value) for check, value in zip(row.checks, found.values, strict=True))
    except ProcedureError as error:
        return Done(row, RowState.FAIL, reason=error.reason)
    except Exception as error:
        if os.environ.get("STATION_TRACEBACK"):
            raise
        reason = f"the row stopped on something it did not foresee: {type(error).__name__}: {error}"
        return Done(row, RowState.FAIL, reason=reason)
    state = RowState.PASS if all(line.passes for line in lines) else RowState.FAIL
    return Done(row, state, lines, found.figures, found.remark)


def _missing(row: Row, setting: Setting, *, named: bool) -> str:
    """Why a row is left out; nothing where it can be computed."""
    if row.long and not (setting.full or named):
        return "it takes long; compute it with --full, or by its name"
    try:
        for name in row.needs:
            setting.path(name)
    except BadParameter as error:
        return f"{error.reason}: {error.remedy}"
    return ""


def _sentence(one: Done) -> str:
    reason = f": {one.reason}" if one.reason else ""
    return f"{one.row.name}: {one.state}{reason} ({one.seconds:.1f} s, {one.processor_s:.1f} s of processor)"


def _page(found: Reproduction) -> str:
    from station.demo.reproduce.page import reproduction_page  # here: templates are slow to load

    return reproduction_page(found)


def _record(found: Reproduction, setting: Setting) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "procedure": "reproduce",
        "parameters": {"full": setting.full, "data": None if setting.data is None else str(setting.data)},
        "summary": {state.value.replace(" ", "_"): found.count(state) for state in RowState},
        "rows": [_entry(one) for one in found.done],
        "software": software(),
        "duration_s": round(found.seconds, 3),
        "processor_s": round(found.processor_s, 3),
    }


def _entry(one: Done) -> dict[str, Any]:
    row = one.row
    return {
        "name": row.name,
        "chapter": row.chapter,
        "place": row.place,
        "title": row.title,
        "state": str(one.state),
        "reason": one.reason,
        "remark": one.remark,
        "tolerance": row.tolerance,
        "checks": [_line_entry(line) for line in one.lines],
        "duration_s": round(one.seconds, 3),
        "processor_s": round(one.processor_s, 3),
    }


def _line_entry(line: CheckedFigure) -> dict[str, Any]:
    check = line.check
    told = {"quantity": check.quantity, "unit": check.unit, "published": check.published}
    return {**told, "ours": line.ours, "low": check.low, "high": check.high, "pass": line.passes}
