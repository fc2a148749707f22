import pytest

from drivers.tmcl.link import TmclParser
from drivers.tmcl.stage import TmclStage
from simulators.devices.serial_device import Cable, plug
from simulators.devices.tmcl import TmclModule
from simulators.world.motion import Axis

from .orders import AXES, STEP


@pytest.fixture
def module(bench):
    pytest.importorskip("pytrinamic", reason="pytrinamic is not installed (extra `tmcl`)")
    module = TmclModule([(Axis(0.0, 200.0, 20.0), STEP) for _ in AXES])
    bench.cables["stage"] = cable = Cable(module, bench.clock)
    plug(f"{bench.name}/stage", cable)
    return module


@pytest.fixture
def make(wired, module):
    return lambda axes=AXES, **more: wired(TmclStage, TmclParser, "stage", axes, line={"baud": 9600}, **more)


@pytest.fixture
def stage(make):
    stage = make()
    stage.connect()
    return stage


@pytest.fixture
def homed(stage):
    stage.home()
    stage.move_to(z_mm=100.0, x_mm=100.0)
    return stage


@pytest.fixture
def after_an_order(module, monkeypatch):
    """Let something happen as soon as the module has obeyed its first order of a kind."""

    def when(command, kind, happen):
        obey = module._obey

        def meddled(*order):
            done = obey(*order)
            if order[:2] == (command, kind):
                monkeypatch.setattr(module, "_obey", obey)
                happen()
            return done

        monkeypatch.setattr(module, "_obey", meddled)

    return when
