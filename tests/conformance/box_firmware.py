"""The shutter box's firmware, compiled for this machine, at the end of a cable in the time of the tests."""

import ctypes
import subprocess
from pathlib import Path

HERE = Path(__file__).parent
SKETCH = HERE.parent.parent / "drivers" / "firmware" / "strig"
STEP_S = 0.005
"""How often it is looked what it says by itself."""
REST, DEEPEST = 2048, 2047
GRAVITY = 4096
"""In digits of 8 g."""


def compiled_box(place: Path) -> ctypes.CDLL:
    """Its protocol beside strig_host.c, which keeps what it says and puts out."""
    command = ["gcc", "-shared", "-fPIC", "-O1", "-Wall", "-Wextra", "-Werror", f"-I{SKETCH}", SKETCH / "strig.c"]
    subprocess.run([*map(str, command), str(HERE / "strig_host.c"), "-o", str(place)], check=True)
    found = ctypes.CDLL(str(place))
    found.host_said.restype = ctypes.c_char_p
    found.host_run.argtypes = [ctypes.c_uint64]
    return found


class BoxFirmware:
    """A box with a shaker of 2 mm; there is one at a time, as the firmware has one state."""

    baud = 115200

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library, self._ran_s, self._said = library, 0.0, b""
        self._channels = (REST, REST)
        library.host_begin(True)
        library.host_imu((ctypes.c_int16 * 6)(0, GRAVITY, 0, 0, 0, 0))

    def set_lines(self, rts: bool, dtr: bool, now_s: float) -> None:
        """A board that is not wired to be reset by DTR."""

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes from the host."""
        self._run(now_s)
        self._library.host_hear(data)
        self._collect()

    def advance(self, now_s: float) -> bytes:
        """Run until now; what it said."""
        self._run(now_s)
        said, self._said = self._said, b""
        return said

    def next_event_s(self) -> float | None:
        """Nobody knows."""
        return self._ran_s + STEP_S

    def carried(self) -> tuple[float, float]:
        """Where the channels have the camera."""
        x, y = (2.0 * (channel - REST) / DEEPEST for channel in self._channels)
        return x, y

    def _run(self, until_s: float) -> None:
        self._library.host_run(round(until_s * 1e6))
        self._ran_s = until_s
        self._collect()

    def _collect(self) -> None:
        for line in self._library.host_said().splitlines(keepends=True):
            if line.startswith(b"* shaker"):
                x, y = map(int, line.split()[2:])
                self._channels = x, y
            elif not line.startswith(b"*"):
                self._said += line
        self._library.host_forget()
