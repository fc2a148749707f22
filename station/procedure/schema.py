"""The JSON schema of every procedure's record, generated from its settings and the table of numbers."""

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import msgspec

from procedures.numbers import NUMBERS
from procedures.outcome import BadParameter, Verdict
from station.procedure.base import Procedure
from station.results.comparison import Compliance
from station.results.measurement import BY_PLANE

DRAFT = "https://json-schema.org/draft/2020-12/schema"
NUMBER_OR_NULL = {"type": ["number", "null"]}
"""JSON null represents values that are not finite."""


def schema_of(procedure: Procedure[Any]) -> dict[str, Any]:
    """The schema (draft 2020-12) of a procedure's `result.json`."""
    (settings,), definitions = msgspec.json.schema_components(
        [procedure.Settings], schema_hook=lambda path: {"type": "string"}, ref_template="#/$defs/{name}"
    )
    results = {"type": "object", "additionalProperties": {"$ref": "#/$defs/plane"}}
    return {
        "$schema": DRAFT,
        "$id": f"urn:{procedure.schema.replace('/', ':')}",
        "title": f"result.json of {procedure.title}",
        "type": "object",
        "required": ["schema", "procedure", "input", "parameters", procedure.results_key, "software"],
        "properties": {
            "schema": {"const": procedure.schema},
            "procedure": {"const": procedure.record_name},
            "input": {"type": "array", "items": {"$ref": "#/$defs/input"}},
            "parameters": {"type": "object"},
            "arguments": {"type": "array", "items": {"type": "string"}},
            "settings": settings,
            procedure.results_key: results if procedure.results_key == BY_PLANE else {"$ref": "#/$defs/plane"},
            "left_out": {"type": "array", "items": {"$ref": "#/$defs/missed"}},
            "specification": {"$ref": "#/$defs/specification"},
            "software": {"type": "object"},
            "environment": {"$ref": "#/$defs/environment"},
            "duration_s": {"type": "number", "minimum": 0},
            "files": {"type": "object", "additionalProperties": {"$ref": "#/$defs/sha256"}},
            "sha256": {"$ref": "#/$defs/sha256"},
        },
        "$defs": {**definitions, **_definitions()},
    }


def limit_schema(more: Mapping[str, Any]) -> dict[str, Any]:
    """The schema of a limit, with these properties too."""
    text, bounds = {"type": "string"}, {"min": NUMBER_OR_NULL, "max": NUMBER_OR_NULL}
    texts, number = {"type": "array", "items": text}, {"type": "number"}
    known = {"number": text, **bounds, "coverage": number, "at": number, "planes": texts, "directions": texts}
    return {"type": "object", "required": ["number", *bounds], "properties": {**known, **more}}


def _definitions() -> dict[str, Any]:
    text, cause = {"type": "string"}, {"reason": {"type": "string"}, "remedy": {"type": "string"}}
    quantity = {
        "type": "object",
        "required": ["value", "unit", "uncertainty", "method", "n"],
        "properties": {
            "value": NUMBER_OR_NULL, "unit": text, "uncertainty": NUMBER_OR_NULL, "method": text,
            "n": {"type": "integer", "minimum": 0},
            "interval": {"type": "array", "items": NUMBER_OR_NULL, "minItems": 2, "maxItems": 2},
            "budget": {"type": "object", "additionalProperties": NUMBER_OR_NULL},
        },
    }  # fmt: skip
    judged = {"enum": [*Compliance, None]}
    limit = limit_schema({"verdict": judged, "place": text, "unit": text})
    reading = {"type": "object", "required": ["value", "unit", "uncertainty", "min", "max", "n"],
               "properties": {"value": NUMBER_OR_NULL, "unit": text, "uncertainty": NUMBER_OR_NULL}}  # fmt: skip
    return {
        "sha256": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
        "input": {"type": "object", "required": ["path", "sha256"],
                  "properties": {"path": text, "sha256": {"$ref": "#/$defs/sha256"}}},
        "missed": {"type": "object", "required": ["source", "reason", "remedy"],
                   "properties": {"source": text, **cause}},
        "quantity": quantity,
        "environment": {"type": "object", "additionalProperties": {"type": "object", "additionalProperties": reading}},
        "number": {"anyOf": [{"$ref": "#/$defs/quantity"}, NUMBER_OR_NULL, {"type": "array"}]},
        "specification": {"type": "object", "required": ["verdict", "limits"],
                          "properties": {"verdict": judged, "limits": {"type": "array", "items": limit}}},
        "plane": {
            "type": "object",
            "required": ["verdict", "reason", "remedy"],
            "properties": {
                "verdict": {"enum": [str(one) for one in Verdict]},
                **cause,
                "other_causes": {"type": "array", "items": {"type": "object", "required": ["reason", "remedy"],
                                                            "properties": cause}},
                "specification": {"$ref": "#/$defs/specification"},
                **{name: {"$ref": "#/$defs/number"} for name in NUMBERS},
            },
            "patternProperties": {"^(mtf_at|projection_uncertainty)_": {"$ref": "#/$defs/quantity"}},
        },
    }  # fmt: skip


# The procedures by name: the built-in ones, and those of installed packages (entry-point group `station.procedures`).
# Each is imported when it is asked for.

GROUP = "station.procedures"
BUILTIN: Mapping[str, str] = {
    "correct": "station.procedure.builtin.correct:Correct",
    "edge": "station.procedure.builtin.edge:SlantedEdge",
    "field": "station.procedure.builtin.field:Field",
    "geometry": "station.procedure.builtin.geometry:CameraGeometry",
    "pattern": "station.procedure.builtin.pattern:Pattern",
    "rays": "station.procedure.builtin.rays:Rays",
    "refocus": "station.procedure.builtin.refocus:Refocus",
    "restore": "station.procedure.builtin.restore:Restore",
    "rig": "station.procedure.builtin.rig:Rig",
    "sensor": "station.procedure.builtin.sensor:SensorCharacterisation",
    "series": "station.procedure.builtin.series:Series",
    "sharpen": "station.procedure.builtin.sharpen:Sharpen",
    "stability": "station.procedure.builtin.stability:StabilityOfPsf",
    "tilt": "station.procedure.builtin.tilt:TiltOfSensor",
    "two-photo": "station.procedure.builtin.two_photo:TwoPhoto",
    "vignetting": "station.procedure.builtin.vignetting:Vignetting",
    "witnessed": "station.procedure.builtin.witnessed:Witnessed",
}


@cache
def added() -> dict[str, EntryPoint]:
    """Procedures of installed packages."""
    return {point.name: point for point in entry_points(group=GROUP) if point.name not in BUILTIN}


def procedure_names() -> list[str]:
    """All names, the built-in ones first."""
    return [*BUILTIN, *added()]


def procedure_named(name: str) -> Procedure[Any]:
    """The procedure of that name. Raises BadParameter if it is unknown."""
    point = added().get(name)
    if name in BUILTIN:
        point = EntryPoint(name, BUILTIN[name], GROUP)
    if point is None:
        raise BadParameter(f"there is no procedure {name!r}", f"use one of {', '.join(procedure_names())}")
    return _loaded(point)


@cache
def _loaded(point: EntryPoint) -> Procedure[Any]:
    loaded: Any = point.load()
    procedure: Procedure[Any] = loaded() if isinstance(loaded, type) else loaded
    return procedure
