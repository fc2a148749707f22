"""Frozen records and pages: what differs from run to run is removed, numbers are compared within a tolerance."""

import csv
import json
import math
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

FROZEN = Path(__file__).with_name("frozen")
WHOLE = 16
"""Arrays of more numbers are frozen as their size and three sums."""

PASSING = ("arguments", "settings", "duration_s", "seconds", "software", "seal", "sha256", "record_sha256")
"""Entries of a record that say how, when, where and with what it was made."""
PASSING_LINES = ("time taken", "calibration-station")
RELATIVE, OF_UNCERTAINTY, ABSOLUTE = 4e-3, 0.02, 1e-7
"""How far numbers may differ: other processors, and the compiled loops, add single-precision numbers in another order.
One without AVX-512 moved a camera's pitch by 1.4e-3."""
OF_CHANGE = 1e-4
"""How far the changes of a restoration's iterations may differ, which go on where the rest has converged."""
BLOCKS = {"p", "li", "tr", "h1", "h2", "h3", "table", "section", "figure", "figcaption", "div", "dt", "dd", "title"}
UNSHOWN = {"style", "script", "svg"}
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def frozen_record(path: Path, folder: Path) -> Any:
    """A record without what differs from run to run; the names of its files are kept, their hashes are not."""
    return _frozen(json.loads(path.read_text(encoding="utf-8")), str(folder))


def frozen_file(path: Path, folder: Path) -> Any:
    """What a table or an array holds: its size, sums of its numbers, also weighted by their place, and one row."""
    if path.suffix == ".csv":
        head, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
        columns = {name: [_value(row[i]) for row in rows] for i, name in enumerate(head)}
        numeric = {
            one: column for one, column in columns.items()
            if column and all(isinstance(value, float) and math.isfinite(value) for value in column)
        }  # fmt: skip
        middle = [column[len(rows) // 2] for column in columns.values() if rows]
        return {"columns": head, "rows": len(rows), "middle": _frozen(middle, str(folder)),
                "sums": {one: _sums(np.array(column)) for one, column in numeric.items()}}  # fmt: skip
    array = np.load(path) if path.suffix == ".npy" else cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return {"kind": str(array.dtype), "sums": _sums(array)}


def _value(cell: str) -> float | str:
    try:
        return float(f"{float(cell):.6g}")
    except ValueError:
        return cell


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
            within = {"value": OF_UNCERTAINTY * _number(expected, "uncertainty"), "change": OF_CHANGE}
            if name in within and _is_near(expected[name], got[name], within[name]):
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
    stated = (re.sub(r"\b[0-9a-f]{12,64}\b", "SHA256", line.replace(str(folder), "DIR")) for line in lines)
    return [line for line in stated if line and not line.startswith(PASSING_LINES)]


def plain(value: Any) -> Any:
    """Any result as JSON has it."""
    if is_dataclass(value) and not isinstance(value, type):
        return {one.name: plain(getattr(value, one.name)) for one in fields(value) if not one.name.startswith("_")}
    if isinstance(value, dict):
        return {str(name): plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray):
        return [plain(one) for one in value] if value.size <= WHOLE else _sums(value)
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, float | np.floating):
        return float(f"{value:.8g}") if np.isfinite(value) else str(value)
    if isinstance(value, bool | np.bool_ | int | np.integer):
        return int(value)
    return str(value) if value is None or isinstance(value, str) else type(value).__name__


def _sums(array: Any) -> list[Any]:
    """Size of an array, number of its NaN, root of its mean square, and two sums that notice an exchange."""
    known = np.nan_to_num(np.abs(array) * np.exp(1j * np.angle(array))).ravel()
    whole = np.sqrt(np.mean(np.abs(known) ** 2)) or 1.0
    waves = [np.exp(1j * 2.4 * np.arange(known.size) ** power) for power in (0.9, 1.1)]
    sums = [float(np.abs(known @ one)) / known.size**0.5 for one in waves]
    # a sum far below the whole is a difference of large numbers: added to the whole, it is compared with it
    return [*array.shape, int(np.isnan(array).sum()), *(plain(float(whole + one)) for one in (0.0, *sums))]


def check_frozen(request: pytest.FixtureRequest, name: str, result: Any) -> None:
    """Compare a result with the kept one, or keep it."""
    found, kept = plain(result), FROZEN / f"{name}.json"
    if request.config.getoption("--freeze"):
        kept.write_text(json.dumps(found, ensure_ascii=False, separators=(",", ":")) + "\n", encoding="utf-8")
    changed = list(differences(json.loads(kept.read_text(encoding="utf-8")), found))
    assert not changed, changed
