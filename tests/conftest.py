import gc
import hashlib
import os
import random
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

# as the program does for itself, before numpy is loaded: see station.__main__
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# the usual paper is A4 then, wherever the tests run
os.environ["LC_PAPER"] = "C"

import hypothesis
import numpy as np
import pytest

from procedures.reading import hdf5

from .browser import CHROMIUM, Browser

# the same examples every time: a rare one that fails is to be found by whoever looks for it (HYPOTHESIS=search), not by
# whoever changes something else. None has a deadline by the clock, which a busy machine would miss
hypothesis.settings.register_profile("fixed", derandomize=True, deadline=None)
hypothesis.settings.register_profile("search", deadline=None)
hypothesis.settings.load_profile("search" if os.environ.get("HYPOTHESIS") == "search" else "fixed")

# a process that has imported everything keeps a large heap: looking through it for garbage after every 700 containers,
# as is Python's habit, takes a good part of the time
gc.set_threshold(500_000)

# a file is waited for until it lies on the disk: a fifth of the tests' time, and no test can see the difference. What a
# power cut leaves is played by tests/station/sessions/faulty_disk.py, and programs that tests start do wait
os.fsync = os.fstat  # refuses what is no file, as it does

# nohup and shell scripts start the tests with signals ignored, and programs that tests start would inherit that. With a
# handler, which no program inherits, the signals have their usual effect there and still none here
for _number in (getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT") if hasattr(signal, name)):
    if signal.getsignal(_number) == signal.SIG_IGN:
        signal.signal(_number, lambda number, frame: None)

ROOT = Path(__file__).resolve().parent.parent
PROGRAMS = {"chromium": CHROMIUM, "pdftotext of poppler": shutil.which("pdftotext")}
ABSENT = "no shared data"

# a folder that is not there is no folder: the commands take it from the environment too, and refuse it
if not Path(os.environ.get("STATION_SHARED_DATA", ROOT)).is_dir():
    del os.environ["STATION_SHARED_DATA"]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20120323)


@pytest.fixture(scope="session")
def browser(tmp_path_factory) -> Iterator[Browser]:
    """A browser without a window, started once."""
    if missing := [name for name, path in PROGRAMS.items() if path is None]:
        pytest.skip(f"needs {' and '.join(missing)}")
    started = Browser(tmp_path_factory.mktemp("browser"))
    yield started
    started.close()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of photographs and known truths that is kept beside the project."""
    folder = Path(os.environ.get("STATION_SHARED_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"{ABSENT} at {folder}; set STATION_SHARED_DATA to its folder")
    return folder


@pytest.fixture(scope="session", autouse=True)
def _hdf5_checked_once() -> Iterator[None]:
    """A content that the HDF5 library came to an end with is not gone through again: each time starts a process."""
    ended: set[tuple[str, ...]] = set()

    def run(words: list[str], **options: Any) -> subprocess.CompletedProcess[bytes]:
        _, _, program, path, *limits = words
        content = program, hashlib.sha256(Path(path).read_bytes()).hexdigest(), *limits
        done = subprocess.CompletedProcess(words, 0) if content in ended else subprocess.run(words, **options)
        if done.returncode == 0:
            ended.add(content)
        return done

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hdf5, "subprocess", SimpleNamespace(run=run, TimeoutExpired=subprocess.TimeoutExpired))
        yield


@pytest.fixture
def start_program() -> Iterator[Callable[..., subprocess.Popen[Any]]]:
    """start_program(words, **options): subprocess.Popen; killed after the test if it still runs then.

    A program that outlives a failed test opens the ports of the tests that follow.
    """
    started: list[subprocess.Popen[Any]] = []

    def start(words: list[object], **options: Any) -> subprocess.Popen[Any]:
        started.append(subprocess.Popen([str(word) for word in words], **options))
        return started[-1]

    yield start
    for program in started:
        program.kill()
        program.wait()
        for stream in (program.stdin, program.stdout, program.stderr):
            if stream is not None:
                stream.close()


@pytest.fixture(scope="session")
def read_until() -> Callable[[Any, str], str]:
    """read_until(stream, text): what a program writes, up to this text; fails if the program ends without it."""

    def read(stream: Any, text: str) -> str:
        seen = ""
        while text not in seen:
            character = stream.read(1)
            assert character, f"the program ended without {text!r}: {seen!r}"
            seen += character
        return seen

    return read


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--nightly`: the tests marked so, too, which otherwise never run, whatever `-m` selects."""
    parser.addoption("--nightly", action="store_true", help="run the tests marked nightly, too")
    parser.addoption("--shuffle", metavar="SEED", help="files, and the tests in each, in a random order")


def pytest_configure(config: pytest.Config) -> None:
    """Where processes share the tests, files come in the order below, not by the number of tests in them."""
    config.option.loadscopereorder = False


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The rules of style first, then the files with slow tests, so that none of these is waited for at the end.

    A test is slow too that asks for one of the fixtures which its file calls SLOW_FIXTURES: these take seconds to make.
    """
    if not config.getoption("--nightly"):
        nightly = [item for item in items if item.get_closest_marker("nightly")]
        config.hook.pytest_deselected(items=nightly)
        items[:] = [item for item in items if not item.get_closest_marker("nightly")]
    for item in items:
        if isinstance(item, pytest.Function) and set(item.fixturenames) & getattr(item.module, "SLOW_FIXTURES", set()):
            item.add_marker(pytest.mark.slow)
    if seed := config.getoption("--shuffle"):
        chance = random.Random(seed)
        places = {path: chance.random() for path in sorted({item.path for item in items})}
        items.sort(key=lambda item: (places[item.path], chance.random()))
        return
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (item.path.name != "test_house.py", item.path not in slow))


def pytest_collection_finish() -> None:
    """What is imported and collected stays: nothing in it is garbage."""
    gc.freeze()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say in one line how many tests were left out because the shared data are not here."""
    left_out = [one for one in terminalreporter.stats.get("skipped", []) if ABSENT in str(one.longrepr)]
    if left_out:
        terminalreporter.write_line(
            f"{len(left_out)} tests need shared data and were left out: set STATION_SHARED_DATA"
        )
