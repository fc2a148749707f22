"""How a program that holds devices is ended from outside, or by its own fault: the bench stops first.

Python runs signal handlers in the main thread, between two of its steps, and a computation there would delay the stop.
So a thread makes it that the system's own handler wakes through a socket, whatever the main thread is at.
"""

from __future__ import annotations

import gc
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

EXIT_DEVICE = 3
"""The exit code after an emergency stop."""
ENDING = tuple(getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT") if hasattr(signal, n))
"""Ctrl-C, the system's end, a terminal or an ssh line that is gone, Ctrl-\\."""
SUSPENDING = tuple(getattr(signal, n) for n in ("SIGTSTP",) if hasattr(signal, n))
"""Ctrl-Z."""
TURN_S = 0.0005
"""How long a thread may keep Python's lock while the stop waits for it; by default it is 5 ms."""
STOPPED_S = 1.0
"""How long the end of the program waits for a stop that is under way."""
Handler = Callable[[int, FrameType | None], object]


@contextmanager
def guarded(
    emergency_stop: Callable[[], None], ask_to_stop: Callable[[], None], *, terminated: int = EXIT_DEVICE
) -> Iterator[None]:
    """Within, INT, TERM, HUP, QUIT and any exception stop the bench, at once; and TSTP, before it suspends the program.

    `ask_to_stop` is called in the main thread after the first Ctrl-C, to end what runs there; a second one raises
    KeyboardInterrupt. The others end the program with `terminated`. What is loaded is no longer looked through for
    garbage: no thread can interrupt that. Must be entered in the main thread;
    `emergency_stop` is called from another one, waits for no lock and never raises.
    """
    asked = False

    def hear(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if number != signal.SIGINT:
            raise SystemExit(terminated)
        if asked:
            raise KeyboardInterrupt
        asked = True
        ask_to_stop()

    with woken(emergency_stop), handled(hear), _stopped_before_suspended(emergency_stop), _short_turns():
        try:
            yield
        except BaseException:
            emergency_stop()
            raise


@contextmanager
def handled(hear: Handler) -> Iterator[None]:
    """Within, these signals are heard; one that the program was started deaf to, as by nohup, is not."""
    before = {number: signal.getsignal(number) for number in ENDING}
    hup = getattr(signal, "SIGHUP", None)
    heard = [number for number in ENDING if not (number == hup and before[number] == signal.SIG_IGN)]
    for number in heard:
        signal.signal(number, hear)
    try:
        yield
    finally:
        for number in heard:
            signal.signal(number, before[number])


@contextmanager
def _stopped_before_suspended(emergency_stop: Callable[[], None]) -> Iterator[None]:
    """Within, Ctrl-Z stops the bench before the program is suspended: nobody would hear of an axis that goes on."""

    def hear(number: int, frame: FrameType | None) -> None:
        emergency_stop()
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)  # it goes on here when somebody says `fg`
        signal.signal(number, hear)

    heard = {number: signal.getsignal(number) for number in SUSPENDING}
    heard = {number: before for number, before in heard.items() if before != signal.SIG_IGN}
    for number in heard:
        signal.signal(number, hear)
    try:
        yield
    finally:
        for number, before in heard.items():
            signal.signal(number, before)


@contextmanager
def woken(emergency_stop: Callable[[], None]) -> Iterator[None]:
    """Within, a thread makes the stop that INT, TERM, HUP, QUIT and TSTP ask for; leaving waits for one under way."""
    ear, mouth = socket.socketpair()
    mouth.setblocking(False)

    def listen() -> None:
        while heard := ear.recv(64):
            if any(number in heard for number in (*ENDING, *SUSPENDING)):
                emergency_stop()

    thread = threading.Thread(target=listen, name="signals", daemon=True)
    thread.start()
    before = signal.set_wakeup_fd(mouth.fileno(), warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        mouth.close()
        thread.join(STOPPED_S)
        ear.close()


@contextmanager
def _short_turns() -> Iterator[None]:
    gc.freeze()  # looking for garbage among all that is loaded would hold the lock for a tenth of a second
    before = sys.getswitchinterval()
    sys.setswitchinterval(TURN_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
