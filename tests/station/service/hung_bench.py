"""A bench behind pseudo-terminals whose controllers hang on request, and requests that wait for their answers."""

import itertools
import os
import select
import socket
import time
from contextlib import contextmanager, suppress

from simulators.bench.bench import Setup, SimulatedBench
from simulators.devices.ports import PtyPort
from station.bench.opening import make_bench, simulated_tables
from station.guide.workspace import StationLab

SPEED = 20.0
"""How much faster than real the axes move; the drivers keep real time."""
PORTS = ("stage", "head", "shutter", "imu", "fast_imu", "rangefinder", "light", "room")


class HangingPort(PtyPort):
    """A controller that hangs on request: it answers nothing ("silent"), or it reads nothing either ("clogged")."""

    def __init__(self, cable):
        self.hangs = ""
        super().__init__(cable)

    def _read(self):
        if self.hangs == "clogged":
            time.sleep(0.001)
            return
        with suppress(OSError):
            data = os.read(self._master, 4096)
            if not self.hangs:
                self._cable.write(data)

    def hang(self, how):
        """Hang; the terminal of a clogged one takes no byte more."""
        self.hangs = how
        terminal = os.open(self.address, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        for size in (512, 1, 512, 1) if how == "clogged" else ():  # the system makes some more room after a moment
            with suppress(BlockingIOError):
                while True:
                    os.write(terminal, b"x" * size)
            time.sleep(0.02)
        os.close(terminal)


class HungLab(StationLab):
    """The lab of such a bench."""

    def _make_bench(self):
        folder = self.sessions.parent / "incoming"
        folder.mkdir()
        self.truth = SimulatedBench(folder, Setup(develop=lambda opening: b"", speed=SPEED))
        self.ports = {name: HangingPort(self.truth.cables[name]) for name in PORTS}
        tables = simulated_tables(lambda name: self.ports[name].address, folder)
        return make_bench(tables, folder=folder)

    def hang(self, how):
        """Let every controller hang."""
        for port in self.ports.values():
            port.hang(how)

    def close(self):
        super().close()
        for port in self.ports.values():
            port.end()
        for port in self.ports.values():
            port.close()
        self.truth.close()


class Pending:
    """Requests whose answers are waited for."""

    def __init__(self, client):
        self._client, self._sockets = client, []

    def fill(self, number, paths):
        """Let so many requests wait, to these paths in turn."""
        for path in itertools.islice(itertools.cycle(paths), number - self.count()):
            opened = socket.create_connection(("127.0.0.1", self._client.port))
            words = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {self._client.token}\r\n\r\n"
            opened.sendall(words.encode())
            self._sockets.append(opened)

    def count(self):
        """How many wait still."""
        answered = select.select(self._sockets, [], [], 0)[0] if self._sockets else []
        for one in answered:
            self._sockets.remove(one)
            one.close()
        return len(self._sockets)

    def close(self):
        for one in self._sockets:
            one.close()


@contextmanager
def pending(client):
    found = Pending(client)
    try:
        yield found
    finally:
        found.close()
