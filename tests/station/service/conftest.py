from contextlib import contextmanager

import pytest

from drivers.alpaca.link import AlpacaAddress
from station.guide import catalogue

from ..guide import benches
from .serving import TOKEN, serving


@contextmanager
def serving_short_plans(folder):
    short = catalogue.GuidedProcedure("a short plan", benches.short_plan)
    with pytest.MonkeyPatch.context() as patch, serving(folder) as both:
        patch.setattr(catalogue, "PLANS", {**catalogue.PLANS, "short": short})
        yield both


@pytest.fixture
def server(tmp_path):
    """A client, and what is served; the plan `short` takes no time."""
    with serving_short_plans(tmp_path) as both:
        yield both


@pytest.fixture(scope="module")
def shared_server(tmp_path_factory):
    """The same for tests that leave it as it is."""
    with serving_short_plans(tmp_path_factory.mktemp("served")) as both:
        yield both


@pytest.fixture
def client(server):
    return server[0]


@pytest.fixture
def served(server):
    return server[1]


@pytest.fixture
def camera(client):
    """The bench's camera, by the ASCOM Initiative's own client."""
    device = pytest.importorskip("alpaca.camera").Camera(client.address, 0)
    device.Connected = True
    return device


@pytest.fixture
def at(client, monkeypatch):
    """The server as configured in a driver, with its password in the environment."""
    monkeypatch.setenv("BENCH_TOKEN", TOKEN)
    return AlpacaAddress(f"127.0.0.1:{client.port}", "BENCH_TOKEN")
