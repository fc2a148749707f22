"""A server on a loopback port, over a simulated bench whose frames cost nothing, and a client to it."""

import json
import threading
from contextlib import contextmanager
from http.client import HTTPConnection

from station.guide.workspace import StationLab
from station.service.bench_state import ServedBench
from station.service.hosting import Hosting, listen
from station.service.site import site

from ..guide import benches

TOKEN = "a token of tests".replace(" ", "-")
ENDS_S = 30.0
"""Longer than anything here takes: a test that hangs ends."""


class QuickLab(StationLab):
    """The lab of a bench in virtual time."""

    def _make_bench(self):
        return self._scratch.enter_context(benches.quick_bench(self.sessions.parent))


class Client:
    """Asks the server."""

    def __init__(self, port, token=TOKEN):
        self.port, self.token = port, token
        self.address = f"any:{token}@127.0.0.1:{port}"

    def request(self, method, path, data=None, **headers):
        """Status, headers and body of an answer."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=ENDS_S)
        credentials = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        if data is not None and not isinstance(data, bytes):
            data, credentials["Content-Type"] = json.dumps(data), "application/json"
        elif path.startswith("/api/") and method == "PUT":
            credentials["Content-Type"] = "application/x-www-form-urlencoded"
        connection.request(method, path, data, {**credentials, **headers})
        reply = connection.getresponse()
        body = reply.read()
        connection.close()
        return reply.status, dict(reply.getheaders()), body

    def get(self, path, **headers):
        """Status and JSON."""
        status, _, body = self.request("GET", f"/station/v1{path}", **headers)
        return status, json.loads(body)

    def post(self, path, data=None, **headers):
        """Status and JSON."""
        status, _, body = self.request("POST", f"/station/v1{path}", data or {}, **headers)
        return status, json.loads(body)

    def lines(self, path):
        """The lines of a stream, as they come."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=ENDS_S)
        connection.request("GET", f"/station/v1{path}", headers={"Authorization": f"Bearer {self.token}"})
        reply = connection.getresponse()
        assert reply.getheader("content-type").startswith("text/event-stream")
        try:
            yield from iter(reply.readline, b"")
        finally:
            connection.close()

    def journal(self, session):
        """The entries of a session's journal, as they come."""
        for line in self.lines(f"/sessions/{session}/journal"):
            if line.startswith(b"data: "):
                yield json.loads(line[6:])


@contextmanager
def serving(folder, *, token=TOKEN, host="127.0.0.1", lab=None):
    """A client to a server, and what is served."""
    lab = lab or QuickLab(sessions=folder / "sessions", config=None, simulate=True)
    closing = threading.Event()
    served = ServedBench(lab)
    hosting = Hosting(site(served, host=host, token=token, closing=closing), listen("127.0.0.1", 0), closing)
    hosting.begin()
    try:
        yield Client(hosting.port, token), served
    finally:
        hosting.end()
        served.close(ENDS_S)
        lab.close()
