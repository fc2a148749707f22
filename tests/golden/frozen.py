"""Frozen records and pages: what differs from run to run is removed, numbers are compared within a tolerance."""

import csv
import json
import math
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

PASSING = ("arguments", "settings", "duration_s", "seconds", "software", "seal", "sha256", "record_sha256")
"""Entries of a record that say how, when, where and with what it was made."""
PASSING_LINES = ("time taken", "calibration-station")
RELATIVE, OF_UNCERTAINTY, ABSOLUTE = 1e-3, 0.02, 1e-7
"""How far numbers may differ: other processors, and the compiled loops, add single-precision numbers in another order,
which moved parts of uncertainties by 8e-4."""
BLOCKS = {"p", "li", "tr", "h1", "h2", "h3", "table", "section", "figure", "figcaption", "div", "dt", "dd", "title"}
UNSHOWN = {"style", "script", "svg"}
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def frozen_record(path: Path, folder: Path) -> Any:
    """A record without what differs from run to run; the names of its files are kept, their hashes are not."""
    return _frozen(json.loads(path.read_text(encoding="utf-8")), str(folder))


def frozen_file(path: Path) -> Any:
    """What a table or an array holds: its size, sums of its numbers, also weighted by their place, and one row."""
    if path.suffix == ".csv":
        head, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
        columns = {name: [_value(row[i]) for row in rows] for i, name in enumerate(head)}
        numeric = {one: column for one, column in columns.items() if column and all(map(_is_number, column))}
        middle = [column[len(rows) // 2] for column in columns.values() if rows]
        return {"columns": head, "rows": len(rows), "middle": middle,
                "sums": {one: _sums(np.array(column)) for one, column in numeric.items()}}  # fmt: skip
    array = np.load(path) if path.suffix == ".npy" else cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return {"shape": list(array.shape), "kind": str(array.dtype), "sums": _sums(array.astype(np.float64).ravel())}


def _value(cell: str) -> float | str:
    try:
        return float(f"{float(cell):.6g}")
    except ValueError:
        return cell


def _is_number(value: float | str) -> bool:
    return isinstance(value, float) and math.isfinite(value)


def _sums(values: npt.NDArray[np.float64]) -> list[float]:
    """Root mean square, mean above its negative, and mean magnitude weighted by the place; of the finite ones."""
    values = np.where(np.isfinite(values), values, 0.0)
    rms = np.sqrt(np.mean(values**2))
    moments = (rms, rms + values.mean(), np.mean(np.abs(values) * np.linspace(0, 1, len(values))))
    return [float(f"{one:.6g}") for one in moments]


def without_hashes(text: str) -> str:
    """A text without the hashes of files, and of what a batch's folders depend on."""
    return re.sub(r"-[0-9a-f]{16}\b", "-KEY", re.sub(r"\b[0-9a-f]{64}\b", "SHA256", text))


def _frozen(value: Any, folder: str) -> Any:
    if isinstance(value, dict):
        kept = {name: one for name, one in value.items() if name not in PASSING}
        if isinstance(kept.get("files"), dict):
            kept["files"] = sorted(kept["files"])
        return {name: _frozen(one, folder) for name, one in kept.items()}
    if isinstance(value, list):
        return [_frozen(one, folder) for one in value]
    if isinstance(value, str):
        return without_hashes(value.replace(folder, "DIR"))
    return float(f"{value:.8g}") if isinstance(value, float) else value


def differences(expected: Any, got: Any, where: str = "") -> Iterator[str]:
    """Where two records differ by more than other processors may make them."""
    if isinstance(expected, dict) and isinstance(got, dict):
        for name in sorted({*expected, *got}):
            if name not in got or name not in expected:
                yield f"{where}/{name}: {'is new' if name in got else 'is gone'}"
                continue
            if name == "value" and _is_near(
                expected[name], got[name], OF_UNCERTAINTY * _number(expected, "uncertainty")
            ):
                continue
            yield from differences(expected[name], got[name], f"{where}/{name}")
    elif isinstance(expected, list) and isinstance(got, list) and len(expected) == len(got):
        for at, (one, other) in enumerate(zip(expected, got, strict=True)):
            yield from differences(one, other, f"{where}[{at}]")
    elif isinstance(expected, str) and isinstance(got, str):
        if not same_text(expected, got):
            yield f"{where}: {expected!r} became {got!r}"
    elif not _is_near(expected, got, 0.0):
        yield f"{where}: {expected!r} became {got!r}"


def _number(entry: dict[str, Any], name: str) -> float:
    value = entry.get(name)
    return float(value) if isinstance(value, int | float) else 0.0


def _is_near(expected: Any, got: Any, within: float) -> bool:
    if isinstance(expected, bool) or not (isinstance(expected, int | float) and isinstance(got, int | float)):
        return bool(expected == got)
    return abs(expected - got) <= max(RELATIVE * abs(expected), within, ABSOLUTE)


def same_text(expected: str, got: str) -> bool:
    """Whether two sentences have the same words, and numbers that differ in the last of their digits at most."""
    if NUMBER.split(expected) != NUMBER.split(got):
        return False
    pairs = zip(NUMBER.findall(expected), NUMBER.findall(got), strict=True)
    return all(abs(float(a) - float(b)) <= max(0.02 * abs(float(a)), _last_digit(a)) for a, b in pairs)


def _last_digit(number: str) -> float:
    digits, _, power = number.partition("e")
    return 1.01 * 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


class _Text(HTMLParser):
    """The text of a page, a line for each block, what is drawn left away."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = [""]
        self.unshown = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.unshown += tag in UNSHOWN
        if tag in BLOCKS:
            self.lines.append("")
        elif tag in ("td", "th"):
            self.lines[-1] += " | "

    def handle_endtag(self, tag: str) -> None:
        self.unshown -= tag in UNSHOWN

    def handle_data(self, data: str) -> None:
        if not self.unshown:
            self.lines[-1] += data


def page_text(path: Path, folder: Path) -> list[str]:
    """The words of a page, line by line."""
    parser = _Text()
    parser.feed(path.read_text(encoding="utf-8"))
    lines = (re.sub(r"\s+", " ", line).strip(" |") for line in parser.lines)
    told = (re.sub(r"\b[0-9a-f]{12,64}\b", "SHA256", line.replace(str(folder), "DIR")) for line in lines)
    return [line for line in told if line and not line.startswith(PASSING_LINES)]
