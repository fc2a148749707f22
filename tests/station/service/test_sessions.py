"""Sessions, results and journals are read by other programs."""

import json
import shutil
import sys
from urllib.parse import quote

import pytest

from drivers.errors import SystemClock
from station.sessions.journal import SUM
from station.sessions.session import Session

from ..guide import benches
from .serving import serving
from .test_control import UNATTENDED

SESSION_TELLS = "its session lists the files"


@pytest.fixture(scope="module")
def kept(shared_server):
    """A client, the folder of a session whose plan was carried out, and that of its result."""
    client, served = shared_server
    client.post("/run", UNATTENDED)
    served.runs.wait(30)
    served.lab._leave_session()
    folder = served.lab.sessions / served.runs.status.session
    return client, folder, result_of(folder)


def result_of(session):
    """A result that stands for one of the estimators, kept in the session."""
    with Session.open(session, SystemClock()) as opened:
        folder = opened.result_folder()
        folder.mkdir(parents=True)
        (folder / "result.json").write_text('{"schema": "station/psf/1",  "planes": {}}')
        (folder / "psf_G1.npy").write_bytes(b"numbers")
        opened.keep_result(step="shots", shots=[1], verdict="pass")
    return folder


@pytest.fixture
def client(kept):
    return kept[0]


@pytest.fixture
def session(kept):
    return kept[1].name


@pytest.fixture
def derived(kept):
    return kept[2]


@pytest.fixture
def copied(kept):
    """The folder of a copy that may be changed."""
    folder = kept[1].with_name("copied")
    shutil.copytree(kept[1], folder)
    yield folder
    shutil.rmtree(folder)


@pytest.mark.slow
def test_the_journal_is_streamed_as_it_was_written(client, kept, session):
    written = (kept[1] / "journal.jsonl").read_bytes().splitlines()
    streamed = []
    for line in client.lines(f"/sessions/{session}/journal?follow=false"):
        if line.startswith(b"data: "):
            streamed.append(line[6:].rstrip())
    assert streamed == written


@pytest.mark.slow
def test_a_stream_goes_on_where_it_was_broken_off(client, session):
    path = f"/station/v1/sessions/{session}/journal?follow=false"
    _, _, body = client.request("GET", path, **{"Last-Event-ID": "3"})
    assert body.startswith(b"id: 4\ndata: ")


def test_lines_come_as_they_are_written(tmp_path):
    with serving(tmp_path) as (client, served):
        opened = benches.new_session(tmp_path, served.bench)
        lines = client.journal(opened.folder.name)
        assert next(lines)["event"] == "created"
        opened.note("first", number=float("nan"))
        while (entry := next(lines))["event"] != "first":
            pass
        assert entry["number"] == {"not_finite": "nan"}
        opened.note("second")
        assert next(lines)["event"] == "second"
        opened.close()


def test_an_altered_journal_is_not_streamed(client, copied):
    path = copied / "journal.jsonl"
    path.write_bytes(path.read_bytes().replace(b'"camera":"C"', b'"camera":"D"'))
    status, reply = client.get("/sessions/copied/journal")
    assert status == 422
    assert "line 1 is not what was written" in reply["reason"]


def test_a_result_is_given_byte_for_byte(client, session, derived):
    status, headers, body = client.request("GET", f"/station/v1/sessions/{session}/result")
    assert (status, headers["content-type"]) == (200, "application/json")
    assert body == (derived / "result.json").read_bytes()
    assert json.loads(body)["schema"] == "station/psf/1"
    assert client.request("GET", f"/station/v1/sessions/{session}/results/1/psf_G1.npy")[2] == b"numbers"


def test_a_result_that_was_changed_is_not_given(client, copied):
    (copied / "derived" / "1" / "result.json").write_text("{}")
    status, reply = client.get("/sessions/copied/result")
    assert status == 422
    assert "has been changed" in reply["reason"]


@pytest.mark.parametrize("file", ["nosuch", "../../session.toml", "..%2f..%2fsession.toml", "/etc/passwd"])
def test_only_files_of_results_are_given(client, session, derived, file):
    assert client.request("GET", f"/station/v1/sessions/{session}/results/1/{file}")[0] == 404


@pytest.mark.parametrize("name", ["nosuch", "..", "%2e%2e", "."])
def test_what_is_no_session_is_not_there(client, name):
    for what in ("", "/result", "/journal", "/report"):
        assert client.request("GET", f"/station/v1/sessions/{name}{what}")[0] == 404


def test_what_a_session_has_not_is_reported(client, session):
    missing = client.get(f"/sessions/{session}/results/2/result.json")
    assert missing == (404, {"reason": f"{session} has no file 'result.json' in a result 2", "remedy": SESSION_TELLS})
    assert "station session report" in client.get(f"/sessions/{session}/report")[1]["remedy"]


HOSTILE = "\"'><script>alert(1)</script><img src=x onerror=alert(1)>"
SCRIPT = b"<!doctype html><title>R</title><script>fetch('/station/v1/run', {method: 'POST'})</script>"


@pytest.fixture
def hostile(kept):
    """The folder of a session whose name, report and result would be scripts in a page."""
    if sys.platform == "win32":
        pytest.skip("no such file names here")
    folder = kept[1].with_name(HOSTILE.replace("/", "\u2215"))  # a folder's name has no slash
    shutil.copytree(kept[1], folder)
    (folder / "report.html").write_bytes(SCRIPT)
    with Session.open(folder, SystemClock()) as opened:
        derived = opened.result_folder()
        derived.mkdir(parents=True)
        for name in ("report.html", "drawing.svg", f"{HOSTILE.replace('/', '-')}.html"):
            (derived / name).write_bytes(SCRIPT)
        opened.keep_result(step="shots", shots=[1], verdict="pass")
    yield folder
    shutil.rmtree(folder)


def test_reports_and_results_run_no_script_and_are_no_page_of_the_station(client, hostile):
    there = f"/station/v1/sessions/{quote(hostile.name)}"
    names = [one.name for one in (hostile / "derived" / "2").iterdir()]
    assert len(names) == 3
    for path in (f"{there}/report", *(f"{there}/results/2/{quote(name)}" for name in names)):
        status, headers, body = client.request("GET", path)
        assert (status, body) == (200, SCRIPT)
        policy = [one.strip() for one in headers["content-security-policy"].split(";")]
        assert "sandbox" in policy  # with nothing allowed: no script, and an origin of its own
        assert "default-src 'none'" in policy
        assert headers["x-content-type-options"] == "nosniff"


def test_hostile_names_are_data_and_never_markup(client, hostile):
    listed = client.request("GET", "/station/v1/sessions")
    found = client.request("GET", f"/station/v1/sessions/{quote(hostile.name)}")
    missing = client.request("GET", f"/station/v1/sessions/{quote(HOSTILE, safe='')}/report")
    assert (listed[0], found[0], missing[0]) == (200, 200, 404)
    assert str(hostile) in [one["folder"] for one in json.loads(listed[2])["sessions"]]
    for _, headers, _ in (listed, found, missing):
        assert headers["content-type"] == "application/json"
        assert headers["x-content-type-options"] == "nosniff"


def test_the_page_shows_names_as_text(client):
    _, headers, body = client.request("GET", "/")
    assert "default-src 'self'" in headers["content-security-policy"]
    for way in (b"innerHTML", b"outerHTML", b"insertAdjacentHTML", b"document.write", b"eval("):
        assert way not in body


def test_sums_are_reported_so_that_a_client_can_check_the_chain(client, session):
    line = next(line for line in client.lines(f"/sessions/{session}/journal?follow=false") if b"data" in line)
    assert SUM in line
