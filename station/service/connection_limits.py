"""A server's connections are limited in number and time, so that a stop always gets through.

A client owes a request from its connection on, or from the last answer, until the request has arrived whole. Whoever
owes one for too long is disconnected, and where there are too many connections the one that has owed longest gives way
to the new one. Connections that are being answered stay; beyond the limit, only stops are answered.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any

import h11
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from station.service.access import answered_beyond_limits, refused

REQUEST_S = 10.0
"""How long a client may owe a request."""
MOST, FEWEST = 320, 16
"""Connections at the most, and where few files may be open."""
SHARE_OF_FILES = 3
"""One in so many of the files that this program may have open is a connection at the most: the rest is for devices,
sessions and photographs."""
FOR_STOPS = 32
"""Connections beyond the limit on which stops are answered."""
ACCEPTED_AT_ONCE = 32
"""Connections that are accepted before those too many are closed."""


def most_connections() -> int:
    """How many connections this program may have by the number of files that it may have open."""
    try:
        from resource import RLIM_INFINITY, RLIMIT_NOFILE, getrlimit
    except ImportError:  # Windows
        return MOST
    files, _ = getrlimit(RLIMIT_NOFILE)
    return MOST if files == RLIM_INFINITY else max(FEWEST, min(MOST, files // SHARE_OF_FILES))


class LimitedConnection(H11Protocol):
    """One connection of a server; uvicorn makes one for each that it accepts."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self._deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn has it
        """A client connected."""
        super().connection_made(transport)
        self._expect_request()
        self._find_room()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection has ended."""
        self._cancel_deadline()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """A part of a request came."""
        super().data_received(data)
        if not self.owes_request:
            self._cancel_deadline()

    def on_response_complete(self) -> None:
        """A request was answered."""
        super().on_response_complete()
        if self.owes_request:
            self._expect_request()

    @property
    def owes_request(self) -> bool:
        """Whether the client is to send a request, or the rest of one."""
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
        """End it at once; it counts no more."""
        self._cancel_deadline()
        self.connections.discard(self)
        self.transport.abort()

    def _find_room(self) -> None:
        """Let those give way that owe a request; where none does, answer only stops here."""
        most = most_connections()
        if len(self.connections) <= most * 3 // 4:
            return
        everybody = [one for one in self.connections if isinstance(one, LimitedConnection)]
        neighbours = [one for one in everybody if one._address == self._address]
        if not (self._has_room(neighbours, most * 3 // 4) and self._has_room(everybody, most)):
            self.app = OnlyStops(self.app, most)
        if len(self.connections) > most + FOR_STOPS:
            self._disconnect()

    @property
    def _address(self) -> str:
        return self.client[0] if self.client else ""

    def _has_room(self, crowd: Iterable[LimitedConnection], most: int) -> bool:
        """Whether at most so many of these are open, after the one that has owed its request longest was closed."""
        others = [one for one in crowd if one is not self and one in self.connections]
        if len(others) < most:
            return True
        oldest = min((one for one in others if one.owes_request), key=lambda one: one.due_s, default=None)
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
        busy = refused(503, f"{reason}, and all are in use", "close some, or wait; stops are answered all the same")
        busy.headers["Connection"] = "close"
        await busy(scope, receive, send)
