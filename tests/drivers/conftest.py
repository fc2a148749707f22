import json

import exifread
import pytest

from drivers.shutter import StrigParser, StrigShutter
from drivers.transport import SerialTransport
from simulators.bench.bench import Setup, SimulatedBench


def frame(opening) -> bytes:
    return b"RAW" * 1000 + repr(opening).encode() + b"END"


def comment_of(path):
    """The notes of a driver in a DNG, besides the tags."""
    with path.open("rb") as file:
        noted = exifread.process_file(file, details=True)["EXIF UserComment"].values
    return json.loads(noted if isinstance(noted, str) else bytes(noted).removeprefix(b"ASCII\0\0\0"))


@pytest.fixture
def bench(tmp_path):
    """A simulated bench in virtual time whose body writes small files that end in END."""
    folder = tmp_path / "incoming"
    folder.mkdir()
    bench = SimulatedBench(folder, Setup(develop=frame, virtual_time=True))
    yield bench
    bench.close()


@pytest.fixture
def wired(bench):
    """wired(driver, parser, name, ...): a driver at this line of the bench; all are closed in the end."""
    made = []

    def make(driver, parser, name, *words, line=None, **options):
        wire = SerialTransport(bench.address(name), parser, clock=bench.clock, **(line or {}))
        made.append(driver(wire, *words, clock=bench.clock, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def box(wired):
    """The shutter's box, connected."""
    box = wired(StrigShutter, StrigParser, "shutter")
    box.connect()
    return box
