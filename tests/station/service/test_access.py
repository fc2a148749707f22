"""Who may ask what."""

from __future__ import annotations

import base64

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


def test_what_is_required_came_and_is_to_do_is_said(client):
    client.token = ""
    assert client.get("/status")[1]["reason"] == "the token is required, and none came"
    client.token = "another"
    assert client.get("/status")[1]["reason"] == "the token is required, and another one came"


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
        status, told = client.post("/run", **{"Content-Type": "text/plain"})
        assert status == 400
        assert "JSON is required" in told["reason"]


@pytest.mark.parametrize("token", ["short", "", "with a space in it", "not-ascii-ä-ö-ü-ß"])
def test_a_token_that_is_soon_guessed_or_sent_wrong_is_refused(token):
    with pytest.raises(BadParameter, match=r"12 ASCII characters or more is needed"):
        check_token(token)


def test_a_port_that_is_taken_is_named():
    with listen("127.0.0.1", 0) as one:
        port = one.getsockname()[1]
        with pytest.raises(PortTaken, match=rf"port {port} of 127.0.0.1 is needed, and another program has it"):
            listen("127.0.0.1", port)


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(BadParameter, match=r"cannot listen at 192\.0\.2\.1"):
        listen("192.0.2.1", 0)
