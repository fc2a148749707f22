import pytest

from drivers.grbl import GrblStage
from drivers.protocols.grbl import GrblParser

from .axes import AXES


@pytest.fixture
def twin(bench):
    return bench.devices["stage"]


@pytest.fixture
def make(wired):
    return lambda axes=AXES, **options: wired(GrblStage, GrblParser, "stage", axes, **options)


@pytest.fixture
def homed(make):
    stage = make()
    stage.connect()
    stage.home()
    return stage
