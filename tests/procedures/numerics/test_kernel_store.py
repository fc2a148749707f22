"""Machine code that is kept: what kernels answer with it, and when it is made anew."""

from __future__ import annotations

import gc
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from procedures.numerics import compiled, kernel_store
from procedures.numerics.native_call import described

ROOT = Path(__file__).parents[3]
SOURCE = """
from typing import NamedTuple
import numpy as np
from procedures.numerics.compiled import compiled

FACTOR = 2.5

class Pair(NamedTuple):
    values: np.ndarray
    n: int

@compiled
def scaled(x):
    return x * FACTOR

@compiled
def many(pair, place, flag, size):
    out = np.zeros((len(pair.values), 2), np.float32)
    for i in range(len(pair.values)):
        out[i, 0] = scaled(pair.values[i] * place.real)
        out[i, 1] = abs(place) + size[1]
    return out[1:], pair.n > 2 and flag, np.sqrt(pair.values), place * 1j, size[0]

@compiled
def doubled(x):
    for i in range(len(x)):
        x[i] *= 2

@compiled
def flat(x):
    return x.reshape(-1)[::2].copy().reshape(2, 2)
"""


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """A module of kernels, written anew, and what makes another of the same file."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python does not see what changed within a second
    path = tmp_path / "some_kernels.py"

    def module(source=SOURCE):
        if not path.exists() or path.read_text() != source:
            path.write_text(source)
        spec = importlib.util.spec_from_file_location("some_kernels", path)
        made = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(made)
        return made

    return module


def answers(made):
    return made.many(made.Pair(np.arange(4.0), 3), 3 + 4j, True, (7, 8))


def assert_right(found):
    array, flag, roots, turned, first = found
    np.testing.assert_array_equal(array, np.array([[7.5, 13], [15, 13], [22.5, 13]], np.float32))
    assert array.dtype == np.float32
    np.testing.assert_array_equal(roots, np.sqrt(np.arange(4.0)))
    assert (flag, turned, first) == (True, -4 + 3j, 7)


@pytest.mark.slow
def test_every_kind_of_argument_and_answer_is_handed_over(kernels):
    made = kernels()
    assert_right(answers(made))
    x = np.arange(3.0)
    assert made.doubled(x) is None
    np.testing.assert_array_equal(x, [0, 2, 4])
    # rows that are apart in memory, as they are
    wide = np.arange(8.0).reshape(4, 2)
    np.testing.assert_array_equal(made.many(made.Pair(wide[:, 0], 3), 1 + 0j, True, (1, 2))[2], np.sqrt(wide[:, 0]))


@pytest.mark.slow
def test_what_is_kept_is_not_compiled_again(kernels, monkeypatch):
    answers(kernels())
    monkeypatch.setattr(compiled.Kernel, "_compiled", lambda *_: pytest.fail("it was compiled again"))
    assert_right(answers(kernels()))


@pytest.mark.slow
def test_a_copy_of_the_source_elsewhere_uses_what_is_kept(kernels, monkeypatch, tmp_path):
    answers(kernels())
    copied = tmp_path / "copied" / "some_kernels.py"
    copied.parent.mkdir()
    copied.write_text(SOURCE)
    os.utime(copied, (0, 0))
    spec = importlib.util.spec_from_file_location("some_kernels", copied)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    monkeypatch.setattr(compiled.Kernel, "_compiled", lambda *_: pytest.fail("it was compiled again"))
    assert_right(answers(made))


@pytest.mark.slow
@pytest.mark.parametrize("change", [("FACTOR = 2.5", "FACTOR = 5.0"), ("return x * FACTOR", "return x * 5.0    ")])
def test_changed_constant_and_changed_callee_are_compiled_anew(kernels, change):
    answers(kernels())
    np.testing.assert_array_equal(answers(kernels(SOURCE.replace(*change)))[0][:, 0], [15, 30, 45])


@pytest.mark.slow
def test_damaged_file_is_written_again(kernels, tmp_path):
    answers(kernels())
    for file in (tmp_path / "kept").glob("*.kernel"):
        whole = file.read_bytes()
        for wrong in (b"[]\nx", b"[" * 100_000, b"", whole[:-100]):
            file.write_bytes(wrong)
            assert kernel_store.read(file) is None
    assert_right(answers(kernels()))
    assert all(kernel_store.read(file) for file in (tmp_path / "kept").glob("*.kernel"))


@pytest.mark.slow
def test_code_that_needs_more_of_numba_is_left_to_it(kernels, tmp_path):
    made = kernels()
    np.testing.assert_array_equal(made.flat(np.arange(8.0).reshape(2, 4)[:, :4]), [[0, 2], [4, 6]])
    x = np.arange(16.0).reshape(2, 8)[:, ::2]
    np.testing.assert_array_equal(made.flat(np.ascontiguousarray(x)), [[0, 4], [8, 12]])


@pytest.mark.slow
def test_folder_that_cannot_be_written_keeps_nothing_and_works(kernels, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "below"))
    assert_right(answers(kernels()))


@pytest.mark.slow
def test_arrays_outlive_the_call_and_free_their_memory(kernels):
    made = kernels()
    array, _, roots, *_ = answers(made)
    part = roots[2:]
    del roots
    gc.collect()
    for _ in range(50):
        answers(made)  # whatever was freed is written over
    assert_right((array, True, np.concatenate([[0, 1], part]), -4 + 3j, 7))


@pytest.mark.parametrize("value", ["text", np.array(["a"]), None, np.zeros(2, ">f8"), (1, "a")])
def test_what_cannot_be_handed_over_is_left_to_numba(value):
    assert described(value) == ""


def test_what_a_chart_is_estimated_with_imports_neither_scipy_nor_the_compiler():
    words = "import sys; import station.calibration.planes, station.results.result_files; "
    words += "import procedures.pattern_psf.estimate; "
    words += "print(sorted({'numba', 'scipy', 'matplotlib', 'rawpy', 'h5py', 'exifread'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", words], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
