"""Every driver at its twin, or, with `--driver NAME --port URL`, one driver at a real device."""

import ctypes
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import Clock, SystemClock
from drivers.folder_camera import FolderCamera
from drivers.frames import ExposureMetadata
from drivers.gcs import GcsParser, GcsStage
from drivers.gphoto import GphotoCamera
from drivers.grbl import GrblStage
from drivers.imu import FastImu, StrigImu, WitImu
from drivers.light import DmxLight, DmxParser, GrblLight
from drivers.newport import Esp301Stage, NewportParser, Smc100Stage
from drivers.polled_stage import PolledAxis
from drivers.protocols.grbl import GrblParser
from drivers.protocols.grbl_link import GrblLink
from drivers.protocols.imu import FastParser, WitParser
from drivers.protocols.zaber import ZaberParser
from drivers.rangefinder import BoschParser, BoschRangefinder, JrtParser, JrtRangefinder
from drivers.scpi import ProbeChannel, ScpiLight, ScpiParser, ScpiProbe, SupplySettings
from drivers.shaker import ShakerAxis, StrigShaker
from drivers.shutter import NullParser, RelayShutter, RtsShutter, StrigParser, StrigShutter
from drivers.thorlabs import AptParser, AptStage
from drivers.tmcl.link import TmclParser
from drivers.tmcl.stage import TmclAxis, TmclStage
from drivers.transport import SerialTransport, register_scheme
from drivers.zaber import ZaberAxis, ZaberStage
from simulators.bench.bench import Setup, SimulatedBench
from simulators.devices.gcs import GcsTwin
from simulators.devices.grbl import GrblController
from simulators.devices.instruments import ScpiTwin
from simulators.devices.newport import Esp301Twin, Smc100Twin
from simulators.devices.serial_device import Cable, plug, unplug
from simulators.devices.thorlabs import AptTwin
from simulators.devices.tmcl import TmclModule
from simulators.world.clock import VirtualClock

from .box_firmware import BoxFirmware, compiled_box
from .grbl_rigs import GRBL_AXES, REAL, CabledGrbl
from .lab_devices import ALPACA, LABS
from .rig import Rig

ZABER_AXES = [
    ZaberAxis("pan_deg", 1, 0.000234375, zero=-30.0, speed_per_s=10.0),
    ZaberAxis("tilt_deg", 2, 0.000234375, zero=-20.0, speed_per_s=10.0),
]
TMCL_AXES = [TmclAxis("z_mm", 0, (0.0, 300.0), 1 / 320), TmclAxis("x_mm", 1, (0.0, 300.0), 1 / 320)]
"""Belts of 40 mm around, 200 steps of 64 microsteps."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--driver", default=None, help="run the promises of this driver only, e.g. grbl")
    parser.addoption("--port", default=None, help="the real port of that driver, any pyserial URL")
    parser.addoption("--grbl-firmware", default=None, help="GRBL for an ATmega328P (see grbl_transcript.py): elf")
    parser.addoption("--grbl-box", default=None, help="the program of grbl_box.c, which runs it in simavr")
    parser.addoption("--grblhal", default=None, help="grblHAL's simulator (see grblhal_simulator.py): its program")
    parser.addoption("--grbl-settings", default="", help="what either is set to besides, e.g. '$110=500 $21=0'")


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


Wire = Callable[..., SerialTransport[Any]]
sys.path.append(str(HERE.parent / "station" / "bench" / "toy_package"))


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
    return TmclStage(wire("stage", TmclParser, baud=9600), TMCL_AXES, clock=clock, poll_s=0.2)


def _toy(wire: Wire, clock: Clock, bench: SimulatedBench | None, _: Path) -> Any:
    """The stage of a package outside."""
    from toy_stage import ToyParser, ToyStage, ToyTwin

    if bench is not None:
        bench.cables["stage"] = cable = Cable(ToyTwin(bench.world.axes["x_mm"]), bench.clock)
        plug(f"{bench.name}/stage", cable)
    return ToyStage(wire("stage", ToyParser), clock)


def _polled(
    stage: Callable[..., Any], parser: Any, twin: Callable[..., Any], **axis: Any
) -> Callable[..., Any]:  # fmt: skip
    """One axis of a polled stage, in the place of the bench's own."""

    def make(wire: Wire, clock: Clock, bench: SimulatedBench | None, _: Path) -> Any:
        if bench is not None:
            bench.cables["stage"] = cable = Cable(twin({"x_mm": bench.world.axes["x_mm"]}), bench.clock)
            plug(f"{bench.name}/stage", cable)
        return stage(wire("stage", parser, baud=twin.baud), [PolledAxis("x_mm", **axis)], clock=clock)

    return make


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
    return FolderCamera(folder, shutter, lambda path: ExposureMetadata(exposure_s=0.02), clock=clock)


def _shaker(wire: Wire, clock: Clock, bench: SimulatedBench | None, _: Path) -> StrigShaker:
    """On the shutter's box; at the simulated bench nothing else moves the camera."""
    if bench is not None:
        bench.world.room = replace(bench.world.room, modes=())
    box = StrigShutter(wire("shutter", StrigParser), clock=clock)
    box.connect()
    return StrigShaker(box, [ShakerAxis("x_mm", 0, 2.0), ShakerAxis("y_mm", 1, 2.0)], clock=clock)


def _box_imu(wire: Wire, clock: Clock, bench: SimulatedBench | None, _: Path) -> StrigImu:
    """On the shutter's box."""
    box = StrigShutter(wire("shutter", StrigParser), clock=clock)
    box.connect()
    return StrigImu(box, clock=clock)


def _gphoto_camera(wire: Wire, clock: Clock, bench: SimulatedBench | None, folder: Path) -> GphotoCamera:
    """The folder of the simulated body, seen through libgphoto2's own camera that browses folders."""
    pytest.importorskip("gphoto2", reason="gphoto2 is not installed (extra `tether`)")
    saved = folder.with_name(folder.name + "-saved")
    saved.mkdir()
    shutter = StrigShutter(wire("shutter", StrigParser), clock=clock)
    shutter.connect()
    model, port = "Directory Browse", f"disk:{folder}"
    return GphotoCamera(
        saved, lambda path: ExposureMetadata(exposure_s=0.02), model=model, port=port, shutter=shutter, clock=clock
    )


STAGES: dict[str, Callable[..., Any]] = {
    "grbl": _stage,
    "grblHAL": _variant("grblHAL"),
    "FluidNC": _variant("FluidNC"),
    "zaber": lambda wire, clock, *_: ZaberStage(wire("head", ZaberParser), ZABER_AXES, clock=clock),
    "tmcl": _tmcl,
    "esp301": _polled(Esp301Stage, NewportParser, Esp301Twin),
    "smc100": _polled(Smc100Stage, NewportParser, Smc100Twin),
    "apt": _polled(AptStage, AptParser, AptTwin, scale=1 / 34304, travel=(0.0, 300.0)),
    "gcs": _polled(GcsStage, GcsParser, GcsTwin, number="1"),
    "toy-stage": _toy,
}
GRBLS = {name: STAGES[name] for name in ("grbl", "grblHAL", "FluidNC")}
SHUTTERS: dict[str, Callable[..., Any]] = {
    "strig": lambda wire, clock, *_: StrigShutter(wire("shutter", StrigParser), clock=clock),
    "strig_simavr": lambda wire, clock, *_: StrigShutter(wire("shutter", StrigParser), clock=clock),
    "strig_host": lambda wire, clock, *_: StrigShutter(wire("shutter", StrigParser), clock=clock),
    "rts": lambda wire, clock, *_: RtsShutter(wire("rts", NullParser, rts=False), clock=clock),
    "relay": lambda wire, clock, *_: RelayShutter(GrblLink(wire("stage", GrblParser)), clock=clock),
}
IMUS: dict[str, Callable[..., Any]] = {
    "strig_imu": _box_imu,
    "strig_imu_host": _box_imu,
    "wit": lambda wire, clock, *_: WitImu(wire("imu", WitParser), clock=clock),
    "fast": lambda wire, clock, *_: FastImu(wire("fast_imu", FastParser), clock=clock),
}
RANGEFINDERS: dict[str, Callable[..., Any]] = {
    "jrt": lambda wire, clock, *_: JrtRangefinder(wire("rangefinder", JrtParser, baud=19200), clock=clock),
    "bosch": lambda wire, clock, *_: BoschRangefinder(wire("bosch", BoschParser), clock=clock),
}


def _instrument(make: Callable[..., Any]) -> Callable[..., Any]:
    """A SCPI instrument on the bench."""

    def made(wire: Wire, clock: Clock, bench: SimulatedBench | None, _: Path) -> Any:
        if bench is not None:
            bench.cables["instrument"] = cable = Cable(ScpiTwin(bench.world), bench.clock)
            plug(f"{bench.name}/instrument", cable)
        return make(wire("instrument", ScpiParser, baud=9600), clock)

    return made


LIGHTS: dict[str, Callable[..., Any]] = {
    "scpi_light": _instrument(lambda line, clock: ScpiLight(line, SupplySettings(full=2.0), clock=clock)),
    "dmx": lambda wire, clock, *_: DmxLight(wire("light", DmxParser), clock=clock),
    "grbl_light": lambda wire, clock, *_: GrblLight(GrblLink(wire("stage", GrblParser)), clock=clock),
}
PROBES = {"scpi_probe": _instrument(lambda line, _: ScpiProbe(line, (ProbeChannel("temperature", "MEAS:TEMP?", 0.2),)))}
CAMERAS: dict[str, Callable[..., Any]] = {"folder_camera": _folder_camera, "gphoto_camera": _gphoto_camera}
SHAKERS: dict[str, Callable[..., Any]] = {"strig_shaker": _shaker, "strig_shaker_host": _shaker}
KINDS = {
    "stage": STAGES,
    "shutter": SHUTTERS,
    "imu": IMUS,
    "rangefinder": RANGEFINDERS,
    "light": LIGHTS,
    "camera": CAMERAS,
    "probe": PROBES,
}
ALONE = {name: maker for kind in KINDS.values() for name, maker in kind.items() if not name.startswith("strig_imu")}
"""All that have a line of their own; a shaker, or an inertial unit on a box, has its shutter's."""
MAKERS = {**ALONE, **IMUS, **SHAKERS}


def _frame(opening: object) -> bytes:
    return b"RAW" * 1000 + repr(opening).encode()


def _names(kind: str, makers: Mapping[str, Any], config: pytest.Config) -> list[Any]:
    """Which devices play a kind: all, or the one that was asked for."""
    chosen = config.getoption("--driver", default=None)
    real = [name for name in REAL if config.getoption(f"--{name}", default=None)]
    if real and kind in ("stage", "grbl"):
        return real
    there = {**makers, **{name: one for name, one in LABS.items() if kind in ("device", one.kind)}}
    if chosen in ALPACA and kind in ("device", chosen.partition("_")[2]):
        return [chosen]
    names = [name for name in there if chosen in (None, name)]
    return [pytest.param(name, marks=LABS[name].marks) if name in LABS else name for name in names]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    for kind, makers in (*KINDS.items(), ("grbl", GRBLS), ("shaker", SHAKERS), ("device", ALONE)):
        if f"{kind}_rig" in metafunc.fixturenames:
            metafunc.parametrize(f"{kind}_rig", _names(kind, makers, metafunc.config), indirect=True)


@pytest.fixture(scope="session")
def strig_library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The box's firmware, compiled for this machine."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc not found")
    return compiled_box(tmp_path_factory.mktemp("strig") / "strig.so")


def _host_rig(request: pytest.FixtureRequest, folder: Path) -> Iterator[Rig]:
    """The box's firmware at the end of a cable."""
    box, clock = BoxFirmware(request.getfixturevalue("strig_library")), VirtualClock()
    register_scheme("simulators.devices")
    plug("firmware/shutter", Cable(box, clock))
    wire = SerialTransport("sim://firmware/shutter", StrigParser, clock=clock)
    try:
        yield Rig(MAKERS[request.param](lambda name, parser: wire, clock, None, folder), clock, None, box.carried)
    finally:
        wire.close()
        unplug("firmware/shutter")


def _make_rig(request: pytest.FixtureRequest, folder: Path) -> Iterator[Rig]:
    port = request.config.getoption("--port", default=None)
    if request.param in REAL:
        yield from REAL[request.param](request.config.getoption, folder)
        return
    if request.param in ALPACA:
        address, number, home = (*str(port).split("/"), "0", "")[:3]
        device = ALPACA[request.param](address, int(number), home, folder)
        yield Rig(device, SystemClock(), None, pulse_error_s=0.3)
        device.close()
        return
    if request.param in LABS:
        with LABS[request.param].make(request, folder) as device:
            yield Rig(device, SystemClock(), None, places=(0.2, 0.1, 0.0))
        return
    if request.param.endswith("_host") and port is None:
        yield from _host_rig(request, folder)
        return
    if request.param == "strig_simavr" and port is None:
        port = request.getfixturevalue("simavr_port")
    maker = MAKERS[request.param]
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

    def carried() -> tuple[float, float]:
        sway = bench.world.sway(np.atleast_1d(bench.clock.now_s()))
        return float(sway["x_mm"][0][0]), float(sway["y_mm"][0][0])

    rig = Rig(maker(wire, clock, bench, folder), clock, bench, carried)
    if request.param in GRBLS:
        axes = bench.world.axes.values()
        rig.machine = CabledGrbl(bench.cables["stage"], lambda now_s: tuple(axis.position(now_s) for axis in axes))
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
grbl_rig = _fixture("grbl")
shutter_rig = _fixture("shutter")
imu_rig = _fixture("imu")
rangefinder_rig = _fixture("rangefinder")
light_rig = _fixture("light")
probe_rig = _fixture("probe")
camera_rig = _fixture("camera")
shaker_rig = _fixture("shaker")
device_rig = _fixture("device")
