"""A server in a thread of its own, on a port that is reserved in advance."""

from __future__ import annotations

import errno
import socket
import threading
from dataclasses import dataclass

import uvicorn
from starlette.types import ASGIApp

from procedures.outcome import BadParameter
from station.service.connection_limits import ACCEPTED_AT_ONCE, LimitedConnection

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
        """Start answering."""
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
        self._thread = threading.Thread(target=self._serve, name="server", daemon=True)

    def _serve(self) -> None:
        self._server.run(sockets=[self.listening])

    @property
    def port(self) -> int:
        """The port it listens on."""
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
