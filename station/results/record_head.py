"""Entries of records besides results: procedure, inputs, parameters, verdict with its causes."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from procedures.outcome import BadInput, Cause, Verdict, WithVerdict
from procedures.reading.arrays import checked_number


class ReadFile(Protocol):
    """A file that was read: a photograph, a frame of a session."""

    @property
    def path(self) -> Path | str:
        """Path of the file."""

    @property
    def sha256(self) -> str:
        """SHA-256 of its bytes."""


@dataclass(frozen=True)
class InputFile:
    """A file as a record names it."""

    path: str
    sha256: str


@dataclass(frozen=True)
class RecordHead:
    """The entries that the records of all procedures begin with.

    parameters : by name, as JSON has them: each procedure has its own, and a record is read by versions that know other
        ones
    arguments, settings : paths and settings as given, by which the result can be computed again
    specification, batch, field : entries of records that have them
    environment : readings of the bench's probes during the photographs, by probe and quantity
    duration_s : how long it took; None where the same files have to come of it again
    """

    procedure: str
    input: tuple[InputFile, ...] = ()
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    specification: Mapping[str, Any] | None = None
    batch: Mapping[str, Any] | None = None
    field: Mapping[str, Any] | None = None
    environment: Mapping[str, Any] | None = None
    duration_s: float | None = None
    arguments: Sequence[str] | None = None
    settings: Mapping[str, Any] | None = None

    def to_record(self) -> dict[str, Any]:
        entries = {
            "procedure": self.procedure,
            "input": [asdict(one) for one in self.input],
            "parameters": dict(self.parameters),
            "arguments": None if self.arguments is None else list(self.arguments),
            "settings": None if self.settings is None else dict(self.settings),
            **{name: getattr(self, name) for name in ("specification", "batch", "field", "environment", "duration_s")},
        }
        return {name: value for name, value in entries.items() if value is not None}


@dataclass(frozen=True)
class PartBeside:
    """A result in a folder beside a record: the verdict on it, and the file of it to look into first, "" for none.
    `used` is what the record's own numbers took from it, or why they took nothing; "" where they never do."""

    verdict: Verdict
    reason: str
    remedy: str
    look: str
    used: str = ""


def files_read(files: Sequence[ReadFile]) -> tuple[InputFile, ...]:
    """Files as a record names them. Raises BadInput for copies of one file, whose errors are not independent."""
    first: dict[str, ReadFile] = {}
    for file in files:
        if file.sha256 and (other := first.setdefault(file.sha256, file)) is not file:
            raise BadInput(f"inputs must differ; {file.path} has the content of {other.path}", "give it once")
    return tuple(InputFile(str(file.path), file.sha256) for file in files)


def verdict_entry(judged: WithVerdict) -> dict[str, Any]:
    """Verdict, the most likely cause, and the other possible ones where there are some."""
    entry: dict[str, Any] = {"verdict": str(judged.verdict), "reason": judged.reason, "remedy": judged.remedy}
    return {**entry, **other_causes_entry(judged)}


def other_causes_entry(judged: WithVerdict) -> dict[str, Any]:
    """The other possible causes alone; nothing where there are none."""
    return {"other_causes": [asdict(cause) for cause in judged.other_causes]} if judged.other_causes else {}


def read_other_causes(entry: Mapping[str, Any]) -> tuple[Cause, ...]:
    """The other possible causes that a record holds; earlier records have none."""
    entries = entry.get("other_causes")
    causes = [one for one in entries if isinstance(one, dict)] if isinstance(entries, list) else []
    return tuple(Cause(str(cause.get("reason", "")), str(cause.get("remedy", ""))) for cause in causes)


ENVIRONMENT = "environment"
"""Entry of the state of devices at a photograph, and of records."""


def environment_of(snapshots: Iterable[Mapping[str, Any]]) -> dict[str, dict[str, Any]] | None:
    """The conditions over these photographs: by probe and quantity, mean and range; None without a probe. The
    uncertainty is the largest that the probe states for a reading."""
    grouped: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for snapshot in snapshots:
        for probe, quantities in snapshot.get(ENVIRONMENT, {}).items():
            for name, quantity in quantities.items():
                grouped.setdefault((str(probe), str(name)), []).append(quantity)
    entries: dict[str, dict[str, Any]] = {}
    for (probe, name), readings in grouped.items():
        values = [checked_number(reading["value"], f"`value` of {name}") for reading in readings]
        stated = [checked_number(u, f"`uncertainty` of {name}") for reading in readings
                  if (u := reading.get("uncertainty")) is not None]  # fmt: skip
        entries.setdefault(probe, {})[name] = {
            "value": float(np.mean(values)), "unit": str(readings[0]["unit"]),
            "uncertainty": max(stated, default=None), "min": min(values), "max": max(values), "n": len(values),
        }  # fmt: skip
    return entries or None


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
