"""The program before a real terminal: a pseudo-terminal that is typed into, closed, or never there."""

import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

SLOW_FIXTURES = {"terminal"}

ROOT = Path(__file__).resolve().parents[3]
PATIENCE_S = 180.0


class Terminal:
    """A program in a terminal of 80 x 24: `station --simulate` if no other is given."""

    def __init__(self, folder: Path, words: Sequence[str] = (), **environment: str) -> None:
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        environ = {**os.environ, "TERM": "xterm-256color", "PYTHONPATH": str(ROOT), **environment}
        self.program = subprocess.Popen(
            words or [sys.executable, "-m", "station", "--simulate", "--sessions", str(folder)],
            cwd=folder if words else None, stdin=slave, stdout=slave, stderr=slave, env=environ, start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )  # fmt: skip
        os.close(slave)
        self.open = True
        self.unread = b""

    def wait_for(self, text: str) -> None:
        """Read up to and including the text; what follows it stays for the next call."""
        end = time.monotonic() + PATIENCE_S
        while text.encode() not in self.unread:
            assert time.monotonic() < end, f"waited in vain for {text}"
            if select.select([self.master], [], [], 1.0)[0]:
                self.unread += os.read(self.master, 65536)
        self.unread = self.unread.partition(text.encode())[2]

    def wait_until(self, ready: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not ready():
            assert time.monotonic() < end
            if select.select([self.master], [], [], 0.05)[0]:
                os.read(self.master, 65536)

    def suspended(self) -> bool:
        stat = Path(f"/proc/{self.program.pid}/stat").read_text()
        return stat.rpartition(")")[2].split()[0] == "T"

    def raw(self) -> bool:
        """Whether the terminal gives every key to the program at once."""
        return not termios.tcgetattr(self.master)[3] & termios.ICANON

    def press(self, keys: bytes) -> None:
        os.write(self.master, keys)

    def hang_up(self) -> None:
        if self.open:
            os.close(self.master)
            self.open = False


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    one = Terminal(tmp_path / "sessions")
    yield one
    one.program.kill()
    one.program.wait()
    one.hang_up()


def test_it_is_painted_and_left_by_a_key(terminal):
    terminal.wait_for("press Enter to begin")
    terminal.press(b"\x11")
    terminal.wait_for("\x1b[?1049l")  # the shell's screen is back
    assert terminal.program.wait(PATIENCE_S) == 0


def test_a_terminal_that_is_gone_ends_the_program_and_its_run(terminal, tmp_path):
    terminal.wait_for("head: not homed")
    for _ in range(3):
        terminal.press(b"\r")
        time.sleep(0.2)
    terminal.wait_for("Which paper")
    terminal.press(b"\r")  # a session in which nothing was answered is not kept
    terminal.wait_for("How wide")
    terminal.press(b"\r")
    terminal.wait_for("matt paper")
    terminal.hang_up()
    assert terminal.program.wait(PATIENCE_S) == 3
    (journal,) = (tmp_path / "sessions").glob("*/journal.jsonl")
    ended, wired = journal.read_text().splitlines()[-2:]
    assert '"ended"' in ended
    assert '"wired"' in wired


def test_the_systems_end_leaves_the_terminal_as_it_was(terminal):
    terminal.wait_for("press Enter to begin")
    terminal.program.send_signal(signal.SIGTERM)
    terminal.wait_for("\x1b[?1049l")
    assert terminal.program.wait(PATIENCE_S) == 3


needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="whether it is suspended stands in /proc")


@needs_proc
def test_suspended_it_gives_the_terminal_back_and_takes_it_again(terminal):
    terminal.wait_for("head: not homed")
    terminal.program.send_signal(signal.SIGTSTP)
    terminal.wait_until(terminal.suspended)
    assert not terminal.raw()
    terminal.program.send_signal(signal.SIGCONT)
    terminal.wait_for("EMERGENCY STOP: every device was stopped")
    assert terminal.raw()
    terminal.press(b"\x1bOR")  # F3
    terminal.wait_for("Manual moves")
    terminal.press(b"\x11")
    terminal.wait_for("\x1b[?1049l")
    assert terminal.program.wait(PATIENCE_S) == 0


@needs_proc
def test_stopped_from_outside_it_goes_on_with_the_threads_it_had(terminal):
    def threads() -> int:
        return len(os.listdir(f"/proc/{terminal.program.pid}/task"))

    terminal.wait_for("head: not homed")
    before = threads()
    terminal.program.send_signal(signal.SIGSTOP)
    terminal.wait_until(terminal.suspended)
    terminal.program.send_signal(signal.SIGCONT)
    terminal.wait_for("\x1b[?1049l")
    terminal.wait_for("F12 STOP ALL")
    assert terminal.raw()
    terminal.wait_until(lambda: threads() == before)


def test_without_a_terminal_it_says_so(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "station", "--sessions", str(tmp_path)], stdin=subprocess.DEVNULL, capture_output=True,
        text=True, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 2
    assert "needs a terminal" in done.stderr
