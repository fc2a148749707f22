"""Simulated cables on pseudo-terminals and TCP, for other programs, in real time only."""

import contextlib
import os
import select
import socket
import threading
import time
from collections.abc import Callable

from simulators.devices.serial_device import Cable

POLL_S = 0.25
HANGUP_S = 0.1


class Port:
    """A cable that other programs open at `address`, served by some threads."""

    address: str

    def __init__(self, cable: Cable, *works: Callable[[], None]) -> None:
        self._cable = cable
        self._closing = False
        self._threads = _start(*works)

    def end(self) -> None:
        self._closing = True
        self._cable.cancel_read()

    def close(self) -> None:
        """Wait for the threads, and release the address."""
        self.end()
        for thread in self._threads:
            thread.join(timeout=2.0)


class PtyPort(Port):
    """A cable on a pseudo-terminal without modem lines.

    The cable is opened when a program opens the terminal, and closed with it, which the master sees as a hangup.
    """

    def __init__(self, cable: Cable) -> None:
        import tty  # not available on Windows

        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.address = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._in_use = threading.Event()
        super().__init__(cable, self._from_host, self._to_host)

    def _from_host(self) -> None:
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        while not self._closing:
            happened = sum(event for _, event in poll.poll(1000 * POLL_S))
            if happened & select.POLLIN and self._in_use.is_set():  # including what was written before closing
                self._read()
            elif happened & select.POLLHUP:
                self._let_go()
                time.sleep(HANGUP_S)
            elif not self._in_use.is_set():
                self._take()
        self._let_go()

    def _read(self) -> None:
        """Pass what the host has written to the device."""
        with contextlib.suppress(OSError):
            self._cable.write(os.read(self._master, 4096))

    def _take(self) -> None:
        try:
            self._cable.open(self, self._cable.device.baud)
        except OSError:  # another program holds it
            time.sleep(HANGUP_S)
            return
        self._cable.set_lines(False, True)
        self._in_use.set()

    def _let_go(self) -> None:
        if self._in_use.is_set():
            self._in_use.clear()
            self._cable.close(self)
            self._cable.set_lines(False, False)

    def _to_host(self) -> None:
        while not self._closing:
            if self._in_use.wait(POLL_S):
                # without a reader, what does not fit is lost, as on a line
                with contextlib.suppress(OSError):
                    os.write(self._master, self._cable.read(self, 4096, POLL_S))

    def close(self) -> None:
        super().close()
        os.close(self._master)


class TcpPort(Port):
    """A cable on a TCP port of this machine, `socket://host:port`; one client at a time, each connection opens it."""

    def __init__(self, cable: Cable, host: str = "127.0.0.1") -> None:
        self._server = socket.create_server((host, 0))
        self._server.settimeout(POLL_S)
        self.address = "socket://{}:{}".format(*self._server.getsockname()[:2])
        super().__init__(cable, self._serve)

    def _serve(self) -> None:
        while not self._closing:
            try:
                client, _ = self._server.accept()
            except TimeoutError:
                continue
            with client:
                client.settimeout(POLL_S)
                with contextlib.suppress(OSError):  # in use, unplugged, or the client went away
                    self._bridge(client)

    def _bridge(self, client: socket.socket) -> None:
        self._cable.open(client, self._cable.device.baud)
        self._cable.set_lines(False, True)
        ended = threading.Event()

        def to_host() -> None:
            with contextlib.suppress(OSError):
                while not ended.is_set():
                    client.sendall(self._cable.read(client, 4096, POLL_S))

        (sender,) = _start(to_host)
        try:
            while not self._closing:
                with contextlib.suppress(TimeoutError):
                    data = client.recv(4096)
                    if not data:
                        return
                    self._cable.write(data)
        finally:
            ended.set()
            self._cable.close(client)
            self._cable.set_lines(False, False)
            sender.join(timeout=2.0)

    def close(self) -> None:
        super().close()
        self._server.close()


def _start(*works: Callable[[], None]) -> list[threading.Thread]:
    threads = [threading.Thread(target=work, name="simulated port", daemon=True) for work in works]
    for thread in threads:
        thread.start()
    return threads
