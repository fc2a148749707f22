"""The drivers of Alpaca devices at a server that others wrote (alpaca-simulators)."""

import threading

import pytest

from drivers.alpaca.camera import AlpacaCamera
from drivers.alpaca.link import AlpacaAddress, AlpacaProbe
from drivers.alpaca.stage import AlpacaAxis, AlpacaStage
from drivers.dng import DngFolder
from station.bench.opening import inspect_raw
from station.service.hosting import Hosting, listen

pytestmark = pytest.mark.slow  # the server loads astronomers' packages


@pytest.fixture(scope="module")
def server():
    pytest.importorskip("alpaca_simulators", reason="alpaca-simulators is not installed (extra `peers`)")
    from alpaca_simulators.main import app

    hosting = Hosting(app, listen("127.0.0.1", 0), threading.Event())
    hosting.begin()
    yield AlpacaAddress(f"127.0.0.1:{hosting.port}")
    hosting.end()


def test_a_focuser_goes_where_it_is_sent(server):
    stage = AlpacaStage(server, [AlpacaAxis("z_mm", 0, unit_per_step=0.001)], patience_s=20.0)
    stage.connect()
    stage.home()
    here = stage.position()["z_mm"]
    goal = here + (0.5 if stage.travel()["z_mm"].holds(here + 0.5) else -0.5)
    stage.move_to(z_mm=goal)
    assert stage.position()["z_mm"] == pytest.approx(goal, abs=0.002)
    assert stage.resume() is None  # this server has no pauses
    stage.stop()  # its motions take no time
    assert not stage.moving()
    stage.close()


def test_a_cameras_format_is_known_before_a_photograph(server, tmp_path):
    camera = AlpacaCamera(server, 0, DngFolder(tmp_path, inspect_raw))
    camera.connect()
    sensor = camera.sensor()
    assert min(sensor.columns, sensor.rows) > 0
    assert sensor.white == 65535
    camera.emergency_stop()  # without an exposure there is nothing to abort
    camera.close()


def test_weather_sensors_are_read(server):
    probe = AlpacaProbe(server, 0, {"temperature": 0.5})
    probe.connect()
    readings = probe.read()
    assert {name: one.unit for name, one in readings.items()} == {
        "temperature": "°C", "humidity": "%", "pressure": "hPa",
    }  # fmt: skip
    assert -60 < readings["temperature"].value < 60
    assert 0 <= readings["humidity"].value <= 100
    assert 500 < readings["pressure"].value < 1100
    probe.close()
