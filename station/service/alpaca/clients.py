"""The clients: which of them are connected to a device, and all that have sent requests, with their rights."""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from station.service.alpaca.protocol import as_alpaca


class ConnectedClients:
    """The clients of one device by ClientID, 0 for those without. Thread-safe. `connect` connects the hardware if
    necessary, and raises DeviceError or InUse."""

    def __init__(self, connect: Callable[[], None]) -> None:
        self._connect = connect
        self._lock = threading.Lock()
        self._clients: set[int] = set()
        self._connecting: dict[int, threading.Thread] = {}
        self._failures: dict[int, Exception] = {}

    def __contains__(self, client: int) -> bool:
        return client in self._clients

    def __len__(self) -> int:
        return len(self._clients)

    def add(self, client: int) -> None:
        """Connect for this client. Raises what `connect` does."""
        with self._lock:
            self._connect()
        self._clients.add(client)

    def remove(self, client: int) -> None:
        """Disconnect for this client."""
        self._clients.discard(client)

    def begin(self, client: int) -> None:
        """Connect for this client in a new thread; `connecting` raises its error."""
        if self._is_connecting(client):
            return
        self._failures.pop(client, None)
        thread = threading.Thread(target=self._add_beside, args=(client,), name="connect", daemon=True)
        self._connecting[client] = thread
        thread.start()

    def _add_beside(self, client: int) -> None:
        try:
            self.add(client)
        except Exception as error:  # raised when the client polls
            self._failures[client] = error

    def _is_connecting(self, client: int) -> bool:
        thread = self._connecting.get(client)
        return thread is not None and thread.is_alive()

    def connecting(self, client: int) -> bool:
        """Whether this client's connecting is in progress. Raises AlpacaError if it failed, once."""
        if self._is_connecting(client):
            return True
        self._connecting.pop(client, None)
        failure = self._failures.pop(client, None)
        if failure is not None:
            raise as_alpaca(failure)
        return False


MOST_LISTED = 64
"""Clients are listed by what they sent last: numbers of clients are invented by them."""


@dataclass(frozen=True)
class ClientEntry:
    """A client's last request, by the monotonic clock, and what it may do."""

    rights: str
    last_s: float


class ClientList:
    """The clients that have sent requests, by address and ClientID. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entries: dict[tuple[str, int], ClientEntry] = {}

    def note(self, host: str, client: int, rights: str) -> None:
        """Record a request."""
        with self._lock:
            self._entries.pop((host, client), None)  # the newest stands last
            self._entries[host, client] = ClientEntry(rights, time.monotonic())
            if len(self._entries) > MOST_LISTED:
                del self._entries[next(iter(self._entries))]

    def records(self, devices: Mapping[str, ConnectedClients]) -> list[dict[str, Any]]:
        """Each client with its rights, the devices that it has connected, and the time since its last request."""
        with self._lock:
            entries, now_s = list(self._entries.items()), time.monotonic()
        return [
            {
                "address": host,
                "client": client,
                "rights": entry.rights,
                "devices": [name for name, connected in devices.items() if client in connected],
                "last_request_s_ago": round(now_s - entry.last_s, 3),
            }
            for (host, client), entry in reversed(entries)
        ]
