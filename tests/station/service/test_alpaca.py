"""The ASCOM Initiative's own client drives every member of the bench's Alpaca devices."""

import json
import socket
import threading
from contextlib import closing

import pytest
import requests
from alpaca import camera as alpaca_camera
from alpaca import exceptions, focuser, management, observingconditions, switch

from drivers.errors import NoAnswer
from drivers.interfaces import Condition
from station.service.alpaca.clients import MOST_LISTED
from station.service.alpaca.discovery import Discovery

from .alpaca_clients import homed, members, once
from .serving import ENDS_S, TOKEN, Client

NOT_IMPLEMENTED = exceptions.NotImplementedException


@pytest.fixture
def rail(client):
    """The focuser that is the rail's axis."""
    device = focuser.Focuser(client.address, 0)
    device.Connected = True
    return device


@pytest.fixture
def box(client):
    device = switch.Switch(client.address, 0)
    device.Connected = True
    return device


def test_the_server_reports_its_devices(client):
    assert management.apiversions(client.address) == [1]
    assert management.description(client.address)["ServerName"] == "Calibration station"
    devices = management.configureddevices(client.address)
    reply = [(one["DeviceType"], one["DeviceNumber"], one["DeviceName"]) for one in devices]
    assert reply == [
        ("Camera", 0, "camera"), ("Focuser", 0, "stage z_mm"), ("Focuser", 1, "stage x_mm"),
        ("Focuser", 2, "stage y_mm"), ("Switch", 0, "lamp, shutter and laser"), ("ObservingConditions", 0, "room"),
    ]  # fmt: skip
    assert len({one["UniqueID"] for one in devices}) == 6


@pytest.mark.parametrize(
    ("kind", "device_class", "besides"),
    [
        ("camera", alpaca_camera.Camera, {"ImageArrayRaw", "ImageArrayInfo"}),  # the client's own views of ImageArray
        ("focuser", focuser.Focuser, set()),
        ("switch", switch.Switch, set()),
        ("observingconditions", observingconditions.ObservingConditions, set()),
    ],
)
def test_no_member_of_the_client_is_missing(server, kind, device_class, besides):
    from station.service.alpaca.server import devices_of

    device = next(one for one in devices_of(server[1]) if one.kind == kind)
    read, called = members(device_class)
    there = {*device.gets, *device.puts}
    assert {name for name in (read | called) - besides if name.lower() not in there} == set()


def test_every_common_member_answers(client):
    device = focuser.Focuser(client.address, 1)
    assert not device.Connected
    assert not device.Connecting
    assert device.Name == "stage x_mm"
    assert device.InterfaceVersion == 4
    assert device.SupportedActions == ["Home", "Resume", "EmergencyStop"]
    assert device.Description
    assert device.DriverInfo
    assert device.DriverVersion
    with pytest.raises(exceptions.NotConnectedException, match="put Connected = True first"):
        _ = device.Position
    device.Connect()
    once(lambda: not device.Connecting)
    assert device.Connected
    assert {one["Name"] for one in device.DeviceState} == {"IsMoving"}  # before it has homed no position is known
    for command in (device.CommandBlind, device.CommandBool, device.CommandString):
        with pytest.raises(NOT_IMPLEMENTED):
            command("x", False)
    with pytest.raises(exceptions.ActionNotImplementedException, match="there are Home, Resume, EmergencyStop"):
        device.Action("Fly", "")
    device.Disconnect()
    assert not device.Connected
    device.Connected = True
    device.Connected = False
    assert not device.Connected


def test_the_emergency_stop_is_an_action_of_every_device(camera, rail, box, served):
    for number, device in enumerate((camera, rail, box), 1):
        device.Action("EmergencyStop", "")
        assert served.bench.stops == number


def requested(client, method, member, number, form=""):
    """Error number and value of a member of focuser 0, asked as the client of that number."""
    path, form = f"/api/v1/focuser/0/{member}", f"ClientID={number}&{form}"
    if method == "GET":
        _, _, body = client.request("GET", f"{path}?{form}")
    else:
        _, _, body = client.request("PUT", path, form.encode())
    reply = json.loads(body)
    return reply["ErrorNumber"], reply.get("Value")


def test_a_client_that_disconnects_takes_the_device_from_nobody_else(client):
    for number in (1, 2):
        assert requested(client, "PUT", "connected", number, "Connected=True") == (0, None)
    requested(client, "PUT", "connected", 2, "Connected=False")
    assert requested(client, "GET", "connected", 2) == (0, False)
    assert requested(client, "GET", "connected", 1) == (0, True)
    assert requested(client, "GET", "ismoving", 1) == (0, False)
    requested(client, "PUT", "disconnect", 2)
    assert requested(client, "GET", "ismoving", 1) == (0, False)
    requested(client, "PUT", "disconnect", 1)
    assert requested(client, "GET", "ismoving", 1)[0] == 0x407


def test_each_client_that_connects_beside_hears_how_its_own_attempt_went(client, served, monkeypatch):
    begun, go_on = threading.Event(), threading.Event()

    def connect():
        begun.set()
        go_on.wait()
        raise NoAnswer("the controller is silent", "check its power")

    monkeypatch.setattr(served.bench.stage, "condition", lambda: Condition("not connected", False))
    monkeypatch.setattr(served.bench.stage, "connect", connect)
    assert requested(client, "PUT", "connect", 1) == (0, None)
    begun.wait()
    assert requested(client, "GET", "connecting", 1) == (0, True)
    assert requested(client, "GET", "connecting", 2) == (0, False)
    go_on.set()
    once(lambda: requested(client, "GET", "connecting", 1)[0])
    assert requested(client, "GET", "connecting", 1) == (0, False)
    assert requested(client, "GET", "connected", 1) == (0, False)


@pytest.mark.parametrize(
    ("path", "form"),
    [
        ("focuser/0/halt", b""),
        ("camera/0/abortexposure", b""),
        ("switch/0/action", b"Action=EmergencyStop&Parameters="),
        ("camera/0/action", b"Action=emergencystop"),
    ],
)
def test_a_stop_is_never_refused(client, served, path, form):
    # nobody has connected the device, and somebody else has the bench
    with served.tenancy.held("a run of the plan short"):
        status, _, body = client.request("PUT", f"/api/v1/{path}", form)
    assert (status, json.loads(body)["ErrorNumber"]) == (200, 0)
    assert served.bench.stops == ("action" in path)


def test_every_member_of_the_focuser(rail, served):
    travel = served.bench.stage.travel()["z_mm"]
    last = int(1000 * (travel.high - travel.low))
    assert rail.Absolute
    assert rail.StepSize == 1.0
    assert rail.MaxStep == rail.MaxIncrement == last
    assert not rail.TempCompAvailable
    assert not rail.TempComp
    with pytest.raises(NOT_IMPLEMENTED):
        rail.TempComp = True
    with pytest.raises(NOT_IMPLEMENTED):
        _ = rail.Temperature
    with pytest.raises(exceptions.InvalidOperationException, match="the action Home does that"):
        rail.Move(1000)
    with pytest.raises(exceptions.InvalidOperationException, match="not homed"):
        _ = rail.Position
    homed(rail)
    rail.Move(123456)
    once(lambda: not rail.IsMoving)
    assert rail.Position == 123456
    assert served.bench.stage.position()["z_mm"] == pytest.approx(travel.low + 123.456, abs=1e-3)  # a step is 1 um
    rail.Move(last)
    once(lambda: not rail.IsMoving)
    assert rail.Position == pytest.approx(last, abs=1)
    for beyond in (-1, last + 1):
        with pytest.raises(exceptions.InvalidValueException, match=f"between 0 and {last}; got {beyond}"):
            rail.Move(beyond)
    rail.Halt()
    assert {one["Name"]: one["Value"] for one in rail.DeviceState} == {"IsMoving": False, "Position": rail.Position}


def test_what_ended_a_move_is_reported(rail, served, monkeypatch):
    from drivers.errors import MoveFailed

    def stall(name, target):
        raise MoveFailed("z_mm stopped at 3", "move again")

    homed(rail)
    monkeypatch.setattr(served.bench.motions, "move", stall)
    rail.Move(10)
    with pytest.raises(exceptions.DriverException, match="stopped at 3; move again"):
        once(lambda: not rail.IsMoving)


def test_a_move_that_was_halted_has_not_failed(rail, served, monkeypatch):
    from drivers.errors import MoveFailed

    moving, halted = threading.Event(), threading.Event()

    def move(**target):
        moving.set()
        halted.wait()
        raise MoveFailed("z_mm was stopped at 3", "move again")

    homed(rail)
    monkeypatch.setattr(served.bench.stage, "move_to", move)
    monkeypatch.setattr(served.bench.stage, "stop", halted.set)
    monkeypatch.setattr(served.bench.stage, "moving", lambda: not halted.is_set())
    rail.Move(10)
    moving.wait()
    assert rail.IsMoving
    rail.Halt()
    once(lambda: not rail.IsMoving)


def test_a_run_keeps_clients_from_moving_and_clients_a_run(rail, client, served):
    homed(rail)
    with served.tenancy.held("a run of the plan short"):
        with pytest.raises(exceptions.InvalidOperationException, match="in use by a run of the plan short; wait until"):
            rail.Move(10)
        assert rail.Position >= 0
        rail.Halt()  # stopping is free


def test_a_pause_at_the_door_is_ended_by_the_action_resume(rail, served):
    homed(rail)
    twin, cable = served.bench.simulated.devices["stage"], served.bench.simulated.cables["stage"]
    cable.happen(lambda now_s: twin.door(True, now_s))
    for _ in range(2):  # with the door open it stays paused, and so after `Resume`
        rail.Move(1000)
        with pytest.raises(exceptions.DriverException, match="paused at the door; close it and resume: the action Res"):
            once(lambda: not rail.IsMoving)
        rail.Action("Resume", "")
    cable.happen(lambda now_s: twin.door(False, now_s))
    rail.Action("Resume", "")
    once(lambda: not rail.IsMoving)
    rail.Move(1000)
    once(lambda: not rail.IsMoving)
    assert rail.Position == 1000


def test_a_halt_that_comes_before_the_driver_has_its_order_is_not_lost(rail, served, monkeypatch):
    entered, go_on, moving, halted = (threading.Event() for _ in range(4))
    arrived = []

    def move(**target):
        entered.set()
        go_on.wait()
        moving.set()
        arrived.append(not halted.wait(ENDS_S / 6))

    homed(rail)
    monkeypatch.setattr(served.bench.stage, "move_to", move)
    monkeypatch.setattr(served.bench.stage, "stop", lambda: halted.set() if moving.is_set() else None)
    rail.Move(10)
    entered.wait()
    rail.Halt()
    go_on.set()
    once(lambda: not served.tenancy.tenant)
    assert arrived == [False]


def test_every_member_of_the_switch(box, served):
    assert box.MaxSwitch == 5
    names = [box.GetSwitchName(number) for number in range(5)]
    assert names == ["light", "release", "half-press", "laser", "distance"]
    assert [box.CanWrite(number) for number in range(5)] == [True, True, True, True, False]
    assert all(box.GetSwitchDescription(number) for number in range(5))
    assert [box.MinSwitchValue(number) for number in range(5)] == [0.0] * 5
    assert [box.MaxSwitchValue(number) for number in range(5)] == [1.0, 1.0, 1.0, 1.0, 1e5]
    assert [box.SwitchStep(number) for number in range(5)] == [0.01, 1.0, 1.0, 1.0, 0.1]
    box.SetSwitchValue(0, 0.25)
    assert box.GetSwitchValue(0) == served.bench.light.level() == 0.25
    box.SetSwitch(0, True)
    assert served.bench.light.level() == 1.0
    assert box.GetSwitch(0)
    box.SetSwitch(0, False)
    assert not box.GetSwitch(0)
    box.SetSwitch(2, True)
    assert box.GetSwitch(2)
    box.SetSwitch(2, False)
    box.SetSwitch(3, True)
    assert box.GetSwitchValue(3) == 1.0
    distance_mm = served.bench.devices["rangefinder"].measure().distance_mm
    assert box.GetSwitchValue(4) == pytest.approx(distance_mm, abs=10)  # its noise
    box.SetSwitch(1, True)
    box.SetSwitch(1, False)
    with pytest.raises(NOT_IMPLEMENTED, match="distance is read only"):
        box.SetSwitchValue(4, 1.0)
    with pytest.raises(exceptions.InvalidValueException, match=r"between 0 and 1 for light; got 1\.5"):
        box.SetSwitchValue(0, 1.5)
    with pytest.raises(exceptions.InvalidValueException, match="between 0 and 4; got 5"):
        box.GetSwitch(5)
    for refused in (
        lambda: box.SetAsync(0, True), lambda: box.SetAsyncValue(0, 0.5), lambda: box.CancelAsync(0),
        lambda: box.StateChangeComplete(0), lambda: box.SetSwitchName(0, "lamp"),
    ):  # fmt: skip
        with pytest.raises(NOT_IMPLEMENTED):
            refused()
    assert not box.CanAsync(0)


def test_every_member_of_the_rooms_conditions(client, served):
    room = observingconditions.ObservingConditions(client.address, 0)
    room.Connected = True
    assert room.Temperature == pytest.approx(served.bench.simulated.world.temperature_c(0.0), abs=0.5)
    assert room.Humidity == 45.2
    # of 21 degrees at 45.2 %: 8.6 in tables of dew points
    assert room.DewPoint == pytest.approx(8.6, abs=0.5)
    assert room.AveragePeriod == 0
    assert room.TimeSinceLastUpdate("") == room.TimeSinceLastUpdate("Temperature") == 0
    assert "room" in room.SensorDescription("DewPoint")
    assert {one["Name"] for one in room.DeviceState} == {"Temperature", "Humidity"}
    room.Refresh()
    for hours, error in ((0, 0), (1, 0x401)):
        form = f"AveragePeriod={hours}".encode()
        _, _, body = client.request("PUT", "/api/v1/observingconditions/0/averageperiod", form)
        assert json.loads(body)["ErrorNumber"] == error
    with pytest.raises(exceptions.InvalidValueException, match="the name of a sensor; got 'nose'"):
        room.SensorDescription("nose")
    for name in ("Pressure", "CloudCover", "WindSpeed"):
        with pytest.raises(NOT_IMPLEMENTED):
            getattr(room, name)
    with pytest.raises(NOT_IMPLEMENTED):
        room.SensorDescription("Pressure")


@pytest.mark.parametrize(
    ("method", "path", "form", "status"),
    [
        ("GET", "focuser/0/connected", None, 200),
        ("GET", "focuser/0/connected?clientid=1&CLIENTTRANSACTIONID=77", None, 200),
        ("GET", "focuser/0/connected?ClientID=-1", None, 400),
        ("GET", "focuser/0/connected?ClientTransactionID=4294967296", None, 400),
        ("GET", "focuser/0/connected?ClientTransactionID=seven", None, 400),
        ("GET", "focuser/9/connected", None, 400),
        ("GET", "focuser/x/connected", None, 400),
        ("GET", "dome/0/connected", None, 400),
        ("GET", "focuser/0/nosuch", None, 400),
        ("GET", "focuser/0/halt", None, 400),
        ("PUT", "focuser/0/connected", b"Connected=true", 200),
        ("PUT", "focuser/0/connected", b"connected=true", 400),
        ("PUT", "focuser/0/connected", b"Connected=maybe", 400),
        ("PUT", "focuser/0/connected", b"", 400),
        ("PUT", "focuser/0/connected", b"Connected=True&" + b"x" * 70000, 400),
    ],
)
def test_requests_are_read_by_the_standard(shared_server, method, path, form, status):
    client, _ = shared_server
    came, _, body = client.request(method, f"/api/v1/{path}", form)
    assert came == status, body
    assert b'"ClientTransactionID": 77' in body or "77" not in path


def test_transactions_are_numbered_and_strangers_are_turned_away(shared_server):
    client, _ = shared_server
    url = f"http://127.0.0.1:{client.port}/api/v1/focuser/0/name"
    numbers = [requests.get(url, auth=("any", TOKEN), timeout=30).json()["ServerTransactionID"] for _ in range(3)]
    assert numbers == sorted(set(numbers))
    assert requests.get(url, timeout=30).status_code == 401


def stranger(client, path, form=b"", **headers):
    """Status and body of a PUT without the token."""
    status, _, body = Client(client.port, "").request("PUT", f"/api/v1/{path}", form, **headers)
    return status, body


def test_a_stop_over_alpaca_needs_no_token_and_nothing_else_goes_without(client, served):
    for path in ("focuser/0/halt", "camera/0/abortexposure"):
        assert stranger(client, path)[0] == 200
    assert stranger(client, "switch/0/action", b"Action=EmergencyStop&Parameters=&ClientID=9")[0] == 200
    assert served.bench.stops == 1
    for path, form in (
        ("focuser/0/action", b"Action=Home&Parameters="),
        ("focuser/0/move", b"Position=1"),
        ("focuser/0/connected", b"Connected=True"),
    ):
        status, body = stranger(client, path, form)
        assert (status, b"the token is required" in body) == (401, True)
    assert stranger(client, "focuser/0/halt", Origin="http://elsewhere.example")[0] == 403


def test_clients_are_listed_with_their_rights(client, rail):
    stranger(client, "focuser/0/halt", b"ClientID=9")
    listed = client.get("/status")[1]["clients"]
    assert [(one["rights"], one["devices"]) for one in listed] == [("stop only", []), ("everything", ["focuser 0"])]
    assert [one["address"] for one in listed] == ["127.0.0.1"] * 2
    assert listed[0]["client"] == 9
    for number in range(2 * MOST_LISTED):  # numbers are invented by clients
        stranger(client, "focuser/0/halt", f"ClientID={number}".encode())
    assert len(client.get("/status")[1]["clients"]) == MOST_LISTED


def test_discovery_reports_the_port():
    with closing(Discovery(4711, "127.0.0.1", 0)) as answering, socket.socket(type=socket.SOCK_DGRAM) as asker:
        asker.settimeout(30)
        for words in (b"something else", b""):  # nobody else ends it
            asker.sendto(words, ("127.0.0.1", answering.port))
        asker.sendto(b"alpacadiscovery1", ("127.0.0.1", answering.port))
        assert json.loads(asker.recv(64)) == {"AlpacaPort": 4711}
