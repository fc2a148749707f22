"""Round trips per second of each device over sim://, emergency stops during a homing, CPU of an idle bench."""

from __future__ import annotations

import os
import platform
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import serial

from drivers.errors import DeviceError
from drivers.rangefinder import BoschParser, BoschRangefinder
from drivers.transport import SerialTransport
from station.bench.opening import Bench, simulated_bench

RUNS, TRIPS, STOPS, IDLE_S = 5, 2000, 200, 20.0
BOUND_PER_S, BOUND_STOP_MS, BOUND_IDLE = 5000.0, 20.0, 0.02


def best_rate(trip: Callable[[], object]) -> float:
    """Most round trips per second of some runs."""
    rates = []
    for _ in range(RUNS):
        start = time.perf_counter()
        for _ in range(TRIPS):
            trip()
        rates.append(TRIPS / (time.perf_counter() - start))
    return max(rates)


def bare_rate(address: str, question: bytes) -> float:
    """The same question by pyserial alone, read by whoever asks: no reader thread, no lock, no transcript."""
    port = serial.serial_for_url(address, baudrate=115200, timeout=1.0)
    time.sleep(0.6)
    port.read(port.in_waiting)

    def trip() -> None:
        port.write(question)
        while not port.read(max(port.in_waiting, 1)).endswith(b"\n"):
            pass

    rate = best_rate(trip)
    port.close()
    return rate


def round_trips(bench: Bench) -> None:
    """Each device's question that asks for no measurement."""
    devices: dict[str, Any] = bench.devices
    bosch = BoschRangefinder(SerialTransport(bench.simulated.address("bosch"), BoschParser, clock=bench.clock))
    bosch.connect()
    head = devices["head"]
    trips: dict[str, Callable[[], object]] = {
        "grbl": devices["stage"].link.report,
        "zaber": lambda: head._status(head._axes[0]),
        "strig": lambda: devices["shutter"]._synchronise(1),
        "wit": lambda: devices["imu"]._register(3),
        "fast": lambda: devices["fast_imu"]._ask("ID?"),
        "jrt": lambda: devices["rangefinder"]._read(0x000A),
        "bosch": lambda: bosch.laser(True),
        "dmx": lambda: devices["light"]._ask(3, b"\0\0"),
    }
    for name, trip in trips.items():
        rate = best_rate(trip)
        print(f"  {name:8} {rate:8.0f} /s  {rate / BOUND_PER_S:5.2f} of the bar of {BOUND_PER_S:.0f}")
    bosch.close()
    devices["stage"].close()
    bare = bare_rate(bench.simulated.address("stage"), b"?")
    print(f"  (grbl by pyserial alone, without the transport: {bare:.0f} /s)")


def latencies_ms(bench: Bench, name: str, marks: tuple[bytes, ...]) -> list[float]:
    """Milliseconds from the call to the byte at the device, while another thread waits inside a homing."""
    stage: Any = bench.devices[name]
    twin = bench.simulated.devices[name]
    arrived: list[float] = []
    receive = twin.receive

    def listening(data: bytes, now_s: float) -> None:
        if any(mark in data for mark in marks):
            arrived.append(time.perf_counter())
        receive(data, now_s)

    twin.receive = listening
    stage.connect()
    found = []
    for _ in range(STOPS):
        homing = threading.Thread(target=_home, args=(stage,))
        homing.start()
        while not twin_is_homing(twin):
            time.sleep(0.001)
        arrived.clear()
        called = time.perf_counter()
        stage.emergency_stop()
        found.append(1000 * (arrived[0] - called))
        homing.join()
    twin.receive = receive
    return found


def twin_is_homing(twin: Any) -> bool:
    """Whether the simulated controller is on its way."""
    run = getattr(twin, "_run", None)
    if run is not None:
        return bool(run.homing)
    return any(motor.homing for device in twin.devices.values() for motor in device.motors)


def _home(stage: Any) -> None:
    try:
        stage.home()
    except DeviceError:
        return


def idle_share(bench: Bench) -> float:
    """CPU seconds per second of a connected bench that has nothing to do."""
    bench.connect()
    time.sleep(1.0)
    cpu, wall = time.process_time(), time.perf_counter()
    time.sleep(IDLE_S)
    return (time.process_time() - cpu) / (time.perf_counter() - wall)


def main() -> None:
    """Print environment, figures and bars."""
    load = os.getloadavg()[0]
    print(f"{platform.platform()}, Python {platform.python_version()}, {os.cpu_count()} cores, load {load:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        bench = simulated_bench(Path(folder))
        bench.connect()
        print(f"round trips over sim://, best of {RUNS} x {TRIPS}")
        round_trips(bench)
        for name, marks in (("stage", (b"\x18",)), ("head", (b"estop",))):
            times = sorted(latencies_ms(bench, name, marks))
            print(
                f"emergency stop of the {name} inside a homing, {STOPS} tries: median {times[STOPS // 2]:.3f} ms, "
                f"longest {times[-1]:.3f} ms; bar {BOUND_STOP_MS:.0f} ms"
            )
        share = 100 * idle_share(bench)
        print(f"idle CPU of the whole bench over {IDLE_S:.0f} s: {share:.2f} %; bar {100 * BOUND_IDLE:.0f} %")
        bench.close()


if __name__ == "__main__":
    main()
