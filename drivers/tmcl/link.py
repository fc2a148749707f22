"""A line to TMCL modules: pytrinamic encodes and decodes the datagrams, a Transport carries them.

Datagrams have no numbers, so a late answer would be taken for that to the next request; and nothing marks
their beginning, so a module that lost a byte, or whose order was cut off by a stop, misreads everything after it until
it is switched off. The line must therefore be synchronised before any request: after an unanswered request and after a
stop, the version is requested until it comes, shifted by one byte each time. Modules answer in order: that answer
follows all older ones.
"""

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

from drivers.errors import BadConfiguration, NoAnswer, Rejected
from drivers.interfaces import Transport
from drivers.wire.connection import WRITE_S, OutOfStep, anything

REPLY_S, STEP_S = 0.3, 0.15
VERSION, VERSION_BINARY = 136, 1
PAD = b"\0"  # sent between datagrams to shift the module's framing: no command is 0, and no module has that address
REMEDIES = {
    2: "check the module's firmware",
    3: "check the number of the motor, and the module's firmware",
    4: "check the axis in station.toml",
    5: "unlock its memory",
    6: "check the module's firmware",
}


@dataclass(frozen=True, eq=False)
class PendingReply:
    """An answer that a module still owes, or an unknown framing state of the module."""

    module: int


class TmclLink:
    """The modules of one line, as the line of a stage; thread-safe.

    Pending replies of each module are kept in a set, whose updates need no lock. All modules read the same
    bytes: those desynchronised together by a truncated order are synchronised together.
    """

    def __init__(self, transport: Transport[bytes], modules: Iterable[int]) -> None:
        self._transport, self._modules = transport, tuple(modules)
        self._pending: set[PendingReply] = set()

    @property
    def address(self) -> str:
        return self._transport.address

    @property
    def is_open(self) -> bool:
        return self._transport.is_open

    def open(self, listen: Callable[[bytes, float], None]) -> None:
        self._mark_all_pending()
        self._transport.open(listen)

    def close(self) -> None:
        self._transport.close()

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        return self._transport.wait(ready, timeout_s)

    def write(self, data: bytes, *, noted: bool = True, within_s: float = WRITE_S) -> None:
        """Send stops without queueing. Raises LineLost, NoAnswer if the port accepts none."""
        self._mark_all_pending()
        self._transport.write(data, noted=noted, within_s=within_s)

    def preempt(self, data: bytes, error: Exception) -> None:
        """Send stops ahead of every lock; the next request resynchronises the line. Never raises."""
        self._mark_all_pending()
        self._transport.preempt(data, error)

    def host(self, allowed: Callable[[], None] = anything, tries: int = 1) -> Any:
        """The library's interface to these modules; `allowed`, `tries` and the errors are those of a Transport.

        A refusal by a module raises Rejected.
        """
        return library().host(lambda data: self._carry(data, tries, allowed), self.address)

    # --- one request

    def _carry(self, data: bytes, tries: int, allowed: Callable[[], None]) -> bytes:
        """The answer to one datagram, sent when the line is synchronised."""
        while True:
            try:
                return self._ask(data, allowed)
            except OutOfStep:
                self._step(data[0])
            except NoAnswer:
                if (tries := tries - 1) < 1:
                    raise

    def _ask(self, data: bytes, allowed: Callable[[], None]) -> bytes:
        pending = PendingReply(data[0])

        def may_go() -> None:
            if self._pending_for(data[0]):
                raise OutOfStep
            allowed()
            self._pending.add(pending)

        def answer(frame: bytes) -> bytes | None:
            # an order with a transmission error was not executed, and counts as unanswered
            if (frame[MODULE], frame[COMMAND]) != (data[0], data[1]) or frame[STATUS] == DAMAGED:
                return None
            self._pending.discard(pending)
            return frame

        return self._transport.request(data, answer, REPLY_S, 1, may_go)

    def _pending_for(self, module: int) -> list[PendingReply]:
        return [pending for pending in tuple(self._pending) if pending.module == module]

    def _mark_all_pending(self) -> None:
        self._pending.update(map(PendingReply, self._modules))

    def _step(self, module: int) -> None:
        """Synchronise module and line. Raises NoAnswer."""
        for attempt in range(LENGTH):
            with suppress(NoAnswer):
                self._ask_version(module, PAD * bool(attempt))
                return
        raise NoAnswer(
            f"{self.address}: no answer from module {module}", "check its power, cable, baud rate and address"
        )

    def _ask_version(self, module: int, before: bytes) -> None:
        """Request the version: its answer follows every reply pending at the time of the request."""
        paid: set[PendingReply] = set()

        def answer(frame: bytes) -> bytes | None:
            if (frame[MODULE], frame[STATUS], frame[COMMAND]) != (module, OK, VERSION):
                return None
            self._pending.difference_update(paid)
            return frame

        question = before + library().datagram(module, VERSION, VERSION_BINARY, 0, 0)
        self._transport.request(question, answer, STEP_S, 1, lambda: paid.update(self._pending_for(module)))


def stop_bytes(motors: Iterable[tuple[int, int]]) -> bytes:
    """Bytes that stop these (module, motor), whatever the framing state of each module.

    The stop may have truncated an order: a module holding some of its bytes would complete it with the first of these,
    and misread everything after. The stops are therefore sent nine times, each time shifted by one byte: the first are
    right for a synchronised module, and one of the others for any other module. No misread datagram is an order:
    its command is then 0, or its checksum wrong.
    A reference search is ended first, since it would drive a stopped motor on.
    """
    make = library().datagram
    once = b"".join(make(module, 13, 1, motor, 0) + make(module, 3, 0, motor, 0) for module, motor in motors)
    return (once + PAD) * LENGTH


class _Library:
    def __init__(self) -> None:
        try:
            from pytrinamic.connections.tmcl_interface import TmclInterface
            from pytrinamic.tmcl import TMCLCommand, TMCLReplyStatusError, TMCLRequest, TMCLStatus
        except ImportError as error:
            remedy = "install it: pip install 'calibration-station[tmcl]'"
            raise BadConfiguration("pytrinamic is not installed", remedy) from error

        class Host(TmclInterface):  # type: ignore[misc]
            """The library's interface over our line."""

            def __init__(self, carry: Callable[[bytes], bytes], address: str) -> None:
                super().__init__()
                self._carry, self._address, self._order = carry, address, b""

            def _send(self, host_id: int, module_id: int, data: bytes) -> None:
                self._order = bytes(data)

            def _recv(self, host_id: int, module_id: int) -> bytes:
                return self._carry(self._order)

            def send_request(self, request: Any, *, no_reply: bool = False) -> Any:
                try:
                    return super().send_request(request, no_reply=no_reply)
                except TMCLReplyStatusError as error:
                    code = int(error.reply.status)
                    reason = f"status {code} ({TMCLStatus.get_name(code).lower()})"
                    message = f"module {request.moduleAddress} at {self._address} refused {words(request)}: {reason}"
                    raise Rejected(message, REMEDIES.get(code, "see the module's manual"), str(code)) from error

        def words(request: Any) -> str:
            command = TMCLCommand.get_name(request.command)
            return f"{command} {request.commandType}, {request.motorBank}, {request.value}"

        self.host: Callable[[Callable[[bytes], bytes], str], Any] = Host
        self._request: Callable[..., Any] = TMCLRequest

    def datagram(self, module: int, command: int, kind: int, motor: int, value: int) -> bytes:
        """Encode one order."""
        return bytes(self._request(module, command, kind, motor, value).to_buffer())


@cache
def library() -> _Library:
    """The library. Raises BadConfiguration if it is not installed."""
    return _Library()


# --- Datagrams of TMCL modules: nine bytes in each direction, the last one the sum of the others ---
# `host module status command value(4) checksum` is an answer, `module command type motor value(4) checksum` an order.
# Nothing marks the beginning of a datagram, and datagrams have no number.
# Source: TMCL firmware manuals, "binary command format" and "reply format".

LENGTH = 9
OK, LOADED, DAMAGED = 100, 101, 1  # statuses: done, stored for later, and wrong checksum of the order
STATUSES = frozenset({*range(1, 16), OK, LOADED})
MODULE, STATUS, COMMAND = 1, 2, 3  # byte positions in an answer


def checksum(body: bytes) -> int:
    """The sum of these bytes modulo 256."""
    return sum(body) & 0xFF


class TmclParser:
    """Bytes to datagrams with a valid checksum; at an invalid one it advances by one byte."""

    def __init__(self) -> None:
        self._received = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        self._received += data
        frames = []
        while len(self._received) >= LENGTH:
            frame = bytes(self._received[:LENGTH])
            good = frame[STATUS] in STATUSES and checksum(frame[:-1]) == frame[-1]
            if good:
                frames.append(frame)
            del self._received[: LENGTH if good else 1]
        return frames
