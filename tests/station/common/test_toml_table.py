"""A table of TOML gives numbers of the kind that is asked for, or names the key."""

from __future__ import annotations

import pytest

from procedures.outcome import BadParameter
from station.common.toml_table import Table


@pytest.mark.parametrize("text", [f"a = {10**400}", f"a = [{10**400}]"])
def test_a_whole_number_too_large_for_a_float_is_refused(text):
    with pytest.raises(BadParameter, match=r"p\.toml must be a TOML file: .* whole numbers have up to 64 bits"):
        Table.parse(text, "p.toml")
