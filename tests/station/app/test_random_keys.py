"""Whatever is typed: no crash, no move that was not confirmed, no second run."""

from __future__ import annotations

import pytest

from .random_keys import press_at_random


@pytest.fixture(autouse=True)
def _in_haste(monkeypatch):
    """Keys come one after the other, whatever the screen still does; and a question is read as fast as they come."""
    monkeypatch.setattr("station.app.screens.parts.READ_S", 0.1)
    for name, wait_s in (("SLEEP_GRANULARITY", 0.002), ("SLEEP_IDLE", 0.001)):
        monkeypatch.setattr(f"textual._wait.{name}", wait_s)


@pytest.mark.slow
def test_random_keys_neither_crash_nor_move_nor_begin_two_runs(tmp_path):
    seen = press_at_random(tmp_path, 1500, 1500)
    assert seen.wrong == []
    assert seen.runs > 2  # the keys did lead somewhere
    assert seen.moves > 2
