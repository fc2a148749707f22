"""What a session's results are held to: the specification that it was begun with, kept in its frozen configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from procedures.budget import with_frequencies
from procedures.outcome import ProcedureError
from station.results.plane_result import PlaneResult, curves_of, numbers_of
from station.results.specification_file import parse_specification, specification_text
from station.results.terms import USUAL, Terms
from station.results.units import Pixels
from station.sessions.layout import read_config

KEY = "specification"


def frozen(path: Path) -> dict[str, str]:
    """A specification as a session freezes it. Raises BadParameter where it cannot be meant."""
    text = specification_text(path)
    parse_specification(text, str(path))
    return {"path": str(path), "text": text}


def terms_of_session(folder: Path) -> Terms:
    """What the results of a session are held to; the usual where it was begun without a specification."""
    config, _ = read_config(folder)
    told: Mapping[str, Any] = config.get("config", {}).get(KEY, {})
    if not isinstance(told, Mapping) or not isinstance(told.get("text"), str):
        return USUAL
    return Terms(specification=parse_specification(told["text"], str(told.get("path", ""))))


def in_terms(result: PlaneResult, terms: Terms, pixels: Pixels) -> PlaneResult:
    """A plane's result held to the terms, its MTF told at their frequencies as well; as it is where they say nothing.

    Where the limits' unit needs what is not known, they stay undecided and the reason is told with the verdict.
    """
    if not terms.specification.limits:
        return result
    try:
        at = terms.frequencies(pixels)
    except ProcedureError as error:
        return terms.undecided(result, error.reason)
    if result.psf is not None and result.quality is not None and at:
        quality = with_frequencies(result.quality, result.psf, at)
        numbers = dict(numbers_of(quality, result.pitch))
        result = replace(result, quality=quality, numbers=numbers, curves=curves_of(quality))
    return terms.told(result, pixels)
