"""Devices without a port: behind other people's software, at the kernel's boundary, or behind a program."""

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from drivers.alpaca.camera import AlpacaCamera, AlpacaCameraSettings
from drivers.alpaca.link import AlpacaAddress
from drivers.alpaca.stage import AlpacaAxis, AlpacaStage
from drivers.alpaca.switch import AlpacaLight, AlpacaShutter, AlpacaSwitch
from drivers.dng import DngFolder
from drivers.frames import ExposureMetadata
from drivers.genicam.camera import GenicamCamera, GenicamSettings
from drivers.micromanager.camera import Core, MicroManagerCamera, MicroManagerShutter
from drivers.micromanager.stage import MicroManagerAxis, MicroManagerStage
from drivers.rpicam import RpicamCamera, RpicamSettings
from drivers.v4l2.camera import V4l2Camera
from tests.drivers.v4l2_twin import FakeCamera

from ..aravis_fake import IGNORED, fake_camera, require_aravis
from ..drivers.rpicam_twin import install_twin

DEMO = """\
Property,Core,Initialize,0
Device,Table,DemoCamera,DXYStage
Device,Cam,DemoCamera,DCam
Device,Door,DemoCamera,DShutter
Property,Core,Initialize,1
Property,Table,Velocity,0.1
Property,Cam,PixelType,16bit
Property,Cam,OnCameraCCDXSize,48
Property,Cam,OnCameraCCDYSize,32
Property,Cam,Exposure,20
"""
TABLE = (MicroManagerAxis("x_mm", "Table", (0.0, 0.3), "x"), MicroManagerAxis("y_mm", "Table", (0.0, 0.3), "y"))
"""At 0.1 mm/s the way from end to end lasts three seconds; the tests stop it after one."""


@dataclass(frozen=True)
class Lab:
    """A kind of device that needs no port, how one is had, and the marks of its tests."""

    kind: str
    make: Callable[[pytest.FixtureRequest, Path], AbstractContextManager[Any]]
    marks: tuple[pytest.MarkDecorator, ...] = (pytest.mark.slow,)


def _frames(folder: Path) -> DngFolder:
    return DngFolder(folder, lambda path: ExposureMetadata(exposure_s=0.02))


@contextmanager
def _left(device: Any) -> Iterator[Any]:
    try:
        yield device
    finally:
        device.close()


def _demo(make: Callable[[Core, Path], Any]) -> Callable[[pytest.FixtureRequest, Path], AbstractContextManager[Any]]:
    def made(request: pytest.FixtureRequest, folder: Path) -> AbstractContextManager[Any]:
        pytest.importorskip("pymmcore", reason="pymmcore is not installed (extra `micromanager`)")
        adapters = pytest.importorskip("mm_test_adapters", reason="Micro-Manager's demo devices are not installed")
        config = folder.with_name(f"{folder.name}.cfg")
        config.write_text(DEMO)
        return _left(make(Core(config, adapters.device_adapter_path()), folder))

    return made


@contextmanager
def _genicam(request: pytest.FixtureRequest, folder: Path) -> Iterator[GenicamCamera]:
    require_aravis()
    with fake_camera() as address, _left(GenicamCamera(_frames(folder), address, GenicamSettings())) as camera:
        yield camera


@contextmanager
def _v4l2(request: pytest.FixtureRequest, folder: Path) -> Iterator[V4l2Camera]:
    with _left(V4l2Camera(_frames(folder), kernel=FakeCamera(period_s=1 / 200))) as camera:
        yield camera


@contextmanager
def _rpicam(request: pytest.FixtureRequest, folder: Path) -> Iterator[RpicamCamera]:
    if sys.platform == "win32":
        pytest.skip("the twin is a shell script")
    program = install_twin(folder.parent)
    with _left(RpicamCamera(_frames(folder), settings=RpicamSettings(exposure_s=0.02), program=str(program))) as camera:
        yield camera


LABS: dict[str, Lab] = {
    "micromanager_stage": Lab("stage", _demo(lambda core, _: MicroManagerStage(core, TABLE, patience_s=20.0))),
    "micromanager_shutter": Lab("shutter", _demo(lambda core, _: MicroManagerShutter(core, "Door"))),
    "micromanager_camera": Lab("camera", _demo(lambda core, folder: MicroManagerCamera(core, "Cam", _frames(folder)))),
    "v4l2_camera": Lab("camera", _v4l2, ()),
    "rpicam_camera": Lab("camera", _rpicam, ()),
    "genicam_camera": Lab("camera", _genicam, (pytest.mark.slow, pytest.mark.filterwarnings(IGNORED))),
}
ALPACA: dict[str, Callable[[str, int, str, Path], Any]] = {
    "alpaca_stage": lambda server, number, home, _: AlpacaStage(
        AlpacaAddress(server), [AlpacaAxis("z_mm", number, home=home)]
    ),
    "alpaca_camera": lambda server, number, _, folder: AlpacaCamera(
        AlpacaAddress(server), number, _frames(folder), AlpacaCameraSettings(exposure_s=0.02)
    ),
    "alpaca_light": lambda server, number, *_: AlpacaLight(AlpacaSwitch(AlpacaAddress(server), 0, number)),
    "alpaca_shutter": lambda server, number, *_: AlpacaShutter(AlpacaSwitch(AlpacaAddress(server), 0, number)),
}
"""Only at a real server: `--driver alpaca_stage --port 192.168.1.20:11111/0/Home`, the focuser and its action."""
