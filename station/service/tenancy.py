"""Exclusive use of the bench by a run, or a client's exposure or move. Queries and stops are always allowed."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from procedures.outcome import ProcedureError

Work = Callable[[], None]


class InUse(ProcedureError):
    """The bench is in use, or the requested operation is in progress."""

    exit_code = 75


class Tenancy:
    """The present user of the bench; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.tenant = ""
        """Its description; "" if none."""

    def take(self, tenant: str) -> None:
        """Reserve the bench until `leave`. Raises InUse."""
        with self._lock:
            if self.tenant:
                raise InUse(f"the bench is in use by {self.tenant}", "wait until that ends, or stop it")
            self.tenant = tenant

    def leave(self) -> None:
        with self._lock:
            self.tenant = ""

    @contextmanager
    def held(self, tenant: str) -> Iterator[None]:
        """Context in which the bench is reserved. Raises InUse."""
        self.take(tenant)
        try:
            yield
        finally:
            self.leave()

    def begin(self, tenant: str, work: Work) -> threading.Thread:
        """Run this in a new thread that reserves the bench. Raises InUse."""
        self.take(tenant)

        def run() -> None:
            try:
                work()
            finally:
                self.leave()

        thread = threading.Thread(target=run, name=tenant, daemon=True)
        thread.start()
        return thread
