"""Processes that die: the item is named, the rest is finished."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from multiprocessing.context import SpawnProcess
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from procedures.outcome import BadParameter, Refused
from station.batch import dask_pool, process_pool
from station.batch.dask_pool import run_on_cluster
from station.batch.process_pool import (
    DEATHS_IN_A_ROW,
    NO_LIMIT,
    ONE_THREAD,
    TRIES,
    Allowance,
    Lost,
    Stop,
    limited_memory,
    one_thread,
    run_in_processes,
    single_threads,
)


def run(errands, tmp_path, count=8, jobs=2, stop=None, allowance=NO_LIMIT, **trouble):
    errand = errands.Errand(tmp_path, **trouble)
    return dict(run_in_processes(errands.square, errand, range(count), jobs, stop or Stop(), allowance))


def test_every_item_is_worked_on_once(errands, tmp_path):
    before, threads = (dict(os.environ), signal.pthread_sigmask(signal.SIG_BLOCK, ())), set(threading.enumerate())
    assert run(errands, tmp_path) == {n: n * n for n in range(8)}
    assert (dict(os.environ), signal.pthread_sigmask(signal.SIG_BLOCK, ())) == before
    assert set(threading.enumerate()) <= threads  # those of other tests may end meanwhile


def test_processes_start_with_one_thread_each_and_what_was_set_before_comes_back(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    before = dict(os.environ)
    with single_threads():
        assert [os.environ[name] for name in ONE_THREAD] == ["1"] * 4
    assert dict(os.environ) == before


def test_a_process_computes_in_one_thread(monkeypatch):
    cv2, numba = Mock(), Mock()
    monkeypatch.setitem(sys.modules, "cv2", cv2)
    monkeypatch.setitem(sys.modules, "numba", numba)
    one_thread()
    cv2.setNumThreads.assert_called_once_with(1)
    numba.set_num_threads.assert_called_once_with(1)
    monkeypatch.delitem(sys.modules, "cv2")
    monkeypatch.delitem(sys.modules, "numba")
    one_thread()
    assert not {"cv2", "numba"} & set(sys.modules)  # what is not loaded is not loaded for that


def test_pipe_is_closed_only_after_its_sender(errands, tmp_path, monkeypatch):
    closed, send = [], process_pool._send

    def late(pipe, outgoing):
        send(pipe, outgoing)
        threading.Event().wait(0.2)
        closed.append(pipe.closed)

    monkeypatch.setattr(process_pool, "_send", late)
    run(errands, tmp_path, count=1)
    assert closed == [False]


def test_every_process_has_ended_when_the_answers_are_given_up(errands, tmp_path, monkeypatch):
    start, started = SpawnProcess.start, []
    monkeypatch.setattr(SpawnProcess, "start", lambda process: (start(process), started.append(process)))
    answers = run_in_processes(errands.square, errands.Errand(tmp_path, endless=(1,)), range(2), 2, Stop())
    assert next(answers) == (0, 0)
    answers.close()
    assert [process._popen.returncode for process in started] == [-signal.SIGKILL] * 2  # without waiting now


def test_item_that_always_ends_its_process_is_named_and_the_rest_is_finished(errands, tmp_path):
    found = run(errands, tmp_path, deadly=(3,))
    assert found.pop(3) == Lost(f"the process that worked on it was ended by the system (SIGKILL), {TRIES} times")
    assert found == {n: n * n for n in range(8) if n != 3}
    assert len((tmp_path / "3").read_text()) == TRIES


def test_item_whose_process_was_killed_once_is_done_again(errands, tmp_path):
    assert run(errands, tmp_path, deadly_once=(2, 5)) == {n: n * n for n in range(8)}


def test_process_that_ends_by_itself_shows_its_exit_code(errands, tmp_path):
    found = run(errands, tmp_path, count=2, quits=(0, 1))
    assert [f"exit code {code}" in found[item].reason for item, code in ((0, 0), (1, 7))] == [True, True]


@pytest.mark.slow
def test_processes_that_die_without_end_are_not_blamed_on_the_items(errands, tmp_path):
    with pytest.raises(Refused, match=f"{DEATHS_IN_A_ROW} died one after the other"):
        run(errands, tmp_path, count=20, jobs=1, deadly=tuple(range(20)))
    assert sum(len(mark.read_text()) for mark in tmp_path.iterdir()) == DEATHS_IN_A_ROW


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "waitid"), reason="the system does not show which child is stopped")
def test_process_that_is_stopped_is_ended_and_its_item_done_again(errands, tmp_path, monkeypatch):
    monkeypatch.setattr("station.batch.process_pool.STOPPED_S", 0.2)
    monkeypatch.setattr("station.batch.process_pool.POLL_S", 0.1)
    assert run(errands, tmp_path, stops_once=(1, 4)) == {n: n * n for n in range(8)}
    assert (tmp_path / "1").exists()


def test_process_that_is_stopped_before_it_takes_its_work_holds_nobody(errands, tmp_path, monkeypatch):
    monkeypatch.setattr("station.batch.process_pool.STOPPED_S", 0.2)
    monkeypatch.setattr("station.batch.process_pool.POLL_S", 0.1)
    start, started = SpawnProcess.start, []

    def stopped(process):
        start(process)
        if not started:
            os.kill(process.pid, signal.SIGSTOP)
        started.append(process)

    monkeypatch.setattr(SpawnProcess, "start", stopped)
    errand = replace(errands.Errand(tmp_path), ballast=bytes(10_000_000))  # more than any pipe holds
    found = dict(run_in_processes(errands.square, errand, range(4), 2, Stop()))
    assert found == {n: n * n for n in range(4)}
    # a third where one that works had not taken all of the work before the stopped one was given up
    assert 2 <= len(started) <= 3


def test_item_that_takes_too_long_is_named_and_not_tried_again(errands, tmp_path, monkeypatch):
    monkeypatch.setattr("station.batch.process_pool.POLL_S", 0.1)
    found = run(errands, tmp_path, count=4, allowance=Allowance(time_s=3.0), endless=(2,))
    assert found.pop(2) == Lost("it took longer than 3 s")
    assert found == {n: n * n for n in (0, 1, 3)}


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux holds to a limit of address space")
def test_item_that_takes_too_much_memory_gets_an_error_and_the_next_ones_their_own_room(errands, tmp_path):
    allowance = Allowance(memory_bytes=1 << 30)
    found = run(errands, tmp_path, count=4, jobs=1, allowance=allowance, greedy=(1,))
    assert found == {0: 0, 1: -1, 2: 4, 3: 9}


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux holds to a limit of address space")
@pytest.mark.parametrize("hard", [None, 1 << 40, 1 << 20])
def test_limit_of_memory_is_beside_what_is_taken_and_within_the_systems(monkeypatch, hard):
    import resource

    most, limits = resource.RLIM_INFINITY if hard is None else hard, []
    monkeypatch.setattr(resource, "getrlimit", lambda which: (1 << 50, most))
    monkeypatch.setattr(resource, "setrlimit", lambda which, limit: limits.append((which, limit)))
    status = Path("/proc/self/status").read_text()
    taken = 1024 * int(re.search(r"VmSize:\s*(\d+) kB", status)[1])
    with limited_memory(1 << 30):
        ((which, (soft, unchanged)),) = limits
    assert (which, unchanged) == (resource.RLIMIT_AS, most)
    # what was allocated since it was read is far below a hundredth of the limit
    assert soft == pytest.approx(taken + (1 << 30) if most != 1 << 20 else 1 << 20, rel=0.01)
    assert limits[1] == (resource.RLIMIT_AS, (1 << 50, most))
    with limited_memory(None):
        assert len(limits) == 2


def test_share_of_memory_is_smaller_for_more_processes_and_never_too_small():
    one, many = Allowance.fair(1), Allowance.fair(10_000)
    assert one.time_s == many.time_s == 3600
    if one.memory_bytes is not None:
        assert one.memory_bytes > many.memory_bytes == 2_000_000_000


def test_what_runs_is_finished_when_asked_to_stop_and_nothing_else_is_begun(errands, tmp_path):
    stop, found = Stop(), {}
    for number, answer in run_in_processes(errands.square, errands.Errand(tmp_path), range(50), 2, stop):
        found[number] = answer
        stop.ask()
    assert 1 <= len(found) <= 3  # the two that ran, and one more if it had been given out by then
    assert found == {n: n * n for n in found}


@pytest.mark.parametrize(("error", "words"), [(OSError("refused"), "refused"), (KeyError("op"), "KeyError: 'op'")])
def test_what_does_not_answer_as_a_cluster_is_named_with_its_address(error, words, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "Client", Mock(side_effect=error))
    with pytest.raises(BadParameter, match=f"no cluster answers at tcp://here:1: {words}"):
        dask_pool._connected("tcp://here:1", None)


class Cluster:
    """A client of three threads whose work ends at once, that of some items as `ends` says at first."""

    def __init__(self, ends, status="running"):
        self.ends, self.status, self.begun = dict(ends), status, []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def nthreads(self):
        return {"one": 1, "other": 2}

    def submit(self, function, *words, pure):
        assert not pure
        if function is dask_pool._same:
            return function(*words)
        self.begun.append(words[1])
        future = Mock(status=self.ends.pop(words[1], "finished"))
        future.result.side_effect, future.exception.return_value = lambda: function(*words), OSError("gone")
        future.add_done_callback.side_effect = lambda call: call(future)
        return future


def test_work_whose_worker_died_with_the_answer_is_given_out_again(monkeypatch):
    cluster, stop, found = Cluster({2: "lost", 3: "error"}), Stop(), []
    monkeypatch.setattr(dask_pool, "_connected", lambda *_: cluster)
    answers = run_on_cluster(lambda item, job: item * job, 10, range(20), stop, "tcp://here:1")
    assert next(answers) == (0, 0)
    assert cluster.begun == [0, 1, 2, 3, 4, 5]  # two for each of three threads
    found = [next(answers) for _ in range(3)]
    assert found == [(1, 10), (3, Lost("the cluster gave it up: OSError: gone")), (4, 40)]
    assert cluster.begun[6:9] == [6, 7, 2]
    stop.ask()
    assert dict(answers).keys() == set(cluster.begun) - {0, 1, 3, 4}
    cluster = Cluster({1: "lost"}, status="closed")
    monkeypatch.setattr(dask_pool, "_connected", lambda *_: cluster)
    with pytest.raises(Refused, match="the cluster at tcp://here:1 went away"):
        list(run_on_cluster(lambda item, job: item, 0, range(3), Stop(), "tcp://here:1"))


def test_what_a_cluster_could_not_do_is_lost_with_the_reason():
    def future(status, error=None):
        return SimpleNamespace(status=status, result=lambda: 4, exception=lambda: error)

    killed = type("KilledWorker", (Exception,), {})()
    assert dask_pool._answer(future("finished")) == 4
    assert "died or took too long" in dask_pool._answer(future("error", killed)).reason
    assert dask_pool._answer(future("error", OSError("gone"))) == Lost("the cluster gave it up: OSError: gone")


@pytest.mark.slow
@pytest.mark.nightly
def test_cluster_gives_the_same_and_survives_a_killed_worker(errands, tmp_path):
    distributed = pytest.importorskip("distributed")
    errand = errands.Errand(tmp_path, deadly_once=(4,))
    cluster = distributed.LocalCluster(2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50)
    with cluster:
        found = dict(run_on_cluster(errands.square, errand, range(8), Stop(), cluster.scheduler_address))
    assert (tmp_path / "4").exists()
    assert found == {n: n * n for n in range(8)}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="a process shows its signals in /proc")
def test_no_process_of_a_pool_hears_of_ctrl_c(errands, tmp_path):
    errand = errands.Errand(tmp_path)
    assert dict(run_in_processes(errands.deaf, errand, range(2), 2, Stop())) == {0: True, 1: True}


CTRL_C = """
import errands, pathlib, sys
from station.common.stop_signals import guarded
from station.batch.process_pool import Stop, run_in_processes
if __name__ == "__main__":
    errand, stop = errands.Errand(pathlib.Path(sys.argv[1]), endless=range(9)), Stop()
    with guarded(lambda: None, stop.ask, terminated=130):
        list(run_in_processes(errands.square, errand, range(9), 2, stop))
"""


def group_ends(group):
    """Whether all processes of a group are gone within some seconds."""
    for _ in range(200):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="there are no groups of processes")
def test_ctrl_c_twice_ends_endless_work_and_all_its_processes(tmp_path):
    script = tmp_path / "ctrl_c.py"
    script.write_text(CTRL_C)
    here = Path(__file__).parent
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(here.parents[2]), str(here)])}
    words = [sys.executable, script, tmp_path]
    with subprocess.Popen(words, env=environment, start_new_session=True, stderr=subprocess.PIPE) as program:
        while len(list(tmp_path.glob("[0-9]"))) < 2:
            assert program.poll() is None
            time.sleep(0.05)
        os.killpg(program.pid, signal.SIGINT)  # as a terminal does: parent, workers and their helpers
        with pytest.raises(subprocess.TimeoutExpired):
            program.wait(1.0)  # what runs is finished
        os.killpg(program.pid, signal.SIGINT)
        said = program.communicate(timeout=60)[1]
        assert b"KeyboardInterrupt" in said
        assert program.returncode in (1, -signal.SIGINT)
    assert group_ends(program.pid)


def test_what_is_no_cluster_is_said(errands, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("station.batch.dask_pool.PATIENCE_S", 1)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"

        def greet():
            line, _ = server.accept()
            line.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n" * 100)
            line.close()

        threading.Thread(target=greet, daemon=True).start()
        for wrong in (address, "nonsense://x", ""):
            with pytest.raises(BadParameter, match="no cluster answers at"):
                list(run_on_cluster(errands.square, errands.Errand(tmp_path), range(2), Stop(), wrong))


def test_cluster_that_does_not_answer_is_said(errands, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("station.batch.dask_pool.PATIENCE_S", 0.2)
    with pytest.raises(BadParameter, match=r"no cluster answers at tcp://127\.0\.0\.1:9"):
        list(run_on_cluster(errands.square, errands.Errand(tmp_path), range(2), Stop(), "tcp://127.0.0.1:9"))
