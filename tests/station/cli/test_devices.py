import json
import signal
import subprocess
import sys
import tomllib

import pytest

from drivers.protocols.zaber import Reply, ZaberParser
from drivers.transport import SerialTransport
from tests.program import run


def test_the_simulated_bench_is_shown_with_firmware_and_state():
    done = run("devices", "--simulate")
    rows = {line.split()[0]: line for line in done.stdout.splitlines()}
    assert "1.1h.20190830" in rows["stage"]
    assert "not homed" in rows["stage"]
    assert "home the stage" in rows["stage"]
    assert "ready" in rows["shutter"]


def test_what_is_wrong_is_shown_with_its_remedy(tmp_path):
    config = tmp_path / "station.toml"
    config.write_text(
        '[devices.light]\ndriver = "dmx"\nport = "/dev/nowhere"\n'
        '[devices.rangefinder]\ndriver = "jrt"\nport = "usb:NOSUCH"\n'
    )
    done = run("devices", "--config", config, "--json", code=3)
    rows = json.loads(done.stdout)
    assert [row["name"] for row in rows] == ["light", "rangefinder"]
    assert all(row["wrong"] and row["remedy"] and not row["usable"] for row in rows)
    assert "light: cannot open /dev/nowhere" in done.stderr
    assert "what to do: plug the cable in" in done.stderr


def test_without_configuration_the_remedy_names_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run("devices", code=2, says="there is no station.toml")
    assert "use --simulate" in done.stderr


def test_commissioning_asks_first_and_writes_the_tables(tmp_path):
    output = tmp_path / "stages.toml"
    commissioned = run("devices", "--simulate", "--commission", "--output", output, typed="n\n\n")
    assert commissioned.stderr.count("Is the way free and the emergency stop at hand? [y/N]") == 2
    tables = tomllib.loads(output.read_text())["devices"]
    assert [axis["name"] for axis in tables["stage"]["axes"]] == ["z_mm", "x_mm", "y_mm"]
    assert tables["head"]["driver"] == "zaber"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals here")
def test_commissioning_replaces_no_file_and_refuses_its_output_before_anything_moves(tmp_path):
    (tmp_path / "station.toml").write_text('unit = "lp/mm"')
    for output in (tmp_path / "station.toml", tmp_path / "none" / "stages.toml"):
        run("devices", "--simulate", "--commission", "--output", output, code=2, says="nothing is replaced")
    assert (tmp_path / "station.toml").read_text() == 'unit = "lp/mm"'
    run("devices", "--simulate", "--output", tmp_path / "stages.toml", code=2, says="--commission")


def test_other_programs_reach_the_simulated_bench(tmp_path):
    command = [sys.executable, "-m", "station", "simulate", "--json", "--folder", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        ports = json.loads(process.stdout.readline())
        transport = SerialTransport(ports["head"][1], ZaberParser)
        transport.open(lambda event, host_s: None)
        reply = transport.request(b"/1 get deviceid\n", lambda event: event if isinstance(event, Reply) else None, 2.0)
        transport.close()
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=10.0) == 0
    assert reply.data == "50081"
