"""Whether two configurations open the same bench: the same devices, reached in the same way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

Tables = Mapping[str, Mapping[str, Any]]

WHICH = (
    "driver", "port", "server", "device", "switch", "camera", "model", "config", "folder", "on", "box", "shutter",
    "name", "letter", "axis", "motor", "module", "channel", "focuser", "part",
)  # fmt: skip
"""Keys of a device and of its axes that say which hardware it is; others set how it is used."""


def bench_differences(before: Tables, now: Tables) -> list[str]:
    """What is of another device, each difference in words; empty where both open the same bench."""
    old, new = dict(_which(before)), dict(_which(now))
    keys = dict.fromkeys([*old, *new])
    return [
        f"{key} was {old.get(key, 'absent')}, is {new.get(key, 'absent')}"
        for key in keys
        if old.get(key) != new.get(key)
    ]


def _which(tables: Tables) -> Iterator[tuple[str, str]]:
    for name, table in tables.items():
        rows = [("", table), *((f".axes[{n}]", row) for n, row in enumerate(table.get("axes", ()), 1))]
        for place, row in rows:
            for key in WHICH:
                if key in row:
                    yield f"devices.{name}{place}.{key}", repr(row[key])
