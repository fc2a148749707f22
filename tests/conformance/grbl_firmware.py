"""A real GRBL in simavr, in the time of the tests."""

import subprocess


class FirmwareInSimavr:
    """A real GRBL at the end of a cable, in the time of the tests: its processor runs as far as their clock."""

    baud = 115200
    STEP_S = 0.02
    SETTINGS = (
        *(f"${110 + i}=1000" for i in range(3)), *(f"${120 + i}=100" for i in range(3)),
        *(f"${130 + i}=40" for i in range(3)), "$25=1000", "$24=300", "$26=20", "$22=1", "$20=1", "$21=1", "$1=255",
    )  # fmt: skip
    """A small quick machine with hard limits; its switches are 10 mm from where it begins."""

    STEPS_PER_MM = 250

    def __init__(self, firmware: str, box: str, settings: tuple[str, ...] = ()) -> None:
        command = [box, firmware, str(10 * self.STEPS_PER_MM), "lockstep"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._ran_s, self._said, self._off_until_s = 0.0, bytearray(), 0.0
        self._run_until(b"help]")  # it finds no settings, and writes its own
        for line in (*self.SETTINGS, *settings):
            self._run(f"send {(line + chr(10)).encode().hex()}", 0.0)
            self._run_until(b"ok")
        self._ran_s, self._said = 0.0, bytearray()

    def _answer(self, order: str, word: str) -> str:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(order + "\n")
        self._process.stdin.flush()
        return next(line for line in self._process.stdout if line.startswith(word)).removeprefix(word)

    def _run(self, order: str, duration_s: float) -> None:
        self._said += bytes.fromhex(self._answer(f"{order}\nrun {1000 * duration_s}", "said "))
        self._ran_s += duration_s + (len(order) - 5) // 2 * 10 / 115200 * order.startswith("send")

    def _run_until(self, word: bytes) -> None:
        deadline_s = self._ran_s + 10.0
        while word not in self._said:
            assert self._ran_s < deadline_s, f"{word!r} was not said, but {bytes(self._said)!r}"
            self._run("", 0.05)
        self._said.clear()

    def set_lines(self, rts: bool, dtr: bool, now_s: float) -> None:
        """A board that is not wired to be reset by DTR."""

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes at their speed; none while it is off."""
        self._catch_up(now_s)
        if now_s >= self._off_until_s:
            self._run(f"send {data.hex()}", 0.0)

    def _catch_up(self, now_s: float) -> None:
        if now_s > self._ran_s:
            self._run("", now_s - self._ran_s)

    def advance(self, now_s: float) -> bytes:
        """Run until now; what it said."""
        self._catch_up(now_s)
        said, self._said = bytes(self._said), bytearray()
        return said

    def next_event_s(self) -> float | None:
        """Nobody knows: look every few milliseconds."""
        return self._ran_s + self.STEP_S

    def restart(self, now_s: float, off_s: float = 0.5) -> None:
        """Switch it off, and on again so much later; its settings and its axes stay as they are."""
        self._catch_up(now_s)
        self._said.clear()
        self._run("power", 0.0)
        self._ran_s = self._off_until_s = now_s + off_s

    def places(self, now_s: float) -> tuple[float, ...]:
        """Where its axes stand, counted at its pins, in millimetres."""
        self._catch_up(now_s)
        return tuple(int(steps) / self.STEPS_PER_MM for steps in self._answer("where", "at ").split())

    def end(self) -> None:
        """Switch it off."""
        self._process.kill()
        self._process.communicate()
