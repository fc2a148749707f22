"""Who may ask what."""

import base64
import json
import socket

import pytest

from procedures.outcome import BadParameter
from station.service.access import check_token
from station.service.hosting import PortTaken, listen

from .serving import TOKEN, Client, serving


@pytest.fixture
def client(shared_server):
    return Client(shared_server[0].port)


def basic(password):
    return "Basic " + base64.b64encode(f"any:{password}".encode()).decode()


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 401),
        ({"Authorization": "Bearer another"}, 401),
        ({"Authorization": f"Bearer {TOKEN}"}, 200),
        ({"Authorization": basic(TOKEN)}, 200),
        ({"Authorization": basic("another")}, 401),
        ({"Authorization": "Basic ***"}, 401),
        ({"Cookie": f"station_token={TOKEN}"}, 200),
        ({"Cookie": "station_token=another"}, 401),
        ({"Cookie": "\"';="}, 401),
        ({"Authorization": f"Bearer {TOKEN}", "Origin": "http://elsewhere.example"}, 403),
        ({"Authorization": f"Bearer {TOKEN}", "Origin": "null"}, 403),
        ({"Authorization": f"Bearer {TOKEN}", "Host": "rebound.example"}, 403),
    ],
)
def test_the_token_opens_and_nothing_else_does(client, headers, status):
    client.token = ""
    answer = client.get("/status", **headers)
    assert answer[0] == status
    if status != 200:
        assert answer[1]["reason"]
        assert answer[1]["remedy"]


def test_what_is_required_came_and_is_to_do_is_reported(client):
    client.token = ""
    assert client.get("/status")[1]["reason"] == "the token is required; none was sent"
    client.token = "another"
    assert client.get("/status")[1]["reason"] == "the token is required; a wrong one was sent"


def test_the_page_takes_the_token_out_of_its_address(client):
    client.token = ""
    status, headers, _ = client.request("GET", f"/?token={TOKEN}")
    assert (status, headers["location"]) == (303, "/")
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert client.get("/status", Cookie=cookie.partition(";")[0])[0] == 200
    status, headers, body = client.request("GET", "/")
    assert (status, headers["content-type"].partition(";")[0]) == (200, "text/html")
    assert b"STOP" in body


def test_without_a_token_everybody_is_let_in_but_pages_of_others(tmp_path):
    with serving(tmp_path, token=None) as (client, _):
        assert client.get("/status")[0] == 200
        assert client.get("/status", Origin="http://elsewhere.example")[0] == 403
        status, reply = client.post("/run", **{"Content-Type": "text/plain"})
        assert status == 400
        assert "JSON is required" in reply["reason"]


def own_page(client, name="127.0.0.1"):
    return {"Origin": f"http://{name}:{client.port}", "Host": f"{name}:{client.port}"}


STATE_CHANGES = [
    ("POST", "/station/v1/stop", b""),
    ("PUT", "/station/v1/stop", b""),
    ("POST", "/station/v1/run/end", b""),
    ("PUT", "/api/v1/switch/0/action", b"Action=EmergencyStop&Parameters="),
]


@pytest.mark.parametrize(("method", "path", "data"), STATE_CHANGES)
@pytest.mark.parametrize("origin", ["http://elsewhere.example", "null", "file://", "http://127.0.0.1:1", ""])
def test_a_page_of_another_site_changes_nothing(client, shared_server, origin, method, path, data):
    stops = shared_server[1].bench.stops
    status, _, body = client.request(method, path, data, Origin=origin)
    assert status == 403
    assert f"it came from a page of {origin}" in json.loads(body)["reason"]
    assert shared_server[1].bench.stops == stops


@pytest.mark.parametrize(("method", "path", "data"), STATE_CHANGES)
def test_its_own_page_and_programs_are_let_in(client, method, path, data):
    for named in (own_page(client), own_page(client, "localhost"), {}):
        assert client.request(method, path, data, **named)[0] == 200


def test_the_stop_of_a_program_needs_no_token_and_no_name(client):
    client.token = ""
    assert client.request("POST", "/station/v1/stop", b"", Host="tunnel.example")[0] == 200


def test_a_site_whose_name_leads_here_is_refused(tmp_path):
    # a name of the attacker's that his name server has lead to this machine (DNS rebinding): to the browser his page
    # and this server are of one origin
    with serving(tmp_path, host="0.0.0.0") as (client, served):
        for own in ("192.168.1.20", "localhost", socket.gethostname().lower()):
            assert client.request("POST", "/station/v1/stop", b"", **own_page(client, own))[0] == 200
        stops = served.bench.stops
        status, _, body = client.request("POST", "/station/v1/stop", b"", **own_page(client, "evil.example"))
        assert status == 403
        assert "the request was to 'evil.example" in json.loads(body)["reason"]
        assert served.bench.stops == stops


@pytest.mark.parametrize("token", ["short", "", "with a space in it", "not-ascii-ä-ö-ü-ß"])
def test_a_token_that_is_soon_guessed_or_sent_wrong_is_refused(token):
    with pytest.raises(BadParameter, match=r"12 ASCII characters or more"):
        check_token(token)


def test_ports_and_addresses_that_cannot_be_listened_on_are_named():
    with listen("127.0.0.1", 0) as one:
        port = one.getsockname()[1]
        with pytest.raises(PortTaken, match=rf"port {port} of 127.0.0.1 is required, but another program uses it"):
            listen("127.0.0.1", port)
    with pytest.raises(BadParameter, match=r"cannot listen on 192\.0\.2\.1"):
        listen("192.0.2.1", 0)
