"""Text formats: numbers that no float or array takes are refused where they are read."""

import pytest

from procedures.outcome import BadInput
from procedures.reading.text import parse_json, parse_toml

WHOLE = 1 << 63


@pytest.mark.parametrize("number", [WHOLE - 1, -WHOLE])
def test_whole_numbers_of_64_bits_are_read(number):
    assert parse_json(f'{{"a": [{number}]}}'.encode(), "a.json", "") == {"a": [number]}
    assert parse_toml(f"a = [{number}]", "a.toml", "") == {"a": [number]}


@pytest.mark.parametrize("number", [WHOLE, -WHOLE - 1, 10**400])
def test_larger_whole_numbers_are_refused(number):
    with pytest.raises(BadInput, match=r"a\.json cannot be read as JSON: integers must have at most 64 bits"):
        parse_json(f'{{"a": [{number}]}}'.encode(), "a.json", "correct it")
    with pytest.raises(BadInput, match=r"a\.toml cannot be read as TOML: integers must have at most 64 bits"):
        parse_toml(f"[b]\na = [{{c = {number}}}]", "a.toml", "correct it")


@pytest.mark.parametrize("word", ["1e999", "-1e999", "NaN", "Infinity"])
def test_numbers_of_json_are_finite(word):
    with pytest.raises(BadInput, match=f"{word} is not a finite number"):
        parse_json(f'{{"a": {word}}}'.encode(), "a.json", "correct it")
