"""One at a time has the bench: a run, or a client's exposure or move. Asking is free, and so is stopping."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from procedures.outcome import ProcedureError

Work = Callable[[], None]


class InUse(ProcedureError):
    """Somebody else has the bench; or what is asked for is going on already."""

    exit_code = 75


class Tenancy:
    """Who has the bench now. Any thread may ask."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._tenant = ""

    @property
    def tenant(self) -> str:
        """In a few words; "" for nobody."""
        return self._tenant

    def take(self, tenant: str) -> None:
        """Have the bench until `leave`. Raises InUse."""
        with self._lock:
            if self._tenant:
                raise InUse(f"the bench is taken by {self._tenant}", "wait until that ends, or stop it")
            self._tenant = tenant

    def leave(self) -> None:
        """Let others have it."""
        with self._lock:
            self._tenant = ""

    @contextmanager
    def held(self, tenant: str) -> Iterator[None]:
        """Within, the bench is this tenant's. Raises InUse."""
        self.take(tenant)
        try:
            yield
        finally:
            self.leave()

    def begin(self, tenant: str, work: Work) -> threading.Thread:
        """Do this in a thread of its own that has the bench. Raises InUse."""
        self.take(tenant)

        def run() -> None:
            try:
                work()
            finally:
                self.leave()

        thread = threading.Thread(target=run, name=tenant, daemon=True)
        thread.start()
        return thread
