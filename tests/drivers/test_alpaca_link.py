"""Requests to an Alpaca server whose replies are wrong."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from drivers.alpaca.link import AlpacaAddress, AlpacaLink
from drivers.errors import Rejected

DONE = (200, b'{"ErrorNumber": 0, "Value": 3}')


@pytest.fixture
def server():
    """A server that gives its `replies` in turn, the last one again, and notes the members called."""

    class Handler(BaseHTTPRequestHandler):
        def do_PUT(self):
            self.rfile.read(int(self.headers["Content-Length"]))
            self.do_GET()

        def do_GET(self):
            self.server.called.append(self.path.partition("?")[0].rpartition("/")[2])
            status, data = self.server.replies.pop(0) if len(self.server.replies) > 1 else self.server.replies[0]
            self.send_response(status)
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *_):
            pass

    made = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    made.replies, made.called = [DONE], []
    thread = threading.Thread(target=made.serve_forever, args=(0.01,))
    thread.start()
    yield made
    made.shutdown()
    made.server_close()
    thread.join()


@pytest.fixture
def link(server):
    made = AlpacaLink(AlpacaAddress(f"127.0.0.1:{server.server_address[1]}"), "focuser", 0)
    made.is_open = True
    return made


@pytest.mark.parametrize(
    "refusal",
    [
        (503, b"busy"), (200, b"<html>"), (200, b"[" * 10_000), (200, b"[]"), (200, b'{"ErrorNumber": 1e999}'),
        (200, b'{"ErrorNumber": 1280, "ErrorMessage": "no"}'),
    ],
)  # fmt: skip
def test_a_stop_is_repeated_until_the_server_acknowledges_it(server, link, refusal):
    server.replies = [refusal, DONE]
    link.preempt("halt")
    assert server.called == ["halt", "halt"]


def test_a_server_that_lists_no_actions_connects(server, link):
    server.replies = [(200, b'{"ErrorNumber": 0, "Value": null}')]
    link.open()
    assert not link.can_resume


def test_a_stop_that_is_never_acknowledged_ends_without_an_error(server, link):
    server.replies = [(500, b"")]
    link.preempt("halt")
    assert server.called == ["halt"] * 3


@pytest.mark.parametrize("value", [b"NaN", b"Infinity", b'"far"', b"null"])
def test_a_number_that_is_none_is_refused(server, link, value):
    server.replies = [(200, b'{"ErrorNumber": 0, "Value": ' + value + b"}")]
    with pytest.raises(Rejected, match="does not answer as an Alpaca server does"):
        link.number_of("position")
