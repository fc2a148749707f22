"""Processes that die: the item is named, the rest is finished."""

from __future__ import annotations

import pytest

from procedures.outcome import BadParameter, Refused
from station.batch.dask_pool import run_on_cluster
from station.batch.process_pool import DEATHS_IN_A_ROW, TRIES, Lost, Stop, run_in_processes


def run(errands, tmp_path, count=8, jobs=2, stop=None, **trouble):
    errand = errands.Errand(tmp_path, **trouble)
    return dict(run_in_processes(errands.square, errand, range(count), jobs, stop or Stop()))


def test_every_item_is_worked_on_once(errands, tmp_path):
    assert run(errands, tmp_path) == {n: n * n for n in range(8)}


def test_item_that_always_ends_its_process_is_named_and_the_rest_is_finished(errands, tmp_path):
    found = run(errands, tmp_path, deadly=(3,))
    assert found.pop(3) == Lost(f"the process that worked on it was ended by the system (SIGKILL), {TRIES} times")
    assert found == {n: n * n for n in range(8) if n != 3}


def test_item_whose_process_was_killed_once_is_done_again(errands, tmp_path):
    assert run(errands, tmp_path, deadly_once=(2, 5)) == {n: n * n for n in range(8)}


def test_process_that_ends_by_itself_tells_its_exit_code(errands, tmp_path):
    assert "exit code 7" in run(errands, tmp_path, count=1, quits=(0,))[0].reason


def test_processes_that_die_without_end_are_not_blamed_on_the_items(errands, tmp_path):
    with pytest.raises(Refused, match=f"{DEATHS_IN_A_ROW} died one after the other"):
        run(errands, tmp_path, count=20, jobs=1, quits=tuple(range(20)))


def test_what_runs_is_finished_when_asked_to_stop_and_nothing_else_is_begun(errands, tmp_path):
    stop, found = Stop(), {}
    for number, answer in run_in_processes(errands.square, errands.Errand(tmp_path), range(50), 2, stop):
        found[number] = answer
        stop.ask()
    assert 1 <= len(found) <= 3  # the two that ran, and one more if it had been given out by then
    assert found == {n: n * n for n in found}


def test_cluster_gives_the_same_and_survives_a_killed_worker(errands, tmp_path):
    pytest.importorskip("distributed")
    errand = errands.Errand(tmp_path, deadly_once=(4,))
    found = dict(run_on_cluster(errands.square, errand, range(8), 2, Stop(), "local"))
    assert (tmp_path / "4").exists()
    assert found == {n: n * n for n in range(8)}


def test_cluster_that_does_not_answer_is_said(errands, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("station.batch.dask_pool.PATIENCE_S", 0.2)
    with pytest.raises(BadParameter, match=r"no cluster answers at tcp://127\.0\.0\.1:9"):
        list(run_on_cluster(errands.square, errands.Errand(tmp_path), range(2), 2, Stop(), "tcp://127.0.0.1:9"))
