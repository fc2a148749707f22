"""Whatever is typed: no crash, no move that was not confirmed, no second run."""

import pytest

from .random_keys import press_at_random

SEED = 1


@pytest.mark.slow
@pytest.mark.parametrize("keys", [200, pytest.param(1500, marks=pytest.mark.nightly)])
def test_random_keys_neither_crash_nor_move_nor_begin_two_runs(tmp_path, keys):
    seen = press_at_random(tmp_path, SEED, keys)
    assert seen.wrong == []
    assert seen.runs >= max(keys // 500, 1)  # the keys did lead somewhere
    assert seen.moves >= keys // 500
