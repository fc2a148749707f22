"""`station --plain` as a program: pipes, the end of input, Ctrl-C, exit codes."""

import os
import signal
import subprocess
import sys

import pytest
from click.testing import CliRunner

from procedures.outcome import Verdict
from station.__main__ import main
from station.cli.guide import exit_code
from station.guide.frontend import Result, RunEnded
from station.sessions.reader import read_session


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
    done = CliRunner().invoke(main, ["--plain", "--simulate"], input="D90\n50/1.8\n\n200\n", prog_name="station")
    assert done.exit_code == 130
    assert "Stopped. Nothing is lost" in done.stdout
    (folder,) = os.listdir("sessions")
    assert "d90-50-1-8" in folder


def test_a_session_in_which_nothing_was_answered_is_not_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, ["--plain", "--simulate"], input="D90\n50/1.8\n", prog_name="station")
    assert done.exit_code == 130
    assert "the session is not kept" in done.stdout
    assert os.listdir("sessions") == []


@pytest.mark.parametrize("words", [["--plain"], []], ids=["plain", "application"])
def test_an_unknown_plan_is_named(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    # before the application looks for a terminal, which there is none
    done = CliRunner().invoke(main, [*words, "--simulate", "--plan", "x"], prog_name="station")
    assert done.exit_code == 2
    assert "no plan 'x'" in done.stderr
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
    CliRunner().invoke(main, begin, input="D90\n50/1.8\nmotions\n\n\n\n\n", prog_name="station")
    (folder,) = (tmp_path / "sessions").iterdir()
    CliRunner().invoke(main, ["session", "resume", str(folder)], input="", prog_name="station")
    lines = read_session(folder).contents.lines
    assert ["shaker" in line.data["devices"] for line in lines if line.event == "devices"] == [True, True]
