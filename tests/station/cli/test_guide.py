"""`station --plain` as a program: pipes, the end of input, Ctrl-C, exit codes."""

import io
import os
import signal
import subprocess
import sys
import threading

import pytest

from procedures.outcome import Verdict
from station.cli.guide import PlainStop, exit_code
from station.guide.frontend import Result, RunEnded
from station.guide.line_frontend import STOPPING, LineOperator
from station.sessions.reader import read_session
from tests.program import run


def result(verdict):
    return Result("out", {}, verdict, "", "")


@pytest.mark.parametrize(
    ("how", "findings", "code"),
    [
        ("finished", result(Verdict.PASS), 0),
        ("finished", result(Verdict.DOUBTFUL), 0),
        ("finished", result(Verdict.REFUSED), 5),
        ("stopped", None, 130),
        ("emergency", None, 3),
    ],
)
def test_exit_codes_are_the_contract_s(how, findings, code):
    assert exit_code(RunEnded(how), findings) == code


@pytest.mark.slow
def test_the_end_of_input_stops_politely_and_keeps_the_session(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run("--plain", "--simulate", typed="D90\n50/1.8\n\n200\n", code=130, says="Stopped. Nothing is lost")
    (folder,) = os.listdir("sessions")
    assert "d90-50-1-8" in folder


def test_a_session_in_which_nothing_was_answered_is_not_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run("--plain", "--simulate", typed="D90\n50/1.8\n", code=130, says="the session is not kept")
    assert os.listdir("sessions") == []


@pytest.mark.parametrize("words", [["--plain"], []], ids=["plain", "application"])
def test_an_unknown_plan_is_named(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    # before the application looks for a terminal, which there is none
    ended = run(*words, "--simulate", "--plan", "x", code=2, says="no plan 'x'")
    assert STOPPING not in ended.stdout  # nothing was opened
    assert not os.path.exists("sessions")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_ctrl_c_at_a_question_stops_at_once(tmp_path, start_program, read_until):
    program = start_program(
        [sys.executable, "-m", "station", "--plain", "--simulate", "--sessions", tmp_path / "kept"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    program.stdin.write("D90\n50\n")
    program.stdin.flush()
    read_until(program.stdout, ">> Which paper")
    program.send_signal(signal.SIGINT)
    rest, _ = program.communicate(timeout=180)
    assert program.returncode == 130
    assert "Stopped. Nothing was answered" in rest


@pytest.mark.slow
def test_a_session_that_began_with_a_shaker_goes_on_with_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    begin = ["--plain", "--simulate", "--shaker", "--plan", "restoration"]
    run(*begin, typed="D90\n50/1.8\nmotions\n\n\n\n\n", code=None)
    (folder,) = (tmp_path / "sessions").iterdir()
    run("session", "resume", folder, typed="", code=None)
    lines = read_session(folder).contents.lines
    assert ["shaker" in line.data["devices"] for line in lines if line.event == "devices"] == [True, True]


def test_a_folder_of_sessions_that_cannot_be_written_is_named_before_the_first_question(tmp_path):
    (tmp_path / "file").write_text("here first")
    done = run("--simulate", "--plain", "--sessions", tmp_path / "file" / "below", code=2, says="cannot be written")
    assert ">>" not in done.output


class StoppableLab:
    """The part of a lab by which a run is stopped."""

    has_run = True

    def stop_run(self):
        pass


def test_a_stop_from_two_threads_is_reported_once():
    # SIGTERM stops the bench in the thread of the signals, and again by the SystemExit that it raises
    output = io.StringIO()
    stop = PlainStop(StoppableLab(), LineOperator(io.StringIO(), output))
    stop.now()
    stop.now()
    for thread in threading.enumerate():
        if thread.name == "at once":
            thread.join()
    assert output.getvalue().count(STOPPING) == 1
