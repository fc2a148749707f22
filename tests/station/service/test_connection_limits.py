"""Clients that connect and do not ask leave room for those that do, and files for the run."""

import os
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager

import pytest

from station.service import hosting
from station.service.hosting import FOR_STOPS, most_connections

from ..guide import benches
from .alpaca_clients import once
from .serving import ENDS_S, serving

resource = pytest.importorskip("resource", reason="no limit of files here")
FILES = 600
"""Files that the server's process may have open beside those that it has: less than the clients of the flood."""
FLOOD = """
import resource, socket, sys
hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
count, half = int(sys.argv[2]), sys.argv[3].encode()
held = []
for _ in range(count):
    one = socket.create_connection(("127.0.0.1", int(sys.argv[1])), 30)
    held.append(one)
    try:
        one.sendall(half)
    except OSError:
        pass
print("there", flush=True)
sys.stdin.read()
"""
HEAD = "POST /station/v1/stop HTTP/1.1\r\nHost: "
BODY = "POST /station/v1/run HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n\r\n{"


@pytest.fixture
def few_files():
    """This process may have few files open."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(map(int, os.listdir("/dev/fd"))) + FILES, hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@contextmanager
def flood(client, count, half):
    """So many connections from another process on which half a request was sent."""
    words = [sys.executable, "-c", FLOOD, str(client.port), str(count), half]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "there\n"
        yield
        process.stdin.close()


def half_sent(client, half=HEAD):
    opened = socket.create_connection(("127.0.0.1", client.port), ENDS_S)
    opened.sendall(half.encode())
    return opened


def ends(opened, within_s):
    """Whether the other end closes it within that time."""
    opened.settimeout(within_s)
    try:
        return opened.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionError:
        return True


@pytest.mark.slow
@pytest.mark.parametrize("half", [HEAD, BODY])
def test_a_thousand_half_sent_requests_keep_nobody_from_stopping_or_writing(few_files, tmp_path, half):
    with serving(tmp_path, token=None) as (client, _), flood(client, 1000, half):
        took = []
        for _ in range(5):
            begin_s = time.monotonic()
            assert client.post("/stop")[0] == 200
            took.append(time.monotonic() - begin_s)
        assert min(took) < 0.05
        assert client.get("/status")[0] == 200
        with ExitStack() as opened:  # what a run needs for its photographs, its journal and its lines
            for number in range(FILES // 3):
                opened.enter_context((tmp_path / f"{number}").open("w"))


def test_a_request_must_come_whole_within_its_time(tmp_path, monkeypatch):
    monkeypatch.setattr(hosting, "REQUEST_S", 0.05)
    with serving(tmp_path, token=None) as (client, _):
        for half in ("", HEAD, BODY, "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nGET"):
            opened = half_sent(client, half)
            whole = b""
            while data := opened.recv(65536):  # until it is closed
                whole += data
            assert whole.count(b"HTTP/1.1 200") == half.count("\r\n\r\nGET")
            opened.close()


def test_an_answer_may_take_longer_than_a_request(tmp_path, monkeypatch):
    with serving(tmp_path, token=None) as (client, served):
        monkeypatch.setattr(hosting, "REQUEST_S", 0.02)
        look = served._watch.look
        monkeypatch.setattr(served._watch, "look", lambda: time.sleep(0.1) or look())
        assert client.get("/status")[0] == 200


def test_who_owes_a_request_longest_gives_way(tmp_path, monkeypatch):
    monkeypatch.setattr(hosting, "most_connections", lambda: 8)  # six of one address
    with serving(tmp_path, token=None) as (client, _):
        first = [half_sent(client) for _ in range(6)]
        client.request("GET", "/")
        assert ends(first[0], ENDS_S)
        assert not any(ends(one, 0.01) for one in first[2:])
        for one in first:
            one.close()


def test_beyond_the_limit_only_stops_are_answered(tmp_path, monkeypatch):
    monkeypatch.setattr(hosting, "most_connections", lambda: 8)
    with serving(tmp_path, token=None) as (client, served):
        name = benches.new_session(tmp_path, served.bench).folder.name
        streams = [iter(client.lines(f"/sessions/{name}/journal")) for _ in range(6)]
        for one in streams:
            next(one)  # each is being answered
        status, reply = client.get("/status")
        assert status == 503
        assert "at most 8 connections are answered at a time" in reply["reason"]
        assert client.post("/stop")[0] == 200
        assert client.request("GET", "/")[0] == 200
        assert client.request("PUT", "/api/v1/focuser/0/halt", b"")[0] == 200
        beyond = [half_sent(client) for _ in range(FOR_STOPS + 8)]
        assert client.post("/stop")[0] == 200
        for one in (*beyond, *streams):
            one.close()
        once(lambda: client.get("/status")[0] == 200)


def test_few_files_are_few_connections(few_files):
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    assert most_connections() + FOR_STOPS < soft / 2  # the greater part is left to everything else
