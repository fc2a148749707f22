"""Everything stops: each device in a thread of its own, so that none waits for another's port; when each was told."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers.interfaces import Device
from drivers.wire.transcript import Transcript

PATIENCE_S = 0.25
"""How long a stop waits for ports that take nothing; their threads go on trying."""


@dataclass(frozen=True)
class Asked:
    """A stop was asked for at this time; `done` when every device was told, or is still being told."""

    at_s: float
    done: threading.Event = field(default_factory=threading.Event)


@dataclass(frozen=True)
class StopRequest:
    """One stop of the bench: when it was asked for, and when the stop bytes were on each wire; None: not yet."""

    asked_s: float
    wires: Mapping[str, float | None]

    def record(self) -> dict[str, Any]:
        """For the session's journal: times by the bench's clock, delays in milliseconds."""
        delays = {n: None if t is None else round(1000 * (t - self.asked_s), 3) for n, t in self.wires.items()}
        return {"asked_s": self.asked_s, "on_the_wire_s": dict(self.wires), "after_ms": delays}


def stop_all(devices: Iterable[Device]) -> None:
    """Stop these devices side by side, in this order where threads are slow to begin; from any thread."""
    threads = [threading.Thread(target=one.emergency_stop, name="stop", daemon=True) for one in devices]
    begun = [thread for thread in threads if _begin(thread)]  # each has mostly done its work when the next one begins
    for thread in begun:
        thread.join(PATIENCE_S / len(begun))


def _begin(thread: threading.Thread) -> bool:
    """Whether it runs: where there are no more threads, its work is done here."""
    try:
        thread.start()
    except RuntimeError:
        thread.run()
        return False
    return True


def stops_on_wires(asked: Sequence[Asked], transcripts: Mapping[str, Transcript]) -> list[StopRequest]:
    """These stops, once they are done, with when each wire took its bytes; wires that were told nothing are left out.

    The port of a wire that refused the bytes has None.
    """
    for stop in asked:
        stop.done.wait(2 * PATIENCE_S)
    return [StopRequest(stop.at_s, _sent(stop.at_s, transcripts)) for stop in asked]


def _sent(since_s: float, transcripts: Mapping[str, Transcript]) -> dict[str, float | None]:
    sent: dict[str, float | None] = {}
    for name, transcript in transcripts.items():
        tries = [one for one in transcript.last() if one.way in "!x" and one.time_s >= since_s]
        if tries:
            sent[name] = next((one.time_s for one in tries if one.way == "!"), None)
    return sent
