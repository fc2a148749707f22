"""The part of JSON Schema (draft 2020-12) that the shipped schemas use, as a check that raises."""

import json
import re
from importlib.resources import files

TYPES = {"object": dict, "array": list, "string": str, "null": type(None), "integer": int, "number": (int, float)}
KNOWN = {
    *("$schema", "$defs", "$ref", "title", "type", "enum", "required", "properties", "patternProperties", "pattern"),
    *("additionalProperties", "propertyNames", "items", "minimum"),
}


def schema(name):
    return json.loads(files("station.results").joinpath("schemas", name).read_text(encoding="utf-8"))


def check(value, rule, whole, at="$"):
    """Raises AssertionError, naming the place, where a value does not follow a rule of a schema."""
    assert rule.keys() <= KNOWN, rule.keys() - KNOWN
    if "$ref" in rule:
        return check(value, whole["$defs"][rule["$ref"].rpartition("/")[2]], whole, at)
    if "type" in rule:
        kinds = [rule["type"]] if isinstance(rule["type"], str) else rule["type"]
        assert any(isinstance(value, TYPES[one]) for one in kinds), (at, value)
        assert not isinstance(value, bool), (at, value)
    if "enum" in rule:
        assert value in rule["enum"], (at, value)
    if isinstance(value, str) and "pattern" in rule:
        assert re.search(rule["pattern"], value), (at, value)
    if isinstance(value, int | float) and "minimum" in rule:
        assert value >= rule["minimum"], (at, value)
    if isinstance(value, list):
        for number, one in enumerate(value):
            check(one, rule.get("items", {}), whole, f"{at}[{number}]")
    if isinstance(value, dict):
        _object(value, rule, whole, at)
    return None


def _object(value, rule, whole, at):
    assert set(rule.get("required", ())) <= value.keys(), (at, set(rule["required"]) - value.keys())
    for name, one in value.items():
        check(name, rule.get("propertyNames", {}), whole, f"{at} key")
        own = [rule["properties"][name]] if name in rule.get("properties", {}) else []
        own += [found for pattern, found in rule.get("patternProperties", {}).items() if re.search(pattern, name)]
        for found in own or [rule.get("additionalProperties", {})]:
            check(one, found, whole, f"{at}.{name}")
