"""The compiled extension computes what the loops' Python source does, refuses what it cannot take, and is optional."""

import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from procedures.numerics import loops
from procedures.numerics.arrays import field_of
from procedures.numerics.loops import build_extension, edges, layouts, matrices, saddles, splines
from procedures.pattern_psf.chart_finding.corner_layouts import RIM, RULES
from procedures.pattern_psf.chart_finding.marks import SAME_AXIS

ROOT = Path(__file__).resolve().parents[3]
PYTHON = {
    name: getattr(module, name)
    for module in (edges, layouts, matrices, saddles, splines)
    for name in loops.__all__
    if hasattr(module, name)
}
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


def pixels(rng):
    return rng.integers(0, 8, 30), rng.integers(0, 9, 30)


def kernels():
    t = np.arange(5, dtype=np.float32) / 1.3  # no value of a derivative is zero
    g = np.exp(-(t**2) / 2) / 2.5
    return np.array([g, t * g, (t**2 - 1) * g], np.float32)


def spline(rng):
    H = np.array([[0.4, 0.02, 3], [-0.03, 0.5, 2], [1e-4, -2e-4, 1]])
    places = np.array([20.0, 15]), 30.0, 0.3 * rng.standard_normal((2, 9)), np.array([-3.0, -2]), 0.7, (60, 80)
    return float32(rng, 25, 30), H, *places


def convolution(rng):
    return (float32(rng, 30, 33), *pixels(rng))


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
    "square_sides": lambda rng: (field := lattices(rng), layouts.collinear_triples(field, RULES), RULES),
    "substituted": lambda rng: (triangle(rng, 40, np.float32), float32(rng, 40)),
    "sums_of_groups": lambda rng: (float32(rng, 40, 7), rng.integers(0, 5, 40), float32(rng, 40), 6),
}  # fmt: skip


def parts(answer, arguments):
    """Arrays of an answer; the first argument where the loop writes to it."""
    if answer is None:
        return [arguments[0]]
    return list(answer) if isinstance(answer, tuple) else [answer]


@pytest.mark.slow
@pytest.mark.parametrize("name", loops.__all__)
def test_extension_computes_what_the_python_source_does(name, native):
    answers = []
    for loop in (PYTHON[name], getattr(native, name)):
        arguments = CASES[name](np.random.default_rng(3))
        answers.append(parts(loop(*arguments), arguments))
    for expected, got in zip(*answers, strict=True):
        assert expected.size
        assert (expected.dtype, expected.shape) == (got.dtype, got.shape)
        tolerance = {"f": SINGLE, "F": SINGLE, "d": DOUBLE}.get(expected.dtype.char, EXACT)
        np.testing.assert_allclose(got, expected, rtol=0, atol=tolerance * float(np.abs(expected).max()))


# --- what the loops compute, by NumPy and SciPy --------------------------------------------------------------------


def dense_edges(vertical, first_vertical, horizontal, first_horizontal, lines):
    """C of `EdgeColumns` with zeros, (samples, 2 lines)."""
    C = np.zeros((len(vertical), 2 * lines))
    for block, first, offset in ((vertical, first_vertical, 0), (horizontal, first_horizontal, lines)):
        for p, row in enumerate(block):
            width = min(len(row), lines - first[p])
            C[p, offset + first[p] : offset + first[p] + width] = row[:width]
    return C


def windows(raster, rows, columns, k, s):
    return np.stack([raster[s * r : s * r + k, s * c : s * c + k] for r, c in zip(rows, columns, strict=True)])


def band(cut, spectrum, filter_y, filter_x, J, limit):
    n, ky, kx = len(spectrum), np.arange(len(filter_y)) - len(filter_y) // 2, np.arange(len(filter_x))
    inside = (np.abs(np.add.outer(J[1, 0] * ky, J[0, 0] * kx)) <= limit * n) & (
        np.abs(np.add.outer(J[1, 1] * ky, J[0, 1] * kx)) <= limit * n
    )
    cut[ky] += inside * spectrum[np.ix_(ky % n, kx % n)] * np.outer(filter_y, filter_x)
    return cut


def read_at(coefficients, H, centre, radius, displacement, start, step, shape):
    py, px = (start[axis] + step * np.arange(n) for axis, n in zip((1, 0), shape, strict=True))
    y, x = np.meshgrid((py - centre[1]) / radius, (px - centre[0]) / radius, indexing="ij")
    powers = np.stack([x, y, x**2, x * y, y**2, x**3, x**2 * y, x * y**2, y**3])
    q = np.stack(np.meshgrid(px, py)) + np.tensordot(displacement, powers, 1)
    gx, gy, w = np.tensordot(H, np.stack([*q, np.ones(shape)]), 1)
    places = [np.clip(g / w, 1, n - 2.001) for g, n in zip((gy, gx), coefficients.shape, strict=True)]
    return ndimage.map_coordinates(coefficients, places, order=3, prefilter=False)


def saddles_of(image, kernels, flatter, weakest):
    g, d, dd = (np.concatenate([sign * k[:0:-1], k]) for k, sign in zip(kernels, (1, -1, 1), strict=True))
    along = [partial(ndimage.correlate1d, axis=axis, mode="mirror") for axis in (0, 1)]
    xx, yy, xy = (
        along[1](along[0](image.astype(float), a), b) for a, b in ((g, dd), (dd, g), (d, d))
    )  # fmt: skip
    squared, mean = ((xx - yy) / 2) ** 2 + xy**2, ((xx + yy) / 2) ** 2
    strength = squared - mean
    peak = strength == ndimage.maximum_filter(strength, 3, mode="constant", cval=-np.inf)
    at = np.flatnonzero(peak & (mean < flatter**2 * squared) & (squared > weakest**2))
    return at, ((xx - yy) / 2).ravel()[at], xy.ravel()[at]


def purity(image, index, radius, off_centre):
    turn = np.arange(8) * np.pi / 4
    row, column = (n[:, None] for n in np.unravel_index(index, image.shape))
    places = [row + radius * np.sin(turn), column + radius * np.cos(turn)]
    c = np.abs(np.fft.fft(ndimage.map_coordinates(image.astype(float), places, order=1, mode="nearest"))) ** 2 / 8
    return 2 * c[:, 2] / (c[:, 1:].sum(axis=1) - 2 * off_centre * c[:, 1])


def best_pixels(index, shape, merits, side, most):
    """The best of every tile, as many of each as needed."""
    row, column = np.unravel_index(index, shape)
    tiles = row // side * -(-shape[1] // side) + column // side
    order = [np.flatnonzero(tiles == tile) for tile in np.unique(tiles)]
    order = [one[np.argsort(-merits[one])] for one in order]
    each = next(n for n in range(len(index) + 1) if sum(min(len(one), n) for one in order) >= min(most, len(index)))
    return np.sort(np.concatenate([one[:each] for one in order]))


def lines_around(cells, steps, fine, scale, reach, pieces, weight):
    """Sums over the lines' points, `pieces` a cell, of the step times the nearest sample."""
    n, width = steps.shape[1], 2 * int(np.ceil(reach[0])) + 1
    values, first = np.zeros((len(cells), width)), np.clip(np.floor(cells[:, 0] - reach[0]), 0, n).astype(int)
    for p, (u, v) in enumerate(cells):
        i0, i1 = max(int(v - reach[1]), 0), min(int(v + reach[1]) + 1, n)
        along = v - i0 - (np.arange((i1 - i0) * pieces) + 0.5) / pieces
        for j in range(first[p], min(first[p] + width, n + 1)):
            x, y = np.floor(scale @ [np.full_like(along, u - j), along] + len(fine) // 2 + 0.5).astype(int)
            inside = (np.minimum(x, y) >= 0) & (np.maximum(x, y) < len(fine))
            line = np.repeat(steps[j, i0:i1], pieces)[inside]
            values[p, j - first[p]] = weight[p] / pieces * line @ fine[y[inside], x[inside]]
    return values, first


def like(field, i, j, rules):
    """Whether saddles, of indices or of all, have similar axes and merits."""
    ratio = field.merits[i] / field.merits[j]
    similar = (field.axes[i] * field.axes[j].conj()).real > rules.same_axis
    return similar & (ratio < rules.same_merit) & (ratio > 1 / rules.same_merit)


def nearest(field, place, reach, i, rules):
    """By a search through all saddles; -1 for none."""
    distance = np.where(like(field, i, slice(None), rules), np.abs(field.points - place), np.inf)
    return int(np.argmin(distance)) if np.min(distance) <= reach else -1


def steps_from(field, i, rules):
    """Mask of the saddles that lie a lattice step from one."""
    d, axis = field.points - field.points[i], field.axes + field.axes[i]
    length = np.abs(d)
    straight = np.abs((d**2 * axis.conj()).real) > rules.along_axis * length**2 * np.abs(axis)
    return straight & (length > rules.min_step) & (length < rules.max_step) & like(field, i, slice(None), rules)


def is_free(field, i, j, rules):
    a, b = field.points[i], field.points[j]
    return nearest(field, (a + b) / 2, rules.middle_radius * abs(b - a), i, rules) < 0


def triples_of(field, rules):
    triples = []
    for i in range(len(field.points)):
        d = field.points - field.points[i]
        for j in np.flatnonzero(steps_from(field, i, rules) & (d.imag >= -rules.level_slope * np.abs(d.real))):
            k = nearest(field, field.points[j] + d[j], rules.collinear * abs(d[j]), j, rules)
            if (
                k >= 0
                and steps_from(field, j, rules)[k]
                and (is_free(field, i, j, rules) or is_free(field, j, k, rules))
            ):
                triples.append((i, j, k))
    return np.array(triples)


def sides_of(field, triples, rules):
    """Hits of every x-corner of the rim, in steps (s, t) of the triple's line and of the direction across it."""
    sides = []
    for i, j, k in triples:
        u = (field.points[k] - field.points[i]) / 2
        free = is_free(field, i, j, rules) and is_free(field, j, k, rules)
        for v, first in ((u * 1j, 0), (u * 1j, 1), (-u * 1j, 0), (-u * 1j, 1)):

            def at(s, t, share, origin=field.points[i] - first * u, u=u, v=v, j=j):
                return nearest(field, origin + s * u + t * v, share * abs(u), j, rules)

            known = {(first + n, 0): index for n, index in enumerate((i, j, k))}
            near = [(int(s), int(t)) for s, t in RIM if t < 3 and (s, t) not in known]
            found = known | {place: at(*place, rules.square) for place in near}
            hits = [n for place, n in found.items() if place not in known and n >= 0]
            lattice = at(1, 1, rules.collinear) >= 0 and at(2, 1, rules.collinear) >= 0
            off_the_side = any(found[place] >= 0 for place in near if place[1])
            if off_the_side and not lattice and len(hits) >= (rules.min_near if free else rules.min_near_crowded):
                sides.append([found.get((int(s), int(t)), -1) for s, t in RIM])
    return np.array(sides)


def maxima(field, radius, same_axis):
    n = np.arange(len(field.points))
    better = (field.merits > field.merits[:, None]) | ((field.merits == field.merits[:, None]) & (n > n[:, None]))
    close = np.abs(np.subtract.outer(field.points, field.points)) <= radius
    return ~(better & close & (np.multiply.outer(field.axes, field.axes.conj()).real > same_axis)).any(axis=1)


REFERENCES = {
    "add_band": band,
    "all_nearest": lambda field, places, reaches, likes, rules: np.array(
        [[nearest(field, one, r, i, rules) for one in row] for row, r, i in zip(places, reaches, likes, strict=True)]
    ),
    "apply_edges": lambda *a: dense_edges(*a[:4], len(a[4]) // 2) @ a[4],
    "apply_edges_transposed": lambda *a: dense_edges(*a[:4], a[5]).T @ a[4],
    "best_of_tiles": best_pixels,
    "collinear_triples": triples_of,
    "convolve_at": lambda raster, rows, columns, h, s: np.einsum(
        "nij,ij->n", windows(raster, rows, columns, len(h), s), h[::-1, ::-1]
    ),
    "edge_gram": lambda *a: np.tril((C := dense_edges(*a)).T @ C),
    "edge_lines": lines_around,
    "fill_convolution": lambda A, raster, rows, columns, weight, s, k: np.hstack(
        [weight[:, None] * windows(raster, rows, columns, k, s)[:, ::-1, ::-1].reshape(len(rows), -1), A[:, k * k :]]
    ),
    "folded_product": lambda transform, spectrum, s: (transform * spectrum).reshape(s, -1, transform.shape[1]).sum(0),
    "inverted": np.linalg.inv,
    "non_maximum_suppression": maxima,
    "read_spline": read_at,
    "ring_purity": purity,
    "saddle_points": saddles_of,
    "square_sides": sides_of,
    "substituted": lambda L, b: np.linalg.solve(L.astype(float) @ L.T.astype(float), b),
    "sums_of_groups": lambda A, group, factor, count: (group == np.arange(count)[:, None]) @ (factor[:, None] * A),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", REFERENCES)
def test_loops_compute_what_numpy_and_scipy_do(name):
    arguments = CASES[name](np.random.default_rng(3))
    answers = parts(PYTHON[name](*arguments), arguments)
    expected = REFERENCES[name](*CASES[name](np.random.default_rng(3)))
    for got, right in zip(answers, expected if isinstance(expected, tuple) else [expected], strict=True):
        assert got.size
        got = np.sort(got) if name == "best_of_tiles" else got
        np.testing.assert_allclose(got, right, rtol=0, atol=SINGLE * float(np.abs(right).max()))


def test_the_extension_keeps_bins_digits_and_copies(native):
    points = lattices(np.random.default_rng(3)).points
    field, order = field_of(points, points, points.real, 12.0)
    np.testing.assert_array_equal(field.points, points[order])
    assert len(field.starts) == field.rows * field.columns + 1
    bins = np.repeat(np.arange(field.rows * field.columns), np.diff(field.starts))
    places = np.stack([bins % field.columns, bins // field.columns])
    corner = np.stack([field.points.real - field.left, field.points.imag - field.top])
    assert np.all((corner >= 12 * places) & (corner < 12 * (places + 1)))
    places = np.zeros(1, np.int64)
    with pytest.raises(TypeError, match="incompatible function arguments"):
        native.convolve_at(np.ones((9, 9)), places, places, np.ones((3, 3), np.float32), 1)
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
def test_loops_are_numbas_where_the_extension_is_not_installed():
    name = "procedures.numerics.loops"
    absent = f"sys.modules['{name}._native'] = None"
    assert imports(name, first=absent) == "[]\n"
    assert imports(name, first=f"{absent}; from {name} import edge_lines").startswith("['llvmlite', 'numba'")


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
    assert said.startswith("no extension, the loops will be compiled by Numba when first used: ")
    assert data == "{'artifacts': []}"
    assert not list(folder.glob("_native*"))


def test_wheel_with_the_extension_is_for_this_system(monkeypatch):
    monkeypatch.setattr(build_extension, "build", lambda: None)
    data = {"artifacts": []}
    build_extension.LoopExtension("", {}, None, None, "", "wheel").initialize("standard", data)
    (module,) = data.pop("artifacts")
    assert module.startswith("procedures/numerics/loops/_native")
    assert data == {"pure_python": False, "infer_tag": True}
