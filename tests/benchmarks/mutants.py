"""Mutation testing: random small changes of the sources, and whether the tests notice them.

    python mutants.py [AREA ...] [--count 25] [--seed N] [--keep FOLDER] [--quick] [--without-golden]

The tests of an area run once under coverage.py, so that the tests of each line are known. Each mutant is then written
into a copy of the sources, and the tests of its line run, the likeliest and fastest first, until one fails. Machine
code and other processes are invisible to coverage: a file with compiled loops is tried with all tests, a line without a
test with the tests of its file, and every line with the tests of its file's name. A mutant is killed too if a test
takes more than ten times as long as before. Printed are the share killed with its 95 % interval (Clopper-Pearson), the
survivors as a difference, and what was too slow.

With --keep, a later run of an area records only the files of tests that changed, and tries only the mutants that
survived and whose rows still stand.

With --quick, tests marked slow are left out, with --without-golden those of frozen records, which leaves more mutants
alive.

Needs coverage (`pip install coverage`).
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import difflib
import hashlib
import importlib
import json
import os
import random
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import Any

from scipy.stats import beta

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("station", "drivers", "procedures", "simulators", "tests", "pyproject.toml", "README.md", "CHANGELOG.md")
PRELOADED = (
    "cv2", "h5py", "hypothesis", "matplotlib.pyplot", "msgspec", "numba", "pytest", "rawpy", "scipy.ndimage",
    "scipy.optimize", "scipy.signal", "textual.app",
)  # fmt: skip
"""Loaded once; every mutant's tests run in a fork."""
PROCEDURE = ("base", "psf", "schema")
GOLDEN = ("tests/golden",)
"""Records and pages of every procedure, which all areas of procedures change."""
FIRST = (
    "tests/golden/test_intermediates.py",
    "tests/golden/test_plans.py",
    "tests/golden/test_golden.py::test_records",
)
"""Tests that notice most."""
AREAS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "pattern_psf": (("procedures/pattern_psf",), ("tests/procedures/pattern_psf", *GOLDEN)),
    "two_photo": (("procedures/two_photo",), ("tests/procedures/two_photo", *GOLDEN)),
    "field": (
        ("procedures/field",),
        ("tests/procedures/field", "tests/station/calibration/test_psf_exports.py", *GOLDEN),
    ),
    "geometry": (("procedures/geometry",), ("tests/procedures/geometry", *GOLDEN)),
    "numerics": (("procedures/numerics",), ("tests/procedures/numerics", *GOLDEN)),
    "slanted_edge": (("procedures/slanted_edge",), ("tests/procedures/slanted_edge", *GOLDEN)),
    "sessions": (
        ("station/sessions",),
        ("tests/station/sessions", "tests/station/cli/test_session.py", "tests/station/service/test_sessions.py"),
    ),
    "batch": (("station/batch",), ("tests/station/batch", *GOLDEN)),
    "stop path": (
        (
            "station/common/stop_signals.py", "station/bench/stage_watch.py",
            "station/bench/motions.py", "drivers/transport.py", "drivers/grbl.py", "drivers/protocols/grbl.py",
            "drivers/move_checks.py", "drivers/watchdog.py", "drivers/zaber.py",
        ),
        (
            *(f"tests/station/bench/test_{one}.py" for one in ("commission", "opening", "stage_watch")),
            "tests/drivers/grbl",
            *(f"tests/drivers/test_{one}.py" for one in ("parsers", "transport", "watchdog", "wire_journals", "zaber")),
            *(f"tests/conformance/test_{one}.py" for one in ("grbl_machine", "grbl_transcript", "stage")),
            "tests/conformance/test_zaber_motion.py",
        ),
    ),
    "measurement": (
        ("station/results", *(f"station/procedure/{one}.py" for one in PROCEDURE)),
        (
            "tests/station/results", "tests/station/procedure", "tests/station/reports/test_certificate.py",
            "tests/station/batch/test_registry.py", *GOLDEN,
            *(f"tests/station/cli/test_{one}.py" for one in ("explain", "profile", "typed_settings", "verify")),
        ),
    ),
    "corruption": (
        ("procedures/corruption", "procedures/slanted_edge/corruptions.py", "procedures/slanted_edge/evidence.py"),
        ("tests/procedures/corruption", "tests/procedures/slanted_edge", *GOLDEN),
    ),
}  # fmt: skip
"""Area -> its sources and its tests."""
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.Add: ast.Sub, ast.Sub: ast.Add,
    ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.And: ast.Or, ast.Or: ast.And, ast.LShift: ast.RShift,
    ast.Break: ast.Continue, ast.Continue: ast.Break,
}  # fmt: skip
USES_LOOPS = b"numerics.compiled import"
COMPILED = "compiled"
"""Folder of machine code."""
SLOWER = 10.0
GRACE_S = 20.0
MOST_TESTS_S = 30.0
"""Tests of one mutant beside FIRST take at most so much processor time by the first run; no others are tried."""
QUICK_S = 4.0
"""Processor time of the tests that are run before all others."""
AGAIN = 3
"""As many times longer for a mutant that is tried again, then also tests that do not execute its line themselves."""


@dataclass(frozen=True)
class Mutant:
    """One change: the text between two places of a file, and what replaces it."""

    file: str
    line: int
    start: int
    end: int
    text: str

    def apply(self, source: bytes) -> bytes:
        """The changed source."""
        return source[: self.start] + self.text.encode() + source[self.end :]


def mutants_of(file: str, source: bytes) -> list[Mutant]:
    """Every mutant of a file."""
    tree = ast.parse(source)
    starts = [0]
    for row in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(row))
    return [
        Mutant(file, node.lineno, starts[node.lineno - 1] + node.col_offset,
               starts[node.end_lineno - 1] + node.end_col_offset, text)
        for node, text in _changes(tree)
    ]  # fmt: skip


def _changes(node: ast.AST) -> Iterator[tuple[Any, str]]:
    """Nodes and the text that replaces each. Texts, annotations, decorators and messages of errors stay."""
    for name, child in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for one in child if isinstance(child, list) else [child]:
            if isinstance(one, ast.AST) and not _stays(one):
                yield from _own_changes(one)
                yield from _changes(one)


def _stays(node: ast.AST) -> bool:
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
        return True
    if isinstance(node, ast.FunctionDef) and node.name in ("__repr__", "__str__"):
        return True
    if isinstance(node, ast.Expr) and "log" in ast.unparse(node.value).split("(")[0].lower():
        return True
    return isinstance(node, (ast.JoinedStr, ast.Raise, ast.Import, ast.ImportFrom, ast.Global, ast.Assert))


def _own_changes(node: Any) -> Iterator[tuple[Any, str]]:
    changed = copy.deepcopy(node)
    if isinstance(node, (ast.BinOp, ast.BoolOp)) and type(node.op) in SWAPPED:
        changed.op = SWAPPED[type(node.op)]()
        yield node, f"({ast.unparse(changed)})"
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED:
        changed.ops[0] = SWAPPED[type(node.ops[0])]()
        yield node, f"({ast.unparse(changed)})"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
        yield node, f"({ast.unparse(node.operand)})"
    elif isinstance(node, ast.AugAssign) and type(node.op) in SWAPPED:
        changed.op = SWAPPED[type(node.op)]()
        yield node, ast.unparse(changed)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield node, str(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int):
        yield node, str(node.value + 1)
    elif isinstance(node, ast.Constant) and isinstance(node.value, float):
        yield node, repr(2 * node.value or 1.0)
    elif isinstance(node, (ast.Break, ast.Continue)):
        yield node, ast.unparse(SWAPPED[type(node)]())
    elif isinstance(node, ast.IfExp):
        changed.body, changed.orelse = node.orelse, node.body
        yield node, f"({ast.unparse(changed)})"
    elif isinstance(node, ast.If):
        yield node.test, f"(not ({ast.unparse(node.test)}))"
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield node, "pass"
    elif isinstance(node, ast.Return) and node.value is not None and not isinstance(node.value, ast.Constant):
        yield node, "return None"


class Recorder:
    """Plugin of pytest: which test executes which line of the sources, and its seconds of processor, at least 10 ms."""

    def __init__(self, sources: Sequence[str]) -> None:
        import coverage

        include = [f"{source}{end}" for source in sources for end in ("", "/**")]
        self.coverage = coverage.Coverage(data_file=None, source=None, include=include, config_file=False)
        self.begin_s, self.seconds, self.failed, self.lines = 0.0, dict[str, float](), list[str](), dict[str, Any]()

    def pytest_sessionstart(self) -> None:
        self.coverage.start()
        self.coverage.switch_context("imports")

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.coverage.switch_context(nodeid)
        self.begin_s = _processor_s()

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self.seconds[nodeid] = max(_processor_s() - self.begin_s, 0.01)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self.failed.append(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        self.coverage.stop()
        data = self.coverage.get_data()
        for file in data.measured_files():
            self.lines[Path(file).relative_to(Path.cwd()).as_posix()] = data.contexts_by_lineno(file)


def _processor_s() -> float:
    """Processor time of this process and of the programs that it has waited for."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


class Announcer:
    """Plugin of pytest: writes the name of each test that begins into a pipe."""

    def __init__(self, pipe: int) -> None:
        self.pipe = pipe

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        os.write(self.pipe, f"{nodeid}\n".encode())


class Area:
    """The sources and tests of an area in a copy of the checkout."""

    def __init__(self, name: str, folder: Path, quick: bool = False, golden: bool = True) -> None:
        self.name, self.folder, self.again, self.quick = name, folder, False, quick
        self.too_slow: list[Mutant] = []
        self.sources, tests = AREAS[name]
        self.tests = tests if golden else tuple(one for one in tests if one not in GOLDEN)
        self.files = _files_of(folder, self.sources, "*.py")
        kept = folder / f"{name}-record.json"
        record: dict[str, Any] = {"digests": {}, "seconds": {}, "lines": {}, "sources": {}}
        if kept.exists():
            record |= json.loads(kept.read_text())
        self.seconds: dict[str, float] = record["seconds"]
        self.lines: dict[str, dict[str, list[str]]] = record["lines"]
        sources = {file: (folder / file).read_text() for file in self.files}
        for file in {*sources, *record["sources"]}:
            row_of = moved_rows(record["sources"].get(file, ""), sources.get(file, ""))
            before = self.lines.get(file, {})
            self.lines[file] = {str(new): before[str(old)] for old, new in row_of.items() if str(old) in before}
        record["digests"] = self._recorded(record["digests"])
        kept.write_text(json.dumps({**record, "seconds": self.seconds, "lines": self.lines, "sources": sources}))

    def _recorded(self, before: dict[str, str]) -> dict[str, str]:
        """Run the files of tests that changed, and keep what each test executes: digests of the files."""
        files = _files_of(self.folder, self.tests, "test_*.py")
        now = {file: hashlib.sha256((self.folder / file).read_bytes()).hexdigest() for file in files}
        changed = [file for file in files if now[file] != before.get(file)]
        if not changed:
            return now

        def old(test: str) -> bool:
            return test.partition("::")[0] in changed or test.partition("::")[0] not in now

        self.seconds = {test: value for test, value in self.seconds.items() if not old(test)}
        out = self.folder / "recording.json"
        log = self.folder / "recording.log"
        out.unlink(missing_ok=True)
        _wait(self._fork(lambda: _record(self.sources, changed, out, self.quick), log, self.folder / COMPILED))
        if not out.exists():
            sys.exit(f"{self.name}: the tests cannot be recorded, see {log}")
        new = json.loads(out.read_text())
        if new["failed"]:
            print(f"{self.name}: fail without a mutant, and are not used: {', '.join(new['failed'])}", flush=True)
        self.seconds |= {test: s for test, s in new["seconds"].items() if test not in new["failed"]}
        for file in {*self.lines, *new["lines"]}:
            rows, more = self.lines.setdefault(file, {}), new["lines"].get(file, {})
            for row in {*rows, *more}:
                rows[row] = [test for test in rows.get(row, []) if not old(test)] + more.get(row, [])
        return now

    def _fork(self, run: Callable[[], int], log: Path, compiled: Path) -> int:
        """Fork a process group that runs this in the copy: its id."""
        child = os.fork()
        if child:
            return child
        code = 70
        try:
            os.setsid()
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            os.chdir(self.folder)
            with log.open("wb") as file:
                os.dup2(file.fileno(), 1)
                os.dup2(file.fileno(), 2)
            os.environ |= {"PYTHONPATH": str(self.folder), "PYTHONDONTWRITEBYTECODE": "1",
                           "NUMBA_CACHE_DIR": str(compiled),
                           "STATION_SHARED_DATA": str(ROOT.parent / "shared" / "data")}  # fmt: skip
            sys.dont_write_bytecode = True
            sys.path[:] = [str(self.folder), *(one for one in sys.path if not Path(one).is_relative_to(ROOT))]
            code = run()
        except Exception:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)

    def mutants(self, count: int, rng: random.Random) -> list[Mutant]:
        """Random mutants, each as likely as another."""
        all_of = [m for file in self.files for m in mutants_of(file, (self.folder / file).read_bytes())]
        return rng.sample(all_of, min(count, len(all_of)))

    def tests_of(self, mutant: Mutant) -> list[str]:
        """The tests of its name, then those that execute its line, or its file where none does; the fastest first."""
        lines = self.lines.get(mutant.file, {})
        tests = {test for test in lines.get(str(mutant.line), []) if test in self.seconds}
        if USES_LOOPS in (self.folder / mutant.file).read_bytes():
            tests = set(self.seconds)
        tests = tests or {test for line in lines.values() for test in line if test in self.seconds}
        # they may start a program, which executes the line
        parts = Path(mutant.file).with_suffix("").parts
        named = {test for test in self.seconds if Path(test.partition("::")[0]).stem.removeprefix("test_") in parts}
        chosen, total_s = [], 0.0
        all_of = self.seconds if self.again or not tests else {*tests, *named}
        later = {
            test: not test.startswith(FIRST) and (test not in named or self.seconds[test] > QUICK_S) for test in all_of
        }
        for test in sorted(all_of, key=lambda test: (test not in tests | named, later[test], self.seconds[test])):
            total_s += 0.0 if test.startswith(FIRST) else self.seconds[test]
            if chosen and total_s > MOST_TESTS_S * (AGAIN if self.again else 1):
                break
            chosen.append(test)
        return chosen

    def killed(self, mutant: Mutant) -> bool:
        """Whether a test fails, or takes far longer, with the mutant in place."""
        file = self.folder / mutant.file
        original, status = file.read_bytes(), file.stat()
        has_loops = USES_LOOPS in original
        compiled = self.folder / ("changed" if has_loops else COMPILED)
        if has_loops:  # Numba compiles the changed file anew; no loop calls one of another file
            shutil.copytree(self.folder / COMPILED, compiled, copy_function=os.link)
        file.write_bytes(mutant.apply(original))
        tests = self.tests_of(mutant)
        quick = sum(total_s < QUICK_S for total_s in accumulate(self.seconds[test] for test in tests))
        try:
            # the first ones alone: others may import much
            return any(self._fail(part, compiled, mutant) for part in (tests[:quick], tests[quick:]) if part)
        finally:
            if has_loops:
                shutil.rmtree(compiled)
            file.write_bytes(original)
            os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))

    def _fail(self, tests: Sequence[str], compiled: Path, mutant: Mutant) -> bool:
        """Whether one of these tests fails now, or takes far longer."""
        (self.folder / "chosen.txt").write_text("\n".join(tests))
        listen, announce = os.pipe()
        words = ["-x", "--nightly", "@chosen.txt"]
        child = self._fork(lambda: _pytest(words, Announcer(announce)), self.folder / "mutant.log", compiled)
        os.close(announce)
        try:
            # a test may have to make what another one made in the first run
            grace_s = 3 * max(self.seconds.values()) + (GRACE_S if compiled.name == COMPILED else 3 * GRACE_S)
            if not self._in_time(listen, grace_s):
                self.too_slow.append(mutant)
                return True
            return _wait(child) != 0
        finally:
            _end(child)
            os.close(listen)

    def _in_time(self, announcements: int, grace_s: float) -> bool:
        """Follow the tests until the pipe is closed: whether none took too long."""
        load = min(3.0, max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1)))
        limit_s = 6 * GRACE_S * load  # tests are collected
        while select.select([announcements], [], [], limit_s)[0]:
            names = os.read(announcements, 1 << 16).decode().split("\n")[:-1]
            if not names:
                return True
            limit_s = (SLOWER * self.seconds.get(names[-1], 1.0) + grace_s) * load
        return False


def moved_rows(old: str, new: str) -> dict[int, int]:
    """Number of a row in the old text -> its number in the new one, of rows that are the same; from 1 on."""
    blocks = difflib.SequenceMatcher(None, old.splitlines(), new.splitlines(), autojunk=False).get_matching_blocks()
    return {block.a + i + 1: block.b + i + 1 for block in blocks for i in range(block.size)}


def moved(mutant: Mutant, old: str, new: str) -> Mutant | None:
    """A mutant of the old text in the new one; None where its rows are gone."""
    row_of = moved_rows(old, new)
    last = mutant.line + old.encode()[mutant.start : mutant.end].count(b"\n")
    rows = [row_of[row] for row in range(mutant.line, last + 1) if row in row_of]
    if len(rows) <= last - mutant.line:
        return None
    before, after = (text.encode().splitlines(keepends=True) for text in (old, new))
    by = sum(map(len, after[: rows[0] - 1])) - sum(map(len, before[: mutant.line - 1]))
    return replace(mutant, line=rows[0], start=mutant.start + by, end=mutant.end + by)


def copy_checkout(folder: Path) -> None:
    """Copy sources and tests."""
    for one in COPIED:
        path = ROOT / one
        shutil.rmtree(folder / one, ignore_errors=True)
        (shutil.copytree if path.is_dir() else shutil.copy2)(path, folder / one)


def _files_of(folder: Path, places: Sequence[str], pattern: str) -> list[str]:
    """The files at or below these places, relative to a folder."""
    found = [p for one in places for p in ([folder / one] if one.endswith(".py") else (folder / one).rglob(pattern))]
    return sorted(path.relative_to(folder).as_posix() for path in found)


def _pytest(words: Sequence[str], plugin: object) -> int:
    """Run tests; loops compiled before are taken again if nothing changed in their file."""
    import pytest

    compiled = importlib.import_module("procedures.numerics.compiled")
    compiled._digest = lambda root: "same"  # type: ignore[attr-defined]
    quiet = ("-W", "ignore::pytest.PytestAssertRewriteWarning")  # of what is preloaded
    alone = ("-k", "not on_paper")  # a browser notices no number
    return int(pytest.main(["-q", "-n", "0", *quiet, *alone, *words], plugins=[plugin]))


def _record(sources: Sequence[str], tests: Sequence[str], out: Path, quick: bool) -> int:
    """Run tests and write which of them executes which line."""
    recorder = Recorder(sources)
    code = _pytest([*tests, *(("-m", "not slow") if quick else ())], recorder)
    if code > 1:  # no test ran
        return code
    out.write_text(json.dumps({"seconds": recorder.seconds, "lines": recorder.lines, "failed": recorder.failed}))
    return code


def _wait(child: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _end(child: int) -> None:
    """End what is left of a child's group."""
    for end in (lambda: os.killpg(child, signal.SIGKILL), lambda: os.waitpid(child, 0)):
        with contextlib.suppress(ProcessLookupError, ChildProcessError):
            end()


def described(mutant: Mutant, folder: Path) -> str:
    """The changed rows before and after."""
    source = (folder / mutant.file).read_bytes()
    first = source.rfind(b"\n", 0, mutant.start) + 1
    last = source.find(b"\n", mutant.end)
    before, after = source[first:last].decode(), (source[first : mutant.start] + mutant.text.encode()
                                                  + source[mutant.end : last]).decode()  # fmt: skip
    return f"{mutant.file}:{mutant.line}\n    - {before.strip()}\n    + {after.strip()}"


def tried(name: str, count: int, seed: int, folder: Path, quick: bool = False, golden: bool = True) -> None:
    """Try random mutants of an area, or those that survived in a kept folder, and print what survives."""
    begin = time.monotonic()
    area = Area(name, folder, quick, golden)
    kept = folder / f"{name}-mutants.json"
    if kept.exists():
        state = json.loads(kept.read_text())
        all_of = [Mutant(**one) for one in state["survivors"]]
        texts = {file: (folder / file).read_text() if file in area.files else "" for file in state["sources"]}
        now = [moved(one, state["sources"][one.file], texts[one.file]) for one in all_of]
        mutants = [one for one in now if one is not None]
        total = state["total"] - len(all_of) + len(mutants)
        area.again = True
    else:
        mutants = area.mutants(count, random.Random(f"{seed} {name}"))
        total = len(mutants)
    survivors = []
    for one in mutants:
        if not area.killed(one):
            survivors.append(one)
            print(f"  {described(one, folder)}\n    {len(area.tests_of(one))} tests", flush=True)
    for one in area.too_slow:
        print(f"  too slow: {described(one, folder)}")
    sources = {one.file: (folder / one.file).read_text() for one in survivors}
    kept.write_text(json.dumps({"total": total, "survivors": [asdict(one) for one in survivors], "sources": sources}))
    dead = total - len(survivors)
    low = beta.ppf(0.025, dead, total - dead + 1) if dead else 0.0
    high = beta.ppf(0.975, dead + 1, total - dead) if dead < total else 1.0
    print(f"{name}: {dead} of {total} killed ({dead / total:.0%}, 95 % interval {low:.0%} to {high:.0%}),"
          f" {len(area.seconds)} tests, {time.monotonic() - begin:.0f} s", flush=True)  # fmt: skip


def main() -> int:
    """Read the command line and try the mutants."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("areas", nargs="*", metavar="AREA", help=", ".join(AREAS))
    parser.add_argument("--count", type=int, default=25)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="copies, records and survivors; by default none")
    parser.add_argument("--quick", action="store_true", help="without the tests marked slow")
    parser.add_argument("--without-golden", action="store_true", help="without frozen records")
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(143))  # no mutant stays in a kept copy
    for module in PRELOADED:
        __import__(module)
    with tempfile.TemporaryDirectory() as passing:
        folder = (options.keep or Path(passing)).resolve()
        copy_checkout(folder)
        for name in options.areas or AREAS:
            tried(name, options.count, options.seed, folder, options.quick, not options.without_golden)
    return 0


if __name__ == "__main__":
    sys.exit(main())
