"""A server in a thread of its own, on a port that is reserved in advance."""

import asyncio
import errno
import socket
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import h11
import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from procedures.outcome import BadParameter
from station.service.access import answered_beyond_limits, refused

QUEUE = 1024
"""Connections queued by the system until they are accepted."""
ENDED_S = 3
"""How long shutting down waits for answers in progress."""


class PortTaken(BadParameter):
    """Another program listens on the port."""


def listen(host: str, port: int) -> socket.socket:
    """A listening socket; port 0 selects a free one. Raises BadParameter, PortTaken."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except socket.gaierror as error:
        reason = f"{host!r} is not an address of this machine: {error}"
        raise BadParameter(reason, "use 127.0.0.1 or 0.0.0.0") from error
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        if hasattr(socket, "SO_REUSEPORT"):  # POSIX: a port may be reused at once after its program ended
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen()
    except OSError as error:
        listening.close()
        raise bad_address(host, port, error) from error
    return listening


def bad_address(host: str, port: int, error: OSError) -> BadParameter:
    """The error for an address on which listening is impossible."""
    if error.errno == errno.EADDRINUSE:
        remedy = "end that program, or choose another port: --port 0 takes a free one"
        return PortTaken(f"port {port} of {host} is required, but another program uses it", remedy)
    reason = f"cannot listen on {host}, port {port}: {error.strerror}"
    return BadParameter(reason, "use an address of this machine, and a port above 1023")


class Server(uvicorn.Server):
    """A server that accepts few connections at once from a long queue."""

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        for listening in sockets or ():
            listening.listen(QUEUE)


@dataclass
class Hosting:
    """An application that is served until `end`."""

    app: ASGIApp
    listening: socket.socket
    closing: threading.Event

    def __post_init__(self) -> None:
        config = uvicorn.Config(
            self.app, log_config=None, access_log=False, lifespan="off", ws="none", server_header=False,
            timeout_graceful_shutdown=ENDED_S, http=LimitedConnection, backlog=ACCEPTED_AT_ONCE,
        )  # fmt: skip
        self._server = Server(config)
        self._thread = threading.Thread(target=partial(self._server.run, [self.listening]), name="server", daemon=True)

    @property
    def port(self) -> int:
        number: int = self.listening.getsockname()[1]
        return number

    def begin(self) -> None:
        """Start answering: earlier connections are queued by the system."""
        self._thread.start()

    def end(self) -> None:
        """Stop answering; streams end, and answers in progress are completed."""
        self.closing.set()
        self._server.should_exit = True
        self._thread.join(ENDED_S + 1)
        self.listening.close()


# A request is due from the connection, or the last answer, until it has arrived completely. A client whose request is
# overdue is disconnected; with too many connections, the one whose request has been due longest is replaced by the new
# one. Connections that are being answered stay; beyond the limit, only stops are answered.

REQUEST_S = 10.0
MOST, FEWEST = 320, 16
"""Largest number of connections, and if the system allows few open files."""
SHARE_OF_FILES = 3
"""Number of permitted open files per connection: the rest is for devices, sessions and photographs."""
FOR_STOPS = 32
"""Connections beyond the limit on which stops are answered."""
ACCEPTED_AT_ONCE = 32
"""Connections accepted before the excess ones are closed."""


def most_connections() -> int:
    """The number of connections permitted by the limit of open files."""
    try:
        from resource import RLIM_INFINITY, RLIMIT_NOFILE, getrlimit
    except ImportError:  # Windows
        return MOST
    files, _ = getrlimit(RLIMIT_NOFILE)
    return MOST if files == RLIM_INFINITY else max(FEWEST, min(MOST, files // SHARE_OF_FILES))


class LimitedConnection(H11Protocol):
    """One connection of a server, created by uvicorn."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn has it
        """A client connected."""
        super().connection_made(transport)
        self._expect_request()
        most = most_connections()
        if len(self.connections) <= most * 3 // 4:
            return
        everybody = [other for other in self.connections if isinstance(other, LimitedConnection)]
        neighbours = [other for other in everybody if other._address == self._address]
        if not (self._has_room(neighbours, most * 3 // 4) and self._has_room(everybody, most)):
            self.app = OnlyStops(self.app, most)
        if len(self.connections) > most + FOR_STOPS:
            self._disconnect()

    def connection_lost(self, exc: Exception | None) -> None:
        self._cancel_deadline()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if not self.owes_request:
            self._cancel_deadline()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        if self.owes_request:
            self._expect_request()

    @property
    def owes_request(self) -> bool:
        """Whether a request, or the rest of one, is due."""
        return self.conn.their_state in (h11.IDLE, h11.SEND_BODY)

    @property
    def due_s(self) -> float:
        """When its request is due, by the loop's clock."""
        return self._deadline.when() if self._deadline is not None else float("inf")

    def _expect_request(self) -> None:
        self._cancel_deadline()
        self._deadline = self.loop.call_later(REQUEST_S, self._disconnect)

    def _cancel_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _disconnect(self) -> None:
        self._cancel_deadline()
        self.connections.discard(self)
        self.transport.abort()

    @property
    def _address(self) -> str:
        return self.client[0] if self.client else ""

    def _has_room(self, crowd: "Iterable[LimitedConnection]", most: int) -> bool:
        """Whether at most this many are open, after closing the one whose request has been due longest."""
        others = [other for other in crowd if other is not self and other in self.connections]
        if len(others) < most:
            return True
        oldest = min((other for other in others if other.owes_request), key=lambda other: other.due_s, default=None)
        if oldest is not None:
            oldest._disconnect()
        return oldest is not None


class OnlyStops:
    """The application on a connection beyond the limit."""

    def __init__(self, app: ASGIApp, most: int) -> None:
        self._app, self._most = app, most

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if answered_beyond_limits(scope["path"]):
            await self._app(scope, receive, send)
            return
        reason = f"at most {self._most} connections are answered at a time, three quarters of them from one address"
        busy = refused(503, f"{reason}, and all are in use", "close some, or wait; stops are still answered")
        busy.headers["Connection"] = "close"
        await busy(scope, receive, send)
