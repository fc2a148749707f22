from functools import partial

import numpy as np
import pytest

from procedures.numerics.loops import convolve_at
from procedures.pattern_psf.observation import noise_window, observe
from procedures.pattern_psf.printed_edges import LINES, edge_columns
from procedures.pattern_psf.radiometry import measure_light
from procedures.pattern_psf.rasterise import band_limited_chart, whole_chart

from .conftest import CHART, Bench


@pytest.fixture(scope="module")
def columns(bench: Bench):
    samples = bench.clean.astype(np.float32)
    _, registration = bench.marks()
    window = noise_window(registration, samples.shape)
    o = observe(samples, registration, measure_light(samples, registration, 1e-5), window, margin_px=4)
    h = bench.photograph.true_psf("Y", 4, 17).h
    C = partial(edge_columns, whole_chart(CHART), registration, o.points, h, 4)
    return registration, o, h, C


@pytest.mark.slow
def test_moving_all_lines_moves_the_chart(bench: Bench, columns) -> None:
    registration, o, h, C = columns
    every = np.zeros(2 * LINES)
    every[:LINES] = 1.0
    # the chart moved by one cell along its x: the map that sees at p what it saw one cell before
    raster, window = band_limited_chart(CHART, registration, 4), noise_window(registration, bench.clean.shape)
    step = 0.02 * np.linalg.inv(registration.jacobian())[:, 0]
    pictures = [
        convolve_at(raster.read(registration.translated(d), window, 8), o.rows, o.columns, h.astype(np.float32), 4)
        for d in (-step, step)
    ]
    expected = (pictures[0] - pictures[1]) / 0.04
    # light at the pieces' middles, and a PSF cut at 3 % of its peak: good to some per cent
    assert np.linalg.norm(C(np.ones(len(o.y))).apply(every) - expected) < 0.1 * np.linalg.norm(expected)


def test_offsets_come_back_and_noise_alone_has_none(columns, rng):
    _, o, _, C = columns
    truth = 0.03 * rng.standard_normal(2 * LINES)
    noise = 0.004
    v = (C(np.ones(len(o.y))).apply(truth) + noise * rng.standard_normal(len(o.y))) / noise
    edges = C(np.full(len(o.y), 1 / noise))
    rms, left = edges.widths(v)
    # 514 offsets give their own width to 1 / sqrt(1028) = 3 %, the cells' random signs a few per cent more
    assert rms == pytest.approx(0.03, rel=0.15)
    assert left == pytest.approx(1, rel=0.15)
    assert np.corrcoef(edges.estimator(rms, left)(v), truth)[0, 1] > 0.9
    assert C(np.full(len(o.y), 1 / 0.004)).widths(rng.standard_normal(len(o.y)))[0] < 0.006


@pytest.mark.slow
def test_products_are_those_of_one_matrix(columns, rng: np.random.Generator) -> None:
    _, o, _, C = columns
    edges = C(np.ones(len(o.y)))
    C_whole = np.column_stack([edges.apply(line) for line in np.eye(2 * LINES)])
    samples, scale = rng.standard_normal(len(o.y)), np.abs(C_whole).sum(axis=0).max()
    # single precision
    assert np.allclose(edges.apply_transposed(samples), C_whole.T @ samples, atol=1e-5 * scale)
    assert np.allclose(edges.gram, C_whole.T @ C_whole, atol=1e-5 * scale)
