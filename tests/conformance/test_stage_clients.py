"""The twins of stage controllers, driven by published clients, which share no line with our drivers."""

import time
from collections.abc import Callable

import pytest

from simulators.devices.gcs import GcsTwin
from simulators.devices.newport import Esp301Twin
from simulators.devices.ports import PtyPort, TcpPort
from simulators.devices.serial_device import Cable
from simulators.devices.thorlabs import AptTwin
from simulators.world.clock import FastClock
from simulators.world.motion import Axis

SLOW_FIXTURES = {"port"}

COUNTS = 34304.0


@pytest.fixture
def port():
    """port(device, kind): a simulated device at the address of a port; twenty times as fast as real ones."""
    ports = []

    def opened(device, kind):
        ports.append(kind(Cable(device, FastClock(20.0))))
        return ports[-1].address

    yield opened
    for one in ports:
        one.close()


def until(ready: Callable[[], object], limit_s: float = 10.0) -> None:
    """Poll, as these clients do."""
    deadline = time.monotonic() + limit_s
    while not ready():
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.01)


def axis() -> dict[str, Axis]:
    return {"x_mm": Axis(0.0, 50.0, 21.0)}


@pytest.fixture
def kcube(port):
    devices = pytest.importorskip("thorlabs_apt_device.devices.kdc101", reason="thorlabs-apt-device is not installed")
    twin = AptTwin(axis(), counts=COUNTS, sources=(0x50,))
    stage = devices.KDC101(serial_port=port(twin, PtyPort), home=False)
    stage.twin = twin
    yield stage
    stage.close()
    stage._thread.join()


def test_a_k_cube_homes_moves_and_stops(kcube):
    until(lambda: kcube.status["channel_enabled"])
    assert not kcube.status["homed"]
    kcube.home()
    until(lambda: kcube.status["homed"] and not kcube.status["homing"])
    assert kcube.status["position"] == 0
    kcube.move_absolute(round(10 * COUNTS))
    until(lambda: kcube.status["position"] == round(10 * COUNTS))
    kcube.move_absolute(round(50 * COUNTS))
    until(lambda: kcube.status["moving_forward"] or kcube.status["moving_reverse"])
    kcube.stop()
    until(lambda: not (kcube.status["moving_forward"] or kcube.status["moving_reverse"]))
    assert 10 * COUNTS < kcube.status["position"] < 50 * COUNTS


def test_our_messages_are_those_of_the_published_protocol():
    apt = pytest.importorskip("thorlabs_apt_protocol", reason="thorlabs-apt-protocol is not installed")
    from drivers import thorlabs

    ends = {"dest": 0x50, "source": 0x01, "chan_ident": 1}
    ours = [
        thorlabs.header(thorlabs.HOMING, 0x50, 1),
        thorlabs.header(thorlabs.STOP, 0x50, 1, thorlabs.PROFILED),
        thorlabs.header(thorlabs.REQ_STATUS, 0x50, 1),
        thorlabs.header(thorlabs.ENABLE, 0x50, 1, 1),
        thorlabs.packet(thorlabs.SET_TARGET, 0x50, b"\x01\x00\x00\x20\x03\x00"),
        thorlabs.header(thorlabs.MOVE, 0x50, 1),
    ]
    assert ours == [
        apt.mot_move_home(**ends), apt.mot_move_stop(**ends, stop_mode=2), apt.mot_req_dcstatusupdate(**ends),
        apt.mod_set_chanenablestate(**ends, enable_state=1),
        apt.mot_set_moveabsparams(**ends, absolute_position=204800), apt.mot_move_absolute(**ends),
    ]  # fmt: skip


@pytest.fixture
def pi(port):
    pipython = pytest.importorskip("pipython", reason="pipython is not installed")
    from pipython.pidevice.gcscommands import GCSCommands
    from pipython.pidevice.gcsmessages import GCSMessages
    from pipython.pidevice.interfaces.pisocket import PISocket

    assert pipython.__name__
    host, number = port(GcsTwin(axis()), TcpPort).removeprefix("socket://").split(":")
    with PISocket(host, int(number)) as gateway:
        yield GCSCommands(GCSMessages(gateway))


def test_a_pi_controller_references_moves_and_stops(pi):
    from pipython import pitools
    from pipython.pidevice.gcserror import GCSError

    assert "C-884" in pi.qIDN()
    assert pi.axes == ["1"]
    pi.SVO("1", True)
    with pytest.raises(GCSError, match="Unallowable move"):
        pi.MOV("1", 10.0)
    pi.FRF("1")
    until(lambda: pi.qFRF("1")["1"])
    pi.MOV("1", 10.0)
    pitools.waitontarget(pi, "1", timeout=10)
    assert pi.qPOS("1")["1"] == pytest.approx(10.0)
    assert (pi.qTMN("1")["1"], pi.qTMX("1")["1"]) == (0.0, 50.0)
    pi.MOV("1", 50.0)
    assert pi.IsMoving("1")["1"]
    with pytest.raises(GCSError, match="stopped"):
        pi.StopAll()
    assert 10.0 < pi.qPOS("1")["1"] < 50.0


def test_an_esp301_homes_moves_and_stops(port, monkeypatch):
    esp = pytest.importorskip("newportESP", reason="newportESP is not installed")

    serial = esp.serial.Serial

    class TextPort:
        """The client was written for Python 2, where text is bytes."""

        def __init__(self, **options):
            self._port = serial(**{**options, "rtscts": False})

        def write(self, text):
            self._port.write(text.encode())

        def readline(self):
            return self._port.readline().decode()

        def close(self):
            self._port.close()

    monkeypatch.setattr(esp.serial, "Serial", TextPort)
    monkeypatch.delattr(esp.Axis, "__del__")  # it would write to a closed port
    controller = esp.ESP(port(Esp301Twin(axis()), PtyPort))
    assert controller.version.startswith("ESP301")
    x = controller.axis(1)
    x.on()
    x.home_search(4)
    x.wait()
    assert x.position == 0.0
    x.move_to(10.0, wait=True)
    assert x.position == 10.0
    assert x.travel_limits() == {"left": 0.0, "right": 50.0}
    assert x.unit == "millimiter"
    x.move_to(50.0)
    until(lambda: x.position > 10.0)
    x.stop()
    x.wait()
    assert 10.0 < x.position < 50.0
    x.move_to(60.0)
    with pytest.raises(esp.NewportError, match="PARAMETER OUT OF RANGE"):
        controller.raise_error()
