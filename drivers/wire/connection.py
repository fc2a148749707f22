"""What every driver does with its line: open it or leave it closed, ask who is there, and say whether it is open."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from drivers.errors import DeviceError, LineLost, NoAnswer
from drivers.interfaces import Condition, Transport

E = TypeVar("E")
T = TypeVar("T")


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


def not_connected(address: str) -> LineLost:
    """What is raised where nothing can be asked yet."""
    return LineLost(f"{address} is not connected", "connect first")


def roll_call(numbers: Iterable[int], ask: Callable[[int], T], where: str, remedy: str) -> list[T]:
    """What each of those that share a line tells of itself. Raises NoAnswer naming all that are missing.

    `where` is the port and what they are: "/dev/ttyUSB0: no answer from devices".
    """
    told, missing = [], []
    for number in dict.fromkeys(numbers):
        try:
            told.append(ask(number))
        except NoAnswer:
            missing.append(str(number))
    if missing:
        raise NoAnswer(f"{where} {', '.join(missing)}", remedy)
    return told


def line_condition(is_open: bool, word: str = "ready") -> Condition:
    """`word` while the line is there."""
    return Condition(word) if is_open else Condition("not connected", False, "connect it")
