"""In what terms a session's results are told: unit and specification that it was begun with, in what it has frozen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from procedures.budget import with_frequencies
from procedures.outcome import ProcedureError
from station.common.sanitise import printable
from station.results.plane_result import PlaneResult, curves_of, numbers_of
from station.results.preferred_unit import unit_named
from station.results.specification_file import parse_specification, specification_text
from station.results.terms import USUAL, Terms
from station.results.units import Pixels, Unit
from station.sessions.layout import read_config

KEY = "specification"
UNIT = "unit"


def frozen(path: Path) -> dict[str, str]:
    """A specification as a session freezes it. Raises BadParameter where it cannot be meant."""
    text = specification_text(path)
    parse_specification(text, str(path))
    return {"path": str(path), "text": text}


def terms_of_session(folder: Path) -> Terms:
    """What the results of a session are told in and held to; the usual where it was begun without either.

    Raises
    ------
    BadParameter
        If what it has frozen names no unit, or no specification.
    """
    config, _ = read_config(folder)
    frozen_config = config.get("config", {})
    unit = unit_named(str(frozen_config.get(UNIT, Unit.CYCLES)), f"{printable(folder)}, unit")
    specification: Mapping[str, Any] = frozen_config.get(KEY, {})
    if not isinstance(specification, Mapping) or not isinstance(specification.get("text"), str):
        return USUAL if unit is Unit.CYCLES else Terms(unit)
    return Terms(unit, specification=parse_specification(specification["text"], str(specification.get("path", ""))))


def in_terms(result: PlaneResult, terms: Terms, pixels: Pixels) -> PlaneResult:
    """A plane's result held to the terms, its MTF told at their frequencies as well; as it is where they say nothing.

    Where the limits' unit needs what is not known, they stay undecided and the reason is told with the verdict; where
    that of the session does, cycles per pixel are told.
    """
    terms = terms.tellable(pixels)
    if not terms.specification.limits:
        return terms.told(result, pixels)
    try:
        at = terms.frequencies(pixels)
    except ProcedureError as error:
        return terms.undecided(result, error.reason)
    if result.psf is not None and result.quality is not None and at:
        quality = with_frequencies(result.quality, result.psf, at)
        numbers = dict(numbers_of(quality, result.pitch))
        result = replace(result, quality=quality, numbers=numbers, curves=curves_of(quality))
    return terms.told(result, pixels)
