"""The compiled extension computes what array operations do, refuses what it cannot take, and is optional."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from procedures.numerics.arrays import field_of
from procedures.numerics.loops import array_operations, build_extension
from procedures.pattern_psf.chart_finding.corner_layouts import RIM, RULES
from procedures.pattern_psf.chart_finding.marks import SAME_AXIS

ROOT = Path(__file__).resolve().parents[3]
EXACT, SINGLE, DOUBLE = 0.0, 2e-5, 1e-12
"""Greatest differences, relative to the greatest value: indices; sums of hundreds of numbers in either precision."""


@pytest.fixture
def native():
    return pytest.importorskip("procedures.numerics.loops._native", reason="installed without a compiler")


def float32(rng, *shape):
    return rng.standard_normal(shape).astype(np.float32)


def complex64(rng, *shape):
    return (float32(rng, *shape) + 1j * float32(rng, *shape)).astype(np.complex64)


def sparse_edges(rng):
    """Columns of `EdgeColumns` with 20 lines a direction, at either end of them too."""
    first = [np.r_[0, 17, rng.integers(0, 18, 38)].astype(np.int32) for _ in range(2)]
    return float32(rng, 40, 5), first[0], float32(rng, 40, 4), first[1]


def lattices(rng):
    """Sorted saddles: charts' rims of several sizes and positions, whole lattices, one with a row between, clutter."""
    grid = np.add.outer(np.arange(5), 1j * np.arange(5)).ravel()
    shapes = [RIM @ [1, 1j]] * 12 + [grid] * 3 + [np.append(grid, np.arange(0.5, 4.5) + 2j)]
    shapes = [one * rng.uniform(18, 36) * np.exp(1j * rng.uniform(0, 7)) for one in shapes]
    axes = [np.full(len(one), np.exp(2j * np.angle(one[1] - one[0]))) for one in shapes]
    clutter = rng.uniform(0, 600, 300) + 1j * rng.uniform(0, 600, 300)
    points = np.concatenate([*(one + complex(*rng.uniform(0, 600, 2)) for one in shapes), clutter])
    n = len(points)
    points += 0.3 * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
    axes = np.concatenate([*axes, np.exp(1j * rng.uniform(0, 7, 300))])
    return field_of(points, axes, rng.uniform(1, 3, n), 12.0)[0]


def triangle(rng, n, dtype):
    return (np.tril(rng.standard_normal((n, n))) + 3 * n**0.5 * np.eye(n)).astype(dtype)


def near(rng, field):
    """Places, reaches and similar saddles."""
    like = rng.integers(0, len(field.points), 50)
    step = 4 * (rng.standard_normal((50, 3)) + 1j * rng.standard_normal((50, 3)))
    places = field.points[like][:, None] + step
    places[0] = np.inf, np.nan, 1e12
    return places, rng.uniform(5, 40, 50), like, RULES


def picture(rng):
    return np.cumsum(np.cumsum(float32(rng, 45, 70), axis=0), axis=1) / 100


def kernels():
    t = np.arange(5, dtype=np.float32) / 1.3  # no value of a derivative is zero
    g = np.exp(-(t**2) / 2) / 2.5
    return np.array([g, t * g, (t**2 - 1) * g], np.float32)


def spline(rng):
    H = np.array([[0.4, 0.02, 3], [-0.03, 0.5, 2], [1e-4, -2e-4, 1]])
    places = np.array([20.0, 15]), 30.0, 0.3 * rng.standard_normal((2, 9)), np.array([-3.0, -2]), 0.7, (60, 80)
    return float32(rng, 25, 30), H, *places


def convolution(rng):
    return float32(rng, 30, 33), rng.integers(0, 8, 30), rng.integers(0, 9, 30)


CASES = {
    "add_band": lambda rng: (
        np.zeros((24, 11), np.complex64), complex64(rng, 12, 12), complex64(rng, 21), complex64(rng, 11),
        np.array([[0.9, 0.1], [-0.2, 1.1]]), 0.6,
    ),
    "all_nearest": lambda rng: (field := lattices(rng), *near(rng, field)),
    "apply_edges": lambda rng: (*sparse_edges(rng), float32(rng, 40)),
    "apply_edges_transposed": lambda rng: (*sparse_edges(rng), float32(rng, 40), 20),
    "best_of_tiles": lambda rng: (np.sort(rng.choice(64 * 97, 500, replace=False)), (64, 97), rng.random(500), 32, 60),
    "collinear_triples": lambda rng: (lattices(rng), RULES),
    "convolve_at": lambda rng: (*convolution(rng), float32(rng, 7, 7), 3),
    "edge_gram": lambda rng: (*sparse_edges(rng), 20),
    "edge_lines": lambda rng: (
        rng.uniform(-1, 21, (40, 2)), float32(rng, 21, 20), float32(rng, 29, 29),
        np.array([[7.0, 0.4], [-0.3, 8.0]]), np.array([1.6, 1.4]), 3, float32(rng, 40),
    ),
    "fill_convolution": lambda rng: (np.zeros((30, 51), np.float32), *convolution(rng), float32(rng, 30), 3, 7),
    "folded_product": lambda rng: (complex64(rng, 12, 7), float32(rng, 12, 7), 3),
    "inverted": lambda rng: (triangle(rng, 40, np.float64),),
    "non_maximum_suppression": lambda rng: (
        (field := lattices(rng))._replace(merits=field.merits.round(1)), 12.0, SAME_AXIS,
    ),
    "read_spline": spline,
    "ring_purity": lambda rng: (picture(rng), rng.integers(0, 45 * 70, 60), 2.0, 0.7),
    "saddle_points": lambda rng: (picture(rng), kernels(), 0.9, 1e-3),
    "square_sides": lambda rng: (field := lattices(rng), array_operations.collinear_triples(field, RULES), RULES),
    "substituted": lambda rng: (triangle(rng, 40, np.float32), float32(rng, 40)),
    "sums_of_groups": lambda rng: (float32(rng, 40, 7), rng.integers(0, 5, 40), float32(rng, 40), 6),
}  # fmt: skip


def parts(answer, arguments):
    """Arrays of an answer; the first argument where the loop writes to it."""
    if answer is None:
        return [arguments[0]]
    return list(answer) if isinstance(answer, tuple) else [answer]


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_extension_computes_what_array_operations_do(name, native):
    answers = []
    for loop in (getattr(array_operations, name), getattr(native, name)):
        arguments = CASES[name](np.random.default_rng(3))
        answers.append(parts(loop(*arguments), arguments))
    for expected, got in zip(*answers, strict=True):
        assert expected.size
        assert (expected.dtype, expected.shape) == (got.dtype, got.shape)
        tolerance = {"f": SINGLE, "F": SINGLE, "d": DOUBLE}.get(expected.dtype.char, EXACT)
        np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * float(np.abs(expected).max()))


def test_saddles_lie_in_the_bins_of_their_places():
    points = lattices(np.random.default_rng(3)).points
    field, order = field_of(points, points, points.real, 12.0)
    np.testing.assert_array_equal(field.points, points[order])
    assert len(field.starts) == field.rows * field.columns + 1
    bins = np.repeat(np.arange(field.rows * field.columns), np.diff(field.starts))
    places = np.stack([bins % field.columns, bins // field.columns])
    corner = np.stack([field.points.real - field.left, field.points.imag - field.top])
    assert np.all((corner >= 12 * places) & (corner < 12 * (places + 1)))


def test_extension_refuses_numbers_that_would_lose_digits(native):
    places = np.zeros(1, np.int64)
    with pytest.raises(TypeError, match="incompatible function arguments"):
        native.convolve_at(np.ones((9, 9)), places, places, np.ones((3, 3), np.float32), 1)


def test_extension_fills_no_copy(native):
    arguments = np.ones((9, 9), np.float32), *np.zeros((2, 1), np.int64), np.ones(1, np.float32), 1, 3
    with pytest.raises(TypeError, match="incompatible function arguments"):
        native.fill_convolution(np.zeros((1, 18), np.float32)[:, ::2], *arguments)


def imports(*modules, first=""):
    """The names of some slow packages that are loaded by some modules."""
    words = f"import sys\n{first}\nimport {', '.join(modules)}\n"
    words += "print(sorted({'numba', 'llvmlite', 'scipy', 'matplotlib', 'rawpy', 'h5py'} & set(sys.modules)))"
    return subprocess.run([sys.executable, "-c", words], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_estimate_of_a_chart_imports_neither_scipy_nor_a_compiler(native):
    used = "station.calibration.planes", "station.results.result_files", "procedures.pattern_psf.estimate"
    assert imports(*used) == "[]\n"


@pytest.mark.slow
def test_loops_are_array_operations_where_the_extension_is_not_installed():
    name = "procedures.numerics.loops"
    absent = f"sys.modules['{name}._native'] = None"
    assert imports(name, first=absent) == "[]\n"
    assert imports(name, first=f"{absent}; from {name} import edge_lines") == "['scipy']\n"


BUILD = """
import sys
sys.path.insert(0, "procedures/numerics/loops")
import build_extension
class App:
    def display_warning(self, text):
        print(text)
data = {"artifacts": []}
hook = build_extension.LoopExtension("", {}, None, None, "", "wheel", App())
hook.initialize("standard", data)
print(data)
"""


@pytest.mark.slow
def test_build_without_a_compiler_says_so_in_one_line_and_goes_on(tmp_path):
    folder = tmp_path / "procedures" / "numerics" / "loops"
    ignored = shutil.ignore_patterns("_native*", "__pycache__")
    shutil.copytree(ROOT / "procedures" / "numerics" / "loops", folder, ignore=ignored)
    environment = os.environ | {"CC": "/bin/false", "CXX": "/bin/false"}
    done = subprocess.run(
        [sys.executable, "-c", BUILD], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    said, data = done.stdout.splitlines()
    assert said.startswith("no extension, its loops run slower by array operations: ")
    assert data == "{'artifacts': []}"
    assert not list(folder.glob("_native*"))


def test_wheel_with_the_extension_is_for_this_system(monkeypatch):
    monkeypatch.setattr(build_extension, "build", lambda: None)
    data = {"artifacts": []}
    build_extension.LoopExtension("", {}, None, None, "", "wheel").initialize("standard", data)
    (module,) = data.pop("artifacts")
    assert module.startswith("procedures/numerics/loops/_native")
    assert data == {"pure_python": False, "infer_tag": True}
