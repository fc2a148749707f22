"""NumPy's files: wanted arrays are read, others skipped, and damaged archives raise BadInput."""

import io
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from procedures.outcome import BadInput
from procedures.reading.arrays import checked_array, checked_number, read_npy, read_npz

NUMBERS = st.sampled_from(["<f4", ">f8", "<i2", "|u1", "|b1"])


def npy(array):
    data = io.BytesIO()
    np.save(data, array, allow_pickle=False)
    return data.getvalue()


@pytest.mark.slow
@given(NUMBERS.flatmap(lambda kind: hnp.arrays(kind, hnp.array_shapes(min_dims=0, min_side=0))), st.booleans())
def test_array_comes_back_as_it_was_written(tmp_path_factory, array, by_columns):
    path = tmp_path_factory.mktemp("npy") / "a.npy"
    path.write_bytes(npy(np.asfortranarray(array) if by_columns else array))
    found = read_npy(path)
    assert found.dtype == array.dtype
    np.testing.assert_array_equal(found, array)


def test_what_is_not_asked_for_is_not_read(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, wanted=np.arange(3), other=np.zeros(5))
    data = path.read_bytes()
    path.write_bytes(data.replace(npy(np.zeros(5)), bytes(len(npy(np.zeros(5))))))
    found, names = read_npz(path, ("wanted", "absent"))
    assert (list(found), names) == (["wanted"], ["other", "wanted"])
    np.testing.assert_array_equal(found["wanted"], np.arange(3))
    with pytest.raises(BadInput, match=r"a\.npz cannot be read as an npz archive"):
        read_npz(path, ("other",))


@pytest.mark.parametrize("kind", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_compression_that_numpy_does_not_write_is_refused(tmp_path, kind):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", kind) as archive:
        archive.writestr("a.npy", npy(np.arange(3)))
    with pytest.raises(BadInput, match="must be stored or deflated"):
        read_npz(tmp_path / "a.npz", ("a",))


@pytest.mark.parametrize(("at", "value"), [(6, 1), (8, 99)])
def test_encrypted_members_and_unknown_methods_are_refused(tmp_path, at, value):
    path = tmp_path / "a.npz"
    np.savez(path, a=np.arange(3))
    data = bytearray(path.read_bytes())
    for head, first in ((b"PK\3\4", at), (b"PK\1\2", at + 2)):  # local header, and the directory's
        data[data.index(head) + first] = value
    path.write_bytes(data)
    with pytest.raises(BadInput, match=r"a\.npz cannot be read as an npz archive"):
        read_npz(path, ("a",))


def test_objects_and_records_are_no_numbers(tmp_path):
    for array in (np.array([None], dtype=object), np.zeros(2, [("x", "f8")]), np.zeros(2, "V0")):
        data = io.BytesIO()
        np.save(data, array, allow_pickle=True)
        (tmp_path / "a.npy").write_bytes(data.getvalue())
        with pytest.raises(BadInput, match="must contain plain numbers"):
            read_npy(tmp_path / "a.npy")


def test_header_that_announces_more_or_less_than_is_there_is_refused(tmp_path):
    whole = npy(np.arange(10.0))
    for data in (whole[:-8], whole + bytes(8), whole[:20], b""):
        (tmp_path / "a.npy").write_bytes(data)
        with pytest.raises(BadInput, match="cannot be read as an array of numbers"):
            read_npy(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.ones(3), r"x must be an array \(k, k, 2\); got an array \(3\); drop it"),
        (np.ones((3, 4, 2)), r"got an array \(3, 4, 2\)"),
        (np.ones((0, 0, 2)), r"got an array \(0, 0, 2\)"),
        (2.0, "got one number"),
        ([[1, 2], [3]], r"x must be rows of equal length; got \[\[1, 2\], \[3\]\]"),
        ([[["1", "2"]]], "x must be real numbers"),
        ([[[True, False]]], "x must be real numbers"),
        ([[[1, None]]], "x must be real numbers"),
        ([[[1, 10**400]]], "x must be real numbers"),
        ({"a": 1}, "x must be real numbers"),
        (np.ones((1, 1, 2)) * 1j, "x must be real numbers"),
        ([[[1, np.nan]]], "x must be finite, from -1 to 2; got NaN"),
        ([[[-1, np.inf]]], "got -1 to inf"),
        ([[[-1.1, 0]]], "got -1.1 to 0"),
        ([[[1, 2.1]]], "got 1 to 2.1"),
    ],
    ids=str,
)
def test_what_is_no_such_array_is_refused(value, words):
    with pytest.raises(BadInput, match=words):
        checked_array(value, "x", ("k", "k", 2), low=-1, high=2, remedy="drop it")


def test_an_array_or_number_is_given_as_it_is():
    whole = np.arange(6, dtype=np.uint8).reshape(3, 2)
    assert checked_array(whole, "x", (None, 2)).dtype == np.float64
    assert checked_array(whole, "x", (None, 2), dtype=None) is whole
    assert checked_array([], "x", (0,)).size == 0
    assert np.isnan(checked_array([np.nan], "x", finite=False)).all()
    assert checked_number(3, "x") == 3.0
    for wrong in ([3], "3", True, None, 1e31, -1e31):
        with pytest.raises(BadInput, match="x must be"):
            checked_number(wrong, "x")
