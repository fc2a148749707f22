"""The coach: previews while a person corrects a pose, until it was held for a moment."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from procedures.plan import Advice, Outline
from procedures.raw import RawFrame, read_frame

if TYPE_CHECKING:
    from drivers.interfaces import ExposedFile

HOLD_S = 3.0
"""Time for which a pose must be held within its tolerance."""
Ended = Callable[[bool], bool]
"""Whether to end, given whether the pose is within its tolerance now."""


def until_held(
    preview: Callable[[], RawFrame],
    check: Callable[[RawFrame], Advice],
    show: Callable[[RawFrame, Advice, float | None], None],
    held: Callable[[Advice], bool],
    ended: Ended,
    clock: Callable[[], float] = time.monotonic,
) -> bool:
    """Take previews and show each with the time left to hold the pose; False where it ended before that time.

    held : whether nothing is left to correct by hand
    """
    since_s: float | None = None
    while True:
        frame = preview()
        advice = check(frame)
        now_s = clock()
        good = held(advice)
        since_s = (now_s if since_s is None else since_s) if good else None
        left_s = None if since_s is None else max(HOLD_S - (now_s - since_s), 0.0)
        show(frame, advice, left_s)
        if left_s == 0.0:
            return True
        if ended(good):
            return False


RIGHT, LEFT, DOWN, UP = "→", "←", "↓", "↑"
LEAST_SHARE = 0.01
"""Offsets and changes of size below this share of the frame or the size are not mentioned."""
LEAST_TURN_DEG = 1.0
"""Nor are smaller turns in the frame."""


def ways(outline: Outline, shape: tuple[int, ...]) -> list[tuple[str, float]]:
    """The ways in which the subject must move in the frame, the farthest first, each with its share of that side."""
    shares = [side / n for side, n in zip(outline.arrow, (shape[1], shape[0]), strict=True)]
    arrows = [(RIGHT if shares[0] > 0 else LEFT, abs(shares[0])), (DOWN if shares[1] > 0 else UP, abs(shares[1]))]
    return sorted([arrow for arrow in arrows if arrow[1] >= LEAST_SHARE], key=lambda one: -one[1])


def way_words(outline: Outline, shape: tuple[int, ...]) -> str:
    """How the outline must change to match: "→ 12 % ↓ 3 % of the frame, 5 % larger"."""
    words = [f"{arrow} {100 * share:.0f} %" for arrow, share in ways(outline, shape)]
    parts = [f"{' '.join(words)} of the frame"] if words else []
    if outline.growth >= 2:
        parts.append(f"{outline.growth:.1f} times as large")
    elif abs(outline.growth - 1) >= LEAST_SHARE:
        parts.append(f"{100 * abs(outline.growth - 1):.0f} % {'larger' if outline.growth > 1 else 'smaller'}")
    if abs(outline.turn_deg) >= LEAST_TURN_DEG:
        parts.append(f"turned {'clockwise' if outline.turn_deg > 0 else 'counter-clockwise'}")
    return ", ".join(parts)


def preview_of(exposure: ExposedFile) -> RawFrame:
    """The frame of an exposure that is not a photograph of the session: its file is removed."""
    try:
        return read_frame(exposure.path)
    finally:
        for path in (exposure.path, *exposure.companions):
            path.unlink(missing_ok=True)
