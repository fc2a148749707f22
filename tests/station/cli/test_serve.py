"""`station serve` in the terminal: what it says, what it refuses, how it ends."""

import json
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

from procedures.outcome import BadParameter
from station.guide import workspace
from station.service.hosting import listen
from tests.program import run


def test_a_port_that_is_taken_is_refused():
    with listen("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        done = run("serve", "--simulate", "--port", port, code=2)
    assert f"port {port} of 127.0.0.1 is required, but another program uses it" in done.stderr
    assert "--port 0 takes a free one" in done.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--token", "short"), "a token must have 12 ASCII characters or more, without spaces; got 5"),
        (("--token", "long-enough-to-be-one", "--no-token"), "contradict each other"),
        (("--host", "no such host"), "is not an address of this machine"),
    ],
)
def test_options_that_cannot_be_meant_are_refused(options, words):
    done = run("serve", "--simulate", "--port", 0, *options, code=2, says=words)
    assert "what to do" in done.stderr


def test_new_sessions_have_the_unit_the_specification_and_the_shaker(monkeypatch, tmp_path):
    limits = tmp_path / "lens.toml"
    limits.write_text("[limits]\nmtf50_horizontal = { min = 0.25 }\n")
    asked = []

    def lab(**settings):
        asked.append(settings)
        raise BadParameter("this is enough", "end")

    monkeypatch.setattr(workspace, "StationLab", lab)
    given = ("--unit", "lp/mm", "--specification", limits, "--simulate", "--shaker")
    run(*given, "serve", code=2)
    assert asked[0] | {"unit": "lp/mm", "specification": limits, "shaker": True, "simulate": True} == asked[0]


def test_without_the_extra_the_remedy_is_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    monkeypatch.delitem(sys.modules, "station.service.hosting")
    done = run("serve", "--simulate", "--port", 0, code=2)
    assert "the extra `serve` is needed, and uvicorn is not installed" in done.stderr
    assert "pip install 'calibration-station[serve]'" in done.stderr


def post(address, path, data):
    request = urllib.request.Request(address + path, json.dumps(data).encode(), {"Content-Type": "application/json"})
    with urllib.request.urlopen(request, timeout=60) as reply:
        return json.load(reply)


def get(address, path):
    with urllib.request.urlopen(address + path, timeout=60) as reply:
        return json.load(reply)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no such signals here")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_server_its_run_and_its_session(tmp_path, number, start_program):
    words = [sys.executable, "-m", "station", "serve", "--simulate", "--port", "0", "--json", "--no-token"]
    program = start_program([*words, "--sessions", tmp_path], stdout=subprocess.PIPE, text=True)
    address = json.loads(program.stdout.readline())["address"]
    post(address, "/station/v1/run", {"by_default": True})
    while (question := get(address, "/station/v1/run")["question"]) is None:
        assert program.poll() is None
    assert question["key"] == "move"
    program.send_signal(number)
    assert program.wait(180) == 0
    with pytest.raises(urllib.error.URLError):
        post(address, "/station/v1/stop", {})
    (session,) = tmp_path.glob("*/")
    journal = map(json.loads, (session / "journal.jsonl").read_text().splitlines())
    assert [one["how"] for one in journal if one["event"] == "ended"] == ["emergency"]
