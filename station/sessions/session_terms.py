"""The terms of a session's results: unit and specification, from its frozen configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from procedures.budget import with_frequencies
from procedures.outcome import ProcedureError
from station.common.models import TableSource
from station.results.plane_result import PlaneResult, curves_of, numbers_of
from station.results.preferred_unit import unit_named
from station.results.specification_file import parse_specification, specification_text
from station.results.terms import USUAL, Terms
from station.results.units import Pixels, Unit
from station.sessions.layout import read_config

KEY = "specification"
UNIT = "unit"


def frozen(path: Path) -> dict[str, str]:
    """A specification as frozen in a session. Raises BadParameter if it is invalid."""
    text = specification_text(path)
    parse_specification(text, str(path))
    return {"path": str(path), "text": text}


def terms_of_session(folder: Path) -> Terms:
    """The terms of a session's results; the default ones if it was begun without any.

    Raises BadParameter if it names an invalid unit or specification.
    """
    config, _ = read_config(folder)
    frozen_config = config.get("config", {})
    unit = unit_named(frozen_config.get(UNIT, Unit.CYCLES), TableSource(places={UNIT: (f"{folder}, {UNIT}",)}))
    specification: Mapping[str, Any] = frozen_config.get(KEY, {})
    if not isinstance(specification, Mapping) or not isinstance(specification.get("text"), str):
        return USUAL if unit is Unit.CYCLES else Terms(unit)
    return Terms(unit, specification=parse_specification(specification["text"], str(specification.get("path", ""))))


def in_terms(result: PlaneResult, terms: Terms, pixels: Pixels) -> PlaneResult:
    """Express a plane's result in these terms, its MTF also at their frequencies; unchanged without terms.

    If the limits' unit requires an unknown quantity, they stay undecided and the verdict gives the reason; if
    the session's unit does, cycles per pixel are used.
    """
    terms = terms.with_known_unit(pixels)
    if not terms.specification.limits:
        return terms.apply(result, pixels)
    try:
        at = terms.frequencies(pixels)
    except ProcedureError as error:
        return terms.undecided(result, error.reason)
    if result.psf is not None and result.quality is not None and at:
        quality = with_frequencies(result.quality, result.psf, at)
        numbers = dict(numbers_of(quality, result.pitch))
        result = replace(result, quality=quality, numbers=numbers, curves=curves_of(quality))
    return terms.apply(result, pixels)
