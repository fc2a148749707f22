import pytest

from .wall import Pair, gaussian, photographs

OTF = gaussian(0.42, 0.37)


@pytest.fixture(scope="session")
def pair() -> Pair:
    """A good pair: a rough wall, a little tilt, little noise."""
    return photographs(OTF, tilt=0.04)
