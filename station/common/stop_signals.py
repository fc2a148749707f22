"""Ends a program that holds devices, by signals or exceptions: the bench stops first.

Python runs signal handlers in the main thread between two bytecodes, where a computation would delay the stop.
The stop is therefore made by a thread, which the system's own handler wakes through a socket.
"""

import gc
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

EXIT_DEVICE = 3
ENDING = tuple(getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT") if hasattr(signal, n))
"""Ctrl-C, termination by the system, a lost terminal or ssh connection, Ctrl-\\."""
SUSPENDING = tuple(getattr(signal, n) for n in ("SIGTSTP",) if hasattr(signal, n))
TURN_S = 0.0005
"""Switch interval of Python's lock, which delays the stop; the default is 5 ms."""
STOPPED_S = 1.0
"""How long the end of the program waits for a stop in progress."""
Handler = Callable[[int, FrameType | None], object]


@contextmanager
def guarded(
    emergency_stop: Callable[[], None], ask_to_stop: Callable[[], None], *, terminated: int = EXIT_DEVICE
) -> Iterator[None]:
    """Context in which INT, TERM, HUP, QUIT and any exception stop the bench at once; TSTP also, before suspension.

    `ask_to_stop` is called in the main thread after the first Ctrl-C, to end the current work; a second one raises
    KeyboardInterrupt. The other signals end the program with `terminated`. Loaded objects are frozen for the garbage
    collector, whose runs cannot be interrupted. Must be entered in the main thread;
    `emergency_stop` is called from another one, waits for no lock and never raises.
    """
    asked = ended = False

    def hear(number: int, frame: FrameType | None) -> None:
        nonlocal asked, ended
        if number != signal.SIGINT:
            ended = True
            raise SystemExit(terminated)
        if asked:
            raise KeyboardInterrupt
        asked = True
        ask_to_stop()

    with woken(emergency_stop), handled(hear), _stopped_before_suspended(emergency_stop), _short_turns():
        try:
            yield
            if ended:  # Python ignores errors in the finalizer in which the signal was heard
                raise SystemExit(terminated)
        except BaseException as error:
            emergency_stop()
            if ended:  # what a signal interrupts may fail otherwise, as a lock that is not held again yet
                raise SystemExit(terminated) from error
            raise


@contextmanager
def closed_whole(close: Callable[[], None]) -> Iterator[None]:
    """Context that ends with `close`, which further signals do not cut short: a lamp goes out. `guarded` is within."""
    with handled(lambda number, frame: None):
        try:
            yield
        finally:
            close()


@contextmanager
def handled(hear: Handler) -> Iterator[None]:
    """Context in which these signals are handled, except one ignored at start-up, as HUP under nohup."""
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
    """Context in which Ctrl-Z stops the bench before the program is suspended, as nobody would supervise an axis."""

    def hear(number: int, frame: FrameType | None) -> None:
        emergency_stop()
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)  # continues here after `fg`
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
    """Context in which a thread stops the bench on INT, TERM, HUP, QUIT and TSTP; leaving waits for a running stop."""
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
    gc.freeze()  # a collection of everything loaded would hold the lock for a tenth of a second
    before = sys.getswitchinterval()
    sys.setswitchinterval(TURN_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
