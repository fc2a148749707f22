"""Datagrams of TMCL: in step, late, cut off, and the stop past all of them."""

import struct

import pytest

from drivers.errors import NoAnswer, NotHomed, Rejected, WasReset
from drivers.tmcl.link import PendingReply, checksum, library, stop_bytes
from drivers.tmcl.stage import TmclAxis
from simulators.devices.serial_device import Cable, plug
from simulators.devices.tmcl import TmclModule
from simulators.world.motion import Axis

from .orders import AXES, MST, MVP, RFS, STEP, datagram

pytest.importorskip("pytrinamic", reason="pytrinamic is not installed (extra `tmcl`)")


def test_the_numbers_of_the_library_are_the_manuals():
    assert library().datagram(1, MVP, 0, 2, -1000) == datagram(1, MVP, 0, 2, -1000)
    with pytest.raises(Rejected, match=r"module 1 at here refused MVP 9, 0, 5: status 3 \(wrong type\)"):
        library().host(lambda sent: _answer(3, sent[1], 0), "here").move(9, 0, 5, 1)


def _answer(status, command, value):
    body = struct.pack(">BBBBi", 2, 1, status, command, value)
    return body + bytes([checksum(body)])


@pytest.mark.parametrize("stray", range(1, 9))
def test_a_module_that_has_stray_bytes_is_brought_into_step(homed, bench, module, stray):
    bench.cables["stage"].happen(lambda now_s: module.receive(bytes(stray), now_s))
    assert homed.position()["z_mm"] == pytest.approx(100.0)
    homed.move_to(z_mm=20.0)


def test_an_answer_that_comes_late_is_not_taken_for_the_next_ones(homed, bench):
    bench.cables["stage"].faults.delay_s = 0.32  # past the deadline of a question, before that of the next
    with pytest.raises(NoAnswer):
        homed._link.host().get_axis_parameter(1, 0, 1, signed=True)
    bench.cables["stage"].faults.delay_s = 0.0
    assert homed._parameter(AXES[0], 3) == 0  # its speed, and not its position


def test_two_modules_of_a_line_move_and_are_brought_into_step_together(make, bench, module):
    second = TmclModule([(Axis(0.0, 200.0, 20.0), STEP)], address=7)
    both = Both(module, second)
    bench.cables["stage"] = cable = Cable(both, bench.clock)
    plug(f"{bench.name}/stage", cable)
    stage = make([AXES[0], TmclAxis("y_mm", 0, (0.0, 200.0), STEP, module=7)])
    assert stage.connect().model == "TMCL TMCM-3110"
    stage.home()
    cable.happen(lambda now_s: both.receive(b"\0\0\0", now_s))  # an order was cut off
    stage.move_to(z_mm=30.0, y_mm=40.0)
    assert stage.position() == pytest.approx({"z_mm": 30.0, "y_mm": 40.0})
    cable.happen(second.restart)
    with pytest.raises(WasReset, match="module 7"):
        stage.move_to(z_mm=10.0)
    assert stage.position()["z_mm"] == pytest.approx(30.0)


class Both:
    """Two modules that hear the same bytes."""

    baud = 9600

    def __init__(self, *modules):
        self.modules = modules

    def set_lines(self, rts, dtr, now_s):
        pass

    def receive(self, data, now_s):
        for module in self.modules:
            module.receive(data, now_s)

    def advance(self, now_s):
        return b"".join(module.advance(now_s) for module in self.modules)

    def next_event_s(self):
        return min((moment for one in self.modules if (moment := one.next_event_s()) is not None), default=None)


def test_what_a_stop_cut_off_while_the_line_came_into_step_is_owed_after_it(homed, bench, module, monkeypatch):
    obey, stops = module._obey, PendingReply(1)

    def stopped_meanwhile(command, *order):
        if command == 136:
            monkeypatch.setattr(module, "_obey", obey)
            homed._link._pending.add(stops)
        return obey(command, *order)

    homed._link._pending.add(PendingReply(1))
    monkeypatch.setattr(module, "_obey", stopped_meanwhile)
    homed._link._step(1)
    assert homed._link._pending == {stops}
    homed.position()
    assert not homed._link._pending


def rest(cut, module_number=1):
    """Two motors on their way; one gets `cut` bytes of an order, then the stop."""
    axes = [Axis(0.0, 1e9, 5e8), Axis(0.0, 1e9, 5e8)]
    module = TmclModule([(axis, 1.0) for axis in axes], address=module_number)
    module.receive(datagram(module_number, 1, 0, 0, 500) + datagram(module_number, 2, 0, 1, 500), 0.0)
    assert all(axis.velocity(1.0) for axis in axes)
    module.obeyed.clear()
    module.receive(datagram(module_number, MVP, 0, 0, 123456)[:cut], 1.0)
    module.receive(stop_bytes([(module_number, 0), (module_number, 1)]), 1.0)
    return module, axes


@pytest.mark.parametrize("cut", range(9))
def test_the_stop_reaches_a_module_wherever_it_is_in_a_datagram(cut):
    module, axes = rest(cut)
    assert {order[0] for order in module.obeyed} == {MST, RFS}
    module.advance(1000.0)
    assert [axis.velocity(1000.0) for axis in axes] == [0.0, 0.0]


@pytest.mark.slow
def test_nothing_of_the_stop_is_another_order_however_it_is_read():
    for address in range(1, 256):
        stops = stop_bytes([(address, motor) for motor in range(6)])
        for shift in range(9):
            for at in range(shift, len(stops) - 8, 9):
                read = stops[at : at + 9]
                if read[0] == address and checksum(read[:-1]) == read[-1]:
                    assert read[1:3] in (bytes([MST, 0]), bytes([RFS, 1]))


def test_a_stop_leaves_a_module_in_step_where_it_was():
    module, _ = rest(0)
    module.advance(1.0)
    module.receive(datagram(1, 136, 1), 1.0)
    assert module.advance(1.0) == _answer(100, 136, 3110 << 16 | 1 << 8 | 15)


def test_a_stage_that_was_not_connected_takes_a_stop(make):
    stage = make()
    stage.emergency_stop()
    stage.connect()
    with pytest.raises(NotHomed):
        stage.move_to(z_mm=1.0)
