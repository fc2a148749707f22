"""A line to TMCL modules: pytrinamic makes and reads the datagrams, a Transport carries them.

Datagrams have no numbers, so an answer that comes late would be taken for that to the next question; and nothing marks
where one begins, so a module that lost a byte, or that a stop found in the middle of an order, reads everything after
it wrongly, for as long as it is on. Therefore the line must be in step before anything is asked: after a question
without answer, and after a stop, the version is asked until it comes, each time one byte further on. Modules answer in
order: with that answer all older ones are past.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

from drivers.errors import BadConfiguration, NoAnswer, Rejected
from drivers.interfaces import Transport
from drivers.protocols.tmcl import COMMAND, DAMAGED, LENGTH, MODULE, OK, STATUS
from drivers.wire.connection import anything
from drivers.wire.outgoing import URGENT_S

REPLY_S, STEP_S = 0.3, 0.15
VERSION, VERSION_BINARY = 136, 1
PAD = b"\0"
"""Stands between datagrams to shift what a module reads: no command is 0, and no module has that address."""
REMEDIES = {
    2: "check the module's firmware",
    3: "check the number of the motor, and the module's firmware",
    4: "check what station.toml says of the axis",
    5: "unlock its memory",
    6: "check the module's firmware",
}


class OutOfStep(Exception):
    """An answer is still owed: nothing else may be asked before the line is in step."""


@dataclass(frozen=True, eq=False)
class Debt:
    """An answer that a module owes, or a state of its reading that nobody knows."""

    module: int


class TmclLink:
    """The modules of one line; from any thread.

    What each module owes stands in a set, as adding to it and taking from it wait for nobody. All modules read the same
    bytes: those that a cut order left out of step together are brought into step together.
    """

    def __init__(self, transport: Transport[bytes], modules: Iterable[int]) -> None:
        self._transport, self._modules = transport, tuple(modules)
        self._debts: set[Debt] = set()

    @property
    def address(self) -> str:
        """The port or URL."""
        return self._transport.address

    @property
    def is_open(self) -> bool:
        """Whether the port is owned and has not been lost."""
        return self._transport.is_open

    def open(self) -> None:
        """Own the port. Raises BadConfiguration without the library, LineLost."""
        library()
        self._owe_all()
        self._transport.open(lambda event, host_s: None)

    def close(self) -> None:
        """Give the port back."""
        self._transport.close()

    def host(self, allowed: Callable[[], None] = anything, tries: int = 1) -> Any:
        """The library's interface to these modules; `allowed` and `tries` are a Transport's, and so are the errors.

        What a module refuses raises Rejected.
        """
        return library().host(lambda data: self._carry(data, tries, allowed), self.address)

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> None:
        """Wait for something that changes by itself. Raises what interrupts it."""
        self._transport.wait(ready, timeout_s)

    # --- one question

    def _carry(self, data: bytes, tries: int, allowed: Callable[[], None]) -> bytes:
        """The answer to one datagram, sent when the line is in step."""
        while True:
            try:
                return self._ask(data, allowed)
            except OutOfStep:
                self._step(data[0])
            except NoAnswer:
                if (tries := tries - 1) < 1:
                    raise

    def _ask(self, data: bytes, allowed: Callable[[], None]) -> bytes:
        debt = Debt(data[0])

        def may_go() -> None:
            if self._owed_by(data[0]):
                raise OutOfStep
            allowed()
            self._debts.add(debt)

        def answer(frame: bytes) -> bytes | None:
            # an order that was damaged on its way was not obeyed, and counts as unanswered
            if (frame[MODULE], frame[COMMAND]) != (data[0], data[1]) or frame[STATUS] == DAMAGED:
                return None
            self._debts.discard(debt)
            return frame

        return self._transport.request(data, answer, REPLY_S, 1, may_go)

    def _owed_by(self, module: int) -> list[Debt]:
        return [debt for debt in tuple(self._debts) if debt.module == module]

    def _owe_all(self) -> None:
        self._debts.update(map(Debt, self._modules))

    def _step(self, module: int) -> None:
        """Bring module and line into step. Raises NoAnswer."""
        for attempt in range(LENGTH):
            with suppress(NoAnswer):
                self._ask_version(module, PAD * bool(attempt))
                return
        raise NoAnswer(
            f"{self.address}: no answer from module {module}", "check its power, cable, baud rate and address"
        )

    def _ask_version(self, module: int, before: bytes) -> None:
        """With its answer, all that was owed when it was asked is past."""
        paid: set[Debt] = set()

        def answer(frame: bytes) -> bytes | None:
            if (frame[MODULE], frame[STATUS], frame[COMMAND]) != (module, OK, VERSION):
                return None
            self._debts.difference_update(paid)
            return frame

        question = before + library().datagram(module, VERSION, VERSION_BINARY, 0, 0)
        self._transport.request(question, answer, STEP_S, 1, lambda: paid.update(self._owed_by(module)))

    # --- the stop

    def urge(self, stops: bytes) -> None:
        """Send these datagrams past the queue of requests. Raises LineLost, NoAnswer where the port takes none."""
        self._owe_all()
        self._transport.write(stops, within_s=URGENT_S)

    def shout(self, stops: bytes, error: Exception) -> None:
        """Send these datagrams past everything; what it cut off is put right before the next question. Never raises."""
        self._owe_all()
        self._transport.shout(stops, error)


def stop_bytes(motors: Iterable[tuple[int, int]]) -> bytes:
    """What stops these (module, motor), wherever in a datagram each module is.

    The stop may have cut an order off: a module that has some bytes of it would take the first of ours for its rest,
    and read all after it wrongly. So the stops come nine times, one byte further on each time; the first are right for
    a module that is in step, and one of the others is for any that is not. Nothing that is read wrongly is an order:
    what stands at the place of the command is then 0, or the checksum is wrong.
    A reference search is ended first: a motor that is only stopped is driven on by it.
    """
    make = library().datagram
    once = b"".join(make(module, 13, 1, motor, 0) + make(module, 3, 0, motor, 0) for module, motor in motors)
    return (once + PAD) * LENGTH


class _Library:
    """What is used of pytrinamic."""

    def __init__(self) -> None:
        try:
            from pytrinamic.connections.tmcl_interface import TmclInterface
            from pytrinamic.tmcl import TMCLCommand, TMCLReplyStatusError, TMCLRequest, TMCLStatus
        except ImportError as error:
            remedy = "install it: pip install 'calibration-station[tmcl]'"
            raise BadConfiguration("pytrinamic is not installed", remedy) from error

        class Host(TmclInterface):  # type: ignore[misc]
            """The library's interface over a line of ours."""

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
                    told = f"module {request.moduleAddress} at {self._address} refused {words(request)}: {reason}"
                    raise Rejected(told, REMEDIES.get(code, "see the module's manual"), str(code)) from error

        def words(request: Any) -> str:
            command = TMCLCommand.get_name(request.command)
            return f"{command} {request.commandType}, {request.motorBank}, {request.value}"

        self.host: Callable[[Callable[[bytes], bytes], str], Any] = Host
        self._request: Callable[..., Any] = TMCLRequest

    def datagram(self, module: int, command: int, kind: int, motor: int, value: int) -> bytes:
        """One order."""
        return bytes(self._request(module, command, kind, motor, value).to_buffer())


@cache
def library() -> _Library:
    """The library. Raises BadConfiguration where it is not installed."""
    return _Library()
