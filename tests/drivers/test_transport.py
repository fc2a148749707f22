import os
import select
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import SimpleNamespace

import pytest

from drivers.errors import EmergencyStopped, LineLost, NoAnswer, SystemClock
from drivers.protocols.framing import LineSplitter
from drivers.protocols.grbl import GrblParser, Ok, Status
from drivers.transport import SerialTransport, resolve
from drivers.wire.connection import STOP_TRIES, WRITE_S, Outgoing, Transcript


class Lines:
    """Lines as they are."""

    def __init__(self):
        self._lines = LineSplitter()

    def feed(self, data):
        return self._lines.feed(data)


def nobody(event, host_s):
    """Hears nothing."""


@pytest.fixture
def loop():
    """A line that answers what it is sent."""
    transport = SerialTransport("loop://", Lines)
    transport.open(nobody)
    yield transport
    transport.close()


def echo(line):
    return line


def test_a_request_gets_its_reply(loop):
    assert loop.request(b"hello\n", echo, 1.0) == b"hello"


def test_every_byte_is_in_the_transcript_with_its_time(loop, tmp_path):
    begin_s = loop.clock.now_s()
    loop.request(b"hello\n", echo, 1.0)
    passages = loop.transcript.last()
    assert b"".join(p.data for p in passages if p.way == ">") == b"hello\n"
    assert b"".join(p.data for p in passages if p.way == "<") == b"hello\n"
    assert all(begin_s <= p.time_s <= loop.clock.now_s() for p in passages)


def test_the_transcript_is_written_to_its_file(tmp_path):
    transcript = Transcript(length=2, file=tmp_path / "wire.txt")
    for i in range(5):
        transcript.record(float(i), ">", bytes([i]))
    transcript.close()
    assert len(transcript.last()) == 2
    lines = (tmp_path / "wire.txt").read_text().splitlines()
    assert [line.split()[0] for line in lines] == [f"{i}.000000" for i in range(5)]


def test_transcript_goes_on_in_another_file_and_no_wire_fails_by_a_file(tmp_path):
    transcript = Transcript()
    for place in (tmp_path / "one.txt", tmp_path / "two.txt", tmp_path / "none" / "three.txt", None):
        transcript.write_to(place)
        transcript.record(1.0, "<", b"x")
        assert place is None or place.parent.name == "none" or len(place.read_text().splitlines()) == 1
    assert len(transcript.last()) == 4


def test_transcript_of_many_threads_is_whole(tmp_path):
    transcript = Transcript(file=tmp_path / "wire.txt")
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda i: transcript.record(float(i), ">", b"x" * 50), range(2000)))
    transcript.close()
    lines = (tmp_path / "wire.txt").read_text().splitlines()
    assert sorted(float(line.split()[0]) for line in lines) == list(map(float, range(2000)))


def test_a_deadline_without_reply_is_an_error_that_says_what_to_do(loop):
    with pytest.raises(NoAnswer, match=r": 6 bytes came .* check baud rate"):
        loop.request(b"hello\n", lambda event: None, 0.05)


def test_silence_is_distinguished_from_noise(bench):
    transport = SerialTransport(bench.address("head"), Lines, clock=bench.clock)
    transport.open(nobody)
    with pytest.raises(NoAnswer, match=r"did not answer .* check power and cable"):
        transport.request(b"no command\n", echo, 0.5)
    transport.close()


def test_requests_of_several_threads_do_not_mix(loop):
    mixed = []

    def ask(name):
        for i in range(50):
            line = f"{name}{i}".encode()
            if loop.request(line + b"\n", echo, 5.0) != line:
                mixed.append(line)

    threads = [threading.Thread(target=ask, args=(name,)) for name in "abcd"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not mixed


def test_a_stop_passes_a_waiting_request_and_ends_it(loop):
    outcome = []

    def wait():
        try:
            loop.request(b"hello\n", lambda event: None, 30.0)
        except EmergencyStopped as error:
            outcome.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    while not loop.bytes_received:
        time.sleep(0.001)
    stop = EmergencyStopped("stop", "home")
    loop.preempt(b"!", stop)
    thread.join(30.0)
    assert outcome == [stop]
    assert any(p.way == "!" and p.data == b"!" for p in loop.transcript.last())


def test_a_stop_between_an_order_and_the_wait_for_its_answer_is_not_missed(loop):
    stop = EmergencyStopped("stop", "home")
    write = loop.write

    def then_stopped(data, allowed):
        write(data, allowed)
        loop.preempt(b"!", stop)

    loop.write = then_stopped
    with pytest.raises(EmergencyStopped):
        loop.request(b"order\n", lambda event: None, 30.0)


def test_after_a_stop_requests_work_again(loop):
    loop.preempt(b"\n", EmergencyStopped("stop", "home"))
    assert loop.request(b"hello\n", echo, 1.0) == b"hello"


def test_closing_ends_the_reader_and_every_wait():
    before = set(threading.enumerate())
    transport = SerialTransport("loop://", Lines)
    transport.open(nobody)
    transport.close()
    transport.close()
    assert set(threading.enumerate()) == before
    with pytest.raises(LineLost, match="is closed; connect first"):
        transport.request(b"x\n", echo, 1.0)


def test_a_port_that_is_not_there_is_reported():
    with pytest.raises(LineLost, match="cannot open /dev/nowhere"):
        SerialTransport("/dev/nowhere", Lines).open(nobody)


def test_a_listener_hears_everything_even_unasked(bench):
    heard = []
    transport = SerialTransport(bench.address("stage"), GrblParser, clock=bench.clock)
    transport.open(lambda event, host_s: heard.append(event))
    transport.wait(lambda: len(heard) >= 2, 2.0)
    transport.request(b"?", lambda event: event if isinstance(event, Status) else None, 1.0)
    transport.request(b"\n", lambda event: event if isinstance(event, Ok) else None, 1.0)
    transport.close()
    assert [type(event).__name__ for event in heard] == ["Banner", "Feedback", "Status", "Ok"]


def test_questions_are_asked_again_orders_are_not(bench):
    transport = SerialTransport(bench.address("head"), Lines, clock=bench.clock)
    transport.open(nobody)
    for tries in ({}, {"tries": 3}):
        with pytest.raises(NoAnswer):
            transport.request(b"silence\n", echo, 0.2, **tries)
    assert sum(p.way == ">" for p in transport.transcript.last()) == 4
    transport.close()


@pytest.fixture
def terminal():
    """A line on a pseudo-terminal, and the descriptor of its other end."""
    tty = pytest.importorskip("tty", reason="no pseudo-terminals here")
    master, slave = os.openpty()
    tty.setraw(slave)
    transport = SerialTransport(os.ttyname(slave), Lines)
    transport.open(nobody)
    os.close(slave)
    yield transport, master
    transport.close()
    os.close(master)


def clog(transport):
    """Write until the port takes no more, as where the other end reads nothing."""
    port = transport._port.fd
    while select.select([], [port], [], 0.05)[1]:  # the system makes some more room on the way to the other end
        with suppress(BlockingIOError):
            os.write(port, b"x" * 512)


def heard(master):
    """What has come to the other end."""
    found = b""
    while select.select([master], [], [], 0.2)[0]:
        found += os.read(master, 65536)
    return found


def test_a_stop_comes_first_where_the_port_is_clogged(terminal):
    transport, master = terminal
    clog(transport)
    # the order ends by the stop, not by having waited
    orders = threading.Thread(target=lambda: transport.write(b"order " * 1000, within_s=60.0))
    orders.start()
    while not transport._outgoing._turn.locked():
        time.sleep(0.001)
    transport.preempt(b"stop", EmergencyStopped("stop", "home"))
    orders.join(30.0)
    assert not orders.is_alive()
    came = heard(master)
    assert came.endswith(b"stop")
    assert b"order" not in came
    assert transport.transcript.last()[-1].way == "!"


def test_a_port_that_takes_no_bytes_is_named_and_stays_open_for_a_stop(terminal):
    transport, master = terminal
    clog(transport)
    with pytest.raises(NoAnswer, match=r"took no bytes for 0\.05 s"):
        transport.write(b"order " * 1000, within_s=0.05)
    transport.preempt(b"stop", EmergencyStopped("stop", "home"))
    assert heard(master).endswith(b"stop")


def test_a_stop_into_a_line_that_is_gone_reports_it_and_raises_nothing(terminal):
    transport, _ = terminal
    transport._port.close()
    transport.preempt(b"stop", EmergencyStopped("stop", "home"))
    assert transport.transcript.last()[-1].way == "x"


def test_an_order_that_is_not_allowed_any_more_is_not_written(loop):
    stop = EmergencyStopped("stop", "home")

    def refuse():
        raise stop

    with pytest.raises(EmergencyStopped):
        loop.request(b"order\n", echo, 1.0, allowed=refuse)
    assert not any(b"order" in p.data for p in loop.transcript.last())
    assert loop.request(b"hello\n", echo, 1.0) == b"hello"


def test_a_port_is_opened_as_it_is_configured(monkeypatch):
    port = SimpleNamespace(open=lambda: setattr(port, "is_open", True), read=lambda n: time.sleep(0.01) or b"")
    port.cancel_read, port.close, port.in_waiting = (lambda: None), (lambda: setattr(port, "is_open", False)), 0
    asked = []
    monkeypatch.setattr("serial.serial_for_url", lambda url, do_not_open: asked.append((url, do_not_open)) or port)
    for options, lines in (({}, {}), ({"baud": 9600, "dtr": False, "rts": True}, {"dtr": False, "rts": True})):
        for name in ("dtr", "rts", "exclusive"):
            vars(port).pop(name, None)
        transport = SerialTransport("/dev/ttyX", Lines, **options)
        assert not transport.is_open
        transport.open(nobody)
        assert (transport.is_open, port.is_open, port.exclusive) == (True, True, True)
        assert (port.baudrate, port.timeout, port.write_timeout) == (options.get("baud", 115200), 0.25, WRITE_S)
        assert {name: vars(port)[name] for name in ("dtr", "rts") if name in vars(port)} == lines
        transport.set_lines(rts=False)
        assert port.rts is False
        transport.close()
        assert (transport.is_open, port.is_open) == (False, False)
        with pytest.raises(LineLost, match="is closed; connect first"):
            transport.write(b"x")
        with pytest.raises(LineLost, match="is not open"):
            transport.set_lines(rts=True)
    assert asked == [("/dev/ttyX", True)] * 2


PORTS = [
    SimpleNamespace(device="/dev/ttyUSB0", vid=0x1A86, pid=0x7523, serial_number=None),
    SimpleNamespace(device="/dev/ttyUSB1", vid=0x0403, pid=0x6001, serial_number="A10K8QZV"),
]


@pytest.mark.parametrize("address", ["usb:A10K8QZV", "usb:a10k8qzv", "usb:0403:6001:A10K8QZV"])
def test_a_port_is_found_by_its_usb_serial_number(address):
    assert resolve(address, lambda: PORTS) == "/dev/ttyUSB1"


def test_a_serial_number_that_is_not_there_names_those_that_are_and_other_addresses_are_left_alone():
    with pytest.raises(LineLost, match=r"/dev/ttyUSB0 has no serial number, /dev/ttyUSB1 has A10K8QZV"):
        resolve("usb:OTHER", lambda: PORTS)
    assert resolve("socket://host:1", lambda: PORTS) == "socket://host:1"
    clock, condition = SystemClock(), threading.Condition()
    begin_s = clock.now_s()
    with condition:
        assert not clock.wait(condition, lambda: False, begin_s + 0.02)
    assert clock.now_s() >= begin_s + 0.02


@pytest.mark.parametrize(("refusals", "taken"), [(0, True), (STOP_TRIES - 1, True), (STOP_TRIES, False)])
def test_a_stop_is_offered_again_to_a_port_that_takes_no_bytes(refusals, taken):
    class Clogged:
        """A port without a descriptor, whose writes run into their time limit."""

        def __init__(self):
            self.left, self.took = refusals, b""

        def write(self, data):
            if self.left:
                self.left -= 1
                raise TimeoutError
            self.took += data

    port = Clogged()
    assert Outgoing(port).stop(b"!") is taken
    assert port.took == (b"!" if taken else b"")
