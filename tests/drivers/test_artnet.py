"""Art-Net: a node that lights a lamp, and packets as a published client sends them."""

import socket
import threading

import pytest

from drivers.artnet import ArtNetLight, dmx_packet
from drivers.errors import BadConfiguration, LineLost, NoAnswer
from tests.drivers.artnet_node import ArtNetNode


@pytest.fixture
def node():
    """A node; `levels` are those of its lamp so far."""
    levels = []
    node = ArtNetNode(levels.append, channel=3, universe=300)
    node.levels = levels
    yield node
    node.close()


@pytest.fixture
def light(node):
    light = ArtNetLight(node.host, (3, 4), universe=300)
    yield light
    light.close()


def test_the_node_is_identified_and_lit(node, light):
    identity = light.connect()
    assert (identity.model, identity.firmware) == ("Simulated node", "1.3")
    light.set_level(0.5)
    assert node.levels[-1] == pytest.approx(0.5, abs=0.5 / 255)
    assert node.slots[2] == node.slots[3] == 128
    assert light.level() == 0.5
    with pytest.raises(BadConfiguration, match=r"must be in 0 \.\. 1"):
        light.set_level(1.5)


def test_the_level_is_sent_again_while_nothing_changes(node, light, monkeypatch):
    monkeypatch.setattr("drivers.artnet.AGAIN_S", 0.01)
    again = threading.Event()
    node._lit = lambda level: again.set() if node.packets > 3 else None
    light.connect()
    light.set_level(1.0)
    assert again.wait(5.0)


def test_a_lamp_goes_out_though_a_packet_is_lost_and_it_is_closed(node, light):
    light.connect()
    light.set_level(1.0)
    dark, receive = threading.Event(), node._receive
    node._lit = lambda level: dark.set() if level == 0 else None
    node._receive = lambda data: setattr(node, "_receive", receive)  # the next packet is lost
    light.set_level(0.0)
    light.close()
    assert dark.wait(5.0)


def test_a_node_that_is_gone_is_reported(node, light, monkeypatch):
    monkeypatch.setattr("drivers.artnet.REPLY_S", 0.05)
    light.connect()
    node.close()
    with pytest.raises((NoAnswer, LineLost)):
        light.set_level(1.0)


def test_our_packet_is_that_of_a_published_client():
    client = pytest.importorskip("stupidArtnet", reason="stupidArtnet is not installed")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5.0)
        theirs = client.StupidArtnet("127.0.0.1", 300, 512, 30, True, False, port=receiver.getsockname()[1])
        theirs.set_single_value(3, 128)
        theirs.show()
        data = receiver.recv(1024)
        theirs.close()
    slots = bytearray(512)
    slots[2] = 128
    assert data == dmx_packet(300, bytes(slots), data[12])
