"""Of processes that want one kernel at a time, one compiles."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from procedures.numerics import kernel_cache, kernel_lock

ROOT = Path(__file__).parents[3]
HOLDER = """
import sys
from pathlib import Path
from procedures.numerics.kernel_lock import only_one
with only_one(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.readline()
    Path(sys.argv[1]).write_text("code")
    print("kept", flush=True)
"""


@pytest.fixture
def path(tmp_path):
    return tmp_path / "below" / "some.kernel"


@pytest.fixture
def holder(path):
    """Another process that holds the lock of `path` until it gets a line, or is killed."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def let_go_while_waited_for(monkeypatch, act):
    """Do `act` when the lock is first found held; the wait then goes on without waiting."""
    waits = []

    def sleep(_):
        if not waits:
            act()
        waits.append(1)

    monkeypatch.setattr(kernel_lock.time, "sleep", sleep)
    return waits


def test_the_second_enters_when_the_first_has_kept_its_code(path, holder, monkeypatch):
    def finish():
        holder.stdin.write("\n")
        holder.stdin.flush()
        assert holder.stdout.readline() == "kept\n"

    waits = let_go_while_waited_for(monkeypatch, finish)
    with kernel_lock.only_one(path):
        assert path.read_text() == "code"
    assert waits
    assert os.listdir(path.parent) == [path.name]


def test_a_killed_owner_holds_nobody_up(path, holder, monkeypatch):
    def kill():
        holder.send_signal(signal.SIGKILL)
        holder.wait()

    assert_entered_after(path, monkeypatch, kill)


def test_a_stopped_owner_holds_up_for_a_while(path, holder, monkeypatch):
    # the clock is set forward by all that is waited
    now = [0.0]
    monkeypatch.setattr(kernel_lock.time, "monotonic", lambda: now[0])

    def pass_time():
        now[0] += kernel_lock.WAIT_S

    assert_entered_after(path, monkeypatch, pass_time)


def assert_entered_after(path, monkeypatch, act):
    waits = let_go_while_waited_for(monkeypatch, act)
    entered = False
    with kernel_lock.only_one(path):
        entered = True
    assert entered
    assert waits


@pytest.mark.parametrize("spoilt", ["no folder", "no lock"])
def test_where_nothing_can_be_locked_all_enter(path, tmp_path, monkeypatch, spoilt):
    if spoilt == "no folder":
        path.parent.touch()
    else:
        monkeypatch.setattr("fcntl.flock", lambda *_: (_ for _ in ()).throw(OSError("not on this file system")))
    with kernel_lock.only_one(path):
        assert not path.exists()


def test_an_error_within_leaves_no_lock_behind(path):
    with pytest.raises(ArithmeticError), kernel_lock.only_one(path):
        raise ArithmeticError
    assert os.listdir(path.parent) == []


@pytest.mark.slow
def test_a_kernel_that_numba_keeps_is_compiled_by_one_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    entered = []

    @contextmanager
    def only_one(path):
        entered.append(path)
        yield

    monkeypatch.setattr(kernel_cache, "only_one", only_one)
    kernel = kernel_cache.jitted()(plus_one)
    assert [kernel(1), kernel(2), kernel(1.5)] == [2, 3, 2.5]
    assert len(entered) == 2  # whole numbers and others: once each, when there is something to compile
    assert {path.name for path in entered} == {f"{__name__}.plus_one"}
    assert tmp_path in entered[0].parents


def plus_one(x):
    return x + 1
