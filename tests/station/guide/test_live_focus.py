"""Sources of photographs for live focus, and its results."""

import itertools

import cv2
import numpy as np
import pytest

from procedures import BadInput, Chart
from station.guide.focus.live import POLL_S, SETTLE_S, UNREADABLE_AFTER_S, LiveFocus, PhotographSource

PICTURE = np.full((40, 60), 20000, np.uint16)


def source_of(looks: int) -> PhotographSource:
    """A source that ends after so many polls of the folder, a tenth of a second apart."""
    count = itertools.count()
    now = {"looks": 0}

    def ended() -> bool:
        now["looks"] = next(count)
        return now["looks"] >= looks

    return PhotographSource(ended, clock=lambda: now["looks"] / 10)


def test_only_new_photographs_are_reported_and_once(tmp_path):
    cv2.imwrite(str(tmp_path / "old.png"), PICTURE)

    def arrives(seconds: float) -> None:
        cv2.imwrite(str(tmp_path / "new.png"), PICTURE)

    frames = list(source_of(20).watched(tmp_path, arrives))
    assert [frame.path.name for frame in frames] == ["new.png"]
    assert frames[0].plane.value is not None


def test_a_new_file_is_polled_sooner(tmp_path):
    pauses = []

    def arrives(seconds: float) -> None:
        cv2.imwrite(str(tmp_path / "new.png"), PICTURE)
        pauses.append(seconds)

    assert len(list(source_of(5).watched(tmp_path, arrives))) == 1
    assert pauses[:3] == [POLL_S, SETTLE_S, POLL_S]


def test_an_incomplete_file_is_reported_with_its_reason(tmp_path):
    half = tmp_path / "half.png"
    whole = cv2.imencode(".png", PICTURE)[1].tobytes()
    frames = list(
        source_of(int(20 * UNREADABLE_AFTER_S)).watched(tmp_path, lambda s: half.write_bytes(whole[: len(whole) // 2]))
    )
    assert [frame.path for frame in frames] == [half]
    reading = LiveFocus(Chart.from_seed()).measure(frames[0])
    assert reading.sharpness.reason
    assert reading.best is None
    assert reading.say == "Focus by eye first."


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(BadInput, match="there is no folder"):
        next(source_of(3).watched(tmp_path / "none", lambda s: None))
