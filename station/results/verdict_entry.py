"""A verdict with its causes, as records hold it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from procedures.outcome import Cause, Judged


def verdict_entry(judged: Judged) -> dict[str, Any]:
    """Verdict, the most likely cause, and the other possible ones where there are some."""
    entry: dict[str, Any] = {"verdict": str(judged.verdict), "reason": judged.reason, "remedy": judged.remedy}
    return {**entry, **other_causes_entry(judged)}


def other_causes_entry(judged: Judged) -> dict[str, Any]:
    """The other possible causes alone; nothing where there are none."""
    return {"other_causes": [asdict(one) for one in judged.other_causes]} if judged.other_causes else {}


def read_other_causes(entry: Mapping[str, Any]) -> tuple[Cause, ...]:
    """The other possible causes that a record holds; earlier records have none."""
    found = entry.get("other_causes")
    causes = [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []
    return tuple(Cause(str(one.get("reason", "")), str(one.get("remedy", ""))) for one in causes)
