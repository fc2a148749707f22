"""Common operations of drivers on their line: open it or leave it closed, identify devices, report its state."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from drivers.errors import DeviceError, LineLost, NoAnswer
from drivers.interfaces import Condition, Transport

E = TypeVar("E")
T = TypeVar("T")


def anything() -> None:
    """Allow every order: the default of `allowed`."""


@contextmanager
def opened(transport: Transport[E], listen: Callable[[E, float], None] = lambda event, host_s: None) -> Iterator[None]:
    """Open the line for the first requests; close it again if one of them fails."""
    transport.open(listen)
    try:
        yield
    except DeviceError:
        transport.close()
        raise


def not_connected(address: str) -> LineLost:
    """The error for a request before `connect`."""
    return LineLost(f"{address} is not connected", "connect first")


def roll_call(numbers: Iterable[int], ask: Callable[[int], T], where: str, remedy: str) -> list[T]:
    """Identify every device of a shared line. Raises NoAnswer naming all that are missing.

    `where` is the port and the kind of devices: "/dev/ttyUSB0: no answer from devices".
    """
    answers, missing = [], []
    for number in dict.fromkeys(numbers):
        try:
            answers.append(ask(number))
        except NoAnswer:
            missing.append(str(number))
    if missing:
        raise NoAnswer(f"{where} {', '.join(missing)}", remedy)
    return answers


def line_condition(is_open: bool, word: str = "ready") -> Condition:
    """The condition of a device with or without its line."""
    return Condition(word) if is_open else Condition("not connected", False, "connect it")
