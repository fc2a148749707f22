"""station.toml before a device is made: type and range of every value, the line it stands on, and what to write."""

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
    """One station.toml: its devices' tables, the name it goes by, and the lines of its keys where it is a file."""

    def __init__(self, tables: Mapping[str, Any], file: str = "", lines: Mapping[Path, int] | None = None) -> None:
        self._tables = tables
        self._file = file
        self._lines = lines or {}

    def check(self) -> None:
        """Raises BadConfiguration about the first thing that is wrong."""
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
            self._refuse((name,), f"{_value(table)} is no table", f"begin one with [devices.{printable(name)}]")
        driver = table.get("driver")
        if not isinstance(driver, str) or driver not in driver_names():
            near = get_close_matches(str(driver), driver_names(), 1)
            known = f'write driver = "{near[0]}"' if near else f"use one of {', '.join(driver_names())}"
            missing = "it has no driver" if driver is None else f"there is no driver {_value(driver)}"
            self._refuse((name, "driver"), missing, known)
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
                known = [one for one in (*keys, *besides) if one]
                near = get_close_matches(key, known, 1)
                remedy = f"write {near[0]}" if near else f"use one of {', '.join(sorted(known))}"
                self._refuse((*path, key), f"{_value(table[key])} is given, and there is no such option", remedy)
        for key, option in keys.items():
            if key not in table:
                if option.required:
                    self._refuse(path, f"{key} is missing", f"write {key} = {option.rule.example}, for example")
            elif not option.rule.holds(table[key]):
                told = f"{_value(table[key])} is given, and it must be {option.rule.words}"
                self._refuse((*path, key), told, f"write {key} = {option.rule.example}, for example")

    def _check_axes(self, name: str, table: Mapping[str, Any], options: Options) -> None:
        assert options.rows is not None
        needed = ", ".join(f"{key} = {one.rule.example}" for key, one in options.rows.items() if one.required)
        example = f"write axes = [{{ {needed} }}], for example"
        axes = table.get("axes")
        if axes is None:
            self._refuse((name,), "axes is missing", example)
        if not isinstance(axes, list) or not axes or not all(isinstance(one, Mapping) for one in axes):
            told = f"{_value(axes)} is given, and it must be a list of tables with at least one axis"
            self._refuse((name, "axes"), told, example)
        for at, axis in enumerate(axes):
            self._check_keys((name, "axes", at), axis, options.rows, set())
        for keys in options.unlike:
            self._check_unlike(name, axes, keys)

    def _check_unlike(self, name: str, axes: list[Mapping[str, Any]], keys: tuple[str, ...]) -> None:
        seen = []
        for at, axis in enumerate(axes):
            mark = tuple(axis.get(key, 1) for key in keys)
            if mark in seen:
                told = ", ".join(f"{key} = {_value(value)}" for key, value in zip(keys, mark, strict=True))
                self._refuse(
                    (name, "axes", at, keys[0]), f"{told} is given to two axes", f"give each its own {keys[-1]}"
                )
            seen.append(mark)

    def _check_ports(self) -> None:
        owners: dict[str, str] = {}
        for name, table in self._tables.items():
            port = table.get("port")
            if port in owners:
                told = f"{_value(port)} is given to {owners[port]} already"
                self._refuse(
                    (name, "port"), told, "name another port; relays and lamps on a stage's controller use `on`"
                )
            if port is not None:
                owners[port] = name

    def _check_references(self, name: str) -> None:
        table = self._tables[name]
        for key, (drivers, kind) in REFERS.items():
            for one in named(table, key) if key in options_of(table["driver"]).keys else ():
                self._check_reference((name, key), one, drivers, kind)

    def _check_reference(self, path: tuple[str, str], one: str, drivers: tuple[str, ...], kind: str) -> None:
        other, given = self._tables.get(one), self._tables[path[0]][path[1]]
        if other is None or other["driver"] not in drivers:
            good = [name for name, its in self._tables.items() if its["driver"] in drivers]
            remedy = f"add a table of a {kind}: {', '.join(drivers)}"
            if good:
                remedy = f"write {path[1]} = {toml_value(good[:1] if isinstance(given, list) else good[0])}"
            missing = "there is no such device" if other is None else f"{one} is no {kind}"
            self._refuse(path, f"{_value(given)} is given, and {missing}", remedy)


def _shown(path: Path) -> str:
    """A place in the file: devices.stage.axes[1].feed_per_min, axes counted from 1."""
    text = ""
    for part in path:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{printable(part)}" if text else printable(part)
    return text


def _value(value: Any) -> str:
    """A value as it stands in the file, cut where it is long."""
    text = printable(toml_value(value))
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
