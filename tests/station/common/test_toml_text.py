import math
import tomllib
from datetime import UTC, datetime

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.common.toml_text import toml_text

texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
values = st.recursive(
    st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=12,
)


@pytest.mark.slow
@given(table=st.dictionaries(texts, values, max_size=4))
@settings(max_examples=150, deadline=None)
def test_what_is_written_is_read_back(table):
    assert tomllib.loads(toml_text(table)) == table


@pytest.mark.parametrize("text", ['"\n[evil]\nx = 1', "a\x00b", "\x1b[31m", "\x7f", "'''", '\\"', "\r\n", "\u2028"])
def test_no_text_leaves_its_quotes(text):
    assert tomllib.loads(toml_text({"camera": text, text: {"x": [text]}})) == {"camera": text, text: {"x": [text]}}


def test_what_toml_has_no_form_for_is_named_or_written_otherwise():
    assert tomllib.loads(toml_text({"name": "a\udcff"})) == {"name": "a?"}
    when = datetime(2026, 3, 14, 9, 26, 53, tzinfo=UTC)
    table = tomllib.loads(toml_text({"a": math.nan, "b": -math.inf, "when": when, "none": None}))
    assert math.isnan(table.pop("a"))
    assert table == {"b": -math.inf, "when": when}
    with pytest.raises(TypeError, match="no bytes"):
        toml_text({"a": b""})
