"""Whatever is typed: no crash, no move that was not confirmed, no second run."""

from __future__ import annotations

import pytest

from .random_keys import press_at_random


@pytest.mark.slow
def test_random_keys_neither_crash_nor_move_nor_begin_two_runs(tmp_path):
    seen = press_at_random(tmp_path, 1500, 1500)
    assert seen.wrong == []
    assert seen.runs > 2  # the keys did lead somewhere
    assert seen.moves > 2
