"""grblHAL's own simulator behind a port of this machine that stays when it is switched off and on.

It goes in real time: its main program does so whatever factor its clock is given, and runs out of steps (`ALARM:9` in
mid-homing, always at a factor of 4 on a busy machine, now and then at 1).

It is built from the sources of grblHAL's project "Simulator" with switches at the ends of its axes, which it has not:
`set_step_outputs` of its driver.c counts the steps of each axis and closes LIMITS_PORT0 from 2500 steps on, and
`limitsEnable` leaves the axes that are homing out of the interrupt's mask, as drivers of real boards do.
"""

import select
import socket
import subprocess
import threading
import time
from contextlib import suppress
from pathlib import Path

from .grbl_firmware import FirmwareInSimavr

HERE = "127.0.0.1"
START_S = 20.0
SAVE_S = 3.0
"""How long it may take to begin, and to keep a setting."""


class GrblHalSimulator:
    """A controller that one can switch off; whoever is connected to it is cut off then, as from a board with a network.

    The program does not let its port be used again at once: each start gets another one, and this one passes on.
    """

    line_stays = False
    SETTINGS = tuple(line for line in FirmwareInSimavr.SETTINGS if line != "$22=1")

    def __init__(self, program: str, folder: Path, settings: tuple[str, ...] = ()) -> None:
        self._command = [program, "-n", "-t", "1", "-e", str(folder / "EEPROM")]
        self._door = socket.create_server((HERE, 0))
        self._host: socket.socket | None = None
        self._board: socket.socket | None = None
        self._over = False
        self.url = f"socket://{HERE}:{self._door.getsockname()[1]}"
        self.switch_on()
        for line in ("$X", "$22=17", *self.SETTINGS, *settings):
            self._ask(line)
        self._carrier = threading.Thread(target=self._carry, name="relay", daemon=True)
        self._carrier.start()

    def _ask(self, line: str) -> None:
        assert self._board is not None
        self._board.sendall(line.encode() + b"\n")
        said = b""
        while b"ok\r\n" not in said and b"error" not in said:
            said += self._board.recv(4096)

    def switch_on(self) -> None:
        """Begin anew, with the settings it had."""
        with socket.create_server((HERE, 0)) as free:
            port = free.getsockname()[1]
        command = [*self._command, "-p", str(port)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline_s = time.monotonic() + START_S
        while self._board is None:
            try:
                self._board = socket.create_connection((HERE, port))
            except OSError:
                assert time.monotonic() < deadline_s, "the simulator does not start"
                time.sleep(0.05)

    def cut_power(self, off_s: float, with_line: bool) -> None:
        """Off now, on so much later; its line goes, too."""
        self._process.kill()
        self._process.wait()
        while self._board is not None:
            time.sleep(0.01)
        time.sleep(off_s)
        self.switch_on()

    def set(self, *lines: str) -> None:
        """Write settings, from somewhere else; after a reset by its host the simulator would hang at that."""
        self.cut_power(0.0, True)
        assert self._board is not None
        for line in lines:
            self._board.sendall(line.encode() + b"\n")
            time.sleep(SAVE_S)

    def standing(self) -> tuple[float, ...]:
        """Its own account is all that there is."""
        return ()

    def end(self) -> None:
        """Switch it off for good."""
        self._over = True
        self._carrier.join()
        self._process.kill()
        self._process.wait()
        for end in (self._host, self._board, self._door):
            if end is not None:
                end.close()

    def _carry(self) -> None:
        while not self._over:
            ends = [end for end in (self._door, self._host, self._board) if end is not None]
            for end in select.select(ends, [], [], 0.02)[0]:
                if end is self._door:
                    self._let_in(self._door.accept()[0])
                else:
                    self._pass_on(end)

    def _let_in(self, host: socket.socket) -> None:
        if self._board is None or self._host is not None:
            host.close()
        else:
            self._host = host

    def _pass_on(self, end: socket.socket) -> None:
        data = b""
        with suppress(OSError):
            data = end.recv(4096)
        if data:
            other = self._board if end is self._host else self._host
            with suppress(OSError):
                other and other.sendall(data)
            return
        if end is self._board:
            self._board = self._closed(end)
        self._host = self._closed(self._host)

    @staticmethod
    def _closed(end: socket.socket | None) -> None:
        if end is not None:
            end.close()
