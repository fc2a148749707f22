"""Mutates small files of every format and reads them: each must end in a right result or a stated refusal.

    python -m tests.benchmarks.fuzz_readers [--mutations 6000] [--seed RANDOM] [--only npz,exr] [--keep FOLDER]

The files are those of `fuzz_files`. Each mutation of one (bytes flipped, runs zeroed, cut out, doubled or swapped,
numbers made extreme, the end missing; words of text replaced) is read by a fork with every library loaded, limited in
address space (2 GB beside what is there) and in time (60 s of processor). A fork reads so many and is followed by
another; one that the system ends is followed by one that begins after the mutation that it died of. What a mutation
comes to is counted: 0 read, 2, 4, 5 refused as stated, 70 something unforeseen, `SIG...` ended by the system. The seed
is printed, with which a run is repeated, and `--keep` keeps the files that came to neither.
"""

import gc
import json
import os
import random
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from procedures.ray_histogram.film import film_of_samples
from procedures.ray_histogram.multiscale import filter_film
from tests.benchmarks import options, processor_s
from tests.benchmarks.fuzz_files import AFTER, FEW, READERS, restored, samples
from tests.benchmarks.fuzz_structure import STRUCTURED, restructured

ROOM, TIME_S = 2_000_000_000, 60
"""Address space beside what the program has, bytes; seconds of processor."""
IN_ONE = 40
"""Mutations that one fork reads."""
STATED = ("0", "2", "4", "5")
EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
WORDS = (
    "nan", "inf", "-1", "0", "1e999", "1e308", "-1e308", "1e200", "1e-320", "2147483648", "9" * 30, "[1.0]",
    "9" * 400, "[" * 3000, '"', "{}", "null", "true", "\0", "\x1b[2J", "a" * 9999,
)  # fmt: skip


def mutated(data: bytes, rng: random.Random, suffix: str) -> bytes:
    """The content of a file of this name's end with one to four things wrong with it."""
    text = suffix in (".txt", ".csv", ".json", ".jsonl", ".toml")
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        if suffix in STRUCTURED and rng.random() < 0.6:
            data = restructured(data, suffix, rng)
        else:
            data = rng.choice(TEXT if text and rng.random() < 0.7 else BINARY)(data, rng)
    return data


def _place(data: bytes, rng: random.Random) -> int:
    """Anywhere, and half of the time where headers are."""
    return rng.randrange(max(1, min(len(data), 600) if rng.random() < 0.5 else len(data)))


def _flip(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 3, 20))):
        if changed:
            changed[_place(data, rng)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _extreme(data: bytes, rng: random.Random) -> bytes:
    at, width, order = _place(data, rng), rng.choice((1, 2, 4, 8)), rng.choice(("little", "big"))
    number = rng.choice(EXTREMES) & (256**width - 1)
    return data[:at] + number.to_bytes(width, order) + data[at + width :]


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _zero(data: bytes, rng: random.Random) -> bytes:
    at, n = _place(data, rng), rng.choice((4, 16, 300))
    return data[:at] + bytes(min(n, len(data) - at)) + data[at + n :]


def _remove(data: bytes, rng: random.Random) -> bytes:
    at = _place(data, rng)
    return data[:at] + data[at + rng.choice((1, 2, 12, 100)) :]


def _double(data: bytes, rng: random.Random) -> bytes:
    at, n = _place(data, rng), rng.choice((1, 12, 100, 3000))
    return data[: at + n] + data[at:]


def _swap(data: bytes, rng: random.Random) -> bytes:
    first, second, n = _place(data, rng), _place(data, rng), rng.choice((2, 12, 64))
    one, other = sorted((first, second))
    if other - one < n or other + n > len(data):
        return _flip(data, rng)
    return data[:one] + data[other : other + n] + data[one + n : other] + data[one : one + n] + data[other + n :]


def _word(data: bytes, rng: random.Random) -> bytes:
    """One word or number of a text replaced."""
    pieces = data.replace(b",", b" , ").split(b" ")
    pieces[rng.randrange(len(pieces))] = rng.choice(WORDS).encode()
    return b" ".join(pieces)


def _rescaled(data: bytes, rng: random.Random) -> bytes:
    """One number of a text made larger or smaller, or of the other sign."""
    numbers = list(re.finditer(rb"-?\d+(\.\d*)?(e[+-]?\d+)?", data))
    if not numbers:
        return data
    one = rng.choice(numbers)
    changed = float(one[0]) * rng.choice((-1, 0, 0.5, 2, 10, 1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9, 1e12))
    return data[: one.start()] + f"{changed:.9g}".encode() + data[one.end() :]


def _line(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True) or [b""]
    at = rng.randrange(len(lines))
    lines[at : at + 1] = rng.choice(([], [lines[at]] * 2, [rng.choice(WORDS).encode() + b"\n"]))
    return b"".join(lines)


BINARY = (_flip, _flip, _extreme, _extreme, _cut, _zero, _remove, _double, _swap)
TEXT = (_word, _word, _rescaled, _rescaled, _line)


@dataclass(frozen=True)
class Answer:
    """What a reading came to: its code, bytes that it took beside what was there, seconds of processor, and why."""

    code: str
    memory: int = 0
    time_s: float = 0.0
    stated: str = ""


@dataclass
class Counts:
    """What came of the mutations: how often each code, the largest growth and longest time, what was unforeseen."""

    codes: Counter[str] = field(default_factory=Counter)
    memory: int = 0
    time_s: float = 0.0
    odd: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Subject:
    """A file, its whole content, how it is read, and what the mutations' random numbers begin with."""

    path: Path
    whole: bytes
    read: Callable[[Path], object]
    seed: int
    keep: Path | None

    def spoil(self, n: int) -> str:
        """Write the n-th mutation, none where n is below 0; what it is called."""
        mark = f"{self.seed}/{self.path.name}/{n}"
        data = mutated(self.whole, random.Random(mark), self.path.suffix) if n >= 0 else self.whole
        self.path.write_bytes(AFTER.get(self.path.name, bytes)(data))
        return mark


def read_apart(subject: Subject, numbers: range) -> list[Answer]:
    """The answers to these mutations, one fork after the other where one dies."""
    answers: list[Answer] = []
    while len(answers) < len(numbers):
        rest = numbers[len(answers) :]
        ear, mouth = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(ear)
            os._exit(_serve(subject, rest, mouth))
        os.close(mouth)
        with os.fdopen(ear, "rb") as file:
            answers += [Answer(*json.loads(line)) for line in file.read().splitlines()]
        _, status = os.waitpid(child, 0)
        if os.WIFSIGNALED(status):
            answers.append(Answer(signal.Signals(os.WTERMSIG(status)).name))
        elif status:
            raise SystemExit(f"{subject.path.name}: the fork failed")
    return answers


def _serve(subject: Subject, numbers: range, mouth: int) -> int:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    size = 1024 * _status("VmSize")
    resource.setrlimit(resource.RLIMIT_AS, (size + ROOM, size + ROOM))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for n in numbers:
        subject.spoil(n)
        begin_s = processor_s()
        resource.setrlimit(resource.RLIMIT_CPU, (int(begin_s) + TIME_S, resource.RLIM_INFINITY))
        Path("/proc/self/clear_refs").write_text("5")  # the peak is counted from here
        before = _status("VmRSS")
        code, stated = _read(subject)
        answer = (code, 1024 * max(0, _status("VmHWM") - before), processor_s() - begin_s, stated)
        os.write(mouth, (json.dumps(answer) + "\n").encode())
    return 0


def _read(subject: Subject) -> tuple[str, str]:
    try:
        subject.read(subject.path)
    except Exception as error:
        if type(getattr(error, "exit_code", None)) is int and hasattr(error, "remedy"):
            return str(error.exit_code), ""
        return "70", traceback.format_exc()[-3000:]
    return "0", ""


def _status(name: str) -> int:
    """A number of this process' status, in kB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{name}:"))


def fuzz(mutations: int, seed: int, only: Sequence[str] = (), keep: Path | None = None) -> dict[str, Counts]:
    """Counts by file, of so many mutations shared out evenly; reported as they come."""
    chosen = {name: one for name, one in READERS.items() if not only or any(part in name for part in only)}
    counts: dict[str, Counts] = defaultdict(Counts)
    # what is compiled is made or loaded once, not in every fork
    if any(name.startswith("film") for name in chosen):
        filter_film(film_of_samples(samples()).checked(), FEW, threads=1)
    restored()
    gc.freeze()  # what is there is no fork's garbage: to look through it would copy it
    with tempfile.TemporaryDirectory(prefix="fuzz-") as raw:
        for name, (write, read) in chosen.items():
            path, begin = Path(raw, name.replace(".", "-"), name), time.perf_counter()
            path.parent.mkdir()
            _write_apart(write, path)
            subject = Subject(path, path.read_bytes(), read, seed, keep)
            many = mutations // len(chosen)
            for first in range(-1, many, IN_ONE):
                numbers = range(first, min(first + IN_ONE, many))
                for n, answer in zip(numbers, read_apart(subject, numbers), strict=True):
                    if n >= 0:
                        _count(counts[name], subject, n, answer)
                    elif answer.code != "0":
                        raise SystemExit(f"{name} cannot be read as it was written: {answer}")
            _tell(name, counts[name], time.perf_counter() - begin)
    return counts


def _write_apart(write: Callable[[Path], None], path: Path) -> None:
    """In a fork: its libraries may start threads."""
    writer = os.fork()
    if writer == 0:
        try:
            write(path)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    if os.waitpid(writer, 0)[1] != 0:
        raise SystemExit(f"{path.name} could not be written")


def _count(counts: Counts, subject: Subject, n: int, answer: Answer) -> None:
    counts.codes[answer.code] += 1
    counts.memory, counts.time_s = max(counts.memory, answer.memory), max(counts.time_s, answer.time_s)
    if answer.code not in STATED:
        mark = subject.spoil(n)
        counts.odd.append(f"{mark}: {answer.code}: {answer.stated}")
        if subject.keep:
            subject.keep.mkdir(parents=True, exist_ok=True)
            (subject.keep / mark.replace("/", "-")).write_bytes(subject.path.read_bytes())


def _tell(name: str, counts: Counts, took_s: float) -> None:
    codes = ", ".join(f"{code}: {n}" for code, n in sorted(counts.codes.items()))
    print(f"{name:15} {codes:45} {counts.memory / 1e6:6.0f} MB  {counts.time_s:5.2f} s  ({took_s:.0f} s)", flush=True)
    for what in {one.strip().splitlines()[-1]: one for one in counts.odd}.values():
        print("    " + what.strip().replace("\n", "\n    "), flush=True)


def main() -> None:
    """Mutate, read, count."""
    given = options(__doc__, mutations=6000, seed=random.SystemRandom().randrange(1 << 32), only="", keep=None)
    print(f"seed {given.seed}", flush=True)
    counts = fuzz(given.mutations, given.seed, [one for one in given.only.split(",") if one], given.keep)
    total = sum((one.codes for one in counts.values()), Counter[str]())
    print(f"{total.total()} mutations, seed {given.seed}: {dict(sorted(total.items()))}")
    print(f"the most memory {max(one.memory for one in counts.values()) / 1e6:.0f} MB, "
          f"the longest {max(one.time_s for one in counts.values()):.1f} s of processor")  # fmt: skip
    sys.exit(any(one.odd for one in counts.values()))


if __name__ == "__main__":
    main()
