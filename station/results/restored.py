"""A restoration read back from its folder: verdict, depth and the sharp picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput, Cause, Verdict
from station.common.durable_files import read_own
from station.results.record_head import read_other_causes

RESTORATION = "station/restore/1"
"""The schema of its record."""
SHARP = "sharp.png"
LARGEST_BYTES = 400_000_000


@dataclass(frozen=True, eq=False)
class Restored:
    """A restoration as its folder tells it.

    Attributes
    ----------
    w : the least and the greatest blur of the map, with its unit, as a sentence; "" where it was refused
    sharp : (rows, columns) uint8 brightness; None where it was refused
    """

    verdict: Verdict
    reason: str
    remedy: str
    w: str = ""
    sharp: npt.NDArray[np.uint8] | None = None
    other_causes: tuple[Cause, ...] = ()


def read_restored(folder: Path, record: Mapping[str, Any]) -> Restored:
    """What the record and the picture beside it say. Raises BadInput."""
    try:
        verdict = Verdict(record.get("verdict", ""))
    except ValueError as error:
        raise BadInput(f"{folder} has no verdict", "recompute the session") from error
    told = (str(record.get("reason", "")), str(record.get("remedy", "")))
    others = read_other_causes(record)
    if verdict is Verdict.REFUSED:
        return Restored(verdict, *told, other_causes=others)
    return Restored(verdict, *told, _range_of(record.get("w")), _picture(folder / SHARP), others)


def _range_of(w: object) -> str:
    if not isinstance(w, dict) or not all(isinstance(w.get(end), int | float) for end in ("least", "greatest")):
        return ""
    return f"{w['least']:.4g} to {w['greatest']:.4g} {w.get('unit', '')}".strip()


def _picture(path: Path) -> npt.NDArray[np.uint8]:
    import cv2  # here: it is slow to load

    try:
        if path.lstat().st_size > LARGEST_BYTES:
            raise BadInput(f"{path} is larger than {LARGEST_BYTES} bytes", "recompute the session")
        data = read_own(path)
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error}", "recompute the session") from error
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
    if picture is None:
        raise BadInput(f"{path} is no picture", "recompute the session")
    return np.asarray(picture, dtype=np.uint8)
