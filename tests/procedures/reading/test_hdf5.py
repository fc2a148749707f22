"""Files with which the HDF5 library does not terminate are stopped in a separate process."""

import h5py
import numpy as np
import pytest

from procedures.outcome import BadInput
from procedures.reading import hdf5
from procedures.reading.guard import Room
from procedures.reading.hdf5 import Stored, check_ends


@pytest.fixture
def path(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["numbers"] = np.arange(6.0).reshape(2, 3)
        file["texts"] = ["a.dng", "märz.dng"]
        file["wrong"] = np.array([1.0, np.nan])
        file["elsewhere"] = h5py.ExternalLink("/etc/passwd", "x")
    return tmp_path / "a.h5"


@pytest.mark.slow
def test_file_is_gone_through_whatever_is_in_it(path, tmp_path):
    check_ends(path, 10**9)
    (tmp_path / "b.h5").write_bytes(b"no HDF5")
    check_ends(tmp_path / "b.h5", 10**9)


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["while True: pass", "import os; os.abort()"])
def test_library_that_does_not_end_or_breaks_down_is_a_fault_of_the_file(path, monkeypatch, fault):
    monkeypatch.setattr(hdf5, "WALL_TIMEOUT_S", 1)
    monkeypatch.setattr(hdf5, "PROGRAM", hdf5.PROGRAM.replace("import h5py", fault))
    with pytest.raises(ValueError, match=r"does not terminate|crashes"):
        check_ends(path, 10**9)


def test_data_sets_are_numbers_and_texts_within_the_limit(path, monkeypatch):
    with h5py.File(path) as file:
        stored = Stored(file, Room("a.h5"))
        np.testing.assert_array_equal(stored.numbers("numbers"), np.arange(6.0).reshape(2, 3))
        assert stored.texts("texts") == ["a.dng", "märz.dng"]
        with pytest.raises(BadInput, match=r"`wrong` of / in a\.h5 must be finite"):
            stored.numbers("wrong")
        with pytest.raises(BadInput, match=r"must be an array \(any, 2\); got an array \(2, 3\)"):
            stored.numbers("numbers", (None, 2))
        with pytest.raises(ValueError, match="a fixed length"):
            stored.numbers("texts")
        with pytest.raises(KeyError):
            stored.numbers("elsewhere")
        monkeypatch.setenv("STATION_LARGEST_MB", "0.00005")
        with pytest.raises(BadInput, match=r"a\.h5 has `numbers` of shape \(2, 3\)"):
            Stored(file, Room("a.h5")).numbers("numbers")
