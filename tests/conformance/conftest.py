"""Every driver at its twin, or, with `--driver NAME --port URL`, one driver at a real device."""

from __future__ import annotations

import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from drivers.alpaca.camera import AlpacaCamera, AlpacaCameraSettings
from drivers.alpaca.link import AlpacaServer
from drivers.alpaca.stage import AlpacaAxis, AlpacaStage
from drivers.alpaca.switch import AlpacaLight, AlpacaShutter, AlpacaSwitch
from drivers.clock import Clock, SystemClock
from drivers.folder_camera import FolderCamera
from drivers.frame_files.dng_folder import DngFolder
from drivers.frames import Facts
from drivers.gphoto import GphotoCamera
from drivers.grbl import GrblStage
from drivers.grbl_envelope import GrblAxis
from drivers.imu import FastImu, WitImu
from drivers.light import DmxLight, DmxParser, GrblLight
from drivers.protocols.grbl import GrblParser
from drivers.protocols.grbl_link import GrblLink
from drivers.protocols.imu import FastParser, WitParser
from drivers.protocols.tmcl import TmclParser
from drivers.protocols.zaber import ZaberParser
from drivers.rangefinder import BoschParser, BoschRangefinder, JrtParser, JrtRangefinder
from drivers.shutter import DeafParser, RelayShutter, RtsShutter, StrigParser, StrigShutter
from drivers.tmcl.stage import TmclAxis, TmclStage
from drivers.transport import SerialTransport, register_scheme
from drivers.zaber import ZaberAxis, ZaberStage
from simulators.bench.bench import Setup, SimulatedBench
from simulators.devices.grbl import GrblController
from simulators.devices.serial_device import Cable, plug, unplug
from simulators.devices.tmcl import TmclModule
from simulators.world.clock import VirtualClock

GRBL_AXES = [GrblAxis("z_mm", "X", 3000.0, travel=1500.0), GrblAxis("x_mm", "Y", 1500.0, travel=300.0)]
ZABER_AXES = [
    ZaberAxis("pan_deg", 1, 0.000234375, zero=-30.0, speed_per_s=10.0),
    ZaberAxis("tilt_deg", 2, 0.000234375, zero=-20.0, speed_per_s=10.0),
]
TMCL_AXES = [
    TmclAxis("z_mm", 0, (0.0, 300.0), 1 / 320),
    TmclAxis("x_mm", 1, (0.0, 300.0), 1 / 320),
]
"""Belts of 40 mm around, 200 steps of 64 microsteps."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--driver", default=None, help="run the promises of this driver only, e.g. grbl")
    parser.addoption("--port", default=None, help="the real port of that driver, any pyserial URL")
    parser.addoption("--grbl-firmware", default=None, help="GRBL for an ATmega328P (see grbl_transcript.py): elf")
    parser.addoption("--grbl-box", default=None, help="the program of grbl_box.c, which runs it in simavr")


@dataclass
class Rig:
    """A device under test, its clock, and the simulated bench behind it (None at a real port)."""

    device: Any
    clock: Any
    bench: SimulatedBench | None

    def together(self, *works: Callable[[], object]) -> list[object]:
        """Do these at the same time; outcomes."""
        if isinstance(self.clock, VirtualClock):
            return self.clock.together(*works)
        outcomes: list[object] = [None] * len(works)

        def run(i: int) -> None:
            try:
                outcomes[i] = works[i]()
            except Exception as error:
                outcomes[i] = error

        threads = [threading.Thread(target=run, args=(i,)) for i in range(len(works))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return outcomes


HERE = Path(__file__).parent
FIRMWARE = HERE.parent.parent / "drivers" / "firmware"


def _compile(*command: str | Path) -> None:
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"{command[0]} does not build here: {done.stderr[-300:]}")


@pytest.fixture(scope="session")
def simavr_box(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The program that runs firmware in simavr, and our firmware."""
    missing = [tool for tool in ("avr-gcc", "simavr", "gcc") if shutil.which(tool) is None]
    if missing:
        pytest.skip(
            f"{', '.join(missing)} not found: install gcc-avr, avr-libc, simavr, libsimavr-dev, libelf-dev, gcc"
        )
    folder = tmp_path_factory.mktemp("firmware")
    elf, box, sketch = folder / "strig.elf", folder / "box", FIRMWARE / "strig"
    warn = ["-Os", "-Wall", "-Wextra", "-Werror"]
    source = [FIRMWARE / "avr" / "main.c", sketch / "strig.c"]
    done = subprocess.run(
        ["avr-gcc", "-mmcu=atmega328p", *warn, f"-I{sketch}", *source, "-o", elf],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    libraries = ["-lsimavrparts", "-lsimavr", "-lelf", "-lpthread", "-lutil"]
    _compile("gcc", "-O2", "-I/usr/include/simavr", HERE / "simavr_box.c", "-o", box, *libraries)
    return box, elf


@pytest.fixture
def simavr_port(simavr_box: tuple[Path, Path]) -> Iterator[str]:
    """The pseudo-terminal of a freshly started box."""
    process = subprocess.Popen(list(map(str, simavr_box)), stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with process.stdout as said:
        yield next(line.strip() for line in said if line.startswith("/dev/"))
        process.kill()
        process.wait()


class FirmwareInSimavr:
    """A real GRBL at the end of a cable, in the time of the tests: its processor runs as far as their clock."""

    baud = 115200
    STEP_S = 0.02
    SETTINGS = (
        *(f"${110 + i}=1000" for i in range(3)), *(f"${120 + i}=100" for i in range(3)),
        *(f"${130 + i}=40" for i in range(3)), "$25=1000", "$24=300", "$26=20", "$22=1", "$20=1", "$21=1", "$1=255",
    )  # fmt: skip
    """A small quick machine with hard limits; its switches are 10 mm from where it begins."""

    def __init__(self, firmware: str, box: str) -> None:
        command = [box, firmware, str(10 * 250), "lockstep"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._ran_s, self._said = 0.0, bytearray()
        self._run("", 3.0)
        for line in self.SETTINGS:
            self._run(f"send {(line + chr(10)).encode().hex()}", 0.3)
        self._ran_s, self._said = 0.0, bytearray()

    def _run(self, order: str, duration_s: float) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{order}\nrun {1000 * duration_s}\n")
        self._process.stdin.flush()
        told = next(line for line in self._process.stdout if line.startswith("said "))
        self._said += bytes.fromhex(told.split(" ")[1])
        self._ran_s += duration_s + (len(order) - 5) // 2 * 10 / 115200 * bool(order)

    def set_lines(self, rts: bool, dtr: bool, now_s: float) -> None:
        """A board that is not wired to be reset by DTR."""

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes at their speed."""
        self._catch_up(now_s)
        self._run(f"send {data.hex()}", 0.0)

    def _catch_up(self, now_s: float) -> None:
        if now_s > self._ran_s:
            self._run("", now_s - self._ran_s)

    def advance(self, now_s: float) -> bytes:
        """Run until now; what it said."""
        self._catch_up(now_s)
        said, self._said = bytes(self._said), bytearray()
        return said

    def next_event_s(self) -> float | None:
        """Nobody knows: look every few milliseconds."""
        return self._ran_s + self.STEP_S

    def end(self) -> None:
        """Switch it off."""
        self._process.kill()
        self._process.communicate()


Wire = Callable[..., SerialTransport[Any]]


def _stage(wire: Wire, clock: Clock, bench: SimulatedBench | None, _: Path) -> GrblStage:
    return GrblStage(wire("stage", GrblParser), GRBL_AXES, clock=clock)


def _tmcl(wire: Wire, clock: Clock, bench: SimulatedBench | None, _: Path) -> TmclStage:
    """In the place of the bench's own stage."""
    pytest.importorskip("pytrinamic", reason="pytrinamic is not installed (extra `tmcl`)")
    if bench is not None:
        motors = [(bench.world.axes[axis.name], axis.unit_per_step) for axis in TMCL_AXES]
        cable = Cable(TmclModule(motors), bench.clock)
        bench.cables["stage"] = cable
        plug(f"{bench.name}/stage", cable)
    return TmclStage(wire("stage", TmclParser, baud=9600), TMCL_AXES, clock=clock)


def _variant(variant: str) -> Callable[..., GrblStage]:
    def make(wire: Wire, clock: Clock, bench: SimulatedBench | None, folder: Path) -> GrblStage:
        if bench is not None:
            axes = {"X": bench.world.axes["z_mm"], "Y": bench.world.axes["x_mm"]}
            cable = Cable(GrblController(axes, variant=variant), bench.clock)
            bench.cables["stage"] = cable
            plug(f"{bench.name}/stage", cable)
        return _stage(wire, clock, bench, folder)

    return make


def _folder_camera(wire: Wire, clock: Clock, bench: SimulatedBench | None, folder: Path) -> FolderCamera:
    shutter = StrigShutter(wire("shutter", StrigParser), clock=clock)
    shutter.connect()
    return FolderCamera(folder, shutter, lambda path: Facts(exposure_s=0.02), clock=clock)


def _gphoto_camera(wire: Wire, clock: Clock, bench: SimulatedBench | None, folder: Path) -> GphotoCamera:
    """The folder of the simulated body, seen through libgphoto2's own camera that browses folders."""
    pytest.importorskip("gphoto2", reason="gphoto2 is not installed (extra `tether`)")
    saved = folder.with_name(folder.name + "-saved")
    saved.mkdir()
    shutter = StrigShutter(wire("shutter", StrigParser), clock=clock)
    shutter.connect()
    model, port = "Directory Browse", f"disk:{folder}"
    return GphotoCamera(
        saved, lambda path: Facts(exposure_s=0.02), model=model, port=port, shutter=shutter, clock=clock
    )


STAGES: dict[str, Callable[..., Any]] = {
    "grbl": _stage,
    "grblHAL": _variant("grblHAL"),
    "FluidNC": _variant("FluidNC"),
    "zaber": lambda wire, clock, *_: ZaberStage(wire("head", ZaberParser), ZABER_AXES, clock=clock),
    "tmcl": _tmcl,
}
SHUTTERS: dict[str, Callable[..., Any]] = {
    "strig": lambda wire, clock, *_: StrigShutter(wire("shutter", StrigParser), clock=clock),
    "strig_simavr": lambda wire, clock, *_: StrigShutter(wire("shutter", StrigParser), clock=clock),
    "rts": lambda wire, clock, *_: RtsShutter(wire("rts", DeafParser, rts=False), clock=clock),
    "relay": lambda wire, clock, *_: RelayShutter(GrblLink(wire("stage", GrblParser)), clock=clock),
}
IMUS: dict[str, Callable[..., Any]] = {
    "wit": lambda wire, clock, *_: WitImu(wire("imu", WitParser), clock=clock),
    "fast": lambda wire, clock, *_: FastImu(wire("fast_imu", FastParser), clock=clock),
}
RANGEFINDERS: dict[str, Callable[..., Any]] = {
    "jrt": lambda wire, clock, *_: JrtRangefinder(wire("rangefinder", JrtParser, baud=19200), clock=clock),
    "bosch": lambda wire, clock, *_: BoschRangefinder(wire("bosch", BoschParser), clock=clock),
}
LIGHTS: dict[str, Callable[..., Any]] = {
    "dmx": lambda wire, clock, *_: DmxLight(wire("light", DmxParser), clock=clock),
    "grbl_light": lambda wire, clock, *_: GrblLight(GrblLink(wire("stage", GrblParser)), clock=clock),
}
CAMERAS: dict[str, Callable[..., Any]] = {"folder_camera": _folder_camera, "gphoto_camera": _gphoto_camera}
ALPACA: dict[str, Callable[[AlpacaServer, int, str, Path], Any]] = {
    "alpaca_stage": lambda server, number, home, _: AlpacaStage(server, [AlpacaAxis("z_mm", number, home=home)]),
    "alpaca_camera": lambda server, number, _, folder: AlpacaCamera(
        server, number, DngFolder(folder, lambda path: Facts(exposure_s=0.02)), AlpacaCameraSettings(exposure_s=0.02)
    ),
    "alpaca_light": lambda server, number, *_: AlpacaLight(AlpacaSwitch(server, 0, number)),
    "alpaca_shutter": lambda server, number, *_: AlpacaShutter(AlpacaSwitch(server, 0, number)),
}
"""Only at a real server: `--driver alpaca_stage --port 192.168.1.20:11111/0/Home`, the focuser and its action."""
KINDS = {
    "stage": STAGES,
    "shutter": SHUTTERS,
    "imu": IMUS,
    "rangefinder": RANGEFINDERS,
    "light": LIGHTS,
    "camera": CAMERAS,
}


def _frame(opening: object) -> bytes:
    return b"RAW" * 1000 + repr(opening).encode()


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    for kind, makers in (*KINDS.items(), ("device", {k: v for one in KINDS.values() for k, v in one.items()})):
        if f"{kind}_rig" in metafunc.fixturenames:
            chosen = metafunc.config.getoption("--driver", default=None)
            names = [name for name in makers if chosen in (None, name)]
            if chosen in ALPACA and kind in ("device", chosen.partition("_")[2]):
                names = [chosen]
            if kind == "stage" and metafunc.config.getoption("--grbl-firmware", default=None):
                names = ["grbl_firmware"]
            metafunc.parametrize(f"{kind}_rig", names, indirect=True)


def _firmware_rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    options = request.config.getoption
    firmware, clock = FirmwareInSimavr(options("--grbl-firmware"), options("--grbl-box")), VirtualClock()
    register_scheme("simulators")
    plug("firmware/stage", Cable(firmware, clock))
    wire = SerialTransport("sim://firmware/stage", GrblParser, clock=clock)
    stage = GrblStage(wire, GRBL_AXES, clock=clock)
    try:
        yield Rig(stage, clock, None)
    finally:
        stage.close()
        unplug("firmware/stage")
        firmware.end()


def _make_rig(request: pytest.FixtureRequest, folder: Path) -> Iterator[Rig]:
    port = request.config.getoption("--port", default=None)
    if request.param == "grbl_firmware":
        yield from _firmware_rig(request)
        return
    if request.param in ALPACA:
        address, number, home = (*str(port).split("/"), "0", "")[:3]
        device = ALPACA[request.param](AlpacaServer(address), int(number), home, folder)
        yield Rig(device, SystemClock(), None)
        device.close()
        return
    if request.param == "strig_simavr" and port is None:
        port = request.getfixturevalue("simavr_port")
    maker = {k: v for one in KINDS.values() for k, v in one.items()}[request.param]
    if port is not None:
        clock: Any = SystemClock()
        device = maker(
            lambda _, parser, **kwargs: SerialTransport(port, parser, clock=clock, **kwargs), clock, None, folder
        )
        try:
            yield Rig(device, clock, None)
        finally:
            device.close()
        return
    bench = SimulatedBench(folder, Setup(develop=_frame, virtual_time=True))
    clock = bench.clock
    opened: list[SerialTransport[Any]] = []

    def wire(name: str, parser: Any, **kwargs: Any) -> SerialTransport[Any]:
        opened.append(SerialTransport(bench.address(name), parser, clock=clock, **kwargs))
        return opened[-1]

    rig = Rig(maker(wire, clock, bench, folder), clock, bench)
    yield rig
    rig.device.close()
    for transport in opened:
        transport.close()
    bench.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("reader")]


def _fixture(kind: str) -> Any:
    @pytest.fixture(name=f"{kind}_rig")
    def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
        yield from _make_rig(request, tmp_path)

    return rig


stage_rig = _fixture("stage")
shutter_rig = _fixture("shutter")
imu_rig = _fixture("imu")
rangefinder_rig = _fixture("rangefinder")
light_rig = _fixture("light")
camera_rig = _fixture("camera")
device_rig = _fixture("device")
