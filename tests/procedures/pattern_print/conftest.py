import numpy as np
import pytest

from procedures.pattern import CELLS, Chart
from procedures.pattern_print.source import Source


@pytest.fixture(scope="session")
def source() -> Source:
    return Source.from_seed(20120323)


@pytest.fixture(scope="session")
def plain() -> Source:
    """Cells all white: for what does not depend on them."""
    return Source(Chart(np.ones((CELLS, CELLS), np.uint8)), "from image, SHA-256 " + 64 * "0")
