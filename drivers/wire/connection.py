"""Common operations of drivers on their line: open it or leave it closed, identify devices, report its state."""

import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TextIO, TypeVar

from drivers.errors import Clock, DeviceError, LineLost, NoAnswer, SystemClock
from drivers.interfaces import Condition, Line, Transport

E = TypeVar("E")
T = TypeVar("T")
L = TypeVar("L", bound=Line)


def anything() -> None:
    """Allow every order: the default of `allowed`."""


@contextmanager
def opened(transport: Transport[E], listen: Callable[[E, float], None] = lambda event, host_s: None) -> Iterator[None]:
    """Open the line for the first requests; close it again if one of them fails."""
    transport.open(listen)
    try:
        yield
    except DeviceError:
        transport.close()
        raise


@contextmanager
def closed_after_errors(device: Any) -> Iterator[None]:
    """Close the line or device again if connecting it fails."""
    try:
        yield
    except BaseException:
        device.close()
        raise


def not_connected(address: str) -> LineLost:
    """The error for a request before `connect`."""
    return LineLost(f"{address} is not connected", "connect first")


def roll_call(numbers: Iterable[int], ask: Callable[[int], T], where: str, remedy: str) -> list[T]:
    """Identify every device of a shared line. Raises NoAnswer naming all that are missing.

    `where` is the port and the kind of devices: "/dev/ttyUSB0: no answer from devices".
    """
    answers, missing = [], []
    for number in dict.fromkeys(numbers):
        try:
            answers.append(ask(number))
        except NoAnswer:
            missing.append(str(number))
    if missing:
        raise NoAnswer(f"{where} {', '.join(missing)}", remedy)
    return answers


def line_condition(is_open: bool, word: str = "ready") -> Condition:
    """The condition of a device with or without its line."""
    return Condition(word) if is_open else Condition("not connected", False, "connect it")


class LineDevice(Generic[L]):
    """A driver that has a line: its address, its condition, and its release."""

    def __init__(self, line: L, clock: Clock | None = None) -> None:
        self.clock = clock or SystemClock()
        self._transport = line

    @property
    def address(self) -> str:
        return self._transport.address

    @property
    def _word(self) -> str:
        """The state while it is connected."""
        return "ready"

    def condition(self) -> Condition:
        """The state, or that it is not connected."""
        return line_condition(self._transport.is_open, self._word)

    def close(self) -> None:
        """Release the line; the device keeps its settings."""
        self._transport.close()


# --- The outgoing bytes of one port: orders in turn, and stops before all of them ---
# pyserial's own `write` cannot be cancelled when a port accepts nothing: it retries until its timeout, and
# what it then writes would follow the stop. Here no lock is held while waiting for a port with a descriptor.

WRITE_S = 1.0  # time limit for a port to accept bytes
URGENT_S = 0.03  # how long bytes that end a motion wait for a port before the driver stops by stronger means
STOP_TRIES = 6
"""How often a stop is offered to a port that takes no bytes, each time for `WRITE_S`: what moves goes on meanwhile."""
HELD_UP_S = 0.005  # how long a stop waits for an order that is being written to a port without a descriptor
GONE = (OSError, ValueError, TypeError, AttributeError)  # exceptions of ports that were unplugged or closed meanwhile


class Outgoing:
    """One port's outgoing bytes; thread-safe."""

    def __init__(self, port: Any) -> None:
        self._port = port
        self._turn = threading.Lock()
        self._wire = threading.Lock()  # from the check that an order is allowed until the port has it
        self._stops = 0

    def send(self, data: bytes, allowed: Callable[[], None] = anything, within_s: float = WRITE_S) -> None:
        """Write these bytes in turn. A stop that comes meanwhile drops the remainder.

        Raises what `allowed` raises, TimeoutError if the port takes no bytes `within_s`, OSError if it is gone.
        """
        deadline_s = time.monotonic() + within_s
        if not self._turn.acquire(timeout=within_s):
            raise TimeoutError(f"earlier bytes were not taken within {within_s:g} s")
        try:
            stops = self._stops
            rest = self._give(data, stops, allowed)
            while rest:
                if not _room(self._port, deadline_s):
                    self._drop_unsent()
                    raise TimeoutError(f"it took no bytes for {within_s:g} s")
                rest = self._give(rest, stops)
        finally:
            self._turn.release()

    def _give(self, data: bytes, stops: int, allowed: Callable[[], None] = anything) -> bytes:
        with self._wire:
            allowed()
            return _put(self._port, data) if self._stops == stops else b""

    def stop(self, data: bytes) -> bool:
        """Drop unsent bytes, then write these; returns whether the port accepted them. Never raises."""
        self._stops += 1
        held = self._wire.acquire(timeout=HELD_UP_S)
        try:
            self._drop_unsent()
            return any(self._stopped(data) for _ in range(STOP_TRIES))
        finally:
            if held:
                self._wire.release()

    def _stopped(self, data: bytes) -> bool:
        """Whether the port takes these bytes within `WRITE_S`; one that is clogged may take them later."""
        try:
            rest, deadline_s = _put(self._port, data), time.monotonic() + WRITE_S
            while rest and _room(self._port, deadline_s):
                rest = _put(self._port, rest)
            return not rest
        except GONE:
            return False

    def _drop_unsent(self) -> None:
        with suppress(Exception):  # a port that is gone, or one without a buffer
            self._port.reset_output_buffer()


def _put(port: Any, data: bytes) -> bytes:
    """Write without waiting if the port has a descriptor; returns the bytes not accepted."""
    descriptor = getattr(port, "fd", None)
    if descriptor is None:
        port.write(data)
        return b""
    try:
        return data[os.write(descriptor, data) :]
    except BlockingIOError:
        return data


def _room(port: Any, deadline_s: float) -> bool:
    """Wait until the port accepts bytes again; False if it did not by the deadline."""
    return bool(select.select([], [port.fd], [], max(deadline_s - time.monotonic(), 0.0))[1])


# --- Every byte on a line with its time: a ring buffer, and optionally a file ---


@dataclass(frozen=True, slots=True)
class TranscriptEntry:
    """Bytes on the line with time and direction.

    `>` to the device, `<` from it, `!` a stop ahead of the queue, `x` a stop that the port did not accept.
    """

    time_s: float
    way: str
    data: bytes

    def line(self) -> str:
        """One readable line: seconds, direction, bytes with escapes."""
        return f"{self.time_s:14.6f} {self.way} {self.data!r}"


class Transcript:
    """The last `length` entries, and all of them in `file` if given.

    If the file cannot be written, as on a full disk, it is abandoned: no line waits for it or fails because of it.
    """

    def __init__(self, length: int = 1000, file: Path | None = None) -> None:
        self._ring: deque[tuple[float, str, bytes]] = deque(maxlen=length)
        self._path = file
        self._file: TextIO | None = None
        self._waiting: deque[tuple[float, str, bytes]] = deque()
        self._lock = threading.Lock()

    def write_to(self, path: Path | None) -> None:
        """From now on, write to this file, or to none."""
        self.close()
        self._path = path

    def record(self, time_s: float, way: str, data: bytes) -> None:
        """Record bytes; from any thread, without waiting: a thread that is already writing takes them along."""
        entry = (time_s, way, data)
        self._ring.append(entry)
        if self._path is not None:
            self._waiting.append(entry)
            if self._lock.acquire(blocking=False):
                try:
                    self._write()
                finally:
                    self._lock.release()

    def _write(self) -> None:
        """Bring the file up to date."""
        try:
            while self._waiting and self._path is not None:
                if self._file is None:
                    self._file = self._path.open("a", encoding="utf-8", buffering=1)  # lines outlive the program
                self._file.write(TranscriptEntry(*self._waiting.popleft()).line() + "\n")
        except OSError:
            self._path = None
            self._waiting.clear()

    def last(self, n: int = 1000) -> list[TranscriptEntry]:
        """The newest `n` entries, oldest first."""
        return [TranscriptEntry(*entry) for entry in list(self._ring)[-n:]]

    def close(self) -> None:
        """Update the file and close it until the next record; the ring stays readable."""
        with self._lock, suppress(OSError):
            self._write()
            if self._file is not None:
                file, self._file = self._file, None
                file.close()


# --- Requests on a line whose replies carry no number ---
# A reply that comes late, or slips by one, would be taken for that to the next request. A request without a reply
# therefore leaves the line out of step: before the next one, a question whose reply differs from all others is given
# until it is answered. Devices answer in order, so that reply follows all older ones.

QUESTIONS = 12  # a device that lost a byte may need some questions to find a beginning again


class OutOfStep(Exception):
    """A reply is still owed: no request is allowed before the line is in step."""


@dataclass(frozen=True)
class StepQuestion(Generic[E]):
    """Bytes whose reply `recognise` accepts alone; `pad` precedes all but the first."""

    data: bytes
    recognise: Callable[[E], object | None]
    pad: bytes = b""


class InStepLine(Generic[E]):
    """Requests of one line; thread-safe. `owed` is the question of the device that owes a reply."""

    def __init__(self, transport: Transport[E], reply_s: float, questions: int = QUESTIONS) -> None:
        self._transport, self._reply_s, self._questions = transport, reply_s, questions
        self.owed: StepQuestion[E] | None = None

    def request(
        self, data: bytes, answer: Callable[[E], T | None], question: StepQuestion[E],
        allowed: Callable[[], None] = anything, tries: int = 1,
    ) -> T:  # fmt: skip
        """The reply to `data`; arguments and errors are those of a Transport."""
        while True:
            try:
                return self._ask(data, answer, question, allowed)
            except OutOfStep:
                self._step()
            except NoAnswer:
                if (tries := tries - 1) < 1:
                    raise

    def _ask(
        self, data: bytes, answer: Callable[[E], T | None], question: StepQuestion[E], allowed: Callable[[], None]
    ) -> T:
        def may_go() -> None:
            if self.owed is not None:
                raise OutOfStep
            allowed()
            self.owed = question

        def hear(event: E) -> T | None:
            value = answer(event)
            if value is not None:
                self.owed = None
            return value

        return self._transport.request(data, hear, self._reply_s, 1, may_go)

    def _step(self) -> None:
        """Bring the line in step again. Raises NoAnswer."""
        question = self.owed
        if question is None:
            return

        def hear(event: E) -> object | None:
            value = question.recognise(event)
            if value is not None and self.owed is question:
                self.owed = None
            return value

        for attempt in range(self._questions):
            with suppress(NoAnswer):
                self._transport.request(question.pad * bool(attempt) + question.data, hear, self._reply_s)
                return
        raise NoAnswer(f"{self._transport.address} does not answer {question.data!r}", "check power, cable, baud rate")
