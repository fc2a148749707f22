"""Mutation testing: random small changes of the sources, and whether the tests notice them.

    python mutants.py [AREA ...] [--count 25] [--seed N] [--keep FOLDER]

The tests of an area run once under coverage.py, so that the tests of each line are known. Each mutant is then written
into a copy of the sources, and the tests of its line run, the fastest first, until one fails. Machine code is invisible
to coverage: in a file with compiled loops, lines without a test of their own are tried with all tests of that file. A
mutant whose tests take more than ten times as long as before counts as killed. Printed are the share killed with its
95 % interval (Clopper-Pearson) and the survivors as a difference.

Needs coverage (`pip install coverage`).
"""

from __future__ import annotations

import argparse
import ast
import copy
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scipy.stats import beta

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("station", "drivers", "procedures", "simulators", "tests", "pyproject.toml", "README.md", "CHANGELOG.md")
AREAS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "pattern_psf": (("procedures/pattern_psf",), ("tests/procedures/pattern_psf",)),
    "two_photo": (("procedures/two_photo",), ("tests/procedures/two_photo",)),
    "field": (("procedures/field",), ("tests/procedures/field",)),
    "geometry": (("procedures/geometry",), ("tests/procedures/geometry",)),
    "numerics": (("procedures/numerics",), ("tests/procedures/numerics",)),
    "slanted_edge": (("procedures/slanted_edge",), ("tests/procedures/slanted_edge",)),
    "sessions": (("station/sessions",), ("tests/station/sessions",)),
    "batch": (("station/batch",), ("tests/station/batch",)),
    "stop path": (
        ("station/common/stop_signals.py", "station/bench", "drivers/transport.py", "drivers/grbl.py"),
        ("tests/station/common", "tests/station/bench", "tests/drivers", "tests/conformance"),
    ),
    "measurement": (("station/results", "station/procedure"), ("tests/station/results", "tests/station/procedure")),
}
"""Area -> its sources and its tests."""
SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.Add: ast.Sub, ast.Sub: ast.Add,
    ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.And: ast.Or, ast.Or: ast.And, ast.LShift: ast.RShift,
    ast.Break: ast.Continue, ast.Continue: ast.Break,
}  # fmt: skip
SLOWER = 10.0
GRACE_S = 30.0
MOST_TESTS_S = 240.0
"""Tests of one mutant take at most this long by the times of the first run; further ones are not tried."""


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
    """Plugin of pytest: which test executes which line of the sources, and how long it takes."""

    def __init__(self, sources: Sequence[str], out: Path) -> None:
        import coverage

        self.coverage = coverage.Coverage(
            data_file=None,
            source=None,
            include=[f"{s}{end}" for s in sources for end in ("", "/**")],
            config_file=False,
        )
        self.out, self.seconds, self.failed = out, dict[str, float](), list[str]()

    def pytest_sessionstart(self) -> None:
        self.coverage.start()
        self.coverage.switch_context("imports")

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.coverage.switch_context(nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if report.failed:
            self.failed.append(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        self.coverage.stop()
        data, lines = self.coverage.get_data(), {}
        for file in data.measured_files():
            name = Path(file).relative_to(Path.cwd()).as_posix()
            lines[name] = data.contexts_by_lineno(file)
        self.out.write_text(json.dumps({"seconds": self.seconds, "lines": lines, "failed": self.failed}))


class Area:
    """The sources and tests of an area in a copy of the checkout."""

    def __init__(self, name: str, folder: Path) -> None:
        sources, self.tests = AREAS[name]
        self.name, self.folder = name, folder
        self.files = sorted(
            path.relative_to(folder).as_posix()
            for source in sources
            for path in ([folder / source] if source.endswith(".py") else (folder / source).rglob("*.py"))
        )
        self.environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1",
                            "STATION_SHARED_DATA": str(ROOT.parent / "shared" / "data")}  # fmt: skip
        out = folder / "recorded.json"
        words = [sys.executable, str(Path(__file__).resolve()), "--record", str(out), *sources, "--", *self.tests]
        subprocess.run(words, cwd=folder, env=self.environment, check=False, stdout=subprocess.DEVNULL)
        record = json.loads(out.read_text())
        if record["failed"]:
            print(f"{name}: fail without a mutant, and are not used: {', '.join(record['failed'])}")
        self.seconds: dict[str, float] = {t: s for t, s in record["seconds"].items() if t not in record["failed"]}
        self.lines: dict[str, dict[str, list[str]]] = record["lines"]

    def mutants(self, count: int, rng: random.Random) -> list[Mutant]:
        """Random mutants, each line alike."""
        all_of = [m for file in self.files for m in mutants_of(file, (self.folder / file).read_bytes())]
        return rng.sample(all_of, min(count, len(all_of)))

    def tests_of(self, mutant: Mutant) -> list[str]:
        """The tests that execute its line, the fastest first; all of the area where it runs only at import."""
        lines = self.lines.get(mutant.file, {})
        tests = {test for test in lines.get(str(mutant.line), []) if test in self.seconds}
        compiled = "compiled" in (self.folder / mutant.file).read_text()
        if not tests and ("imports" in lines.get(str(mutant.line), []) or compiled):
            tests = {t for line in lines.values() for t in line if t in self.seconds} or set(self.seconds)
        ordered, chosen, total_s = sorted(tests, key=lambda t: self.seconds[t]), [], 0.0
        for test in ordered:
            total_s += self.seconds[test]
            if chosen and total_s > MOST_TESTS_S:
                break
            chosen.append(test)
        return chosen

    def killed(self, mutant: Mutant) -> bool:
        """Whether a test fails, or takes far longer, with the mutant in place."""
        tests = self.tests_of(mutant)
        if not tests:
            return False
        file = self.folder / mutant.file
        original = file.read_bytes()
        file.write_bytes(mutant.apply(original))
        (self.folder / "chosen.txt").write_text("\n".join(tests))
        words = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:randomly", "-p", "no:cacheprovider", "-n", "0",
                 "--nightly", "@chosen.txt"]  # fmt: skip
        limit_s = SLOWER * sum(self.seconds[t] for t in tests) + GRACE_S
        try:
            done = subprocess.run(words, cwd=self.folder, env=self.environment, capture_output=True, timeout=limit_s)
        except subprocess.TimeoutExpired:
            return True
        finally:
            file.write_bytes(original)
        return done.returncode != 0


def described(mutant: Mutant, folder: Path) -> str:
    """The changed rows before and after."""
    source = (folder / mutant.file).read_bytes()
    first = source.rfind(b"\n", 0, mutant.start) + 1
    last = source.find(b"\n", mutant.end)
    before, after = source[first:last].decode(), (source[first : mutant.start] + mutant.text.encode()
                                                  + source[mutant.end : last]).decode()  # fmt: skip
    return f"{mutant.file}:{mutant.line}\n    - {before.strip()}\n    + {after.strip()}"


def tried(name: str, count: int, seed: int, folder: Path) -> tuple[int, int]:
    """Try random mutants of an area and print what survives: number killed, number tried."""
    begin = time.monotonic()
    area = Area(name, folder)
    mutants = area.mutants(count, random.Random(f"{seed} {name}"))
    survivors = [one for one in mutants if not area.killed(one)]
    total, dead = len(mutants), len(mutants) - len(survivors)
    low = beta.ppf(0.025, dead, total - dead + 1) if dead else 0.0
    high = beta.ppf(0.975, dead + 1, total - dead) if dead < total else 1.0
    print(f"{name}: {dead} of {total} killed ({dead / total:.0%}, 95 % interval {low:.0%} to {high:.0%}),"
          f" {len(area.seconds)} tests, {time.monotonic() - begin:.0f} s")  # fmt: skip
    for one in survivors:
        tests = len(area.tests_of(one))
        print(
            f"  {described(one, folder)}\n    {f'{tests} tests execute it' if tests else 'no test executes it'}",
            flush=True,
        )
    return dead, total


def record(out: Path, sources: Sequence[str], tests: Sequence[str]) -> int:
    """Run tests and write which of them executes which line."""
    import pytest

    return pytest.main(["-q", "-n", "0", "-p", "no:randomly", *tests], plugins=[Recorder(sources, out)])


def main() -> int:
    """Read the command line and try the mutants."""
    if sys.argv[1:2] == ["--record"]:
        split = sys.argv.index("--")
        return record(Path(sys.argv[2]), sys.argv[3:split], sys.argv[split + 1 :])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("areas", nargs="*", metavar="AREA", help=", ".join(AREAS))
    parser.add_argument("--count", type=int, default=25)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for name in options.areas or AREAS:
        with tempfile.TemporaryDirectory() as folder:
            for one in COPIED:
                path = ROOT / one
                (shutil.copytree if path.is_dir() else shutil.copy2)(path, Path(folder) / one)
            tried(name, options.count, options.seed, Path(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
