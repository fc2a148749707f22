import pytest

from drivers.grbl import GrblStage
from drivers.protocols.grbl import GrblParser
from drivers.transport import SerialTransport

from .axes import AXES


@pytest.fixture
def twin(bench):
    return bench.devices["stage"]


@pytest.fixture
def make(bench):
    made = []

    def make(axes=AXES, **options):
        wire = SerialTransport(bench.address("stage"), GrblParser, clock=bench.clock)
        made.append(GrblStage(wire, axes, clock=bench.clock, **options))
        return made[-1]

    yield make
    for stage in made:
        stage.close()


@pytest.fixture
def homed(make):
    stage = make()
    stage.connect()
    stage.home()
    return stage
