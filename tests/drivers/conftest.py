import pytest

from simulators.bench.bench import Setup, SimulatedBench


def frame(opening) -> bytes:
    return b"RAW" * 1000 + repr(opening).encode() + b"END"


@pytest.fixture
def bench(tmp_path):
    """A simulated bench in virtual time whose body writes small files that end in END."""
    folder = tmp_path / "incoming"
    folder.mkdir()
    bench = SimulatedBench(folder, Setup(develop=frame, virtual_time=True))
    yield bench
    bench.close()
