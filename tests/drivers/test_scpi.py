"""Instruments with SCPI: at a byte-level twin, and by pyvisa at pyvisa-sim, which others have written."""

import pytest

from drivers.errors import BadConfiguration, LineLost, NoAnswer, NoReading, Rejected
from drivers.interfaces import PROBE_UNITS, ProbeReading
from drivers.scpi import ProbeChannel, ScpiLight, ScpiParser, ScpiProbe, SupplySettings
from drivers.transport import SerialTransport, register_scheme
from drivers.wire.visa import VisaTransport
from simulators.devices.instruments import ScpiTwin
from simulators.devices.serial_device import Cable, Faults, plug, unplug
from simulators.world.clock import VirtualClock
from simulators.world.world import World

SIMULATED = """\
spec: "1.1"
devices:
  meter:
    eom:
      USB INSTR: {q: "\\n", r: "\\n"}
    error:
      error_queue: [{q: "SYST:ERR?", default: '0,"No error"', command_error: '-113,"Undefined header"'}]
    dialogues:
      - {q: "*IDN?", r: "Thorlabs,PM100D,P0012345,2.4.0"}
      - {q: "MEAS:POW?", r: "1.234E-03"}
      - {q: "MEAS:TEMP?", r: "+9.91E+37"}
  supply:
    eom:
      USB INSTR: {q: "\\n", r: "\\n"}
    error:
      error_queue: [{q: "SYST:ERR?", default: '0,"No error"', command_error: '-113,"Undefined header"'}]
    dialogues:
      - {q: "*IDN?", r: "Maker,Supply,42,1.0"}
    properties:
      current:
        default: 0.0
        getter: {q: "CURR?", r: "{:.4f}"}
        setter: {q: "CURR {:.6f}"}
        specs: {min: 0.0, max: 3.0, type: float}
      output:
        default: 0
        getter: {q: "OUTP?", r: "{:d}"}
        setter: {q: "OUTP {:d}"}
        specs: {valid: [0, 1], type: int}
resources:
  "USB0::0x1313::0x8078::P0012345::INSTR": {device: meter}
  "USB0::0x1313::0x0001::42::INSTR": {device: supply}
"""


@pytest.fixture
def twin():
    """A twin on a cable, with its world and clock."""
    world, clock = World(), VirtualClock()
    device = ScpiTwin(world)
    device.world, device.clock, device.cable = world, clock, Cable(device, clock)
    register_scheme("simulators.devices")
    plug("test/scpi", device.cable)
    device.line = SerialTransport("sim://test/scpi", ScpiParser, baud=9600, clock=clock)
    yield device
    device.line.close()
    unplug("test/scpi")


def test_a_lamp_gives_the_light_that_was_set(twin):
    light = ScpiLight(twin.line, SupplySettings(full=2.0), clock=twin.clock)
    assert light.connect().model == "STATION SIM-SUPPLY"
    light.set_level(0.25)
    assert light.level() == 0.25
    assert light.measured_level() == pytest.approx(0.25)
    assert twin.world.lamp(1e6) == pytest.approx(0.25)
    light.set_level(0.0)
    assert twin.world.lamp(1e6) == 0.0


def test_a_level_beyond_the_supply_is_refused_in_its_words(twin):
    light = ScpiLight(twin.line, SupplySettings(full=5.0), clock=twin.clock)
    light.connect()
    with pytest.raises(Rejected, match=r"refused CURR 5\.0*: data out of range \(-222\)"):
        light.set_level(1.0)
    assert light.level() == 0.0


def test_the_output_is_switched_off_also_where_the_supply_refuses_the_setting(twin):
    light = ScpiLight(twin.line, SupplySettings(full=2.0), clock=twin.clock)
    light.connect()
    light.set_level(1.0)
    receive = twin.receive
    twin.receive = lambda data, now_s: receive(data.replace(b"CURR 0.000000", b"CURR 9"), now_s)
    with pytest.raises(Rejected):
        light.set_level(0.0)
    assert twin.world.lamp(1e6) == 0.0


def test_an_error_from_before_is_not_that_of_the_next_order(twin):
    light = ScpiLight(twin.line, SupplySettings(full=2.0), clock=twin.clock)
    twin.receive(b"NONSENSE\n", 0.0)
    light.connect()
    light.set_level(0.5)
    assert light.level() == 0.5


def test_a_probe_reads_the_room_with_its_uncertainty(twin):
    probe = ScpiProbe(
        twin.line, (ProbeChannel("temperature", "MEAS:TEMP?", 0.2), ProbeChannel("humidity", "MEAS:HUM?"))
    )
    probe.connect()
    now_s = twin.clock.now_s()
    reading = probe.read()
    assert reading["temperature"].value == pytest.approx(twin.world.temperature_c(now_s), abs=1e-4)
    assert (reading["temperature"].unit, reading["temperature"].uncertainty) == (PROBE_UNITS["temperature"], 0.2)
    assert reading["humidity"] == ProbeReading(pytest.approx(45.2), "%")


def test_a_sensor_without_number_is_no_reading(twin):
    probe = ScpiProbe(twin.line, (ProbeChannel("temperature", "MEAS:TEMP?"),))
    probe.connect()
    twin.unplugged = True
    with pytest.raises(NoReading, match="check sensor and range"):
        probe.read()


def test_a_reply_that_slips_by_one_is_never_taken_for_the_next(twin):
    probe = ScpiProbe(twin.line, (ProbeChannel("temperature", "MEAS:TEMP?"), ProbeChannel("humidity", "MEAS:HUM?")))
    probe.connect()
    twin.cable.faults = Faults(slip=True)
    for _ in range(3):
        with pytest.raises(NoAnswer):
            probe.read()
    twin.cable.faults = Faults()
    assert probe.read()["humidity"].value == pytest.approx(45.2)


@pytest.fixture
def library(tmp_path):
    pytest.importorskip("pyvisa", reason="pyvisa is not installed (extra `visa`)")
    pytest.importorskip("pyvisa_sim", reason="pyvisa-sim is not installed")
    file = tmp_path / "instruments.yaml"
    file.write_text(SIMULATED)
    return f"{file}@sim"


def test_a_power_meter_by_visa(library):
    line = VisaTransport("visa:USB0::0x1313::0x8078::P0012345::INSTR", ScpiParser, library=library)
    probe = ScpiProbe(line, (ProbeChannel("power", "MEAS:POW?", 5e-5),))
    identity = probe.connect()
    assert (identity.model, identity.firmware, identity.serial) == ("Thorlabs PM100D", "2.4.0", "P0012345")
    assert probe.read() == {"power": ProbeReading(1.234e-3, "W", 5e-5)}
    probe.close()
    with pytest.raises(LineLost, match="is not connected"):
        probe.read()


def test_a_supply_by_visa(library):
    line = VisaTransport("visa:USB0::0x1313::0x0001::42::INSTR", ScpiParser, library=library)
    light = ScpiLight(line, SupplySettings(full=2.0))
    light.connect()
    light.set_level(0.5)
    assert light._number("CURR?") == 1.0
    light.close()


def test_a_resource_that_is_not_there_is_a_lost_line(library):
    line = VisaTransport("visa:NOWHERE", ScpiParser, library=library)
    with pytest.raises(LineLost, match=r"cannot open visa:NOWHERE.*pyvisa-shell list"):
        ScpiProbe(line, ()).connect()


def test_without_pyvisa_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyvisa", None)
    with pytest.raises(BadConfiguration, match=r"calibration-station\[visa\]"):
        VisaTransport("visa:ASRL1::INSTR", ScpiParser).open(lambda line, host_s: None)
