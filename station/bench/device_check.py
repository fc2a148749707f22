"""Checks of station.toml before a device is created: type and range of every value, its line, and a correction."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any, NoReturn

from drivers.errors import BadConfiguration
from station.bench.device_options import EITHER, REFERS, Option, Options, driver_names, named, options_of
from station.common.sanitise import printable
from station.common.toml_lines import Path, line_of
from station.common.toml_text import toml_value

LONGEST = 60


class TableCheck:
    """One station.toml: its devices' tables, its name, and the lines of its keys if it is a file."""

    def __init__(self, tables: Mapping[str, Any], file: str = "", lines: Mapping[Path, int] | None = None) -> None:
        self._tables = tables
        self._file = file
        self._lines = lines or {}

    def check(self) -> None:
        """Raises BadConfiguration about the first error."""
        for name, table in self._tables.items():
            self._check_device(name, table)
        self._check_ports()
        for name in self._tables:
            self._check_references(name)

    def _refuse(self, path: Path, reason: str, remedy: str) -> NoReturn:
        line = line_of(self._lines, ("devices", *path))
        place = f"{self._file}, line {line}: " if line else f"{self._file}: " if self._file else ""
        raise BadConfiguration(f"{place}{_shown(('devices', *path))}: {reason}", remedy)

    def _check_device(self, name: str, table: Any) -> None:
        if not isinstance(table, Mapping):
            self._refuse((name,), f"{_value(table)} is not a table", f"begin one with [devices.{printable(name)}]")
        driver = table.get("driver")
        if not isinstance(driver, str) or driver not in driver_names():
            near = get_close_matches(str(driver), driver_names(), 1)
            remedy = f'write driver = "{near[0]}"' if near else f"use one of {', '.join(driver_names())}"
            missing = "it has no driver" if driver is None else f"there is no driver {_value(driver)}"
            self._refuse((name, "driver"), missing, remedy)
        options = options_of(driver)
        listed = "axes" if options.rows is not None else None
        self._check_keys((name,), table, options.keys, {"driver", listed})
        if driver in EITHER and not any(key in table for key in EITHER[driver]):
            first, second = EITHER[driver]
            self._refuse((name,), f"it has neither {second} nor {first}", f'write {first} = "stage", or a {second}')
        if options.rows is not None:
            self._check_axes(name, table, options)

    def _check_keys(
        self, path: Path, table: Mapping[str, Any], keys: Mapping[str, Option], besides: set[str | None]
    ) -> None:
        for key in table:
            if key not in keys and key not in besides:
                names = [name for name in (*keys, *besides) if name]
                near = get_close_matches(key, names, 1)
                remedy = f"write {near[0]}" if near else f"use one of {', '.join(sorted(names))}"
                self._refuse((*path, key), f"{_value(table[key])} is given, and there is no such option", remedy)
        for key, option in keys.items():
            if key not in table:
                if option.required:
                    self._refuse(path, f"{key} is missing", f"write {key} = {option.rule.example}, for example")
            elif not option.rule.holds(table[key]):
                reason = f"{_value(table[key])} is given, but it must be {option.rule.words}"
                self._refuse((*path, key), reason, f"write {key} = {option.rule.example}, for example")

    def _check_axes(self, name: str, table: Mapping[str, Any], options: Options) -> None:
        assert options.rows is not None
        needed = ", ".join(f"{key} = {row.rule.example}" for key, row in options.rows.items() if row.required)
        example = f"write axes = [{{ {needed} }}], for example"
        axes = table.get("axes")
        if axes is None:
            self._refuse((name,), "axes is missing", example)
        if not isinstance(axes, list) or not axes or not all(isinstance(axis, Mapping) for axis in axes):
            reason = f"{_value(axes)} is given, but it must be a list of tables with at least one axis"
            self._refuse((name, "axes"), reason, example)
        for at, axis in enumerate(axes):
            self._check_keys((name, "axes", at), axis, options.rows, set())
        for keys in options.unlike:
            self._check_unlike(name, axes, keys)

    def _check_unlike(self, name: str, axes: list[Mapping[str, Any]], keys: tuple[str, ...]) -> None:
        marks = []
        for at, axis in enumerate(axes):
            mark = tuple(axis.get(key, 1) for key in keys)
            if mark in marks:
                values = ", ".join(f"{key} = {_value(value)}" for key, value in zip(keys, mark, strict=True))
                self._refuse(
                    (name, "axes", at, keys[0]), f"{values} is given to two axes", f"give each its own {keys[-1]}"
                )
            marks.append(mark)

    def _check_ports(self) -> None:
        owners: dict[str, str] = {}
        for name, table in self._tables.items():
            port = table.get("port")
            if port in owners:
                reason = f"{_value(port)} is already given to {owners[port]}"
                self._refuse(
                    (name, "port"), reason, "name another port; relays and lamps on a stage's controller use `on`"
                )
            if port is not None:
                owners[port] = name

    def _check_references(self, name: str) -> None:
        table = self._tables[name]
        for key, (drivers, kind) in REFERS.items():
            for other in named(table, key) if key in options_of(table["driver"]).keys else ():
                self._check_reference((name, key), other, drivers, kind)

    def _check_reference(self, path: tuple[str, str], name: str, drivers: tuple[str, ...], kind: str) -> None:
        other, given = self._tables.get(name), self._tables[path[0]][path[1]]
        if other is None or other["driver"] not in drivers:
            good = [name for name, its in self._tables.items() if its["driver"] in drivers]
            remedy = f"add a table of a {kind}: {', '.join(drivers)}"
            if good:
                remedy = f"write {path[1]} = {toml_value(good[:1] if isinstance(given, list) else good[0])}"
            missing = "there is no such device" if other is None else f"{name} is not a {kind}"
            self._refuse(path, f"{_value(given)} is given, but {missing}", remedy)


def _shown(path: Path) -> str:
    """A path in the file: devices.stage.axes[1].feed_per_min, axes counted from 1."""
    text = ""
    for part in path:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{printable(part)}" if text else printable(part)
    return text


def _value(value: Any) -> str:
    """A value as in the file, truncated if long."""
    text = printable(toml_value(value))
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
