"""Temperature, humidity and other conditions during photographs, by probe, as an entry of a record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from procedures.reading.arrays import checked_number

ENVIRONMENT = "environment"
"""Entry of the state of devices at a photograph, and of records."""


def environment_of(snapshots: Iterable[Mapping[str, Any]]) -> dict[str, dict[str, Any]] | None:
    """The conditions over these photographs: by probe and quantity, mean and range; None without a probe.

    The uncertainty is the largest that the probe states for a reading.
    """
    entries: dict[str, dict[str, Any]] = {}
    for probe, name, readings in _readings(snapshots):
        values = [checked_number(one["value"], f"`value` of {name}") for one in readings]
        stated = [checked_number(u, f"`uncertainty` of {name}") for one in readings
                  if (u := one.get("uncertainty")) is not None]  # fmt: skip
        entries.setdefault(probe, {})[name] = {
            "value": float(np.mean(values)), "unit": str(readings[0]["unit"]),
            "uncertainty": max(stated, default=None), "min": min(values), "max": max(values), "n": len(values),
        }  # fmt: skip
    return entries or None


def _readings(snapshots: Iterable[Mapping[str, Any]]) -> list[tuple[str, str, list[Mapping[str, Any]]]]:
    grouped: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for snapshot in snapshots:
        for probe, quantities in snapshot.get(ENVIRONMENT, {}).items():
            for name, one in quantities.items():
                grouped.setdefault((str(probe), str(name)), []).append(one)
    return [(*key, readings) for key, readings in grouped.items()]


def temperature_during(snapshot: Mapping[str, Any]) -> float | None:
    """The temperature at a photograph in °C, of the first probe that measures it; None without one."""
    for quantities in snapshot.get(ENVIRONMENT, {}).values():
        if "temperature" in quantities:
            return checked_number(quantities["temperature"]["value"], "`value` of temperature")
    return None


def condition_words(entry: Mapping[str, Any]) -> str:
    """A quantity of the environment in words: its range, and its standard uncertainty."""
    low, high, unit, u = entry["min"], entry["max"], entry["unit"], entry["uncertainty"]
    digits = 2 if u is None else max(0, 1 - int(np.floor(np.log10(u)))) if u > 0 else 2
    texts = dict.fromkeys(f"{value:.{digits}f}" for value in (low, high))
    stated = "" if u is None else f", standard uncertainty {u:.{digits}f} {unit}"
    return f"{' to '.join(texts)} {unit}{stated}"
