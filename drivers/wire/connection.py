"""What every driver does with its line: open it or leave it closed, and say whether it is there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from drivers.errors import DeviceError
from drivers.interfaces import Condition, Transport

E = TypeVar("E")


def anything() -> None:
    """Allows every order: the usual `allowed`."""


@contextmanager
def opened(transport: Transport[E], listen: Callable[[E, float], None] = lambda event, host_s: None) -> Iterator[None]:
    """The line open for the first questions; closed again if one of them fails."""
    transport.open(listen)
    try:
        yield
    except DeviceError:
        transport.close()
        raise


def line_condition(is_open: bool, word: str = "ready") -> Condition:
    """`word` while the line is there."""
    return Condition(word) if is_open else Condition("not connected", False, "connect it")
