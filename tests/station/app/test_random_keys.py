"""Whatever is typed: no crash, no move that was not confirmed, no second run."""

from __future__ import annotations

import pytest

from .random_keys import press_at_random


@pytest.fixture(autouse=True)
def _quick_reader(monkeypatch):
    """Who presses keys at random reads no faster or slower than is waited for."""
    monkeypatch.setattr("station.app.screens.parts.READ_S", 0.1)


@pytest.mark.parametrize("keys", [400, pytest.param(1500, marks=pytest.mark.slow)])
def test_random_keys_neither_crash_nor_move_nor_begin_two_runs(tmp_path, keys):
    seen = press_at_random(tmp_path, keys, keys)
    assert seen.wrong == []
    assert seen.runs > 2  # the keys did lead somewhere
    assert seen.moves > 2
