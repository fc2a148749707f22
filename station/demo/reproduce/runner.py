"""Rows computed one after the other; an error in one does not stop the others."""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

from procedures.outcome import BadParameter, ProcedureError
from station.common.progress import Progress, silent
from station.common.versions import software
from station.demo.reproduce.row import ClaimCheck, Row, RowValues, Setting, shown
from station.results.result_files import ResultFolder, write_record

SCHEMA = "station/reproduce/2"
PAGE = "index.html"
NO_VALUES = RowValues(())


class RowState(StrEnum):
    """Outcome of a row.

    REPRODUCED: every value is within the paper's own claim. SAME_DIRECTION: the order that the paper states holds,
    values differ. NOT_REPRODUCED: neither, or the row could not be computed to its end. NOT_COMPUTED: not tried.
    """

    REPRODUCED = "reproduced"
    SAME_DIRECTION = "same direction"
    NOT_REPRODUCED = "not reproduced"
    NOT_COMPUTED = "not computed"


@dataclass(frozen=True, eq=False)
class RowResult:
    """A row with its outcome; without values there is a reason. `processor_s` counts all threads of this process."""

    row: Row
    state: RowState
    computed: RowValues = NO_VALUES
    reason: str = ""
    seconds: float = 0.0
    processor_s: float = 0.0

    @property
    def lines(self) -> list[tuple[ClaimCheck, float]]:
        return list(zip(self.row.checks, self.computed.values, strict=False))

    @property
    def deviating(self) -> list[tuple[ClaimCheck, float]]:
        """Checks whose values are outside the claim."""
        return [(check, value) for check, value in self.lines if not check.agrees(value)]


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The selected rows."""

    rows: tuple[RowResult, ...]
    full: bool
    seconds: float

    @property
    def processor_s(self) -> float:
        """Processor time of all rows, seconds."""
        return sum(row.processor_s for row in self.rows)

    def count(self, state: RowState) -> int:
        return sum(row.state is state for row in self.rows)

    @property
    def agrees(self) -> bool:
        """Whether a row was computed and none is *not reproduced*."""
        return self.count(RowState.NOT_COMPUTED) < len(self.rows) and not self.count(RowState.NOT_REPRODUCED)


def select(rows: Sequence[Row], name: str | None) -> tuple[Row, ...]:
    """The rows of that name or chapter, all for None. Raises BadParameter, with the names, if there is none."""
    selected = tuple(row for row in rows if name in (None, row.name, row.chapter))
    if not selected:
        names = ", ".join(row.name for row in rows)
        chapters = ", ".join(dict.fromkeys(row.chapter for row in rows))
        raise BadParameter(f"no row {name!r}", f"name a row ({names}) or a chapter ({chapters})")
    return selected


def reproduce(
    out: Path, rows: Sequence[Row], setting: Setting, *, name: str | None = None, progress: Progress = silent
) -> tuple[Reproduction, str]:
    """Compute rows, write `index.html` and `result.json` to `out`; returns the results and the record's text.

    name : a row or a chapter; without one all rows are computed, the long ones only with `setting.full`.
    """
    start = time.perf_counter()
    selected = select(rows, name)
    with ResultFolder(out) as folder:
        results = []
        for row in selected:
            results.append(compute(row, setting, by_name=row.name == name))
            one = results[-1]
            reason = f": {one.reason}" if one.reason else ""
            progress(f"{one.row.name}: {one.state}{reason} ({one.seconds:.1f} s, {one.processor_s:.1f} s of processor)")
        result = Reproduction(tuple(results), setting.full, time.perf_counter() - start)
        folder.write(PAGE, _page(result).encode())
        return result, write_record(folder, _record(result, setting))


def _page(result: Reproduction) -> str:
    from station.demo.reproduce.catalogue import NOT_HERE  # here: rows and templates are slow to load
    from station.reports.page import render

    return render("reproduce.html", result=result, State=RowState, shown=shown, not_here=NOT_HERE, software=software())


def compute(row: Row, setting: Setting, *, by_name: bool = False) -> RowResult:
    """A row's values compared with the published ones, or the reason why there are none. An unexpected error is the
    row's reason; with STATION_TRACEBACK it is raised."""
    if missing := _missing(row, setting, by_name=by_name):
        return RowResult(row, RowState.NOT_COMPUTED, reason=missing)
    start, worked = time.perf_counter(), time.process_time()
    result = _compared(row, setting)
    return replace(result, seconds=time.perf_counter() - start, processor_s=time.process_time() - worked)


def _compared(row: Row, setting: Setting) -> RowResult:
    try:
        computed = row.compute(setting)
        if len(computed.values) != len(row.checks):
            raise ValueError(f"{len(row.checks)} checks need as many values; got {len(computed.values)}")
    except ProcedureError as error:
        return RowResult(row, RowState.NOT_REPRODUCED, reason=error.reason)
    except Exception as error:
        if os.environ.get("STATION_TRACEBACK"):
            raise
        reason = f"the row stopped with an unexpected error: {type(error).__name__}: {error}"
        return RowResult(row, RowState.NOT_REPRODUCED, reason=reason)
    if all(check.agrees(value) for check, value in zip(row.checks, computed.values, strict=True)):
        return RowResult(row, RowState.REPRODUCED, computed)
    ordered = row.order is not None and row.order.holds(computed.values)
    return RowResult(row, RowState.SAME_DIRECTION if ordered else RowState.NOT_REPRODUCED, computed)


def _missing(row: Row, setting: Setting, *, by_name: bool) -> str:
    """The reason not to compute a row; empty if there is none."""
    if row.long and not (setting.full or by_name):
        return "it takes long; compute it with --full, or by its name"
    try:
        for name in row.needs:
            setting.path(name)
    except BadParameter as error:
        return f"{error.reason}: {error.remedy}"
    return ""


def _record(result: Reproduction, setting: Setting) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "procedure": "reproduce",
        "parameters": {"full": setting.full, "data": None if setting.data is None else str(setting.data)},
        "summary": {state.value.replace(" ", "_"): result.count(state) for state in RowState},
        "rows": [_entry(row) for row in result.rows],
        "software": software(),
        "duration_s": round(result.seconds, 3),
        "processor_s": round(result.processor_s, 3),
    }


def _entry(result: RowResult) -> dict[str, Any]:
    row = result.row
    return {
        **{name: getattr(row, name) for name in ("name", "chapter", "place", "title")},
        "state": str(result.state),
        "reason": result.reason,
        "remark": result.computed.remark,
        "order": row.order.statement if row.order else "",
        "setup": row.setup,
        "checks": [
            {
                **{name: getattr(check, name) for name in ("quantity", "unit", "published")},
                "ours": value,
                "low": check.low,
                "high": check.high,
                "agrees": check.agrees(value),
                "deviation": check.deviation(value),
            }
            for check, value in result.lines
        ],
        "duration_s": round(result.seconds, 3),
        "processor_s": round(result.processor_s, 3),
    }
