"""A session resumes only on the bench on which it began; another is refused before any connection."""

import socket
from contextlib import closing

import pytest

from procedures.outcome import BadParameter
from station.bench.device_models import bench_differences
from station.guide.scripted import ScriptedOperator
from station.guide.workspace import StationLab
from station.sessions.layout import Busy
from tests.program import run

NOBODY = "socket://127.0.0.1:9"


def config(path, port=NOBODY, more=""):
    path.write_text(f'[devices.stage]\ndriver = "grbl"\nport = "{port}"\n{more}'
                    'axes = [{ name = "z_mm", letter = "X", feed_per_min = 3000 }]\n')  # fmt: skip
    return path


@pytest.fixture
def listener():
    """A port that detects connections."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        yield server


@pytest.fixture
def begun(tmp_path):
    """The folder of a session that began with a.toml and is still open."""
    with closing(StationLab(sessions=tmp_path / "sessions", config=config(tmp_path / "a.toml"))) as lab:
        lab.begin("pattern", "C", "L", ScriptedOperator())
        (folder,) = (tmp_path / "sessions").iterdir()
        yield folder


def test_another_port_is_refused_and_not_connected(begun, tmp_path, listener):
    port = f"socket://127.0.0.1:{listener.getsockname()[1]}"
    other = config(tmp_path / "b.toml", port)
    done = run("session", "resume", begun, "--config", other, code=2)
    assert f"b.toml has another: devices.stage.port was '{NOBODY}', is '{port}'" in done.output
    assert f"give --config {tmp_path / 'a.toml'}" in done.stderr
    with pytest.raises(BlockingIOError):
        listener.accept()


@pytest.mark.parametrize(
    ("lab", "words"),
    [({"simulate": True}, "without --simulate"), ({}, "no configuration has another: devices.stage.driver was 'grbl'")],
    ids=str,
)
def test_neither_a_simulated_bench_nor_none_replaces_it(begun, lab, words):
    with pytest.raises(BadParameter, match=words):
        StationLab(sessions=begun.parent, config=None, **lab).resume(begun, ScriptedOperator())


def test_a_simulated_session_does_not_resume_on_a_real_device(tmp_path):
    with closing(StationLab(sessions=tmp_path / "sessions", config=None, simulate=True)) as lab:
        lab.begin("pattern", "C", "L", ScriptedOperator())
        (folder,) = (tmp_path / "sessions").iterdir()
        real = StationLab(sessions=folder.parent, config=config(tmp_path / "a.toml"))
        with pytest.raises(BadParameter, match=r"a simulated one; got a real one; resume it with --simulate"):
            real.resume(folder, ScriptedOperator())


def test_the_same_bench_with_other_settings_is_accepted(begun, tmp_path):
    same = config(tmp_path / "c.toml", more="poll_s = 0.1\n")
    with closing(StationLab(sessions=begun.parent, config=same)) as lab, pytest.raises(Busy):  # accepted
        lab.resume(begun, ScriptedOperator())


def test_every_difference_of_hardware_is_named():
    stage = {"driver": "grbl", "port": "a", "poll_s": 1.0, "axes": [{"name": "z_mm", "letter": "X", "feed_per_min": 9}]}
    other = {**stage, "poll_s": 2.0, "axes": [{"name": "z_mm", "letter": "Y", "feed_per_min": 8}]}
    assert bench_differences({"stage": stage}, {"stage": dict(stage)}) == []
    assert bench_differences({"stage": stage}, {"stage": other}) == ["devices.stage.axes[1].letter was 'X', is 'Y'"]
    assert "devices.light.driver was absent, is 'dmx'" in bench_differences({}, {"light": {"driver": "dmx"}})
