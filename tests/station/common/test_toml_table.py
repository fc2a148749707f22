"""A table of TOML gives numbers of the kind that is asked for, or names the key."""

from __future__ import annotations

import pytest

from procedures.outcome import BadParameter
from station.common.toml_table import TomlTable


@pytest.mark.parametrize("text", [f"a = {10**400}", f"a = [{10**400}]"])
def test_a_whole_number_too_large_for_a_float_is_refused(text):
    with pytest.raises(BadParameter, match=r"p\.toml must be a TOML file: .* integers must have at most 64 bits"):
        TomlTable.parse(text, "p.toml")
