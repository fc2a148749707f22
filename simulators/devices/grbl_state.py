"""What a simulated GRBL controller remembers: modes, planned lines, and what is going on."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

NEVER = float("inf")


@dataclass(frozen=True)
class Outputs:
    """What hangs on the controller's relay and spindle pins."""

    relay: Callable[[bool, float], None] = lambda on, now_s: None
    spindle: Callable[[float, float], None] = lambda level, now_s: None


@dataclass
class Modes:
    """G-code modes, as after a reset."""

    inches: bool = False
    relative: bool = False
    motion: int = 0
    feed: float = 0.0


@dataclass(frozen=True)
class Block:
    """One planned straight line, in machine space, mm/min."""

    target: tuple[float, ...]
    feed: float
    jog: bool


@dataclass(frozen=True)
class Sync:
    """A block that waits until the planner is empty: then outputs switch, then the dwell."""

    dwell_s: float
    switches: tuple[int, ...]
    speed: float


@dataclass
class Run:
    """What is going on: the line being driven, when it ends, what the main loop waits for."""

    state: str = "Alarm"
    hold: int = 0
    plan: deque[Block] = field(default_factory=deque)
    current: Block | None = None
    motion_end_s: float = NEVER
    busy_until_s: float = NEVER
    homing: bool = False
    sync: Sync | None = None
