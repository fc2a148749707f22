"""Runs that clients start, answer and stop, one at a time."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from procedures.outcome import BadParameter
from procedures.plan import Fact
from procedures.raw import Plane
from station.common.errors import ExplainedError
from station.guide.frontend import ProblemEvent
from station.guide.workspace import StationLab
from station.service.remote_operator import RemoteOperator, RunStatus
from station.service.tenancy import Tenancy

if TYPE_CHECKING:
    from station.guide.run import Run

LONGEST_SIDE = 800
LEAST_WHITE = 0.05
"""Lower limit of the white level: a frame with the lens cap on must not look like a picture."""
GAMMA = 2.2
QUALITY = 85


@dataclass(frozen=True)
class JpegPicture:
    """A JPEG file, its number since the start of the program, and its caption."""

    number: int
    jpeg: bytes
    caption: str


class LatestPicture:
    """The newest frame; encoded on request."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._plane: Plane | None = None
        self._encoded: JpegPicture | None = None
        self.number = 0

    def show(self, plane: Plane) -> None:
        """Set the newest frame. From any thread; returns at once."""
        with self._lock:
            self._plane, self._encoded, self.number = plane, None, self.number + 1

    def take(self) -> JpegPicture | None:
        """The newest picture, None before the first."""
        with self._lock:
            if self._encoded is None and self._plane is not None:
                rows, columns = self._plane.samples.shape
                caption = f"plane {self._plane.name}, {columns} x {rows} pixels"
                self._encoded = JpegPicture(self.number, jpeg_of(self._plane.samples), caption)
            return self._encoded


def jpeg_of(samples: npt.NDArray[np.float32]) -> bytes:
    """A linear plane (rows, columns) as a JPEG, its brightest parts white, no side above LONGEST_SIDE."""
    rows, columns = samples.shape
    scale = min(1.0, LONGEST_SIDE / max(rows, columns))
    size = (max(1, round(columns * scale)), max(1, round(rows * scale)))
    small = cv2.resize(samples, size, interpolation=cv2.INTER_AREA)
    white = max(float(np.percentile(small, 99.5)), LEAST_WHITE)
    levels = np.clip(small / white, 0.0, 1.0) ** (1 / GAMMA) * 255
    _, data = cv2.imencode(".jpg", levels.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(data)


@dataclass(frozen=True)
class RunOrder:
    """The run to start; with `by_default`, questions that need no person are answered by defaults."""

    plan: str
    camera: str
    lens: str
    answers: Mapping[str, Fact] = field(default_factory=dict)
    by_default: bool = False


def read_order(data: Any, names: tuple[str, str]) -> RunOrder:
    """Parse a client's order; camera and lens are `names` if it gives none. Raises BadParameter."""
    from station.guide.catalogue import DEFAULT

    remedy = 'send {"plan": "pattern", "camera": "...", "lens": "...", "answers": {}, "by_default": false}'
    text, table, flag = (str, "text"), (dict, "an object"), (bool, "true or false")
    kinds: dict[str, tuple[type, str]] = {
        "plan": text, "camera": text, "lens": text, "answers": table, "by_default": flag
    }  # fmt: skip
    if not isinstance(data, Mapping):
        raise BadParameter("a run is started by a JSON object; something else was sent", remedy)
    for name, value in data.items():
        if name not in kinds:
            raise BadParameter(f"a run's order has no {name!r}", remedy)
        kind, words = kinds[name]
        if not isinstance(value, kind):
            raise BadParameter(f"{name!r} must be {words}; got {json.dumps(value)}", remedy)
    answers = data.get("answers", {})
    if wrong := [key for key, value in answers.items() if not isinstance(value, str | int | float | bool)]:
        raise BadParameter(f"the answers to {', '.join(wrong)} must be text, a number, true or false", remedy)
    about = {"plan": DEFAULT, "camera": names[0], "lens": names[1], **data}
    return RunOrder(about["plan"], about["camera"], about["lens"], answers, about.get("by_default", False))


class Runs:
    """The runs of one lab; thread-safe."""

    def __init__(self, lab: StationLab, tenancy: Tenancy, picture: LatestPicture) -> None:
        self._lab, self._tenancy, self._picture = lab, tenancy, picture
        self._operator: RemoteOperator | None = None
        self._running: Run | None = None
        self._thread: threading.Thread | None = None
        self._failed = ""
        self._stops = 0

    @property
    def status(self) -> RunStatus | None:
        """The status of the run started last; None before the first."""
        if self._operator is None:
            return None
        status = self._operator.status
        return replace(status, ended="failed", trouble=ProblemEvent(self._failed, "")) if self._failed else status

    def start(self, order: RunOrder) -> None:
        """Start a run in a new session. Raises ProcedureError, InUse if the bench is taken."""
        from station.guide.catalogue import entry_named

        entry_named(order.plan)
        stops = self._stops
        self._tenancy.take(f"a run of the plan {order.plan}")
        try:
            operator = RemoteOperator(order.answers, order.by_default, self._picture.show)
            running = self._lab.begin(order.plan, order.camera, order.lens, operator)
        except BaseException:
            self._tenancy.leave()
            raise
        self._operator, self._running, self._failed = operator, running, ""
        if self._stops != stops:  # it was stopped while its session was created
            running.stop_now()
            operator.stop()
        self._thread = threading.Thread(target=self._go, args=(running,), name="run", daemon=True)
        self._thread.start()

    def _go(self, running: Run) -> None:
        try:
            running.go()
        except Exception as error:  # any error is reported to the client as a sentence
            self._failed = error.reason if isinstance(error, ExplainedError) else f"{type(error).__name__}: {error}"
        finally:
            self._tenancy.leave()

    def end(self) -> None:
        """End the run after this exposure or move; an open question is no longer answered."""
        if self._running is not None:
            self._running.ask_to_stop()
        self._silence()

    def stop(self) -> None:
        """Stop every device at once, in the same way as signals, and end any run. Never raises."""
        self._stops += 1
        self._lab.stop_run()
        self._silence()

    def _silence(self) -> None:
        if self._operator is not None:
            self._operator.stop()

    def reply(self, key: str, words: str) -> None:
        """Answer the run's open question. Raises BadParameter."""
        if self._operator is None:
            raise BadParameter(f"an answer to {key!r} was sent, but no run was started", "start one first")
        self._operator.reply(key, words)

    def wait(self, timeout_s: float) -> None:
        """Wait for the end of the run, at most this long."""
        if self._thread is not None:
            with suppress(RuntimeError):
                self._thread.join(timeout_s)
