"""A serial line by pyserial URL, owned by one reader thread. The only import of `serial`.

A request holds the line from its first byte to its reply; every wait has a deadline. `preempt` bypasses both for
emergencies: unsent bytes are dropped, its own are written, and an order that is not `allowed` any
more when its turn comes is not written. A lost line is reopened only by its driver's `connect`, never
during a motion.
"""

import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any, Generic, TypeVar

import serial
from serial.tools import list_ports

from drivers.errors import Clock, DeviceError, LineLost, NoAnswer, SystemClock
from drivers.interfaces import Parser
from drivers.wire.connection import WRITE_S, Outgoing, Transcript, anything

E = TypeVar("E")
T = TypeVar("T")
PortBase = serial.SerialBase
PortError = serial.SerialException

BUSY_S = 2.0  # least time for which another's answer is awaited: a loaded computer may take a second
POLL_S = 0.25  # close() does not reliably end a blocking read, so reads are no longer than this
PORT_ERRORS = (serial.SerialException, OSError, ValueError, TypeError, AttributeError)  # observed on unplugged adapters


def register_scheme(package: str) -> None:
    """Let pyserial find the `protocol_<scheme>` modules of `package`, once."""
    if package not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append(package)


def resolve(address: str, ports: Callable[[], Iterable[Any]] = list_ports.comports) -> str:
    """The port behind `usb:SERIAL` or `usb:VID:PID:SERIAL`; any other address unchanged. Raises LineLost."""
    if not address.lower().startswith("usb:"):
        return address
    wanted = address.split(":")[1:]
    listed = list(ports())
    for port in listed:
        ids = [f"{port.vid or 0:04x}", f"{port.pid or 0:04x}", port.serial_number or ""]
        if [part.lower() for part in wanted] == [part.lower() for part in ids[-len(wanted) :]]:
            return str(port.device)
    there = ", ".join(f"{port.device} has {port.serial_number or 'no serial number'}" for port in listed) or "none"
    raise LineLost(
        f"no USB port has the serial number of {address} (ports: {there})", "plug it in, or correct the port"
    )


class SerialTransport(Generic[E]):
    """A line whose bytes are decoded by `parser()`."""

    def __init__(
        self, address: str, parser: Callable[[], Parser[E]], *, baud: int = 115200, clock: Clock | None = None,
        transcript: Transcript | None = None, dtr: bool | None = None, rts: bool | None = None,
    ) -> None:  # fmt: skip
        self.address = address
        self.baud = baud
        self.clock = clock or SystemClock()
        self.transcript = transcript or Transcript()
        self.bytes_received = 0
        self._new_parser = parser
        self._preset = {"dtr": dtr, "rts": rts}
        self._port: Any = None
        self._outgoing: Outgoing | None = None
        self._reader: threading.Thread | None = None
        self._news = threading.Condition()
        self._busy = False
        self._claim: Callable[[E], None] | None = None
        self._lost: DeviceError | None = None
        self._interrupts = 0
        self._interruption: Exception | None = None

    def open(self, listen: Callable[[E, float], None]) -> None:
        """Open the port; `listen(event, host_s)` is called by the reader for every event. Raises LineLost."""
        self.close()
        self._lost = None
        try:
            url = resolve(self.address)
            port = serial.serial_for_url(url, do_not_open=True)
            port.baudrate = self.baud
            port.timeout = POLL_S
            port.write_timeout = WRITE_S
            if "://" not in url:
                port.exclusive = True
            for line, level in self._preset.items():
                if level is not None:
                    setattr(port, line, level)
            port.open()
            self._port = port
        except PORT_ERRORS as error:
            raise LineLost(
                f"cannot open {self.address}: {error}",
                "plug the cable in, close other programs on this port, or correct its name",
            ) from error
        self._outgoing = Outgoing(self._port)
        self._reader = threading.Thread(
            target=self._read, args=(self._port, self._new_parser(), listen), name=f"reader {self.address}", daemon=True
        )
        self._reader.start()

    @property
    def is_open(self) -> bool:
        return self._port is not None and self._lost is None

    def close(self) -> None:
        """Release the port and end the reader thread."""
        port, self._port = self._port, None
        self._lose(port, LineLost(f"{self.address} is closed", "connect first"))
        if self._reader is not None and self._reader is not threading.current_thread():
            self._reader.join(timeout=2.0)
        self.transcript.close()

    def request(
        self, data: bytes, answer: Callable[[E], T | None], timeout_s: float, tries: int = 1,
        allowed: Callable[[], None] = anything,
    ) -> T:  # fmt: skip
        """Write `data` and wait for the first event for which `answer` returns a value; up to `tries` times.

        Only queries may be repeated: a repeated order is a second order. `allowed` is called at the last moment,
        when no `preempt` can intervene, and raises why the order may not be given any more.
        Raises NoAnswer, LineLost.
        """
        for _ in range(tries - 1):
            with suppress(NoAnswer):
                return self._request(data, answer, timeout_s, allowed)
        return self._request(data, answer, timeout_s, allowed)

    def _request(
        self, data: bytes, answer: Callable[[E], T | None], timeout_s: float, allowed: Callable[[], None]
    ) -> T:
        answers: list[T] = []

        def claim(event: E) -> None:
            value = None if answers else answer(event)
            if value is not None:
                answers.append(value)

        patience_s = max(timeout_s, BUSY_S)
        with self._news:
            if not self._wait(lambda: not self._busy, self.clock.now_s() + patience_s):
                raise NoAnswer(f"{self.address} is still busy after {patience_s:g} s", "wait, or stop the device")
            self._busy, self._claim, before, interrupts = True, claim, self.bytes_received, self._interrupts
        deadline_s = self.clock.now_s() + timeout_s
        try:
            self.write(data, allowed)
            with self._news:
                self._wait(lambda: bool(answers), deadline_s, interrupts)
        finally:
            with self._news:
                self._busy, self._claim = False, None
                self._news.notify_all()
        if not answers:
            raise self._silence(data, timeout_s, self.bytes_received - before)
        return answers[0]

    def _silence(self, data: bytes, timeout_s: float, received_bytes: int) -> NoAnswer:
        if received_bytes:
            remedy = "check baud rate and device type, then connect again"
            return NoAnswer(
                f"{self.address}: {received_bytes} bytes came within {timeout_s:g} s, but no answer to {data!r}", remedy
            )
        return NoAnswer(
            f"{self.address} did not answer {data!r} within {timeout_s:g} s",
            "check power and cable, then connect again",
        )

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until `ready()`, which is called after every event, or the timeout; returns its last value.

        Raises LineLost if the line is lost, and the error of a `preempt` that happens meanwhile.
        """
        with self._news:
            return self._wait(ready, self.clock.now_s() + timeout_s)

    def _wait(self, ready: Callable[[], bool], deadline_s: float, interrupts: int | None = None) -> bool:
        """Wait; with `interrupts` counted before, no interrupt since then is missed."""
        interrupts = self._interrupts if interrupts is None else interrupts
        self.clock.wait(
            self._news, lambda: self._lost is not None or self._interrupts != interrupts or ready(), deadline_s
        )
        if self._interrupts != interrupts and self._interruption is not None:
            raise self._interruption
        if self._lost is not None:
            raise self._lost
        return ready()

    def write(
        self, data: bytes, allowed: Callable[[], None] = anything, *, noted: bool = True, within_s: float = WRITE_S
    ) -> None:
        """Write without waiting for a reply; recorded in the transcript if `noted`.

        Raises LineLost, NoAnswer if the port takes no bytes `within_s`, and what `allowed` raises.
        """
        port, outgoing = self._port, self._outgoing
        if port is None or outgoing is None or self._lost is not None:
            raise self._lost or LineLost(f"{self.address} is not open", "connect first")

        def allowed_and_noted() -> None:
            allowed()
            if noted:
                self.transcript.record(self.clock.now_s(), ">", data)

        try:
            outgoing.send(data, allowed_and_noted, within_s)
        except (TimeoutError, serial.SerialTimeoutException) as error:  # keep it open: a stop must still get through
            raise NoAnswer(
                f"{self.address} took no bytes for {within_s:g} s", "check power, cable, handshake"
            ) from error
        except PORT_ERRORS as error:
            self._lose(port, self._gone(error))
            raise self._lost or self._gone(error) from error

    def preempt(self, data: bytes, error: Exception) -> None:
        """Write without waiting for any lock or queue, then end every wait with `error`; never raises.

        The transcript records when the port accepted the bytes (`!`), or that it did not (`x`).
        """
        outgoing = self._outgoing
        if outgoing is not None and data:
            way = "!" if outgoing.stop(data) else "x"
            self.transcript.record(self.clock.now_s(), way, data)
        self.interrupt(error)

    def interrupt(self, error: Exception) -> None:
        """End the waits of all other threads with `error`."""
        with self._news:
            self._interruption = error
            self._interrupts += 1
            self._news.notify_all()

    def set_lines(self, **lines: bool) -> None:
        """Set modem lines, `rts=` and `dtr=`. Raises LineLost."""
        port = self._port
        if port is None:
            raise LineLost(f"{self.address} is not open", "connect first")
        try:
            for line, level in lines.items():
                setattr(port, line, level)
        except PORT_ERRORS as error:
            raise LineLost(f"{self.address} has no modem lines: {error}", "use a port with RTS and DTR") from error

    def _read(self, port: Any, parser: Parser[E], listen: Callable[[E, float], None]) -> None:
        try:
            self._read_on(port, parser, listen)
        finally:  # end all waits, whatever the cause
            if self._port is port:
                self._lose(port, self._gone(RuntimeError("its reader has ended")))

    def _read_on(self, port: Any, parser: Parser[E], listen: Callable[[E, float], None]) -> None:
        while self._port is port:
            try:
                data = port.read(1)
                if data and (more := port.in_waiting):
                    data += port.read(more)
            except PORT_ERRORS as error:
                self._lose(port, self._gone(error))
                return
            if self._lost is not None:
                return
            if data:
                received_s = self.clock.now_s()
                self.transcript.record(received_s, "<", data)
                with self._news:
                    self.bytes_received += len(data)
                    for event in parser.feed(data):
                        listen(event, received_s)
                        if self._claim is not None:
                            self._claim(event)
                    self._news.notify_all()

    def _gone(self, error: Exception) -> LineLost:
        return LineLost(
            f"{self.address} went away: {error}", "plug the cable in, close other programs on this port, connect again"
        )

    def _lose(self, port: Any, error: DeviceError) -> None:
        with self._news:
            if self._lost is None:
                self._lost = error
            self._news.notify_all()
        if port is not None:
            with suppress(*PORT_ERRORS):
                port.cancel_read()
            socket = getattr(port, "_socket", None)  # pyserial does not close one whose peer has gone
            with suppress(*PORT_ERRORS):
                port.close()
            if socket is not None:
                socket.close()
