"""Aravis where it is installed, and its fake GigE Vision camera: another process, over the loopback network."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

DISTRIBUTION = "/usr/lib/python3/dist-packages"
"""Where Debian keeps PyGObject: a virtual environment does not see it by itself."""
IGNORED = "ignore:DynamicImporter:ImportWarning"
"""Of PyGObject 3.42 with Python 3.11, which is silent about it outside of tests."""
ADDRESS = "127.0.0.1"
FAKE = """
import sys
sys.path.append({distribution!r})
import gi
gi.require_version("Aravis", "0.8")
from gi.repository import Aravis
camera = Aravis.GvFakeCamera.new({address!r}, None)
print(camera.is_running(), flush=True)
sys.stdin.read()
"""
"""What arv-fake-gv-camera-0.8 does: the same camera out of the same library."""


def require_aravis(*, module: bool = False) -> None:
    """Skip where it is not installed; `module` in the middle of a module of tests."""
    sys.path.append(DISTRIBUTION)
    try:
        gi = pytest.importorskip("gi", reason="PyGObject is not installed (extra `genicam`)", exc_type=ImportError)
    finally:
        sys.path.remove(DISTRIBUTION)
    try:
        gi.require_version("Aravis", "0.8")
    except ValueError:
        pytest.skip("Aravis 0.8 is not installed (Debian: gir1.2-aravis-0.8)", allow_module_level=module)


@contextmanager
def fake_camera() -> Iterator[str]:
    """Its address, while it runs: one at a time on this machine, as all of them would answer at one port."""
    import fcntl  # here: conformance imports this module on every system, Aravis or not

    with Path(tempfile.gettempdir(), "aravis-fake.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield from _running()


def _running() -> Iterator[str]:
    command = [sys.executable, "-c", FAKE.format(distribution=DISTRIBUTION, address=ADDRESS)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "True\n"
    try:
        yield ADDRESS
    finally:
        process.communicate("", timeout=10)
