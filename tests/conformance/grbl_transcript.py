"""What a real GRBL answers, line by line: recorded from a firmware or simulator that one has, compared with the twin.

    python tests/conformance/grbl_transcript.py record FILE --firmware grbl.elf --box grbl_box
    python tests/conformance/grbl_transcript.py record FILE --port socket://127.0.0.1:5000
    python tests/conformance/grbl_transcript.py compare tests/conformance/grbl_1.1h.txt
    python tests/conformance/grbl_transcript.py compare tests/conformance/grblhal_1.1f.txt --variant grblHAL

`grbl.elf` is GRBL 1.1h, built from its own sources by avr-gcc for an ATmega328P at 16 MHz (`-mmcu=atmega328p
-DF_CPU=16000000L -Os`, all of `grbl/*.c`); `grbl_box` is grbl_box.c beside this file, built with libsimavr-dev
(`gcc -O2 -I/usr/include/simavr grbl_box.c -o grbl_box -lsimavrparts -lsimavr -lelf -lpthread -lutil`).
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from simulators.devices.grbl import GrblController
from simulators.world.motion import Axis

SWITCH_MM, STEPS_PER_MM = 10.0, 250


@dataclass(frozen=True)
class Step:
    """One line of a transcript: what is sent and waited for, or done at the machine; and what was answered."""

    row: str
    answer: tuple[str, ...] = ()

    @property
    def wait_s(self) -> float:
        """How long to listen."""
        return float(self.row.split()[1]) if self.sends else 0.1

    @property
    def sends(self) -> bool:
        """Whether anything goes over the wire."""
        return self.row.startswith(">")

    @property
    def data(self) -> bytes:
        """What is sent: realtime bytes as they are, text as a line."""
        text = self.row.split(" ", 2)[2]
        data = text.encode().decode("unicode_escape").encode("latin-1")
        realtime = all(byte >= 0x80 or byte in b"?!~\x18\n" for byte in data)
        return data if realtime else data + b"\n"


def read(path: Path) -> list[Step]:
    """The steps of a transcript."""
    steps: list[Step] = []
    for row in path.read_text(encoding="utf-8").splitlines():
        if row.startswith("<"):
            steps[-1] = Step(steps[-1].row, (*steps[-1].answer, row[2:]))
        elif row[:1] in (">", "!"):
            steps.append(Step(row))
    return steps


def rewrite(path: Path, answers: list[list[str]]) -> None:
    """Put these answers into the transcript; its remarks stay."""
    rows, fresh = [], iter(answers)
    for row in path.read_text(encoding="utf-8").splitlines():
        if not row.startswith("<"):
            rows.append(row)
        if row[:1] in (">", "!"):
            rows += [f"< {line}" for line in next(fresh)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


Exchange = Callable[[Step], bytes]


def lines(said: bytes) -> list[str]:
    """The lines of an answer."""
    return [line for line in said.decode("latin-1").split("\r\n") if line]


def answers_of(exchange: Exchange, steps: list[Step]) -> list[list[str]]:
    """What each step is answered."""
    return [lines(exchange(step)) for step in steps]


@contextmanager
def at_port(port: str, do: Callable[[str], None]) -> Iterator[Exchange]:
    """A controller behind a serial port or URL."""
    import serial

    with serial.serial_for_url(port, 115200, timeout=0.02) as line:

        def listen(wait_s: float) -> bytes:
            said, quiet_since = b"", time.monotonic()
            while time.monotonic() - quiet_since < wait_s:
                if heard := line.read(4096):
                    said, quiet_since = said + heard, time.monotonic()
            return said

        def exchange(step: Step) -> bytes:
            if step.sends:
                line.write(step.data)
            else:
                do(step.row[2:])
            return listen(step.wait_s)

        listen(1.0)
        yield exchange


@contextmanager
def firmware(elf: Path, box: Path) -> Iterator[Exchange]:
    """A firmware in simavr, in its own time: nothing depends on how busy the machine is."""
    command = [str(box), str(elf), str(int(SWITCH_MM * STEPS_PER_MM)), "lockstep"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        stdin, stdout = process.stdin, process.stdout

        def run(order: str, wait_s: float) -> bytes:
            stdin.write(f"{order}\nrun {1000 * wait_s}\n")
            stdin.flush()
            return bytes.fromhex(next(line for line in stdout if line.startswith("said ")).split(" ")[1])

        run("", 3.0)  # it finds no settings, and writes its own
        yield lambda step: run("send " + step.data.hex() if step.sends else step.row[2:], step.wait_s)
        stdin.close()


def twin(variant: str = "GRBL") -> Exchange:
    """The twin, as the firmware comes from its makers, with the same switches."""
    axes = {letter: Axis(-200.0, SWITCH_MM, 0.0) for letter in "XYZ"}
    controller = GrblController(axes, variant=variant, settings=FACTORY | (GRBLHAL if variant == "grblHAL" else {}))
    controller.set_lines(True, True, 0.0)
    clock_s = [5.0]
    controller.advance(clock_s[0])

    def exchange(step: Step) -> bytes:
        if step.sends:
            controller.receive(step.data, clock_s[0])
        else:
            what, letter, on = step.row[2:].split()
            assert what == "switch"
            controller.press(letter, on == "1", clock_s[0])
        clock_s[0] += step.wait_s
        return controller.advance(clock_s[0])

    return exchange


FACTORY: dict[int, float] = {
    0: 10, 1: 25, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.01, 12: 0.002, 13: 0, 20: 0, 21: 0, 22: 0, 23: 0, 24: 25,
    25: 500, 26: 250, 27: 1, 30: 1000, 31: 0, 32: 0, **{100 + i: 250 for i in range(3)},
    **{110 + i: 500 for i in range(3)}, **{120 + i: 10 for i in range(3)}, **{130 + i: 200 for i in range(3)},
}  # fmt: skip
"""GRBL's settings as built without any of one's own."""


GRBLHAL: dict[int, float] = {0: 5, 4: 7, 10: 511}
"""Where grblHAL's simulator has other ones."""


def differences(steps: list[Step], exchange: Exchange) -> list[tuple[Step, tuple[str, ...]]]:
    """The steps that are answered otherwise than the transcript has it, and how."""
    reported = [tuple(lines(exchange(step))) for step in steps]
    return [(step, answer) for step, answer in zip(steps, reported, strict=True) if answer != step.answer]


def _record(arguments: Any) -> None:
    peer = at_port(arguments.port, print) if arguments.port else firmware(arguments.firmware, arguments.box)
    with peer as exchange:
        rewrite(arguments.transcript, answers_of(exchange, read(arguments.transcript)))


def _compare(path: Path, variant: str) -> int:
    steps = read(path)
    wrong = differences(steps, twin(variant))
    for step, answer in wrong:
        print(step.row, f"  recorded {list(step.answer)}", f"  the twin {list(answer)}", sep="\n")
    print(f"{len(steps) - len(wrong)} of {len(steps)} steps are answered alike")
    return len(wrong)


def main() -> int:
    """Record or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["record", "compare"])
    parser.add_argument("transcript", type=Path)
    parser.add_argument("--firmware", type=Path)
    parser.add_argument("--box", type=Path)
    parser.add_argument("--port")
    parser.add_argument("--variant", default="GRBL", help="of the twin: GRBL, grblHAL or FluidNC")
    arguments = parser.parse_args()
    if arguments.what == "record":
        _record(arguments)
        return 0
    return _compare(arguments.transcript, arguments.variant)


if __name__ == "__main__":
    sys.exit(main())
