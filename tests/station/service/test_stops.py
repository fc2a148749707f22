"""A stop gets through, whatever hangs: over HTTP, from the phone page, and over Alpaca."""

import json
import time

import pytest

from .alpaca_clients import once
from .hung_bench import HungLab, pending
from .serving import TOKEN, Client, serving

pytestmark = pytest.mark.slow

BOUND_MS = 50.0
POLLS = 200
TRIES = 5
"""The best of some tries: where a stop waits for polls or controllers every one takes seconds, and a machine that has
much else to do delays a few of them."""
POLLED = [f"/api/v1/focuser/{number}/ismoving?ClientID=1" for number in range(3)]


def page_stop(client):
    """What the page sends."""
    headers = {"Cookie": f"station_token={TOKEN}", "Origin": f"http://127.0.0.1:{client.port}"}
    return Client(client.port, "").request("POST", "/station/v1/stop", {}, **headers)


WAYS = {  # the halt is first: after an emergency stop there is no position to keep, and a halt is a reset
    "Halt": lambda client: client.request("PUT", "/api/v1/focuser/0/halt", b"ClientID=1"),
    "HTTP": lambda client: client.request("POST", "/station/v1/stop", {}),
    "page": page_stop,
    "EmergencyStop": lambda client: client.request(
        "PUT", "/api/v1/switch/0/action", b"Action=EmergencyStop&Parameters="
    ),
}
HALTS = (b"\x85", b"\x18")
"""The end of a jog, which keeps the position, or a reset."""
MARKS = {"stage": (b"\x18",), "head": (b"estop\n",), "shutter": (b"ABORT\n",)}


@pytest.fixture(scope="module")
def hung(tmp_path_factory):
    """A client of a bench in real time whose stage was homed; its lab."""
    pytest.importorskip("tty", reason="no pseudo-terminals here")
    folder = tmp_path_factory.mktemp("hung")
    lab = HungLab(sessions=folder / "sessions", config=None)
    with serving(folder, lab=lab) as (client, served):
        served.bench.stage.home()
        for number in range(3):
            path = f"/api/v1/focuser/{number}"
            client.request("PUT", f"{path}/connected", b"Connected=true&ClientID=1")
            client.request("PUT", f"{path}/halt", b"ClientID=1")  # from now on it is asked whether it moves
        yield client, served, lab


def stop_ms(client, served, way, how):
    """Milliseconds until the answer, and until the last wire had taken its stop."""
    marks = MARKS if way != "Halt" else {"stage": HALTS}
    taken = "!" if how == "clogged" else "!>"  # what is sent in turn is noted before a clogged port refuses it
    begin_s = time.monotonic()
    status, _, body = WAYS[way](client)
    answered_s = time.monotonic()
    assert status == 200
    reply = json.loads(body)
    assert reply.get("stopped") or reply["ErrorNumber"] == 0

    def sent_s(name):
        passed = served.bench.transcripts[name].last()
        times = (one.time_s for one in passed if one.way in taken and one.data.endswith(marks[name]))
        return next((time_s for time_s in times if time_s >= begin_s), None)

    wires = [once(lambda name=name: sent_s(name)) for name in marks]
    return 1000 * (answered_s - begin_s), 1000 * (max(wires) - begin_s)


def in_time(found):
    """Whether an answer, and a stop on all wires, came within the bound."""
    return bool(found) and all(min(times) < BOUND_MS for times in zip(*found, strict=True))


@pytest.mark.parametrize("how", ["silent", "clogged"])
@pytest.mark.parametrize("way", [*WAYS])
def test_a_stop_waits_for_no_poll_and_no_controller(hung, way, how):
    client, served, lab = hung
    lab.hang(how)
    found = []
    with pending(client) as polls:
        while len(found) < TRIES and not in_time(found):
            polls.fill(POLLS, POLLED)
            client.request("GET", "/")  # the server has read them when it answers this
            found.append(stop_ms(client, served, way, how))
        assert polls.count() > POLLS // 2  # every stop answers those that the controllers were being asked
    assert in_time(found), found


def test_polls_whose_clients_have_left_are_forgotten(hung):
    client, _, lab = hung
    lab.hang("silent")
    with pending(client) as polls:
        polls.fill(POLLS, POLLED)
        client.request("GET", "/")
    begin_s = time.monotonic()
    form = b"ClientID=1&Connected=true"
    assert client.request("PUT", "/api/v1/focuser/0/connected", form)[0] == 200
    # it waits for the two polls that are being answered, not for all: each takes the controller's three half seconds
    assert time.monotonic() - begin_s < POLLS / 3 / 2 * 1.5 / 2
